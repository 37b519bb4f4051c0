//! Work for which rank 0 calls the other ranks of a team.

use cardiotwin_mechanics::organ::PassiveJob;
use cardiotwin_schemas::task::OrganBeatSpec;
use serde::{Deserialize, Serialize};

use crate::finite_element::stored::About;

/// Work for which rank 0 calls the other ranks. Rank 0 also sends them the mesh.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) enum Call {
    /// A beat of a stored ventricle.
    Beat(Box<OrganBeatSpec>, Box<About>),
    /// Fibres and activation times.
    Tissue,
    /// Unloading and fit of a passive law.
    PassiveState(Box<PassiveJob>),
}
