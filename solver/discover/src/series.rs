//! Data of a search for figures and tables: measurement, model before and after, and residuals by
//! place.

use crate::forward::Prediction;
use crate::held_out::HeldOut;
use crate::locate::{PHASES, Phases};
use crate::noise::Signal;
use crate::problem::Data;
use serde::{Deserialize, Serialize};

/// Interval of the curves \[ms\], about one pressure bin.
const CURVE_MS: f64 = 4.0;

/// A signal at the times of its data, with the model's values there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Compared {
    /// Times of the data \[ms\].
    pub time_ms: Vec<f64>,
    /// Data: pressure bins \[mmHg\] or volume frames \[mL\].
    pub measured: Vec<f64>,
    /// Values of the base model.
    pub before: Vec<f64>,
    /// Values of the model with the accepted effects.
    pub after: Vec<f64>,
    /// Values of the base model fitted without the block of the sample; `None` if a refit failed.
    pub held_out_before: Option<Vec<f64>>,
    /// Values of the model with the accepted effects fitted without that block; `None` if a refit
    /// failed.
    pub held_out_after: Option<Vec<f64>>,
    /// Standard deviation of the noise of one sample.
    pub noise_sd: f64,
}

/// Simulated beats on a common grid over the cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curves {
    /// Times \[ms\].
    pub time_ms: Vec<f64>,
    /// Pressure of the base model, as measured \[mmHg\].
    pub pressure_before_mmhg: Vec<f64>,
    /// Pressure with the accepted effects, as measured \[mmHg\].
    pub pressure_after_mmhg: Vec<f64>,
    /// Volume of the base model, as measured \[mL\].
    pub volume_before_ml: Vec<f64>,
    /// Volume with the accepted effects, as measured \[mL\].
    pub volume_after_ml: Vec<f64>,
}

/// Rms standardised residuals of a signal in a phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GapAt {
    /// `pressure` or `volume`.
    pub signal: String,
    /// One of [`PHASES`], or `beat` for the whole cycle.
    pub phase: String,
    /// Number of samples.
    pub n: usize,
    /// Residual of the base model.
    pub before: f64,
    /// Residual with the accepted effects.
    pub after: f64,
    /// Residual of the base model on data held out; `None` if a refit failed.
    pub held_out_before: Option<f64>,
    /// Residual with the accepted effects on data held out; `None` if a refit failed.
    pub held_out_after: Option<f64>,
}

/// Data of a search for figures and tables.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Phases of the beat.
    pub phases: Phases,
    /// Pressure at the bins of the data.
    pub pressure: Compared,
    /// Volume at the frames of the data.
    pub volume: Compared,
    /// Simulated beats.
    pub curves: Curves,
    /// Residuals by signal and phase.
    pub gaps: Vec<GapAt>,
}

impl Series {
    /// Collects the series of the fitted beats and of the predictions for data held out.
    #[must_use]
    pub fn of(
        data: &Data,
        before: &Prediction,
        after: &Prediction,
        held_before: Option<&HeldOut>,
        held_after: Option<&HeldOut>,
    ) -> Self {
        let phases = Phases::of(data);
        let at = |signal: &Signal, beat: &Prediction, trace: &[f64]| -> Vec<f64> {
            signal.time_ms.iter().map(|t| beat.at(trace, *t)).collect()
        };
        let compared = |signal: &Signal,
                        trace: fn(&Prediction) -> &[f64],
                        held: fn(&HeldOut) -> &Vec<f64>| Compared {
            time_ms: signal.time_ms.clone(),
            measured: signal.value.clone(),
            before: at(signal, before, trace(before)),
            after: at(signal, after, trace(after)),
            held_out_before: held_before.map(|h| held(h).clone()),
            held_out_after: held_after.map(|h| held(h).clone()),
            noise_sd: signal.noise_sd,
        };
        let pressure = compared(&data.pressure, |p| &p.pressure_mmhg, |h| &h.pressure_mmhg);
        let volume = compared(&data.volume, |p| &p.volume_ml, |h| &h.volume_ml);
        let cycle = data.measured.cycle_ms;
        let n = (cycle / CURVE_MS).ceil() as usize;
        let time_ms: Vec<f64> = (0..=n).map(|i| cycle * i as f64 / n as f64).collect();
        let curve =
            |beat: &Prediction, trace: &[f64]| time_ms.iter().map(|t| beat.at(trace, *t)).collect();
        let curves = Curves {
            pressure_before_mmhg: curve(before, &before.pressure_mmhg),
            pressure_after_mmhg: curve(after, &after.pressure_mmhg),
            volume_before_ml: curve(before, &before.volume_ml),
            volume_after_ml: curve(after, &after.volume_ml),
            time_ms,
        };
        let gaps = [("pressure", &pressure), ("volume", &volume)]
            .into_iter()
            .flat_map(|(name, signal)| gaps(name, signal, &phases, cycle))
            .collect();
        Self {
            phases,
            pressure,
            volume,
            curves,
            gaps,
        }
    }
}

