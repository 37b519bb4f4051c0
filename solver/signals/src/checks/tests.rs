use super::*;
use crate::{Quantity, Trace};
use cardiotwin_units::{Ml, Mmhg};
use proptest::prelude::*;
use std::f64::consts::PI;
use std::path::Path;

const CYCLE_MS: f64 = 800.0;

fn pressure_at(t: f64) -> f64 {
    8.0 + if (40.0..340.0).contains(&t) {
        112.0 * (PI * (t - 40.0) / 300.0).sin().powi(2)
    } else {
        0.0
    }
}

fn volume_at(t: f64) -> f64 {
    let fall = ((t - 90.0) / 220.0).clamp(0.0, 1.0);
    let rise = ((t - 380.0) / 300.0).clamp(0.0, 1.0);
    130.0 - 75.0 * (0.5 - 0.5 * (PI * fall).cos()) + 75.0 * (0.5 - 0.5 * (PI * rise).cos())
}

/// A patient without problems, to be spoilt by each test.
struct Patient {
    cycle_length_ms: f64,
    pressure: (f64, Vec<f64>),
    volume: (f64, Vec<f64>),
    edp: f64,
    atrial: f64,
    forward: f64,
    accepted: Vec<String>,
}

fn sample(step: f64, length: f64, f: impl Fn(f64) -> f64) -> (f64, Vec<f64>) {
    (
        step,
        (0..(length / step).round() as usize)
            .map(|i| f(i as f64 * step))
            .collect(),
    )
}

impl Default for Patient {
    fn default() -> Self {
        Self {
            cycle_length_ms: CYCLE_MS,
            pressure: sample(1.0, CYCLE_MS, pressure_at),
            volume: sample(CYCLE_MS / 30.0, CYCLE_MS, volume_at),
            edp: 8.0,
            atrial: 6.0,
            forward: 74.0,
            accepted: Vec::new(),
        }
    }
}

impl Patient {
    fn problems(&self) -> Vec<Problem> {
        let pressure =
            Trace::uniform(Quantity::Pressure, self.pressure.0, self.pressure.1.clone()).unwrap();
        let volume =
            Trace::uniform(Quantity::Volume, self.volume.0, self.volume.1.clone()).unwrap();
        check(&Measured {
            patient_file: Path::new("patient.toml"),
            cycle_length: Ms(self.cycle_length_ms),
            pressure: Some(Source {
                file: Path::new("pressure.csv"),
                trace: &pressure,
            }),
            volume: Some(Source {
                file: Path::new("volume.csv"),
                trace: &volume,
            }),
            end_diastolic_pressure: Some(Mmhg(self.edp)),
            left_atrial_pressure: Some(Mmhg(self.atrial)),
            forward_stroke_volume: Some(MeasuredVolume {
                volume: Ml(self.forward),
                sd: Ml(5.0),
            }),
            accepted: &self.accepted,
        })
    }

    /// The one problem that a spoilt patient has.
    #[track_caller]
    fn only(&self) -> Problem {
        let problems = self.problems();
        assert_eq!(problems.len(), 1, "{problems:#?}");
        problems.into_iter().next().unwrap()
    }
}

fn scaled(trace: (f64, Vec<f64>), factor: f64, offset: f64) -> (f64, Vec<f64>) {
    (
        trace.0,
        trace.1.into_iter().map(|v| v * factor + offset).collect(),
    )
}

#[test]
fn a_sound_patient_has_no_problem() {
    assert_eq!(Patient::default().problems(), []);
}

#[test]
fn cycle_length_that_disagrees_with_the_trace() {
    let p = Patient {
        cycle_length_ms: 900.0,
        ..Patient::default()
    }
    .problems();
    assert_eq!(p.len(), 2, "{p:#?}");
    assert!(
        p.iter()
            .all(|p| p.is_error() && p.remedy.contains("cycle_length_ms"))
    );
    assert!(p[0].found.contains("800.0 ms"), "{}", p[0]);
    let seconds = Patient {
        cycle_length_ms: 0.8,
        ..Patient::default()
    }
    .only();
    assert!(seconds.remedy.contains("seconds"), "{seconds}");
}

