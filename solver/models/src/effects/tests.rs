//! Tests of the whole catalogue: each effect changes the beat as declared.

use super::*;
use crate::beat::{BeatOutcome, BeatSettings, Beats, run_beats};
use crate::periodic::{FitSubject, PeriodicBeat, PeriodicSettings, find as find_periodic};
use crate::ventricle::Ventricle;
use cardiotwin_units::{Ml, Ms};
use cardiotwin_vocabulary::measurements::Measurement;

const CYCLE: Ms = Ms(800.0);
const STEP: Ms = Ms(1.0);

fn model(effects: &[EffectSetting]) -> Assembled {
    FitSubject::new(CYCLE, Ml(110.0))
        .model(&FitSubject::typical(), effects)
        .unwrap()
}

/// The heart's periodic beat and the traces as measured.
fn beat(effects: &[EffectSetting]) -> (PeriodicBeat, PeriodicTraces) {
    let mut model = model(effects);
    let settings = PeriodicSettings {
        tolerance: 1e-8,
        ..PeriodicSettings::with_step(CYCLE, STEP)
    };
    let found = find_periodic(&mut model, CYCLE, &settings, None).unwrap();
    assert!(found.periodic);
    let measured = found.measured(&model);
    (found, measured)
}

fn setting(effect: &'static Effect, values: Vec<f64>) -> EffectSetting {
    EffectSetting { effect, values }
}

/// Largest difference of pressure (mmHg) or volume (mL).
fn distance(a: &PeriodicTraces, b: &PeriodicTraces) -> f64 {
    let largest = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .fold(0.0f64, |l, (a, b)| l.max((a - b).abs()))
    };
    largest(&a.pressure_mmhg, &b.pressure_mmhg).max(largest(&a.volume_ml, &b.volume_ml))
}

#[test]
fn catalogue_is_complete() {
    let names = CATALOGUE.map(|effect| effect.name);
    let expected = [
        "atrial_kick",
        "mitral_regurgitation",
        "aortic_regurgitation",
        "aortic_stenosis",
        "wave_reflection",
        "delayed_relaxation",
        "passive_stiffening",
        "ventricular_septal_defect",
        "pericardial_constraint",
        "dyssynchrony",
        "viscoelasticity",
        "cross_fibre_stress",
        "catheter_response",
        "pv_misalignment",
        "pressure_offset",
        "volume_scaling",
    ];
    assert!(expected.iter().all(|name| names.contains(name)));
    for effect in CATALOGUE {
        let name = effect.name;
        assert_eq!(find(name).unwrap().name, name);
        for text in [
            effect.meaning,
            effect.equation,
            effect.source,
            effect.signature,
        ] {
            assert!(text.len() > 10, "{name}: {text}");
        }
        assert!(
            effect.meaning.ends_with('.') && effect.meaning.matches(". ").count() == 0,
            "{name}"
        );
        assert!(
            !effect.marks.is_empty() && !effect.separated_by.is_empty(),
            "{name}"
        );
        // Stress across the fibre has no trace in a ventricle of one fibre, whatever is measured.
        let is_read = |words: &&str| Measurement::of_words(words).is_some();
        let has_one = effect.separated_by.iter().any(is_read);
        assert_eq!(has_one, name != "cross_fibre_stress", "{name}");
        assert!(
            effect
                .confused_with
                .iter()
                .all(|other| *other != name && names.contains(other)),
            "{name}"
        );
        assert_eq!(
            effect.remedy.is_some(),
            effect.kind == Kind::Artefact,
            "{name}"
        );
        assert_eq!(
            matches!(effect.action, Action::Measurement(_)),
            effect.kind == Kind::Artefact,
            "{name}"
        );
        let strength = effect.strength();
        let off = strength
            .off
            .unwrap_or_else(|| panic!("{name}: the strength has no off-value"));
        assert!(
            strength.role == Role::Strength && strength.smallest > 0.0,
            "{name}"
        );
        assert!(
            (strength.typical - off).abs() >= strength.smallest,
            "{name}"
        );
        for (idx, p) in effect.parameters.iter().enumerate() {
            assert!(
                p.range.0 < p.range.1 && p.typical >= p.range.0 && p.typical <= p.range.1,
                "{name} {}",
                p.name
            );
            assert!(
                p.prior_scale > 0.0 && !p.unit.is_empty() && !p.meaning.is_empty(),
                "{name} {}",
                p.name
            );
            assert_eq!(p.role == Role::Strength, idx == 0, "{name} {}", p.name);
            assert!(
                effect.parameters[..idx]
                    .iter()
                    .all(|other| other.name != p.name),
                "{name} {}",
                p.name
            );
        }
        assert!(
            effect.is_off(&effect.off()) && !effect.is_off(&effect.typical()),
            "{name}"
        );
        if let InThreeDimensions::PassiveExponents { factor } = effect.in_3d {
            assert!(effect.parameters.iter().any(|p| p.name == factor), "{name}");
        }
    }
}

