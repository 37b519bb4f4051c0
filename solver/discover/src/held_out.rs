//! Gap between model and data, for the fitted data and for data held out of the fit.

use crate::calibration::Calibration;
use crate::fit::Fit;
use crate::forward::Prediction;
use crate::least_squares::Settings;
use crate::noise::{BIN_MS, Signal};
use crate::problem::{Data, Problem};
use rayon::prelude::*;

/// Shortest block that is held out \[ms\]. It exceeds the memory of the noise and the duration of a
/// frame.
const SHORTEST_BLOCK_MS: f64 = 40.0;
/// Number of folds. Each block is held out once, together with every fourth of the others.
const FOLDS: usize = 4;

/// Mean of the squared standardised residuals of a signal; `None` without data.
fn mean_square(signal: &Signal, beat: &Prediction, trace: &[f64]) -> Option<f64> {
    let sum: f64 = (0..signal.len())
        .map(|i| ((signal.value[i] - beat.at(trace, signal.time_ms[i])) / signal.noise_sd).powi(2))
        .sum();
    (!signal.is_empty()).then(|| sum / signal.len() as f64)
}

/// Sum of squared standardised residuals and its weight. Pressure counts by its number of
/// independent samples.
fn squares(data: &Data, beat: &Prediction) -> (f64, f64) {
    let n_pressure =
        data.pressure.len() as f64 * BIN_MS / (2.0 * data.levels.pressure_correlation_ms);
    let n_volume = data.volume.len() as f64;
    let p = mean_square(&data.pressure, beat, &beat.pressure_mmhg).unwrap_or(0.0);
    let v = mean_square(&data.volume, beat, &beat.volume_ml).unwrap_or(0.0);
    (n_pressure * p + n_volume * v, n_pressure + n_volume)
}

/// Rms standardised residual of a beat, including side data.
#[must_use]
pub fn gap(problem: &Problem<'_>, beat: &Prediction) -> f64 {
    let (sum, n) = squares(problem.data, beat);
    let mut side = problem.side(beat);
    side.extend(problem.data.further.white(beat).residuals);
    ((sum + side.iter().map(|r| r * r).sum::<f64>()) / (n + side.len() as f64)).sqrt()
}

/// Length of the blocks that are held out \[ms\].
#[must_use]
pub fn block_ms(data: &Data) -> f64 {
    SHORTEST_BLOCK_MS.max(3.0 * data.levels.pressure_correlation_ms)
}

/// Predictions for data that were held out: each fourth of the blocks from a fit to the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// Rms standardised residual of the traces.
    pub gap: f64,
    /// Predicted pressure at each of the data's bins \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Predicted volume at each frame \[mL\].
    pub volume_ml: Vec<f64>,
}

/// Predicts the data held out of refits; `None` if a refit fails.
#[must_use]
pub fn held_out(problem: &Problem<'_>, fit: &Fit, settings: &Settings) -> Option<HeldOut> {
    let length = block_ms(problem.data);
    let fold_of = |time_ms: f64| (time_ms / length) as usize % FOLDS;
    let folds: Vec<Option<Prediction>> = (0..FOLDS)
        .into_par_iter()
        .map(|fold| {
            let fitted = problem.data.part(&|t| fold_of(t) != fold);
            let inner = Problem {
                forward: problem.forward,
                data: &fitted,
            };
            let refit = inner.fit(&fit.structure, &fit.z, Some(fit), settings)?;
            let beat =
                inner.predict(&refit.structure, &refit.values(), Some(&refit.minimum.warm))?;
            Some(Calibration::of(&fitted, &beat).apply(&beat))
        })
        .collect();
    let folds: Vec<Prediction> = folds.into_iter().collect::<Option<_>>()?;
    let (mut sum, mut n) = (0.0, 0.0);
    for (fold, beat) in folds.iter().enumerate() {
        let (s, m) = squares(&problem.data.part(&|t| fold_of(t) == fold), beat);
        sum += s;
        n += m;
    }
    let predicted = |signal: &Signal, trace: fn(&Prediction) -> &[f64]| {
        let at = |t: &f64| {
            let beat = &folds[fold_of(*t)];
            beat.at(trace(beat), *t)
        };
        signal.time_ms.iter().map(at).collect()
    };
    Some(HeldOut {
        gap: (sum / n).sqrt(),
        pressure_mmhg: predicted(&problem.data.pressure, |p| &p.pressure_mmhg),
        volume_ml: predicted(&problem.data.volume, |p| &p.volume_ml),
    })
}
