//! Valves as diodes (Jung 2022, section 2.2.3) with a small forward and a large backward
//! resistance.

use super::{CirculationError, FlowPath, positive};
use cardiotwin_units::MmhgSPerMl;

/// Q = Δp/R_f forward and Δp/R_b backward; continuous and monotone, with a kink at Δp = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiodeValve {
    name: &'static str,
    forward_per_resistance: f64,
    backward_per_resistance: f64,
}

impl DiodeValve {
    /// A valve called `name` with its two resistances.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if a resistance is not positive and finite.
    pub fn new(
        name: &'static str,
        forward: MmhgSPerMl,
        backward: MmhgSPerMl,
    ) -> Result<Self, CirculationError> {
        positive(name, "forward resistance", forward.0)?;
        positive(name, "backward resistance", backward.0)?;
        Ok(Self {
            name,
            forward_per_resistance: 1.0 / forward.0,
            backward_per_resistance: 1.0 / backward.0,
        })
    }
}

impl FlowPath for DiodeValve {
    fn name(&self) -> &'static str {
        self.name
    }

    #[inline]
    fn flow(&self, difference_mmhg: f64) -> (f64, f64) {
        let conductance = if difference_mmhg > 0.0 {
            self.forward_per_resistance
        } else {
            self.backward_per_resistance
        };
        (difference_mmhg * conductance, conductance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaks_a_tenth_of_a_millilitre_per_second_at_100_mmhg() {
        let valve = DiodeValve::new("v", MmhgSPerMl(0.01), MmhgSPerMl(1000.0)).unwrap();
        assert!((valve.flow(-100.0).0 + 0.1).abs() < 1e-15);
        assert!((valve.flow(2.0).0 - 200.0).abs() < 1e-12);
        assert_eq!(valve.flow(0.0).0, 0.0);
        assert!(valve.is_open(1e-9) && !valve.is_open(-1e-9));
    }

    #[test]
    fn refuses_a_resistance_of_zero() {
        let error =
            DiodeValve::new("aortic_valve", MmhgSPerMl(0.0), MmhgSPerMl(1000.0)).unwrap_err();
        assert!(matches!(
            error,
            CirculationError::Parameter {
                component: "aortic_valve",
                ..
            }
        ));
    }
}
