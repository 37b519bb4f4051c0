//! Table `steps`: present and former tasks of the steps of patients' chains.

use cardiotwin_workflow::patient::Stage;
use serde::Serialize;

/// A new row of `steps`.
#[derive(Debug, Serialize)]
pub struct StepRow<'a> {
    /// Row id of the patient.
    pub patient_id: i64,
    /// Stage of the chain.
    pub stage: Stage,
    /// Number of the task within the stage, from 1.
    pub number: u32,
    /// Key of the task.
    pub task: &'a str,
    /// Time since which the step has this task, milliseconds since 1970.
    pub at_ms: i64,
}

pub(super) const INSERT: &str = "
INSERT INTO steps (patient_id, stage, number, task, at_ms)
SELECT value->>'patient_id', value->>'stage', value->>'number', value->>'task', value->>'at_ms' FROM json_each(?1)";

/// The present task of each step, as one text per patient.
pub(super) const SELECT_PRESENT: &str = "
SELECT patient_id, json_group_array(json_array(stage, number, task)) FROM
    (SELECT patient_id, stage, number, task, max(id) FROM steps GROUP BY patient_id, stage, number)
GROUP BY patient_id";

/// Present and former tasks of the steps of one patient, oldest first.
pub(super) const SELECT_OF_PATIENT: &str = "
SELECT steps.stage, steps.number, steps.task, steps.at_ms, tasks.spec, tasks.state
FROM steps JOIN tasks ON tasks.key = steps.task WHERE steps.patient_id = ?1 ORDER BY steps.id";

/// Other patients that share a task with this one.
pub(super) const SELECT_SHARED: &str = "
SELECT steps.task, patients.patient FROM steps JOIN patients ON patients.id = steps.patient_id
WHERE patients.id <> ?1 AND steps.task IN (SELECT task FROM steps WHERE patient_id = ?1)
GROUP BY steps.task, patients.id ORDER BY patients.position";
