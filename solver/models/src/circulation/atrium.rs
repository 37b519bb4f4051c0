//! A compartment with constant pressure: the left atrium of the base model.

use super::{CirculationError, Compartment, TimeStep};
use cardiotwin_units::Mmhg;

/// Pressure that does not depend on the flow (the paper names no atrial model; SPEC section 4).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantPressure {
    name: &'static str,
    pressure_mmhg: f64,
}

impl ConstantPressure {
    /// A compartment called `name` at `pressure`.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if the pressure is not finite.
    pub fn new(name: &'static str, pressure: Mmhg) -> Result<Self, CirculationError> {
        if !pressure.0.is_finite() {
            return Err(CirculationError::Parameter {
                component: name,
                name: "pressure",
                value: pressure.0,
                expected: "finite",
            });
        }
        Ok(Self {
            name,
            pressure_mmhg: pressure.0,
        })
    }
}

impl Compartment for ConstantPressure {
    fn name(&self) -> &'static str {
        self.name
    }

    fn n_states(&self) -> usize {
        0
    }

    fn start(&self, _state: &mut [f64]) {}

    fn pressure(&self, _state: &[f64], _inflow_ml_per_s: f64, _step: TimeStep) -> (f64, f64) {
        (self.pressure_mmhg, 0.0)
    }

    fn advance(&self, _state: &mut [f64], _inflow_ml_per_s: f64, _step: TimeStep) {}

    fn is_source(&self) -> bool {
        true
    }
}
