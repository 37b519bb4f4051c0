//! Both updates of step 1, with a simulated organ that is another one-fibre ventricle than the
//! surrogate.

mod support;

use std::collections::BTreeMap;

use cardiotwin_calibrate::fixed_point::{self, Cost, Decision, History, Outcome};
use cardiotwin_models::ventricle::{OneFibrePassive, PassiveLaw as _};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::finite_element::{FiniteElementOrgan, VentricleFigures};
use cardiotwin_schemas::organ::{ContractionSpec, EffectSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Ending, PassiveStateResult, Step1ProposalResult, TaskResult};
use cardiotwin_schemas::settings::Step1Settings;
use cardiotwin_schemas::task::{InputFile, OrganBeatSpec, Step1ProposalSpec, Step1Run, TaskSpec};
use cardiotwin_units::{Ml, Mmhg};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::organ_beat::{ReducedOrgan, reduced_beat};
use cardiotwin_worker::tasks::proposal::outcome;
use cardiotwin_worker::tasks::run_task;

/// A patient with the simulated organ and the surrogate.
struct Patient {
    cycle_length_ms: f64,
    state: PassiveStateResult,
    /// Weights of the cost; empty for the default weights.
    weights: BTreeMap<String, f64>,
}

impl Patient {
    fn new(id: &str) -> Self {
        let scratch = tempfile::tempdir().unwrap();
        let spec = support::step0(id);
        let state = support::passive_state(&spec, &mut Context::plain(scratch.path(), 1));
        Self {
            cycle_length_ms: spec.cycle_length_ms,
            state,
            weights: BTreeMap::new(),
        }
    }

    fn beat(&self, p: &Step1Parameters) -> OrganBeatSpec {
        support::beat_spec(
            self.cycle_length_ms,
            &self.state,
            p,
            ContractionSpec::Tanh { parameters: p.tanh },
        )
    }

    /// Outcome of the ventricle that stands for the expensive one.
    fn other(&self, p: &Step1Parameters, differs: bool) -> Outcome {
        let OrganSpec::Reduced {
            mut passive,
            mut activation,
        } = self.state.organ.clone()
        else {
            panic!()
        };
        let mut p = *p;
        if differs {
            passive = OneFibrePassive::through(
                Ml(0.95 * passive.unloaded_volume_ml),
                Ml(passive.end_diastolic_volume_ml),
                Mmhg(passive.end_diastolic_pressure_mmhg),
                Ml(0.72 * passive.wall_volume_ml),
                0.7 * passive.exponent,
            )
            .unwrap();
            activation.spread_ms = 62.0;
            (p.tanh.a6, p.tanh.a7, p.tanh.t_emd_ms) = (4.2, 0.67, 19.0);
        }
        let beat = reduced_beat(
            &self.beat(&p),
            &ReducedOrgan::one_fibre(passive, activation),
        )
        .unwrap();
        outcome(beat.as_ref())
    }

    fn spec(&self, runs: &[Step1Run]) -> Step1ProposalSpec {
        let settings = Step1Settings::default();
        Step1ProposalSpec {
            beat: self.beat(&Step1Parameters::default()),
            measured: self.state.measured,
            runs: runs.to_vec(),
            bounds: settings.bounds,
            frozen: settings.frozen,
            weights: self.weights.clone(),
            law: None,
            prior: None,
            seed: 1,
        }
    }

    fn proposal(&self, runs: &[Step1Run]) -> Step1ProposalResult {
        let scratch = tempfile::tempdir().unwrap();
        let task = TaskSpec::Step1Proposal(Box::new(self.spec(runs)));
        match support::succeed(&task, &mut Context::plain(scratch.path(), 1)) {
            TaskResult::Step1Proposal(result) => result,
            other => panic!("{other:?}"),
        }
    }

    fn cost(&self, outcome: &Outcome) -> f64 {
        match outcome {
            Outcome::Simulated(found) => Cost::of(&self.state.measured, found).total,
            Outcome::NoWholeBeat(_) | Outcome::Failed => f64::INFINITY,
        }
    }

    fn outcomes(&self, n: usize, differs: bool) -> Vec<Outcome> {
        let mut runs = Vec::new();
        (0..n)
            .map(|_| {
                let proposal = self.proposal(&runs);
                let outcome = self.other(&proposal.parameters, differs);
                runs.push(Step1Run {
                    parameters: proposal.parameters,
                    biomarkers: match &outcome {
                        Outcome::Simulated(found) | Outcome::NoWholeBeat(found) => Some(*found),
                        Outcome::Failed => None,
                    },
                    whole_beat: matches!(outcome, Outcome::Simulated(_)),
                    predicted_misfit: Some(proposal.predicted_misfit),
                });
                outcome
            })
            .collect()
    }

    fn space_mapping(&self, n: usize, differs: bool) -> Vec<f64> {
        self.outcomes(n, differs)
            .iter()
            .map(|outcome| self.cost(outcome))
            .collect()
    }

    fn fixed_point(&self, n: usize) -> Vec<f64> {
        let settings = Step1Settings {
            tolerance: 1e-9,
            stall_iterations: 100,
            ..support::fixed_point_settings(&Step1Settings::default())
        };
        let mut history = History::new(Step1Parameters::default());
        let mut costs = Vec::new();
        let measured = &self.state.measured;
        while costs.len() < n {
            let Decision::Next { parameters, .. } =
                fixed_point::decide(&settings, measured, &history).unwrap()
            else {
                break;
            };
            let outcome = self.other(&parameters, true);
            costs.push(self.cost(&outcome));
            history.push(parameters, outcome);
        }
        costs
    }
}

