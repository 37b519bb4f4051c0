//! The closed loop around a finite-element ventricle: its blood stays, it starts from given contents, and
//! an interrupted beat goes on to the bit.

mod support;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Duration;

use cardiotwin_schemas::finite_element::FiniteElementSettings;
use cardiotwin_schemas::organ::{
    BeatCount, ClosedLoopSpec, ContractionSpec, EffectSpec, LoopFilling, OrganSpec, Step1Parameters,
};
use cardiotwin_schemas::outcome::{Ending, LoopState, OrganBeatResult, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, PassiveStateSpec, TaskSpec};
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::run_task;
use support::{beat_spec, passive_state, step0};

/// 01-CoA on the coarsest mesh, in a loop with the blood of its end-diastolic volume.
fn beat(folder: &Path) -> OrganBeatSpec {
    let coarse = FiniteElementSettings {
        mesh_nodes: 500,
        ..FiniteElementSettings::default()
    };
    let spec = PassiveStateSpec {
        finite_element: Some(coarse.anatomy(&[])),
        ..step0("01-CoA")
    };
    let state = passive_state(&spec, &mut Context::plain(folder, 2));
    let parameters = Step1Parameters::default();
    let contraction = ContractionSpec::Tanh {
        parameters: parameters.tanh,
    };
    let mut beat = OrganBeatSpec {
        time_step_ms: 2.0,
        finite_element: Some(coarse.equations()),
        beats: BeatCount::Fixed { n: 1 },
        ..beat_spec(spec.cycle_length_ms, &state, &parameters, contraction)
    };
    let OrganSpec::FiniteElement(organ) = &beat.organ else {
        panic!("another organ")
    };
    let volume_ml = organ.figures.end_diastolic_volume_ml;
    beat.circulation.closed = Some(ClosedLoopSpec {
        stroke_volume_ml: 100.0,
        venous_share: Some(0.05),
        rest: None,
        filling: Some(LoopFilling::EndDiastolicVolume { volume_ml }),
        contents: None,
    });
    beat
}

fn run(spec: &OrganBeatSpec, context: &mut Context) -> Ending {
    run_task(&TaskSpec::OrganBeat(Box::new(spec.clone())), context)
}

fn finished(spec: &OrganBeatSpec, context: &mut Context) -> (OrganBeatResult, LoopState) {
    match run(spec, context) {
        Ending::Succeeded { result } => match *result {
            TaskResult::OrganBeat(result) => {
                let state = result.closed_loop.clone().expect("a loop");
                (result, state)
            }
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

fn traces(folder: &Path) -> Vec<u8> {
    fs::read(folder.join("traces.csv")).expect("traces")
}

// One test, because step 0 takes most of the time.
#[test]
fn a_3d_ventricle_keeps_the_blood_of_its_loop_and_goes_on_from_any_state_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let spec = beat(folder.path());
    let OrganSpec::FiniteElement(organ) = &spec.organ else {
        panic!("another organ")
    };
    let end_diastolic_ml = organ.figures.end_diastolic_volume_ml;

    let whole = tempfile::tempdir().unwrap();
    let (result, state) = finished(&spec, &mut Context::plain(whole.path(), 1));
    assert!(result.failed_check().is_none(), "{:?}", result.checks);
    // The atrium contracts at the beat's end, and the law's loop fills the ventricle to its volume.
    let gap_ml = result.biomarkers.end_of_beat_gap_ml.expect("a single beat");
    assert!(gap_ml.abs() < 0.06 * end_diastolic_ml, "{gap_ml} mL");
    assert_eq!(state.contents.volumes_ml.len(), 8);

    // A beat from the end of the first one has the blood that it is given, to the rounding of all steps.
    let mut next = spec.clone();
    let closed = next.circulation.closed.as_mut().unwrap();
    let volume_ml = state.blood_volume_ml + 5.0;
    closed.filling = Some(LoopFilling::BloodVolume { volume_ml });
    closed.contents = Some(state.contents.clone());
    let folder_of_next = tempfile::tempdir().unwrap();
    let (more, after) = finished(&next, &mut Context::plain(folder_of_next.path(), 1));
    let lost_ml = after.blood_volume_ml - volume_ml;
    assert!(lost_ml.abs() < 1e-6, "{lost_ml} mL of {volume_ml} mL");
    let [fuller, before] = [&more, &result].map(|beat| beat.biomarkers.end_of_beat_gap_ml.unwrap());
    assert!(
        fuller < before - 0.2,
        "more blood fills more: {fuller} {before}"
    );

    // Interrupted, and resumed with another number of threads.
    let kept = tempfile::tempdir().unwrap();
    let mut writing = Context {
        checkpoints: Checkpoints::restarting(kept.path(), Path::new("nowhere"), None),
        checkpoint_ms: 200.0,
        checkpoint_apart: Duration::ZERO,
        ..Context::plain(kept.path(), 1)
    };
    finished(&spec, &mut writing);
    let again = tempfile::tempdir().unwrap();
    let mut resuming = Context {
        checkpoints: Checkpoints::restarting(again.path(), kept.path(), None),
        ..Context::plain(again.path(), 1)
    };
    let (resumed, state_of_resumed) = finished(&spec, &mut resuming);
    assert!(resumed.counters["resumed_at_ms"] >= 600.0);
    assert_eq!(state_of_resumed, state);
    assert!(traces(again.path()) == traces(whole.path()));

    // What a loop has itself cannot be added to it.
    let mut twice = spec.clone();
    twice.circulation.effects.push(EffectSpec {
        name: "atrial_kick".to_owned(),
        parameters: BTreeMap::from([("amplitude_mmHg".to_owned(), 5.0)]),
    });
    let refused = format!("{:?}", run(&twice, &mut Context::plain(again.path(), 1)));
    assert!(refused.contains("atrial_kick"), "{refused}");

    // A name that no part of the loop has.
    let mut foreign = next;
    let contents = foreign
        .circulation
        .closed
        .as_mut()
        .unwrap()
        .contents
        .as_mut();
    contents
        .unwrap()
        .volumes_ml
        .insert("spleen".to_owned(), 200.0);
    let refused = format!("{:?}", run(&foreign, &mut Context::plain(again.path(), 1)));
    assert!(refused.contains("spleen"), "{refused}");
}
