//! A cohort reaches its end whatever is killed meanwhile: no result is lost or published twice, and
//! no finished task is begun again.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK, Tally, lives, pid_of, signal};
use crate::ranks;

const SEVEN: [&str; 7] = [
    "01-CoA", "02-CoA", "03-CoA", "04-CoA", "05-CoA", "06-CoA", "07-CoA",
];
/// The paper's search, shortened.
const STEP2: &str = "popsize = 5\nmax_generations = 60\n";
const NODES: [&str; 4] = ["n1", "n2", "n3", "n4"];

/// Personalisations in 3D, two at once on a node.
fn in_3d<'a>(cluster: &'a Cluster, patients: &[&str], step2: &str) -> Cohort<'a> {
    Cohort::of(cluster, patients, step2)
        .set("solver.fidelity=finite-element")
        .set("solver.finite_element.mesh_nodes=500")
        .set("executor.slurm.memory_MiB=120000")
        .set("executor.site_retries=100")
        .set("executor.slurm.free_repeats=1000")
}

/// Claims of the drivers that are at work.
fn drivers(cohort: &Cohort) -> Vec<PathBuf> {
    let files = cohort
        .jobs()
        .into_iter()
        .flat_map(|job| std::fs::read_dir(job).into_iter().flatten().flatten());
    let claims = files.map(|entry| entry.path()).filter(|path| {
        path.file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with("started-"))
    });
    claims
        .filter(|claim| pid_of(claim).is_some_and(lives))
        .collect()
}

/// A coordinator that is started again when it is dead.
struct Coordinator<'a> {
    cohort: &'a Cohort<'a>,
    process: Child,
    /// Time at which drained nodes were looked for.
    looked: Instant,
}

/// Time between two looks for drained nodes.
const LOOK: Duration = Duration::from_secs(10);

impl<'a> Coordinator<'a> {
    fn start(cohort: &'a Cohort<'a>) -> Self {
        Self {
            cohort,
            process: cohort.watch(),
            looked: Instant::now(),
        }
    }

    fn kill(&mut self) {
        let _ = self.process.kill();
        self.process.wait().expect("it is ours");
    }

    /// Whether the coordinator ended because everything is over. If it ended for another reason, it
    /// is started again.
    #[track_caller]
    fn is_over(&mut self) -> bool {
        if self.looked.elapsed() > LOOK {
            self.cohort.cluster.resume_drained();
            self.looked = Instant::now();
        }
        match self
            .process
            .try_wait()
            .expect("it is ours")
            .map(|status| status.code())
        {
            None => false,
            Some(Some(0)) => true,
            Some(Some(1)) => panic!(
                "a patient failed: {:#}\n{}\n{}",
                self.cohort.status(),
                self.cohort.cluster.slurm(
                    "sacct",
                    &[
                        "-P",
                        "-X",
                        "-o",
                        "jobid,jobname,state,exitcode,reason,start,end"
                    ]
                ),
                self.cohort.cluster.slurm("scontrol", &["show", "job"]),
            ),
            Some(_) => {
                self.process = self.cohort.watch();
                false
            }
        }
    }
}

impl Drop for Coordinator<'_> {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Kills the coordinator, the database daemon, the controller and a worker. With `by_slurms_clock`
/// a slurmd is killed, too, and one job runs into its walltime.
fn every_kind_of_kill(cluster: &Cluster, cohort: &Cohort, by_slurms_clock: bool) -> Tally {
    let mut coordinator = Coordinator::start(cohort);
    cluster.wait("workers", || !cohort.workers().is_empty());
    coordinator.kill();
    cluster.kill("slurmdbd");
    cluster.kill("slurmctld");
    coordinator = Coordinator::start(cohort); // neither of them answers it
    cluster.wait("a worker", || !cohort.workers().is_empty());
    cohort
        .workers()
        .first()
        .into_iter()
        .for_each(|claim| signal(claim, Signal::KILL));
    cluster.revive("slurmdbd"); // without it a killed controller does not start
    cluster.revive("slurmctld");
    let mut down = None;
    if by_slurms_clock {
        let jobs = || cluster.slurm("squeue", &["--me", "-h", "-r", "-t", "R", "-o", "%i %N"]);
        let find = |other: &str| {
            let rows = jobs();
            let mut rows = rows.lines().filter_map(|row| row.split_once(' '));
            rows.find(|(_, node)| *node != other)
                .map(|(id, node)| (id.to_owned(), node.to_owned()))
        };
        cluster.wait("two jobs on two nodes", || {
            find("").is_some_and(|(_, node)| find(&node).is_some())
        });
        let (late, node) = find("").expect("it was there");
        cluster.slurm(
            "scontrol",
            &["update", &format!("jobid={late}"), "endtime=now+1"],
        );
        let (_, node) = find(&node).expect("it was there");
        cluster.kill(&node);
        down = Some(node);
    }
    cluster.wait_for(Duration::from_secs(1800), "the end of the cohort", || {
        coordinator.is_over()
    });
    if let Some(node) = down {
        cluster.revive(&node);
    }
    cohort.assert_done();
    cohort.tally()
}

pub fn a_cohort_in_3d_survives_kills(cluster: &Cluster) {
    let cohort = in_3d(cluster, &["01-CoA", "05-CoA"], QUICK);
    let tally = every_kind_of_kill(cluster, &cohort, false);
    assert!(tally.published > 10, "{tally:?}");
}

