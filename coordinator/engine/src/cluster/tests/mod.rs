//! The tick against a model of Slurm: same results as the local loop, every crash point, random
//! faults.

mod breaker;
mod bundles;
mod cancelled;
mod crashes;
mod faults;
mod lab;
mod pilots;
mod recorded;
mod revoked;

use std::collections::BTreeMap;

use cardiotwin_schemas::failure::{FailureCause, FailureClass};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_slurm_model::{Behaviour, Fault, Limits, Settings};

use crate::tests::personalised;
use crate::{EventRecord, tests};
use lab::Lab;

fn noops(n: usize) -> Vec<ResolvedPatient> {
    (1..=n)
        .map(|i| ResolvedPatient::noop(&format!("P{i:02}"), 0))
        .collect()
}

/// Patients of half an hour each, which are expected to fill a job.
fn long_noops(n: usize) -> Vec<ResolvedPatient> {
    (1..=n)
        .map(|i| ResolvedPatient::noop(&format!("P{i:02}"), 600_000))
        .collect()
}

/// Events in a comparable form: without times and the numbers of processes and jobs.
fn told(events: Vec<EventRecord>) -> Vec<String> {
    let events = events.into_iter().filter(|event| event.machine != "job");
    events
        .map(|event| {
            let mut body = event.event;
            if let Some(id) = body.get_mut("id") {
                *id = "-".into();
            }
            let who = event.patient.map(|p| p.to_string()).unwrap_or_default();
            let task = event.task.map(|t| t.to_string()).unwrap_or_default();
            format!(
                "{} {who} {task} {:?} {body}",
                event.machine, event.generation
            )
        })
        .collect()
}

#[tokio::test]
async fn another_build_decides_for_finished_patients_of_a_cluster_too() {
    let mut lab = Lab::new(noops(3), Settings::default());
    assert_eq!(lab.finish().await.done, 3);
    lab.has_stored_plans = true;
    tests::another_build::decided_otherwise(&lab.run_dir(), "P02", "sleep_ms").await;
    let summary = lab.tick().await;
    assert!(
        summary.on_cluster(),
        "its tasks are others now: {summary:?}"
    );
    assert_eq!(lab.finish().await.done, 3);
    assert!(!lab.tick().await.on_cluster());
}

#[tokio::test]
async fn a_patient_leaves_the_same_store_on_a_cluster_and_on_this_machine() {
    let here = tests::Bench::new(vec![personalised("P1", 8.0)]);
    assert_eq!(here.run().await.0.done, 1);
    let mut there = Lab::new(vec![personalised("P1", 8.0)], Settings::default());
    assert_eq!(there.finish().await.done, 1);
    assert_eq!(
        told(there.events().await),
        told(here.reader().await.history(None).await.unwrap())
    );
    assert_eq!(
        there.slurm.model.lock().unwrap().runs().len(),
        1,
        "it waited in the queue once"
    );
    let record = |mut record: cardiotwin_schemas::record::PatientRecord| {
        record.status.for_s = 0.0;
        let mut value = serde_json::to_value(&record).unwrap();
        value["attempts"] = serde_json::Value::Null;
        value
    };
    let id = PatientId::from("P1");
    let ours = record(there.reader().await.patient_record(&id).await.unwrap());
    let theirs = record(here.patient("P1").await);
    let places = |value: &serde_json::Value| serde_json::to_string(value).unwrap();
    let (a, b) = (places(&ours), places(&theirs));
    assert_eq!(
        a.replace(&there.run_dir().display().to_string(), "RUN"),
        b.replace(&here.path().display().to_string(), "RUN")
    );
}

#[tokio::test]
async fn a_tick_asks_two_commands_at_the_most() {
    let mut lab = Lab::new(
        noops(30),
        Settings {
            n_nodes: 2,
            ..Settings::default()
        },
    );
    lab.settings.job_s = 1;
    lab.tick().await;
    lab.slurm.asked.lock().unwrap().clear();
    lab.pass(5);
    lab.tick().await;
    assert_eq!(*lab.slurm.asked.lock().unwrap(), ["squeue"]);
    lab.slurm.asked.lock().unwrap().clear();
    lab.drive(|| Some((1, false))).await;
    lab.pass(400);
    lab.tick().await;
    let asked = lab.slurm.asked.lock().unwrap().clone();
    assert!(
        asked.iter().filter(|p| **p != "sbatch").count() <= 2,
        "{asked:?}"
    );
    lab.finish().await;
    lab.assert_published_once().await;
}

