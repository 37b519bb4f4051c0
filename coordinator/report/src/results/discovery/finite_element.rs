//! The gap that a patient's finite-element ventricle leaves without and with the accepted effects, by
//! the data, noise and phases of the search.

use cardiotwin_schemas::discover::{
    ComparedSignal, DiscoverSeries, Discovered, FiniteElementBeat, FiniteElementGap, GapAt,
    SimulatedCurves,
};
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::record::PatientRecord;

use crate::results::columns::Columns;
use crate::results::signals::{SignalKind, Signals, Source, at};

type Trace = Vec<(f64, f64)>;

/// Compares the beats of a patient's twins without and with the effects; `None` if either has none
/// yet.
#[must_use]
pub fn compare(
    found: &Discovered,
    before: &PatientRecord,
    after: &PatientRecord,
) -> Option<FiniteElementGap> {
    let (without, with) = (Beat::of(before)?, Beat::of(after)?);
    let OrganSpec::FiniteElement(organ) = &before.step0.as_ref()?.result.organ else {
        return None;
    };
    let pressure = compared(&found.series.pressure, 0, &without, &with);
    let volume = compared(&found.series.volume, 1, &without, &with);
    let gaps = [("pressure", &pressure), ("volume", &volume)]
        .into_iter()
        .flat_map(|(name, signal)| gaps(name, signal, &found.series))
        .collect();
    let time_ms = found.series.curves.time_ms.clone();
    let curve = |k: usize, beat: &Beat, corrected: Option<&Beat>| -> Vec<f64> {
        let value = |t: &f64| beat.as_measured(k, *t, corrected);
        time_ms.iter().map(value).collect()
    };
    let curves = SimulatedCurves {
        pressure_before_mmhg: curve(0, &without, None),
        pressure_after_mmhg: curve(0, &with, Some(&without)),
        volume_before_ml: curve(1, &without, None),
        volume_after_ml: curve(1, &with, Some(&without)),
        time_ms: time_ms.clone(),
    };
    let rms = |signal: &ComparedSignal, model: &[f64]| {
        root_mean_square(
            signal,
            model,
            &(0..signal.time_ms.len()).collect::<Vec<_>>(),
        )
    };
    Some(FiniteElementGap {
        nodes: organ.figures.nodes,
        before: FiniteElementBeat {
            task: without.task,
            pressure_rms_mmhg: rms(&pressure, &pressure.before),
            volume_rms_ml: rms(&volume, &volume.before),
        },
        after: FiniteElementBeat {
            task: with.task,
            pressure_rms_mmhg: rms(&pressure, &pressure.after),
            volume_rms_ml: rms(&volume, &volume.after),
        },
        gaps,
        series: DiscoverSeries {
            phases: found.series.phases.clone(),
            pressure,
            volume,
            curves,
        },
    })
}

