//! The cell fit gives the same numbers for any number of interruptions and threads.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use cardiotwin_schemas::biomarkers::CellBiomarkers;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::{Ending, TargetsResult, TaskOutcome, TaskResult};
use cardiotwin_schemas::settings::{CellFitSettings, InstructionSet};
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::{Artefacts, Context};
use cardiotwin_worker::progress::ProgressLog;
use cardiotwin_worker::run::run_attempt;
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::tasks::run_task;

fn fit(settings: CellFitSettings) -> TaskSpec {
    let targets = CellBiomarkers {
        sa_max_kpa: 58.0,
        dsadt_max_kpa_per_ms: 0.9,
        std30_ms: 260.0,
        std50_ms: 320.0,
        std90_ms: 398.0,
        lambda_min: 0.835,
    };
    let targets = TargetsResult {
        lambda_0: 1.0,
        lambda_max: 1.0,
        targets,
        n_nodes: 16,
        has_calcium: false,
    };
    TaskSpec::CellFit(Box::new(support::cell_fit_spec(852.0, &targets, settings)))
}

/// A fit that takes about a second: first population, eight generations, polish.
fn short() -> TaskSpec {
    fit(CellFitSettings {
        popsize: 2,
        max_generations: 8,
        ..CellFitSettings::default()
    })
}

fn result(ending: Ending) -> TaskResult {
    match ending {
        Ending::Succeeded { result } => *result,
        ending => panic!("{ending:?}"),
    }
}

fn uninterrupted(task: &TaskSpec, threads: u32) -> (TaskResult, String) {
    let scratch = tempfile::tempdir().unwrap();
    let result = result(run_task(task, &mut Context::plain(scratch.path(), threads)));
    (
        result,
        fs::read_to_string(scratch.path().join("convergence.csv")).unwrap(),
    )
}

fn attempt_directory(root: &Path, task: &TaskSpec, generation: u32, threads: u32) -> PathBuf {
    let key = task.key();
    let directory = root.join(format!("{}-g{generation}", &key.0[..16]));
    fs::create_dir_all(&directory).unwrap();
    let attempt = AttemptId {
        task: key,
        generation,
    };
    let spec = AttemptSpec {
        schema_version: formats::SPEC.version,
        attempt,
        threads,
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

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    assert_eq!(uninterrupted(&short(), 1), uninterrupted(&short(), 2));
}

#[test]
fn a_fit_stopped_after_every_batch_ends_as_one_that_was_not() {
    let task = short();
    let expected = uninterrupted(&task, 1);
    let root = tempfile::tempdir().unwrap();
    let mut stopped = 0;
    // Each attempt computes one batch, because its stop flag is raised from the beginning; the
    // tenth and last one may finish.
    for generation in 1..=10 {
        let directory = attempt_directory(root.path(), &task, generation, 1);
        let stop = StopFlag::default();
        if generation < 10 {
            stop.raise();
        }
        match run_attempt(&directory, None, &stop, false).unwrap() {
            Ending::Cancelled => stopped += 1,
            ending => {
                let convergence = fs::read_to_string(directory.join("convergence.csv")).unwrap();
                assert_eq!((result(ending), convergence), expected);
            }
        }
    }
    assert_eq!(stopped, 9);
}

#[test]
fn a_damaged_checkpoint_costs_time_but_no_digits() {
    let task = short();
    let root = tempfile::tempdir().unwrap();
    let first = attempt_directory(root.path(), &task, 1, 1);
    let stop = StopFlag::default();
    stop.raise();
    assert_eq!(
        run_attempt(&first, None, &stop, false).unwrap(),
        Ending::Cancelled
    );
    let file = first.join("checkpoint/told-costs");
    let mut bytes = fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&file, bytes).unwrap();
    let second = attempt_directory(root.path(), &task, 2, 1);
    let mut context = Context {
        artefacts: Artefacts::in_directory(&second),
        checkpoints: Checkpoints::of_attempt(
            &second,
            &AttemptId {
                task: task.key(),
                generation: 2,
            },
        ),
        progress: ProgressLog::silent(),
        ..Context::plain(&second, 1)
    };
    assert_eq!(
        result(run_task(&task, &mut context)),
        uninterrupted(&task, 1).0
    );
}

