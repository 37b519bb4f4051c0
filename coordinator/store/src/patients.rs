//! Tables `patients` (narrow rows, for `status`) and `plans` (wide rows).

use cardiotwin_schemas::status::PatientStatus;
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::patient::Patient;
use serde::Serialize;

/// Key of the refused patients, as JSON, in the table `meta`.
pub const REFUSED: &str = "refused";

/// A row of `patients`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatientRow {
    /// Row id; the other tables refer to the patient by it.
    pub id: i64,
    /// Position in the cohort.
    pub position: i64,
    /// Whether the cohort still has this patient.
    pub active: bool,
    /// Version of the row, which guards updates.
    pub version: i64,
    /// State of the patient.
    pub state: Patient,
    /// Columns that `status` shows. The pseudonym is unique in the run; `for_s` is 0, since it
    /// follows from `since_ms` when the row is read.
    pub status: PatientStatus,
    /// Time since which the shown state is unchanged, milliseconds since 1970.
    pub since_ms: i64,
}

/// A row of `plans`. Every column except the id is JSON in text.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanRow {
    /// Row id of the patient.
    pub patient_id: i64,
    /// Plan according to the cohort's files.
    pub given: String,
    /// Settings that reruns changed.
    pub overrides: String,
    /// Step 1's parameters that were simulated under earlier settings.
    pub carried: String,
    /// `given` with `overrides` on top; `None` if there are no overrides.
    pub plan: Option<String>,
}

/// The column `chain` of a row of `plans`.
#[derive(Debug, Serialize)]
pub struct ChainRow<'a> {
    /// Row id of the patient.
    pub patient_id: i64,
    /// Chain as far as it is settled.
    pub chain: &'a Chain,
}

pub(super) const INSERT: &str = "
INSERT INTO patients (id, patient, position, active, version, word, step, iteration, max_iterations, step1_cost,
                      step1_quality, step2_cost, failure_class, note, since_ms, state)
SELECT value->>'id', value->>'$.status.patient', value->>'position', value->>'active', value->>'version',
       value->>'$.status.state', value->>'$.status.step', value->>'$.status.iteration[0]',
       value->>'$.status.iteration[1]', value->>'$.status.step1_cost', value->>'$.status.step1_quality',
       value->>'$.status.step2_cost', value->>'$.status.failure_class', value->>'$.status.note', value->>'since_ms',
       value->'state'
FROM json_each(?1)";

pub(super) const UPDATE: &str = "
UPDATE patients
SET (position, active, version, word, step, iteration, max_iterations, step1_cost, step1_quality, step2_cost,
     failure_class, note, since_ms, state)
  = (value->>'position', value->>'active', patients.version + 1, value->>'$.status.state', value->>'$.status.step',
     value->>'$.status.iteration[0]', value->>'$.status.iteration[1]', value->>'$.status.step1_cost',
     value->>'$.status.step1_quality', value->>'$.status.step2_cost', value->>'$.status.failure_class',
     value->>'$.status.note', value->>'since_ms', value->'state')
FROM json_each(?1) AS new
WHERE patients.id = (new.value->>'id') AND patients.version = (new.value->>'version')";

pub(super) const PUT_PLAN: &str = "
INSERT INTO plans (patient_id, given, overrides, carried, plan, chain)
SELECT value->>'patient_id', value->>'given', value->>'overrides', value->>'carried', value->>'plan', '{}'
FROM json_each(?1) WHERE true
ON CONFLICT (patient_id) DO UPDATE
SET given = excluded.given, overrides = excluded.overrides, carried = excluded.carried, plan = excluded.plan";

pub(super) const UPDATE_CHAIN: &str = "
UPDATE plans SET chain = new.value->'chain'
FROM json_each(?1) AS new WHERE plans.patient_id = (new.value->>'patient_id')";

pub(super) const SELECT_ALL: &str = "
SELECT id, patient, position, active, version, word, step, iteration, max_iterations, step1_cost, step1_quality,
       step2_cost, failure_class, note, since_ms, state
FROM patients ORDER BY position, id";

pub(super) const SELECT_PLANS: &str =
    "SELECT patient_id, given, overrides, carried, plan, chain FROM plans";

/// Plans whose patients' ids are in a range.
pub(super) const SELECT_GROUP: &str = "
SELECT patient_id, given, overrides, carried, plan, chain FROM plans WHERE patient_id BETWEEN ?1 AND ?2";

pub(super) const LAST_PLAN: &str = "SELECT coalesce(max(patient_id), 0) FROM plans";
