//! Computation of fibres and activation times on one rank, on threads, or on the ranks of a team.

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::PassiveStateError;
use cardiotwin_mechanics::tissue::{self, FEWEST_NODES, Tissue, TissueError, TissueJob};
use cardiotwin_mesh::TetMesh;

use super::FiniteElementError;
use super::passive::Workers;
use crate::call::Call;
use crate::team::Team;

/// Carries out a job on all workers if the mesh is large enough, otherwise on one. `fibres_done` is
/// called when the fibres are computed.
///
/// # Errors
/// [`FiniteElementError`] for fibres or activation times that cannot be computed.
pub fn found(
    job: &TissueJob,
    mesh: &TetMesh,
    workers: Workers<'_>,
    fibres_done: &(dyn Fn() + Sync),
) -> Result<Tissue, FiniteElementError> {
    let threads = match workers {
        Workers::Team(team) if team.n_ranks() > 1 && mesh.n_nodes() >= FEWEST_NODES => {
            let (comm, begin) = (team.shared_comm(), || team.begin(&Call::Tissue));
            return job
                .lead(mesh, comm.as_ref(), begin, fibres_done)
                .map_err(FiniteElementError::from);
        }
        Workers::Team(_) => 1,
        Workers::Threads(n) => n,
    };
    Ok(job.on_threads(mesh, threads, ThreadSettings::default(), fibres_done)?)
}

/// Takes part in [`found`] on a rank other than 0. Rank 0 reports the errors.
pub(crate) fn serve(team: &Team) {
    tissue::serve(team.shared_comm().as_ref());
}

impl From<TissueError> for FiniteElementError {
    fn from(error: TissueError) -> Self {
        match error {
            TissueError::Fibres(error) => Self::Fibres(error),
            TissueError::Activation(error) => Self::Activation(error),
            TissueError::Partition(error) => Self::PassiveState(PassiveStateError::from(error)),
            TissueError::Rank(error) => Self::PassiveState(PassiveStateError::from(error)),
        }
    }
}
