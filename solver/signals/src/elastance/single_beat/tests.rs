use super::super::model_heart::{Arterial, Heart, hearts};
use super::*;
use crate::{Continuation, Quantity, Trace};
use cardiotwin_units::Ms;

/// Time by which QRS begins before the pressure's rise: 31 to 52 ms in recordings (docs/measurements/prepare.md).
const DELAY_MS: f64 = 40.0;

fn recording(beat: &Beat, arterial: Arterial) -> Recording<'_> {
    Recording {
        beat,
        qrs_begins_ms: Some(-DELAY_MS),
        arterial_systolic_mmhg: Some(arterial.systolic_mmhg),
        arterial_diastolic_mmhg: Some(arterial.diastolic_mmhg),
    }
}

#[test]
fn chen_has_the_value_that_the_public_program_gives() {
    // lv_elast(rtonset = 0.08, rtend = 0.36, ef = 0.6, dbp = 78, sbp = 124, sv = 72), evaluated apart from this program.
    let estimate = normalised_elastance::Estimate::from_inputs(normalised_elastance::Inputs {
        pre_ejection_ms: 80.0,
        ejection_ms: 280.0,
        ejection_fraction: 0.6,
        stroke_volume_ml: 72.0,
        arterial_systolic_mmhg: 124.0,
        arterial_diastolic_mmhg: 78.0,
    })
    .unwrap();
    assert!(
        (estimate.elastance_mmhg_per_ml - 1.5835481915).abs() < 1e-9,
        "{estimate:?}"
    );
    // The elastance curve that it stands for passes through the onset of ejection.
    let end_systolic = 0.9 * 124.0;
    let stretched_ml = 72.0 + end_systolic / estimate.elastance_mmhg_per_ml;
    let at_onset = estimate.normalised_elastance * estimate.elastance_mmhg_per_ml * stretched_ml;
    assert!((at_onset - 78.0).abs() < 1e-9, "{at_onset}");
}

#[test]
fn chen_is_within_its_published_scatter_except_in_strong_hearts() {
    for heart in hearts() {
        let beat = heart.beat();
        let estimate =
            normalised_elastance::Estimate::of(&recording(&beat, heart.arterial())).unwrap();
        let missed = heart.elastance_mmhg_per_ml - estimate.expected_mmhg_per_ml();
        let allowed = 2.0 * normalised_elastance::STANDARD_ERROR_MMHG_PER_ML;
        if heart.elastance_mmhg_per_ml <= 2.3 {
            assert!(missed.abs() < allowed, "{heart:?}: {missed} {estimate:?}");
        } else {
            // In models of the circulation it underestimates strong hearts: 1.54 for 2.5 mmHg/mL (Di Molfetta et al. 2021,
            // Cardiovasc Eng Technol, abstract), and so it does here.
            assert!(missed > allowed, "{heart:?}: {missed} {estimate:?}");
        }
    }
}

