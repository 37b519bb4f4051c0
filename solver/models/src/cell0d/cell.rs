//! The 0D cell's parameters, beats and errors.

use super::passive::{LandPassive, LandPassiveParameters};
use super::system::{LAMBDA, System, Vector};
use crate::calcium::{Calcium, CalciumError, Rice2008, Rice2008Parameters, SampledCalcium};
use crate::contraction::{ContractionError, Land2017, Land2017Parameters};
use crate::roots::RootError;
use cardiotwin_units::{Kpa, Ms, Stretch};
use cardiotwin_vector_math::Number;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Source of the cell's calcium: step 2's `calcium = "rice"` or `"median-trace"`.
#[derive(Debug, Clone, PartialEq)]
pub enum CalciumInput {
    /// Rice's transient with these parameters.
    Rice(Rice2008Parameters),
    /// A fixed sampled transient.
    Sampled(Arc<SampledCalcium>),
}

/// All parameters of one 0D cell beat.
#[derive(Debug, Clone, PartialEq)]
pub struct CellParameters {
    /// Parameters of the active stress.
    pub land: Land2017Parameters,
    /// Parameters of the passive stress.
    pub passive: LandPassiveParameters,
    /// Calcium transient that drives the cell.
    pub calcium: CalciumInput,
    /// Cycle length at which the cell is paced \[ms\].
    pub cycle_length_ms: f64,
    /// Initial stretch λ0, to which the passive strain is relative.
    pub lambda0: f64,
}

impl Default for CellParameters {
    /// Tables A2 to A4 with a cycle of 1000 ms and λ0 = 1.
    fn default() -> Self {
        Self {
            land: Land2017Parameters::default(),
            passive: LandPassiveParameters::default(),
            calcium: CalciumInput::Rice(Rice2008Parameters::default()),
            cycle_length_ms: 1000.0,
            lambda0: 1.0,
        }
    }
}

impl CellParameters {
    /// Checks the parameters and prepares the cell.
    ///
    /// # Errors
    /// As [`Cell0d::new`].
    pub fn build(&self) -> Result<Cell0d, CellError> {
        Cell0d::new(self)
    }
}

/// Accuracy and limits of the periodic solution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CellSolverSettings {
    /// Relative local error per step; the default keeps stress within 0.005 kPa and stretch within 2e-5 of the reference.
    pub tolerance: f64,
    /// Largest remaining change of the state from beat to beat at which the beat counts as periodic.
    pub periodic_tolerance: f64,
    /// Beats after which the search for the periodic state is given up.
    pub max_beats: usize,
    /// Steps after which a beat is given up.
    pub max_steps_per_beat: usize,
}

impl Default for CellSolverSettings {
    fn default() -> Self {
        Self {
            tolerance: 5e-6,
            periodic_tolerance: 1e-6,
            max_beats: 60,
            max_steps_per_beat: 20_000,
        }
    }
}

/// State of the cell with the distortions themselves.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CellState {
    /// States of Land 2017, order as [`crate::contraction::land2017::STATES`].
    pub land: [f64; 6],
    /// Strain C_V of the passive dashpot.
    pub c_v: f64,
    /// Fibre stretch λ, dimensionless.
    pub lambda: f64,
}

/// One beat in the periodic steady state, sampled every millisecond from 0 to the cycle length inclusive (the last sample
/// lies at the cycle length, closer than 1 ms to its neighbour where that is no integer).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CellBeat {
    /// Times of the samples \[ms\].
    pub time_ms: Vec<f64>,
    /// Active stress at each time \[kPa\].
    pub sa_kpa: Vec<f64>,
    /// Calcium at each time \[µM\].
    pub ca_um: Vec<f64>,
    /// Fibre stretch at each time, dimensionless.
    pub lambda: Vec<f64>,
    /// State at the start of the beat.
    pub start_state: CellState,
    /// State at the end of the beat, equal to the start up to `remaining_change`.
    pub end_state: CellState,
    /// Number of beats that were run, the recorded one included.
    pub beats_to_periodic: usize,
    /// Largest change of any state that further beats would still bring, from the change over the recorded beat and the
    /// observed contraction of the changes.
    pub remaining_change: f64,
    /// Number of accepted steps in the recorded beat.
    pub n_steps: usize,
    /// Lengths of these steps \[ms\], kept to repeat them in the next beat.
    pub(super) steps_ms: Vec<f64>,
}

