//! Cases made by the model that is fitted (inverse crime: these show that the search works, not that it is right).

use cardiotwin_discover::forward::{Forward, Prediction, Request};
use cardiotwin_discover::locate::Phases;
use cardiotwin_discover::measured::{
    Cuff, GivenLoads, Measured, SideData, StatedNoise, Uncertain, WholeHeart,
};
use cardiotwin_discover::noise::ModelDiscrepancy;
use cardiotwin_discover::problem::{Data, Problem};
use cardiotwin_discover::search::fit_base;
use cardiotwin_discover::{Discovery, Reduced, Settings, discover};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

const CYCLE_MS: f64 = 850.0;

/// A patient whose priors the base values come from: a half sine of pressure, a cosine of volume.
fn template() -> Measured {
    let pressure_time_ms: Vec<f64> = (0..850).map(f64::from).collect();
    let frame_time_ms: Vec<f64> = (0..30).map(|i| CYCLE_MS / 30.0 * f64::from(i)).collect();
    let known = |value: f64, sd: f64| Uncertain { value, sd };
    Measured {
        cycle_ms: CYCLE_MS,
        pressure_mmhg: pressure_time_ms
            .iter()
            .map(|t| 8.0 + 110.0 * (PI * t / 400.0).sin().max(0.0))
            .collect(),
        frame_volume_ml: frame_time_ms
            .iter()
            .map(|t| 95.0 + 35.0 * (TAU * t / CYCLE_MS).cos())
            .collect(),
        pressure_time_ms,
        frame_time_ms,
        noise: StatedNoise {
            pressure_rms_mmhg: Some(1.2),
            pressure_correlation_ms: Some(10.0),
            volume_rms_ml: Some(2.5),
        },
        side: SideData {
            cuff: Some(Cuff {
                systolic: known(118.0, 4.0),
                diastolic: known(76.0, 4.0),
            }),
            forward_stroke_volume: Some(known(70.0, 5.0)),
            whole_heart: Some(WholeHeart {
                time_ms: 700.0,
                volume: known(115.0, 4.0),
            }),
        },
        wall_volume: known(115.0, 5.75),
        given: GivenLoads::default(),
    }
}

/// The base model at its prior's mean with effects at these strengths and their first starts' shapes, and bumps of the
/// activation.
fn beat(effects: &[(&str, f64)], bumps: &[f64]) -> Prediction {
    let model = Reduced::new(&template());
    let base: Vec<f64> = model.base().iter().map(|p| p.mean).collect();
    let values = |(name, strength): &(&str, f64)| {
        let idx = model
            .candidates()
            .iter()
            .position(|c| c.name == *name)
            .unwrap();
        let mut values = model.candidates()[idx].starts[0].clone();
        values[0] = *strength;
        (idx, values)
    };
    let values: Vec<(usize, Vec<f64>)> = effects.iter().map(values).collect();
    let terms: Vec<(usize, &[f64])> = values
        .iter()
        .map(|(idx, values)| (*idx, values.as_slice()))
        .collect();
    model
        .predict(
            &Request {
                base: &base,
                terms: &terms,
                bumps,
            },
            None,
        )
        .unwrap()
}

/// Data with noise as stated.
fn patient(effect: Option<(&str, f64)>, seed: u64) -> Measured {
    measured(&beat(effect.as_slice(), &[]), seed)
}

fn measured(beat: &Prediction, seed: u64) -> Measured {
    let mut measured = template();
    let mut random = Pcg64::seed_from_u64(seed);
    let mut normal = || {
        let (u, v): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
    };
    let rho = (-0.1f64).exp();
    let mut noise = 1.2 * normal();
    for (t, p) in measured
        .pressure_time_ms
        .iter()
        .zip(&mut measured.pressure_mmhg)
    {
        *p = beat.at(&beat.pressure_mmhg, *t) + noise;
        noise = rho * noise + 1.2 * (1.0 - rho * rho).sqrt() * normal();
    }
    for (t, v) in measured
        .frame_time_ms
        .iter()
        .zip(&mut measured.frame_volume_ml)
    {
        *v = beat.at(&beat.volume_ml, *t) + 2.5 * normal();
    }
    let side = &mut measured.side;
    let cuff = side.cuff.as_mut().unwrap();
    cuff.systolic.value = beat.systolic_mmhg + 4.0 * normal();
    cuff.diastolic.value = beat.diastolic_mmhg + 4.0 * normal();
    side.forward_stroke_volume.as_mut().unwrap().value =
        beat.forward_stroke_volume_ml + 5.0 * normal();
    let whole = side.whole_heart.as_mut().unwrap();
    whole.volume.value = beat.at(&beat.true_volume_ml, whole.time_ms) + 4.0 * normal();
    measured
}

