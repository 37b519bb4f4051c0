//! Executes an attempt from claim to outcome, or a task alone.

use std::any::Any;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::{Arc, Mutex};

use cardiotwin_protocol::names;
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::organ_law::LawKnowledge;
use cardiotwin_schemas::outcome::{Ending, TaskOutcome};
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::task::TaskSpec;

use crate::attempt::{Attempt, AttemptError};
use crate::checkpoint::Checkpoints;
use crate::context::{Artefacts, CHECKPOINT_APART, CHECKPOINT_MS, Context};
use crate::progress::ProgressLog;
use crate::provenance::Beginning;
use crate::stop::StopFlag;
use crate::tasks::proposal::in_law;
use crate::tasks::run_task;
use crate::team::Team;

/// Claims the attempt in `directory`, executes its task (a 3D beat on the ranks of `team`) and
/// publishes the outcome.
///
/// # Errors
/// [`AttemptError`] when no outcome was published. A task that fails is not an error but an
/// outcome.
pub fn run_attempt(
    directory: &Path,
    team: Option<Team>,
    stop: &StopFlag,
    echo: bool,
) -> Result<Ending, AttemptError> {
    let beginning = Beginning::now();
    let nodes = team.as_ref().map_or(&[][..], Team::nodes);
    let attempt = Attempt::claim(directory, nodes)?;
    let mut context = Context {
        artefacts: Artefacts::in_directory(directory),
        threads: if team.is_some() {
            1
        } else {
            attempt.spec.threads.max(1)
        },
        team,
        instruction_set: attempt.spec.instruction_set,
        progress: ProgressLog::in_directory(directory, echo),
        checkpoints: Checkpoints::of_attempt(directory, &attempt.spec.attempt),
        checkpoint_ms: CHECKPOINT_MS,
        checkpoint_apart: CHECKPOINT_APART,
        vtu_every_ms: attempt.spec.vtu_every_ms,
        stop: stop.clone(),
        closed: Some(directory.join(names::OUTCOME)),
    };
    let task = &attempt.spec.task;
    let ending = guarded(task.kind(), || run_task(task, &mut context));
    let outcome = outcome(
        attempt.spec.attempt.clone(),
        ending,
        &attempt.spec.task,
        &mut context,
        &beginning,
    );
    attempt.publish(&outcome)?;
    Ok(outcome.ending)
}

/// Executes one task without a claim.
#[must_use]
pub fn simulate(task: &TaskSpec, context: Context) -> TaskOutcome {
    alone(task, context, |context| run_task(task, context))
}

/// As [`simulate`], with the organ's law in place of a beat's finite-element ventricle.
#[must_use]
pub fn simulate_in_law(task: &TaskSpec, known: &LawKnowledge, context: Context) -> TaskOutcome {
    alone(task, context, |context| match task {
        TaskSpec::OrganBeat(beat) => in_law(beat, known, context),
        _ => run_task(task, context),
    })
}

fn alone(
    task: &TaskSpec,
    mut context: Context,
    work: impl FnOnce(&mut Context) -> Ending,
) -> TaskOutcome {
    let beginning = Beginning::now();
    let ending = guarded(task.kind(), || work(&mut context));
    outcome(
        AttemptId {
            task: task.key(),
            generation: 0,
        },
        ending,
        task,
        &mut context,
        &beginning,
    )
}

fn outcome(
    attempt: AttemptId,
    ending: Ending,
    task: &TaskSpec,
    context: &mut Context,
    beginning: &Beginning,
) -> TaskOutcome {
    let ranks = context
        .team
        .as_ref()
        .map_or(1, |team| team.n_ranks() as u32);
    let provenance = Provenance {
        ranks,
        ..beginning.provenance(task, context.threads, context.instruction_set)
    };
    TaskOutcome {
        schema_version: formats::OUTCOME.version,
        attempt,
        ending,
        artefacts: context.artefacts.take(),
        provenance,
        sha256: None,
    }
}

/// Runs the task. A panic becomes a failure of class `bug` with the panic's message and location.
fn guarded(kind: &str, work: impl FnOnce() -> Ending) -> Ending {
    let place: Arc<Mutex<Option<String>>> = Arc::default();
    let seen = Arc::clone(&place);
    let earlier = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        let location = info
            .location()
            .map(|location| format!("{}:{}", location.file(), location.line()));
        eprintln!("defect in the worker: {info}");
        if let Ok(mut place) = seen.lock() {
            // The first panic is the cause; panics of other threads follow from it.
            place.get_or_insert(location.unwrap_or_default());
        }
    }));
    let caught = panic::catch_unwind(AssertUnwindSafe(work));
    panic::set_hook(earlier);
    caught.unwrap_or_else(|payload| {
        let place = place
            .lock()
            .ok()
            .and_then(|mut place| place.take())
            .unwrap_or_default();
        let message = format!(
            "{kind} task panicked at {place}: {}",
            panic_message(payload.as_ref())
        );
        let remedy = "please report this with the attempt's spec.json".to_owned();
        Ending::Failed {
            failure: Failure {
                class: FailureClass::Bug,
                message,
                remedy: Some(remedy),
                cause: None,
            },
        }
    })
}

fn panic_message(payload: &(dyn Any + Send)) -> String {
    payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    // One test for both cases, because the hook belongs to the whole process.
    #[test]
    fn a_panic_is_a_failure_of_class_bug_with_message_and_place() {
        for text in ["a text", "a made text"] {
            let ending = guarded("noop", || {
                if text == "a text" {
                    panic!("a text")
                } else {
                    panic!("a {} text", "made")
                }
            });
            let Ending::Failed { failure } = ending else {
                panic!("{ending:?}")
            };
            assert_eq!(failure.class, FailureClass::Bug);
            assert!(
                failure
                    .message
                    .starts_with("noop task panicked at worker/src/run.rs:"),
                "{}",
                failure.message
            );
            assert!(failure.message.ends_with(text), "{}", failure.message);
        }
        assert_eq!(guarded("noop", || Ending::Cancelled), Ending::Cancelled);

        let ending = guarded("cell-fit", || {
            rayon::ThreadPoolBuilder::new()
                .num_threads(2)
                .build()
                .map(|pool| pool.install(|| panic!("far away")))
                .ok();
            Ending::Cancelled
        });
        let Ending::Failed { failure } = ending else {
            panic!("{ending:?}")
        };
        assert!(failure.message.ends_with("far away"), "{}", failure.message);
    }
}
