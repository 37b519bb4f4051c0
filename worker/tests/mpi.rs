//! The worker under an MPI launcher: a beat on two ranks equals the beat on two threads, and
//! nothing hangs when a rank fails.
//!
//! `CARDIOTWIN_MPIRUN` is the launcher with its arguments; the default is `mpirun`.

#[path = "support/launcher.rs"]
mod launcher;
mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use cardiotwin_schemas::finite_element::FiniteElementSettings;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::organ::{
    BeatCount, ClosedLoopSpec, ContractionSpec, OrganSpec, Step1Parameters,
};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, TaskOutcome, TaskResult};
use cardiotwin_schemas::task::{AttemptSpec, OrganBeatSpec, PassiveStateSpec, TaskSpec};
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::finite_element::checkpoint::{BeatCheckpoint, FILE};
use cardiotwin_worker::tasks::run_task;
use support::{beat_spec, passive_state, step0};

/// Time from the failure of a rank to the end of all, with a margin for slow machines.
const ALL_END_WITHIN: Duration = Duration::from_secs(10);

fn mpirun(n_ranks: usize, arguments: &[&str]) -> Command {
    let program = env!("CARGO_BIN_EXE_cardiotwin-worker-mpi");
    launcher::mpirun(program, n_ranks, arguments)
}

/// The task in `file` on so many ranks.
fn simulation(n_ranks: usize, file: &Path, out: &Path) -> Command {
    let ranks = n_ranks.to_string();
    let arguments = [
        "simulate",
        text(file),
        "--out",
        text(out),
        "--ranks",
        &ranks,
    ];
    mpirun(n_ranks, &arguments)
}

fn output(mut command: Command) -> Output {
    command.output().expect("the launcher starts")
}

fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// Step 0 of a patient on the coarsest mesh, and the specification of a beat.
fn beat(folder: &Path, cycle_length_ms: f64) -> OrganBeatSpec {
    let coarse = FiniteElementSettings {
        mesh_nodes: 500,
        tolerance: 1e-3,
        ..FiniteElementSettings::default()
    };
    let spec = PassiveStateSpec {
        finite_element: Some(coarse.anatomy(&[])),
        ..step0("01-CoA")
    };
    let state = passive_state(&spec, &mut Context::plain(folder, 1));
    let parameters = Step1Parameters::default();
    let contraction = ContractionSpec::Tanh {
        parameters: parameters.tanh,
    };
    OrganBeatSpec {
        time_step_ms: 2.0,
        finite_element: Some(coarse.equations()),
        ..beat_spec(cycle_length_ms, &state, &parameters, contraction)
    }
}

