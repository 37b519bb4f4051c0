//! Step 0's search for the passive state: on one rank, on threads, or on the ranks of a team.

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::{
    Anatomy, FoundState, PassiveJob, PassiveStateError, Piece, Search, UnloadingSettings, parts_of,
};

use crate::call::Call;
use crate::team::Team;

/// Ranks that carry out a search.
#[derive(Debug, Clone, Copy)]
pub enum Workers<'a> {
    /// Number of threads of this process.
    Threads(usize),
    /// Ranks in several processes.
    Team(&'a Team),
}

impl<'a> Workers<'a> {
    /// The team if there is one, otherwise threads.
    pub(crate) fn of(team: Option<&'a Team>, threads: usize) -> Self {
        team.map_or(Self::Threads(threads), Self::Team)
    }
}

/// Carries out a search on all workers if its solver supports ranks, otherwise on one.
///
/// # Errors
/// [`PassiveStateError`] of the search.
pub fn found(
    job: &PassiveJob,
    anatomy: &Anatomy,
    workers: Workers<'_>,
    search: &mut Search<'_>,
) -> Result<FoundState, PassiveStateError> {
    match workers {
        Workers::Team(team) if team.n_ranks() > 1 && search.settings.are_for_ranks(anatomy) => {
            let parts = parts_of(anatomy, team.n_ranks())?;
            let _session = team.begin(&Call::PassiveState(Box::new(job.clone())));
            let piece = Piece::sent(anatomy, parts, team.shared_comm());
            job.run(&piece, search)
        }
        Workers::Team(_) => job.run(&Piece::whole(anatomy), search),
        Workers::Threads(n) => job.on_threads(anatomy, search, n, ThreadSettings::default()),
    }
}

/// Takes part in [`found`] on a rank other than 0. Errors are ignored here, because rank 0 reports
/// them.
pub(crate) fn serve(job: &PassiveJob, team: &Team) {
    let piece = Piece::received(team.shared_comm());
    let _ = job.run(&piece, &mut Search::new(UnloadingSettings::on_ranks()));
}
