//! Sampled calcium transient: the median trace of step 1 as a fixed input of step 2 (Jung 2022, eq.
//! 18).

use super::{Calcium, CalciumError};
use cardiotwin_units::Ms;

/// Samples at a constant interval from activation, joined by cubic Hermite pieces with
/// central-difference slopes (C¹) and constant beyond the ends.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledCalcium {
    interval_ms: f64,
    samples_um: Vec<f64>,
}

impl SampledCalcium {
    /// Creates the transient from samples \[µM\] at `0, interval, 2 interval, …` after activation.
    ///
    /// # Errors
    /// [`CalciumError::Samples`] if there are fewer than three samples, the interval is invalid, or
    /// a sample is not positive and finite.
    pub fn new(interval: Ms, samples_um: Vec<f64>) -> Result<Self, CalciumError> {
        let n_samples = samples_um.len();
        let bad = samples_um.iter().position(|c| !(*c > 0.0 && c.is_finite()));
        if let Some(index) = bad {
            return Err(CalciumError::Samples {
                n_samples,
                index,
                value_um: samples_um[index],
            });
        }
        if n_samples < 3 || !(interval.0 > 0.0 && interval.0.is_finite()) {
            return Err(CalciumError::Samples {
                n_samples,
                index: n_samples,
                value_um: f64::NAN,
            });
        }
        Ok(Self {
            interval_ms: interval.0,
            samples_um,
        })
    }

    /// Slope at sample `k` in µM per interval.
    fn slope(&self, k: usize) -> f64 {
        let s = &self.samples_um;
        let last = s.len() - 1;
        match k {
            0 => s[1] - s[0],
            k if k == last => s[last] - s[last - 1],
            k => 0.5 * (s[k + 1] - s[k - 1]),
        }
    }
}

impl Calcium for SampledCalcium {
    fn concentration_um(&self, since_activation_ms: f64) -> f64 {
        self.value_and_rate(since_activation_ms).0
    }

    fn value_and_rate(&self, since_activation_ms: f64) -> (f64, f64) {
        let last = self.samples_um.len() - 1;
        let position = since_activation_ms / self.interval_ms;
        if position < 0.0 {
            return (self.samples_um[0], 0.0);
        }
        if position >= last as f64 {
            return (self.samples_um[last], 0.0);
        }
        let k = position as usize;
        let x = position - k as f64;
        let (a, b) = (self.samples_um[k], self.samples_um[k + 1]);
        let (ma, mb) = (self.slope(k), self.slope(k + 1));
        let (c2, c3) = (3.0 * (b - a) - 2.0 * ma - mb, 2.0 * (a - b) + ma + mb);
        (
            a + x * (ma + x * (c2 + x * c3)),
            (ma + x * (2.0 * c2 + x * 3.0 * c3)) / self.interval_ms,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calcium::{Rice2008, Rice2008Parameters};

    #[test]
    fn follows_the_transient_it_was_sampled_from() {
        let rice = Rice2008::new(Rice2008Parameters::default()).unwrap();
        let samples = (0..=1000)
            .map(|t| rice.concentration_um(f64::from(t)))
            .collect();
        let sampled = SampledCalcium::new(Ms(1.0), samples).unwrap();
        for k in 10..9000 {
            let t = f64::from(k) * 0.1;
            let (value, rate) = sampled.value_and_rate(t);
            let (exact, exact_rate) = rice.value_and_rate(t);
            assert!(
                (value - exact).abs() < 1e-7 && (rate - exact_rate).abs() < 1e-6,
                "{t}"
            );
        }
        assert_eq!(sampled.concentration_um(1e9), rice.concentration_um(1000.0));
        assert_eq!(sampled.concentration_um(-1.0), 0.15);
    }

    #[test]
    fn refuses_nonsense() {
        assert!(matches!(
            SampledCalcium::new(Ms(1.0), vec![0.1, -0.2, 0.1]),
            Err(CalciumError::Samples { index: 1, .. })
        ));
        assert!(matches!(
            SampledCalcium::new(Ms(1.0), vec![0.1]),
            Err(CalciumError::Samples { n_samples: 1, .. })
        ));
    }
}