/// Rows of one signal: one per phase that has samples, then one for the whole beat.
fn gaps(name: &str, signal: &Compared, phases: &Phases, cycle_ms: f64) -> Vec<GapAt> {
    let row = |phase: &str, inside: &dyn Fn(usize) -> bool| {
        let chosen: Vec<usize> = (0..signal.time_ms.len())
            .filter(|i| inside(phases.at(signal.time_ms[*i], cycle_ms)))
            .collect();
        let rms = |model: &[f64]| {
            let sum: f64 = chosen
                .iter()
                .map(|i| ((signal.measured[*i] - model[*i]) / signal.noise_sd).powi(2))
                .sum();
            (sum / chosen.len() as f64).sqrt()
        };
        (!chosen.is_empty()).then(|| GapAt {
            signal: name.to_owned(),
            phase: phase.to_owned(),
            n: chosen.len(),
            before: rms(&signal.before),
            after: rms(&signal.after),
            held_out_before: signal.held_out_before.as_deref().map(rms),
            held_out_after: signal.held_out_after.as_deref().map(rms),
        })
    };
    let mut rows: Vec<GapAt> = PHASES
        .iter()
        .enumerate()
        .filter_map(|(k, phase)| row(phase, &|at| at == k))
        .collect();
    rows.extend(row("beat", &|_| true));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_hold_all_samples_once_and_the_whole_beat() {
        let phases = Phases {
            isovolumic_contraction_ms: 20.0,
            early_ejection_ms: 80.0,
            late_ejection_ms: 200.0,
            isovolumic_relaxation_ms: 350.0,
            rapid_filling_ms: 420.0,
            diastasis_ms: 560.0,
            atrial_systole_ms: 700.0,
        };
        let time_ms: Vec<f64> = (0..40).map(|i| 20.0 * f64::from(i)).collect();
        let compared = Compared {
            measured: vec![3.0; 40],
            before: vec![1.0; 40],
            after: time_ms
                .iter()
                .map(|t| if (80.0..200.0).contains(t) { 4.0 } else { 3.0 })
                .collect(),
            held_out_before: Some(vec![0.0; 40]),
            held_out_after: None,
            noise_sd: 2.0,
            time_ms,
        };
        let rows = gaps("volume", &compared, &phases, 800.0);
        assert_eq!(rows.len(), 8);
        assert_eq!(rows[..7].iter().map(|r| r.n).sum::<usize>(), 40);
        assert!(rows.iter().all(|r| r.before == 1.0
            && r.held_out_before == Some(1.5)
            && r.held_out_after.is_none()));
        assert_eq!(
            (rows[1].phase.as_str(), rows[1].after, rows[2].after),
            ("early_ejection", 0.5, 0.0)
        );
        assert!((rows[7].after - (6.0f64 / 40.0).sqrt() * 0.5).abs() < 1e-12);
    }
}
