//! A fitted parameter: its interval, its prior and its coordinate in the optimiser.

/// One parameter. The optimiser works in z, the distance of the parameter (or its logarithm) from
/// the prior mean in prior standard deviations, so that all steps and priors have one scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name with unit, such as `pressure_mmhg`.
    pub name: String,
    /// Smallest value in the search, in the parameter's unit.
    pub lower: f64,
    /// Largest value in the search, in the parameter's unit.
    pub upper: f64,
    /// Mean of the prior.
    pub mean: f64,
    /// Standard deviation of the prior, or of the logarithm if `log` is set.
    pub sd: f64,
    /// Whether the logarithm of the parameter has the normal prior.
    pub log: bool,
}

impl Parameter {
    /// Converts a value to z.
    #[must_use]
    pub fn z(&self, value: f64) -> f64 {
        if self.log {
            (value / self.mean).ln() / self.sd
        } else {
            (value - self.mean) / self.sd
        }
    }

    /// Converts z to a value, clamped to the interval.
    #[must_use]
    pub fn value(&self, z: f64) -> f64 {
        let value = if self.log {
            self.mean * (z * self.sd).exp()
        } else {
            self.mean + z * self.sd
        };
        value.clamp(self.lower, self.upper)
    }

    /// z of the two ends of the interval.
    #[must_use]
    pub fn z_bounds(&self) -> (f64, f64) {
        (self.z(self.lower), self.z(self.upper))
    }

    /// Derivative of the value with respect to z.
    #[must_use]
    pub fn slope(&self, z: f64) -> f64 {
        if self.log {
            self.value(z) * self.sd
        } else {
            self.sd
        }
    }
}
