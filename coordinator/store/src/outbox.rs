//! Table `outbox`: actions decided in a transaction and executed after it. Each may be executed
//! twice.

use cardiotwin_schemas::ids::AttemptId;
use serde::{Deserialize, Serialize};

/// An action with an effect outside of the database.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "action", rename_all = "kebab-case")]
pub enum Action {
    /// Hand an attempt to the executor.
    Submit {
        /// Id of the attempt to start.
        attempt: AttemptId,
    },
    /// Fence an attempt and end its process.
    Stop {
        /// Id of the attempt to end.
        attempt: AttemptId,
    },
    /// Submit a job to the cluster, unless its folder shows that this was begun before.
    SubmitJob {
        /// Name of the job.
        job: String,
    },
    /// Fence an element of a job, which then begins and publishes nothing more.
    FenceJob {
        /// Name of the job to which the element belongs.
        job: String,
        /// Index of the element.
        element: usize,
    },
    /// Cancel an element of a job at the scheduler.
    CancelJob {
        /// Name of the job to which the element belongs.
        job: String,
        /// Index of the element.
        element: usize,
    },
    /// Write a patient's `model.toml`.
    WriteOverlay {
        /// Row id of the patient.
        patient_id: i64,
    },
}

/// A new row of `outbox`.
#[derive(Debug, Serialize)]
pub struct NewAction<'a> {
    /// Row id, assigned by the writer in rising order.
    pub id: i64,
    /// Time of the decision, milliseconds since 1970.
    pub at_ms: i64,
    /// The action, stored as JSON.
    pub action: &'a Action,
}

pub(super) const INSERT: &str = "
INSERT INTO outbox (id, at_ms, action) SELECT value->>'id', value->>'at_ms', value->'action' FROM json_each(?1)";

pub(super) const DONE: &str = "DELETE FROM outbox WHERE id IN (SELECT value FROM json_each(?1))";

pub(super) const SELECT_PENDING: &str = "SELECT id, action FROM outbox ORDER BY id";