#[test]
fn off_is_the_base_model_and_a_trace_of_an_effect_is_near_it() {
    let base = beat(&[]);
    let all_off: Vec<_> = CATALOGUE
        .into_iter()
        .map(|effect| setting(effect, effect.off()))
        .collect();
    assert_eq!(beat(&all_off), base);
    for effect in CATALOGUE {
        let on = distance(&beat(&[EffectSetting::typical(effect)]).1, &base.1);
        let mut slight = effect.typical();
        // Close to every off-value; a catheter has two, its lag and its filter.
        for (value, parameter) in slight.iter_mut().zip(effect.parameters) {
            if let Some(off) = parameter.off {
                *value = off + 1e-3 * (*value - off);
            }
        }
        let near = distance(&beat(&[setting(effect, slight)]).1, &base.1);
        assert!(on > 0.5, "{} moves nothing: {on}", effect.name);
        assert!(
            near < 0.01 * on + 0.02,
            "{} jumps at its off-value: {near} of {on}",
            effect.name
        );
    }
}

#[test]
fn each_parameter_moves_the_traces() {
    for effect in CATALOGUE {
        let here = beat(&[EffectSetting::typical(effect)]).1;
        for (idx, p) in effect.parameters.iter().enumerate() {
            let mut values = effect.typical();
            let moved = values[idx] + p.prior_scale;
            values[idx] = if moved <= p.range.1 {
                moved
            } else {
                values[idx] - p.prior_scale
            };
            let there = beat(&[setting(effect, values)]).1;
            assert!(distance(&here, &there) > 0.02, "{} {}", effect.name, p.name);
        }
    }
}

/// First and last sample of each phase of the base model's beat.
fn phases(base: &PeriodicBeat) -> impl Fn(Phase) -> (usize, usize) {
    let n = base.heart.pressure_mmhg.len();
    let ejects = |i: &usize| base.aortic_flow_ml_per_s[*i] > 1.0;
    let fills = |i: &usize| base.mitral_flow_ml_per_s[*i] > 1.0;
    let opens = (0..n).find(ejects).unwrap();
    let closes = (opens..n).find(|i| !ejects(i)).unwrap();
    let filling = (closes..n).find(fills).unwrap();
    let third = (n - filling) / 3;
    // The beat starts at the first activation minus the onset, so that contraction is under way
    // after 30 ms.
    move |phase| match phase {
        Phase::IsovolumicContraction => (30, opens),
        Phase::EarlyEjection => (opens, usize::midpoint(opens, closes)),
        Phase::LateEjection => (usize::midpoint(opens, closes), closes),
        Phase::IsovolumicRelaxation => (closes, filling),
        Phase::RapidFilling => (filling, filling + third),
        Phase::Diastasis => (filling + third, n - 150),
        Phase::AtrialSystole => (n - 130, n - 20),
    }
}