#[test]
fn pressure_and_volume_of_different_cycles() {
    let volume = sample(24.0, 720.0, |t| volume_at(t * CYCLE_MS / 720.0));
    let p = Patient {
        volume,
        ..Patient::default()
    }
    .problems();
    assert!(
        p.iter().any(|p| p
            .found
            .contains("720 ms of volume against 800 ms of pressure")),
        "{p:#?}"
    );
}

#[test]
fn frames_and_catheter_samples_may_differ() {
    for n in [20, 25, 30, 40] {
        let volume = sample(CYCLE_MS / f64::from(n), CYCLE_MS, volume_at);
        assert_eq!(
            Patient {
                volume,
                ..Patient::default()
            }
            .problems(),
            [],
            "{n} frames"
        );
    }
}

#[test]
fn a_closing_sample_is_no_problem() {
    let mut patient = Patient::default();
    patient.pressure.1.push(8.0);
    patient.volume.1.push(130.0);
    assert_eq!(patient.problems(), []);
}

#[test]
fn times_in_seconds() {
    let mut patient = Patient::default();
    patient.pressure.0 /= 1000.0;
    let p = patient.only();
    assert!(
        p.is_error() && p.remedy.contains("look like seconds"),
        "{p}"
    );
}

#[test]
fn pressures_in_other_units() {
    for (per_mmhg, unit) in [(0.133322, "kPa"), (133.322, " Pa "), (1.33322e-3, "bar")] {
        let patient = Patient {
            pressure: scaled(Patient::default().pressure, per_mmhg, 0.0),
            ..Patient::default()
        };
        let p = patient.only();
        assert!(
            p.remedy.contains(unit) && p.remedy.contains("120 mmHg"),
            "{p}"
        );
    }
}

#[test]
fn volumes_in_other_units() {
    for (per_ml, unit) in [(1e-3, "litres"), (1e3, "mm3")] {
        let patient = Patient {
            volume: scaled(Patient::default().volume, per_ml, 0.0),
            ..Patient::default()
        };
        let p = patient.only();
        assert!(
            p.remedy.contains(unit) && p.remedy.contains("130 mL"),
            "{p}"
        );
    }
}

#[test]
fn swapped_files() {
    let pressure = sample(1.0, CYCLE_MS, volume_at);
    let volume = sample(CYCLE_MS / 30.0, CYCLE_MS, pressure_at);
    let p = Patient {
        pressure,
        volume,
        ..Patient::default()
    }
    .only();
    assert!(p.remedy.contains("swapped"), "{p}");
}

#[test]
fn volumes_in_a_pressure_file() {
    let p = Patient {
        pressure: sample(1.0, CYCLE_MS, volume_at),
        ..Patient::default()
    }
    .only();
    assert!(p.remedy.contains("looks like a volume"), "{p}");
}

#[test]
fn pressures_in_a_volume_file() {
    let volume = sample(CYCLE_MS / 30.0, CYCLE_MS, pressure_at);
    let p = Patient {
        volume,
        ..Patient::default()
    }
    .only();
    assert!(p.remedy.contains("looks like a pressure"), "{p}");
}

#[test]
fn a_volume_that_never_ejects() {
    let p = Patient {
        volume: sample(CYCLE_MS / 30.0, CYCLE_MS, |_| 120.0),
        ..Patient::default()
    }
    .only();
    assert!(p.is_error() && p.remedy.contains("never ejects"), "{p}");
}

#[test]
fn negative_volumes() {
    let p = Patient {
        volume: scaled(Patient::default().volume, 1.0, -80.0),
        ..Patient::default()
    }
    .only();
    assert!(p.is_error() && p.found.contains("at or below zero"), "{p}");
}

