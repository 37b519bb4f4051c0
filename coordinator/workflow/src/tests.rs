//! Properties of the state machines of attempts, tasks and patients, and the table of every state
//! and event.

use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::ids::{ExternalId, TaskKey};
use proptest::prelude::*;

use super::IllegalTransition;
use super::attempt::{Attempt, AttemptAction, AttemptEnding, AttemptEvent};
use super::patient::{Patient, PatientEvent, Stage, Step};
use super::task::{Task, TaskEvent};

fn failure(class: FailureClass) -> Failure {
    Failure::new(class, "why")
}

// ---------------------------------------------------------------- every state, every event

fn attempt_endings() -> Vec<AttemptEnding> {
    vec![
        AttemptEnding::Succeeded,
        AttemptEnding::Failed {
            failure: failure(FailureClass::Numerics),
        },
        AttemptEnding::Lost {
            reason: "killed".into(),
        },
        AttemptEnding::Interrupted,
        AttemptEnding::Cancelled,
    ]
}

pub(super) fn attempt_states() -> Vec<Attempt> {
    let mut states = vec![
        Attempt::Planned,
        Attempt::Submitting,
        Attempt::Running {
            id: ExternalId::from("7"),
        },
        Attempt::Unknown { since_ms: 5 },
        Attempt::Cancelling,
    ];
    states.extend(
        attempt_endings()
            .into_iter()
            .map(|how| Attempt::Done { how }),
    );
    states
}

pub(super) fn attempt_events() -> Vec<AttemptEvent> {
    let mut events = vec![
        AttemptEvent::Approve,
        AttemptEvent::Cancel,
        AttemptEvent::GiveUp,
        AttemptEvent::Accepted {
            id: ExternalId::from("7"),
        },
        AttemptEvent::Refused {
            failure: failure(FailureClass::Site),
        },
        AttemptEvent::Seen {
            id: ExternalId::from("7"),
        },
        AttemptEvent::Vanished { since_ms: 5 },
    ];
    events.extend(
        attempt_endings()
            .into_iter()
            .map(|how| AttemptEvent::Ended { how }),
    );
    events
}

fn is_command(event: &AttemptEvent) -> bool {
    matches!(
        event,
        AttemptEvent::Approve | AttemptEvent::Cancel | AttemptEvent::GiveUp
    )
}

pub(super) fn task_states() -> Vec<Task> {
    vec![
        Task::Open {
            generation: 0,
            site_failures: 0,
        },
        Task::Open {
            generation: 2,
            site_failures: 2,
        },
        Task::Attempting {
            generation: 1,
            site_failures: 0,
        },
        Task::Attempting {
            generation: 2,
            site_failures: 2,
        },
        Task::Published { generation: 1 },
        Task::Failed {
            generation: 1,
            failure: failure(FailureClass::Numerics),
        },
    ]
}

pub(super) fn task_events() -> Vec<TaskEvent> {
    let mut events = vec![TaskEvent::Start, TaskEvent::Retry, TaskEvent::Purged];
    for generation in [1, 2] {
        events.extend(attempt_endings().into_iter().map(|how| TaskEvent::Ended {
            generation,
            how,
            site_retries: 2,
        }));
    }
    events
}

fn step(stage: Stage, number: u32) -> Step {
    Step { stage, number }
}

pub(super) fn patient_states() -> Vec<Patient> {
    let task = TaskKey::from("a");
    vec![
        Patient::Waiting,
        Patient::Working {
            step: step(Stage::Step0, 1),
            task: task.clone(),
        },
        Patient::Working {
            step: step(Stage::Step1, 2),
            task,
        },
        Patient::Deciding {
            after: step(Stage::Step1, 2),
        },
        Patient::Done,
        Patient::Failed {
            step: step(Stage::Step1, 1),
            failure: failure(FailureClass::Numerics),
        },
        Patient::Cancelled { at: None },
    ]
}