#[tokio::test]
async fn a_doubtful_submission_is_adopted_and_not_repeated() {
    for fault in [
        Fault::TimeoutAfter,
        Fault::KilledAfter,
        Fault::Garbage("motd\n".into()),
        Fault::Cut(0),
    ] {
        let mut lab = Lab::new(noops(1), Settings::default());
        lab.fault("sbatch", fault.clone());
        lab.tick().await;
        lab.moment();
        let summary = lab.finish().await;
        assert_eq!(summary.done, 1);
        let submissions = lab.n_asked("sbatch");
        assert_eq!((submissions, lab.attempts()), (1, (3, 3)), "{fault:?}");
    }
    let mut lab = Lab::new(noops(1), Settings::default());
    lab.fault("sbatch", Fault::TimeoutBefore);
    lab.tick().await;
    lab.moment();
    assert_eq!(lab.finish().await.done, 1);
    let submissions = lab.n_asked("sbatch");
    assert_eq!(
        submissions, 2,
        "it never arrived: after the lookup it is asked for again, under another name"
    );
}

/// What a person must mend fails its patient in the same tick, in the site's words, and every other
/// patient is submitted.
#[tokio::test]
async fn a_refusal_for_good_is_told_at_once_and_stops_no_other_patient() {
    let mut lab = Lab::new(long_noops(3), Settings::default()).without_arrays();
    let why = "Requested reservation is invalid";
    lab.fault("sbatch", Fault::Refused(why.into()));
    let summary = lab.tick().await;
    assert_eq!(
        (summary.failed, summary.jobs, lab.n_asked("sbatch")),
        (1, 2, 3)
    );
    let status = lab.reader().await.status().await.unwrap();
    let note = &status.patients[0].note;
    assert!(
        note.contains("refused by Slurm (exit code 1 of sbatch): Requested reservation is invalid"),
        "{note}"
    );
    assert_eq!(lab.finish().await.done, 2);
}

/// A reservation that ended is said once for each patient, with its remedy, and asked for no more.
#[tokio::test]
async fn a_reservation_that_ended_is_not_asked_for_at_every_tick() {
    let lab = Lab::new(long_noops(2), Settings::default()).without_arrays();
    for _ in 0..2 {
        lab.fault(
            "sbatch",
            Fault::Refused("Requested reservation is invalid".into()),
        );
    }
    let summary = lab.tick().await;
    assert_eq!((summary.failed, lab.n_asked("sbatch")), (2, 2));
    for _ in 0..3 {
        lab.moment();
        assert_eq!(lab.tick().await.failed, 2);
    }
    assert_eq!(lab.n_asked("sbatch"), 2);
    let status = lab.reader().await.status().await.unwrap();
    for patient in &status.patients {
        let note = &patient.note;
        assert!(
            note.contains("Requested reservation is invalid")
                && note.contains("`scontrol show reservation` lists those that hold"),
            "{note}"
        );
    }
}

/// What passes by itself fails nobody, and is asked for again.
#[tokio::test]
async fn a_refusal_that_passes_fails_no_patient() {
    let mut lab = Lab::new(long_noops(2), Settings::default()).without_arrays();
    let why = "Requested reservation not usable now";
    lab.fault("sbatch", Fault::Refused(why.into()));
    let summary = lab.tick().await;
    assert_eq!((summary.failed, summary.unfinished), (0, 2));
    let status = lab.reader().await.status().await.unwrap();
    let holds = status.cluster.unwrap().holds.unwrap();
    assert!(
        holds.contains(why) && !holds.contains("queue is full"),
        "{holds}"
    );
    assert_eq!(lab.finish().await.done, 2);
}

#[tokio::test]
async fn a_budget_stops_submissions_until_it_is_raised() {
    let mut lab = Lab::new(long_noops(3), Settings::default()).without_arrays();
    lab.settings.max_node_hours = 0.001;
    for _ in 0..2 {
        let summary = lab.tick().await;
        assert_eq!((summary.failed, summary.unfinished), (0, 3));
        let status = lab.reader().await.status().await.unwrap();
        let holds = status.cluster.unwrap().holds.unwrap();
        assert!(
            holds.contains("3 patients wait") && holds.contains("max_node_hours (0.001)"),
            "{holds}"
        );
    }
    assert!(!lab.slurm.asked.lock().unwrap().contains(&"sbatch"));
    lab.settings.max_node_hours = 1000.0;
    assert_eq!(lab.finish().await.done, 3);
    let status = lab.reader().await.status().await.unwrap();
    assert_eq!(status.cluster.unwrap().holds, None);
}

