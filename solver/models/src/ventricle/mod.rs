//! Interface of a ventricle that advances together with the circulation.

pub mod activation;
pub mod group_contraction;
mod law_wall;
pub mod one_fibre;
pub mod organ_law;
pub mod passive_state;
mod recent_inflow;

pub use activation::{ActivationGroups, ActivationSpread};
pub use group_contraction::{GroupContraction, NodeContraction};
pub use one_fibre::{
    CavityPressureTerm, OneFibreParameters, OneFibreVentricle, steps_before_the_beat,
};
pub use organ_law::{OrganLaw, end_diastolic_stretch};
pub use passive_state::{
    DiastasisPoint, OneFibrePassive, PassiveLaw, PassiveStateInput, PassiveStateMode,
};

use crate::circulation::{Circulation, CirculationError};
use crate::contraction::ContractionError;
use cardiotwin_units::{Ml, Mmhg, Ms};
use serde::{Deserialize, Serialize};

/// Result of a tried step, with its cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriedStep {
    /// Cavity pressure at the end of the step.
    pub pressure: Mmhg,
    /// Cavity volume at the end of the step.
    pub volume: Ml,
    /// Number of Newton iterations.
    pub iterations: usize,
}

/// All states of a ventricle as numbers. `kind` prevents another model from restoring them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VentricleSnapshot {
    /// Implementation that wrote the snapshot.
    pub kind: String,
    /// Values in the order of that implementation.
    pub values: Vec<f64>,
}

/// A left ventricle: reduced or finite-element.
///
/// A step is tried together with the circulation, monolithically. The implementation finds the
/// cavity pressure at the end of the step at which the change of volume equals the net inflow. The
/// driver then commits both or rolls both back. Nodes are the carriers of contraction models:
/// groups of the reduced ventricle, or mesh nodes.
pub trait Ventricle {
    /// Time of the last committed step.
    fn time(&self) -> Ms;

    /// Cavity volume at the end of the last committed step.
    fn volume(&self) -> Ml;

    /// Cavity pressure at the end of the last committed step.
    fn pressure(&self) -> Mmhg;

    /// Tries a step of `dt`. On success, ventricle and circulation hold the same pending trial. On
    /// an error, neither committed state has changed; the caller rolls back and may try a shorter
    /// step.
    ///
    /// # Errors
    /// [`VentricleError`] if the coupled step has no solution.
    fn try_step(
        &mut self,
        circulation: &mut Circulation,
        dt: Ms,
    ) -> Result<TriedStep, VentricleError>;

    /// Accepts the pending trial, if there is one. The caller commits the circulation's trial.
    fn commit(&mut self);

    /// Drops the pending trial.
    fn roll_back(&mut self);

    /// Activation time of each node within its beat \[ms\].
    fn activation_times_ms(&self) -> &[f64];

    /// Weight of each node in medians and means; they sum to one.
    fn node_weights(&self) -> &[f64];

    /// Writes the committed active stress of each node \[kPa\] to `out`.
    fn active_stress_kpa(&self, out: &mut [f64]);

    /// Writes the committed calcium of each node \[µM\] to `out`: zero, never NaN, if the model has
    /// none.
    fn calcium_um(&self, out: &mut [f64]);

    /// Writes the committed fibre stretch of each node to `out`, relative to the reference length
    /// of its cell.
    fn stretch(&self, out: &mut [f64]);

    /// Copy of all committed states.
    fn snapshot(&self) -> VentricleSnapshot;

    /// Restores a snapshot and drops any pending trial.
    ///
    /// # Errors
    /// [`VentricleError::ForeignSnapshot`] if a ventricle of another model or size wrote the
    /// snapshot.
    fn restore(&mut self, snapshot: &VentricleSnapshot) -> Result<(), VentricleError>;
}

/// Reasons why a ventricle could not be created or a step not taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VentricleError {
    /// A parameter is outside its range.
    #[error("{name} = {value} must be {expected}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
    /// No passive law fits these volumes and pressures.
    #[error(
        "no passive law passes through V0 = {v0_ml} mL and ({volume_ml} mL, {pressure_mmhg} mmHg)"
    )]
    PassiveState {
        /// Unloaded volume V0 \[mL\].
        v0_ml: f64,
        /// Volume of the loaded state \[mL\].
        volume_ml: f64,
        /// Pressure of the loaded state \[mmHg\].
        pressure_mmhg: f64,
    },
    /// The contraction model failed.
    #[error("the contraction model failed at t = {t_ms} ms")]
    Contraction {
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Cause of the failure.
        source: ContractionError,
    },
    /// The circulation has no solution for the step.
    #[error("the circulation failed")]
    Circulation(#[from] CirculationError),
    /// No cavity volume was found for the step.
    #[error(
        "no cavity volume found at t = {t_ms} ms with a step of {dt_ms} ms: start {volume_ml:.3} mL at \
         {pressure_mmhg:.3} mmHg, last candidate {candidate_ml:.3} mL, residual {residual_ml:.1e} mL after \
         {iterations} iterations"
    )]
    NoVolume {
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Length of the step \[ms\].
        dt_ms: f64,
        /// Volume at the start \[mL\].
        volume_ml: f64,
        /// Pressure at the start \[mmHg\].
        pressure_mmhg: f64,
        /// Last candidate volume \[mL\].
        candidate_ml: f64,
        /// Residual of the last candidate \[mL\].
        residual_ml: f64,
        /// Number of iterations that were made.
        iterations: usize,
    },
    /// The wall's equation of motion has no solution for the step.
    #[error("no solution for the step of {dt_ms} ms to t = {t_ms} ms: {reason}")]
    NoMotion {
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Length of the step \[ms\].
        dt_ms: f64,
        /// Cause: Newton's method, an inverted element, or a value that is not finite.
        reason: String,
    },
    /// A snapshot belongs to another ventricle.
    #[error(
        "the snapshot of {found} with {found_values} values does not fit {expected} with {expected_values} values"
    )]
    ForeignSnapshot {
        /// Kind of ventricle in the snapshot.
        found: String,
        /// Number of values in the snapshot.
        found_values: usize,
        /// Kind of this ventricle.
        expected: &'static str,
        /// Number of values of this ventricle.
        expected_values: usize,
    },
}
