//! What follows from a plan and the outcomes so far: the next task, or how the chain ended. Pure.
//!
//! Nothing is remembered from one decision to the next: the whole chain is derived anew, each task found by its key.
//! A changed input or setting leads to another key and so to another task, from there on and nowhere before; a resumed
//! run is the same derivation.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;

use cardiotwin_calibrate::fixed_point;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::finite_element::Electrophysiology;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::organ::{
    BeatCount, ContractionSpec, OrganSpec, Step1Parameters, ValveParameters,
};
use cardiotwin_schemas::outcome::{
    Artefact, CellFitResult, PassiveStateResult, Step1ProposalResult, Step3ProposalResult,
    TargetsResult, TaskResult,
};
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::posterior::TwinBeat;
use cardiotwin_schemas::record::{
    StallReason, Step1Quality, Step1Summary, Step3Ending, Step3Summary,
};
use cardiotwin_schemas::settings::{LastStep, Update};
use cardiotwin_schemas::task::{
    CellInOrgan, InputFile, NoopSpec, OrganBeatSpec, Step1Beat, Step1Run, TargetsSpec, TaskSpec,
};
use cardiotwin_schemas::verdict::Verdict;

use super::{step1, step2, step3};
use crate::machine::chain::{Chain, ChainIteration, ChainProposal, Step3ChainIteration};
use crate::machine::patient::{Stage, Step};

/// A settled task, as the chain sees it.
#[derive(Debug, Clone)]
pub enum Settled<'a> {
    /// Its result stands.
    Published {
        /// What was computed.
        result: &'a TaskResult,
        /// Its files.
        artefacts: &'a [Artefact],
        /// Where they lie, absolute.
        directory: PathBuf,
    },
    /// It failed for good.
    Failed(&'a Failure),
}

/// What follows.
#[derive(Debug, Clone, PartialEq)]
pub enum Next {
    /// This task is wanted.
    Run {
        /// Where in the chain.
        step: Step,
        /// The task.
        key: TaskKey,
        /// Its specification.
        spec: Box<TaskSpec>,
    },
    /// Nothing is left to do.
    Finished,
    /// The chain cannot go on.
    Failed {
        /// Where.
        step: Step,
        /// Why.
        failure: Failure,
    },
}

/// The chain so far and what follows.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Settled tasks.
    pub chain: Chain,
    /// What follows.
    pub next: Next,
}

/// Derives a patient's chain.
///
/// - `carried`: step 1's parameters that were simulated under earlier settings, oldest first
/// - `settled`: finds a settled task by its key
#[must_use]
pub fn evaluate<'a>(
    plan: &ResolvedPatient,
    carried: &[Step1Parameters],
    settled: &dyn Fn(&TaskKey) -> Option<Settled<'a>>,
) -> Evaluation {
    let mut derivation = Derivation {
        plan,
        carried,
        settled,
        chain: Chain::default(),
    };
    let next = match &plan.workflow {
        Workflow::Personalise => derivation.personalise(),
        Workflow::Noop { sleep_ms } => derivation.noops(*sleep_ms),
        Workflow::Task { task } => derivation.one_task(task),
    };
    Evaluation {
        next: next.err().unwrap_or(Next::Finished),
        chain: derivation.chain,
    }
}

struct Derivation<'a, 'b> {
    plan: &'b ResolvedPatient,
    carried: &'b [Step1Parameters],
    settled: &'b dyn Fn(&TaskKey) -> Option<Settled<'a>>,
    chain: Chain,
}

/// A result in the chain.
struct Published<'a> {
    key: TaskKey,
    result: &'a TaskResult,
    artefacts: &'a [Artefact],
    directory: PathBuf,
}

/// Ends the derivation early: with what is wanted, or with what holds it.
type Derived<T> = Result<T, Next>;

fn broken(step: Step, class: FailureClass, message: String) -> Next {
    Next::Failed {
        step,
        failure: Failure::new(class, message),
    }
}

