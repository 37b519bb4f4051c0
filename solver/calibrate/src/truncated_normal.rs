//! Normal distribution within bounds, and the coordinate in which it is standard normal.

use serde::{Deserialize, Serialize};

use crate::Interval;
use crate::normal::quantile;

/// Prior knowledge of a parameter: a normal distribution of its logarithm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Mean of the logarithm.
    pub centre: f64,
    /// Standard deviation of the logarithm.
    pub width: f64,
}

/// Largest magnitude of the standard coordinate, beyond which lies a probability of 10⁻¹⁵.
const FARTHEST: f64 = 8.0;

/// A normal distribution, cut off at bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruncatedNormal {
    normal: Prior,
    /// Interval of the parameter.
    pub interval: Interval,
    /// Probabilities below each bound under the normal distribution without bounds.
    below: [f64; 2],
}

/// Probability that a standard normal variable stays below `z`.
fn cumulative(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

impl TruncatedNormal {
    /// Restricts `normal` to `interval`, in which it must have some probability.
    #[must_use]
    pub fn new(normal: Prior, interval: Interval) -> Self {
        let below = [interval.lower, interval.upper]
            .map(|x| cumulative((x - normal.centre) / normal.width));
        Self {
            normal,
            interval,
            below,
        }
    }

    /// Parameter below which the distribution has the same probability as the standard normal one
    /// below `u`.
    #[must_use]
    pub fn from_standard(&self, u: f64) -> f64 {
        let [low, high] = self.below;
        let z = quantile(low + cumulative(u) * (high - low));
        self.interval
            .clamp(self.normal.centre + self.normal.width * z)
    }

    /// Inverse of [`Self::from_standard`]. A value on a bound maps to eight standard deviations.
    #[must_use]
    pub fn to_standard(&self, x: f64) -> f64 {
        let [low, high] = self.below;
        let share = (cumulative((x - self.normal.centre) / self.normal.width) - low) / (high - low);
        quantile(share.clamp(0.0, 1.0)).clamp(-FARTHEST, FARTHEST)
    }

    /// Value that the parameter stays below with this probability.
    #[must_use]
    pub fn quantile(&self, probability: f64) -> f64 {
        self.from_standard(quantile(probability))
    }
}
