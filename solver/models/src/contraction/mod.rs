//! Active stress of a cardiomyocyte, one model a file.
//!
//! A model is a value with parameters only; the states of many nodes live with the caller, so that a snapshot is a copy of
//! numbers and a step can be tried again. Another cell model is one file that implements [`Contraction`], and one line in
//! [`catalogue`].

mod bestel_clement_sorine;
pub mod catalogue;
mod declaration;
pub mod land2017;
mod reference;
pub mod tanh;
mod tor_ord_land;

pub use declaration::{ContractionModel, ModelParameter};
pub use land2017::{LAMBDA_CAP, Land2017, Land2017Parameters};
pub use reference::StretchReference;
pub use tanh::{Tanh, TanhParameters};

use std::sync::Arc;

use crate::calcium::{Calcium, CalciumError};
use crate::tor_ord::PacingError;

/// One node's time step: what the cell sees while the stretch goes linearly from `lambda_prev` to `lambda`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeStep {
    /// Time since activation at the end of the step \[ms\]; negative before a first activation.
    pub since_activation_ms: f64,
    /// Length of the step \[ms\].
    pub dt_ms: f64,
    /// Calcium at the start of the step \[µM\].
    pub ca_start_um: f64,
    /// Calcium at the end of the step \[µM\].
    pub ca_end_um: f64,
    /// Fibre stretch at the start of the step.
    pub lambda_prev: f64,
    /// Candidate fibre stretch at the end of the step.
    pub lambda: f64,
}

/// Active stress at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ActiveStress {
    /// Active stress along the fibre \[kPa\].
    pub sa_kpa: f64,
    /// Total derivative of the stress with respect to the candidate stretch \[kPa\], including the
    /// answer of the model's states. Newton's method needs it, and it makes a rate-dependent model
    /// stable in a staggered or monolithic step.
    pub dsa_dlambda_kpa: f64,
}

/// The same step for many nodes that share one stretch (the groups of a reduced ventricle).
#[derive(Debug, Clone, Copy)]
pub struct UniformStep<'a> {
    /// Length of the step \[ms\].
    pub dt_ms: f64,
    /// Fibre stretch at the start of the step.
    pub lambda_prev: f64,
    /// Candidate fibre stretch at the end of the step.
    pub lambda: f64,
    /// Time since activation at the end of the step \[ms\], one a node.
    pub since_activation_ms: &'a [f64],
    /// Calcium at the start of the step \[µM\], one a node, empty where [`Contraction::needs_calcium`] is false.
    pub ca_start_um: &'a [f64],
    /// Calcium at the end of the step \[µM\], as above.
    pub ca_end_um: &'a [f64],
}

impl UniformStep<'_> {
    /// The step of node `node_idx`.
    #[must_use]
    pub fn node(&self, node_idx: usize) -> NodeStep {
        NodeStep {
            since_activation_ms: self.since_activation_ms[node_idx],
            dt_ms: self.dt_ms,
            ca_start_um: self.ca_start_um.get(node_idx).copied().unwrap_or(0.0),
            ca_end_um: self.ca_end_um.get(node_idx).copied().unwrap_or(0.0),
            lambda_prev: self.lambda_prev,
            lambda: self.lambda,
        }
    }
}

/// The same step for many nodes, each with a stretch of its own (the integration points of a wall).
#[derive(Debug, Clone, Copy)]
pub struct EachStep<'a> {
    /// Length of the step \[ms\].
    pub dt_ms: f64,
    /// Fibre stretch at the start of the step, one a node.
    pub lambda_prev: &'a [f64],
    /// Candidate fibre stretch at the end of the step, one a node.
    pub lambda: &'a [f64],
    /// Time since activation at the end of the step \[ms\], one a node.
    pub since_activation_ms: &'a [f64],
    /// Calcium at the start of the step \[µM\], one a node, empty where [`Contraction::needs_calcium`] is false.
    pub ca_start_um: &'a [f64],
    /// Calcium at the end of the step \[µM\], as above.
    pub ca_end_um: &'a [f64],
}

impl EachStep<'_> {
    /// The step of node `node_idx`.
    #[must_use]
    pub fn node(&self, node_idx: usize) -> NodeStep {
        UniformStep {
            dt_ms: self.dt_ms,
            lambda_prev: self.lambda_prev[node_idx],
            lambda: self.lambda[node_idx],
            since_activation_ms: self.since_activation_ms,
            ca_start_um: self.ca_start_um,
            ca_end_um: self.ca_end_um,
        }
        .node(node_idx)
    }
}

/// Node after node, up to the first one that fails.
fn in_turn<C: Contraction + ?Sized>(
    model: &C,
    node: impl Fn(usize) -> NodeStep,
    states: &[f64],
    trials: &mut [f64],
    stress: &mut [ActiveStress],
) -> Result<(), ContractionError> {
    let n = model.n_states();
    for (node_idx, out) in stress.iter_mut().enumerate() {
        let range = node_idx * n..(node_idx + 1) * n;
        *out = model.try_step(&node(node_idx), &states[range.clone()], &mut trials[range])?;
    }
    Ok(())
}

