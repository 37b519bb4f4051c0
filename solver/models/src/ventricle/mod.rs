//! A ventricle that advances together with the circulation.

pub mod activation;
pub mod one_fibre;
pub mod passive_state;

pub use activation::{ActivationGroups, ActivationSpread};
pub use one_fibre::{
    CavityPressureTerm, GroupContraction, OneFibreParameters, OneFibreVentricle,
    steps_before_the_beat,
};
pub use passive_state::{DiastasisPoint, OneFibrePassive, PassiveStateInput, PassiveStateMode};

use crate::circulation::{Circulation, CirculationError};
use crate::contraction::ContractionError;
use cardiotwin_units::{Ml, Mmhg, Ms};
use serde::{Deserialize, Serialize};

/// What a tried step cost and where it would end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriedStep {
    /// Cavity pressure at the end of the step.
    pub pressure: Mmhg,
    /// Cavity volume at its end.
    pub volume: Ml,
    /// Newton iterations.
    pub iterations: usize,
}

/// All states of a ventricle as numbers; `kind` guards against restoring another model's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VentricleSnapshot {
    /// Which implementation wrote it.
    pub kind: String,
    /// Its numbers, in an order of its own.
    pub values: Vec<f64>,
}

/// A left ventricle: reduced or finite-element.
///
/// A step is tried together with the circulation, monolithically: the implementation finds the cavity pressure at the
/// step's end for which its change of volume is what the circulation lets through. Then the driver commits both or rolls
/// both back. Nodes are whatever carries a contraction model (groups of the reduced ventricle, mesh nodes).
pub trait Ventricle {
    /// Time of the last committed step.
    fn time(&self) -> Ms;

    /// Committed cavity volume.
    fn volume(&self) -> Ml;

    /// Committed cavity pressure.
    fn pressure(&self) -> Mmhg;

    /// Tries a step of `dt`. On success both sides hold the same pending trial; on an error neither's committed state has
    /// changed, and the caller rolls back and may try a shorter step.
    ///
    /// # Errors
    /// [`VentricleError`] when the coupled step has no solution.
    fn try_step(
        &mut self,
        circulation: &mut Circulation,
        dt: Ms,
    ) -> Result<TriedStep, VentricleError>;

    /// Accepts the pending trial (the circulation's is committed by the caller); does nothing without one.
    fn commit(&mut self);

    /// Drops the pending trial.
    fn roll_back(&mut self);

    /// Activation time of each node \[ms\] within its beat.
    fn activation_times_ms(&self) -> &[f64];

    /// Weight of each node in medians and means; they sum to one.
    fn node_weights(&self) -> &[f64];

    /// Committed active stress of each node \[kPa\] into `out`.
    fn active_stress_kpa(&self, out: &mut [f64]);

    /// Committed calcium of each node \[µM\] into `out`; NaN-free: zero where the model has none.
    fn calcium_um(&self, out: &mut [f64]);

    /// Committed fibre stretch of each node, from the length that its cell knows, into `out`.
    fn stretch(&self, out: &mut [f64]);

    /// All committed states.
    fn snapshot(&self) -> VentricleSnapshot;

    /// Goes back to a snapshot and drops any pending trial.
    ///
    /// # Errors
    /// [`VentricleError::ForeignSnapshot`] when it was written by another model or size.
    fn restore(&mut self, snapshot: &VentricleSnapshot) -> Result<(), VentricleError>;
}

/// Why a ventricle could not be made or a step not taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VentricleError {
    /// A parameter is outside its range.
    #[error("{name} = {value} must be {expected}")]
    Parameter {
        /// Parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// The passive state has no solution for these volumes and pressures.
    #[error("no passive law through V0 = {v0_ml} mL and ({volume_ml} mL, {pressure_mmhg} mmHg)")]
    PassiveState {
        /// Unloaded volume \[mL\].
        v0_ml: f64,
        /// Volume of the loaded state \[mL\].
        volume_ml: f64,
        /// Its pressure \[mmHg\].
        pressure_mmhg: f64,
    },
    /// The contraction model failed.
    #[error("contraction model at t = {t_ms} ms")]
    Contraction {
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Why.
        source: ContractionError,
    },
    /// The circulation failed.
    #[error("circulation")]
    Circulation(#[from] CirculationError),
    /// The cavity volume of the step was not found.
    #[error(
        "no cavity volume at t = {t_ms} ms with a step of {dt_ms} ms: from {volume_ml:.3} mL at {pressure_mmhg:.3} mmHg, \
         last candidate {candidate_ml:.3} mL, residual {residual_ml:.1e} mL after {iterations} iterations"
    )]
    NoVolume {
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Step length \[ms\].
        dt_ms: f64,
        /// Volume at the start \[mL\].
        volume_ml: f64,
        /// Pressure at the start \[mmHg\].
        pressure_mmhg: f64,
        /// Last candidate \[mL\].
        candidate_ml: f64,
        /// Its residual \[mL\].
        residual_ml: f64,
        /// Iterations made.
        iterations: usize,
    },
    /// The wall's equation of motion has no solution for the step.
    #[error("no step of {dt_ms} ms to t = {t_ms} ms: {reason}")]
    NoMotion {
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Step length \[ms\].
        dt_ms: f64,
        /// Why: Newton's method, an inverted element, a number that is not finite.
        reason: String,
    },
    /// A snapshot belongs to another ventricle.
    #[error(
        "snapshot of {found} with {found_values} values does not fit {expected} with {expected_values}"
    )]
    ForeignSnapshot {
        /// Kind in the snapshot.
        found: String,
        /// Values in it.
        found_values: usize,
        /// Kind here.
        expected: &'static str,
        /// Values here.
        expected_values: usize,
    },
}
