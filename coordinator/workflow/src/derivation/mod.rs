//! Derivation of a patient's chain from its plan and the outcomes so far: the next task, or the
//! ending of the chain. Pure functions.
//!
//! Nothing is remembered between two decisions: the whole chain is derived again, and each task is
//! found by its key. A changed input or setting leads to another key and hence to other tasks, from
//! that point of the chain on and not before. A resumed run is the same derivation.

mod law;
mod step1;
mod step2;
mod step3;

use std::borrow::Cow;
use std::path::PathBuf;

use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::organ::{
    BeatCount, ContractionSpec, OrganSpec, Step1Parameters, ValveParameters,
};
use cardiotwin_schemas::organ_law::{LawLesson, LawSamples};
use cardiotwin_schemas::outcome::{Artefact, PassiveStateResult, TaskResult};
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::record::Step1Summary;
use cardiotwin_schemas::settings::LastStep;
use cardiotwin_schemas::task::{CellInOrgan, InputFile, NoopSpec, Step1Beat, TaskSpec};

use crate::cell_fit;
use crate::chain::{Chain, ChainUnanswered};
use crate::patient::{Stage, Step};

pub use crate::stream::stream;

/// A settled task as the chain sees it.
#[derive(Debug, Clone)]
pub enum Settled<'a> {
    /// The task has a result.
    Published {
        /// Result of the published attempt.
        result: &'a TaskResult,
        /// Files of the published attempt.
        artefacts: &'a [Artefact],
        /// Absolute directory of the files.
        directory: PathBuf,
    },
    /// The task failed for good.
    Failed(&'a Failure),
}

/// What a patient learns from pilots.
#[derive(Debug, Clone, PartialEq)]
pub enum Teaching<'a> {
    /// The patient has no teacher: it is a pilot, or there are no pilots.
    None,
    /// The patient waits for these pilots.
    Awaited(Vec<PatientId>),
    /// All pilots have ended, and this is what they teach.
    Lessons(&'a [LawLesson]),
}

/// Next event of a chain.
#[derive(Debug, Clone, PartialEq)]
pub enum Next {
    /// A task is to be computed.
    Run {
        /// Step of the chain.
        step: Step,
        /// Key of the task.
        key: TaskKey,
        /// Specification of the task.
        spec: Box<TaskSpec>,
    },
    /// The patient waits for pilots of the cohort, without a task of its own.
    Waits {
        /// Step that needs what the pilots teach.
        step: Step,
        /// Pilots that have not ended.
        pilots: Vec<PatientId>,
    },
    /// Nothing is left to do.
    Finished,
    /// A failure holds the chain.
    Failed {
        /// Step of the failed task.
        step: Step,
        /// Class and message of the failure.
        failure: Failure,
    },
}

/// Result of a derivation.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Settled tasks of the chain.
    pub chain: Chain,
    /// Next event of the chain.
    pub next: Next,
}

/// Derives a patient's chain.
///
/// - `carried`: parameters of step 1 that were simulated under earlier settings, oldest first
/// - `teaching`: what the patient learns from pilots
/// - `settled`: finds a settled task by its key
#[must_use]
pub fn evaluate<'a>(
    plan: &ResolvedPatient,
    carried: &[Step1Parameters],
    teaching: &Teaching<'_>,
    settled: &dyn Fn(&TaskKey) -> Option<Settled<'a>>,
) -> Evaluation {
    let mut derivation = Derivation {
        plan,
        carried,
        settled,
        chain: Chain::default(),
    };
    let next = match &plan.workflow {
        Workflow::Personalise => derivation.beginning(teaching).and_then(|(step0, law)| {
            // From here on the law that pilots taught is in the place of `workflow.law`.
            let taught = law.map(|law| ResolvedPatient {
                law: Some(law),
                ..plan.clone()
            });
            let mut rest = Derivation {
                plan: taught.as_ref().unwrap_or(plan),
                chain: std::mem::take(&mut derivation.chain),
                ..derivation
            };
            let ended = rest.personalise(&step0);
            derivation.chain = rest.chain;
            ended
        }),
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

/// A published result in the chain.
struct Published<'a> {
    key: TaskKey,
    result: &'a TaskResult,
    artefacts: &'a [Artefact],
    directory: PathBuf,
}

/// End of step 1.
struct Step1Ended<'a> {
    /// Best simulation.
    best: Published<'a>,
    /// How step 1 ended.
    summary: Step1Summary,
    /// Beats from which the organ's law is learned; `None` for the one-fibre ventricle.
    law: Option<Vec<LawSamples>>,
}

/// Ends the derivation early with a wanted task or with the failure that holds the chain.
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

    /// Step 0, and the law that pilots taught; no law without pilots to learn from.
    fn beginning(
        &mut self,
        teaching: &Teaching<'_>,
    ) -> Derived<(Cow<'a, PassiveStateResult>, Option<InputFile>)> {
        let step0 = self.step0()?;
        let law = self.taught_law(teaching)?;
        Ok((step0, law))
    }

    fn personalise(&mut self, step0: &PassiveStateResult) -> Derived<()> {
        let Step1Ended { best, summary, law } = self.step1(step0)?;
        let parameters = summary.parameters;
        self.chain.step1 = Some(summary);
        let (targets, calcium) = self.targets(&best)?;
        let TaskResult::OrganBeat(beat) = best.result else {
            return Err(wrong_kind(Step::only(Stage::Targets), best.result));
        };
        let of_step1 = Step1Beat {
            parameters,
            biomarkers: beat.biomarkers.organ_alone(),
        };
        let fit = self.step2(targets, calcium.clone())?;
        if self.plan.settings.verification.enabled {
            let contraction = cell_fit::contraction(self.plan, fit, calcium);
            let cell = CellInOrgan {
                beat: self.cell_beat(step0, contraction, parameters.valves),
                step1: Some(of_step1),
                law,
            };
            let cell = self.fitted_in_the_organ(step0, cell)?;
            let verified = self.verification(step0, &cell.beat)?;
            if self.plan.settings.workflow.until == LastStep::Step3 {
                let twin = self.step3(step0, &cell, verified)?;
                self.posterior(step0, &cell, twin)?;
            }
        }
        Ok(())
    }

    /// Result of a task, if it is published. Otherwise the derivation ends here.
    fn result(&self, step: Step, spec: TaskSpec) -> Derived<Published<'a>> {
        self.result_of(step, spec.key(), spec)
    }

    /// Result of a task without which the chain continues: `None` if the model has no answer to it.
    fn if_computable(&mut self, step: Step, spec: TaskSpec) -> Derived<Option<Published<'a>>> {
        let key = spec.key();
        match self.result_of(step, key.clone(), spec) {
            Ok(done) => Ok(Some(done)),
            Err(Next::Failed { failure, .. }) if failure.class == FailureClass::Numerics => {
                let unanswered = ChainUnanswered { step, task: key };
                self.chain.unanswered.push(unanswered);
                Ok(None)
            }
            Err(next) => Err(next),
        }
    }

    fn result_of(&self, step: Step, key: TaskKey, spec: TaskSpec) -> Derived<Published<'a>> {
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
            // The run may have been moved, so the path is taken from its present directory.
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
}

fn wrong_kind(step: Step, result: &TaskResult) -> Next {
    broken(
        step,
        FailureClass::Bug,
        format!("the result found for {step} is of another kind: {result:.80?}"),
    )
}
