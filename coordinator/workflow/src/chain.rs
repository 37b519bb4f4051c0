//! A patient's chain as far as its tasks are settled: what reports read, computed anew at every decision.

use std::collections::BTreeMap;

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::organ::Step1Parameters;
use cardiotwin_schemas::record::{Step1Summary, Step3Summary};
use cardiotwin_schemas::verdict::Verdict;
use serde::{Deserialize, Serialize};

use super::patient::{Stage, Step};

/// Settled tasks of a patient, in order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Chain {
    /// Step 0.
    pub step0: Option<TaskKey>,
    /// Step 1's simulations, failed ones and those of earlier settings included.
    pub iterations: Vec<ChainIteration>,
    /// What step 1's simulations were proposed by, where a task of its own did; the last one's may be still to come.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub proposals: Vec<ChainProposal>,
    /// How step 1 ended.
    pub step1: Option<Step1Summary>,
    /// Step 2's targets.
    pub targets: Option<TaskKey>,
    /// Step 2.
    pub cell_fit: Option<TaskKey>,
    /// Its cost.
    pub step2_cost: Option<f64>,
    /// The verification beat.
    pub verification: Option<TaskKey>,
    /// Its cost by step 1's formula.
    pub verification_cost: Option<f64>,
    /// What the best beat with a cell in the organ says of the twin: the verification beat, or one of step 3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Step 3's simulations, failed ones included.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub step3_iterations: Vec<Step3ChainIteration>,
    /// What they were proposed by.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub step3_proposals: Vec<ChainProposal>,
    /// How step 3 ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step3: Option<Step3Summary>,
    /// How sure the twin is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<TaskKey>,
    /// No-op tasks.
    pub noops: Vec<TaskKey>,
    /// The one task of a sweep's element.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task: Option<TaskKey>,
}

/// One simulation of step 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChainIteration {
    /// What was simulated.
    pub parameters: Step1Parameters,
    /// The task.
    pub task: TaskKey,
    /// Sum of squared relative differences; absent where it failed.
    pub cost: Option<f64>,
    /// Whether a valve did not open and close, so that it cannot be the result.
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
    /// The task.
    pub task: TaskKey,
    /// Squared differences over the measurements' variances; absent where it failed.
    pub misfit: Option<f64>,
    /// Whether both valves opened and closed.
    pub whole_beat: bool,
    /// What it says of the twin; absent where it failed.
    pub verdict: Option<Verdict>,
}

/// What proposed a simulation of step 1 or 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChainProposal {
    /// Which iteration, from 1.
    pub iteration: u32,
    /// The task.
    pub task: TaskKey,
    /// The cost that it promised.
    pub predicted_cost: f64,
    /// The misfit, by the weights of step 1.
    #[serde(default)]
    pub predicted_misfit: f64,
}

impl Chain {
    /// Every settled task with its place.
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
            .chain(std::iter::repeat(Stage::Step1).zip(iterations))
            .chain([Stage::Targets].into_iter().zip(&self.targets))
            .chain([Stage::Step2].into_iter().zip(&self.cell_fit))
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
            .collect();
        steps.sort_by_key(|(step, _)| *step);
        steps.into_iter()
    }

    /// What proposed an iteration, from 1.
    #[must_use]
    pub fn proposal(&self, iteration: u32) -> Option<&ChainProposal> {
        self.proposals
            .iter()
            .find(|proposal| proposal.iteration == iteration)
    }

    /// What proposed an iteration of step 3, from 1.
    #[must_use]
    pub fn step3_proposal(&self, iteration: u32) -> Option<&ChainProposal> {
        self.step3_proposals
            .iter()
            .find(|proposal| proposal.iteration == iteration)
    }

    /// Lowest cost of a whole beat of step 1 so far.
    #[must_use]
    pub fn best_cost(&self) -> Option<f64> {
        self.iterations
            .iter()
            .filter(|i| !i.no_whole_beat)
            .filter_map(|i| i.cost)
            .min_by(f64::total_cmp)
    }
}