#[tokio::test]
async fn a_full_queue_is_waited_for_and_told() {
    let mut settings = Settings {
        n_nodes: 1,
        ..Settings::default()
    };
    settings.qos.insert(
        "normal".into(),
        Limits {
            max_queued: Some(1),
            ..Limits::default()
        },
    );
    let mut lab = Lab::new(noops(1), settings);
    // Another job of the user. The site's profile does not contain the limit, so Slurm itself
    // refuses.
    let filler = "#!/bin/bash\n#SBATCH --job-name=filler\n#SBATCH --hold\n#SBATCH --qos=normal\n";
    let submit = cardiotwin_slurm::commands::submit(".", "filler.sh");
    lab.slurm
        .model
        .lock()
        .unwrap()
        .answer(&submit, |_| Some(filler.into()), None);
    for _ in 0..3 {
        lab.tick().await;
        let status = lab.reader().await.status().await.unwrap();
        let holds = status.cluster.unwrap().holds.unwrap();
        assert!(holds.contains("QOSMaxSubmitJobPerUserLimit"), "{holds}");
        assert!(
            status.patients[0].note.contains("refused for now"),
            "{:?}",
            status.patients[0]
        );
    }
    let filler = cardiotwin_slurm::job::JobName::new("filler").unwrap();
    lab.slurm.model.lock().unwrap().answer(
        &cardiotwin_slurm::commands::cancel_name(&filler),
        |_| None,
        None,
    );
    assert_eq!(lab.finish().await.done, 1);
    assert_eq!(lab.attempts(), (3, 3));
}

/// Lost nodes are avoided and charged to nothing, exhausted memory and unexplained ends are
/// charged, and endless repeats are stopped.
#[tokio::test]
async fn what_follows_from_a_failure_is_bounded_and_named() {
    for (signal, cause) in [
        (125, FailureCause::OutOfMemory),
        (9, FailureCause::Unexplained),
    ] {
        let settings = Settings {
            behaviour: Behaviour {
                seconds: 10,
                code: 0,
                signal,
            },
            ..Settings::default()
        };
        let mut lab = Lab::new(noops(1), settings);
        let mut ended = None;
        for _ in 0..60 {
            let summary = lab.tick().await;
            if !summary.on_cluster() {
                ended = Some(summary);
                break;
            }
            lab.pass(15);
            lab.drive(|| Some((0, true))).await;
        }
        assert_eq!(ended.expect("it ends").failed, 1);
        let record = lab
            .reader()
            .await
            .patient_record(&PatientId::from("P01"))
            .await
            .unwrap();
        let failure = record.failure.unwrap();
        assert_eq!(failure.cause, Some(cause), "{}", failure.message);
    }
}

#[tokio::test]
async fn a_driver_that_panics_is_a_defect_and_not_tried_again() {
    let behaviour = Behaviour {
        seconds: 10,
        code: 101,
        signal: 0,
    };
    let settings = Settings {
        behaviour,
        ..Settings::default()
    };
    let mut lab = Lab::new(noops(1), settings);
    lab.tick().await;
    let folders = std::fs::read_dir(lab.run_dir().join("slurm")).unwrap();
    for folder in folders.flatten() {
        let log = folder.path().join("slurm-1.log");
        std::fs::write(log, "thread 'main' panicked at driver.rs:1:1:\n").unwrap();
    }
    lab.pass(15);
    lab.drive(|| Some((0, true))).await;
    let mut summary = lab.tick().await;
    for _ in 0..10 {
        lab.pass(15);
        summary = lab.tick().await;
    }
    assert_eq!((summary.failed, summary.on_cluster()), (1, false));
    let record = lab
        .reader()
        .await
        .patient_record(&"P01".into())
        .await
        .unwrap();
    let failure = record.failure.unwrap();
    assert_eq!(failure.class, FailureClass::Bug, "{}", failure.message);
    assert_eq!(
        lab.slurm.model.lock().unwrap().runs().len(),
        1,
        "once is enough"
    );
}

