//! Data of a search for figures and tables: measurement, model before and after, and residuals by
//! place.

use crate::forward::Prediction;
use crate::held_out::HeldOut;

use crate::noise::Signal;
use crate::phases::{PHASES, Phases};
use crate::problem::Data;
use cardiotwin_vocabulary::findings::{
    ComparedSignal, DiscoverSeries, GapAt, PhaseBegin, SimulatedCurves,
};

/// Interval of the curves \[ms\], about one pressure bin.
const CURVE_MS: f64 = 4.0;

/// Traces and residuals of a search for drawings and tables.
#[derive(Debug, Clone, PartialEq)]
pub struct Tabulated {
    /// Phases of the beat.
    pub phases: Phases,
    /// Residuals by signal and phase.
    pub gaps: Vec<GapAt>,
    /// Measured traces next to those of the model, before and after the search.
    pub series: DiscoverSeries,
}

impl Tabulated {
    /// Collects the series of the fitted beats and of the predictions for data held out.
    #[must_use]
    pub fn of(
        data: &Data,
        before: &Prediction,
        after: &Prediction,
        held_before: Option<&HeldOut>,
        held_after: Option<&HeldOut>,
    ) -> Self {
        let phases = Phases::of(&data.pressure, &data.volume, data.measured.cycle_ms);
        let at = |signal: &Signal, beat: &Prediction, trace: &[f64]| -> Vec<f64> {
            signal.time_ms.iter().map(|t| beat.at(trace, *t)).collect()
        };
        let compared = |signal: &Signal,
                        trace: fn(&Prediction) -> &[f64],
                        held: fn(&HeldOut) -> &Vec<f64>| ComparedSignal {
            time_ms: signal.time_ms.clone(),
            measured: signal.value.clone(),
            before: at(signal, before, trace(before)),
            after: at(signal, after, trace(after)),
            heldout_before: held_before.map(|h| held(h).clone()),
            heldout_after: held_after.map(|h| held(h).clone()),
            noise_sd: signal.noise_sd,
        };
        let pressure = compared(&data.pressure, |p| &p.pressure_mmhg, |h| &h.pressure_mmhg);
        let volume = compared(&data.volume, |p| &p.volume_ml, |h| &h.volume_ml);
        let cycle = data.measured.cycle_ms;
        let n = (cycle / CURVE_MS).ceil() as usize;
        let time_ms: Vec<f64> = (0..=n).map(|i| cycle * i as f64 / n as f64).collect();
        let curve =
            |beat: &Prediction, trace: &[f64]| time_ms.iter().map(|t| beat.at(trace, *t)).collect();
        let curves = SimulatedCurves {
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
        let begin = |(phase, begin_ms): (&str, f64)| PhaseBegin {
            phase: phase.to_owned(),
            begin_ms,
        };
        let series = DiscoverSeries {
            phases: std::iter::zip(PHASES, phases.beginnings())
                .map(begin)
                .collect(),
            pressure,
            volume,
            curves,
        };
        Self {
            phases,
            gaps,
            series,
        }
    }
}

/// Rows of one signal: one per phase that has samples, then one for the whole beat.
fn gaps(name: &str, signal: &ComparedSignal, phases: &Phases, cycle_ms: f64) -> Vec<GapAt> {
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
            n: chosen.len() as u32,
            before: rms(&signal.before),
            after: rms(&signal.after),
            heldout_before: signal.heldout_before.as_deref().map(rms),
            heldout_after: signal.heldout_after.as_deref().map(rms),
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
        let compared = ComparedSignal {
            measured: vec![3.0; 40],
            before: vec![1.0; 40],
            after: time_ms
                .iter()
                .map(|t| if (80.0..200.0).contains(t) { 4.0 } else { 3.0 })
                .collect(),
            heldout_before: Some(vec![0.0; 40]),
            heldout_after: None,
            noise_sd: 2.0,
            time_ms,
        };
        let rows = gaps("volume", &compared, &phases, 800.0);
        assert_eq!(rows.len(), 8);
        assert_eq!(rows[..7].iter().map(|r| r.n).sum::<u32>(), 40);
        assert!(rows.iter().all(|r| r.before == 1.0
            && r.heldout_before == Some(1.5)
            && r.heldout_after.is_none()));
        assert_eq!(
            (rows[1].phase.as_str(), rows[1].after, rows[2].after),
            ("early_ejection", 0.5, 0.0)
        );
        assert!((rows[7].after - (6.0f64 / 40.0).sqrt() * 0.5).abs() < 1e-12);
    }
}
