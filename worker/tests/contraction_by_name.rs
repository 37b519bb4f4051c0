//! Beats with contraction models of the catalogue.

mod support;

use std::collections::BTreeMap;

use cardiotwin_schemas::organ::{ContractionSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::run_task;
use support::{beat_spec, passive_state, step0, succeed};

/// A reduced beat of a patient with a model of the catalogue.
fn spec(name: &str, parameters: &[(&str, f64)], context: &mut Context) -> OrganBeatSpec {
    let step0 = step0("01-CoA");
    let state = passive_state(&step0, context);
    let parameters = parameters.iter().map(|(key, x)| ((*key).to_owned(), *x));
    let contraction = ContractionSpec::Catalogue {
        name: name.to_owned(),
        parameters: parameters.collect::<BTreeMap<_, _>>(),
    };
    let of_step1 = Step1Parameters::default();
    beat_spec(step0.cycle_length_ms, &state, &of_step1, contraction)
}

fn run(name: &str, parameters: &[(&str, f64)], context: &mut Context) -> OrganBeatResult {
    let spec = spec(name, parameters, context);
    match succeed(&TaskSpec::OrganBeat(Box::new(spec)), context) {
        TaskResult::OrganBeat(result) => result,
        other => panic!("{other:?}"),
    }
}

fn failure(spec: OrganBeatSpec, context: &mut Context) -> String {
    match run_task(&TaskSpec::OrganBeat(Box::new(spec)), context) {
        Ending::Failed { failure } => failure.message,
        other => panic!("{other:?}"),
    }
}

#[test]
fn each_type_of_human_cell_gives_a_beat_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    let [endo, epi, mid] = ["tor-ord-land", "tor-ord-land-epi", "tor-ord-land-mid"].map(|name| {
        let result = run(name, &[("Smax_ref_kPa", 60.0)], &mut context);
        result.biomarkers.p_max_mmhg.unwrap()
    });
    // Peak calcium is higher in the epicardial cell, and highest in the middle.
    assert!(15.0 < endo && endo < epi && epi < mid, "{endo} {epi} {mid}");
}

#[test]
fn a_weaker_calcium_pump_weakens_the_beat() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    let [usual, weak] = [1.0, 0.5].map(|factor| {
        let result = run("tor-ord-land", &[("Jup_factor", factor)], &mut context);
        result.biomarkers.p_max_mmhg.unwrap()
    });
    assert!(weak < 0.95 * usual, "{weak} {usual}");
}

#[test]
fn what_cannot_be_simulated_is_refused_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    let unknown = failure(spec("tor-ord", &[], &mut context), &mut context);
    assert!(
        unknown.contains("bestel-clement-sorine, tor-ord-land"),
        "{unknown}"
    );
    let mistyped = failure(
        spec("tor-ord-land", &[("Jup", 0.5)], &mut context),
        &mut context,
    );
    assert!(mistyped.contains("Jup_factor"), "{mistyped}");
    let mut fast = spec("tor-ord-land", &[], &mut context);
    fast.cycle_length_ms = 250.0;
    let alternates = failure(fast, &mut context);
    assert!(alternates.contains("from beat to beat"), "{alternates}");
}
