//! Times of the samples, and a recording that begins at end-diastole where there is a single beat.

use std::path::Path;

use cardiotwin_recordings::beats::find;
use cardiotwin_recordings::recording::{Channels, Recording};
use cardiotwin_schemas::raw::{BeatSource, BeatsStep};
use cardiotwin_signals::{Continuation, Problem, Quantity, Trace, resample};
use cardiotwin_units::Ms;

use super::columns::{Choice, Chosen};
use super::rises::{ends, rises};
use super::told::{AsksFor, Choices, Learned, NotUnderstood, Signal, column_words, question};
use super::units::{TIME_UNITS, stated};

/// Accepted cycle lengths \[ms\].
const CYCLE_MS: std::ops::RangeInclusive<f64> = 200.0..=3000.0;
/// Distances between samples by which a unit of time is guessed \[ms\].
const STEP_MS: std::ops::RangeInclusive<f64> = 0.05..=60.0;
/// Fewest samples of a single beat.
const FEWEST: usize = 16;
/// Difference of the last and the first sample, over the signal's range, up to which a beat is whole,
/// unless its samples are coarser.
const OPEN: f64 = 0.15;
/// Difference of the last and the first sample, over the signal's range, below which they are one.
const SAME: f64 = 1e-6;
/// Copies of a single beat in which its beginning is looked for.
const COPIES: usize = 4;

/// Recordings, and how their times were found.
pub(super) struct Assembled {
    pub(super) recording: Recording,
    pub(super) time: (Learned, String),
    /// How the length of the only beat was found.
    pub(super) single: Option<String>,
    /// Length of the only beat \[ms\].
    pub(super) one_beat_ms: Option<f64>,
}

/// Puts the signals on a clock. A single beat is turned so that it begins at end-diastole.
pub(super) fn assemble(
    path: &Path,
    chosen: &Chosen,
    (pressure, volume): (&Signal, &Signal),
    choices: &Choices,
) -> Result<Assembled, NotUnderstood> {
    let n_rises = rises(&pressure.values).len();
    let (time_ms, time) = match &chosen.time {
        Some(choice) => told_times(path, choice, n_rises, choices)?,
        None => times_by_rate(path, &pressure.values, choices)?,
    };
    if n_rises > 1 {
        return Ok(Assembled {
            recording: recording(path, &time_ms, &pressure.values, &volume.values)?,
            time,
            single: None,
            one_beat_ms: None,
        });
    }
    let single = single(path, &time_ms, (pressure, volume), choices)?;
    Ok(Assembled { time, ..single })
}

/// Times of a column, in ms.
fn told_times(
    path: &Path,
    choice: &Choice,
    n_rises: usize,
    choices: &Choices,
) -> Result<(Vec<f64>, (Learned, String)), NotUnderstood> {
    let column = &choice.column;
    let values = &column.values;
    if let Some(row) = values
        .windows(2)
        .position(|w| w[1].is_nan() || w[0].is_nan() || w[1] <= w[0])
    {
        let problem = Problem::error(
            path,
            format!(
                "{} after {} in column `{}`",
                values[row + 1],
                values[row],
                column.label
            ),
            "increasing times",
            "sort the samples, keep one for each time, and give each recording a file of its own",
        );
        return Err(problem.into());
    }
    let span = values[values.len() - 1] - values[0];
    let step = span / (values.len() - 1) as f64;
    let (factor, unit) = if let Some(unit) = &choices.time_unit {
        let factor = stated(path, "time", unit, "--time-unit", TIME_UNITS)?;
        (factor, (Learned::Told, format!("{unit} as stated")))
    } else if let (Some(factor), Some(unit)) = (column.factor, &column.unit) {
        (factor, (Learned::Told, format!("{unit} in the header")))
    } else {
        // A recording holds at least most of a cycle.
        let fits = |factor: &f64| {
            STEP_MS.contains(&(factor * step))
                && CYCLE_MS.contains(&(factor * span / n_rises.max(1) as f64))
        };
        let units = [("ms", 1.0), ("s", 1000.0), ("us", 1e-3), ("min", 60_000.0)];
        let fitting: Vec<(&str, f64)> = units.into_iter().filter(|(_, f)| fits(f)).collect();
        let [(unit, factor)] = fitting[..] else {
            return Err(question(
                path,
                AsksFor::TimeUnit,
                format!(
                    "column `{}` without a unit, {} beats in {span}",
                    column.label,
                    n_rises.max(1)
                ),
                format!("times in {TIME_UNITS}"),
                format!(
                    "`{}` spans {span} and has no unit: {TIME_UNITS}?",
                    column.label
                ),
                "UNIT",
            ));
        };
        let why = format!("{unit} by its size (--time-unit says another)");
        (factor, (Learned::Guessed, why))
    };
    let cycle_ms = factor * span / n_rises.max(1) as f64;
    if !CYCLE_MS.contains(&cycle_ms) {
        let problem = Problem::error(
            path,
            format!(
                "{} of about {cycle_ms:.4} ms in column `{}`",
                if n_rises > 1 { "beats" } else { "a beat" },
                column.label
            ),
            format!("beats of {} to {} ms", CYCLE_MS.start(), CYCLE_MS.end()),
            "state the unit of the times (--time-unit); for numbers of samples, leave them out with \
             --sample-interval-ms",
        );
        return Err(problem.into());
    }
    let learned = match choice.learned {
        Learned::Guessed => Learned::Guessed,
        Learned::Told => unit.0,
    };
    let said = format!("{} {}, {}", column_words(&column.label), choice.why, unit.1);
    Ok((values.iter().map(|t| factor * t).collect(), (learned, said)))
}

