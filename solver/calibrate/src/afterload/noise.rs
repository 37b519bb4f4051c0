//! Effective number of independent samples in coloured residuals.

use super::record::Record;
use cardiotwin_vocabulary::statistics::EffectiveSampleSize;

/// Number of correlation times up to which lags count (Sokal 1997, in Functional Integration, NATO
/// ASI B 361:131).
const WINDOW: f64 = 5.0;

/// Misfit that no lumped load removes, over the pulse pressure; it enters the misfit in every
/// comparison. The published four-element fit of the human record (Stergiopulos et al. 1999) leaves
/// 5 %.
const TOLERANCE_OF_PULSE: f64 = 0.02;

/// Comparison of fits of one record by their sums of squares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    n_samples: f64,
    tolerance: f64,
}

impl Scale {
    pub(super) fn new(record: &Record) -> Self {
        let tolerance = (TOLERANCE_OF_PULSE * record.pulse_pressure_mmhg()).powi(2);
        Self {
            n_samples: record.n_samples() as f64,
            tolerance,
        }
    }

    /// Mean square of the residuals plus the misfit that no load removes, mmHg².
    pub(super) fn variance(&self, sum_of_squares: f64) -> f64 {
        sum_of_squares / self.n_samples + self.tolerance
    }

    /// Fall of BIC of a model with `more` additional parameters.
    pub(super) fn delta_bic(&self, without: f64, with: f64, more: usize, n_effective: f64) -> f64 {
        n_effective * (self.variance(without) / self.variance(with)).ln()
            - more as f64 * n_effective.ln()
    }
}

/// Computes the integrated autocorrelation within beats and the design effect of beats with similar
/// misfits. A misfit that every beat repeats is observed once, not once per beat (Kish 1965, Survey
/// Sampling, section 5.4).
pub(super) fn effective_sample_size(record: &Record, residuals: &[f64]) -> EffectiveSampleSize {
    let n = residuals.len();
    let span = record.pressure_time_s[n - 1] - record.pressure_time_s[0];
    let step = span / (n - 1) as f64;
    let mean = residuals.iter().sum::<f64>() / n as f64;
    let variance = residuals.iter().map(|r| (r - mean).powi(2)).sum::<f64>();
    let mut tau = 1.0;
    if variance > 0.0 {
        for lag in 1..n / 2 {
            let product: f64 = (lag..n)
                .map(|i| (residuals[i] - mean) * (residuals[i - lag] - mean))
                .sum();
            tau += 2.0 * product / variance;
            if lag as f64 >= WINDOW * 0.5 * tau {
                break;
            }
        }
    }
    let tau = tau.max(1.0);
    let n_beats = record.n_beats() as f64;
    let within = (n as f64 / tau).max(2.0);
    let beat_correlation =
        (record.n_beats() > 1).then(|| beat_correlation(record, residuals, mean));
    let design = 1.0 + (n_beats - 1.0) * beat_correlation.unwrap_or(0.0).max(0.0);
    EffectiveSampleSize {
        correlation_time_ms: 0.5e3 * tau * step,
        beat_correlation,
        n_effective: (within / design).max(2.0),
    }
}

/// Correlation of residuals at the same phase in neighbouring beats.
fn beat_correlation(record: &Record, residuals: &[f64], mean: f64) -> f64 {
    let time = &record.pressure_time_s;
    let at = |t: f64| -> Option<f64> {
        let i = time.partition_point(|x| *x <= t);
        (i > 0 && i < time.len()).then(|| {
            let share = (t - time[i - 1]) / (time[i] - time[i - 1]);
            residuals[i - 1] + share * (residuals[i] - residuals[i - 1]) - mean
        })
    };
    let (mut product, mut here, mut there) = (0.0, 0.0, 0.0);
    for (t, r) in time.iter().zip(residuals) {
        let beat = record.beat_of(*t);
        let (Some(onset), Some(next)) = (
            record.upstrokes_s.get(beat),
            record.upstrokes_s.get(beat + 1),
        ) else {
            continue;
        };
        if let Some(other) = at(next + t - onset) {
            let r = r - mean;
            product += r * other;
            here += r * r;
            there += other * other;
        }
    }
    if here > 0.0 && there > 0.0 {
        product / (here * there).sqrt()
    } else {
        0.0
    }
}