#[tokio::test]
async fn a_node_that_is_lost_publishes_nothing_and_is_avoided() {
    let mut lab = Lab::new(noops(1), Settings::default());
    lab.tick().await;
    lab.pass(2);
    lab.slurm.model.lock().unwrap().lose_node(1);
    lab.tick().await; // NODE_FAIL is seen, the zombie is revoked, another job is submitted
    lab.drive(|| None).await; // the zombie wakes only now
    assert_eq!(lab.attempts(), (0, 0), "a revoked job begins nothing");
    assert_eq!(lab.finish().await.done, 1);
    let scripts: Vec<String> = walk_scripts(&lab);
    assert!(
        scripts.iter().any(|script| script.contains("--exclude=n1")),
        "{scripts:#?}"
    );
    lab.assert_published_once().await;
    assert_eq!(lab.attempts(), (3, 3));
}

fn walk_scripts(lab: &Lab) -> Vec<String> {
    let folders = std::fs::read_dir(lab.run_dir().join("slurm"))
        .unwrap()
        .flatten();
    folders
        .filter_map(|folder| std::fs::read_to_string(folder.path().join("job.sh")).ok())
        .collect()
}

/// A small random generator, which repeats a run from its seed; the crate has none.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % n
    }
}

/// Random kills and faults of ticks, drivers, nodes, the controller and single commands.
/// `CARDIOTWIN_KILLS` sets the least number of kills (docs/slurm.md has the figures of 10,000).
#[tokio::test]
async fn random_kills_lose_nothing_and_publish_nothing_twice() {
    let wanted: u64 = std::env::var("CARDIOTWIN_KILLS")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(60);
    let (mut kills, mut seed, mut claims, mut tasks) = (0, 0_u64, 0, 0);
    let mut kinds: BTreeMap<&str, u64> = BTreeMap::new();
    while kills < wanted {
        seed += 1;
        let mut dice = Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let n_patients = 1 + dice.roll(4) as usize;
        let mut lab = Lab::new(
            noops(n_patients),
            Settings {
                n_nodes: 3,
                ..Settings::default()
            },
        );
        (lab.settings.free_repeats, lab.site_retries) = (1000, 1000);
        for _ in 0..12 {
            let mut kill = |kind| {
                kills += 1;
                *kinds.entry(kind).or_default() += 1;
            };
            match dice.roll(8) {
                0 | 1 => {
                    if lab.tick_dying_at(1 + dice.roll(30)).await.is_err() {
                        kill("coordinator");
                    }
                }
                2 => lab.pass(1 + dice.roll(40) as i64),
                3 => {
                    let dies = (dice.roll(4) as usize, dice.roll(2) == 0);
                    kill("driver and worker");
                    lab.drive(|| Some(dies)).await;
                }
                4 => {
                    let node = 1 + dice.roll(3) as u32;
                    kill("node");
                    lab.slurm.model.lock().unwrap().lose_node(node);
                    lab.pass(dice.roll(20) as i64);
                    lab.slurm.model.lock().unwrap().return_node(node);
                }
                5 => {
                    kill("controller");
                    lab.slurm.model.lock().unwrap().crash_controller();
                }
                6 => {
                    let faults = [
                        ("sbatch", Fault::TimeoutAfter),
                        ("sbatch", Fault::TimeoutBefore),
                        ("sbatch", Fault::KilledAfter),
                        ("squeue", Fault::Down),
                        ("squeue", Fault::Cut(300)),
                        ("squeue", Fault::Garbage("???".into())),
                        ("sacct", Fault::Down),
                        ("sacct", Fault::Cut(100)),
                        ("sacct", Fault::TimeoutAfter),
                        ("scancel", Fault::TimeoutBefore),
                        ("scancel", Fault::TimeoutAfter),
                        ("scancel", Fault::KilledAfter),
                    ];
                    kill("command");
                    let (program, fault) = faults[dice.roll(12) as usize].clone();
                    lab.fault(program, fault);
                    lab.tick().await;
                }
                _ => lab.drive(|| None).await,
            }
        }
        lab.slurm.faults.lock().unwrap().clear();
        for node in 1..=3 {
            lab.slurm.model.lock().unwrap().return_node(node);
        }
        let summary = lab.finish().await;
        let said = (summary.done, summary.failed, summary.cancelled);
        assert_eq!(
            said,
            (n_patients, 0, 0),
            "seed {seed}: {:#?}",
            lab.reader().await.status().await.unwrap()
        );
        lab.assert_published_once().await;
        let (claimed, _) = lab.attempts();
        claims += claimed;
        tasks += 3 * n_patients;
    }
    eprintln!(
        "{kills} kills {kinds:?} in {seed} runs: {tasks} tasks, each published once, {} attempts repeated",
        claims - tasks
    );
}
