//! Active stress whose curve includes the spread of activation, so that one node represents the
//! whole wall.
//!
//! Jung 2022, eqs. A1-A3 with a4 = 0: Sa = Smax φ(λ) g(t), where g is the mean over the wall of
//! tanhⁿ(ts/τ_SR) tanh²((t_CR − ts)/τ_SD). The paper sets n to 2. Here n is a base parameter,
//! because a fixed sharpness of the upstroke would be mistaken for late activation. The stress has
//! a further factor 1 + tanh(κ dλ/dt), which the paper lacks: muscle that shortens bears less (Hill
//! 1938, Proc R Soc B 126:136; for the left ventricle Shroff et al. 1985, Am J Physiol 249:H358).

use cardiotwin_models::contraction::{ActiveStress, Contraction, ContractionError, NodeStep};
use std::f64::consts::PI;

/// Parameters of the activation curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurveParameters {
    /// Peak isometric stress \[kPa\].
    pub smax_kpa: f64,
    /// Time constant of the rise \[ms\].
    pub rise_ms: f64,
    /// Exponent n of the rise, which sets the sharpness of the upstroke.
    pub rise_exponent: f64,
    /// Time constant of the fall \[ms\].
    pub fall_ms: f64,
    /// Duration t_CR of the contraction at one place of the wall \[ms\].
    pub duration_ms: f64,
    /// Stretch below which no stress develops.
    pub least_stretch: f64,
    /// Time from the first to the last activation of the wall \[ms\].
    pub spread_ms: f64,
    /// Loss of stress by shortening, per rate of the stretch \[s\].
    pub rate_loss_s: f64,
}

/// Slope a6 of the length dependence.
const SLOPE: f64 = 5.0;
/// Number of points over the spread, weighted by 6 x (1 − x) like the groups of the one-fibre
/// ventricle.
const SPREAD_POINTS: usize = 8;

/// Activation curve, tabulated every millisecond from the first activation.
#[derive(Debug)]
pub struct ActivationCurve {
    table_kpa: Vec<f64>,
    least_stretch: f64,
    rate_loss_s: f64,
}

impl ActivationCurve {
    /// Creates the curve. It is multiplied by e^bump, where the bumps are raised cosines at equal
    /// distances with heights `log_factors`.
    #[must_use]
    pub fn new(p: &CurveParameters, log_factors: &[f64]) -> Self {
        let n = p.duration_ms.ceil() as usize + 1;
        let cell: Vec<f64> = (0..n)
            .map(|i| {
                let ts = i as f64;
                if ts >= p.duration_ms {
                    return 0.0;
                }
                let rise = (ts / p.rise_ms).tanh().powf(p.rise_exponent);
                let fall = ((p.duration_ms - ts) / p.fall_ms).tanh();
                rise * fall * fall
            })
            .collect();
        let total = n + p.spread_ms.ceil() as usize + 1;
        let mut table = vec![0.0; total + 1];
        let cumulative = |x: f64| x * x * (3.0 - 2.0 * x);
        for k in 0..SPREAD_POINTS {
            let (left, right) = (
                k as f64 / SPREAD_POINTS as f64,
                (k + 1) as f64 / SPREAD_POINTS as f64,
            );
            let weight = p.smax_kpa * (cumulative(right) - cumulative(left));
            let delay = 0.5 * (left + right) * p.spread_ms;
            let (whole, share) = (delay.floor() as usize, delay.fract());
            for (i, value) in cell.iter().enumerate() {
                table[i + whole] += weight * (1.0 - share) * value;
                table[i + whole + 1] += weight * share * value;
            }
        }
        if !log_factors.is_empty() {
            let width = (p.duration_ms + 0.5 * p.spread_ms) / log_factors.len() as f64;
            for (i, value) in table.iter_mut().enumerate() {
                let at =
                    |k: usize| ((i as f64 - (k as f64 + 0.5) * width) / width).clamp(-1.0, 1.0);
                let bump = |k: usize, b: f64| 0.5 * b * (1.0 + (PI * at(k)).cos());
                *value *= log_factors
                    .iter()
                    .enumerate()
                    .map(|(k, b)| bump(k, *b))
                    .sum::<f64>()
                    .exp();
            }
        }
        Self {
            table_kpa: table,
            least_stretch: p.least_stretch,
            rate_loss_s: p.rate_loss_s,
        }
    }

    /// Factor of the stress at the step's rate of the stretch, with its derivative by the stretch at
    /// the end of the step.
    fn rate_factor(&self, step: &NodeStep) -> (f64, f64) {
        if step.dt_ms <= 0.0 {
            return (1.0, 0.0);
        }
        let per_stretch = 1e3 * self.rate_loss_s / step.dt_ms;
        let change = (per_stretch * (step.lambda - step.lambda_prev)).tanh();
        (1.0 + change, per_stretch * (1.0 - change * change))
    }
}

impl Contraction for ActivationCurve {
    fn n_states(&self) -> usize {
        0
    }

    fn needs_calcium(&self) -> bool {
        false
    }

    fn rest(&self, _state: &mut [f64]) {}

    fn length_factor(&self, lambda: f64) -> (f64, f64) {
        let raw = 1.0 - 2.0 / ((2.0 * SLOPE * (lambda - self.least_stretch)).exp() + 1.0);
        if raw > 0.0 {
            (raw, SLOPE * (1.0 - raw * raw))
        } else {
            (0.0, 0.0)
        }
    }

    fn try_step(
        &self,
        step: &NodeStep,
        _: &[f64],
        _: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        if !(step.lambda > 0.0 && step.lambda.is_finite()) {
            return Err(ContractionError::Stretch {
                lambda: step.lambda,
            });
        }
        let since = step.since_activation_ms;
        if since <= 0.0 || since as usize + 1 >= self.table_kpa.len() {
            return Ok(ActiveStress::default());
        }
        let (i, share) = (since as usize, since.fract());
        let activation = self.table_kpa[i] * (1.0 - share) + self.table_kpa[i + 1] * share;
        let (phi, dphi) = self.length_factor(step.lambda);
        let (rate, drate) = self.rate_factor(step);
        Ok(ActiveStress {
            sa_kpa: activation * phi * rate,
            dsa_dlambda_kpa: activation * (dphi * rate + phi * drate),
        })
    }
}