fn result(ending: Ending) -> OrganBeatResult {
    match ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::OrganBeat(result) => result,
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn written(folder: &Path, task: &TaskSpec) -> PathBuf {
    let file = folder.join("task.json");
    fs::write(&file, serde_json::to_string(task).expect("JSON")).expect("a file");
    file
}

/// Waits for an event before the end of `child`. Fails if the child ends first.
fn until(child: &mut Child, what: &str, done: impl Fn() -> bool) {
    while !done() {
        let ended = child.try_wait().expect("a child");
        assert!(
            ended.is_none() || done(),
            "ended before it had {what}: {ended:?}"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Processes below `pid` that run the worker.
fn ranks_of(pid: u32) -> Vec<u32> {
    let children = |pid: u32| -> Vec<u32> {
        let tasks = fs::read_dir(format!("/proc/{pid}/task"))
            .into_iter()
            .flatten()
            .flatten();
        let texts = tasks.filter_map(|task| fs::read_to_string(task.path().join("children")).ok());
        texts
            .flat_map(|t| {
                t.split_whitespace()
                    .filter_map(|p| p.parse().ok())
                    .collect::<Vec<u32>>()
            })
            .collect()
    };
    let (mut found, mut open) = (vec![], vec![pid]);
    while let Some(pid) = open.pop() {
        let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
        if name.starts_with("cardiotwin-work") {
            found.push(pid);
        }
        open.extend(children(pid));
    }
    found
}

#[test]
fn step_0_on_two_ranks_is_that_on_two_threads_and_is_heard_when_it_has_to_stop() {
    let folder = tempfile::tempdir().expect("a folder");
    // A mesh that is large enough for multigrid, with a given law.
    let mesh = FiniteElementSettings {
        mesh_nodes: 3400,
        ..FiniteElementSettings::default()
    };
    let spec = PassiveStateSpec {
        finite_element: Some(mesh.anatomy(&[])),
        guccione_c_kpa: Some(0.8),
        ..step0("01-CoA")
    };
    let task = TaskSpec::PassiveState(Box::new(spec));
    let file = written(folder.path(), &task);
    let by_threads = folder.path().join("threads");
    fs::create_dir(&by_threads).expect("a folder");
    let want = run_task(&task, &mut Context::plain(&by_threads, 2));
    let by_ranks = folder.path().join("ranks");
    let out = output(simulation(2, &file, &by_ranks));
    assert!(out.status.success(), "{}", said(&out));
    let got: TaskOutcome = serde_json::from_slice(&out.stdout).expect("an outcome");
    let iterations = |ending: Ending| match ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::PassiveState(result) => result.counters["newton_iterations"],
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    };
    assert_eq!(iterations(got.ending), iterations(want));
    let [a, b] = [&by_threads, &by_ranks]
        .map(|folder| fs::read(folder.join("ventricle.bin")).expect("a file"));
    assert!(
        a == b,
        "the ventricle on ranks differs from that on threads"
    );

    // SIGTERM to rank 0 during the unloading ends all ranks with an outcome of cancellation.
    let directory = attempt(folder.path(), &task);
    let mut child = mpirun(2, &["run", text(&directory), "--quiet"])
        .spawn()
        .expect("the launcher starts");
    let progress = || fs::read_to_string(directory.join("progress.jsonl")).unwrap_or_default();
    until(&mut child, "begun to unload", || {
        progress().contains("linear iterations so far")
    });
    let claim: serde_json::Value =
        serde_json::from_slice(&fs::read(directory.join("started.json")).expect("a claim"))
            .expect("JSON");
    let begun = Instant::now();
    let rank_0 = claim["pid"].to_string();
    assert!(
        Command::new("kill")
            .arg(rank_0)
            .status()
            .expect("kill")
            .success()
    );
    child.wait().expect("a child");
    assert!(
        begun.elapsed() < 2 * ALL_END_WITHIN,
        "{:?}",
        begun.elapsed()
    );
    let outcome = fs::read(directory.join("outcome.json")).expect("an outcome");
    let outcome: TaskOutcome = serde_json::from_slice(&outcome).expect("JSON");
    assert!(
        matches!(outcome.ending, Ending::Cancelled),
        "{:?}",
        outcome.ending
    );
}

// One test for everything that needs the beat, because step 0 takes most of the time.
#[test]
fn a_beat_on_two_ranks_is_that_on_two_threads_and_ends_whole_or_with_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let spec = beat(folder.path(), 100.0);
    let task = TaskSpec::OrganBeat(Box::new(spec.clone()));
    let file = written(folder.path(), &task);

    let by_threads = folder.path().join("threads");
    fs::create_dir(&by_threads).expect("a folder");
    let want = result(run_task(&task, &mut Context::plain(&by_threads, 2)));
    let by_ranks = folder.path().join("ranks");
    let arguments = [
        "simulate",
        text(&file),
        "--out",
        text(&by_ranks),
        "--ranks",
        "2",
        "--checkpoint-every",
        "40",
    ];
    let out = output(mpirun(2, &arguments));
    assert!(out.status.success(), "{}", said(&out));
    let outcome: TaskOutcome = serde_json::from_slice(&out.stdout).expect("an outcome");
    assert_eq!(outcome.provenance.ranks, 2);
    let got = result(outcome.ending);
    assert_eq!(got.counters["threads"], 2.0);
    for counter in ["krylov_iterations", "newton_iterations_tried"] {
        assert_eq!(got.counters[counter], want.counters[counter], "{counter}");
    }
    for name in ["traces.csv", "nodal.csv", "heart.json"] {
        let [a, b] =
            [&by_threads, &by_ranks].map(|folder| fs::read(folder.join(name)).expect("a file"));
        assert!(a == b, "{name} on ranks differs from that on threads");
    }

    // One thread resumes the beat from the checkpoint that two ranks wrote at 80 ms.
    let resumed = folder.path().join("resumed");
    fs::create_dir(&resumed).expect("a folder");
    let checkpoints = Checkpoints::restarting(&resumed, &by_ranks, None);
    let resumed = result(run_task(
        &task,
        &mut Context {
            checkpoints,
            ..Context::plain(&resumed, 1)
        },
    ));
    assert_eq!(
        (
            resumed.counters["resumed_at_ms"],
            resumed.counters["threads"]
        ),
        (80.0, 1.0)
    );
    let (want, got) = (
        want.biomarkers.p_max_mmhg.expect("P_max"),
        resumed.biomarkers.p_max_mmhg.expect("P_max"),
    );
    assert!((got / want - 1.0).abs() < 1e-4, "{got} for {want} mmHg");

    so_many_subdomains_give_the_same_bits_on_any_number_of_ranks(
        &folder.path().join("open"),
        &spec,
        &[1, 2, 4, 8],
    );
    // In a closed loop, whose compartments rank 0 solves together with the ventricle.
    let mut in_loop = spec.clone();
    in_loop.circulation.closed = Some(ClosedLoopSpec {
        stroke_volume_ml: 100.0,
        venous_share: None,
        rest: None,
        filling: None,
        contents: None,
    });
    so_many_subdomains_give_the_same_bits_on_any_number_of_ranks(
        &folder.path().join("loop"),
        &in_loop,
        &[2],
    );
    an_attempt_says_how_many_ranks_it_needs(folder.path(), &task);
    a_missing_file_is_an_outcome(folder.path(), &spec);
    a_killed_rank_ends_all(folder.path(), &spec);
}

fn so_many_subdomains_give_the_same_bits_on_any_number_of_ranks(
    folder: &Path,
    spec: &OrganBeatSpec,
    ranks: &[usize],
) {
    fs::create_dir(folder).expect("a folder");
    // Few steps, because eight ranks on two cores spend most of the time waiting for each other.
    let settings = FiniteElementSettings {
        subdomains: 8,
        ..FiniteElementSettings::default()
    };
    let task = &TaskSpec::OrganBeat(Box::new(OrganBeatSpec {
        time_step_ms: 10.0,
        finite_element: Some(settings.equations()),
        ..spec.clone()
    }));
    let by_threads = folder.join("eight-threads");
    fs::create_dir(&by_threads).expect("a folder");
    // The setting decides, not the number of threads.
    result(run_task(task, &mut Context::plain(&by_threads, 2)));
    let file = written(folder, task);
    for &n_ranks in ranks {
        let by_ranks = folder.join(format!("eight-on-{n_ranks}"));
        let out = output(simulation(n_ranks, &file, &by_ranks));
        assert!(out.status.success(), "{}", said(&out));
        result(
            serde_json::from_slice::<TaskOutcome>(&out.stdout)
                .expect("an outcome")
                .ending,
        );
        for name in ["traces.csv", "nodal.csv"] {
            let [a, b] =
                [&by_threads, &by_ranks].map(|folder| fs::read(folder.join(name)).expect("a file"));
            assert!(
                a == b,
                "{name} of eight subdomains on {n_ranks} ranks differs from that on eight threads"
            );
        }
    }
    let refused = output(mpirun(2, &["check", "--ranks", "2", "--subdomains", "3"]));
    assert!(
        said(&refused).contains("3 subdomains: expected a multiple of the 2 ranks"),
        "{}",
        said(&refused)
    );
}

/// Directory of an attempt with two threads or ranks.
fn attempt(folder: &Path, task: &TaskSpec) -> PathBuf {
    let directory = folder.join("attempt");
    fs::create_dir(&directory).expect("a folder");
    let spec = AttemptSpec {
        schema_version: formats::SPEC.version,
        attempt: AttemptId {
            task: task.key(),
            generation: 1,
        },
        threads: 2,
        instruction_set: Default::default(),
        vtu_every_ms: 0.0,
        task: task.clone(),
    };
    fs::write(
        directory.join("spec.json"),
        serde_json::to_string(&spec).expect("JSON"),
    )
    .expect("a file");
    directory
}

fn an_attempt_says_how_many_ranks_it_needs(folder: &Path, task: &TaskSpec) {
    let directory = attempt(folder, task);
    let out = output(mpirun(3, &["run", text(&directory)]));
    assert!(
        !out.status.success()
            && said(&out).contains("found 3 ranks, expected 2 (threads in spec.json)"),
        "{}",
        said(&out)
    );
    assert!(
        !directory.join("started.json").exists(),
        "nothing was claimed"
    );
    let out = output(mpirun(2, &["run", text(&directory)]));
    assert!(out.status.success(), "{}", said(&out));
    let outcome: TaskOutcome =
        serde_json::from_slice(&fs::read(directory.join("outcome.json")).expect("an outcome"))
            .expect("JSON");
    assert_eq!(outcome.provenance.ranks, 2);
    result(outcome.ending);
    let out = output(mpirun(2, &["run", text(&directory)]));
    assert!(
        out.status.code() == Some(3) && said(&out).contains("already been claimed"),
        "{:?} {}",
        out.status,
        said(&out)
    );
}

fn a_missing_file_is_an_outcome(folder: &Path, spec: &OrganBeatSpec) {
    let mut spec = spec.clone();
    let OrganSpec::FiniteElement(organ) = &mut spec.organ else {
        panic!("another organ")
    };
    organ.ventricle.path = folder.join("gone.bin");
    let file = written(folder, &TaskSpec::OrganBeat(Box::new(spec)));
    let out = output(simulation(2, &file, &folder.join("gone")));
    assert!(out.status.success(), "{}", said(&out));
    let outcome: TaskOutcome = serde_json::from_slice(&out.stdout).expect("an outcome");
    assert!(
        matches!(&outcome.ending, Ending::Failed { failure } if failure.message.contains("gone.bin")),
        "{outcome:?}"
    );
}

/// The specification has so many beats that it does not end during the test.
fn a_killed_rank_ends_all(folder: &Path, spec: &OrganBeatSpec) {
    let spec = OrganBeatSpec {
        beats: BeatCount::Fixed { n: 100_000 },
        ..spec.clone()
    };
    let task = TaskSpec::OrganBeat(Box::new(spec));
    let (file, out) = (written(folder, &task), folder.join("killed"));
    let arguments = [
        "simulate",
        text(&file),
        "--out",
        text(&out),
        "--ranks",
        "2",
        "--checkpoint-every",
        "2",
    ];
    let mut child = mpirun(2, &arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the launcher starts");
    let checkpoint = out.join("checkpoint").join(FILE);
    until(&mut child, "a checkpoint", || checkpoint.exists());
    let ranks = ranks_of(child.id());
    assert_eq!(ranks.len(), 2, "{ranks:?}");
    let victim = ranks.iter().max().expect("a rank").to_string();
    assert!(
        Command::new("kill")
            .args(["-9", &victim])
            .status()
            .expect("kill")
            .success()
    );
    let begun = Instant::now();
    let status = child.wait().expect("a child");
    assert!(
        !status.success() && begun.elapsed() < ALL_END_WITHIN,
        "{status} after {:?}",
        begun.elapsed()
    );
    let bytes = fs::read(checkpoint).expect("a checkpoint");
    assert!(
        BeatCheckpoint::from_bytes(&bytes, &task.key().to_string()).is_ok(),
        "the last checkpoint is valid"
    );
}

#[test]
fn a_rank_that_fails_in_any_way_ends_all_with_one_message() {
    let cases = [
        (
            "1:panic",
            "rank 1 of 3 failed at ",
            "panicked at worker/src/mpi/check.rs",
            "600",
        ),
        ("2:error", "rank 2 of 3 failed at ", "asked to fail", "600"),
        ("0:panic", "rank 0 of 3 failed at ", "asked to panic", "600"),
        (
            "0:stall",
            "failed at ",
            "no progress: waited 0.5 s for a reduction of rank 0",
            "0.5",
        ),
    ];
    for (fault, who, why, patience) in cases {
        let begun = Instant::now();
        let out = output(mpirun(
            3,
            &[
                "check",
                "--ranks",
                "3",
                "--fail",
                fault,
                "--patience",
                patience,
            ],
        ));
        let said = said(&out);
        assert!(
            !out.status.success() && begun.elapsed() < ALL_END_WITHIN,
            "{fault}: {:?} {said}",
            begun.elapsed()
        );
        let lines: Vec<&str> = said
            .lines()
            .filter(|line| line.contains("all ranks end"))
            .collect();
        assert!(
            lines
                .iter()
                .any(|line| line.contains(who) && line.contains(why)),
            "{fault}: {said}"
        );
        assert!(
            fault.ends_with("stall") || lines.len() == 1,
            "{fault}: one message: {said}"
        );
    }
}

#[test]
fn ranks_are_counted_before_anything_is_done() {
    let out = output(mpirun(2, &["check", "--ranks", "2"]));
    assert!(
        out.status.success() && String::from_utf8_lossy(&out.stdout).starts_with("2 ranks: 2 on "),
        "{}",
        said(&out)
    );
    for (arguments, found) in [
        (
            vec!["check", "--ranks", "3"],
            "found 2 ranks, expected 3 (--ranks)",
        ),
        (
            vec!["check"],
            "give the required number of ranks with --ranks N or CARDIOTWIN_RANKS",
        ),
    ] {
        let out = output(mpirun(2, &arguments));
        assert!(
            !out.status.success() && said(&out).contains(found),
            "{}",
            said(&out)
        );
    }
    // Without a launcher, or under one of another MPI, every rank runs alone.
    let alone = Command::new(env!("CARGO_BIN_EXE_cardiotwin-worker-mpi"))
        .args(["check", "--ranks", "2"])
        .output()
        .expect("the worker starts");
    assert!(
        alone.status.code() == Some(5) && said(&alone).contains("found 1 ranks, expected 2"),
        "{}",
        said(&alone)
    );
}

/// A Slurm of one node on this machine, ended when dropped.
struct Slurm {
    folder: PathBuf,
}

impl Slurm {
    fn script(what: &str, folder: &Path, more: &[&str]) -> Output {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/one-machine-slurm.sh");
        Command::new(script)
            .arg(what)
            .arg(folder)
            .args(more)
            .output()
            .expect("bash is there")
    }

    fn start() -> Result<Self, String> {
        let folder = PathBuf::from(format!("/tmp/ct-mpi.{}", std::process::id()));
        let out = Self::script(
            "start",
            &folder,
            &["--nodes", "1", "--cpus", "8", "--no-accounting"],
        );
        if out.status.success() {
            Ok(Self { folder })
        } else {
            Err(said(&out).trim().to_owned())
        }
    }

    fn output(&self, program: &str, arguments: &[&str]) -> Output {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .env("SLURM_CONF", self.folder.join("etc/slurm.conf"))
            .stdin(Stdio::null());
        for name in [
            "OMPI_ALLOW_RUN_AS_ROOT",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM",
            "OMPI_MCA_rmaps_base_oversubscribe",
        ] {
            command.env(name, "1");
        }
        output(command)
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        Self::script("stop", &self.folder, &[]);
    }
}

#[test]
fn ranks_start_in_a_slurm_allocation() {
    let slurm = match Slurm::start() {
        Ok(slurm) => slurm,
        Err(why) => {
            cardiotwin_not_tested::not_tested("slurm", why);
            return;
        }
    };
    let launcher = std::env::var("CARDIOTWIN_MPIRUN").unwrap_or_else(|_| "mpirun".to_owned());
    // The plugin of srun that suits the MPI, and one that does not connect its ranks.
    let (mpi, other) = if launcher.contains("mpich") {
        ("pmi2", "pmix")
    } else {
        ("pmix", "none")
    };
    let worker = env!("CARGO_BIN_EXE_cardiotwin-worker-mpi");
    let srun = |mpi: &str, more: &[&str]| {
        let mpi = format!("--mpi={mpi}");
        let begin = [
            "--kill-on-bad-exit=1",
            "-p",
            "main",
            "-n",
            "2",
            &mpi,
            worker,
            "check",
            "--ranks",
            "2",
        ];
        slurm.output("srun", &[&begin, more].concat())
    };
    let shown = |out: &Output| format!("{} {}", String::from_utf8_lossy(&out.stdout), said(out));
    let out = srun(mpi, &[]);
    assert!(
        out.status.success() && shown(&out).starts_with("2 ranks: 2 on "),
        "{}",
        shown(&out)
    );
    let begun = Instant::now();
    let out = srun(mpi, &["--fail", "1:panic"]);
    assert!(
        !out.status.success() && shown(&out).contains("rank 1 of 2 failed at "),
        "{}",
        shown(&out)
    );
    assert!(begun.elapsed() < ALL_END_WITHIN, "{:?}", begun.elapsed());
    let out = srun(other, &[]);
    assert!(!out.status.success(), "the wrong launcher: {}", shown(&out));
    let out = slurm.output(
        "salloc",
        &[
            "-p", "main", "-n", "2", &launcher, "-n", "2", worker, "check", "--ranks", "2",
        ],
    );
    assert!(
        out.status.success() && shown(&out).contains("2 ranks: 2 on "),
        "{}",
        shown(&out)
    );
}
