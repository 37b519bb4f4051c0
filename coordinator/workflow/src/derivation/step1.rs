//! Step 1 of the chain: simulations with the phenomenological active stress until biomarkers match.

use std::collections::BTreeMap;

use cardiotwin_calibrate::fixed_point;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::organ::{ContractionSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::organ_law::LawSamples;
use cardiotwin_schemas::outcome::{PassiveStateResult, Step1ProposalResult, TaskResult};
use cardiotwin_schemas::record::{StallReason, Step1Quality, Step1Summary};
use cardiotwin_schemas::settings::{
    Fidelity, Settings, Step1Settings, StopRule, Surrogate, Update,
};
use cardiotwin_schemas::task::{Step1Run, TaskSpec};

use super::{Derivation, Derived, Next, Published, Settled, Step1Ended, broken, wrong_kind};
use crate::chain::{ChainIteration, ChainProposal};
use crate::patient::{Stage, Step};

/// Number of whole beats after which step 1 ends where the organ's law is learned from them. The
/// third beat moves pressures by less than the law's own error.
const TEACHING_BEATS: usize = 2;

impl<'a> Derivation<'a, '_> {
    fn step1_beat(&self, step0: &PassiveStateResult, parameters: &Step1Parameters) -> TaskSpec {
        self.beat(
            step0,
            ContractionSpec::Tanh {
                parameters: parameters.tanh,
            },
            parameters.valves,
        )
    }

    pub(super) fn step1(&mut self, step0: &PassiveStateResult) -> Derived<Step1Ended<'a>> {
        let settings = &self.plan.settings.step1_resolved();
        let measured = &step0.measured;
        let start = settings.start();
        let invalid = |number, message| {
            broken(
                Step {
                    stage: Stage::Step1,
                    number,
                },
                FailureClass::Input,
                message,
            )
        };
        let mut history = fixed_point::History::new(start);
        let mut runs: Vec<Result<Published<'a>, Failure>> = Vec::new();
        for parameters in self.carried {
            // Carried parameters are kept only as far as the same organ would be simulated again.
            let parameters = start.with_updated(parameters.updated());
            let spec = self.step1_beat(step0, &parameters);
            if let Ok(run) = self.iteration(
                runs.len() as u32 + 1,
                spec,
                &parameters,
                measured,
                &mut history,
            )? {
                runs.push(run);
            }
        }
        history.resumed_at = history.iterations.len();
        loop {
            let number = runs.len() as u32 + 1;
            let decision = if settings.update == Update::SpaceMapping {
                match fixed_point::ended(settings, measured, &history) {
                    Ok(None) if self.has_taught(step0, settings, &history) => {
                        fixed_point::nothing_new(settings, measured, &history)
                    }
                    Ok(None) => match self
                        .proposal(step0, &start, &runs)?
                        .filter(|(next, _)| history.lacks(next))
                    {
                        Some((parameters, promised)) => {
                            let content =
                                fixed_point::content(settings, measured, &history, promised);
                            let next = fixed_point::Decision::Next {
                                parameters,
                                from: None,
                            };
                            content.map(|ended| ended.unwrap_or(next))
                        }
                        None => fixed_point::nothing_new(settings, measured, &history),
                    },
                    Ok(Some(ended)) => Ok(ended),
                    Err(error) => Err(error),
                }
            } else {
                fixed_point::decide(settings, measured, &history)
            };
            let decision = decision.map_err(|error| invalid(number, error.to_string()))?;
            match decision {
                fixed_point::Decision::Next { parameters, .. } => {
                    let spec = self.step1_beat(step0, &parameters);
                    let run = self.iteration(number, spec, &parameters, measured, &mut history)?;
                    runs.push(run.map_err(|wanted| *wanted)?);
                }
                fixed_point::Decision::Ended {
                    quality,
                    because,
                    best,
                } => {
                    let law = self.law_of_step1(step0, &runs);
                    let (best, summary) =
                        self.step1_ended(runs, quality, because, best, settings.tolerance)?;
                    return Ok(Step1Ended { best, summary, law });
                }
            }
        }
    }

    /// Whether step 1 has taught enough for the fit of the cell in the organ's law, which meets the
    /// measurements next: a beat within the tolerance, or the second whole beat.
    fn has_taught(
        &self,
        step0: &PassiveStateResult,
        settings: &Step1Settings,
        history: &fixed_point::History,
    ) -> bool {
        // Iterations under earlier settings come first, failed ones among them.
        let own = self.chain.iterations.iter().skip(history.resumed_at);
        let mut whole = own.filter(|i| i.cost.is_some() && !i.no_whole_beat);
        let is_within = whole
            .clone()
            .any(|i| i.cost.is_some_and(|c| c <= settings.tolerance));
        settings.stop == StopRule::Auto
            && self.learns_a_law(step0)
            && (is_within || whole.nth(TEACHING_BEATS - 1).is_some())
    }

    /// Whether parameters are sought in the organ's law. A reduced ventricle costs no more than its
    /// law.
    fn learns_a_law(&self, step0: &PassiveStateResult) -> bool {
        let Settings {
            workflow, solver, ..
        } = &*self.plan.settings;
        let is_costly = matches!(step0.organ, OrganSpec::FiniteElement(_))
            || solver.fidelity == Fidelity::External;
        workflow.surrogate == Surrogate::OrganLaw && is_costly
    }

    /// Beats of step 1 from which the organ's law is learned; `None` for the one-fibre ventricle.
    fn law_of_step1(
        &self,
        step0: &PassiveStateResult,
        runs: &[Result<Published<'a>, Failure>],
    ) -> Option<Vec<LawSamples>> {
        if !self.learns_a_law(step0) {
            return None;
        }
        let law = |run: &Result<Published<'a>, Failure>| match run.as_ref().ok()?.result {
            TaskResult::OrganBeat(beat) => beat.law.clone(),
            _ => None,
        };
        Some(runs.iter().filter_map(law).collect())
    }

    /// Next parameters by space mapping, with their predicted misfit; `None` if nothing is left to
    /// try.
    fn proposal(
        &mut self,
        step0: &PassiveStateResult,
        start: &Step1Parameters,
        runs: &[Result<Published<'a>, Failure>],
    ) -> Derived<Option<(Step1Parameters, f64)>> {
        let number = runs.len() as u32 + 1;
        let step = Step {
            stage: Stage::Step1Proposal,
            number,
        };
        let told =
            runs.iter()
                .zip(&self.chain.iterations)
                .zip(1..)
                .map(|((run, iteration), number)| Step1Run {
                    parameters: iteration.parameters,
                    biomarkers: match run.as_ref().map(|run| run.result) {
                        Ok(TaskResult::OrganBeat(beat)) => Some(beat.biomarkers.organ_alone()),
                        _ => None,
                    },
                    whole_beat: run.is_ok() && !iteration.no_whole_beat,
                    predicted_misfit: self
                        .chain
                        .proposal(number)
                        .map(|proposal| proposal.predicted_misfit),
                });
        let told = told.collect();
        let law = self.law_of_step1(step0, runs);
        let spec = self.plan.step1_proposal_spec(step0, start, told, law);
        let Some(done) = self.if_computable(step, TaskSpec::Step1Proposal(Box::new(spec)))? else {
            return Ok(None);
        };
        let TaskResult::Step1Proposal(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        let Step1ProposalResult {
            predicted_cost,
            predicted_misfit,
            ..
        } = *result;
        self.chain.proposals.push(ChainProposal {
            iteration: number,
            task: done.key,
            predicted_cost,
            predicted_misfit,
        });
        Ok(Some((result.parameters, predicted_misfit)))
    }

    /// One simulation of step 1. If it is settled, it is added to the history; otherwise it is
    /// returned as wanted.
    fn iteration(
        &mut self,
        number: u32,
        spec: TaskSpec,
        parameters: &Step1Parameters,
        measured: &Biomarkers,
        history: &mut fixed_point::History,
    ) -> Derived<Result<Result<Published<'a>, Failure>, Box<Next>>> {
        let step = Step {
            stage: Stage::Step1,
            number,
        };
        let key = spec.key();
        let mut iteration = ChainIteration {
            parameters: *parameters,
            task: key.clone(),
            cost: None,
            no_whole_beat: false,
            relative_differences: BTreeMap::new(),
        };
        let run = match (self.settled)(&key) {
            None => {
                return Ok(Err(Box::new(Next::Run {
                    step,
                    key,
                    spec: Box::new(spec),
                })));
            }
            Some(Settled::Published {
                result,
                artefacts,
                directory,
            }) => {
                let TaskResult::OrganBeat(beat) = result else {
                    return Err(wrong_kind(step, result));
                };
                let outcome =
                    fixed_point::Outcome::of(&beat.biomarkers, beat.failed_valve().is_none());
                if let fixed_point::Outcome::Simulated(found)
                | fixed_point::Outcome::NoWholeBeat(found) = &outcome
                {
                    let cost = fixed_point::Cost::of(measured, found);
                    iteration.cost = Some(cost.total);
                    iteration.relative_differences = relative_differences(&cost);
                }
                iteration.no_whole_beat = matches!(outcome, fixed_point::Outcome::NoWholeBeat(_));
                history.push(*parameters, outcome);
                Ok(Published {
                    key,
                    result,
                    artefacts,
                    directory,
                })
            }
            // A failed simulation is an answer of the model; any other failure holds the patient.
            Some(Settled::Failed(failure)) if failure.class == FailureClass::Numerics => {
                history.push(*parameters, fixed_point::Outcome::Failed);
                Err(failure.clone())
            }
            Some(Settled::Failed(failure)) => {
                return Err(Next::Failed {
                    step,
                    failure: failure.clone(),
                });
            }
        };
        self.chain.iterations.push(iteration);
        Ok(Ok(run))
    }

    fn step1_ended(
        &self,
        mut runs: Vec<Result<Published<'a>, Failure>>,
        quality: fixed_point::Quality,
        because: fixed_point::Ending,
        best: Option<usize>,
        tolerance: f64,
    ) -> Derived<(Published<'a>, Step1Summary)> {
        let last = Step {
            stage: Stage::Step1,
            number: runs.len().max(1) as u32,
        };
        let Some(best) = best else {
            let failure = Failure {
                class: FailureClass::Numerics,
                message: format!("no simulation of step 1 succeeded: {}", why_none(&runs)),
                remedy: Some("rerun from step1 with other initial values or bounds".into()),
                cause: None,
            };
            return Err(Next::Failed {
                step: last,
                failure,
            });
        };
        let iterations = &self.chain.iterations;
        let summary = Step1Summary {
            quality: match quality {
                fixed_point::Quality::Converged => Step1Quality::Converged,
                fixed_point::Quality::FailedAt(_) => Step1Quality::Stalled {
                    reason: StallReason::SimulationFailed,
                },
                fixed_point::Quality::LimitReached => Step1Quality::Stalled {
                    reason: StallReason::IterationLimit,
                },
                fixed_point::Quality::Stalled if because == fixed_point::Ending::Failure => {
                    Step1Quality::Stalled {
                        reason: StallReason::SimulationFailed,
                    }
                }
                fixed_point::Quality::Stalled => Step1Quality::Stalled {
                    reason: StallReason::Stagnation,
                },
            },
            best_iteration: best as u32 + 1,
            cost: iterations[best].cost.unwrap_or(f64::INFINITY),
            first_converged: iterations
                .iter()
                .zip(1..)
                .find(|(i, _)| !i.no_whole_beat && i.cost.is_some_and(|c| c <= tolerance))
                .map(|x| x.1),
            parameters: iterations[best].parameters,
        };
        match runs.swap_remove(best) {
            Ok(run) => Ok((run, summary)),
            Err(failure) => Err(Next::Failed {
                step: last,
                failure,
            }),
        }
    }
}

/// Reason why no simulation of step 1 can be the result.
fn why_none(runs: &[Result<Published<'_>, Failure>]) -> String {
    let failed = runs
        .iter()
        .rev()
        .find_map(|run| run.as_ref().err())
        .map(|failure| failure.message.clone());
    let shut = || {
        let last = runs.last()?.as_ref().ok()?;
        let TaskResult::OrganBeat(beat) = last.result else {
            return None;
        };
        Some(format!(
            "no whole beat after {} iterations, {}",
            runs.len(),
            beat.failed_valve()?
        ))
    };
    failed
        .or_else(shut)
        .unwrap_or_else(|| "none lies within the bounds".to_owned())
}

/// (simulated − measured) / measured by biomarker. This is the sign convention of files, opposite
/// to that of the cost's terms.
fn relative_differences(cost: &fixed_point::Cost) -> BTreeMap<String, f64> {
    cost.terms
        .iter()
        .map(|term| (term.biomarker.key().to_owned(), -term.relative_difference))
        .collect()
}