/// Against a part of the catalogue, for speed.
fn search(measured: &Measured) -> Discovery {
    let effects = [
        "atrial_kick",
        "mitral_regurgitation",
        "delayed_relaxation",
        "pressure_offset",
    ];
    let settings = Settings {
        effects: effects.map(str::to_owned).to_vec(),
        ..Settings::default()
    };
    discover(measured, &Reduced::new(measured), &settings).unwrap()
}

#[test]
fn loads_that_are_given_narrow_their_priors() {
    let mut measured = template();
    let prior = |measured: &Measured, name: &str| {
        Reduced::new(measured)
            .base()
            .iter()
            .find(|p| p.name == name)
            .cloned()
            .expect("a base parameter")
    };
    let usual = prior(&measured, "compliance_mL_per_mmHg");
    // Beyond the usual bounds, and known to a tenth.
    measured.given.compliance = Some(Uncertain {
        value: 7.0,
        sd: 0.7,
    });
    let given = prior(&measured, "compliance_mL_per_mmHg");
    assert!(usual.upper < 7.0 && given.upper > 7.0 && given.lower <= usual.lower);
    assert!((given.mean - 7.0).abs() < 1e-12 && (given.sd - 0.1).abs() < 1e-12 && usual.sd > 0.1);
    assert_eq!(
        prior(&measured, "left_atrial_pressure_mmHg"),
        prior(&template(), "left_atrial_pressure_mmHg")
    );
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    let found = search(&patient(None, 1));
    assert!(found.none && found.unexplained.is_none(), "{found:?}");
    assert!(
        found.p_value > 0.04 && found.gap_before < 1.2,
        "{} {}",
        found.p_value,
        found.gap_before
    );
    assert!(
        found
            .not_identifiable
            .iter()
            .all(|n| n.expected_misfit < 6.0)
    );
}

#[test]
fn strong_effects_are_named_with_intervals_that_hold_them() {
    for (name, strength, parameter) in [
        ("atrial_kick", 12.0, "amplitude_mmHg"),
        ("delayed_relaxation", 50.0, "tau_ms"),
        ("pressure_offset", 9.0, "offset_mmHg"),
    ] {
        let found = search(&patient(Some((name, strength)), 2));
        assert_eq!(found.accepted, [name], "{found:?}");
        let first = &found.effects[0];
        let [low, high] = first.interval[parameter];
        // Twice the half width: one of three intervals of 95 % may well miss.
        let half = 0.5 * (high - low);
        assert!(
            (first.strength[parameter] - strength).abs() < 2.0 * half,
            "{name} {low} {high}"
        );
        assert!(
            first.probability > 0.9 && first.plausible && first.delta_deviance > 20.0,
            "{first:?}"
        );
        assert!(
            found.gap_after < found.gap_before && found.gap_heldout_after < 1.3,
            "{found:?}"
        );
        assert_eq!(first.artefact, name == "pressure_offset");
    }
}

#[test]
fn two_effects_are_found_together() {
    let beat = beat(&[("atrial_kick", 12.0), ("pressure_offset", 9.0)], &[]);
    let mut found = search(&measured(&beat, 3)).accepted;
    found.sort();
    assert_eq!(found, ["atrial_kick", "pressure_offset"]);
}