pub(super) fn patient_events() -> Vec<PatientEvent> {
    vec![
        PatientEvent::Want {
            step: step(Stage::Step1, 2),
            task: TaskKey::from("a"),
        },
        PatientEvent::Want {
            step: step(Stage::Step1, 3),
            task: TaskKey::from("b"),
        },
        PatientEvent::Want {
            step: step(Stage::Targets, 1),
            task: TaskKey::from("c"),
        },
        PatientEvent::TaskSettled {
            task: TaskKey::from("a"),
        },
        PatientEvent::TaskSettled {
            task: TaskKey::from("b"),
        },
        PatientEvent::Finish,
        PatientEvent::Fail {
            step: step(Stage::Step1, 1),
            failure: failure(FailureClass::Numerics),
        },
        PatientEvent::Cancel,
        PatientEvent::Replan {
            reason: "inputs changed".into(),
        },
    ]
}

fn json<T: serde::Serialize>(value: &T) -> String {
    serde_json::to_string(value).unwrap()
}

#[test]
fn every_state_meets_every_event() {
    let mut table = String::new();
    for state in attempt_states() {
        table += &format!("attempt {}\n", json(&state));
        for event in attempt_events() {
            let line = match state.clone().on(event.clone()) {
                Ok((next, _)) if next == state && !is_command(&event) => "stays".to_owned(),
                Ok((next, actions)) => format!("{} {actions:?}", json(&next)),
                Err(error) => format!("refused: {error}"),
            };
            table += &format!("    {} -> {line}\n", json(&event));
        }
    }
    for state in task_states() {
        table += &format!("task {}\n", json(&state));
        for event in task_events() {
            let line = match state.clone().on(event.clone()) {
                Ok(next) if next == state => "stays".to_owned(),
                Ok(next) => json(&next),
                Err(error) => format!("refused: {error}"),
            };
            table += &format!("    {} -> {line}\n", json(&event));
        }
    }
    for state in patient_states() {
        table += &format!("patient {}\n", json(&state));
        for event in patient_events() {
            let line = match state.clone().on(event.clone()) {
                Ok((next, actions)) if next == state && actions.is_empty() => "stays".to_owned(),
                Ok((next, actions)) => format!("{} {actions:?}", json(&next)),
                Err(error) => format!("refused: {error}"),
            };
            table += &format!("    {} -> {line}\n", json(&event));
        }
    }
    insta::assert_snapshot!("every_state_meets_every_event", table);
}

// ---------------------------------------------------------------- random sequences

fn any_of<T: Clone + std::fmt::Debug + 'static>(all: Vec<T>) -> impl Strategy<Value = Vec<T>> {
    prop::collection::vec(prop::sample::select(all), 0..40)
}

/// Events as the log holds them, that is only accepted ones.
fn accepted<S: Clone, E: Clone>(
    start: S,
    events: &[E],
    on: impl Fn(S, E) -> Result<S, IllegalTransition>,
) -> (S, Vec<E>) {
    events
        .iter()
        .fold((start, Vec::new()), |(state, mut log), event| {
            match on(state.clone(), event.clone()) {
                Ok(next) => {
                    log.push(event.clone());
                    (next, log)
                }
                Err(_) => (state, log),
            }
        })
}

fn attempt_on(state: Attempt, event: AttemptEvent) -> Result<Attempt, IllegalTransition> {
    state.on(event).map(|(next, _)| next)
}

fn patient_on(state: Patient, event: PatientEvent) -> Result<Patient, IllegalTransition> {
    state.on(event).map(|(next, _)| next)
}