#[test]
fn the_bilinear_estimate_holds_where_heart_and_arteries_match() {
    let (mut n_near, mut n_none) = (0, 0);
    for heart in hearts() {
        let beat = heart.beat();
        let arterial = heart.arterial();
        let found = bilinear::Estimate::of(&recording(&beat, arterial));
        let true_point = super::super::end_systole(&beat, heart.intercept_ml).unwrap();
        let true_coupling = heart.elastance_mmhg_per_ml
            / super::super::arterial::arterial_elastance_mmhg_per_ml(&beat, true_point);
        match found {
            Ok(estimate) if true_coupling < 1.6 => {
                let ratio = estimate.elastance_mmhg_per_ml / heart.elastance_mmhg_per_ml;
                assert!((ratio - 1.0).abs() < 0.2, "{true_coupling} {estimate:?}");
                n_near += 1;
            }
            // Stronger hearts are overestimated.
            Ok(estimate) => {
                assert!(estimate.elastance_mmhg_per_ml > heart.elastance_mmhg_per_ml);
            }
            Err(SingleBeatError::OutOfRange { .. }) => {
                assert!(true_coupling < 1.1, "{true_coupling} {heart:?}");
                n_none += 1;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(n_near >= 6 && n_none > 0, "{n_near} {n_none}");
}

#[test]
fn the_isovolumic_estimate_orders_hearts_but_is_off_by_up_to_a_factor() {
    for chunk in hearts().chunks(9).collect::<Vec<_>>().windows(2) {
        for (weak, strong) in chunk[0].iter().zip(chunk[1]) {
            let [a, b] = [weak, strong].map(|heart| {
                let estimate = isovolumic_maximum::Estimate::of(&heart.beat()).unwrap();
                let ratio = estimate.elastance_mmhg_per_ml / heart.elastance_mmhg_per_ml;
                assert!(
                    (0.6..2.4).contains(&ratio),
                    "{heart:?}: {ratio} {estimate:?}"
                );
                if (1.5..=2.3).contains(&heart.elastance_mmhg_per_ml) {
                    assert!((ratio - 1.0).abs() < 0.45, "{heart:?}: {ratio}");
                }
                estimate.elastance_mmhg_per_ml
            });
            assert!(b > a, "{weak:?} {a} {b}");
        }
    }
}

/// A beat whose isovolumic pressure is a polynomial of the fourth degree, cut off by ejection.
#[test]
fn a_polynomial_isovolumic_pressure_is_bridged_exactly() {
    let s = |t: f64| (t - 50.0) / 400.0;
    let isovolumic = |t: f64| {
        let s = s(t).clamp(0.0, 1.0);
        6.0 + 200.0 * 16.0 * s * s * (1.0 - s) * (1.0 - s)
    };
    let pressure = (0..800)
        .map(|t| isovolumic(f64::from(t)).min(126.0))
        .collect();
    let volume = (0..800)
        .map(|t| match s(f64::from(t)) {
            s if s < 0.28 => 120.0,
            s if s < 0.72 => 120.0 - 60.0 * (s - 0.28) / 0.44,
            s if s < 1.0 => 60.0,
            s => (60.0 + 100.0 * (s - 1.0)).min(120.0),
        })
        .collect();
    let beat = Beat::of(
        &Trace::uniform(Quantity::Pressure, 1.0, pressure).unwrap(),
        &Trace::uniform(Quantity::Volume, 1.0, volume).unwrap(),
        Continuation::periodic(Ms(800.0)),
    )
    .unwrap();
    let estimate = isovolumic_maximum::Estimate::of(&beat).unwrap();
    assert!(
        (estimate.isovolumic_mmhg - 206.0).abs() < 1e-3,
        "{estimate:?}"
    );
    assert!(
        (estimate.isovolumic_peak_ms - 250.0).abs() < 0.2,
        "{estimate:?}"
    );
    let line = |v: f64| estimate.elastance_mmhg_per_ml * (v - estimate.intercept_ml);
    assert!((line(120.0) - 206.0).abs() < 1e-3, "{estimate:?}");
    let point = estimate.end_systole;
    assert!(
        (line(point.volume_ml) - point.pressure_mmhg).abs() < 1e-6,
        "{estimate:?}"
    );
}

#[test]
fn a_missing_measurement_is_named() {
    let heart = Heart::default();
    let (beat, arterial) = (heart.beat(), heart.arterial());
    let full = recording(&beat, arterial);
    let missing = |measurement| Some(SingleBeatError::Missing { measurement });
    let chen = |recording| normalised_elastance::Estimate::of(&recording).err();
    assert_eq!(chen(full), None);
    let without_qrs = Recording {
        qrs_begins_ms: None,
        ..full
    };
    assert_eq!(chen(without_qrs), missing(Measurement::QrsBegin));
    let without_systolic = Recording {
        arterial_systolic_mmhg: None,
        ..full
    };
    assert_eq!(
        chen(without_systolic),
        missing(Measurement::ArterialSystolicPressure)
    );
    let without_diastolic = Recording {
        arterial_diastolic_mmhg: None,
        ..full
    };
    assert_eq!(
        bilinear::Estimate::of(&without_diastolic).err(),
        missing(Measurement::ArterialDiastolicPressure)
    );
    assert_eq!(
        missing(Measurement::QrsBegin).unwrap().to_string(),
        "the begin of the QRS complex is missing"
    );
    let late = Recording {
        qrs_begins_ms: Some(400.0),
        ..full
    };
    assert!(matches!(
        chen(late),
        Some(SingleBeatError::OutOfRange { .. })
    ));
}
