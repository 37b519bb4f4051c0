//! Table `outbox`: actions that were decided in a transaction and are done after it. Each may run twice.

use cardiotwin_schemas::ids::AttemptId;
use serde::{Deserialize, Serialize};

/// Something to do in the world.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "action", rename_all = "kebab-case")]
pub enum Action {
    /// Hand an attempt to the executor.
    Submit {
        /// Which.
        attempt: AttemptId,
    },
    /// Fence an attempt and end its process.
    Stop {
        /// Which.
        attempt: AttemptId,
    },
    /// Submit a job to the cluster, unless its folder says that this was begun before.
    SubmitJob {
        /// Its name.
        job: String,
    },
    /// Fence an element of a job: it begins and publishes nothing more.
    FenceJob {
        /// The job's name.
        job: String,
        /// Which.
        element: usize,
    },
    /// Cancel an element of a job at the scheduler.
    CancelJob {
        /// The job's name.
        job: String,
        /// Which.
        element: usize,
    },
    /// Write a patient's `model.toml`.
    WriteOverlay {
        /// Whose.
        patient_id: i64,
    },
}

/// A new row.
#[derive(Debug, Serialize)]
pub struct NewAction<'a> {
    /// Given by the writer, rising.
    pub id: i64,
    /// Milliseconds since 1970.
    pub at_ms: i64,
    /// What.
    pub action: &'a Action,
}

pub(super) const INSERT: &str = "
INSERT INTO outbox (id, at_ms, action) SELECT value->>'id', value->>'at_ms', value->'action' FROM json_each(?1)";

pub(super) const DONE: &str = "DELETE FROM outbox WHERE id IN (SELECT value FROM json_each(?1))";

pub(super) const SELECT_PENDING: &str = "SELECT id, action FROM outbox ORDER BY id";