proptest! {
    #[test]
    fn no_attempt_is_left_in_limbo(events in any_of(attempt_events())) {
        let (state, _) = accepted(Attempt::Planned, &events, attempt_on);
        if !state.is_final() {
            // A person can always end the attempt, and evidence of its end is always accepted.
            let (cancelled, _) = state.clone().on(AttemptEvent::Cancel).unwrap();
            let how = AttemptEnding::Interrupted;
            let ended = attempt_on(cancelled, AttemptEvent::Ended { how }).unwrap();
            prop_assert_eq!(ended, Attempt::Done { how: AttemptEnding::Cancelled });
            let how = AttemptEnding::Succeeded;
            let ended = attempt_on(state, AttemptEvent::Ended { how: how.clone() }).unwrap();
            prop_assert_eq!(ended, Attempt::Done { how }, "evidence of an end wins in every state");
        }
    }

    #[test]
    fn an_attempt_that_is_over_stays_as_it_is(events in any_of(attempt_events()), late in any_of(attempt_events())) {
        let (state, _) = accepted(Attempt::Planned, &events, attempt_on);
        if state.is_final() {
            for event in late {
                match state.clone().on(event.clone()) {
                    Ok((next, actions)) => {
                        prop_assert_eq!(&next, &state);
                        prop_assert!(actions.is_empty());
                        prop_assert!(!is_command(&event));
                    }
                    Err(_) => prop_assert!(is_command(&event), "an observation was refused: {:?}", event),
                }
            }
        }
    }

    #[test]
    fn a_doubled_observation_changes_nothing_more(events in any_of(attempt_events())) {
        let mut state = Attempt::Planned;
        for event in events {
            let Ok((next, _)) = state.clone().on(event.clone()) else { continue };
            if !is_command(&event) {
                let (again, actions) = next.clone().on(event).unwrap();
                prop_assert_eq!(&again, &next);
                prop_assert!(actions.is_empty());
            }
            state = next;
        }
    }

    #[test]
    fn an_attempt_is_submitted_once_and_only_by_command(events in any_of(attempt_events())) {
        let (mut state, mut submits) = (Attempt::Planned, 0);
        for event in events {
            let Ok((next, actions)) = state.clone().on(event.clone()) else { continue };
            submits += actions.iter().filter(|a| **a == AttemptAction::Submit).count();
            prop_assert!(actions.is_empty() || is_command(&event));
            state = next;
        }
        prop_assert!(submits <= 1);
    }

    #[test]
    fn replaying_the_log_gives_the_same_states(
        attempt in any_of(attempt_events()),
        task in any_of(task_events()),
        patient in any_of(patient_events()),
    ) {
        // The log goes through JSON, as in the store.
        fn through<E: serde::Serialize + serde::de::DeserializeOwned>(log: &[E]) -> Vec<E> {
            log.iter().map(|event| serde_json::from_str(&json(event)).unwrap()).collect()
        }
        let (state, log) = accepted(Attempt::Planned, &attempt, attempt_on);
        prop_assert_eq!(accepted(Attempt::Planned, &through(&log), attempt_on), (state, log));
        let (state, log) = accepted(Task::default(), &task, Task::on);
        prop_assert_eq!(accepted(Task::default(), &through(&log), Task::on), (state, log));
        let (state, log) = accepted(Patient::Waiting, &patient, patient_on);
        prop_assert_eq!(accepted(Patient::Waiting, &through(&log), patient_on), (state, log));
    }

    #[test]
    fn a_published_task_stays_published_unless_purged_and_its_generations_rise(events in any_of(task_events())) {
        let mut state = Task::default();
        for event in events {
            let before = state.clone();
            let Ok(next) = state.clone().on(event.clone()) else { continue };
            prop_assert!(next.generation() >= before.generation());
            if let Task::Published { generation } = before {
                // Only missing files revoke a result, and the next attempt has a directory of its
                // own.
                let expected = match event {
                    TaskEvent::Purged => Task::Open { generation, site_failures: 0 },
                    _ => before.clone(),
                };
                prop_assert_eq!(&next, &expected);
            }
            if let (TaskEvent::Ended { generation, .. }, true) = (&event, next != before) {
                prop_assert_eq!(*generation, before.generation(), "an older generation changed the task");
            }
            state = next;
        }
    }

    #[test]
    fn no_task_is_left_in_limbo(events in any_of(task_events())) {
        let (state, _) = accepted(Task::default(), &events, Task::on);
        let open = match state {
            Task::Failed { .. } => state.on(TaskEvent::Retry).unwrap(),
            Task::Attempting { generation, .. } => {
                let how = AttemptEnding::Interrupted;
                state.on(TaskEvent::Ended { generation, how, site_retries: 0 }).unwrap()
            }
            state => state,
        };
        if !matches!(open, Task::Published { .. }) {
            let begun = open.on(TaskEvent::Start).unwrap();
            let (generation, how) = (begun.generation(), AttemptEnding::Succeeded);
            let published = begun.on(TaskEvent::Ended { generation, how, site_retries: 0 }).unwrap();
            prop_assert_eq!(published, Task::Published { generation });
        }
    }

    #[test]
    fn the_site_is_forgiven_as_often_as_asked(site_retries in 0u32..6, interruptions in 0u32..4) {
        let mut state = Task::default();
        let end = |state: Task, how: AttemptEnding| {
            let begun = state.on(TaskEvent::Start).unwrap();
            let generation = begun.generation();
            begun.on(TaskEvent::Ended { generation, how, site_retries }).unwrap()
        };
        let mut losses = 0;
        while !state.is_final() {
            // Interruptions are not charged to the site.
            for _ in 0..interruptions {
                state = end(state, AttemptEnding::Interrupted);
                prop_assert_eq!(state.word(), "open");
            }
            state = end(state, AttemptEnding::Lost { reason: "killed".into() });
            losses += 1;
        }
        prop_assert_eq!(losses, site_retries + 1);
        prop_assert_eq!(state.generation(), losses * (interruptions + 1));
    }

    #[test]
    fn no_patient_is_left_in_limbo(events in any_of(patient_events())) {
        let (state, _) = accepted(Patient::Waiting, &events, patient_on);
        // From every state a path leads to the end: the wanted task is settled, or everything is
        // decided again.
        let decided = match state.clone() {
            Patient::Working { task, .. } => patient_on(state.clone(), PatientEvent::TaskSettled { task }).unwrap(),
            Patient::Waiting | Patient::Deciding { .. } => state.clone(),
            _ => patient_on(state.clone(), PatientEvent::Replan { reason: "retry".into() }).unwrap(),
        };
        prop_assert_eq!(patient_on(decided, PatientEvent::Finish).unwrap(), Patient::Done);
        if !state.is_final() {
            let cancelled = patient_on(state, PatientEvent::Cancel).unwrap();
            prop_assert_eq!(cancelled.shown().as_str(), "cancelled");
        }
    }

    #[test]
    fn observations_are_never_refused_and_do_not_move_a_patient_that_is_over(
        events in any_of(patient_events()),
        task in prop::sample::select(vec!["a", "b", "z"]),
    ) {
        let (state, _) = accepted(Patient::Waiting, &events, patient_on);
        let (next, actions) = state.clone().on(PatientEvent::TaskSettled { task: TaskKey::from(task) }).unwrap();
        prop_assert!(actions.is_empty());
        let wanted = matches!(&state, Patient::Working { task: wanted, .. } if wanted.as_str() == task);
        prop_assert_eq!(next != state, wanted, "only the wanted task's end moves a patient");
    }

    #[test]
    fn steps_only_go_forward_without_a_replan(events in any_of(patient_events())) {
        let mut state = Patient::Waiting;
        let mut last: Option<Step> = None;
        for event in events {
            let Ok((next, _)) = state.clone().on(event.clone()) else { continue };
            match &event {
                PatientEvent::Replan { .. } => last = None,
                PatientEvent::Want { step, .. } => {
                    prop_assert!(last.is_none_or(|last| *step > last));
                    last = Some(*step);
                }
                _ => {}
            }
            state = next;
        }
    }
}

#[test]
fn failures_that_are_not_the_sites_are_never_tried_again_by_themselves() {
    for class in [
        FailureClass::Input,
        FailureClass::Numerics,
        FailureClass::Bug,
    ] {
        let begun = Task::default().on(TaskEvent::Start).unwrap();
        let how = AttemptEnding::Failed {
            failure: failure(class),
        };
        let ended = begun
            .on(TaskEvent::Ended {
                generation: 1,
                how,
                site_retries: 5,
            })
            .unwrap();
        assert!(matches!(ended, Task::Failed { .. }), "{class:?}");
    }
}
