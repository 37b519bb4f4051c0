//! One patient from measured traces to the verification beat, task by task, in this process.

mod support;

use cardiotwin_schemas::organ::{ContractionSpec, OrganSpec};
use cardiotwin_schemas::outcome::{Ending, TaskResult};
use cardiotwin_schemas::settings::{CellFitSettings, Step1Settings};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::nodal::NodalRows;
use cardiotwin_worker::run::simulate;
use cardiotwin_worker::tasks::run_task;
use rand::{Rng, SeedableRng};

/// A short fit, because this test covers the chain; benchmarks cover the optimum.
fn short_fit() -> CellFitSettings {
    CellFitSettings {
        popsize: 3,
        max_generations: 5,
        polish: false,
        ..CellFitSettings::default()
    }
}

#[test]
fn traces_become_a_verified_cell() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    let step0 = support::step0("07-CoA");
    let state = support::passive_state(&step0, &mut context);
    let OrganSpec::Reduced { passive, .. } = &state.organ else {
        panic!("another organ")
    };
    assert!(passive.unloaded_volume_ml < passive.end_diastolic_volume_ml);
    assert!(
        state.diastasis_volume_error_ml.unwrap().abs() < 0.1,
        "{:?}",
        state.diastasis_volume_error_ml
    );
    assert_eq!(
        state.circulation.initial_windkessel_pressure_mmhg,
        step0.aortic_diastolic_mmhg.unwrap()
    );
    let estimated: Vec<&str> = state
        .estimates
        .iter()
        .map(|estimate| estimate.key.as_str())
        .collect();
    assert_eq!(
        estimated,
        ["solver.activation.onset_ms"],
        "the patient file gives everything else"
    );

    let (iterations, best, how) = support::step1(
        step0.cycle_length_ms,
        &state,
        &Step1Settings::default(),
        &mut context,
    );
    let best = &iterations[best.unwrap()];
    assert!(
        iterations.len() <= 4 && best.cost <= 0.1,
        "{how}: {} iterations, cost {}",
        iterations.len(),
        best.cost
    );
    let beat = best.result.as_ref().unwrap();
    assert!(!beat.periodic && beat.beats == 1);
    assert!(
        (0.75..0.9).contains(&beat.lambda_min),
        "{}",
        beat.lambda_min
    );
    assert!((0.0..20.0).contains(&beat.biomarkers.end_of_beat_gap_ml.unwrap()));
    let traces = std::fs::read_to_string(scratch.path().join("traces.csv")).unwrap();
    assert_eq!(
        traces.lines().count() as f64,
        step0.cycle_length_ms + 2.0,
        "header and one row a millisecond"
    );

    let targets = support::targets(scratch.path(), &mut context);
    assert!((targets.lambda_0 - 1.0).abs() < 0.01 && targets.n_nodes == 16);
    let median = std::fs::read_to_string(scratch.path().join("median.csv")).unwrap();
    assert!(
        median.starts_with("time_ms,Sa_kPa,lambda\n"),
        "Tanh has no calcium"
    );

    let fit = support::cell_fit_spec(step0.cycle_length_ms, &targets, short_fit());
    let TaskResult::CellFit(fit) =
        support::succeed(&TaskSpec::CellFit(Box::new(fit)), &mut context)
    else {
        panic!("not a cell fit")
    };
    assert_eq!((fit.generations, fit.evaluations), (5, 180));
    assert!((fit.cost_terms.values().sum::<f64>() - fit.cost).abs() < 1e-9 * fit.cost);
    let convergence = std::fs::read_to_string(scratch.path().join("convergence.csv")).unwrap();
    assert_eq!(
        convergence.lines().count(),
        7,
        "header, first population, five generations"
    );

    let spec = support::beat_spec(
        step0.cycle_length_ms,
        &state,
        &best.parameters,
        support::fitted_contraction(&fit),
    );
    let TaskResult::OrganBeat(verified) =
        support::succeed(&TaskSpec::OrganBeat(Box::new(spec)), &mut context)
    else {
        panic!("not a beat")
    };
    assert_eq!(verified.failed_check(), None);
    let text = std::fs::read_to_string(scratch.path().join("nodal.csv")).unwrap();
    assert!(NodalRows::begin(text.as_bytes()).unwrap().has_calcium);
}