impl<'a> Derivation<'a, '_> {
    fn noops(&mut self, sleep_ms: u64) -> Derived<()> {
        for number in 1..=3 {
            let label = format!("{}/{number}", self.plan.id);
            let spec = TaskSpec::Noop(NoopSpec { label, sleep_ms });
            let done = self.result(
                Step {
                    stage: Stage::Noop,
                    number,
                },
                spec,
            )?;
            self.chain.noops.push(done.key);
        }
        Ok(())
    }

    fn one_task(&mut self, task: &TaskSpec) -> Derived<()> {
        let done = self.result(Step::only(Stage::Task), task.clone())?;
        self.chain.task = Some(done.key);
        Ok(())
    }

    fn personalise(&mut self) -> Derived<()> {
        let step0 = self.step0()?;
        let (best, summary) = self.step1(&step0)?;
        let parameters = summary.parameters;
        self.chain.step1 = Some(summary);
        let (targets, calcium) = self.targets(&best)?;
        let TaskResult::OrganBeat(beat) = best.result else {
            return Err(wrong_kind(Step::only(Stage::Targets), best.result));
        };
        let of_step1 = Step1Beat {
            parameters,
            biomarkers: step1::of_step1(&beat.biomarkers),
        };
        let fit = self.step2(targets, calcium.clone())?;
        if self.plan.settings.verification.enabled {
            let contraction = step2::contraction(self.plan, fit, calcium);
            let beat = self.cell_beat(&step0, contraction, parameters.valves);
            let verified = self.verification(&step0, &beat)?;
            if self.plan.settings.workflow.until == LastStep::Step3 {
                let cell = CellInOrgan {
                    beat,
                    step1: Some(of_step1),
                };
                let twin = self.step3(&step0, &cell, verified)?;
                self.posterior(&step0, &cell, twin)?;
            }
        }
        Ok(())
    }

    /// The result of a task, if it is published; else the derivation ends here.
    fn result(&self, step: Step, spec: TaskSpec) -> Derived<Published<'a>> {
        let key = spec.key();
        match (self.settled)(&key) {
            Some(Settled::Published {
                result,
                artefacts,
                directory,
            }) => Ok(Published {
                key,
                result,
                artefacts,
                directory,
            }),
            Some(Settled::Failed(failure)) => Err(Next::Failed {
                step,
                failure: failure.clone(),
            }),
            None => Err(Next::Run {
                step,
                key,
                spec: Box::new(spec),
            }),
        }
    }

    fn step0(&mut self) -> Derived<Cow<'a, PassiveStateResult>> {
        let step = Step::only(Stage::Step0);
        let done = self.result(
            step,
            TaskSpec::PassiveState(Box::new(self.plan.step0_spec())),
        )?;
        let TaskResult::PassiveState(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        self.chain.step0 = Some(done.key);
        let mut result = Cow::Borrowed(result);
        if let OrganSpec::FiniteElement(organ) = &result.organ {
            // Where the run lies now; it may have been moved since.
            let mut organ = organ.clone();
            if let Some(file) = done
                .artefacts
                .iter()
                .find(|a| a.name == organ.ventricle.name)
            {
                organ.ventricle.path = done.directory.join(&file.file);
            }
            result.to_mut().organ = OrganSpec::FiniteElement(organ);
        }
        Ok(result)
    }

    fn beat(
        &self,
        step0: &PassiveStateResult,
        contraction: ContractionSpec,
        valves: ValveParameters,
    ) -> TaskSpec {
        let beats = BeatCount::Fixed {
            n: self.plan.settings.solver.beats,
        };
        TaskSpec::OrganBeat(Box::new(self.plan.beat_spec(
            step0,
            contraction,
            valves,
            beats,
        )))
    }

    fn step1_beat(&self, step0: &PassiveStateResult, parameters: &Step1Parameters) -> TaskSpec {
        self.beat(
            step0,
            ContractionSpec::Tanh {
                parameters: parameters.tanh,
            },
            parameters.valves,
        )
    }

    fn step1(&mut self, step0: &PassiveStateResult) -> Derived<(Published<'a>, Step1Summary)> {
        let settings = &self.plan.settings.step1;
        let measured = step1::biomarkers(&step0.measured);
        let start = Step1Parameters {
            tanh: settings.initial,
            valves: settings.valves,
        };
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
        let fixed_settings = step1::settings(settings, self.plan.settings.step1_update())
            .map_err(|message| invalid(1, message))?;
        let mut history = fixed_point::History::new(step1::parameters(&start));
        let mut runs: Vec<Result<Published<'a>, Failure>> = Vec::new();
        for parameters in self.carried {
            // Kept only as far as the same organ would be simulated again.
            let parameters = start.with_updated(parameters.updated());
            let spec = self.step1_beat(step0, &parameters);
            if let Ok(run) = self.iteration(
                runs.len() as u32 + 1,
                spec,
                &parameters,
                &measured,
                &mut history,
            )? {
                runs.push(run);
            }
        }
        history.resumed_at = history.iterations.len();
        loop {
            let number = runs.len() as u32 + 1;
            let decision = if self.plan.settings.step1_update() == Update::SpaceMapping {
                match fixed_point::ended(&fixed_settings, &measured, &history) {
                    Ok(None) => match self
                        .proposal(step0, &start, &runs)?
                        .filter(|(next, _)| history.lacks(next))
                    {
                        Some((parameters, promised)) => {
                            let content = fixed_point::content(
                                &fixed_settings,
                                &measured,
                                &history,
                                promised,
                            );
                            let next = fixed_point::Decision::Next {
                                parameters,
                                from: None,
                            };
                            content.map(|ended| ended.unwrap_or(next))
                        }
                        None => fixed_point::nothing_new(&fixed_settings, &measured, &history),
                    },
                    Ok(Some(ended)) => Ok(ended),
                    Err(error) => Err(error),
                }
            } else {
                fixed_point::decide(&fixed_settings, &measured, &history)
            };
            let decision = decision.map_err(|error| invalid(number, error.to_string()))?;
            match decision {
                fixed_point::Decision::Next { parameters, .. } => {
                    let parameters = start.with_updated(step1::values(&parameters));
                    let spec = self.step1_beat(step0, &parameters);
                    let run = self.iteration(number, spec, &parameters, &measured, &mut history)?;
                    runs.push(run.map_err(|wanted| *wanted)?);
                }
                fixed_point::Decision::Ended {
                    quality,
                    because,
                    best,
                } => {
                    return self.step1_ended(runs, quality, because, best, settings.tolerance);
                }
            }
        }
    }

    /// The next parameters by space mapping with the misfit that they promise; none if nothing is left to try.
    fn proposal(
        &mut self,
        step0: &PassiveStateResult,
        start: &Step1Parameters,
        runs: &[Result<Published<'a>, Failure>],
    ) -> Derived<Option<(fixed_point::Parameters, f64)>> {
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
                        Ok(TaskResult::OrganBeat(beat)) => Some(step1::of_step1(&beat.biomarkers)),
                        _ => None,
                    },
                    whole_beat: run.is_ok() && !iteration.no_whole_beat,
                    predicted_misfit: self
                        .chain
                        .proposal(number)
                        .map(|proposal| proposal.predicted_misfit),
                });
        let told = told.collect();
        let spec = self.plan.step1_proposal_spec(step0, start, told);
        let done = match self.result(step, TaskSpec::Step1Proposal(Box::new(spec))) {
            Ok(done) => done,
            Err(Next::Failed { failure, .. }) if failure.class == FailureClass::Numerics => {
                return Ok(None);
            }
            Err(next) => return Err(next),
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
        Ok(Some((
            step1::parameters(&result.parameters),
            predicted_misfit,
        )))
    }

    /// One simulation of step 1: told to the history when it is settled, else handed back as wanted.
    fn iteration(
        &mut self,
        number: u32,
        spec: TaskSpec,
        parameters: &Step1Parameters,
        measured: &fixed_point::Biomarkers,
        history: &mut fixed_point::History,
    ) -> Derived<Result<Result<Published<'a>, Failure>, Box<Next>>> {
        let step = Step {
            stage: Stage::Step1,
            number,
        };
        let key = spec.key();
        let fixed_parameters = step1::parameters(parameters);
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
                let outcome = step1::outcome(beat);
                if let fixed_point::Outcome::Simulated(found)
                | fixed_point::Outcome::NoWholeBeat(found) = &outcome
                {
                    let cost = fixed_point::Cost::of(measured, found);
                    iteration.cost = Some(cost.total);
                    iteration.relative_differences = step1::relative_differences(&cost);
                }
                iteration.no_whole_beat = matches!(outcome, fixed_point::Outcome::NoWholeBeat(_));
                history.push(fixed_parameters, outcome);
                Ok(Published {
                    key,
                    result,
                    artefacts,
                    directory,
                })
            }
            // A failed simulation is an answer of the model; any other failure holds the patient.
            Some(Settled::Failed(failure)) if failure.class == FailureClass::Numerics => {
                history.push(fixed_parameters, fixed_point::Outcome::Failed);
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

    /// Step 2's targets, and the calcium that is a fixed input.
    fn targets(&mut self, best: &Published<'a>) -> Derived<(&'a TargetsResult, Option<InputFile>)> {
        let step = Step::only(Stage::Targets);
        let Some(nodal) = best.artefacts.iter().find(|a| a.name == "nodal") else {
            return Err(broken(
                step,
                FailureClass::Bug,
                format!("simulation {} left no nodal traces", best.key),
            ));
        };
        let path = best.directory.join(&nodal.file);
        let nodal = InputFile {
            name: "nodal".into(),
            path,
            sha256: nodal.sha256.clone(),
        };
        let done = self.result(step, TaskSpec::Targets(TargetsSpec { nodal }))?;
        let TaskResult::Targets(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        self.chain.targets = Some(done.key);
        let calcium = step2::calcium(self.plan, result, done.artefacts, &done.directory);
        let calcium = calcium.map_err(|failure| Next::Failed {
            step: Step::only(Stage::Step2),
            failure,
        })?;
        Ok((result, calcium))
    }

    fn step2(
        &mut self,
        targets: &TargetsResult,
        calcium: Option<InputFile>,
    ) -> Derived<&'a CellFitResult> {
        let step = Step::only(Stage::Step2);
        let spec = step2::cell_fit(self.plan, targets, calcium);
        let done = self.result(step, TaskSpec::CellFit(Box::new(spec)))?;
        let TaskResult::CellFit(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        self.chain.cell_fit = Some(done.key);
        self.chain.step2_cost = Some(result.cost);
        Ok(result)
    }

    /// A beat of the organ with a cell, with the potentials that a verification beat has.
    fn cell_beat(
        &self,
        step0: &PassiveStateResult,
        contraction: ContractionSpec,
        valves: ValveParameters,
    ) -> OrganBeatSpec {
        let beats = BeatCount::Fixed {
            n: self.plan.settings.solver.beats,
        };
        let mut spec = self.plan.beat_spec(step0, contraction, valves, beats);
        let settings = &self.plan.settings.solver.finite_element;
        if let Some(equations) = &mut spec.finite_element
            && settings.ep == Electrophysiology::ReactionEikonal
        {
            equations.potentials = Some(settings.conduction);
        }
        spec
    }

    /// A simulation with a cell in the organ, as step 3 sees it; a failed one is an answer of the model.
    fn beat_with_cell(
        &self,
        step: Step,
        spec: OrganBeatSpec,
        parameters: BTreeMap<String, f64>,
        step0: &PassiveStateResult,
    ) -> Derived<(TaskKey, Result<step3::Beat, Failure>)> {
        let task = TaskSpec::OrganBeat(Box::new(spec));
        let key = task.key();
        let done = match self.result(step, task) {
            Ok(done) => done,
            Err(Next::Failed { failure, .. }) if failure.class == FailureClass::Numerics => {
                return Ok((key, Err(failure)));
            }
            Err(next) => return Err(next),
        };
        let TaskResult::OrganBeat(beat) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        let settings = &self.plan.settings;
        let seen = step3::Beat {
            parameters,
            biomarkers: Some(step1::of_step1(&beat.biomarkers)),
            samples: Some(beat.samples.clone()),
            shut: beat.failed_valve().map(ToString::to_string),
            predicted_misfit: None,
            misfit: Some(step3::misfit(
                &settings.step3,
                step0,
                self.plan.step0.cycle_length_ms,
                beat,
            )),
            verdict: Some(Verdict::of(
                &step0.measured,
                &beat.biomarkers,
                &settings.verification.tolerance_percent,
            )),
        };
        Ok((key, Ok(seen)))
    }

    fn verification(
        &mut self,
        step0: &PassiveStateResult,
        spec: &OrganBeatSpec,
    ) -> Derived<step3::Beat> {
        let step = Step::only(Stage::Verification);
        let moved = self
            .plan
            .settings
            .step3
            .values(spec.contraction.cell_parameters(), &spec.valves);
        let (key, beat) = self.beat_with_cell(step, spec.clone(), moved.clone(), step0)?;
        let is_last = self.plan.settings.workflow.until == LastStep::Step2Verification;
        let beat = match beat {
            Err(failure) if is_last => return Err(Next::Failed { step, failure }),
            // Step 3 goes on from there.
            Err(_) => step3::Beat::failed(moved),
            Ok(beat) => beat,
        };
        if let Some(valve) = beat.shut.as_ref().filter(|_| is_last) {
            return Err(broken(
                step,
                FailureClass::Numerics,
                format!("the fitted cell makes no whole beat: {valve}"),
            ));
        }
        self.chain.verification_cost = beat
            .biomarkers
            .as_ref()
            .map(|found| step1_cost(&step0.measured, found));
        self.chain.verdict = beat.whole_verdict();
        self.chain.verification = Some(key);
        Ok(beat)
    }

    fn step3(
        &mut self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        verified: step3::Beat,
    ) -> Derived<step3::Beat> {
        let settings = &self.plan.settings.step3;
        let traces = settings.traces(step0, self.plan.step0.cycle_length_ms);
        let n_measured = settings.n_measured(&step0.measured, traces.as_ref());
        let mut beats = vec![verified];
        let ending = loop {
            if step3::content(&beats, n_measured) {
                break Step3Ending::WithinUncertainty;
            }
            let number = beats.len() as u32;
            if number > settings.max_iterations {
                break Step3Ending::IterationLimit;
            }
            let Some((parameters, promised)) = self.step3_proposal(step0, cell, &beats)? else {
                break Step3Ending::NoPromise;
            };
            if !step3::worth_it(&beats, promised) {
                break Step3Ending::NoPromise;
            }
            let step = Step {
                stage: Stage::Step3,
                number,
            };
            let spec = cell.beat.with_parameters(&parameters);
            let (task, simulated) = self.beat_with_cell(step, spec, parameters.clone(), step0)?;
            let simulated = simulated.unwrap_or_else(|_| step3::Beat::failed(parameters.clone()));
            self.chain.step3_iterations.push(Step3ChainIteration {
                parameters,
                task,
                misfit: simulated.misfit,
                whole_beat: simulated.is_whole(),
                verdict: simulated.verdict.clone(),
            });
            beats.push(step3::Beat {
                predicted_misfit: Some(promised),
                ..simulated
            });
        };
        let Some(best) = step3::best(&beats) else {
            let step = Step {
                stage: Stage::Step3,
                number: beats.len().max(2) as u32 - 1,
            };
            let message = match beats.last().and_then(|beat| beat.shut.as_ref()) {
                Some(valve) => format!("no cell makes a whole beat of the organ: {valve}"),
                None => "no simulation of the organ with a cell ended".to_owned(),
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

    /// How sure the twin is. A posterior that cannot be sampled leaves the twin as it is.
    fn posterior(
        &mut self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        twin: step3::Beat,
    ) -> Derived<()> {
        let step3::Beat {
            parameters,
            biomarkers: Some(biomarkers),
            samples: Some(samples),
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
        );
        let step = Step::only(Stage::Posterior);
        match self.result(step, TaskSpec::Posterior(Box::new(spec))) {
            Ok(done) => self.chain.posterior = Some(done.key),
            Err(Next::Failed { failure, .. }) if failure.class == FailureClass::Numerics => {}
            Err(next) => return Err(next),
        }
        Ok(())
    }

    /// The next parameters of step 3 with the misfit that they promise; none if nothing is left to try.
    fn step3_proposal(
        &mut self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        beats: &[step3::Beat],
    ) -> Derived<Option<(BTreeMap<String, f64>, f64)>> {
        let number = beats.len() as u32;
        let step = Step {
            stage: Stage::Step3Proposal,
            number,
        };
        let runs = beats.iter().map(step3::Beat::told).collect();
        let spec = self.plan.step3_proposal_spec(step0, cell, runs);
        let done = match self.result(step, TaskSpec::Step3Proposal(Box::new(spec))) {
            Ok(done) => done,
            Err(Next::Failed { failure, .. }) if failure.class == FailureClass::Numerics => {
                return Ok(None);
            }
            Err(next) => return Err(next),
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

/// Why none of step 1's simulations can be the result.
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
            "after {} iterations still no whole beat, {}",
            runs.len(),
            beat.failed_valve()?
        ))
    };
    failed
        .or_else(shut)
        .unwrap_or_else(|| "none lies within the bounds".to_owned())
}

fn wrong_kind(step: Step, result: &TaskResult) -> Next {
    broken(
        step,
        FailureClass::Bug,
        format!("the result found for {step} is of another kind: {result:.80?}"),
    )
}

/// Cost of simulated biomarkers by step 1's formula.
fn step1_cost(measured: &Biomarkers, simulated: &Biomarkers) -> f64 {
    fixed_point::Cost::of(&step1::biomarkers(measured), &step1::biomarkers(simulated)).total
}

/// A patient's own stream of random numbers: 53 bits, so that every reader of JSON gets the same number.
#[must_use]
pub fn stream(seed: u64, patient: &str) -> u64 {
    let digest = sha256_hex(format!("{seed}/{patient}").as_bytes());
    u64::from_str_radix(&digest[..16], 16).expect("a digest is hexadecimal") >> 11
}
