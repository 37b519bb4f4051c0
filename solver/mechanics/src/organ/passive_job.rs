//! Step 0 on one rank or several: what is looked for, and what all of them find together.

use std::sync::Arc;

use cardiotwin_linalg::parallel::{Crew, RankFailure, ThreadRank, ThreadSettings, crew};

use super::anatomy::Anatomy;
use super::end_diastole::EndDiastole;
use super::passive_fit::{PassiveFit, fit, stiffened};
use super::passive_state::PassiveStateError;
use super::piece::{Piece, parts_of};
use super::search::{Search, Slope};
use super::wall::WallParameters;

/// What step 0 looks for.
#[derive(Debug, Clone, PartialEq)]
pub struct PassiveJob {
    /// The wall, whose law is where the search begins.
    pub wall: WallParameters,
    /// What the law is fitted to.
    pub target: PassiveFit,
    /// The fit's slope, where it is known from another mesh.
    pub slope: Option<Slope>,
    /// Factor of the exponents with which the law is steepened around end-diastole once it is fitted.
    pub steepened_by: Option<f64>,
}

/// What step 0 found.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundState {
    /// End-diastole of the whole mesh, on rank 0; of its own nodes on any other.
    pub end_diastole: EndDiastole,
    /// The wall with the law that was found.
    pub wall: WallParameters,
    /// The fit's slope.
    pub slope: Option<Slope>,
    /// Cavity volume in end-diastole \[mm³\].
    pub volume_mm3: f64,
    /// Cavity volume without load \[mm³\].
    pub unloaded_volume_mm3: f64,
    /// Newton iterations.
    pub newton_iterations: usize,
    /// Passes of the unloading.
    pub passes: usize,
}

impl PassiveJob {
    /// Does a rank's part. Collective.
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
            passes,
        })
    }

    /// The same on several threads, each with a part of the mesh; on the calling one where the search's solver is one rank's
    /// ([`super::UnloadingSettings::are_for_ranks`]).
    ///
    /// # Errors
    /// [`PassiveStateError`]; [`PassiveStateError::Rank`] when the system gives no thread.
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
        // Copies of their parts: threads outlive what is borrowed.
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
                // Rank 0 says what went wrong, on all ranks.
                let _ = job.run(&piece, &mut Search::new(settings));
            }
        })
        .map_err(|error| RankFailure {
            rank: 0,
            n_ranks: n_threads,
            reason: error.to_string(),
        })?;
        let piece = Piece::of(anatomy, first, Arc::new(comm));
        // A thread that fails unwinds this one with its reason.
        let found = self.run(&piece, search);
        drop(crew);
        found
    }
}
