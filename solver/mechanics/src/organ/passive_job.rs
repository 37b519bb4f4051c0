//! Step 0 on one rank or several: its task, and the state that all ranks find together.

use std::sync::Arc;

use cardiotwin_linalg::parallel::{Crew, RankFailure, ThreadRank, ThreadSettings, crew};
use serde::{Deserialize, Serialize};

use super::anatomy::Anatomy;
use super::end_diastole::EndDiastole;
use super::passive_fit::{PassiveFit, Slope, fit, stiffened};
use super::passive_state_error::PassiveStateError;
use super::piece::{Piece, parts_of};
use super::search::Search;
use super::wall::WallParameters;

/// Task of step 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassiveJob {
    /// The wall; the search begins with its passive law.
    pub wall: WallParameters,
    /// Targets of the fit.
    pub target: PassiveFit,
    /// Slope of the fit on another mesh, if there is one.
    pub slope: Option<Slope>,
    /// Factor of the exponents by which the fitted law is steepened around end-diastole.
    pub steepened_by: Option<f64>,
}

/// Result of step 0.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundState {
    /// End-diastole of the whole mesh on rank 0, of the rank's own nodes elsewhere.
    pub end_diastole: EndDiastole,
    /// The wall with the fitted passive law.
    pub wall: WallParameters,
    /// Slope of the fit.
    pub slope: Option<Slope>,
    /// Cavity volume at end-diastole \[mm³\].
    pub volume_mm3: f64,
    /// Cavity volume without load \[mm³\].
    pub unloaded_volume_mm3: f64,
    /// Number of Newton iterations, all inflations together.
    pub newton_iterations: usize,
    /// Number of iterations of linear solvers, including those of failed equilibria.
    pub krylov_iterations: usize,
    /// Number of passes of the unloading, all together.
    pub passes: usize,
}

impl PassiveJob {
    /// Runs one rank's part of the search. Collective.
    ///
    /// # Errors
    /// [`PassiveStateError`], on all ranks.
    pub fn run(
        &self,
        piece: &Piece<'_>,
        search: &mut Search<'_>,
    ) -> Result<FoundState, PassiveStateError> {
        let mut found = fit(piece, &self.wall, &self.target, self.slope, search)?;
        let slope = found.slope;
        if let Some(factor) = self.steepened_by {
            found = stiffened(piece, &found, factor, search)?;
        }
        let state = &found.state;
        let whole = |values: &[f64]| piece.gathered(3, values).unwrap_or_else(|| values.to_vec());
        let end_diastole = EndDiastole {
            unloaded: whole(state.unloaded().as_flattened())
                .as_chunks()
                .0
                .to_vec(),
            anchor: whole(state.anchor()),
            u: whole(&state.u),
            pressure_kpa: state.pressure_kpa,
        };
        let (volume_mm3, unloaded_volume_mm3) = (state.volume_mm3(), state.unloaded_volume_mm3());
        let (newton_iterations, passes) = (state.newton_iterations, state.passes);
        let wall = found.wall;
        Ok(FoundState {
            end_diastole,
            wall,
            slope,
            volume_mm3,
            unloaded_volume_mm3,
            newton_iterations,
            krylov_iterations: search.work.krylov_iterations,
            passes,
        })
    }

    /// Runs the search on several threads, each with a part of the mesh; on the calling thread if the solver only runs on one
    /// rank ([`super::UnloadingSettings::are_for_ranks`]).
    ///
    /// # Errors
    /// [`PassiveStateError`]; [`PassiveStateError::Rank`] when the system starts no thread.
    pub fn on_threads(
        &self,
        anatomy: &Anatomy,
        search: &mut Search<'_>,
        n_threads: usize,
        threads: ThreadSettings,
    ) -> Result<FoundState, PassiveStateError> {
        if n_threads <= 1 || !search.settings.are_for_ranks(anatomy) {
            return self.run(&Piece::whole(anatomy), search);
        }
        let mut parts = parts_of(anatomy, n_threads)?.into_iter();
        let Some(first) = parts.next() else {
            unreachable!("there is a rank 0")
        };
        // Threads outlive borrowed data and therefore copy their parts.
        let mut others = parts
            .map(|part| (anatomy.part(&part).into_owned(), part))
            .collect::<Vec<_>>()
            .into_iter();
        let settings = search.settings;
        let (comm, crew): (ThreadRank, Crew) = crew(n_threads, threads, |_| {
            let (job, own) = (self.clone(), others.next());
            move |comm: ThreadRank| {
                let Some((anatomy, part)) = own else { return };
                let piece = Piece {
                    anatomy: std::borrow::Cow::Owned(anatomy),
                    part,
                    comm: Arc::new(comm),
                };
                // The error is the same on all ranks, and rank 0 reports it.
                let _ = job.run(&piece, &mut Search::new(settings));
            }
        })
        .map_err(|error| RankFailure {
            rank: 0,
            n_ranks: n_threads,
            reason: error.to_string(),
        })?;
        let piece = Piece::of(anatomy, first, Arc::new(comm));
        // A failed thread unwinds this one and passes on its reason.
        let found = self.run(&piece, search);
        drop(crew);
        found
    }
}