/// Whole beat's root mean squares of a gap: name of the trace with its unit, before, and after.
#[must_use]
pub fn rms_of(gap: &FiniteElementGap) -> [(&'static str, f64, f64); 2] {
    let (before, after) = (&gap.before, &gap.after);
    [
        (
            "pressure, mmHg",
            before.pressure_rms_mmhg,
            after.pressure_rms_mmhg,
        ),
        ("volume, mL", before.volume_rms_ml, after.volume_rms_ml),
    ]
}

/// Relative change as people read it.
#[must_use]
pub fn change(before: f64, after: f64) -> String {
    format!("{:+.0} %", 100.0 * (after / before - 1.0)).replace('-', "\u{2212}")
}

/// The twin's beat, with the measured traces that it was fitted to.
struct Beat {
    task: String,
    /// Simulated pressure and volume.
    simulated: [Trace; 2],
    /// Measured pressure and volume, corrected for accepted artefacts.
    measured: [Trace; 2],
}

impl Beat {
    fn of(record: &PatientRecord) -> Option<Self> {
        let run = record.twin()?;
        let columns = Columns::read(&run.artefact("traces")?).ok()?;
        let signals = Signals::read(record);
        let simulated = |kind: SignalKind| columns.pairs("time_ms", kind.column());
        let measured = |kind| signals.get(Source::Measured, kind).map(<[_]>::to_vec);
        let (pressure, volume) = (SignalKind::Pressure, SignalKind::Volume);
        Some(Self {
            task: run.key.to_string(),
            simulated: [simulated(pressure)?, simulated(volume)?],
            measured: [measured(pressure)?, measured(volume)?],
        })
    }

    /// Simulated value at a time, as it would be measured: without the correction of the data, which
    /// is the difference to those of `uncorrected`.
    fn as_measured(&self, k: usize, time_ms: f64, uncorrected: Option<&Self>) -> f64 {
        let value = |trace: &Trace| at(trace, time_ms).unwrap_or(f64::NAN);
        let simulated = value(&self.simulated[k]);
        let moved = uncorrected.map_or(0.0, |raw| {
            if raw.measured[k] == self.measured[k] {
                0.0
            } else {
                value(&raw.measured[k]) - value(&self.measured[k])
            }
        });
        simulated + moved
    }
}

fn compared(found: &ComparedSignal, k: usize, without: &Beat, with: &Beat) -> ComparedSignal {
    let values = |beat: &Beat, corrected: Option<&Beat>| {
        let value = |t: &f64| beat.as_measured(k, *t, corrected);
        found.time_ms.iter().map(value).collect()
    };
    ComparedSignal {
        before: values(without, None),
        after: values(with, Some(without)),
        heldout_before: None,
        heldout_after: None,
        ..found.clone()
    }
}

/// Rows of one signal: one per phase that has samples, then one for the whole beat.
fn gaps(name: &str, signal: &ComparedSignal, series: &DiscoverSeries) -> Vec<GapAt> {
    let cycle = series.curves.time_ms.last().copied().unwrap_or(0.0);
    let phase_of = |time_ms: f64| -> Option<&str> {
        let since = |begin: f64| (time_ms - begin).rem_euclid(cycle);
        let begun =
            (series.phases.iter()).min_by(|a, b| since(a.begin_ms).total_cmp(&since(b.begin_ms)));
        begun.map(|phase| phase.phase.as_str())
    };
    let row = |phase: &str, inside: &dyn Fn(f64) -> bool| {
        let chosen: Vec<usize> = (0..signal.time_ms.len())
            .filter(|i| inside(signal.time_ms[*i]))
            .collect();
        let over_noise = |model: &[f64]| root_mean_square(signal, model, &chosen) / signal.noise_sd;
        (!chosen.is_empty()).then(|| GapAt {
            signal: name.to_owned(),
            phase: phase.to_owned(),
            n: u32::try_from(chosen.len()).unwrap_or(u32::MAX),
            before: over_noise(&signal.before),
            after: over_noise(&signal.after),
            heldout_before: None,
            heldout_after: None,
        })
    };
    let mut rows: Vec<GapAt> = (series.phases.iter())
        .filter_map(|begin| row(&begin.phase, &|t| phase_of(t) == Some(begin.phase.as_str())))
        .collect();
    rows.extend(row("beat", &|_| true));
    rows
}

fn root_mean_square(signal: &ComparedSignal, model: &[f64], chosen: &[usize]) -> f64 {
    let square = |i: &usize| (signal.measured[*i] - model[*i]).powi(2);
    (chosen.iter().map(square).sum::<f64>() / chosen.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use cardiotwin_findings::kick;

    use super::*;

    fn beat(simulated: f64, measured: f64) -> Beat {
        let flat = |value: f64| vec![(0.0, value), (800.0, value)];
        Beat {
            task: String::new(),
            simulated: [flat(simulated), flat(simulated)],
            measured: [flat(measured), flat(measured)],
        }
    }

    #[test]
    fn a_corrected_beat_is_compared_with_the_data_as_measured() {
        // An offset of 5 was taken from the data, and the beat fitted to the rest.
        let (raw, corrected) = (beat(97.0, 100.0), beat(94.0, 95.0));
        assert_eq!(raw.as_measured(0, 10.0, None), 97.0);
        assert_eq!(corrected.as_measured(0, 10.0, Some(&raw)), 99.0);
        assert_eq!(beat(94.0, 100.0).as_measured(1, 10.0, Some(&raw)), 94.0);
    }

    #[test]
    fn gaps_by_phase_add_up_to_that_of_the_beat() {
        let series = kick().series;
        for signal in [&series.pressure, &series.volume] {
            let rows = gaps("volume", signal, &series);
            let (beat, phases) = rows.split_last().unwrap();
            assert_eq!(
                (beat.phase.as_str(), beat.n as usize),
                ("beat", signal.time_ms.len())
            );
            assert_eq!(phases.iter().map(|row| row.n).sum::<u32>(), beat.n);
            let squares = |of: fn(&GapAt) -> f64| -> f64 {
                let all = phases.iter().map(|row| f64::from(row.n) * of(row).powi(2));
                (all.sum::<f64>() / f64::from(beat.n)).sqrt()
            };
            assert!((squares(|row| row.before) - beat.before).abs() < 1e-9);
            assert!((squares(|row| row.after) - beat.after).abs() < 1e-9);
        }
    }
}