/// Times of samples that have none: by their rate, or by the length of the beats.
fn times_by_rate(
    path: &Path,
    pressure: &[f64],
    choices: &Choices,
) -> Result<(Vec<f64>, (Learned, String)), NotUnderstood> {
    let n = pressure.len();
    let at = rises(pressure);
    let (step_ms, said) = match (choices.sample_interval_ms, choices.cycle_length_ms) {
        (Some(step_ms), _) => (step_ms, format!("a sample every {step_ms} ms as stated")),
        (None, Some(cycle_ms)) => {
            let n_steps = match (at.first(), at.last()) {
                (Some(first), Some(last)) if last > first => {
                    (last - first) as f64 / (at.len() - 1) as f64
                }
                _ => n as f64,
            };
            let what = if at.len() > 1 {
                "the mean beat"
            } else {
                "the beat"
            };
            (
                cycle_ms / n_steps,
                format!("{what} lasts {cycle_ms:.0} ms as stated"),
            )
        }
        (None, None) => {
            return Err(question(
                path,
                AsksFor::HeartRate,
                "no column of times",
                "a time, a sample interval or a heart rate",
                "there are no times: what is the heart rate per minute?",
                "PER_MINUTE, or --sample-interval-ms MS",
            ));
        }
    };
    let times = (0..n).map(|i| i as f64 * step_ms).collect();
    Ok((times, (Learned::Told, said)))
}

fn recording(
    path: &Path,
    time_ms: &[f64],
    pressure: &[f64],
    volume: &[f64],
) -> Result<Recording, NotUnderstood> {
    let channels = Channels {
        lv_pressure_mmhg: Some(pressure.to_vec()),
        lv_volume_ml: Some(volume.to_vec()),
        ..Channels::default()
    };
    Recording::new(time_ms, channels).map_err(|error| {
        Problem::error(
            path,
            error.to_string(),
            "several beats with a sample every 20 ms or more often, or a single beat",
            "export every sample, or one beat",
        )
        .into()
    })
}

