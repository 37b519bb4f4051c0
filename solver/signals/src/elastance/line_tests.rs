use super::super::model_heart::{CYCLE_MS, Heart, hearts};
use super::*;
use crate::{Continuation, Quantity, Trace, noise_windows};
use cardiotwin_units::Ms;

/// The heart with less filling and with a lower peripheral resistance, the two kinds of virtual load.
fn other_load(heart: Heart, filling: f64, resistance: f64) -> Heart {
    Heart {
        filling_mmhg: filling * heart.filling_mmhg,
        peripheral_mmhg_s_per_ml: resistance * heart.peripheral_mmhg_s_per_ml,
        ..heart
    }
}

#[test]
fn two_loads_find_elastance_and_intercept_of_model_hearts() {
    for heart in hearts() {
        for (filling, resistance) in [(0.8, 1.0), (1.0, 0.75), (1.2, 1.25)] {
            let beats = [heart.beat(), other_load(heart, filling, resistance).beat()];
            let line = EndSystolicLine::through(&beats).unwrap();
            let error = line.elastance_mmhg_per_ml / heart.elastance_mmhg_per_ml - 1.0;
            let shift_ml = line.intercept_ml - heart.intercept_ml;
            assert!(
                error.abs() < 0.05 && shift_ml.abs() < 0.05 * beats[0].stroke_volume_ml(),
                "{heart:?}: {error} {shift_ml}"
            );
            assert_eq!(line.standard_errors, None);
        }
    }
}

/// A weak heart still ejects when it is stiffest, and loses pressure to its resistance then.
#[test]
fn an_internal_resistance_lowers_the_elastance_of_weak_hearts_a_little() {
    for (elastance, allowed) in [(0.8, 0.1), (1.5, 0.06), (2.3, 0.05), (4.0, 0.05)] {
        let heart = Heart {
            elastance_mmhg_per_ml: elastance,
            internal_mmhg_s_per_ml: 0.05,
            ..Heart::default()
        };
        for (filling, resistance) in [(0.8, 1.0), (1.0, 0.75), (0.8, 0.75)] {
            let beats = [heart.beat(), other_load(heart, filling, resistance).beat()];
            let line = EndSystolicLine::through(&beats).unwrap();
            let error = line.elastance_mmhg_per_ml / elastance - 1.0;
            assert!(error.abs() < allowed, "{elastance}: {error}");
        }
    }
}

#[test]
fn standard_errors_hold_the_truth_where_each_beat_is_read_a_little_wrong() {
    let heart = Heart::default();
    let fillings_and_gains = [
        (1.0, 1.01),
        (0.9, 0.985),
        (0.8, 1.015),
        (0.7, 0.99),
        (0.6, 1.005),
    ];
    let beats = fillings_and_gains.map(|(filling, gain)| {
        let (pressure, volume) = other_load(heart, filling, 1.0).traces();
        let values = pressure.values().iter().map(|p| gain * p).collect();
        let pressure = Trace::uniform(Quantity::Pressure, 1.0, values).unwrap();
        Beat::of(&pressure, &volume, Continuation::periodic(Ms(CYCLE_MS))).unwrap()
    });
    let line = EndSystolicLine::through(&beats).unwrap();
    let [slope, intercept_ml] = line.standard_errors.unwrap();
    let error = (line.elastance_mmhg_per_ml - heart.elastance_mmhg_per_ml).abs();
    let shift_ml = (line.intercept_ml - heart.intercept_ml).abs();
    assert!(
        error < 2.0 * slope && shift_ml < 2.0 * intercept_ml,
        "{line:?}"
    );
    // Pressures are wrong by 1 % in mean, over a range of 40 %: some percent of Ees.
    assert!(slope > 0.01 * line.elastance_mmhg_per_ml, "{line:?}");
    assert!(slope < 0.1 * line.elastance_mmhg_per_ml, "{line:?}");
    assert_eq!(line.points.len(), beats.len());
}

/// Noise of a catheter (1 mmHg) and of a cine every 27 ms (1 mL), over the windows that it asks for.
#[test]
fn noisy_traces_of_two_loads_find_the_elastance() {
    let mut state = 7u64;
    let mut normal = || {
        (0..12)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) as f64 / (1u64 << 31) as f64
            })
            .sum::<f64>()
            - 6.0
    };
    let heart = Heart::default();
    let continuation = Continuation::periodic(Ms(CYCLE_MS));
    let mut errors = vec![];
    for _ in 0..10 {
        let beats = [(1.0, 1.0), (0.7, 0.9)].map(|(filling, resistance)| {
            let (pressure, volume) = other_load(heart, filling, resistance).traces();
            let values = pressure.values().iter().map(|p| p + normal()).collect();
            let pressure = Trace::uniform(Quantity::Pressure, 1.0, values).unwrap();
            let step_ms = CYCLE_MS / 30.0;
            let frames = (0..30).map(|k| volume.at(f64::from(k) * step_ms) + normal());
            let frames = Trace::uniform(Quantity::Volume, step_ms, frames.collect()).unwrap();
            let windows = noise_windows::of(Some(&pressure), Some(&frames), continuation);
            assert!(windows.pressure_ms.is_some());
            Beat::over(&pressure, &frames, continuation, windows).unwrap()
        });
        let line = EndSystolicLine::through(&beats).unwrap();
        errors.push(line.elastance_mmhg_per_ml / heart.elastance_mmhg_per_ml - 1.0);
    }
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    assert!(rms < 0.07, "{errors:?}");
}

#[test]
fn stroke_work_rises_with_filling_and_with_contractility() {
    let slope_of = |elastance: f64| {
        let heart = Heart {
            elastance_mmhg_per_ml: elastance,
            ..Heart::default()
        };
        let beats: Vec<Beat> = [1.0, 0.9, 0.8, 0.7]
            .map(|filling| other_load(heart, filling, 1.0).beat())
            .into();
        PreloadRecruitableStrokeWork::through(&beats).unwrap()
    };
    let (weak, strong) = (slope_of(1.2), slope_of(2.4));
    assert!(
        strong.slope_mmhg > 1.2 * weak.slope_mmhg,
        "{weak:?} {strong:?}"
    );
    // Linear in filling, as in the publication: the error of the slope is small.
    assert!(
        strong.standard_errors.unwrap()[0] < 0.1 * strong.slope_mmhg,
        "{strong:?}"
    );
}

#[test]
fn beats_that_make_no_line_say_why() {
    let heart = Heart::default();
    let beat = heart.beat();
    assert_eq!(
        EndSystolicLine::through(std::slice::from_ref(&beat)),
        Err(LineError::TooFewBeats { n_beats: 1 })
    );
    assert!(matches!(
        EndSystolicLine::through(&[beat.clone(), beat.clone()]),
        Err(LineError::SameLoad {
            argument: "the end-systolic volume",
            ..
        })
    ));
    assert!(matches!(
        PreloadRecruitableStrokeWork::through(&[beat.clone(), beat.clone()]),
        Err(LineError::SameLoad {
            argument: "the end-diastolic volume",
            ..
        })
    ));
    // A weaker heart is no other load: it ends systole fuller at a lower pressure.
    let weaker = Heart {
        elastance_mmhg_per_ml: 1.2,
        ..heart
    };
    assert!(matches!(
        EndSystolicLine::through(&[beat, weaker.beat()]),
        Err(LineError::NotRising { .. })
    ));
}
