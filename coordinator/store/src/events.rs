//! Table `events`: append-only. Replaying it through the state machines gives the states of the
//! other tables.

use serde::Serialize;
use serde_json::Value;

/// A new row of `events`.
#[derive(Debug, Serialize)]
pub struct NewEvent<'a> {
    /// Time, milliseconds since 1970.
    pub at_ms: i64,
    /// State machine: `patient`, `task`, `attempt` or `job`.
    pub machine: &'static str,
    /// Row id of the patient, for the machine `patient`.
    pub patient_id: Option<i64>,
    /// Key of the task, for the machines `task` and `attempt`.
    pub task: Option<&'a str>,
    /// Generation of the attempt, for the machine `attempt`.
    pub generation: Option<u32>,
    /// The event that was fed to the machine.
    pub event: &'a Value,
}

pub(super) const INSERT: &str = "
INSERT INTO events (at_ms, machine, patient_id, task, generation, event)
SELECT value->>'at_ms', value->>'machine', value->>'patient_id', value->>'task', value->>'generation', value->'event'
FROM json_each(?1)";

pub(super) const SELECT_ALL: &str = "
SELECT sequence, at_ms, machine, patient, task, generation, event
FROM events LEFT JOIN patients ON patients.id = events.patient_id ORDER BY sequence";

pub(super) const SELECT_OF_PATIENT: &str = "
SELECT sequence, at_ms, machine, patient, task, generation, event
FROM events LEFT JOIN patients ON patients.id = events.patient_id
WHERE events.patient_id = ?1 OR events.task IN (SELECT task FROM steps WHERE patient_id = ?1) ORDER BY sequence";
