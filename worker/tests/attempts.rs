//! Claim, revocation, outcome and stopping of attempts, with the real program.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use cardiotwin_protocol::closing::{self, Winner};
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::organ::ContractionSpec;
use cardiotwin_schemas::outcome::{Ending, Revocation, TaskOutcome, TaskResult};
use cardiotwin_schemas::settings::InstructionSet;
use cardiotwin_schemas::task::{AttemptSpec, InputFile, NoopSpec, TargetsSpec, TaskSpec};

/// An attempt's directory below `root`, named as the coordinator names it.
fn attempt_directory(root: &Path, task: &TaskSpec, generation: u32) -> PathBuf {
    let key = task.key();
    let directory = root.join(format!("{}-g{generation}", &key.0[..16]));
    fs::create_dir_all(&directory).unwrap();
    let spec = AttemptSpec {
        schema_version: formats::SPEC.version,
        attempt: AttemptId {
            task: key,
            generation,
        },
        threads: 1,
        instruction_set: InstructionSet::Auto,
        vtu_every_ms: 0.0,
        task: task.clone(),
    };
    fs::write(
        directory.join("spec.json"),
        serde_json::to_string(&spec).unwrap(),
    )
    .unwrap();
    directory
}

fn noop(sleep_ms: u64) -> TaskSpec {
    TaskSpec::Noop(NoopSpec {
        label: "test".into(),
        sleep_ms,
    })
}

