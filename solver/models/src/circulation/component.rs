//! Components of a circulation: compartments with a pressure and paths with a flow.

/// A time step of a component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeStep {
    /// Time at the end of the step \[ms\], from the start of the first beat.
    pub end_ms: f64,
    /// Length of the step \[ms\].
    pub dt_ms: f64,
}

/// A volume with a pressure, filled and emptied by flow paths.
pub trait Compartment: std::fmt::Debug + Send + Sync {
    /// Name in outputs and messages.
    fn name(&self) -> &'static str;

    /// Number of states of the compartment's own equations.
    fn n_states(&self) -> usize;

    /// Writes the initial state to `state`.
    fn start(&self, state: &mut [f64]);

    /// Prepares a step of this length before it is evaluated; a component may store values that
    /// depend only on the step.
    fn prepare(&mut self, _step: TimeStep) {}

    /// Pressure at the end of a step with constant inflow \[mL/s\], and its derivative with respect
    /// to that inflow, which must not be negative: `(mmHg, mmHg·s/mL)`. The trapezoidal rule is not
    /// allowed, because the cavity constraint holds at the end of the step.
    fn pressure(&self, state: &[f64], inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64);

    /// Resistance through which the inflow reaches the states \[mmHg·s/mL\]: the derivative of [`Self::pressure`] for a step of
    /// no length.
    fn series_resistance(&self) -> f64 {
        0.0
    }

    /// Advances the state over an accepted step.
    fn advance(&self, state: &mut [f64], inflow_ml_per_s: f64, step: TimeStep);

    /// Volume of blood in a state \[mL\], of a compartment that holds all that flowed in; `None` of a
    /// source or of a load that drains to a place outside the circuit.
    fn volume_ml(&self, _state: &[f64]) -> Option<f64> {
        None
    }

    /// Whether the pressure is independent of the inflow, so that no equation needs to be solved.
    fn is_source(&self) -> bool {
        false
    }
}

/// A connection through which blood flows from one place to another.
pub trait FlowPath: std::fmt::Debug + Send + Sync {
    /// Name in outputs and messages.
    fn name(&self) -> &'static str;

    /// Gives the blood in the path an inertance \[mmHg·s²/mL\]. A path without inertia ignores it.
    fn set_inertance(&mut self, _inertance: f64) {}

    /// Prepares a step of this length, before which the path had this flow \[mL/s\].
    fn prepare(&mut self, _step: TimeStep, _flow_ml_per_s: f64) {}

    /// Flow \[mL/s\] from upstream to downstream, and its derivative with respect to the pressure
    /// difference, which must not be negative.
    ///
    /// - `difference_mmhg`: upstream minus downstream pressure at the end of the step
    fn flow(&self, difference_mmhg: f64) -> (f64, f64);

    /// Whether the path counts as an open valve at this pressure difference.
    fn is_open(&self, difference_mmhg: f64) -> bool {
        difference_mmhg > 0.0
    }
}

/// Reasons why the circulation could not be assembled or a step not evaluated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CirculationError {
    /// A parameter is outside its range.
    #[error("{component}: {name} = {value} must be {expected}")]
    Parameter {
        /// Name of the component.
        component: &'static str,
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
    /// The pressure of a compartment could not be found.
    #[error(
        "no pressure found for {compartment} at a cavity pressure of {cavity_mmhg} mmHg, {t_ms} ms, step {dt_ms} ms"
    )]
    NoPressure {
        /// Name of the compartment.
        compartment: &'static str,
        /// Candidate cavity pressure \[mmHg\].
        cavity_mmhg: f64,
        /// Time at the end of the step \[ms\].
        t_ms: f64,
        /// Length of the step \[ms\].
        dt_ms: f64,
    },
    /// A snapshot belongs to another circulation.
    #[error(
        "the snapshot has {found} states and {found_paths} paths, but this circulation has {expected} and \
         {expected_paths}"
    )]
    ForeignSnapshot {
        /// Number of states in the snapshot.
        found: usize,
        /// Number of paths in the snapshot.
        found_paths: usize,
        /// Number of states of this circulation.
        expected: usize,
        /// Number of paths of this circulation.
        expected_paths: usize,
    },
    /// Contents belong to another loop, or the circuit is open.
    #[error(
        "contents of {} are not those of this circulation, which holds {}",
        found.join(", "),
        expected.join(", ")
    )]
    ForeignContents {
        /// Names of the given compartments and paths.
        found: Vec<String>,
        /// Names of those of this circulation.
        expected: Vec<String>,
    },
}

/// Checks that a parameter is positive and finite.
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
