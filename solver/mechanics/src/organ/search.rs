//! How the search for a passive state goes, who watches it, and what it finds.

use std::ops::ControlFlow;

use super::anatomy::Anatomy;
use super::passive_state::{PassiveState, PassiveStateError};
use super::wall::WallParameters;
use crate::element::kernel::VolumeChange;
use crate::newton::LinearSolver;
use crate::step::StepSettings;

/// Nodes up to which a factorisation is faster than multigrid, which is made for nodal volume change; and up to which it serves
/// the plain penalty better.
const FACTORISED_UP_TO: [usize; 2] = [3000, 20_000];

/// Settings of the search for an unloaded geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnloadingSettings {
    /// Volume error over the image's volume at which it has converged.
    pub volume_tolerance: f64,
    /// Largest distance of a node from its place in the image at which it has converged \[mm\].
    pub distance_tolerance_mm: f64,
    /// Most passes.
    pub max_passes: usize,
    /// First step of the first inflation, a share of the pressure.
    pub first_load: f64,
    /// Smallest step of an inflation.
    pub smallest_load: f64,
    /// Newton.
    pub newton: StepSettings,
}

impl Default for UnloadingSettings {
    fn default() -> Self {
        let newton = StepSettings {
            linear: LinearSolver::Direct,
            // Places nodes to a thousandth of the tolerance below. Newton's method is linear in the unsymmetric part of the
            // pressure's tangent, which counts in a small soft heart: more iterations.
            relative_tolerance: 1e-5,
            least_pressure_kpa: 0.05,
            max_iterations: 40,
            farthest_mm: 3.0,
            largest_growth: 100.0,
            max_halvings: 8,
            foresee_pressures: true,
            // A factorisation costs as much as a hundred solves with it.
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
    /// The linear solver that suits an anatomy: multigrid for many linear elements, a factorisation otherwise.
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

    /// The linear solver that several ranks have, multigrid.
    #[must_use]
    pub fn on_ranks() -> Self {
        let mut settings = Self::default();
        settings.newton.linear = LinearSolver::Multigrid;
        // A set-up costs as much as some ten iterations; a solve takes forty or more.
        settings.newton.keep_until = 80;
        settings
    }

    /// Whether several ranks can share the work on an anatomy: a factorisation, and what lies on quadratic elements, is one rank's.
    #[must_use]
    pub fn are_for_ranks(&self, anatomy: &Anatomy) -> bool {
        let linear = anatomy.nodes.len() == anatomy.n_vertices;
        linear
            && matches!(
                self.newton.linear,
                LinearSolver::Multigrid | LinearSolver::BlockJacobi
            )
    }
}

/// How far a search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress {
    /// Passive laws tried.
    pub trials: usize,
    /// Passes of the unloading.
    pub passes: usize,
    /// Newton iterations.
    pub newton_iterations: usize,
    /// Pressure aimed at \[kPa\].
    pub pressure_kpa: f64,
}

/// Told how far a search is, says whether it goes on.
pub type Watch<'a> = dyn FnMut(&SearchProgress) -> ControlFlow<()> + 'a;

/// A search under way.
pub struct Search<'a> {
    /// Settings.
    pub settings: UnloadingSettings,
    watch: Option<&'a mut Watch<'a>>,
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
    /// One that nobody watches.
    #[must_use]
    pub fn new(settings: UnloadingSettings) -> Self {
        Self {
            settings,
            watch: None,
            trials: 0,
        }
    }

    /// One whose watcher is asked before each equilibrium.
    #[must_use]
    pub fn watched(settings: UnloadingSettings, watch: &'a mut Watch<'a>) -> Self {
        Self {
            settings,
            watch: Some(watch),
            trials: 0,
        }
    }

    /// Whether to go on towards an equilibrium at `pressure_kpa`. Collective.
    pub(super) fn go_on(
        &mut self,
        state: &PassiveState,
        pressure_kpa: f64,
    ) -> Result<(), PassiveStateError> {
        let PassiveState {
            passes,
            newton_iterations,
            ..
        } = *state;
        let progress = SearchProgress {
            trials: self.trials,
            passes,
            newton_iterations,
            pressure_kpa,
        };
        let stop = self
            .watch
            .as_mut()
            .is_some_and(|watch| watch(&progress).is_break());
        // Rank 0 is watched, and speaks for all.
        let mut word = [f64::from(u8::from(stop))];
        state.dynamics.comm.broadcast(&mut word);
        if word[0] == 0.0 {
            Ok(())
        } else {
            Err(PassiveStateError::Stopped)
        }
    }
}

/// Derivatives of the logarithms of end-diastolic and unloaded volume (rows) with respect to those of stiffness and factor of
/// the exponents (columns).
pub type Slope = [[f64; 2]; 2];

/// A passive state with the law that was fitted.
#[derive(Debug)]
pub struct Fitted {
    /// In equilibrium at end-diastole.
    pub state: PassiveState,
    /// With the law that was fitted.
    pub wall: WallParameters,
    /// Where it was found: a fit on another mesh of the same heart can begin with it.
    pub slope: Option<Slope>,
}
