//! A normal distribution within bounds, and the coordinate in which it is standard normal.

use crate::Interval;
use crate::normal::quantile;
use crate::space_mapping::Prior;

/// Largest magnitude of the standard coordinate: one in 10¹⁵ lies beyond.
const FARTHEST: f64 = 8.0;

/// A normal distribution, cut off at bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruncatedNormal {
    normal: Prior,
    /// Where the parameter lies.
    pub interval: Interval,
    /// Probabilities that the normal distribution without bounds stays below each of them.
    below: [f64; 2],
}

/// The probability that a standard normal number stays below `z`.
fn cumulative(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

impl TruncatedNormal {
    /// `normal` within `interval`, of which it has to have some probability.
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

    /// The parameter at which the distribution has the share of probability below it that a standard normal one has below `u`.
    #[must_use]
    pub fn from_standard(&self, u: f64) -> f64 {
        let [low, high] = self.below;
        let z = quantile(low + cumulative(u) * (high - low));
        self.interval
            .clamp(self.normal.centre + self.normal.width * z)
    }

    /// The inverse of [`Self::from_standard`]; a value on a bound is eight standard deviations out.
    #[must_use]
    pub fn to_standard(&self, x: f64) -> f64 {
        let [low, high] = self.below;
        let share = (cumulative((x - self.normal.centre) / self.normal.width) - low) / (high - low);
        quantile(share.clamp(0.0, 1.0)).clamp(-FARTHEST, FARTHEST)
    }

    /// The value that the distribution stays below with this probability.
    #[must_use]
    pub fn quantile(&self, probability: f64) -> f64 {
        self.from_standard(quantile(probability))
    }
}
