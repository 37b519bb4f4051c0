//! A patient's chain as far as its tasks are settled. It is the basis of reports and is derived
//! again at every decision.

use std::collections::BTreeMap;

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::organ::Step1Parameters;
use cardiotwin_schemas::record::{Step1Summary, Step3Summary};
use cardiotwin_schemas::verdict::Verdict;
use serde::{Deserialize, Serialize};

use super::patient::{Stage, Step};

/// Settled tasks of a patient, in the order of the chain.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Chain {
    /// Task of step 0.
    pub step0: Option<TaskKey>,
    /// Task that learned the organ's law from pilots.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<TaskKey>,
    /// Simulations of step 1, including failed ones and those under earlier settings.
    pub iterations: Vec<ChainIteration>,
    /// Proposals for step 1's simulations, if they are tasks of their own. The simulation of the
    /// last one may not have been made yet.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub proposals: Vec<ChainProposal>,
    /// Ending of step 1; `None` until then.
    pub step1: Option<Step1Summary>,
    /// Task of step 2's targets.
    pub targets: Option<TaskKey>,
    /// Task of step 2's fit.
    pub cell_fit: Option<TaskKey>,
    /// Task of the fit of step 2's cell in the organ's law.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub organ_fit: Option<TaskKey>,
    /// Cost of step 2's fit.
    pub step2_cost: Option<f64>,
    /// Task of the verification beat.
    pub verification: Option<TaskKey>,
    /// Cost of the verification beat by step 1's formula.
    pub verification_cost: Option<f64>,
    /// Verdict on the twin from the best beat with a cell in the organ: the verification beat, or a
    /// simulation of step 3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Simulations of step 3, including failed ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub step3_iterations: Vec<Step3ChainIteration>,
    /// Proposals for step 3's simulations.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub step3_proposals: Vec<ChainProposal>,
    /// Ending of step 3; `None` until then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step3: Option<Step3Summary>,
    /// Task of the posterior, which measures how certain the twin is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<TaskKey>,
    /// Tasks to which the model had no answer, and without which the chain continued.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unanswered: Vec<ChainUnanswered>,
    /// Tasks of a no-op workflow.
    pub noops: Vec<TaskKey>,
    /// The only task of an element of a sweep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task: Option<TaskKey>,
}

/// One simulation of step 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChainIteration {
    /// Parameters of the Tanh model and the valves with which the organ was simulated.
    pub parameters: Step1Parameters,
    /// Key of the task.
    pub task: TaskKey,
    /// Sum of squared relative differences; `None` if the simulation failed.
    pub cost: Option<f64>,
    /// Whether a valve did not open and close, so that the beat cannot be the result.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub no_whole_beat: bool,
    /// (simulated − measured) / measured, by biomarker.
    pub relative_differences: BTreeMap<String, f64>,
}

/// One simulation of step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step3ChainIteration {
    /// Parameters that step 3 moves, by name.
    pub parameters: BTreeMap<String, f64>,
    /// Key of the task.
    pub task: TaskKey,
    /// Sum of squared differences over the measurements' variances; `None` if the simulation
    /// failed.
    pub misfit: Option<f64>,
    /// Whether both valves opened and closed.
    pub whole_beat: bool,
    /// Verdict on the twin; `None` if the simulation failed.
    pub verdict: Option<Verdict>,
}

/// A proposal for a simulation of step 1 or 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChainProposal {
    /// Number of the iteration, from 1.
    pub iteration: u32,
    /// Key of the task.
    pub task: TaskKey,
    /// Cost that the corrected one-fibre ventricle predicts for the simulation, without weights.
    pub predicted_cost: f64,
    /// Misfit that it predicts, with the weights of the step.
    #[serde(default)]
    pub predicted_misfit: f64,
}

/// A task that failed without holding its patient: a proposal, a fit in the organ's law, or a
/// posterior.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChainUnanswered {
    /// Step of the task.
    pub step: Step,
    /// Key of the task.
    pub task: TaskKey,
}

impl Chain {
    /// Every settled task with its step.
    pub fn steps(&self) -> impl Iterator<Item = (Step, &TaskKey)> {
        let iterations = self.iterations.iter().map(|i| &i.task);
        let of = |stage: Stage| {
            move |p: &'_ ChainProposal| Step {
                stage,
                number: p.iteration,
            }
        };
        let (of_step1, of_step3) = (of(Stage::Step1Proposal), of(Stage::Step3Proposal));
        let proposals = (self.proposals.iter().map(move |p| (of_step1(p), &p.task))).chain(
            self.step3_proposals
                .iter()
                .map(move |p| (of_step3(p), &p.task)),
        );
        let mut steps: Vec<(Step, &TaskKey)> = [Stage::Step0]
            .into_iter()
            .zip(&self.step0)
            .chain([Stage::LearnLaw].into_iter().zip(&self.law))
            .chain(std::iter::repeat(Stage::Step1).zip(iterations))
            .chain([Stage::Targets].into_iter().zip(&self.targets))
            .chain([Stage::Step2].into_iter().zip(&self.cell_fit))
            .chain([Stage::Step2Organ].into_iter().zip(&self.organ_fit))
            .chain([Stage::Verification].into_iter().zip(&self.verification))
            .chain(
                std::iter::repeat(Stage::Step3).zip(self.step3_iterations.iter().map(|i| &i.task)),
            )
            .chain([Stage::Posterior].into_iter().zip(&self.posterior))
            .chain(std::iter::repeat(Stage::Noop).zip(&self.noops))
            .chain([Stage::Task].into_iter().zip(&self.task))
            .scan((None, 0), |(last, number), (stage, key)| {
                *number = if *last == Some(stage) { *number + 1 } else { 1 };
                *last = Some(stage);
                Some((
                    Step {
                        stage,
                        number: *number,
                    },
                    key,
                ))
            })
            .chain(proposals)
            .chain(self.unanswered.iter().map(|task| (task.step, &task.task)))
            .collect();
        steps.sort_by_key(|(step, _)| *step);
        steps.into_iter()
    }

    /// The task of a stage to which the model had no answer.
    #[must_use]
    pub fn unanswered(&self, stage: Stage) -> Option<&TaskKey> {
        let of_stage = self.unanswered.iter().find(|task| task.step.stage == stage);
        of_stage.map(|task| &task.task)
    }

    /// Proposal for an iteration of step 1, from 1.
    #[must_use]
    pub fn proposal(&self, iteration: u32) -> Option<&ChainProposal> {
        self.proposals
            .iter()
            .find(|proposal| proposal.iteration == iteration)
    }

    /// Proposal for an iteration of step 3, from 1.
    #[must_use]
    pub fn step3_proposal(&self, iteration: u32) -> Option<&ChainProposal> {
        self.step3_proposals
            .iter()
            .find(|proposal| proposal.iteration == iteration)
    }

    /// Lowest cost of step 1's whole beats so far.
    #[must_use]
    pub fn best_cost(&self) -> Option<f64> {
        self.iterations
            .iter()
            .filter(|i| !i.no_whole_beat)
            .filter_map(|i| i.cost)
            .min_by(f64::total_cmp)
    }
}