/// Takes minutes; its table is in docs/slurm.md.
pub fn seven_patients_in_3d_survive_kills(cluster: &Cluster) {
    let cohort = in_3d(cluster, &SEVEN, STEP2);
    let began = Instant::now();
    let tally = every_kind_of_kill(cluster, &cohort, true);
    println!(
        "seven patients in 3D, {} jobs, {:.0} s: {tally:?}",
        cohort.jobs().len(),
        began.elapsed().as_secs_f64()
    );
}

/// Time for which three of four kills wait for a worker at work.
const WAIT: Duration = Duration::from_secs(20);

/// A generator of pseudo-random numbers.
struct Series(u64);

impl Series {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        usize::try_from((self.0 >> 33) % n.max(1) as u64).expect("small")
    }
}

/// `CARDIOTWIN_KILLS` kills (100 by default) over as many cohorts as needed. Three of four kills
/// wait for a worker at work. Every second cohort is in 3D, on MPI ranks over two nodes. After each
/// cohort the queue is empty. The table is in docs/measurements/slurm.md.
pub fn a_hundred_random_kills(cluster: &Cluster) {
    let number = |name: &str, else_: u64| {
        std::env::var(name)
            .ok()
            .and_then(|n| n.parse().ok())
            .unwrap_or(else_)
    };
    let (wanted, mut series) = (
        number("CARDIOTWIN_KILLS", 100),
        Series(number("CARDIOTWIN_SEED", 1)),
    );
    let mut kills: BTreeMap<&str, u64> = BTreeMap::new();
    let (mut total, mut n_jobs, mut at_work) = (Tally::default(), 0, 0);
    let (mut n_cohorts, mut n_of_ranks) = (0, 0);
    let began = Instant::now();
    while kills.values().sum::<u64>() < wanted {
        let is_of_ranks = n_cohorts % 2 == 1 && ranks::hindrance(cluster).is_none();
        // Steps so short that there is time to kill something.
        let cohort = if is_of_ranks {
            ranks::over_two_nodes(cluster, &["05-CoA", "06-CoA"]).set("solver.time_step_ms=0.5")
        } else {
            Cohort::of(cluster, &["01-CoA", "02-CoA", "03-CoA", "05-CoA"], STEP2)
                .set("executor.slurm.memory_MiB=120000")
                .set("solver.time_step_ms=0.05")
                .set("solver.shortest_step_ms=0.01")
        };
        let cohort = cohort
            .set("executor.site_retries=100")
            .set("executor.slurm.free_repeats=1000");
        let mut coordinator = Coordinator::start(&cohort);
        let mut down: Vec<(&str, Instant)> = Vec::new();
        let since = Instant::now();
        // Time until which the next kill waits for a worker: with a kill per second, nothing would
        // ever run.
        let mut waits_until = Instant::now() + WAIT;
        while !coordinator.is_over() {
            assert!(
                since.elapsed() < Duration::from_secs(3600),
                "it does not end: {:#}",
                cohort.status()
            );
            // Daemons come back after a while: a slurmd before or after its jobs are given up.
            down.retain(|(daemon, at)| {
                let is_due = at <= &Instant::now();
                is_due.then(|| cluster.revive(daemon));
                !is_due
            });
            // A controller does not start without the database daemon.
            if down.iter().any(|(daemon, _)| *daemon == "slurmctld")
                && let Some(at) = down.iter().position(|(daemon, _)| *daemon == "slurmdbd")
            {
                cluster.revive(down.swap_remove(at).0);
            }
            std::thread::sleep(Duration::from_millis(300 + 100 * series.below(10) as u64));
            if kills.values().sum::<u64>() >= wanted {
                continue;
            }
            let is_working = !cohort.workers().is_empty();
            if !is_working && Instant::now() < waits_until {
                continue;
            }
            waits_until = Instant::now()
                + if series.below(4) == 0 {
                    Duration::ZERO
                } else {
                    WAIT
                };
            let pick = |series: &mut Series, of: Vec<PathBuf>| {
                (!of.is_empty()).then(|| of[series.below(of.len())].clone())
            };
            let killed = match series.below(6) {
                0 => {
                    coordinator.kill();
                    coordinator = Coordinator::start(&cohort);
                    Some("coordinator")
                }
                1 => pick(&mut series, drivers(&cohort))
                    .map(|claim| (signal(&claim, Signal::KILL), "driver").1),
                2 => pick(&mut series, cohort.workers())
                    .map(|claim| (signal(&claim, Signal::KILL), "worker").1),
                daemon => {
                    let (name, kind) = match daemon {
                        3 => (NODES[series.below(4)], "slurmd"),
                        4 => ("slurmctld", "slurmctld"),
                        _ => ("slurmdbd", "slurmdbd"),
                    };
                    (down.iter().all(|(other, _)| *other != name)).then(|| {
                        cluster.kill(name);
                        let longest = if kind == "slurmd" { 40 } else { 4 };
                        down.push((
                            name,
                            Instant::now() + Duration::from_secs(series.below(longest) as u64),
                        ));
                        kind
                    })
                }
            };
            if let Some(kind) = killed {
                *kills.entry(kind).or_default() += 1;
                at_work += u64::from(is_working);
            }
        }
        cohort.assert_done();
        total += cohort.tally();
        drop(coordinator);
        cluster.recover();
        cluster.wait("an empty queue", || {
            cluster.slurm("squeue", &["--me", "-h"]).is_empty()
        });
        n_cohorts += 1;
        n_of_ranks += u64::from(is_of_ranks);
        n_jobs += cohort.jobs().len();
    }
    println!(
        "{kills:?}, {at_work} of them while a worker was at work, {n_cohorts} cohorts ({n_of_ranks} in 3D on ranks over two nodes), {n_jobs} jobs, {:.0} s: {total:?}",
        began.elapsed().as_secs_f64()
    );
}