/// A single beat, turned so that it begins where the pressure begins to rise.
fn single(
    path: &Path,
    time_ms: &[f64],
    (pressure, volume): (&Signal, &Signal),
    choices: &Choices,
) -> Result<Assembled, NotUnderstood> {
    let mut rows: Vec<[f64; 3]> = (0..time_ms.len())
        .map(|i| [time_ms[i], pressure.values[i], volume.values[i]])
        .filter(|row| row.iter().all(|value| value.is_finite()))
        .collect();
    let refused = |found: String, remedy: &str| -> NotUnderstood {
        Problem::error(path, found, "one whole beat, or several", remedy).into()
    };
    if rows.len() < FEWEST {
        return Err(refused(
            format!("a single beat of {} samples", rows.len()),
            "export more samples: a beat needs 16",
        ));
    }
    let share = |a: &[f64; 3], b: &[f64; 3]| {
        let of = |k: usize, signal: &Signal| {
            let (low, high) = ends(&signal.values);
            ((a[k] - b[k]) / (high - low)).abs()
        };
        of(1, pressure).max(of(2, volume))
    };
    let n = rows.len();
    let step_ms = (rows[n - 1][0] - rows[0][0]) / (n - 1) as f64;
    let open = share(&rows[n - 1], &rows[0]);
    let coarse = rows
        .windows(2)
        .map(|w| share(&w[0], &w[1]))
        .fold(0.0, f64::max);
    if open > OPEN.max(1.2 * coarse) || open.is_nan() {
        return Err(refused(
            format!(
                "a single beat whose last sample differs from the first by {:.0} % of its range",
                100.0 * open
            ),
            "export a whole beat, from any instant to the same one of the next beat",
        ));
    }
    let span_ms = rows[n - 1][0] - rows[0][0];
    let (cycle_ms, said) = if let Some(cycle_ms) = choices.cycle_length_ms {
        (cycle_ms, "as stated".to_owned())
    } else if open < SAME && share(&rows[n - 1], &rows[n - 2]) > SAME {
        // Equal samples of a still diastole are no repetition.
        rows.pop();
        (
            span_ms,
            "from the first sample to its repetition at the end".to_owned(),
        )
    } else {
        (
            span_ms + step_ms,
            "from the first sample to one step after the last".to_owned(),
        )
    };
    if !CYCLE_MS.contains(&cycle_ms) || rows[rows.len() - 1][0] - rows[0][0] > 1.02 * cycle_ms {
        return Err(refused(
            format!("a beat of {span_ms:.4} ms, and a cycle of {cycle_ms:.4} ms"),
            "correct the times or the stated cycle",
        ));
    }
    // A whole number of steps, so that copies join without a seam.
    let n_steps = cycle_ms.round();
    let even_ms = cycle_ms / n_steps;
    let begin = rows[0][0];
    let even = |k: usize, quantity| -> Result<Vec<f64>, NotUnderstood> {
        let times = rows.iter().map(|row| row[0] - begin).collect();
        let values = rows.iter().map(|row| row[k]).collect();
        Trace::new(quantity, times, values)
            .map_err(|error| error.to_string())
            .and_then(|trace| {
                let cycle = Continuation::periodic(Ms(cycle_ms));
                resample(&trace, cycle, Ms(even_ms)).map_err(|error| error.to_string())
            })
            .map(|trace| trace.values().to_vec())
            .map_err(|found| refused(found, "export one whole beat with its times"))
    };
    let (p, v) = (even(1, Quantity::Pressure)?, even(2, Quantity::Volume)?);
    let n = p.len().min(v.len());
    let copies = |values: &[f64]| {
        values
            .iter()
            .take(n)
            .cycle()
            .take(COPIES * n)
            .copied()
            .collect::<Vec<f64>>()
    };
    let clock = |n: usize| (0..n).map(|i| i as f64 * even_ms).collect::<Vec<f64>>();
    let repeated = recording(path, &clock(COPIES * n), &copies(&p), &copies(&v))?;
    let by_rise = BeatsStep {
        source: Some(BeatSource::PressureRise),
        ..BeatsStep::default()
    };
    let found = find(&repeated, &by_rise)
        .map_err(|error| refused(error.to_string(), "check that it is a ventricle's pressure"))?;
    let first = found.beats.first().map_or(0.0, |beat| beat.onset_ms);
    let turn = (first / even_ms).round() as usize % n;
    // One sample more than a cycle: the beat ends where the next one begins.
    let turned = |values: &[f64]| {
        (0..=n)
            .map(|i| values[(turn + i) % n])
            .collect::<Vec<f64>>()
    };
    Ok(Assembled {
        recording: recording(path, &clock(n + 1), &turned(&p), &turned(&v))?,
        time: (Learned::Told, String::new()),
        single: Some(said),
        one_beat_ms: Some(n as f64 * even_ms),
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A beat that begins at end-diastole, in `n` samples: pressure in mmHg, volume in mL. Its ejection
    /// lasts from 0.1 to 0.4 of the cycle.
    pub(in super::super) fn beat(n: usize) -> Vec<(f64, f64)> {
        let smooth = |x: f64| {
            let x = x.clamp(0.0, 1.0);
            x * x * (3.0 - 2.0 * x)
        };
        let at = |t: f64| {
            let up = smooth(t / 0.12) * (1.0 - smooth((t - 0.36) / 0.14));
            let active =
                100.0 * up + 12.0 * up * (std::f64::consts::PI * (t - 0.1) / 0.3).sin().max(0.0);
            let out = smooth((t - 0.09) / 0.3) - smooth((t - 0.5) / 0.45);
            (6.0 + active, 120.0 - 65.0 * out)
        };
        (0..n).map(|i| at(i as f64 / n as f64)).collect()
    }

    fn read(text: &str, choices: &Choices) -> Result<super::super::read::OwnTraces, NotUnderstood> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("own.csv");
        std::fs::write(&path, text).unwrap();
        super::super::read::read(&path, choices)
    }

    fn problem(text: &str, choices: &Choices) -> Problem {
        match read(text, choices) {
            Err(NotUnderstood::Problems(problems)) => problems[0].clone(),
            Err(NotUnderstood::Question(question)) => question.problem,
            Ok(traces) => panic!("{traces:?}"),
        }
    }

    fn rows(n: usize, times: usize, row: impl Fn(usize, (f64, f64)) -> String) -> String {
        let beat = beat(n);
        let rows = (0..n * times).map(|i| row(i, beat[i % n]) + "\n");
        "t,LVP,LVV\n".to_owned() + &rows.collect::<String>()
    }

    #[test]
    fn a_single_beat_begins_at_end_diastole_wherever_the_file_begins() {
        let beat = beat(160);
        for shift in [0, 30, 110] {
            let text: String = (0..160)
                .map(|i| {
                    let (p, v) = beat[(i + shift) % 160];
                    format!("{},{p},{v}\n", 0.005 * i as f64)
                })
                .collect();
            let traces = read(&format!("t,LVP,LVV\n{text}"), &Choices::default()).unwrap();
            let channels = &traces.raw.recording.channels;
            let (p, v) = (
                channels.lv_pressure_mmhg.as_ref().unwrap(),
                channels.lv_volume_ml.as_ref().unwrap(),
            );
            assert_eq!(p.len(), 801);
            assert!((p[0] - 6.0).abs() < 1.5, "{shift}: {}", p[0]);
            assert!((v[0] - 120.0).abs() < 1.0, "{shift}: {}", v[0]);
            assert_eq!(traces.raw.file.steps.beats.onsets_ms, [0.0, 800.0]);
            assert_eq!(
                traces.single.as_deref(),
                Some("from the first sample to one step after the last")
            );
            assert!(traces.time.1.contains("s by its size"), "{}", traces.time.1);
        }
    }

    #[test]
    fn a_repeated_first_sample_ends_the_cycle() {
        let beat = beat(100);
        let text: String = (0..=100)
            .map(|i| {
                let (p, v) = beat[(i + 20) % 100];
                format!("{},{p},{v}\n", 8 * i)
            })
            .collect();
        let traces = read(&format!("t_ms,LVP,LVV\n{text}"), &Choices::default()).unwrap();
        assert_eq!(traces.raw.file.steps.beats.onsets_ms[1], 800.0);
    }

    #[test]
    fn many_beats_stay_a_recording_and_give_their_mean() {
        let text = rows(200, 8, |i, (p, v)| format!("{},{p},{v}", 4 * i));
        let traces = read(&text, &Choices::default()).unwrap();
        assert!(traces.single.is_none());
        let made = crate::preparation::make(&traces.raw, "P001").unwrap();
        assert!((made.answer.cycle_length_ms - 800.0).abs() < 1.0);
        let volume = made.prepared.volume.as_ref().unwrap();
        assert!(volume.on_pressure_clock);
        assert!((volume.synchronised.at(0.0) - 120.0).abs() < 1.0);
        assert!(
            made.answer
                .patient_toml
                .starts_with("# Made by `cardiotwin init --from`")
        );
        let volume = made
            .answer
            .steps
            .iter()
            .find(|s| s.step == "synchronise")
            .unwrap();
        assert_eq!(
            volume.what,
            "the volume was recorded with the pressure: unchanged"
        );
    }

    #[test]
    fn without_times_a_heart_rate_or_an_interval_is_needed() {
        let text = rows(200, 6, |_, (p, v)| format!("{p},{v}")).replace("t,", "");
        assert_eq!(
            problem(&text, &Choices::default()).found,
            "no column of times"
        );
        let by_rate = AsksFor::HeartRate
            .answered("75", Choices::default())
            .unwrap();
        assert_eq!(read(&text, &by_rate).unwrap().raw.recording.step_ms, 4.0);
        let by_interval = Choices {
            sample_interval_ms: Some(4.0),
            ..Choices::default()
        };
        assert_eq!(
            read(&text, &by_interval).unwrap().raw.recording.step_ms,
            4.0
        );
        assert!(
            AsksFor::HeartRate
                .answered("fast", Choices::default())
                .is_err()
        );
    }

    #[test]
    fn what_is_no_beat_is_refused() {
        let half = rows(200, 1, |i, (p, v)| format!("{},{p},{v}", 4 * i));
        let half: String = half
            .lines()
            .take(70)
            .map(|line| format!("{line}\n"))
            .collect();
        assert!(
            problem(&half, &Choices::default())
                .found
                .contains("whose last sample differs")
        );
        let few = rows(12, 1, |i, (p, v)| format!("{},{p},{v}", 70 * i));
        let stated = Choices {
            time_unit: Some("ms".into()),
            ..Choices::default()
        };
        assert_eq!(problem(&few, &stated).found, "a single beat of 12 samples");
        let samples = rows(100, 6, |i, (p, v)| format!("{i},{p},{v}"));
        assert!(
            problem(&samples, &Choices::default())
                .remedy
                .contains("--time-unit")
        );
        let backwards = rows(200, 1, |i, (p, v)| {
            format!("{},{p},{v}", if i == 9 { 0 } else { i })
        });
        assert!(
            problem(&backwards, &Choices::default())
                .expected
                .contains("increasing")
        );
    }
}