#[test]
fn rates_of_a_smooth_pressure_are_differences_and_those_of_a_noisy_one_have_a_window() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    for number in 1..=7 {
        let state =
            support::passive_state(&support::step0(&format!("0{number}-CoA")), &mut context);
        assert!(state.noise_windows.are_none(), "0{number}-CoA");
    }

    let smooth = support::step0("07-CoA");
    let known = support::passive_state(&smooth, &mut context);
    let text =
        std::fs::read_to_string(support::patient_folder("07-CoA").join("pressure.csv")).unwrap();
    let mut draw = rand_pcg::Pcg64::seed_from_u64(7);
    let noisy =
        text.lines().map(
            |line| match line.split_once(',').map(|(t, p)| (t, p.parse::<f64>())) {
                Some((time, Ok(pressure))) => {
                    format!("{time},{}\n", pressure + draw.random_range(-2.6..2.6))
                }
                _ => format!("{line}\n"),
            },
        );
    let file = scratch.path().join("noisy.csv");
    std::fs::write(&file, noisy.collect::<String>()).unwrap();
    let mut spec = smooth.clone();
    spec.pressure = Some(support::input("pressure", &file));
    let state = support::passive_state(&spec, &mut context);
    let window_ms = state.noise_windows.pressure_ms.expect("a noisy pressure");
    assert!((4.0..=40.0).contains(&window_ms), "{window_ms}");

    // The window lowers the rates of both traces alike, so that a twin's simulated beat is not too
    // slow for its data.
    let ratio =
        state.measured.dpdt_max_mmhg_per_ms.unwrap() / known.measured.dpdt_max_mmhg_per_ms.unwrap();
    assert!((0.6..1.1).contains(&ratio), "{ratio}");
    let contraction = ContractionSpec::Tanh {
        parameters: Default::default(),
    };
    let rate = |state, context: &mut Context| {
        let beat = support::beat_spec(
            spec.cycle_length_ms,
            state,
            &Default::default(),
            contraction.clone(),
        );
        let TaskResult::OrganBeat(result) =
            support::succeed(&TaskSpec::OrganBeat(Box::new(beat)), context)
        else {
            panic!("not a beat")
        };
        result.biomarkers.dpdt_max_mmhg_per_ms.unwrap()
    };
    assert!(rate(&state, &mut context) < rate(&known, &mut context));
}

#[test]
fn what_a_patient_lacks_is_estimated_and_said() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    let full = support::step0("07-CoA");
    let known = support::passive_state(&full, &mut context);
    let mut spec = full.clone();
    spec.wall_volume_ml = None;
    spec.afterload = None;
    spec.left_atrial_pressure_mmhg = None;
    let state = support::passive_state(&spec, &mut context);
    assert_eq!(state.estimates.len(), 6, "{:?}", state.estimates);
    let ratio = |found: f64, known: f64| found / known;
    let (found, given) = (&state.circulation, &known.circulation);
    let resistance = ratio(
        found.afterload.peripheral_resistance_mmhg_s_per_ml,
        given.afterload.peripheral_resistance_mmhg_s_per_ml,
    );
    let compliance = ratio(
        found.afterload.compliance_ml_per_mmhg,
        given.afterload.compliance_ml_per_mmhg,
    );
    assert!(
        (0.8..1.25).contains(&resistance) && (0.6..1.6).contains(&compliance),
        "{resistance} {compliance}"
    );
    assert!(found.left_atrial_pressure_mmhg <= full.end_diastolic_pressure_mmhg.unwrap());
    assert!((found.left_atrial_pressure_mmhg - given.left_atrial_pressure_mmhg).abs() < 3.0);

    // A patient with these estimates can be simulated.
    let parameters = Default::default();
    let contraction = ContractionSpec::Tanh {
        parameters: Default::default(),
    };
    let beat = support::beat_spec(spec.cycle_length_ms, &state, &parameters, contraction);
    let TaskResult::OrganBeat(result) =
        support::succeed(&TaskSpec::OrganBeat(Box::new(beat)), &mut context)
    else {
        panic!("not a beat")
    };
    assert_eq!(result.failed_check(), None);
}

#[test]
fn a_weak_beat_opens_no_valve_and_is_a_simulation_all_the_same() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    let step0 = support::step0("07-CoA");
    let state = support::passive_state(&step0, &mut context);
    let weak = cardiotwin_schemas::organ::TanhParameters {
        smax_ref_kpa: 30.0,
        ..Default::default()
    };
    let contraction = ContractionSpec::Tanh { parameters: weak };
    let beat = support::beat_spec(
        step0.cycle_length_ms,
        &state,
        &Default::default(),
        contraction,
    );
    let outcome = simulate(&TaskSpec::OrganBeat(Box::new(beat)), context);
    let Ending::Succeeded { result } = outcome.ending else {
        panic!("{:?}", outcome.ending)
    };
    let TaskResult::OrganBeat(beat) = *result else {
        panic!("not a beat")
    };
    assert_eq!(
        beat.checks
            .iter()
            .filter(|check| check.is_of_a_valve())
            .count(),
        2,
        "{:?}",
        beat.checks
    );
    assert_eq!(beat.failed_simulation(), None);
    assert_eq!(
        beat.failed_valve().unwrap().name,
        "aortic valve opened and closed"
    );
    assert!(beat.biomarkers.p_max_mmhg.unwrap() < 70.0 && beat.biomarkers.ptd90_ms.is_some());
}