/// Number of simulations until the cost is at most `level`.
fn until(costs: &[f64], level: f64) -> Option<usize> {
    costs
        .iter()
        .position(|cost| *cost <= level)
        .map(|position| position + 1)
}

/// Whether `a` is not later than `b`; `None` is later than any number.
fn no_later(a: Option<usize>, b: Option<usize>) -> bool {
    a.unwrap_or(usize::MAX) <= b.unwrap_or(usize::MAX)
}

/// `--nocapture` prints the table of docs/step1.md.
#[test]
fn space_mapping_needs_fewer_simulations_than_the_fixed_point_for_every_patient() {
    let number = |n: Option<usize>| n.map_or("-".to_owned(), |n| n.to_string());
    let list = |costs: &[f64]| {
        costs
            .iter()
            .map(|cost| format!("{cost:.3}"))
            .collect::<Vec<_>>()
            .join(" ")
    };
    println!("| patient | fixed point | to 0.1 | to 0.02 | space mapping | to 0.1 | to 0.02 |");
    for id in support::PATIENTS {
        let patient = Patient::new(id);
        let (fixed, mapped) = (patient.fixed_point(10), patient.space_mapping(4, true));
        let [f1, f2] = [0.1, 0.02].map(|level| until(&fixed, level));
        let [m1, m2] = [0.1, 0.02].map(|level| until(&mapped, level));
        let [f, m] = [(f1, f2), (m1, m2)].map(|(a, b)| format!("{} | {}", number(a), number(b)));
        println!(
            "| {id} | {} | {f} | {} | {m} |",
            list(&fixed),
            list(&mapped)
        );
        assert!(m1.is_some_and(|n| n <= 2), "{id}: {mapped:?}");
        assert!(
            no_later(m1, f1) && no_later(m2, f2),
            "{id}: {mapped:?} against {fixed:?}"
        );
        let best = |costs: &[f64]| costs.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(
            best(&mapped) < best(&fixed),
            "{id}: {mapped:?} against {fixed:?}"
        );
    }
}

#[test]
fn weights_lead_to_what_they_weigh() {
    let off = |patient: &Patient, key: &str| {
        let Outcome::Simulated(found) = patient.outcomes(4, true)[3] else {
            panic!()
        };
        let biomarker = Biomarker::named(key).unwrap();
        let clinical = patient.state.measured.get(biomarker).unwrap();
        (found.get(biomarker).unwrap() / clinical - 1.0).abs()
    };
    let mut patient = Patient::new("06-CoA");
    for (key, weight) in [("SV_mL", 50.0), ("PTD90_ms", 50.0)] {
        patient.weights = BTreeMap::new();
        let without = off(&patient, key);
        patient.weights = [(key.to_owned(), weight)].into();
        let with = off(&patient, key);
        assert!(
            with < 0.5 * without,
            "{key}: {with} with its weight, {without} without"
        );
    }
}

#[test]
fn where_the_same_ventricle_is_simulated_the_first_proposal_is_near_its_optimum() {
    for id in ["01-CoA", "04-CoA"] {
        let costs = Patient::new(id).space_mapping(1, false);
        assert!(costs[0] < 0.1, "{id}: {costs:?}");
    }
}

#[test]
fn an_accepted_effect_acts_on_the_proposal_and_one_that_cannot_is_refused() {
    let mut patient = Patient::new("02-CoA");
    let without = patient.proposal(&[]).parameters;
    let kick = |name: &str| EffectSpec {
        name: name.into(),
        parameters: [("amplitude_mmHg".to_owned(), 8.0)].into(),
    };
    patient.state.circulation.effects = vec![kick("atrial_kick")];
    assert_ne!(patient.proposal(&[]).parameters, without);
    patient.state.circulation.effects = vec![kick("atrial_kicks")];
    let scratch = tempfile::tempdir().unwrap();
    let task = TaskSpec::Step1Proposal(Box::new(patient.spec(&[])));
    match run_task(&task, &mut Context::plain(scratch.path(), 1)) {
        Ending::Failed { failure } => assert_eq!(failure.class, FailureClass::Input),
        ending => panic!("{ending:?}"),
    }
}

/// The figures of a finite-element ventricle suffice; its mesh is not read.
#[test]
fn a_finite_element_ventricle_is_proposed_for_by_a_one_fibre_one_of_its_volumes() {
    let mut patient = Patient::new("02-CoA");
    let OrganSpec::Reduced {
        passive,
        activation,
    } = patient.state.organ
    else {
        panic!()
    };
    let figures = VentricleFigures {
        nodes: 1,
        elements: 1,
        degrees_of_freedom: 3,
        mean_edge_mm: 1.0,
        wall_volume_ml: passive.wall_volume_ml,
        image_volume_ml: passive.end_diastolic_volume_ml,
        image_pressure_mmhg: passive.end_diastolic_pressure_mmhg,
        unloaded_volume_ml: passive.unloaded_volume_ml,
        end_diastolic_volume_ml: passive.end_diastolic_volume_ml,
        end_diastolic_pressure_mmhg: passive.end_diastolic_pressure_mmhg,
        stiffness_kpa: 1.0,
        exponent_factor: 1.0,
        onset_ms: activation.onset_ms,
        spread_ms: activation.spread_ms,
        epicardial_duration_share: 0.9,
    };
    let ventricle = InputFile {
        name: "ventricle".into(),
        path: "nowhere".into(),
        sha256: "0".into(),
    };
    patient.state.organ =
        OrganSpec::FiniteElement(Box::new(FiniteElementOrgan { ventricle, figures }));
    assert!(patient.proposal(&[]).predicted_cost < 0.02);
}
