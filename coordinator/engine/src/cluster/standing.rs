//! How patients stand whose job has ended.

use cardiotwin_schemas::ids::AttemptId;

use cardiotwin_store::cluster_jobs::Placed;

/// An element of a job that was revoked, with its patients.
pub struct Settlement {
    pub name: String,
    pub element: usize,
    pub patients: Vec<Standing>,
}

/// Standing of a patient whose job has ended.
pub struct Standing {
    pub i: usize,
    pub placed: Placed,
    /// The attempt of this job that was revoked before it published.
    pub interrupted: Option<AttemptId>,
    /// Whether tasks were settled, or a checkpoint was left.
    pub has_progressed: bool,
    /// Reason for which the driver left the patient.
    pub left: Option<String>,
    /// Whether the patient's worker died of a defect.
    pub has_defect: bool,
}