/// What nothing in the catalogue makes is not named, and does not hide what can be.
#[test]
fn a_strange_activation_is_unexplained_and_hides_nothing() {
    let bumps = [0.4, -0.4, 0.3, -0.3, 0.4, -0.4];
    let alone = search(&measured(&beat(&[], &bumps), 5));
    assert!(alone.none, "{:?}", alone.effects[0]);
    assert_eq!(alone.unexplained.unwrap().kind, "activation");
    let milder = bumps.map(|bump| 0.4 * bump);
    let both = search(&measured(&beat(&[("atrial_kick", 12.0)], &milder), 5));
    assert_eq!(both.accepted, ["atrial_kick"], "{:?}", &both.effects[..2]);
    assert!(
        both.nameless_evidence > 10.0 && both.effects[0].robust_evidence > 6.0,
        "{:?}",
        both.effects[0]
    );
}

/// The measured volumes of a base fit have no systematic sign against the fitted ones, although all of them may be off by a
/// common factor.
#[test]
fn fitted_volumes_do_not_lie_below_the_measured_ones() {
    let beat = beat(&[], &[]);
    let settings = cardiotwin_discover::least_squares::Settings::default();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let ratio = |seed: u64| {
        let mut measured = measured(&beat, seed);
        // Without scalars nothing but weak priors holds the volumes elsewhere.
        measured.side = SideData::default();
        let model = Reduced::new(&measured);
        let data = Data::new(measured, &ModelDiscrepancy::default());
        let problem = Problem {
            forward: &model,
            data: &data,
        };
        let fit = fit_base(&problem, &settings).unwrap();
        let fitted = problem
            .predict(&fit.structure, &fit.values(), Some(&fit.minimum.warm))
            .unwrap();
        mean(&fitted.sampled(&fitted.volume_ml, &data.volume.time_ms)) / mean(&data.volume.value)
    };
    let ratios: Vec<f64> = (1..=4).map(ratio).collect();
    assert!((mean(&ratios) - 1.0).abs() < 0.003, "{ratios:?}");
}

/// The same bits whatever the number of threads.
#[test]
fn threads_do_not_change_a_bit() {
    let measured = patient(Some(("mitral_regurgitation", 0.25)), 3);
    let with = |n| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .unwrap()
            .install(|| search(&measured))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one, three);
    assert_eq!(one.accepted, ["mitral_regurgitation"]);
}

#[test]
fn phases_follow_the_valves_of_the_model() {
    let beat = beat(&[], &[]);
    let data = Data::new(patient(None, 4), &ModelDiscrepancy::default());
    let phases = Phases::of(&data);
    let open = |flow: &[f64]| {
        let n = flow.len();
        (0..n)
            .find(|i| flow[*i] > 1.0 && flow[(i + n - 1) % n] <= 1.0)
            .map(|i| i as f64 * beat.step_ms)
            .unwrap()
    };
    let (aortic, mitral) = (
        open(&beat.aortic_flow_ml_per_s),
        open(&beat.mitral_flow_ml_per_s),
    );
    assert!(
        (phases.early_ejection_ms - aortic).abs() < 25.0,
        "{phases:?} {aortic}"
    );
    assert!(
        (phases.rapid_filling_ms - mitral).abs() < 40.0,
        "{phases:?} {mitral}"
    );
    let after: Vec<f64> = phases
        .beginnings()
        .iter()
        .map(|t| (t - phases.isovolumic_contraction_ms).rem_euclid(CYCLE_MS))
        .collect();
    assert!(after.windows(2).all(|w| w[0] <= w[1]), "{after:?}");
    assert_eq!(phases.at(aortic + 60.0, CYCLE_MS), 1);
}

#[test]
fn bad_input_is_named() {
    let mut measured = patient(None, 1);
    measured.frame_volume_ml[3] = -2.0;
    let message = discover(&measured, &Reduced::new(&measured), &Settings::default())
        .unwrap_err()
        .to_string();
    assert!(message.contains("volume frame is -2"), "{message}");
    let settings = Settings {
        effects: vec!["kick".to_owned()],
        ..Settings::default()
    };
    let measured = patient(None, 1);
    let message = discover(&measured, &Reduced::new(&measured), &settings)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("no effect kick") && message.contains("atrial_kick"),
        "{message}"
    );
}
