//! The organ's law in 3D: what one beat teaches about another one.

mod support;

use std::path::Path;

use cardiotwin_calibrate::organ_law::{LawBeat, OrganFeatures, fit_law, shipped_prior};
use cardiotwin_models::ventricle::OneFibrePassive;
use cardiotwin_models::ventricle::PassiveLaw as _;
use cardiotwin_models::ventricle::passive_state::DEFAULT_EXPONENT;
use cardiotwin_schemas::finite_element::{FiniteElementSettings, VentricleFigures};
use cardiotwin_schemas::organ::{ContractionSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::organ_law::{LawKnowledge, LawSamples, N_LAW_SAMPLES};
use cardiotwin_schemas::outcome::{Ending, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, PassiveStateSpec, Step1ProposalSpec, TaskSpec};
use cardiotwin_units::{Ml, Mmhg};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::run::simulate_in_law;
use cardiotwin_worker::tasks::run_task;
use support::{beat_spec, step0};

fn result(task: TaskSpec, folder: &Path) -> TaskResult {
    match run_task(&task, &mut Context::plain(folder, 1)) {
        Ending::Succeeded { result } => *result,
        other => panic!("{other:?}"),
    }
}

fn samples(spec: &OrganBeatSpec, folder: &Path) -> LawSamples {
    match result(TaskSpec::OrganBeat(Box::new(spec.clone())), folder) {
        TaskResult::OrganBeat(beat) => beat.law.expect("a finite-element beat has samples"),
        other => panic!("{other:?}"),
    }
}

fn law_beat(samples: &LawSamples) -> LawBeat<'_> {
    LawBeat {
        volume_ml: &samples.volume_ml,
        pressure_mmhg: &samples.pressure_mmhg,
        stress_kpa: &samples.active_stress_kpa,
        stretch: &samples.stretch,
        stretch_deviation: &samples.stretch_deviation,
        stress_deviation_kpa: &samples.stress_deviation_kpa,
        slack: None,
    }
}

fn one_fibre(figures: &VentricleFigures) -> OneFibrePassive {
    OneFibrePassive::through(
        Ml(figures.unloaded_volume_ml),
        Ml(figures.end_diastolic_volume_ml),
        Mmhg(figures.end_diastolic_pressure_mmhg),
        Ml(figures.wall_volume_ml),
        DEFAULT_EXPONENT * figures.exponent_factor,
    )
    .unwrap()
}

/// Root mean square of differences.
fn rms(differences: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = differences.len() as f64;
    (differences.map(|d| d * d).sum::<f64>() / n).sqrt()
}

