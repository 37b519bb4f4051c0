//! Uncertainty of the mean beat, from the differences between beats in level, in strength, and in
//! the remaining noise.

/// Longest lag of the correlation \[ms\].
const LONGEST_MS: f64 = 200.0;
/// Longest lag of the correlation, as a share of a beat.
const LONGEST_SHARE: f64 = 0.3;

/// Noise of a mean beat.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// Root mean square of single beats' differences from the mean, without their level and
    /// strength \[mmHg\].
    pub beat_rms_mmhg: f64,
    /// Standard deviation of the beats' levels, which is mainly due to breathing \[mmHg\].
    pub level_sd_mmhg: f64,
    /// Standard deviation of the beats' strengths, dimensionless. The strength is the factor of the
    /// mean's deviation from its own level.
    pub strength_sd: f64,
    /// Time after which the correlation of the remaining noise has fallen to 1/e \[ms\].
    pub correlation_ms: f64,
    /// Standard error of the mean: all parts divided by the square root of their effective number
    /// of beats \[mmHg\].
    pub mean_rms_mmhg: f64,
    /// Effective number of independent levels, which is smaller than that of beats because
    /// neighbours share a phase of breathing.
    pub n_effective: f64,
}

/// Noise from the residuals of `n_averaged` beats; `None` with fewer than three beats to compare.
/// - `residuals_mmhg`: residuals of equal length in temporal order, with samples every `step_ms`,
///   as many as in `mean_mmhg`
#[must_use]
pub fn of(
    residuals_mmhg: &[Vec<f64>],
    mean_mmhg: &[f64],
    step_ms: f64,
    n_averaged: usize,
) -> Option<Noise> {
    let n = residuals_mmhg.len();
    if n < 3 {
        return None;
    }
    let length = residuals_mmhg[0].len();
    let levels: Vec<f64> = residuals_mmhg.iter().map(|r| finite_mean(r)).collect();
    let centre = finite_mean(mean_mmhg);
    let course: Vec<f64> = mean_mmhg.iter().map(|p| p - centre).collect();
    let swing = course.iter().map(|p| p * p).sum::<f64>();
    let strengths: Vec<f64> = residuals_mmhg
        .iter()
        .map(|r| {
            r.iter()
                .zip(&course)
                .filter(|(r, _)| r.is_finite())
                .map(|(r, p)| r * p)
                .sum::<f64>()
                / swing.max(1e-9)
        })
        .collect();
    // The mean uses one degree of freedom.
    let freedom = n as f64 / (n as f64 - 1.0);
    let n_lags =
        ((LONGEST_MS.min(LONGEST_SHARE * length as f64 * step_ms) / step_ms) as usize).max(2);
    let mut products = vec![0.0; n_lags];
    let mut counts = vec![0.0; n_lags];
    // Half an hour has millions of products for each lag; a few hundred beats suffice.
    let every = n.div_ceil(256);
    let mut squares = 0.0;
    let mut n_squares = 0.0;
    for (idx, ((residual, level), strength)) in residuals_mmhg
        .iter()
        .zip(&levels)
        .zip(&strengths)
        .enumerate()
    {
        let rest = |(r, p): (&f64, &f64)| {
            if r.is_finite() {
                r - level - strength * p
            } else {
                0.0
            }
        };
        let fast: Vec<f64> = residual.iter().zip(&course).map(rest).collect();
        squares += fast.iter().map(|r| r * r).sum::<f64>();
        n_squares += length as f64;
        if idx % every == 0 {
            for lag in 0..n_lags {
                products[lag] += fast[lag..]
                    .iter()
                    .zip(&fast)
                    .map(|(a, b)| a * b)
                    .sum::<f64>();
                counts[lag] += (length - lag) as f64;
            }
        }
    }
    let fast_variance = squares / n_squares * freedom;
    let correlation: Vec<f64> = products
        .iter()
        .zip(&counts)
        .map(|(p, c)| p / c / (products[0] / counts[0]).max(1e-12))
        .collect();
    let correlation_ms = fall_to(&correlation, (-1.0_f64).exp()) * step_ms;
    let level_variance = levels.iter().map(|l| l * l).sum::<f64>() / (n as f64 - 1.0);
    let strength_variance = strengths.iter().map(|g| g * g).sum::<f64>() / (n as f64 - 1.0);
    let of_strength = strength_variance * swing / length as f64;
    let worth = effective(&levels);
    let (m_fast, m_level) = if n_averaged > 1 {
        (n_averaged as f64, worth)
    } else {
        (1.0, 1.0)
    };
    Some(Noise {
        beat_rms_mmhg: fast_variance.sqrt(),
        level_sd_mmhg: level_variance.sqrt(),
        strength_sd: strength_variance.sqrt(),
        correlation_ms,
        mean_rms_mmhg: (fast_variance / m_fast + (level_variance + of_strength) / m_level).sqrt(),
        n_effective: worth,
    })
}

