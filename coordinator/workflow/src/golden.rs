//! Stored states, events and chains as version 1 of each wrote them: every later version reads them.

use cardiotwin_schemas::formats::{self, Format};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::attempt::{Attempt, AttemptEvent};
use super::chain::Chain;
use super::cluster_job::{ClusterJob, Element, JobEvent, Submission};
use super::patient::{Patient, PatientEvent};
use super::task::{Task, TaskEvent};
use super::tests;

fn text(format: &Format) -> Value {
    let text = match *format {
        formats::PATIENT_STATE => include_str!("../tests/golden/patient-states.json"),
        formats::TASK_STATE => include_str!("../tests/golden/task-states.json"),
        formats::ATTEMPT_STATE => include_str!("../tests/golden/attempt-states.json"),
        formats::JOB_STATE => include_str!("../tests/golden/job-states.json"),
        formats::EVENTS => include_str!("../tests/golden/events.json"),
        formats::CHAIN => include_str!("../tests/golden/chain.json"),
        _ => panic!("nothing here reads {}", format.golden),
    };
    serde_json::from_str(text).unwrap()
}

#[test]
fn every_format_of_this_crate_is_read_here() {
    let here = |format: &&Format| format.golden.starts_with("coordinator/workflow/");
    assert_eq!(formats::ALL.iter().filter(here).map(text).count(), 6);
}

/// What was written is read, and is written alike.
fn round<T: DeserializeOwned + Serialize>(golden: &Value) -> T {
    let read: T = serde_json::from_value(golden.clone()).unwrap();
    assert_eq!(&serde_json::to_value(&read).unwrap(), golden);
    read
}

#[test]
fn each_stored_state_is_read_as_it_was_written() {
    assert_eq!(
        round::<Vec<Patient>>(&text(&formats::PATIENT_STATE)),
        tests::patient_states()
    );
    assert_eq!(
        round::<Vec<Task>>(&text(&formats::TASK_STATE)),
        tests::task_states()
    );
    assert_eq!(
        round::<Vec<Attempt>>(&text(&formats::ATTEMPT_STATE)),
        tests::attempt_states()
    );
}

#[test]
fn each_state_of_a_cluster_job_is_read_as_it_was_written() {
    let jobs: Vec<ClusterJob> = round(&text(&formats::JOB_STATE));
    let submissions = jobs.iter().map(|job| match job.submission {
        Submission::Intended => 0,
        Submission::Doubtful { .. } => 1,
        Submission::Accepted { job: None } => 2,
        Submission::Accepted { job: Some(_) } => 3,
        Submission::Void { .. } => 4,
    });
    assert_eq!(submissions.collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    let elements = jobs[3].elements.iter().map(|element| match element {
        Element::Waiting => 0,
        Element::Running => 1,
        Element::Unknown { .. } => 2,
        Element::Stopping => 3,
        Element::Over { ending } if ending.cause.is_none() => 4,
        Element::Over { .. } => 5,
    });
    assert_eq!(
        elements.collect::<Vec<_>>(),
        [0, 1, 2, 3, 4, 5, 5, 5, 5, 5, 5, 5, 5]
    );
}

#[test]
fn each_event_is_read_as_it_was_written() {
    let golden = text(&formats::EVENTS);
    assert_eq!(
        round::<Vec<PatientEvent>>(&golden["patient"]),
        tests::patient_events()
    );
    assert_eq!(
        round::<Vec<TaskEvent>>(&golden["task"]),
        tests::task_events()
    );
    assert_eq!(
        round::<Vec<AttemptEvent>>(&golden["attempt"]),
        tests::attempt_events()
    );
    let of_jobs: Vec<JobEvent> = round(&golden["job"]);
    let kinds = of_jobs.iter().map(|event| match event {
        JobEvent::Cancel { .. } => 0,
        JobEvent::GiveUp { .. } => 1,
        JobEvent::Accepted { .. } => 2,
        JobEvent::Refused { .. } => 3,
        JobEvent::Doubt { .. } => 4,
        JobEvent::Absent => 5,
        JobEvent::Seen { .. } => 6,
        JobEvent::Vanished { .. } => 7,
        JobEvent::Ended { .. } => 8,
    });
    assert_eq!(kinds.collect::<Vec<_>>(), (0..9).collect::<Vec<_>>());
}

#[test]
fn a_chain_is_read_as_it_was_written() {
    let chain: Chain = round(&text(&formats::CHAIN));
    assert_eq!(chain.steps().count(), 12);
}

/// Additions of a later version are left out of account.
#[test]
fn a_state_with_an_addition_is_read() {
    let mut states = text(&formats::PATIENT_STATE);
    for state in states.as_array_mut().unwrap() {
        state["of_tomorrow"] = 1.into();
    }
    let read: Vec<Patient> = serde_json::from_value(states).unwrap();
    assert_eq!(read, tests::patient_states());
}
