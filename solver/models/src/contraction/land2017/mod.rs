//! Land 2017 active stress of a human cardiomyocyte (Jung 2022, eqs. A4-A14), driven by calcium, stretch and its rate.
//!
//! [`equations`] hold the model once, over any number; `slopes` and `step` are derived from them by hand and tested against
//! them.

mod cell;
pub mod equations;
mod parameters;
mod slopes;
mod step;

use super::{ActiveStress, Contraction, ContractionError, EachStep, NodeStep, UniformStep};

pub use cell::{Land2017, STATES};
pub use equations::{Equations, LAMBDA_CAP};
pub use parameters::Land2017Parameters;

impl Contraction for Land2017 {
    fn n_states(&self) -> usize {
        STATES.len()
    }

    fn needs_calcium(&self) -> bool {
        true
    }

    fn rest(&self, state: &mut [f64]) {
        // Almost no calcium bound: fully blocked, no bridges.
        state.copy_from_slice(&[1e-3, 1.0, 0.0, 0.0, 0.0, 0.0]);
    }

    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        step::try_step(self, step, state, trial)
    }

    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        step::try_step_uniform(self, step, states, trials, stress)
    }

    fn try_step_each(
        &self,
        step: &EachStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        step::try_step_each(self, step, states, trials, stress)
    }
}