#[test]
fn pressure_alone_is_enough_where_a_volume_is_given() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    let mut spec = support::step0("07-CoA");
    spec.volume = None;
    let task = TaskSpec::PassiveState(Box::new(spec.clone()));
    let image = spec.diastasis_volume_ml.unwrap();
    let TaskResult::PassiveState(state) = support::succeed(&task, &mut context) else {
        panic!("not step 0")
    };
    assert_eq!(state.measured.edv_ml, Some(image));
    assert!(state.measured.tau_vd_ms.is_none() && state.measured.p_max_mmhg.is_some());

    spec.diastasis_volume_ml = None;
    let Ending::Failed { failure } = run_task(
        &TaskSpec::PassiveState(Box::new(spec.clone())),
        &mut context,
    ) else {
        panic!("no volume at all must fail")
    };
    assert!(
        failure.message.contains("end-diastolic volume") && failure.remedy.is_some(),
        "{failure:?}"
    );

    spec.end_diastolic_volume_ml = Some(120.0);
    let state = support::passive_state(&spec, &mut context);
    assert_eq!(state.measured.edv_ml, Some(120.0));
}

/// The perturbed values are the targets of step 1; heart and loads are those of the measured data.
#[test]
fn a_sample_of_uncertain_data_changes_targets_and_nothing_else() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    let mut spec = support::step0("02-CoA");
    spec.afterload = None; // estimated from peak pressure and volume, unaffected by the factors
    spec.aortic_systolic_mmhg = None;
    let measured = support::passive_state(&spec, &mut context);
    let task = TaskSpec::PassiveState(Box::new(spec.clone()));
    assert!(
        !task.canonical().contains("biomarker_factors"),
        "a task without factors keeps its key"
    );
    let key = task.key();
    spec.biomarker_factors = [
        ("P_max_mmHg".to_owned(), 1.07),
        ("tau_VR_ms".to_owned(), 0.93),
    ]
    .into();
    assert_ne!(TaskSpec::PassiveState(Box::new(spec.clone())).key(), key);
    let mut sample = support::passive_state(&spec, &mut context);
    let ratio = |of: fn(&cardiotwin_schemas::biomarkers::Biomarkers) -> Option<f64>| {
        of(&sample.measured).unwrap() / of(&measured.measured).unwrap()
    };
    assert!(
        (ratio(|b| b.p_max_mmhg) - 1.07).abs() < 1e-12
            && (ratio(|b| b.tau_vr_ms) - 0.93).abs() < 1e-12
    );
    assert_eq!(sample.biomarker_factors, spec.biomarker_factors);
    assert_eq!(sample.remarks.len(), measured.remarks.len() + 1);
    sample.measured = measured.measured;
    sample.biomarker_factors.clear();
    sample.remarks.pop();
    assert_eq!(sample, measured);
}

#[test]
fn several_beats_become_periodic_and_leave_no_gap() {
    let scratch = tempfile::tempdir().unwrap();
    let mut context = Context::plain(scratch.path(), 1);
    let step0 = support::step0("02-CoA");
    let state = support::passive_state(&step0, &mut context);
    let contraction = ContractionSpec::Tanh {
        parameters: Default::default(),
    };
    let mut beat = support::beat_spec(
        step0.cycle_length_ms,
        &state,
        &Default::default(),
        contraction,
    );
    beat.beats = cardiotwin_schemas::organ::BeatCount::Periodic {
        max: 40,
        tolerance: 0.05,
    };
    let TaskResult::OrganBeat(result) =
        support::succeed(&TaskSpec::OrganBeat(Box::new(beat)), &mut context)
    else {
        panic!("not a beat")
    };
    assert!(
        result.periodic && result.beats > 2,
        "{} beats",
        result.beats
    );
    assert_eq!(
        result.biomarkers.end_of_beat_gap_ml, None,
        "a periodic simulation has its own end-diastolic volume"
    );
}