#[test]
fn pressure_offset() {
    let with_offset = |offset: f64| Patient {
        pressure: scaled(Patient::default().pressure, 1.0, offset),
        edp: 8.0 + offset,
        atrial: offset,
        ..Patient::default()
    };
    // An effect of the catalogue explains it, so the search may tell which.
    let p = with_offset(-30.0).only();
    assert!(
        !p.is_error() && p.found.contains("-22.0 mmHg") && p.remedy.contains("catheter_response"),
        "{p}"
    );
    let mut broken = Patient::default();
    let values = &mut broken.pressure.1;
    let least = (0..values.len()).min_by(|a, b| values[*a].total_cmp(&values[*b]));
    values[least.unwrap()] = -100.0;
    let p = broken.only();
    assert!(p.is_error() && p.found.contains("-100.0 mmHg"), "{p}");
    let p = with_offset(-17.0).only();
    assert!(!p.is_error() && p.found.contains("-9.0 mmHg"), "{p}");
}

#[test]
fn atrial_pressure_above_the_end_diastolic_one() {
    let p = Patient {
        atrial: 9.5,
        ..Patient::default()
    }
    .only();
    assert!(
        !p.is_error()
            && p.found
                .contains("9.5 mmHg, above the end-diastolic pressure of 8.0"),
        "{p}"
    );
    assert_eq!(p.key.as_deref(), Some("preload.left_atrial_pressure_mmHg"));
}

#[test]
fn atrial_pressure_in_kilopascals() {
    let of = |atrial| {
        Patient {
            atrial,
            ..Patient::default()
        }
        .only()
    };
    let p = of(1.0);
    assert!(
        !p.is_error() && p.found.contains("far below the end-diastolic pressure"),
        "{p}"
    );
    assert!(p.remedy.contains("in kPa, 7.5 mmHg"), "{p}");
    assert!(!of(0.1).remedy.contains("kPa"));
}

#[test]
fn end_diastolic_pressure_far_from_the_trace() {
    let p = Patient {
        edp: 14.0,
        ..Patient::default()
    }
    .only();
    assert!(
        !p.is_error() && p.found.contains("14 mmHg, and 8.0 mmHg at time 0"),
        "{p}"
    );
    assert!(
        Patient {
            edp: 40.0,
            ..Patient::default()
        }
        .only()
        .is_error()
    );
}

#[test]
fn ejection_before_the_pressure_rises() {
    let rotated = |shift: f64| {
        sample(CYCLE_MS / 30.0, CYCLE_MS, |t| {
            volume_at((t + shift).rem_euclid(CYCLE_MS))
        })
    };
    let slightly = Patient {
        volume: rotated(100.0),
        ..Patient::default()
    }
    .only();
    assert!(
        !slightly.is_error() && slightly.remedy.contains("shifted against each other"),
        "{slightly}"
    );
    let inverted = Patient {
        volume: rotated(400.0),
        ..Patient::default()
    }
    .only();
    assert!(
        inverted.is_error() && inverted.expected.contains("ejected in between"),
        "{inverted}"
    );
}

#[test]
fn a_beat_that_begins_in_systole() {
    let pressure = sample(1.0, CYCLE_MS, |t| {
        pressure_at((t + 180.0).rem_euclid(CYCLE_MS))
    });
    let volume = sample(CYCLE_MS / 30.0, CYCLE_MS, |t| {
        volume_at((t + 180.0).rem_euclid(CYCLE_MS))
    });
    let p = Patient {
        pressure,
        volume,
        edp: 119.0,
        ..Patient::default()
    }
    .only();
    assert!(
        p.is_error() && p.expected.contains("begins in diastole"),
        "{p}"
    );
}

#[test]
fn stroke_volume_against_forward_stroke_volume() {
    let leak = Patient {
        forward: 50.0,
        ..Patient::default()
    }
    .only();
    assert!(
        !leak.is_error() && leak.remedy.contains("regurgitation"),
        "{leak}"
    );
    let small = Patient {
        forward: 110.0,
        ..Patient::default()
    }
    .only();
    assert!(
        !small.is_error() && small.remedy.contains("scale of the volumes"),
        "{small}"
    );
    assert!(
        Patient {
            forward: 0.074,
            ..Patient::default()
        }
        .only()
        .is_error()
    );
    assert!(
        Patient {
            forward: -1.0,
            ..Patient::default()
        }
        .only()
        .is_error()
    );
}