fn finite_mean(values: &[f64]) -> f64 {
    let (sum, n) = values
        .iter()
        .filter(|v| v.is_finite())
        .fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(n, 1.0)
}

/// Interpolated position at which a decreasing sequence reaches a level; its length if it never
/// does.
fn fall_to(values: &[f64], level: f64) -> f64 {
    (1..values.len())
        .find(|i| values[*i] <= level)
        .map_or(values.len() as f64, |i| {
            i as f64 - 1.0 + (values[i - 1] - level) / (values[i - 1] - values[i])
        })
}

/// Effective number of independent values for the mean of a sequence, from lags up to the first
/// without correlation.
fn effective(levels: &[f64]) -> f64 {
    let n = levels.len();
    let variance: f64 = levels.iter().map(|l| l * l).sum();
    if variance <= 0.0 {
        return n as f64;
    }
    let mut tau = 1.0;
    for lag in 1..n / 2 {
        let rho = (lag..n).map(|i| levels[i] * levels[i - lag]).sum::<f64>() / variance;
        if rho <= 0.0 {
            break;
        }
        tau += 2.0 * rho;
    }
    (n as f64 / tau).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_validation::random::Random;

    #[test]
    fn noise_of_known_size_and_correlation_is_found() {
        let mean: Vec<f64> = (0..800)
            .map(|i| 60.0 + 50.0 * (f64::from(i) * 0.0025).cos().abs())
            .collect();
        for (rms, tau, level) in [(1.0, 12.0, 0.0), (2.0, 6.0, 1.5), (0.5, 25.0, 0.3)] {
            let mut random = Random::new(7, 3);
            let rho = f64::exp(-1.0 / tau);
            let residuals: Vec<Vec<f64>> = (0..60)
                .map(|_| {
                    let (mut x, offset) = (rms * random.normal(), level * random.normal());
                    let strength = 0.03 * random.normal();
                    mean.iter()
                        .map(|p| {
                            let now = x;
                            x = rho * x + rms * (1.0 - rho * rho).sqrt() * random.normal();
                            now + offset + strength * (p - 60.0 - 100.0 / std::f64::consts::PI)
                        })
                        .collect()
                })
                .collect();
            let noise = of(&residuals, &mean, 1.0, 60).unwrap();
            assert!(
                (noise.beat_rms_mmhg / rms - 1.0).abs() < 0.07,
                "{rms} {tau}: {noise:?}"
            );
            assert!(
                (noise.correlation_ms / tau - 1.0).abs() < 0.2,
                "{rms} {tau}: {noise:?}"
            );
            // The means of the fast noise add to the levels of the beats.
            let own = rms * (2.0 * tau / 800.0).sqrt();
            assert!(
                (noise.level_sd_mmhg / f64::hypot(level, own) - 1.0).abs() < 0.3,
                "{level} {own}: {noise:?}"
            );
            assert!(noise.mean_rms_mmhg < 0.35 * (rms + level));
        }
        assert_eq!(
            of(&[vec![0.0; 10], vec![0.0; 10]], &[0.0; 10], 1.0, 2),
            None
        );
    }
}
