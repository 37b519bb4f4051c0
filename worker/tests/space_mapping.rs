//! Both updates of step 1 where the simulated organ is another one-fibre ventricle than the one that proposes.

mod support;

use cardiotwin_calibrate::fixed_point::{self, Cost, Decision, History, Outcome};
use cardiotwin_models::ventricle::OneFibrePassive;
use cardiotwin_schemas::organ::{ContractionSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Ending, PassiveStateResult, Step1ProposalResult, TaskResult};
use cardiotwin_schemas::settings::Step1Settings;
use cardiotwin_schemas::task::{OrganBeatSpec, Step1ProposalSpec, Step1Run, TaskSpec};
use cardiotwin_units::{Ml, Mmhg};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::step1;
use cardiotwin_worker::tasks::organ_beat::reduced_beat;
use cardiotwin_worker::tasks::run_task;

/// What is simulated, and what proposes.
struct Patient {
    cycle_length_ms: f64,
    state: PassiveStateResult,
}

impl Patient {
    fn new(id: &str) -> Self {
        let scratch = tempfile::tempdir().unwrap();
        let spec = support::step0(id);
        let state = support::passive_state(&spec, &mut Context::plain(scratch.path(), 1));
        Self { cycle_length_ms: spec.cycle_length_ms, state }
    }

    fn beat(&self, p: &Step1Parameters) -> OrganBeatSpec {
        support::beat_spec(self.cycle_length_ms, &self.state, p, ContractionSpec::Tanh { parameters: p.tanh })
    }

    /// The ventricle that plays the expensive one.
    fn other(&self, p: &Step1Parameters, differs: bool) -> Outcome {
        let OrganSpec::Reduced { mut passive, mut activation } = self.state.organ.clone() else { panic!() };
        let mut p = *p;
        if differs {
            let law = OneFibrePassive::through(
                Ml(0.95 * passive.unloaded_volume_ml),
                Ml(passive.end_diastolic_volume_ml),
                Mmhg(passive.end_diastolic_pressure_mmhg),
                Ml(0.72 * passive.wall_volume_ml),
                0.7 * passive.exponent,
            )
            .unwrap();
            passive.wall_volume_ml = law.wall_volume.0;
            passive.unloaded_volume_ml = law.unloaded_volume.0;
            passive.stiffness_kpa = law.stiffness.0;
            passive.exponent = law.exponent;
            activation.spread_ms = 62.0;
            (p.tanh.a6, p.tanh.a7, p.tanh.t_emd_ms) = (4.2, 0.67, 19.0);
        }
        match reduced_beat(&self.beat(&p), &passive, &activation).unwrap() {
            Some(beat) => step1::outcome(&beat),
            None => Outcome::Failed,
        }
    }

    fn proposal(&self, runs: &[Step1Run]) -> Step1ProposalResult {
        let settings = Step1Settings::default();
        let spec = Step1ProposalSpec {
            beat: self.beat(&Step1Parameters::default()),
            measured: self.state.measured,
            runs: runs.to_vec(),
            bounds: settings.bounds,
            frozen: settings.frozen,
            seed: 1,
        };
        let scratch = tempfile::tempdir().unwrap();
        match run_task(&TaskSpec::Step1Proposal(Box::new(spec)), &mut Context::plain(scratch.path(), 1)) {
            Ending::Succeeded { result } => match *result {
                TaskResult::Step1Proposal(result) => result,
                other => panic!("{other:?}"),
            },
            ending => panic!("{ending:?}"),
        }
    }

    fn cost(&self, outcome: &Outcome) -> f64 {
        match outcome {
            Outcome::Simulated(found) => Cost::of(&step1::biomarkers(&self.state.measured), found).total,
            Outcome::NoWholeBeat(_) | Outcome::Failed => f64::INFINITY,
        }
    }

    fn space_mapping(&self, n: usize, differs: bool) -> Vec<f64> {
        let mut runs = Vec::new();
        (0..n)
            .map(|_| {
                let begun = std::time::Instant::now();
                let proposal = self.proposal(&runs);
                let outcome = self.other(&proposal.parameters, differs);
                println!(
                    "   predicted {:.4} found {:.4} radius {:.3?} step {:.3?} {} beats {:.2} s {:.3?} from {:?}",
                    proposal.predicted_cost,
                    self.cost(&outcome),
                    proposal.trust_radius,
                    proposal.step,
                    proposal.reduced_beats,
                    begun.elapsed().as_secs_f64(),
                    proposal.parameters.updated(),
                    proposal.from_iteration,
                );
                runs.push(Step1Run {
                    parameters: proposal.parameters,
                    biomarkers: match &outcome {
                        Outcome::Simulated(found) | Outcome::NoWholeBeat(found) => Some(step1::to_schema(found)),
                        Outcome::Failed => None,
                    },
                    whole_beat: matches!(outcome, Outcome::Simulated(_)),
                    predicted_cost: Some(proposal.predicted_cost),
                });
                self.cost(&outcome)
            })
            .collect()
    }

    fn fixed_point(&self, n: usize) -> Vec<f64> {
        let settings = fixed_point::Settings {
            tolerance: 1e-9,
            stagnation_iterations: 100,
            ..support::fixed_point_settings(&Step1Settings::default())
        };
        let start = Step1Parameters::default();
        let mut history = History::new(step1::parameters(&start));
        let mut costs = Vec::new();
        let measured = step1::biomarkers(&self.state.measured);
        while costs.len() < n {
            let Decision::Next { parameters, .. } = fixed_point::decide(&settings, &measured, &history).unwrap() else {
                break;
            };
            let outcome = self.other(&step1::with(&start, &parameters), true);
            costs.push(self.cost(&outcome));
            history.push(parameters, outcome);
        }
        costs
    }
}

/// Simulations until the best cost is at most `level`.
fn until(costs: &[f64], level: f64) -> Option<usize> {
    costs.iter().position(|cost| *cost <= level).map(|position| position + 1)
}

#[test]
fn table() {
    for id in support::PATIENTS {
        let patient = Patient::new(id);
        let fixed = patient.fixed_point(10);
        println!("{id} fixed {fixed:.3?}");
        let mapped = patient.space_mapping(6, true);
        println!("{id} mapped {mapped:.3?}");
        println!(
            "{id} to 0.1: {:?} {:?}, to 0.02: {:?} {:?}",
            until(&fixed, 0.1),
            until(&mapped, 0.1),
            until(&fixed, 0.02),
            until(&mapped, 0.02)
        );
    }
}
