//! A fitted parameter: interval, prior and the coordinate that the optimiser sees.

/// One parameter. The optimiser works in z: the parameter (or its logarithm) from the prior's mean in prior standard
/// deviations, so that steps and priors have one scale for all.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name with unit, such as `pressure_mmhg`.
    pub name: String,
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Mean of the prior.
    pub mean: f64,
    /// Standard deviation of the prior: of the logarithm where `log`.
    pub sd: f64,
    /// Whether the prior is normal in the logarithm.
    pub log: bool,
}

impl Parameter {
    /// z of a value.
    #[must_use]
    pub fn z(&self, value: f64) -> f64 {
        if self.log {
            (value / self.mean).ln() / self.sd
        } else {
            (value - self.mean) / self.sd
        }
    }

    /// Value of a z, inside the interval.
    #[must_use]
    pub fn value(&self, z: f64) -> f64 {
        let value = if self.log {
            self.mean * (z * self.sd).exp()
        } else {
            self.mean + z * self.sd
        };
        value.clamp(self.lower, self.upper)
    }

    /// z of both ends.
    #[must_use]
    pub fn z_bounds(&self) -> (f64, f64) {
        (self.z(self.lower), self.z(self.upper))
    }

    /// Slope of the value with z.
    #[must_use]
    pub fn slope(&self, z: f64) -> f64 {
        if self.log {
            self.value(z) * self.sd
        } else {
            self.sd
        }
    }
}
