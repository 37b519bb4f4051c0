//! An orifice with flow in one direction: regurgitant valves, a septal defect.

use super::{CirculationError, FlowPath};

/// Flow through an orifice of 1 cm² at 1 mmHg \[mL/s\]: √(2 Δp/ρ) with blood of 1060 kg/m³, 1 mmHg
/// = 133.3 Pa.
pub const ML_PER_S_PER_CM2: f64 = 50.0;
/// Pressure difference below which the flow is laminar, so that its slope at rest is finite
/// \[mmHg\].
const LAMINAR_MMHG: f64 = 1.0;

/// Q = k A √Δp downstream, no flow backward (Gorlin & Gorlin 1951, Am Heart J 41:1, with an
/// effective orifice area A).
///
/// The formula used is `k A Δp / (Δp² + δ²)^¼` with δ = 1 mmHg, which deviates by a relative 3e-5
/// at 100 mmHg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orifice {
    name: &'static str,
    ml_per_s_per_root_mmhg: f64,
}

impl Orifice {
    /// An orifice called `name` with this effective area \[cm²\].
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if the area is negative.
    pub fn new(name: &'static str, area_cm2: f64) -> Result<Self, CirculationError> {
        if !(area_cm2 >= 0.0 && area_cm2.is_finite()) {
            let expected = "zero or more";
            return Err(CirculationError::Parameter {
                component: name,
                name: "orifice area",
                value: area_cm2,
                expected,
            });
        }
        Ok(Self {
            name,
            ml_per_s_per_root_mmhg: ML_PER_S_PER_CM2 * area_cm2,
        })
    }
}

impl FlowPath for Orifice {
    fn name(&self) -> &'static str {
        self.name
    }

    fn flow(&self, difference_mmhg: f64) -> (f64, f64) {
        if difference_mmhg <= 0.0 {
            return (0.0, 0.0);
        }
        let squares = difference_mmhg * difference_mmhg + LAMINAR_MMHG * LAMINAR_MMHG;
        let conductance = self.ml_per_s_per_root_mmhg / squares.sqrt().sqrt();
        let slope = conductance * (1.0 - 0.5 * difference_mmhg * difference_mmhg / squares);
        (conductance * difference_mmhg, slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn constant_is_that_of_bernoulli() {
        let bernoulli_cm_per_s = 100.0 * (2.0 * 133.322 / 1060.0f64).sqrt();
        assert!((ML_PER_S_PER_CM2 / bernoulli_cm_per_s - 1.0).abs() < 0.005);
        let flow = Orifice::new("leak", 0.2).unwrap().flow(100.0).0;
        assert!((flow / (50.0 * 0.2 * 10.0) - 1.0).abs() < 1e-4, "{flow}");
    }

    #[test]
    fn lets_nothing_back_and_refuses_nonsense() {
        assert_eq!(Orifice::new("leak", 0.2).unwrap().flow(-50.0), (0.0, 0.0));
        assert!(Orifice::new("leak", -0.1).is_err());
    }

    proptest! {
        #[test]
        fn slope_is_a_slope(difference in 1e-3..200.0f64) {
            let leak = Orifice::new("leak", 0.3).unwrap();
            let h = 1e-6 * (1.0 + difference);
            let slope = (leak.flow(difference + h).0 - leak.flow(difference - h).0) / (2.0 * h);
            prop_assert!((slope - leak.flow(difference).1).abs() < 1e-5 * (1.0 + slope.abs()));
            prop_assert!(slope > 0.0);
        }
    }
}
