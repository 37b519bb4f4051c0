//! Tests of the search for the periodic beat.

use super::*;
use crate::beat::{BeatOutcome, BeatSettings, Beats, run_beats};
use crate::effects::{CATALOGUE, EffectSetting};
use cardiotwin_units::{Ml, Mmhg};

const CYCLE: Ms = Ms(800.0);

fn subject() -> FitSubject {
    FitSubject::new(CYCLE, Ml(110.0))
}

fn settings() -> PeriodicSettings {
    PeriodicSettings::with_step(CYCLE, Ms(2.0))
}

fn beat(values: &[f64], effects: &[EffectSetting], near: Option<&Orbit>) -> PeriodicBeat {
    find(
        &mut subject().model(values, effects).unwrap(),
        CYCLE,
        &settings(),
        near,
    )
    .unwrap()
}

#[test]
fn is_where_plain_repetition_ends() {
    let found = beat(&FitSubject::typical(), &[], None);
    assert!(
        found.periodic && found.n_beats <= 10,
        "{} beats",
        found.n_beats
    );
    let mut model = subject().model(&FitSubject::typical(), &[]).unwrap();
    let beats = Beats::UntilPeriodic {
        limit: 200,
        volume: Ml(1e-7),
        pressure: Mmhg(1e-7),
    };
    let settings = BeatSettings {
        beats,
        step: Ms(2.0),
        ..BeatSettings::one_beat(CYCLE)
    };
    let BeatOutcome::Finished(plain) =
        run_beats(&mut model.ventricle, &mut model.circulation, &settings)
    else {
        panic!("diverged")
    };
    for (i, (p, v)) in found
        .heart
        .pressure_mmhg
        .iter()
        .zip(&found.heart.volume_ml)
        .enumerate()
        .skip(1)
    {
        assert!((p - plain.traces.pressure_mmhg[i]).abs() < 1e-3, "{i}");
        assert!((v - plain.traces.volume_ml[i]).abs() < 1e-4, "{i}");
    }
    let stroke = found
        .heart
        .volume_ml
        .iter()
        .fold((f64::MAX, 0.0f64), |(l, h), v| (l.min(*v), h.max(*v)));
    assert!(
        (stroke.1 - stroke.0 - found.forward_volume_ml).abs() < 1.0,
        "{stroke:?} {}",
        found.forward_volume_ml
    );
}

#[test]
fn every_effect_has_a_periodic_beat() {
    for effect in CATALOGUE {
        let found = beat(
            &FitSubject::typical(),
            &[EffectSetting::typical(effect)],
            None,
        );
        assert!(
            found.periodic && found.n_beats <= 15,
            "{} {} {}",
            effect.name,
            found.n_beats,
            found.change
        );
    }
}

#[test]
fn a_neighbour_needs_few_beats_and_gives_smooth_differences() {
    let base = FitSubject::typical();
    let here = beat(&base, &[], None);
    for (idx, parameter) in BASE_PARAMETERS.iter().enumerate() {
        let at = |relative: f64| {
            let mut values = base;
            values[idx] += relative * parameter.typical;
            beat(&values, &[], Some(&here.orbit))
        };
        let (near, far) = (at(1e-4), at(1e-3));
        assert!(
            near.n_beats <= 4,
            "{} {} beats",
            parameter.name,
            near.n_beats
        );
        let (mut difference, mut size) = (0.0f64, 0.0f64);
        for i in 0..settings().steps {
            let slope =
                |b: &PeriodicBeat, by: f64| (b.heart.volume_ml[i] - here.heart.volume_ml[i]) / by;
            difference += (slope(&near, 1e-4) - slope(&far, 1e-3)).powi(2);
            size += slope(&far, 1e-3).powi(2);
        }
        assert!(size > 0.0, "{}", parameter.name);
        assert!(
            (difference / size).sqrt() < 0.05,
            "{} {}",
            parameter.name,
            (difference / size).sqrt()
        );
    }
}

#[test]
fn an_orbit_of_another_shape_is_not_used() {
    let kick = EffectSetting::typical(crate::effects::find("wave_reflection").unwrap());
    let other = beat(&FitSubject::typical(), &[kick], None).orbit;
    let (with, without) = (
        beat(&FitSubject::typical(), &[], Some(&other)),
        beat(&FitSubject::typical(), &[], None),
    );
    assert_eq!(with, without);
}