#[test]
fn each_comparison_can_be_accepted_by_its_name() {
    let rolled = |shift: f64| {
        (
            sample(1.0, CYCLE_MS, |t| {
                pressure_at((t + shift).rem_euclid(CYCLE_MS))
            }),
            sample(CYCLE_MS / 30.0, CYCLE_MS, |t| {
                volume_at((t + shift).rem_euclid(CYCLE_MS))
            }),
        )
    };
    let (pressure, volume) = rolled(180.0);
    let (_, late) = rolled(400.0);
    for (rule, patient) in [
        (
            "end-diastolic-pressure",
            Patient {
                edp: 40.0,
                ..Patient::default()
            },
        ),
        (
            "end-diastolic-pressure",
            Patient {
                edp: 14.0,
                ..Patient::default()
            },
        ),
        (
            "forward-volume",
            Patient {
                forward: 0.074,
                ..Patient::default()
            },
        ),
        (
            "forward-volume",
            Patient {
                forward: 50.0,
                ..Patient::default()
            },
        ),
        (
            "ejection",
            Patient {
                volume: late,
                ..Patient::default()
            },
        ),
        (
            "beat-begin",
            Patient {
                pressure,
                volume,
                edp: 119.0,
                ..Patient::default()
            },
        ),
    ] {
        let problem = patient.only();
        let how = format!("accept = [{rule:?}]");
        assert!(problem.remedy.ends_with(&how), "{problem}");
        let accepting = Patient {
            accepted: vec![rule.to_owned()],
            ..patient
        };
        assert_eq!(accepting.problems(), [], "{rule}");
    }
}

#[test]
fn too_few_samples() {
    let coarse = Patient {
        volume: sample(CYCLE_MS / 12.0, CYCLE_MS, volume_at),
        ..Patient::default()
    }
    .only();
    assert!(
        !coarse.is_error() && coarse.found == "12 samples",
        "{coarse}"
    );
    let fewest = Patient {
        volume: sample(CYCLE_MS / 5.0, CYCLE_MS, volume_at),
        ..Patient::default()
    }
    .problems();
    assert!(
        fewest
            .iter()
            .any(|p| p.is_error() && p.found == "5 samples"),
        "{fewest:#?}"
    );
    let pressure = Patient {
        pressure: sample(40.0, CYCLE_MS, pressure_at),
        ..Patient::default()
    }
    .problems();
    assert!(
        pressure
            .iter()
            .any(|p| p.is_error() && p.found == "20 samples"),
        "{pressure:#?}"
    );
}

#[test]
fn all_problems_at_once() {
    let patient = Patient {
        pressure: scaled(Patient::default().pressure, 1.0, -60.0),
        volume: scaled(Patient::default().volume, 1e-3, 0.0),
        cycle_length_ms: 900.0,
        ..Patient::default()
    };
    let p = patient.problems();
    assert_eq!(p.iter().filter(|p| p.is_error()).count(), 4, "{p:#?}");
}

proptest! {
    /// No trace, however odd, makes the checks panic, and errors come before warnings.
    #[test]
    fn any_trace_is_survived(
        p in prop::collection::vec(-1e5..1e5f64, 2..200), v in prop::collection::vec(-1e3..1e6f64, 2..60),
        step in 1e-3..50.0f64, cycle_length_ms in -10.0..5000.0f64,
    ) {
        let patient = Patient { pressure: (step, p), volume: (20.0 * step, v), cycle_length_ms, ..Patient::default() };
        let problems = patient.problems();
        prop_assert!(problems.windows(2).all(|w| w[0].severity <= w[1].severity));
    }
}
