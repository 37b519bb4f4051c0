//! The search for a passive state: its settings, progress and bound of work.

use std::ops::ControlFlow;

use cardiotwin_linalg::parallel::Communicator;

use super::anatomy::Anatomy;
use super::farthest::Farthest;
use super::passive_state_error::PassiveStateError;
use super::search_work::SearchWork;
use crate::element::kernel::VolumeChange;
use crate::newton::LinearSolver;
use crate::step::{StepError, StepReport, StepSettings};

/// Largest node counts at which a factorisation beats multigrid: for nodal volume change, to which multigrid is tuned, and for
/// the plain penalty.
const FACTORISED_UP_TO: [usize; 2] = [3000, 20_000];

/// Work after which a law is given up, and the next one tried. Of 39 hearts of 1,000 nodes, the longest search took 341 Newton
/// iterations with all its laws; at 8,000 nodes multigrid takes 60 linear iterations for one of Newton's (03-CoA).
const MOST_OF_A_LAW: SearchWork = SearchWork {
    newton_iterations: 400,
    krylov_iterations: 24_000,
};
/// Work after which a search is given up: thrice that of a law, with less room for linear iterations.
const MOST_WORK: SearchWork = SearchWork {
    newton_iterations: 1200,
    krylov_iterations: 60_000,
};

/// Settings of the search for an unloaded geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnloadingSettings {
    /// Converged once the volume error, relative to the image's volume, is below this.
    pub volume_tolerance: f64,
    /// Converged once every node is this close to its place in the image \[mm\].
    pub distance_tolerance_mm: f64,
    /// Maximum number of passes.
    pub max_passes: usize,
    /// First load step of the first inflation, as a share of the pressure.
    pub first_load: f64,
    /// Smallest load step of an inflation.
    pub smallest_load: f64,
    /// Work after which a law is given up by a fit, which then tries the next one.
    pub most_of_a_law: SearchWork,
    /// Work after which the search is given up. It counts iterations and no seconds: the same heart ends the same way on a busy
    /// machine.
    pub most_work: SearchWork,
    /// Settings of Newton's method.
    pub newton: StepSettings,
}

impl Default for UnloadingSettings {
    fn default() -> Self {
        let newton = StepSettings {
            linear: LinearSolver::Direct,
            // The nodes' error is then a thousandth of the tolerance below. Convergence is linear in the omitted unsymmetric
            // part of the pressure's tangent, which matters in a small soft heart: hence more iterations.
            relative_tolerance: 1e-5,
            least_pressure_kpa: 0.05,
            max_iterations: 40,
            farthest_mm: 3.0,
            largest_growth: 100.0,
            max_halvings: 8,
            mixed_newton: true,
            // Load steps are no steps of a motion: their corrections do not repeat.
            kept_corrections: 0,
            // A factorisation costs as much as about a hundred solves with it.
            keep_until: 25,
            ..StepSettings::default()
        };
        Self {
            volume_tolerance: 1e-3,
            distance_tolerance_mm: 0.02,
            max_passes: 25,
            first_load: 0.25,
            smallest_load: 0.02,
            most_of_a_law: MOST_OF_A_LAW,
            most_work: MOST_WORK,
            newton,
        }
    }
}

impl UnloadingSettings {
    /// Settings with the linear solver that suits an anatomy: multigrid for many linear elements, else a factorisation.
    #[must_use]
    pub fn for_anatomy(anatomy: &Anatomy) -> Self {
        let linear = anatomy.nodes.len() == anatomy.n_vertices;
        let most = FACTORISED_UP_TO[usize::from(anatomy.volume == VolumeChange::Pointwise)];
        if linear && anatomy.nodes.len() > most {
            Self::on_ranks()
        } else {
            Self::default()
        }
    }

    /// Settings with multigrid, the linear solver that runs on several ranks.
    #[must_use]
    pub fn on_ranks() -> Self {
        let mut settings = Self::default();
        settings.newton.linear = LinearSolver::Multigrid;
        // A set-up costs as much as some ten iterations; a solve takes at least forty.
        settings.newton.keep_until = 80;
        settings
    }

    /// Whether several ranks can share the work on an anatomy: factorisations and quadratic elements run on one rank only.
    #[must_use]
    pub fn are_for_ranks(&self, anatomy: &Anatomy) -> bool {
        let linear = anatomy.nodes.len() == anatomy.n_vertices;
        let solver = self.newton.linear;
        linear && (solver == LinearSolver::Multigrid || solver.is_parallel())
    }
}

