//! Accepted effects in an organ beat: those of the heart are simulated, those of the measurement
//! are rejected.

mod support;

use std::collections::BTreeMap;

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec, EffectSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::run_task;
use support::{PATIENTS, beat_spec, passive_state, step0, succeed};

fn effect(name: &str, parameter: &str, value: f64) -> EffectSpec {
    EffectSpec {
        name: name.to_owned(),
        parameters: BTreeMap::from([(parameter.to_owned(), value)]),
    }
}

/// Periodic beats of a patient with default parameters and these effects.
fn spec(id: &str, effects: Vec<EffectSpec>, context: &mut Context) -> OrganBeatSpec {
    let step0 = step0(id);
    let state = passive_state(&step0, context);
    let parameters = Step1Parameters::default();
    let contraction = ContractionSpec::Tanh {
        parameters: parameters.tanh,
    };
    let mut spec = beat_spec(step0.cycle_length_ms, &state, &parameters, contraction);
    spec.circulation.effects = effects;
    spec.beats = BeatCount::Periodic {
        max: 40,
        tolerance: 0.01,
    };
    spec
}

fn run(spec: OrganBeatSpec, context: &mut Context) -> OrganBeatResult {
    match succeed(&TaskSpec::OrganBeat(Box::new(spec)), context) {
        TaskResult::OrganBeat(result) => result,
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_atrial_kick_fills_the_ventricle_of_every_patient_of_the_cohort() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    for id in PATIENTS {
        let mut edv = |effects| {
            run(spec(id, effects, &mut context), &mut context)
                .biomarkers
                .edv_ml
                .unwrap()
        };
        let (without, with) = (
            edv(vec![]),
            edv(vec![effect("atrial_kick", "amplitude_mmHg", 8.0)]),
        );
        assert!(with > without + 5.0, "{id}: {without} to {with} mL");
    }
}

#[test]
fn what_cannot_be_simulated_is_refused_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    for (refused, message, remedy) in [
        (
            effect("pressure_offset", "offset_mmHg", 5.0),
            "artefact of the measurement",
            "subtract this offset",
        ),
        (
            effect("atrial_flutter", "rate", 5.0),
            "expected one of atrial_kick",
            "use a version that has it",
        ),
        (
            effect("atrial_kick", "amplitude_mmHg", 90.0),
            "between 0 and 25",
            "correct the effect",
        ),
    ] {
        let spec = spec("01-CoA", vec![refused], &mut context);
        let Ending::Failed { failure } =
            run_task(&TaskSpec::OrganBeat(Box::new(spec)), &mut context)
        else {
            panic!("not refused")
        };
        assert_eq!(failure.class, FailureClass::Input);
        assert!(failure.message.contains(message), "{}", failure.message);
        assert!(
            failure
                .remedy
                .as_deref()
                .is_some_and(|text| text.contains(remedy)),
            "{:?}",
            failure.remedy
        );
    }
}