#[test]
fn a_killed_fit_is_continued_by_the_next_generation() {
    // The fit to be killed never ends by itself, so it cannot end too early. Until it is killed, it
    // does the same as the fit that ends after 30 generations.
    let endless = CellFitSettings {
        max_generations: 1_000_000,
        tol: 0.0,
        polish: false,
        identifiability: false,
        ..CellFitSettings::default()
    };
    let task = fit(CellFitSettings {
        max_generations: 30,
        ..endless.clone()
    });
    let root = tempfile::tempdir().unwrap();
    let killed = attempt_directory(root.path(), &fit(endless), 1, 1);
    let mut child = spawn(&killed);
    let checkpoint = killed.join("checkpoint/told-costs");
    wait_for(|| {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        fs::metadata(&checkpoint).is_ok_and(|file| file.len() > 5_000)
    });
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!killed.join("outcome.json").exists());

    let first = attempt_directory(root.path(), &task, 1, 1);
    fs::rename(killed.join("checkpoint"), first.join("checkpoint")).unwrap();
    let second = attempt_directory(root.path(), &task, 2, 2);
    let output = spawn(&second).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(
        log.contains("continuing the fit of an earlier attempt"),
        "{log}"
    );
    let outcome: TaskOutcome =
        serde_json::from_slice(&fs::read(second.join("outcome.json")).unwrap()).unwrap();
    assert_eq!(outcome.provenance.seed, Some(1));
    assert_eq!(outcome.artefacts.len(), 2);
    assert_eq!(result(outcome.ending), uninterrupted(&task, 1).0);
}

#[test]
fn a_search_is_taken_up_again_at_any_of_its_generations() {
    let settings = |max_generations| CellFitSettings {
        popsize: 2,
        max_generations,
        ..CellFitSettings::default()
    };
    let (short, long) = (fit(settings(4)), fit(settings(8)));
    let root = tempfile::tempdir().unwrap();
    let left = |name: &str| root.path().join(name).join("checkpoint/told-costs");
    let run = |task: &TaskSpec, name: &str, from: Option<(&str, Option<u64>)>| {
        let directory = root.path().join(name);
        fs::create_dir_all(&directory).unwrap();
        let other = root.path().join(from.map_or("none", |from| from.0));
        let checkpoints = Checkpoints::restarting(&directory, &other, from.and_then(|from| from.1));
        result(run_task(
            task,
            &mut Context {
                checkpoints,
                ..Context::plain(&directory, 1)
            },
        ))
    };
    let expected = run(&long, "long", None);
    for generation in 0..=8 {
        let name = format!("from-{generation}");
        assert_eq!(
            run(&long, &name, Some(("long", Some(generation)))),
            expected,
            "generation {generation}"
        );
        assert_eq!(
            fs::read(left(&name)).unwrap(),
            fs::read(left("long")).unwrap()
        );
    }
    // With another limit it is the same search, which continues after the end of the shorter one.
    run(&short, "short", None);
    assert_eq!(run(&long, "longer", Some(("short", None))), expected);
    // With other targets it is another search, which starts from the beginning.
    let mut spec = match &long {
        TaskSpec::CellFit(spec) => spec.clone(),
        other => panic!("{other:?}"),
    };
    spec.targets.sa_max_kpa *= 1.1;
    let other = TaskSpec::CellFit(spec);
    assert_eq!(
        run(&other, "other", Some(("long", None))),
        uninterrupted(&other, 1).0
    );
}

fn spawn(directory: &Path) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cardiotwin-worker"));
    command
        .arg("run")
        .arg(directory)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn wait_for(mut condition: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !condition() {
        assert!(
            begin.elapsed() < Duration::from_secs(300),
            "nothing happened"
        );
        std::thread::sleep(Duration::from_millis(2));
    }
}
