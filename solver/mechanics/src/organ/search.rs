//! The search for a passive state: its settings and progress.

use std::ops::ControlFlow;

use super::anatomy::Anatomy;
use crate::element::kernel::VolumeChange;
use crate::newton::LinearSolver;
use crate::step::StepSettings;

/// Largest node counts at which a factorisation beats multigrid: for nodal volume change, to which multigrid is tuned, and for
/// the plain penalty.
const FACTORISED_UP_TO: [usize; 2] = [3000, 20_000];

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
            foresee_pressures: true,
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
    /// Number of Newton iterations.
    pub newton_iterations: usize,
    /// Pressure to which the wall is being inflated \[kPa\].
    pub pressure_kpa: f64,
}

/// Receives the progress of a search and decides whether it continues.
pub type Watch<'a> = dyn FnMut(&SearchProgress) -> ControlFlow<()> + 'a;

/// A search under way.
pub struct Search<'a> {
    /// Settings of the search.
    pub settings: UnloadingSettings,
    pub(super) watch: Option<&'a mut Watch<'a>>,
    pub(super) trials: usize,
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
        }
    }

    /// A search that calls its watcher before each equilibrium.
    #[must_use]
    pub fn watched(settings: UnloadingSettings, watch: &'a mut Watch<'a>) -> Self {
        Self {
            settings,
            watch: Some(watch),
            trials: 0,
        }
    }
}
