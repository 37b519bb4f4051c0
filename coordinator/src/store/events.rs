//! Table `events`: append-only; replaying it through the machines gives the states of the other tables.

use serde::Serialize;
use serde_json::Value;

/// A new line.
#[derive(Debug, Serialize)]
pub struct NewEvent<'a> {
    /// Milliseconds since 1970.
    pub at_ms: i64,
    /// `patient`, `task` or `attempt`.
    pub machine: &'static str,
    /// Whose, for `patient`.
    pub patient_id: Option<i64>,
    /// Which task, for `task` and `attempt`.
    pub task: Option<&'a str>,
    /// Which attempt.
    pub generation: Option<u32>,
    /// As it was fed to the machine.
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
