//! Activation times of the groups that represent the nodes of an eikonal map.

use super::VentricleError;
use cardiotwin_units::Ms;
use serde::{Deserialize, Serialize};

/// Activation of the groups of a reduced ventricle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ActivationSpread {
    /// Time from the start of the beat to the first activation. It is negative if cells are
    /// activated earlier; they then contract at their end-diastolic length until the beat starts.
    #[serde(default)]
    pub onset: Ms,
    /// Time from the first to the last activation.
    pub spread: Ms,
    /// Number of groups, each activated at one time.
    pub n_groups: usize,
}

impl Default for ActivationSpread {
    /// 40 ms (SPEC section 4: 30 to 50) in 32 groups, from the start of the beat.
    fn default() -> Self {
        Self {
            onset: Ms(0.0),
            spread: Ms(40.0),
            n_groups: 32,
        }
    }
}

/// Activation times and weights of a reduced ventricle's groups.
#[derive(Debug, Clone, PartialEq)]
pub struct ActivationGroups {
    times_ms: Vec<f64>,
    weights: Vec<f64>,
}

impl ActivationGroups {
    /// Checks activation times \[ms\] and scales the weights to sum to one.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] if there are no groups, the lists differ in length, a time is
    /// not finite, or a weight is negative.
    pub fn new(times_ms: Vec<f64>, mut weights: Vec<f64>) -> Result<Self, VentricleError> {
        let bad = |name, value, expected| {
            Err(VentricleError::Parameter {
                name,
                value,
                expected,
            })
        };
        if times_ms.is_empty() || times_ms.len() != weights.len() {
            return bad(
                "activation groups",
                times_ms.len() as f64,
                "one or more, with as many weights",
            );
        }
        if let Some(value) = times_ms.iter().find(|x| !x.is_finite()) {
            return bad("activation time", *value, "finite");
        }
        if let Some(value) = weights.iter().find(|x| !(**x >= 0.0 && x.is_finite())) {
            return bad("activation weight", *value, "zero or more");
        }
        let sum: f64 = weights.iter().sum();
        if sum <= 0.0 {
            return bad("sum of activation weights", sum, "positive");
        }
        weights.iter_mut().for_each(|w| *w /= sum);
        Ok(Self { times_ms, weights })
    }

    /// Activation time of each group \[ms\].
    #[must_use]
    pub fn times_ms(&self) -> &[f64] {
        &self.times_ms
    }

    /// Weight of each group; they sum to one.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

impl ActivationSpread {
    /// Activation times \[ms\], equally spaced, and weights that sum to one.
    ///
    /// The weights follow `6 x (1 − x)`, where x is the time over the spread. As in an eikonal map
    /// from fascicles, few cells are activated first and last, and most in between. The times are
    /// the centres of the groups.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] if there are no groups, the spread is negative, or the onset
    /// is not finite.
    pub fn groups(&self) -> Result<(Vec<f64>, Vec<f64>), VentricleError> {
        let spread = self.spread.0;
        if !(spread >= 0.0 && spread.is_finite()) {
            return Err(VentricleError::Parameter {
                name: "activation spread",
                value: spread,
                expected: "zero or more",
            });
        }
        let onset = self.onset.0;
        if !onset.is_finite() {
            return Err(VentricleError::Parameter {
                name: "activation onset",
                value: onset,
                expected: "finite",
            });
        }
        if self.n_groups == 0 {
            return Err(VentricleError::Parameter {
                name: "activation groups",
                value: 0.0,
                expected: "one or more",
            });
        }
        let n = self.n_groups as f64;
        let centre = |k: usize| (k as f64 + 0.5) / n;
        let times = (0..self.n_groups)
            .map(|k| onset + spread * centre(k))
            .collect();
        // Integral of the density over the share of each group.
        let cumulative = |x: f64| x * x * (3.0 - 2.0 * x);
        let weights = (0..self.n_groups)
            .map(|k| cumulative((k as f64 + 1.0) / n) - cumulative(k as f64 / n))
            .collect();
        Ok((times, weights))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_and_times_are_centred() {
        let (times, weights) = ActivationSpread {
            n_groups: 16,
            ..ActivationSpread::default()
        }
        .groups()
        .unwrap();
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        let mean: f64 = times.iter().zip(&weights).map(|(t, w)| t * w).sum();
        assert!((mean - 20.0).abs() < 1e-12);
        assert!(weights[0] < weights[8] && times[0] > 0.0 && times[15] < 40.0);
    }

    #[test]
    fn an_onset_delays_every_group_alike() {
        let early = ActivationSpread::default().groups().unwrap();
        let late = ActivationSpread {
            onset: Ms(30.0),
            ..ActivationSpread::default()
        }
        .groups()
        .unwrap();
        assert!(
            early
                .0
                .iter()
                .zip(&late.0)
                .all(|(a, b)| (b - a - 30.0).abs() < 1e-12)
        );
        assert_eq!(early.1, late.1);
    }

    #[test]
    fn given_groups_are_scaled_and_checked() {
        let given = |times: &[f64], weights: &[f64]| {
            ActivationGroups::new(times.to_vec(), weights.to_vec())
        };
        assert_eq!(
            given(&[0.0, 60.0], &[3.0, 1.0]).unwrap().weights(),
            [0.75, 0.25]
        );
        assert!(given(&[0.0], &[1.0, 1.0]).is_err());
        assert!(given(&[f64::NAN], &[1.0]).is_err());
        assert!(given(&[1.0], &[0.0]).is_err());
        assert!(given(&[], &[]).is_err());
    }

    #[test]
    fn refuses_nonsense() {
        assert!(
            ActivationSpread {
                spread: Ms(-1.0),
                ..ActivationSpread::default()
            }
            .groups()
            .is_err()
        );
        assert!(
            ActivationSpread {
                onset: Ms(f64::INFINITY),
                ..ActivationSpread::default()
            }
            .groups()
            .is_err()
        );
        assert!(
            ActivationSpread {
                n_groups: 0,
                ..ActivationSpread::default()
            }
            .groups()
            .is_err()
        );
    }
}