/// Reasons why a cell beat could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CellError {
    /// A parameter of the cell is outside its range.
    #[error("parameter {name} = {value} must be positive and finite")]
    Parameter {
        /// Name of the parameter as in the paper.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
    },
    /// The contraction model refused its parameters or a state.
    #[error("the contraction model failed")]
    Contraction(#[from] ContractionError),
    /// The calcium transient was refused.
    #[error("invalid calcium transient")]
    Calcium(#[from] CalciumError),
    /// The force balance has no root where it must have one.
    #[error("no {what} found")]
    Balance {
        /// Root that was sought.
        what: &'static str,
        /// Failure of the root search.
        source: RootError,
    },
    /// The step length fell to nothing, or the steps ran out.
    #[error(
        "the integration stopped at t = {t_ms} ms of beat {beat} after {n_steps} steps, the last one of {step_ms} ms"
    )]
    Stuck {
        /// Time in the beat \[ms\].
        t_ms: f64,
        /// Number of the beat, from 1.
        beat: usize,
        /// Number of steps tried in this beat.
        n_steps: usize,
        /// Length of the last step \[ms\].
        step_ms: f64,
    },
    /// The beats did not become periodic.
    #[error("not periodic after {beats} beats: the state still changes by {change} per beat")]
    NotPeriodic {
        /// Number of beats that were run.
        beats: usize,
        /// Largest change of a state over the last beat.
        change: f64,
    },
}

/// A checked 0D cell, ready to be solved any number of times.
#[derive(Debug, Clone)]
pub struct Cell0d {
    pub(super) land: Land2017,
    passive: LandPassive,
    calcium: Source,
    pub(super) cycle_length_ms: f64,
    lambda0: f64,
}

#[derive(Debug, Clone)]
enum Source {
    Rice(Rice2008),
    Sampled(Arc<SampledCalcium>),
}

impl Cell0d {
    /// Checks the parameters and prepares the cell.
    ///
    /// # Errors
    /// [`CellError::Parameter`], [`CellError::Contraction`] or [`CellError::Calcium`] for parameters outside the model.
    pub fn new(parameters: &CellParameters) -> Result<Self, CellError> {
        let own = [
            ("cycle length", parameters.cycle_length_ms),
            ("lambda0", parameters.lambda0),
        ];
        let bad = own
            .into_iter()
            .find(|(_, value)| !(*value > 0.0 && value.is_finite()));
        let passive = parameters.passive.first_outside();
        let passive = passive.map(|(parameter, value)| (parameter.symbol, value));
        if let Some((name, value)) = bad.or(passive) {
            return Err(CellError::Parameter { name, value });
        }
        let calcium = match &parameters.calcium {
            CalciumInput::Rice(rice) => Source::Rice(Rice2008::new(*rice)?),
            CalciumInput::Sampled(trace) => Source::Sampled(Arc::clone(trace)),
        };
        Ok(Self {
            land: Land2017::new(parameters.land)?,
            passive: LandPassive::new(&parameters.passive),
            calcium,
            cycle_length_ms: parameters.cycle_length_ms,
            lambda0: parameters.lambda0,
        })
    }

    /// Cycle length at which the cell is paced.
    #[must_use]
    pub fn cycle_length(&self) -> Ms {
        Ms(self.cycle_length_ms)
    }

    /// Calcium transient that drives the cell.
    #[must_use]
    pub fn calcium(&self) -> &dyn Calcium {
        match &self.calcium {
            Source::Rice(rice) => rice,
            Source::Sampled(trace) => trace.as_ref(),
        }
    }

    /// The same transient, to be shared with an organ.
    #[must_use]
    pub fn shared_calcium(&self) -> Arc<dyn Calcium> {
        match &self.calcium {
            Source::Rice(rice) => Arc::new(*rice),
            Source::Sampled(trace) => Arc::clone(trace) as Arc<dyn Calcium>,
        }
    }

    /// Rice's transient; `None` for a sampled one.
    #[must_use]
    pub fn rice(&self) -> Option<&Rice2008> {
        match &self.calcium {
            Source::Rice(rice) => Some(rice),
            Source::Sampled(_) => None,
        }
    }

    /// Model of the active stress.
    #[must_use]
    pub fn land(&self) -> &Land2017 {
        &self.land
    }

    /// The cell's equations over any number: rates of CaTRPN, B, W, S, z_W = ζ_W − A λ, z_S = ζ_S − A λ and C_V \[1/ms\], then
    /// Sa + S_p \[kPa\], which the stretch λ, the last entry of `y`, makes zero.
    ///
    /// - `ca_um`: calcium \[µM\]; `y`: the seven states and the stretch
    #[must_use]
    pub fn equations<T: Number>(&self, ca_um: T, y: &[T; 8]) -> [T; 8] {
        self.system().equations(ca_um, y)
    }

    pub(crate) fn system(&self) -> System<'_> {
        System {
            land: &self.land,
            passive: &self.passive,
            calcium: self.calcium(),
            lambda0: self.lambda0,
        }
    }
}

impl CellState {
    /// Active stress of this state \[kPa\].
    #[must_use]
    pub fn active_stress(&self, cell: &Cell0d) -> Kpa {
        cell.land.active_stress(&self.land, Stretch(self.lambda))
    }
}

/// Public state of an unknown vector.
pub(super) fn to_state(land: &Land2017, y: &Vector) -> CellState {
    let lambda = y[LAMBDA];
    let zeta = land.k.a * lambda;
    CellState {
        land: [y[0], y[1], y[2], y[3], y[4] + zeta, y[5] + zeta],
        c_v: y[6],
        lambda,
    }
}