fn worker(directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cardiotwin-worker"));
    command
        .arg("run")
        .arg(directory)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn run(directory: &Path) -> Output {
    worker(directory).output().unwrap()
}

fn outcome(directory: &Path) -> TaskOutcome {
    serde_json::from_slice(&fs::read(directory.join("outcome.json")).unwrap()).unwrap()
}

/// Waits until a started worker has claimed its directory.
fn spawn_and_wait_for_claim(directory: &Path) -> Child {
    let child = worker(directory).spawn().unwrap();
    let begin = Instant::now();
    while !directory.join("started.json").exists() {
        assert!(
            begin.elapsed() < Duration::from_secs(300),
            "the worker does not claim its directory"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

#[test]
fn a_noop_ends_with_an_outcome_and_a_second_start_is_refused() {
    let root = tempfile::tempdir().unwrap();
    let directory = attempt_directory(root.path(), &noop(0), 1);
    assert_eq!(run(&directory).status.code(), Some(0));
    let first = outcome(&directory);
    assert!(matches!(&first.ending, Ending::Succeeded { result } if **result == TaskResult::Noop));
    assert_eq!(
        first.attempt,
        AttemptId {
            task: noop(0).key(),
            generation: 1
        }
    );
    assert!(first.provenance.peak_memory_mb > 0.5 && first.provenance.wall_s > 0.0);

    let again = run(&directory);
    assert_eq!(again.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&again.stderr).contains("already been claimed"));
    assert_eq!(outcome(&directory), first);
}

#[test]
fn of_many_starts_at_once_one_does_the_work() {
    let root = tempfile::tempdir().unwrap();
    let directory = attempt_directory(root.path(), &noop(50), 1);
    let children: Vec<Child> = (0..8)
        .map(|_| worker(&directory).spawn().unwrap())
        .collect();
    let mut codes: Vec<Option<i32>> = children
        .into_iter()
        .map(|child| child.wait_with_output().unwrap().status.code())
        .collect();
    codes.sort_unstable();
    let mut expected = vec![Some(3); 8];
    expected[0] = Some(0);
    assert_eq!(codes, expected);
}

fn revoke(directory: &Path, task: &TaskSpec) -> Winner {
    let revocation = Revocation {
        schema_version: formats::REVOCATION.version,
        attempt: AttemptId {
            task: task.key(),
            generation: 1,
        },
        reason: "for a test".into(),
        at: String::new(),
    };
    closing::revoke(directory, &revocation).unwrap()
}

#[test]
fn a_revoked_attempt_publishes_nothing() {
    let root = tempfile::tempdir().unwrap();
    let before = attempt_directory(root.path(), &noop(0), 1);
    assert_eq!(revoke(&before, &noop(0)), Winner::Coordinator);
    assert_eq!(run(&before).status.code(), Some(4));
    assert!(!before.join("started.json").exists() && closing::is_revoked(&before));

    let meanwhile = attempt_directory(root.path(), &noop(3_600_000), 1);
    let child = spawn_and_wait_for_claim(&meanwhile);
    assert_eq!(revoke(&meanwhile, &noop(3_600_000)), Winner::Coordinator);
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(4));
    assert!(closing::is_revoked(&meanwhile));
}

#[test]
fn an_attempt_fenced_by_an_earlier_version_publishes_nothing() {
    let root = tempfile::tempdir().unwrap();
    let directory = attempt_directory(root.path(), &noop(0), 1);
    fs::write(directory.join("fence"), "").unwrap();
    assert_eq!(run(&directory).status.code(), Some(4));
    assert!(!directory.join("started.json").exists() && !directory.join("outcome.json").exists());
}

#[test]
fn an_outcome_that_is_there_cannot_be_revoked() {
    let root = tempfile::tempdir().unwrap();
    let directory = attempt_directory(root.path(), &noop(0), 1);
    assert_eq!(run(&directory).status.code(), Some(0));
    let published = outcome(&directory);
    assert_eq!(revoke(&directory, &noop(0)), Winner::Worker);
    assert_eq!(outcome(&directory), published);
}

/// The worker is stopped between writing and publishing its outcome, and the attempt is revoked at
/// that moment.
#[test]
fn a_revocation_just_before_the_publication_wins() {
    let root = tempfile::tempdir().unwrap();
    let mut caught = 0;
    for label in 0..200 {
        let task = TaskSpec::Noop(NoopSpec {
            label: label.to_string(),
            sleep_ms: 1,
        });
        let directory = attempt_directory(root.path(), &task, 1);
        let mut child = worker(&directory).spawn().unwrap();
        let pid = rustix::process::Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
        let is_at_its_end = loop {
            match child.try_wait().unwrap() {
                Some(_) => break false,
                None if has_draft_of_outcome(&directory) => break true,
                None => {}
            }
        };
        // The process has not been reaped, so its number cannot have been reused.
        let signal = |signal| {
            if is_at_its_end {
                rustix::process::kill_process(pid, signal).unwrap();
            }
        };
        signal(rustix::process::Signal::STOP);
        let winner = revoke(&directory, &task);
        signal(rustix::process::Signal::CONT);
        let code = child.wait_with_output().unwrap().status.code();
        match winner {
            Winner::Coordinator => {
                assert_eq!((code, closing::is_revoked(&directory)), (Some(4), true))
            }
            Winner::Worker => assert_eq!((code, closing::is_revoked(&directory)), (Some(0), false)),
        }
        caught += u32::from(winner == Winner::Coordinator);
        if caught == 10 {
            return;
        }
    }
    panic!("only {caught} workers were stopped before their last step");
}

fn has_draft_of_outcome(directory: &Path) -> bool {
    let names = fs::read_dir(directory).unwrap().flatten();
    names
        .map(|entry| entry.file_name())
        .any(|name| name.to_string_lossy().starts_with(".outcome.json"))
}

#[test]
fn a_term_signal_ends_in_a_cancelled_outcome() {
    let root = tempfile::tempdir().unwrap();
    let directory = attempt_directory(root.path(), &noop(3_600_000), 1);
    let child = spawn_and_wait_for_claim(&directory);
    let pid = rustix::process::Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    assert_eq!(outcome(&directory).ending, Ending::Cancelled);
}

#[test]
fn a_missing_or_edited_input_is_a_failure_of_the_input() {
    let root = tempfile::tempdir().unwrap();
    let file = root.path().join("nodal.csv");
    let task = TaskSpec::Targets(TargetsSpec {
        nodal: InputFile {
            name: "nodal".into(),
            path: file.clone(),
            sha256: "0".repeat(64),
        },
    });
    for (generation, expected) in [(1, "cannot read nodal input"), (2, "has SHA-256")] {
        let directory = attempt_directory(root.path(), &task, generation);
        assert_eq!(run(&directory).status.code(), Some(0));
        let Ending::Failed { failure } = outcome(&directory).ending else {
            panic!("{:?}", outcome(&directory))
        };
        assert_eq!(failure.class, FailureClass::Input);
        assert!(failure.message.contains(expected), "{}", failure.message);
        assert!(failure.remedy.is_some());
        fs::write(&file, "time_ms\n").unwrap();
    }
}

#[test]
fn a_trace_that_is_no_trace_is_a_failure_of_the_input_with_its_line() {
    let root = tempfile::tempdir().unwrap();
    let mut spec = support::step0("02-CoA");
    let text = fs::read_to_string(&spec.pressure.as_ref().unwrap().path).unwrap();
    let file = root.path().join("pressure.csv");
    let damaged: Vec<&str> = text
        .lines()
        .enumerate()
        .map(|(idx, line)| if idx == 41 { "40,NaN" } else { line })
        .collect();
    fs::write(&file, damaged.join("\n")).unwrap();
    spec.pressure = Some(support::input("pressure", &file));
    let task = TaskSpec::PassiveState(Box::new(spec));
    let directory = attempt_directory(root.path(), &task, 1);
    assert_eq!(run(&directory).status.code(), Some(0));
    let Ending::Failed { failure } = outcome(&directory).ending else {
        panic!("{:?}", outcome(&directory))
    };
    assert_eq!(failure.class, FailureClass::Input);
    assert!(
        failure.message.contains("pressure.csv:42"),
        "{}",
        failure.message
    );
}

#[test]
fn simulate_prints_an_outcome_and_leaves_traces_without_a_claim() {
    let root = tempfile::tempdir().unwrap();
    let spec = root.path().join("task.json");
    let out = root.path().join("out");
    let task = TaskSpec::PassiveState(Box::new(support::step0("02-CoA")));
    fs::write(&spec, serde_json::to_string(&task).unwrap()).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_cardiotwin-worker"));
    let output = command
        .arg("simulate")
        .arg(&spec)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    let outcome: TaskOutcome = serde_json::from_slice(&output.stdout).unwrap();
    let Ending::Succeeded { result } = outcome.ending else {
        panic!("{:?}", outcome.ending)
    };
    let TaskResult::PassiveState(state) = *result else {
        panic!("{result:?}")
    };
    assert_eq!(outcome.provenance.inputs.len(), 2);

    let tanh = ContractionSpec::Tanh {
        parameters: Default::default(),
    };
    let beat = support::beat_spec(1231.0, &state, &Default::default(), tanh);
    fs::write(
        &spec,
        serde_json::to_string(&TaskSpec::OrganBeat(Box::new(beat))).unwrap(),
    )
    .unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_cardiotwin-worker"));
    let output = command
        .arg("simulate")
        .arg(&spec)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    let outcome: TaskOutcome = serde_json::from_slice(&output.stdout).unwrap();
    for artefact in &outcome.artefacts {
        let bytes = fs::read(out.join(&artefact.file)).unwrap();
        assert_eq!(
            (sha256_hex(&bytes), bytes.len() as u64),
            (artefact.sha256.clone(), artefact.bytes)
        );
    }
    let files: Vec<&str> = outcome
        .artefacts
        .iter()
        .map(|artefact| artefact.file.as_str())
        .collect();
    assert_eq!(files, ["traces.csv", "nodal.csv"]);
    assert!(!out.join("started.json").exists());
}

#[test]
fn a_directory_that_cannot_be_written_is_an_error_that_names_the_file() {
    let root = tempfile::tempdir().unwrap();
    let directory = root.path().join("nowhere");
    let output = run(&directory);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("nowhere/spec.json"));
}
