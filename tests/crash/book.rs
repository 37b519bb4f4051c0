//! Content of the database after a run, and the properties that it must have.

use std::collections::BTreeMap;

use cardiotwin_engine::{AttemptRecord, EventRecord, Reader};
use cardiotwin_schemas::status::Status;
use cardiotwin_workflow::attempt::Attempt;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use crate::scene::Scene;

/// Status, attempts and complete log of a run.
pub struct Book {
    status: Status,
    events: Vec<EventRecord>,
    attempts: Vec<AttemptRecord>,
}

impl Book {
    pub fn read(scene: &Scene) -> Self {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async {
            let reader = Reader::open(&scene.run_dir())
                .await
                .expect("the database can be read");
            let status = reader.status().await.expect("a status");
            let events = reader.history(None).await.expect("a history");
            let mut attempts = Vec::new();
            for patient in &status.patients {
                attempts.extend(
                    reader
                        .attempts(&patient.patient.as_str().into())
                        .await
                        .expect("attempts"),
                );
            }
            Self {
                status,
                events,
                attempts,
            }
        })
    }

    fn of_tasks(&self) -> BTreeMap<String, Vec<&EventRecord>> {
        let mut by_task: BTreeMap<String, Vec<&EventRecord>> = BTreeMap::new();
        for event in self.events.iter().filter(|e| e.machine == "task") {
            by_task
                .entry(
                    event
                        .task
                        .as_ref()
                        .expect("a task's event names it")
                        .to_string(),
                )
                .or_default()
                .push(event);
        }
        by_task
    }

    /// Asserts that every patient is done, and that every task was published exactly once and never
    /// begun again afterwards.
    pub fn assert_sound(&self) {
        for patient in &self.status.patients {
            assert_eq!(
                (patient.state.as_str(), patient.step.as_str()),
                ("done", "done"),
                "{}",
                patient.patient
            );
        }
        for (task, events) in self.of_tasks() {
            let published: Vec<usize> = (0..events.len())
                .filter(|i| is_success(events[*i]))
                .collect();
            assert_eq!(
                published.len(),
                1,
                "task {task} must be published once: {events:#?}"
            );
            assert_eq!(
                published[0],
                events.len() - 1,
                "task {task} went on after it was published: {events:#?}"
            );
        }
        let mut over = BTreeMap::new();
        for event in self.events.iter().filter(|e| e.machine == "attempt") {
            let attempt = (event.task.clone(), event.generation);
            let ended = event.event["event"] == "ended";
            let before = over.insert(attempt, ended);
            assert_ne!(
                before,
                Some(true),
                "an attempt that was over changed: {event:#?}"
            );
        }
        assert!(
            over.values().all(|ended| *ended),
            "an attempt is in limbo: {over:#?}"
        );
        self.assert_replayed();
    }

    /// Asserts that the log, fed to the machines again, gives the states in the tables.
    fn assert_replayed(&self) {
        let mut patients: BTreeMap<String, Patient> = BTreeMap::new();
        let mut tasks: BTreeMap<String, Task> = BTreeMap::new();
        let mut attempts: BTreeMap<(String, u32), Attempt> = BTreeMap::new();
        for record in &self.events {
            let event = record.event.clone();
            let task = || record.task.as_ref().expect("its task").to_string();
            match record.machine.as_str() {
                "patient" => {
                    let id = record.patient.as_ref().expect("its patient").to_string();
                    let state = patients.remove(&id).unwrap_or(Patient::Waiting);
                    let event = serde_json::from_value(event).expect("a patient's event");
                    patients.insert(
                        id,
                        state.on(event).expect("it was legal when it was logged").0,
                    );
                }
                "task" => {
                    let state = tasks.remove(&task()).unwrap_or_default();
                    let event = serde_json::from_value(event).expect("a task's event");
                    tasks.insert(
                        task(),
                        state.on(event).expect("it was legal when it was logged"),
                    );
                }
                _ => {
                    let id = (task(), record.generation.expect("its generation"));
                    let state = attempts.remove(&id).unwrap_or(Attempt::Planned);
                    let event = serde_json::from_value(event).expect("an attempt's event");
                    attempts.insert(
                        id,
                        state.on(event).expect("it was legal when it was logged").0,
                    );
                }
            }
        }
        assert!(
            patients.values().all(|state| *state == Patient::Done),
            "{patients:?}"
        );
        assert!(
            tasks
                .values()
                .all(|state| matches!(state, Task::Published { .. })),
            "{tasks:?}"
        );
        let stored: BTreeMap<_, _> = self
            .attempts
            .iter()
            .map(|a| ((a.task.to_string(), a.generation), a.state.clone()))
            .collect();
        assert_eq!(attempts, stored);
    }

    /// The part of the result that does not depend on where the coordinator died: patients, their
    /// states, the published tasks.
    pub fn end_state(&self) -> (Vec<(String, String, String)>, Vec<String>) {
        let patients = self.status.patients.iter();
        let patients = patients
            .map(|p| (p.patient.clone(), p.step.clone(), p.state.to_string()))
            .collect();
        let published = self
            .of_tasks()
            .into_iter()
            .filter(|(_, events)| events.iter().any(|e| is_success(e)));
        (patients, published.map(|(task, _)| task).collect())
    }

    /// Generation that published, for each task, sorted.
    pub fn generations(&self) -> Vec<u64> {
        let published = self
            .events
            .iter()
            .filter(|e| e.machine == "task" && is_success(e));
        let mut generations: Vec<u64> = published
            .filter_map(|e| e.event["generation"].as_u64())
            .collect();
        generations.sort_unstable();
        generations
    }
}

fn is_success(event: &EventRecord) -> bool {
    event.event["event"] == "ended" && event.event["how"]["how"] == "succeeded"
}
