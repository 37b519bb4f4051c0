//! What a part of the circulation is: a compartment with a pressure or a path with a flow.

/// A time step as components see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeStep {
    /// Time at the end of the step \[ms\], from the start of the first beat.
    pub end_ms: f64,
    /// Length of the step \[ms\].
    pub dt_ms: f64,
}

/// A place with a pressure, filled and emptied by flow paths.
pub trait Compartment: std::fmt::Debug + Send + Sync {
    /// Name in outputs and messages.
    fn name(&self) -> &'static str;

    /// Number of states.
    fn n_states(&self) -> usize;

    /// Fills `state` with the start of a simulation.
    fn start(&self, state: &mut [f64]);

    /// Called before a step of this length is evaluated: a place to keep what depends on the step alone.
    fn prepare(&mut self, _step: TimeStep) {}

    /// Pressure at the end of a step with a constant inflow \[mL/s\] over it, and its slope with that inflow, which must
    /// not be negative: `(mmHg, mmHg·s/mL)`. Never by the trapezoidal rule: the cavity constraint holds at the step's end.
    fn pressure(&self, state: &[f64], inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64);

    /// Advances the state over an accepted step.
    fn advance(&self, state: &mut [f64], inflow_ml_per_s: f64, step: TimeStep);

    /// Whether the pressure does not depend on the inflow, so that no equation needs solving.
    fn is_source(&self) -> bool {
        false
    }
}

/// A connection that lets blood pass from one place to another.
pub trait FlowPath: std::fmt::Debug + Send + Sync {
    /// Name in outputs and messages.
    fn name(&self) -> &'static str;

    /// Flow \[mL/s\] from upstream to downstream and its slope with the pressure difference, which must not be negative.
    /// - `difference_mmhg`: upstream minus downstream pressure at the end of the step
    fn flow(&self, difference_mmhg: f64) -> (f64, f64);

    /// Whether the path counts as an open valve at this pressure difference.
    fn is_open(&self, difference_mmhg: f64) -> bool {
        difference_mmhg > 0.0
    }
}

/// Why the circulation could not be assembled or a step not evaluated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CirculationError {
    /// A parameter is outside its range.
    #[error("{component}: {name} = {value} must be {expected}")]
    Parameter {
        /// Component.
        component: &'static str,
        /// Parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// The pressure of a compartment could not be found.
    #[error(
        "no pressure of {compartment} at a cavity pressure of {cavity_mmhg} mmHg, {t_ms} ms, step {dt_ms} ms"
    )]
    NoPressure {
        /// Compartment.
        compartment: &'static str,
        /// Candidate cavity pressure \[mmHg\].
        cavity_mmhg: f64,
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Step length \[ms\].
        dt_ms: f64,
    },
    /// A snapshot belongs to another circulation.
    #[error(
        "snapshot holds {found} states and {found_paths} paths, this circulation {expected} and {expected_paths}"
    )]
    ForeignSnapshot {
        /// States in the snapshot.
        found: usize,
        /// Paths in the snapshot.
        found_paths: usize,
        /// States here.
        expected: usize,
        /// Paths here.
        expected_paths: usize,
    },
}

/// Shared check of a parameter.
pub(crate) fn positive(
    component: &'static str,
    name: &'static str,
    value: f64,
) -> Result<(), CirculationError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(CirculationError::Parameter {
            component,
            name,
            value,
            expected: "positive",
        })
    }
}
