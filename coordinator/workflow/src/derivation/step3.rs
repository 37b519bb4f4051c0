//! Step 3 of the chain: changes to the cell in the organ, and the certainty of the twin.

use std::collections::BTreeMap;

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::organ_law::LawSamples;
use cardiotwin_schemas::outcome::{PassiveStateResult, Step3ProposalResult, TaskResult};
use cardiotwin_schemas::posterior::TwinBeat;
use cardiotwin_schemas::record::{Step3Ending, Step3Summary};
use cardiotwin_schemas::settings::LastStep;
use cardiotwin_schemas::task::{CellInOrgan, TaskSpec};

use super::{Derivation, Derived, broken, wrong_kind};
use crate::chain::{ChainProposal, Step3ChainIteration};
use crate::organ_fit;
use crate::patient::{Stage, Step};

impl<'a> Derivation<'a, '_> {
    pub(super) fn step3(
        &mut self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        verified: organ_fit::Beat,
    ) -> Derived<organ_fit::Beat> {
        let settings = &self.plan.settings.step3;
        let traces = settings.traces(step0, self.plan.step0.cycle_length_ms);
        let n_measured = settings.n_measured(&step0.measured, traces.as_ref());
        let mut beats = vec![verified];
        let ending = loop {
            if organ_fit::content(&beats, n_measured) {
                break Step3Ending::WithinUncertainty;
            }
            let number = beats.len() as u32;
            if number > settings.max_iterations {
                break Step3Ending::IterationLimit;
            }
            let Some((parameters, promised)) = self.step3_proposal(step0, cell, &beats)? else {
                break Step3Ending::NoPromise;
            };
            if !organ_fit::worth_it(&beats, promised) {
                break Step3Ending::NoPromise;
            }
            let step = Step {
                stage: Stage::Step3,
                number,
            };
            let spec = cell.beat.with_parameters(&parameters);
            let (task, simulated) = self.beat_with_cell(step, spec, parameters.clone(), step0)?;
            let simulated =
                simulated.unwrap_or_else(|_| organ_fit::Beat::failed(parameters.clone()));
            self.chain.step3_iterations.push(Step3ChainIteration {
                parameters,
                task,
                misfit: simulated.misfit,
                whole_beat: simulated.is_whole(),
                verdict: simulated.verdict.clone(),
            });
            beats.push(organ_fit::Beat {
                predicted_misfit: Some(promised),
                ..simulated
            });
        };
        let Some(best) = organ_fit::best(&beats) else {
            let step = Step {
                stage: Stage::Step3,
                number: beats.len().max(2) as u32 - 1,
            };
            let message = match beats.last().and_then(|beat| beat.shut.as_ref()) {
                Some(valve) => format!("no cell completes a beat of the organ: {valve}"),
                None => "no simulation of the organ with a cell finished".to_owned(),
            };
            return Err(broken(step, FailureClass::Numerics, message));
        };
        let taken = beats.swap_remove(best);
        self.chain.verdict = taken.whole_verdict();
        self.chain.step3 = Some(Step3Summary {
            ending,
            best_iteration: best as u32,
            misfit: taken.misfit.unwrap_or(f64::INFINITY),
            parameters: taken.parameters.clone(),
        });
        Ok(taken)
    }

    /// The cell at the start of step 3. With the organ's law it is the cell that meets the
    /// measurements in the organ; without, it is the one of step 2's fit against a spring.
    pub(super) fn fitted_in_the_organ(
        &mut self,
        step0: &PassiveStateResult,
        cell: CellInOrgan,
    ) -> Derived<CellInOrgan> {
        // The paper's workflow ends with the cell of its own step 2.
        if cell.law.is_none() || self.plan.settings.workflow.until != LastStep::Step3 {
            return Ok(cell);
        }
        let spec = self.plan.step3_proposal_spec(step0, &cell, Vec::new(), &[]);
        let step = Step::only(Stage::Step2Organ);
        let Some(done) = self.if_computable(step, TaskSpec::Step3Proposal(Box::new(spec)))? else {
            // No cell has a beat in the law; the one of the spring may have one in the organ.
            return Ok(cell);
        };
        let TaskResult::Step3Proposal(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        self.chain.organ_fit = Some(done.key);
        Ok(CellInOrgan {
            beat: cell.beat.with_parameters(&result.parameters),
            ..cell
        })
    }

    /// Posterior of the twin. If it cannot be sampled, the twin stays as it is.
    pub(super) fn posterior(
        &mut self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        twin: organ_fit::Beat,
    ) -> Derived<()> {
        let organ_fit::Beat {
            parameters,
            biomarkers: Some(biomarkers),
            samples: Some(samples),
            law,
            ..
        } = twin
        else {
            return Ok(());
        };
        if !self.plan.settings.posterior.enabled {
            return Ok(());
        }
        let spec = self.plan.posterior_spec(
            step0,
            cell,
            TwinBeat {
                parameters,
                biomarkers,
                samples,
            },
            law.as_slice(),
        );
        let step = Step::only(Stage::Posterior);
        let done = self.if_computable(step, TaskSpec::Posterior(Box::new(spec)))?;
        self.chain.posterior = done.map(|done| done.key);
        Ok(())
    }

    /// Next parameters of step 3, with their predicted misfit; `None` if nothing is left to try.
    fn step3_proposal(
        &mut self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        beats: &[organ_fit::Beat],
    ) -> Derived<Option<(BTreeMap<String, f64>, f64)>> {
        let number = beats.len() as u32;
        let step = Step {
            stage: Stage::Step3Proposal,
            number,
        };
        let runs = beats.iter().map(organ_fit::Beat::told).collect();
        let law: Vec<LawSamples> = beats.iter().filter_map(|beat| beat.law.clone()).collect();
        let spec = self.plan.step3_proposal_spec(step0, cell, runs, &law);
        let Some(done) = self.if_computable(step, TaskSpec::Step3Proposal(Box::new(spec)))? else {
            return Ok(None);
        };
        let TaskResult::Step3Proposal(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        let Step3ProposalResult {
            predicted_cost,
            predicted_misfit,
            ..
        } = *result;
        self.chain.step3_proposals.push(ChainProposal {
            iteration: number,
            task: done.key,
            predicted_cost,
            predicted_misfit,
        });
        let lacks = beats
            .iter()
            .all(|beat| beat.parameters != result.parameters);
        Ok(lacks.then(|| (result.parameters.clone(), predicted_misfit)))
    }
}