/// The periodic beat of a model's own cell.
#[derive(Debug, Clone)]
pub struct OwnCell {
    /// Calcium from activation on.
    pub calcium: Arc<dyn Calcium>,
    /// States of contraction at activation.
    pub start: Vec<f64>,
}

/// A model of active stress.
pub trait Contraction: std::fmt::Debug + Send + Sync {
    /// Number of state variables of one node.
    fn n_states(&self) -> usize;

    /// Whether the model is driven by calcium; otherwise by the time since activation alone.
    fn needs_calcium(&self) -> bool;

    /// Fills `state` (length [`Self::n_states`]) with the resting state.
    fn rest(&self, state: &mut [f64]);

    /// The periodic beat of the model's own cell; `None` for a model that brings no calcium.
    ///
    /// - `cycle_length_ms`: of the patient
    /// - `end_diastolic_stretch`: at which the cell is held, from the model's reference length
    ///
    /// # Errors
    /// [`ContractionError::Pacing`] or [`ContractionError::Calcium`] for a cell that has no such beat.
    fn own_cell(
        &self,
        _cycle_length_ms: f64,
        _end_diastolic_stretch: f64,
    ) -> Result<Option<OwnCell>, ContractionError> {
        Ok(None)
    }

    /// Factor of the active stress that depends on the stretch alone, with its slope: what scales an activation that an
    /// effect prolongs. One where the model has no such factor.
    fn length_factor(&self, _lambda: f64) -> (f64, f64) {
        (1.0, 0.0)
    }

    /// Tries one node's step: from `state` at its start to `trial` at its end (both of length [`Self::n_states`]).
    /// `state` is not touched, so that the step can be tried again with another stretch.
    ///
    /// # Errors
    /// [`ContractionError`] when the step's input or the result is outside the model; never a panic or a NaN.
    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError>;

    /// Tries the step of many nodes with one stretch; states are node after node, `stress` one a node.
    ///
    /// # Errors
    /// As [`Self::try_step`], for the first node that fails.
    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        in_turn(self, |idx| step.node(idx), states, trials, stress)
    }

    /// As [`Self::try_step_uniform`], for nodes with a stretch of their own.
    ///
    /// # Errors
    /// As [`Self::try_step`], for the first node that fails.
    fn try_step_each(
        &self,
        step: &EachStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        in_turn(self, |idx| step.node(idx), states, trials, stress)
    }
}

/// Reasons why a contraction model refused its parameters or a step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ContractionError {
    /// The catalogue has no model of this name.
    #[error("unknown contraction model `{found}`, expected one of {expected}")]
    UnknownModel {
        /// Name that was asked for.
        found: String,
        /// Names in the catalogue.
        expected: String,
    },
    /// The model has no parameter of this name.
    #[error("contraction model {model} has no parameter `{found}`, expected one of {expected}")]
    UnknownParameter {
        /// Name of the model.
        model: &'static str,
        /// Name that was asked for.
        found: String,
        /// Names of the model's parameters.
        expected: String,
    },
    /// A parameter is outside what the equations allow.
    #[error("parameter {name} = {value} must be {expected}")]
    Parameter {
        /// Name of the parameter as in the paper.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
    /// k_WU = k_UW (1/r_W − 1) − k_WS is negative: a rate that creates what it should consume.
    #[error(
        "k_WU = {k_wu_per_ms} /ms is negative (k_UW = {k_uw_per_ms}, r_W = {r_w}, k_WS = {k_ws_per_ms})"
    )]
    NegativeKwu {
        /// Rate k_WU from weakly bound to unbound \[1/ms\].
        k_wu_per_ms: f64,
        /// Rate k_UW from unbound to weakly bound \[1/ms\].
        k_uw_per_ms: f64,
        /// Steady ratio r_W of weakly bound bridges.
        r_w: f64,
        /// Rate k_WS from weakly to strongly bound \[1/ms\].
        k_ws_per_ms: f64,
    },
    /// The stretch is not a positive finite number.
    #[error("fibre stretch {lambda} is not positive")]
    Stretch {
        /// Stretch that was given.
        lambda: f64,
    },
    /// The calcium sensitivity Ca50 is not positive at this stretch.
    #[error("Ca50 = {ca50_um} uM is not positive at fibre stretch {lambda}")]
    Sensitivity {
        /// Ca50 at that stretch \[µM\].
        ca50_um: f64,
        /// Fibre stretch at which the sensitivity is lost.
        lambda: f64,
    },
    /// The model's own cell has no periodic beat.
    #[error(transparent)]
    Pacing(#[from] PacingError),
    /// The calcium of the model's own cell is no transient.
    #[error(transparent)]
    Calcium(#[from] CalciumError),
    /// The step ended in a state that is not finite.
    #[error(
        "the state is not finite {since_activation_ms} ms after activation, at fibre stretch {lambda}"
    )]
    NotFinite {
        /// Time since activation \[ms\].
        since_activation_ms: f64,
        /// Fibre stretch at the end of the step.
        lambda: f64,
    },
}