#[test]
fn the_law_of_one_beat_predicts_another_one_and_is_proposed_in() {
    let folder = tempfile::tempdir().unwrap();
    let settings = FiniteElementSettings {
        mesh_nodes: 500,
        ..FiniteElementSettings::default()
    };
    let spec = PassiveStateSpec {
        finite_element: Some(settings.anatomy(&[])),
        ..step0("01-CoA")
    };
    let cycle_length_ms = spec.cycle_length_ms;
    let TaskResult::PassiveState(state) =
        result(TaskSpec::PassiveState(Box::new(spec)), folder.path())
    else {
        panic!("another result")
    };
    let OrganSpec::FiniteElement(organ) = &state.organ else {
        panic!("another organ")
    };
    let beat = |parameters: &Step1Parameters| {
        let contraction = ContractionSpec::Tanh {
            parameters: parameters.tanh,
        };
        OrganBeatSpec {
            time_step_ms: 2.0,
            newton_iterations: settings.newton_iterations,
            finite_element: Some(settings.equations()),
            ..beat_spec(cycle_length_ms, &state, parameters, contraction)
        }
    };
    let first = beat(&Step1Parameters::default());
    let mut weaker = Step1Parameters::default();
    weaker.tanh.smax_ref_kpa *= 0.75;
    weaker.tanh.tau_sr_ref_ms *= 2.0;
    let (known, unseen) = (
        samples(&first, folder.path()),
        samples(&beat(&weaker), folder.path()),
    );
    assert_eq!(known.stretch.len(), N_LAW_SAMPLES);
    let passive = one_fibre(&organ.figures);
    let features = OrganFeatures::default();
    let law = fit_law(&passive, &features, &[law_beat(&known)], &shipped_prior()).unwrap();
    // The stretch of this beat's cells is counted from end-diastole.
    let end_diastolic = law.end_diastolic_stretch(&passive);
    let differences = |of: &dyn Fn(usize) -> f64| rms((0..N_LAW_SAMPLES).map(of));
    let pressure = differences(&|k| {
        let (volume, stress) = (unseen.volume_ml[k], unseen.active_stress_kpa[k]);
        law.pressure(&passive, volume, stress).value - unseen.pressure_mmhg[k]
    });
    let stretch = differences(&|k| {
        let (volume, stress) = (unseen.volume_ml[k], unseen.active_stress_kpa[k]);
        let difference = law.stretch_per_difference(stress) * unseen.stress_deviation_kpa[k];
        (law.stretch(&passive, volume, stress).value + difference) / end_diastolic
            - unseen.stretch[k]
    });
    println!("pressure {pressure:.2} mmHg, stretch {stretch:.4}");
    assert!(pressure < 1.5, "{pressure} mmHg");
    assert!(stretch < 0.01, "{stretch}");

    // The law simulates the unseen beat in the ventricle's place.
    let task = TaskSpec::OrganBeat(Box::new(beat(&weaker)));
    let context = Context::plain(folder.path(), 1);
    let knowledge = LawKnowledge {
        beats: vec![known.clone()],
        prior: None,
    };
    let outcome = simulate_in_law(&task, &knowledge, context);
    let Ending::Succeeded { result: simulated } = outcome.ending else {
        panic!("{:?}", outcome.ending)
    };
    let TaskResult::OrganBeat(simulated) = *simulated else {
        panic!("{simulated:?}")
    };
    let highest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let (in_law, in_3d) = (
        simulated.biomarkers.p_max_mmhg.unwrap(),
        highest(&unseen.pressure_mmhg),
    );
    println!("P_max {in_law:.1} mmHg for {in_3d:.1} mmHg in 3D");
    assert!((in_law / in_3d - 1.0).abs() < 0.04, "{in_law} {in_3d}");
    assert!(
        outcome.artefacts.iter().any(|a| a.name == "traces"),
        "the law's beat has traces"
    );

    let defaults = cardiotwin_schemas::settings::Step1Settings::default();
    let proposal = |law: Option<Vec<LawSamples>>| {
        let spec = Step1ProposalSpec {
            beat: first.clone(),
            measured: state.measured,
            runs: Vec::new(),
            bounds: defaults.bounds.clone(),
            frozen: defaults.frozen.clone(),
            weights: defaults.weights.clone(),
            law,
            prior: None,
            seed: 1,
        };
        match result(TaskSpec::Step1Proposal(Box::new(spec)), folder.path()) {
            TaskResult::Step1Proposal(proposal) => (proposal.parameters, proposal.learned_law),
            other => panic!("{other:?}"),
        }
    };
    let (without, of_prior) = (proposal(None), proposal(Some(Vec::new())));
    let learned = proposal(Some(vec![known.clone()]));
    assert!(without.0 != of_prior.0 && of_prior.0 != learned.0);
    assert!(without.1.is_none(), "a spring has no law");
    assert_eq!(of_prior.1.expect("a law").beats.len(), 0);
    let drawn = learned.1.as_ref().expect("a law");
    let fit = &drawn.beats[0];
    assert_eq!(fit.pressure_mmhg, known.pressure_mmhg);
    println!("before {:?}, after {:?}", fit.before, fit.after);
    assert!(fit.after.rms_mmhg < 1.0 && fit.after.rms_mmhg < fit.before.rms_mmhg);
    assert_eq!(
        learned,
        proposal(Some(vec![known])),
        "the same beats, the same answer"
    );
}