/// Progress of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress {
    /// Number of passive laws tried.
    pub trials: usize,
    /// Number of passes of the unloading.
    pub passes: usize,
    /// Pressure to which the wall is being inflated \[kPa\].
    pub pressure_kpa: f64,
    /// Work so far.
    pub work: SearchWork,
    /// Residual of the equilibrium that is being solved, relative to its forces; `None` before its first one.
    pub relative_residual: Option<f64>,
}

/// Receives the progress of a search and decides whether it continues.
pub type Watch<'a> = dyn FnMut(&SearchProgress) -> ControlFlow<()> + 'a;

/// A search under way.
pub struct Search<'a> {
    /// Settings of the search.
    pub settings: UnloadingSettings,
    pub(super) watch: Option<&'a mut Watch<'a>>,
    pub(super) trials: usize,
    /// Work so far.
    pub(super) work: SearchWork,
    /// Work before the current law.
    before_law: SearchWork,
    /// Node that the last pass of an unloading missed most.
    pub(super) farthest: Option<Farthest>,
    /// Failure of the last equilibrium that was not found.
    pub(super) failed: Option<StepError>,
}

impl std::fmt::Debug for Search<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Search")
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}

impl<'a> Search<'a> {
    /// A search without a watcher.
    #[must_use]
    pub fn new(settings: UnloadingSettings) -> Self {
        Self {
            settings,
            watch: None,
            trials: 0,
            work: SearchWork::default(),
            before_law: SearchWork::default(),
            farthest: None,
            failed: None,
        }
    }

    /// A search that calls its watcher before each equilibrium and each Newton iteration.
    #[must_use]
    pub fn watched(settings: UnloadingSettings, watch: &'a mut Watch<'a>) -> Self {
        Self {
            watch: Some(watch),
            ..Self::new(settings)
        }
    }
}

/// Place of an equilibrium in a search, for watcher and errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub passes: usize,
    pub pressure_kpa: f64,
}

impl Search<'_> {
    /// Begins with another passive law.
    pub(super) fn begin_law(&mut self) {
        self.trials += 1;
        self.before_law = self.work;
    }

    /// Asks the watcher before an equilibrium; an error ends the search. Collective.
    pub(super) fn go_on(
        &mut self,
        comm: &dyn Communicator,
        place: Place,
    ) -> Result<(), PassiveStateError> {
        self.ask(comm, place, None)
    }

    /// Counts the work since the last call and asks the watcher; an error ends the search. Collective.
    ///
    /// - `counted`: work of this equilibrium that was counted before
    pub(super) fn iterate(
        &mut self,
        comm: &dyn Communicator,
        place: Place,
        report: &StepReport,
        counted: &mut StepReport,
    ) -> Result<(), PassiveStateError> {
        self.count(report, counted);
        self.ask(comm, place, Some(report.relative_residual))
    }

    /// Counts the work since `counted`.
    pub(super) fn count(&mut self, report: &StepReport, counted: &mut StepReport) {
        self.work.newton_iterations += report.iterations - counted.iterations;
        self.work.krylov_iterations += report.krylov_iterations - counted.krylov_iterations;
        *counted = *report;
    }

    fn ask(
        &mut self,
        comm: &dyn Communicator,
        place: Place,
        relative_residual: Option<f64>,
    ) -> Result<(), PassiveStateError> {
        let Place {
            passes,
            pressure_kpa,
        } = place;
        // All ranks count the same work.
        let in_all = self.work.exceeds(self.settings.most_work);
        let of_law = self.work.since(self.before_law);
        // A given law has no successor.
        let next_law = self.trials > 0 && of_law.exceeds(self.settings.most_of_a_law);
        if in_all || next_law {
            return Err(PassiveStateError::TooMuchWork {
                ends_the_search: in_all,
                work: self.work,
                trials: self.trials,
                passes,
                pressure_kpa,
                farthest: self.farthest.map(Box::new),
                source: self.failed.clone().map(Box::new),
            });
        }
        let progress = SearchProgress {
            trials: self.trials,
            passes,
            pressure_kpa,
            work: self.work,
            relative_residual,
        };
        let stop = self
            .watch
            .as_mut()
            .is_some_and(|watch| watch(&progress).is_break());
        // Rank 0 has the watcher and decides for all ranks.
        let mut word = [f64::from(u8::from(stop))];
        comm.broadcast(&mut word);
        if word[0] == 0.0 {
            Ok(())
        } else {
            Err(PassiveStateError::Stopped)
        }
    }
}