#[test]
fn marks_are_where_the_traces_move() {
    let (heart, base) = beat(&[]);
    let phase = phases(&heart);
    let mut wrong = Vec::new();
    for effect in CATALOGUE {
        let on = beat(&[EffectSetting::typical(effect)]).1;
        for mark in effect.marks {
            let (first, last) = phase(mark.phase);
            let mean = |x: &[f64]| x[first..=last].iter().sum::<f64>() / (last - first + 1) as f64;
            let rate = |x: &[f64]| (x[last] - x[first]) / (last - first) as f64 * 1e2;
            let value = |t: &PeriodicTraces| match mark.signal {
                Signal::Pressure => mean(&t.pressure_mmhg),
                Signal::Volume => mean(&t.volume_ml),
                Signal::PressureRate => rate(&t.pressure_mmhg),
                Signal::VolumeRate => rate(&t.volume_ml),
            };
            let moved = value(&on) - value(&base);
            let as_declared = if mark.sign == Sign::Up { moved } else { -moved };
            if as_declared < 0.1 {
                wrong.push(format!(
                    "{} {mark:?} {first}..{last}: {moved:.3}",
                    effect.name
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_restored_run_goes_on_alike() {
    for effect in CATALOGUE {
        let effects = [EffectSetting::typical(effect)];
        let run = |model: &mut Assembled, steps: usize| {
            for _ in 0..steps {
                model
                    .ventricle
                    .try_step(&mut model.circulation, STEP)
                    .unwrap();
                model.ventricle.commit();
                model.circulation.commit();
            }
        };
        let mut whole = model(&effects);
        // In late ejection every state is changing.
        run(&mut whole, 300);
        let saved = (whole.ventricle.snapshot(), whole.circulation.snapshot());
        run(&mut whole, 700);
        let mut restored = model(&effects);
        restored.ventricle.restore(&saved.0).unwrap();
        restored.circulation.restore(&saved.1).unwrap();
        run(&mut restored, 700);
        assert_eq!(
            restored.ventricle.snapshot(),
            whole.ventricle.snapshot(),
            "{}",
            effect.name
        );
        assert_eq!(
            restored.circulation.snapshot(),
            whole.circulation.snapshot(),
            "{}",
            effect.name
        );
    }
}

#[test]
fn a_beat_with_any_effect_succeeds_and_keeps_its_volume() {
    let mut all: Vec<Vec<EffectSetting>> = CATALOGUE
        .into_iter()
        .map(|effect| vec![EffectSetting::typical(effect)])
        .collect();
    all.push(CATALOGUE.into_iter().map(EffectSetting::typical).collect());
    for effects in all {
        let mut model = model(&effects);
        let settings = BeatSettings {
            beats: Beats::Exactly(3),
            ..BeatSettings::one_beat(CYCLE)
        };
        let BeatOutcome::Finished(result) =
            run_beats(&mut model.ventricle, &mut model.circulation, &settings)
        else {
            panic!("{effects:?} diverged")
        };
        assert!(result.succeeded(), "{effects:?} {:?}", result.checks);
        let balance = result
            .checks
            .iter()
            .find(|check| check.name == "volume_balance_ml")
            .unwrap();
        assert!(balance.value.abs() < 1e-5, "{effects:?} {}", balance.value);
    }
}

#[test]
fn settings_are_checked() {
    let named = |name: &str, values: &[(&str, f64)]| {
        EffectSetting::named(
            name,
            &values.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect(),
        )
    };
    let kick = named("atrial_kick", &[("amplitude_mmHg", 4.0)]).unwrap();
    assert_eq!(kick.values, [4.0, 140.0, 130.0]);
    assert_eq!(
        named(
            "atrial_kick",
            &kick
                .parameters()
                .iter()
                .map(|(k, v)| (k.as_str(), *v))
                .collect::<Vec<_>>()
        )
        .unwrap()
        .values,
        kick.values
    );
    assert!(
        named("atrial_kick", &[("amplitude_mmHg", 0.0)])
            .unwrap()
            .is_off()
    );
    for (found, expected) in [
        (
            named("atrial_flutter", &[]),
            "unknown effect `atrial_flutter`",
        ),
        (
            named("atrial_kick", &[("lead_ms", 120.0)]),
            "needs its strength amplitude_mmHg",
        ),
        (
            named("atrial_kick", &[("amplitude_mmHg", 4.0), ("lead", 1.0)]),
            "has no parameter `lead`",
        ),
        (
            named("atrial_kick", &[("amplitude_mmHg", 400.0)]),
            "amplitude_mmHg = 400 must be between 0 and 25",
        ),
        (
            named("atrial_kick", &[("amplitude_mmHg", f64::NAN)]),
            "must be between 0 and 25",
        ),
    ] {
        let message = found.unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let twice = FitSubject::new(CYCLE, Ml(110.0))
        .model(&FitSubject::typical(), &[kick.clone(), kick.clone()]);
    assert!(matches!(
        twice.unwrap_err(),
        EffectError::Twice {
            effect: "atrial_kick"
        }
    ));
    assert!(kick.require_physiology().is_ok());
    let offset = named("pressure_offset", &[("offset_mmHg", 4.0)]).unwrap();
    assert!(
        offset
            .require_physiology()
            .unwrap_err()
            .to_string()
            .contains("subtract this offset")
    );
}
