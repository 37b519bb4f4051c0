//! Decisions on the in-memory mirror: a patient's next task, the consequences of an attempt's end,
//! the effects of a request.

use std::collections::HashSet;
use std::path::PathBuf;

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, PatientId, TaskKey};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_workflow::attempt::{Attempt, AttemptEnding, AttemptEvent};
use cardiotwin_workflow::derivation::{self, Next};
use cardiotwin_workflow::judge::judge;
use cardiotwin_workflow::patient::{Patient, PatientEvent, Stage, Step};
use cardiotwin_workflow::task::{Task, TaskEvent};

use super::files_seen::FilesSeen;
use super::program_identity::{self, DECIDED_BY};
use super::purged::Inputs;
use super::world::World;
use super::{EngineError, EngineEvent, PatientEnding, settings};
use crate::dispatch::Evidence;
use crate::store::outbox::Action;
use crate::store::patients::PlanRow;

/// Circumstance by which a missing outcome is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Circumstance {
    /// The worker ended while this coordinator watched it.
    Watched,
    /// The worker was ended by the coordinator, or found dead at a restart.
    Excused,
}

/// Decides, and collects events to be sent after the commit.
#[derive(Debug, Default)]
pub struct Decider {
    /// Events to be sent after the commit.
    pub events: Vec<EngineEvent>,
    /// Number of patients that are over, among those worked on.
    pub over: usize,
    /// Number of patients worked on.
    pub of: usize,
    /// Number of tasks published.
    pub published: u64,
    /// Number of site failures of a task that are forgiven.
    pub site_retries: u32,
    /// Published tasks that were reopened because their files were gone.
    pub remade: HashSet<TaskKey>,
    /// Files that were looked for since the last decision was complete.
    files: FilesSeen,
    /// Files about which decisions ask.
    asked: Vec<PathBuf>,
    /// Patients whose decisions wait for these files, each with the step that was published.
    undecided: Vec<(usize, Option<Step>)>,
}

impl Decider {
    /// A decider that forgives so many site failures of a task.
    pub fn new(site_retries: u32) -> Self {
        Self {
            site_retries,
            ..Self::default()
        }
    }

    /// Counts the patients that are worked on.
    pub fn count(&mut self, world: &World) {
        self.of = world.selected_states().count();
        self.over = world.selected_states().filter(|s| s.is_final()).count();
    }

    /// Takes up the cohort's plans: new patients, changed inputs or settings, removed patients.
    pub fn take_up(
        &mut self,
        world: &mut World,
        plans: &[ResolvedPatient],
    ) -> Result<(), EngineError> {
        let mut present = vec![false; world.patients.len()];
        for (position, given) in plans.iter().enumerate() {
            let position = position as i64;
            let text = serde_json::to_string(given).expect("a plan is JSON");
            let Some(&i) = world.by_name.get(given.id.as_str()) else {
                let row = PlanRow {
                    patient_id: 0,
                    given: text,
                    overrides: "{}".into(),
                    carried: "[]".into(),
                    plan: None,
                };
                world.add_patient(given.id.as_str(), position, row, given.clone());
                continue;
            };
            if let Some(present) = present.get_mut(i) {
                *present = true;
            }
            let patient = &mut world.patients[i];
            if patient.row.position != position || !patient.row.active {
                patient.row.position = position;
                patient.row.active = true;
                world.touch(i);
            }
            if world.patients[i].plan_row.given != text {
                let overrides = self.overrides(world, i)?;
                // Plans are parsed from their rows on first use. Parse the old plan now, before the
                // row is overwritten.
                let _ = world.plan(i);
                world.patients[i].plan_row.given = text;
                self.replan(
                    world,
                    i,
                    given,
                    &overrides,
                    "inputs or settings changed",
                    false,
                )?;
            }
        }
        for (i, present) in present.into_iter().enumerate() {
            if !present && world.patients[i].row.active {
                world.patients[i].row.active = false;
                world.touch(i);
            }
        }
        Ok(())
    }

    pub(super) fn overrides(&self, world: &World, i: usize) -> Result<SettingsLayer, EngineError> {
        let patient = &world.patients[i];
        serde_json::from_str(&patient.plan_row.overrides).map_err(|source| EngineError::Plan {
            patient: patient.row.patient.clone(),
            source,
        })
    }

    /// Makes a patient's plan anew. If it leads to other tasks, or with `force`, the chain is
    /// decided anew.
    pub(super) fn replan(
        &mut self,
        world: &mut World,
        i: usize,
        given: &ResolvedPatient,
        overrides: &SettingsLayer,
        reason: &str,
        force: bool,
    ) -> Result<(), EngineError> {
        let plan = settings::plan(given, overrides).map_err(|error| EngineError::Request {
            message: format!("settings of {}: {error}", given.id),
        })?;
        let same = world
            .plan(i)
            .is_ok_and(|old| settings::same_tasks(old, &plan));
        let text = || serde_json::to_string(&plan).expect("a plan is JSON");
        world.patients[i].plan_row.plan = (*overrides != SettingsLayer::default()).then(text);
        world.set_plan(i, plan);
        if force || !same {
            world.plan_changed(i);
            world.patient_event(
                i,
                PatientEvent::Replan {
                    reason: reason.to_owned(),
                },
            )?;
        }
        Ok(())
    }

    /// Decides for every patient. Settled patients are skipped if this program decided last.
    ///
    /// - `program`: identity of the program that decided last
    /// - `is_settled`: whether a patient needs no new decision by the same program
    pub fn decide_all(
        &mut self,
        world: &mut World,
        program: Option<&String>,
        is_settled: impl Fn(&Patient) -> bool,
    ) -> Result<(), EngineError> {
        let is_the_same = program_identity::is_this_program(program);
        for i in 0..world.patients.len() {
            if !(is_the_same && is_settled(&world.patients[i].row.state)) {
                self.decide(world, i)?;
            }
        }
        // Patients that are not selected were not decided, so the identity is stored only after a
        // run of the whole cohort.
        if !is_the_same && world.patients.iter().all(|p| p.selected || !p.row.active) {
            world.put_meta(DECIDED_BY, program_identity::of_this_program());
        }
        Ok(())
    }

    /// Derives a patient's chain and requests the task that it needs next. The decision waits if it
    /// has to know whether files exist ([`Decider::questions`]).
    pub fn decide(&mut self, world: &mut World, i: usize) -> Result<(), EngineError> {
        self.decide_after(world, i, None)
    }

    /// Files that have to be looked for before the decisions are complete; none when they are.
    pub fn questions(&mut self) -> Vec<PathBuf> {
        if self.undecided.is_empty() {
            // Files may come and go: the next decision looks for them anew.
            self.files = FilesSeen::default();
        }
        std::mem::take(&mut self.asked)
    }

    /// Makes the decisions that waited for files. They may ask for further ones.
    pub fn answer(&mut self, world: &mut World, seen: FilesSeen) -> Result<(), EngineError> {
        self.files.extend(seen);
        for (i, published) in std::mem::take(&mut self.undecided) {
            self.decide_after(world, i, published)?;
        }
        Ok(())
    }

    /// Looks for files until the decisions are complete, for callers that may read.
    pub fn look_and_answer(&mut self, world: &mut World) -> Result<(), EngineError> {
        loop {
            let asked = self.questions();
            if asked.is_empty() {
                return Ok(());
            }
            self.answer(world, FilesSeen::look(asked))?;
        }
    }

    /// Which of these files are missing; `None`, and a question, if that is not known.
    pub(super) fn missing(&mut self, paths: Vec<PathBuf>) -> Option<Vec<PathBuf>> {
        let is_unseen = |path: &&PathBuf| self.files.exists(path).is_none();
        let unseen: Vec<PathBuf> = paths.iter().filter(is_unseen).cloned().collect();
        if !unseen.is_empty() {
            self.asked.extend(unseen);
            return None;
        }
        let is_missing = |path: &PathBuf| self.files.exists(path) == Some(false);
        Some(paths.into_iter().filter(is_missing).collect())
    }

    /// Decides for a patient and reports the step that was published, now or when its files were
    /// looked for.
    fn decide_after(
        &mut self,
        world: &mut World,
        i: usize,
        published: Option<Step>,
    ) -> Result<(), EngineError> {
        let at = self.events.len();
        if !self.try_to_decide(world, i)? {
            self.undecided.push((i, published));
            return Ok(());
        }
        if let Some(step) = published {
            let patient = PatientId(world.patients[i].row.patient.clone());
            let note = note(world, i, step);
            let step = step.to_string();
            let event = EngineEvent::TaskPublished {
                patient,
                step,
                note,
            };
            self.events.insert(at, event);
        }
        Ok(())
    }

    /// Returns false, and changes nothing, if it is not known whether the files exist that the next
    /// task reads.
    fn try_to_decide(&mut self, world: &mut World, i: usize) -> Result<bool, EngineError> {
        if !world.patients[i].selected
            || matches!(world.patients[i].row.state, Patient::Cancelled { .. })
        {
            return Ok(true);
        }
        let evaluation = loop {
            let patient = &world.patients[i];
            let evaluation =
                derivation::evaluate(world.plan(i)?, &patient.carried, &|key| world.settled(key));
            match self.open_purged(world, i, &evaluation.next)? {
                Inputs::Settled => break evaluation,
                // Each pass reopens published tasks, each at most once, so the loop ends.
                Inputs::Reopened => {}
                Inputs::Unseen => return Ok(false),
            }
        };
        let links: Vec<(Step, TaskKey)> = evaluation
            .chain
            .steps()
            .map(|(step, key)| (step, key.clone()))
            .collect();
        for (step, key) in links {
            world.link(i, step, &key);
        }
        let patient = &mut world.patients[i];
        let id = PatientId(patient.row.patient.clone());
        if patient.chain != evaluation.chain {
            if let Some(summary) = evaluation
                .chain
                .step1
                .as_ref()
                .filter(|s| patient.chain.step1.as_ref() != Some(*s))
            {
                self.events.push(EngineEvent::Step1Ended {
                    patient: id.clone(),
                    summary: summary.clone(),
                });
            }
            patient.chain = evaluation.chain;
            patient.chain_changed = true;
            world.touch(i);
        }
        self.align(world, i, &evaluation.next)?;
        match evaluation.next {
            Next::Run { step, key, spec } => {
                world.add_task(&key, &spec);
                world.link(i, step, &key);
                if !matches!(world.patients[i].row.state, Patient::Working { .. }) {
                    world.patient_event(
                        i,
                        PatientEvent::Want {
                            step,
                            task: key.clone(),
                        },
                    )?;
                }
                wait_for(world, i, &key);
            }
            Next::Finished => self.end(world, i, PatientEvent::Finish, PatientEnding::Done)?,
            Next::Failed { step, failure } => {
                let ending = PatientEnding::Failed(failure.clone());
                self.end(world, i, PatientEvent::Fail { step, failure }, ending)?;
            }
        }
        Ok(true)
    }

    /// Replaces a stored state that the derivation does not confirm, because another version
    /// decides differently or a shared task was tried again.
    fn align(&mut self, world: &mut World, i: usize, next: &Next) -> Result<(), EngineError> {
        let settled = match &world.patients[i].row.state {
            Patient::Working { task, .. } => world
                .tasks
                .get(task)
                .is_some_and(|t| t.state.is_final())
                .then(|| task.clone()),
            _ => None,
        };
        if let Some(task) = settled {
            world.patient_event(i, PatientEvent::TaskSettled { task })?;
        }
        let fits = match (&world.patients[i].row.state, next) {
            (Patient::Waiting, _) => true,
            (
                Patient::Working { step, task },
                Next::Run {
                    step: wanted, key, ..
                },
            ) => task == key && step == wanted,
            (Patient::Deciding { after }, Next::Run { step, .. }) => step > after,
            (Patient::Deciding { .. }, _) | (Patient::Done, Next::Finished) => true,
            (
                Patient::Failed { step, failure },
                Next::Failed {
                    step: held,
                    failure: by,
                },
            ) => step == held && failure == by,
            _ => false,
        };
        if !fits {
            self.reopen(world, i);
            world.patient_event(
                i,
                PatientEvent::Replan {
                    reason: "the chain is recomputed".into(),
                },
            )?;
        }
        Ok(())
    }

    fn end(
        &mut self,
        world: &mut World,
        i: usize,
        event: PatientEvent,
        ending: PatientEnding,
    ) -> Result<(), EngineError> {
        if world.patients[i].row.state.is_final() {
            return Ok(());
        }
        world.patient_event(i, event)?;
        if world.plan(i)?.workflow == Workflow::Personalise {
            world.put_action(Action::WriteOverlay {
                patient_id: world.patients[i].row.id,
            });
        }
        self.ended(world, i, ending);
        Ok(())
    }

    pub(super) fn ended(&mut self, world: &World, i: usize, ending: PatientEnding) {
        self.over += 1;
        let patient = PatientId(world.patients[i].row.patient.clone());
        self.events.push(EngineEvent::PatientEnded {
            patient,
            ending,
            over: self.over,
            of: self.of,
        });
    }

    /// Judges the evidence of an attempt's end and updates its task and the waiting patients.
    pub fn attempt_ended(
        &mut self,
        world: &mut World,
        attempt: &AttemptId,
        evidence: Evidence,
        circumstance: Circumstance,
    ) -> Result<(), EngineError> {
        let Some(task) = world.tasks.get(&attempt.task) else {
            return Ok(());
        };
        let (how, outcome) = match evidence {
            Evidence::Outcome { outcome, text } => {
                (judge(attempt, &task.kind, &outcome), Some((outcome, text)))
            }
            Evidence::Nothing { .. } if circumstance == Circumstance::Excused => {
                (AttemptEnding::Interrupted, None)
            }
            Evidence::Nothing {
                class: FailureClass::Site,
                reason,
            } => (AttemptEnding::Lost { reason }, None),
            Evidence::Nothing { class, reason } => {
                let failure = cardiotwin_schemas::failure::Failure::new(class, reason);
                (AttemptEnding::Failed { failure }, None)
            }
        };
        // A worker that was stopped by neither the coordinator nor a person was stopped by its
        // site.
        let how = match how {
            AttemptEnding::Interrupted if circumstance == Circumstance::Watched => {
                AttemptEnding::Lost {
                    reason: "the worker was stopped from outside".into(),
                }
            }
            how => how,
        };
        self.attempt_over(
            world,
            attempt,
            how,
            outcome.map(|(outcome, text)| (*outcome, text)),
            self.site_retries,
        )
    }

    /// Enters the judged end of an attempt for its task and the waiting patients.
    pub fn attempt_over(
        &mut self,
        world: &mut World,
        attempt: &AttemptId,
        how: AttemptEnding,
        outcome: Option<(TaskOutcome, String)>,
        site_retries: u32,
    ) -> Result<(), EngineError> {
        let Some(task) = world.tasks.get(&attempt.task) else {
            return Ok(());
        };
        // Late news of an older generation, or of an attempt that is over, changes nothing.
        let current = matches!(task.state, Task::Attempting { generation, .. } if generation == attempt.generation);
        world.attempt_event(attempt, AttemptEvent::Ended { how: how.clone() })?;
        if !current {
            return Ok(());
        }
        // The attempt's machine may have changed the ending: an attempt that was being cancelled is
        // not lost.
        let how = match world.attempts.get(attempt).map(|a| &a.state) {
            Some(Attempt::Done { how }) => how.clone(),
            _ => how,
        };
        let settles = matches!(how, AttemptEnding::Succeeded | AttemptEnding::Failed { .. });
        if let Some((outcome, text)) = outcome.filter(|_| settles) {
            world.keep_outcome(&attempt.task, outcome, text);
        }
        let generation = attempt.generation;
        world.task_event(
            &attempt.task,
            TaskEvent::Ended {
                generation,
                how: how.clone(),
                site_retries,
            },
        )?;
        self.task_moved(world, attempt, &how)
    }

    fn task_moved(
        &mut self,
        world: &mut World,
        attempt: &AttemptId,
        how: &AttemptEnding,
    ) -> Result<(), EngineError> {
        let task = &world.tasks[&attempt.task];
        let settled = task.state.is_final();
        let published = matches!(task.state, Task::Published { .. });
        let waiters = task.waiters.clone();
        for &i in &waiters {
            let patient = PatientId(world.patients[i].row.patient.clone());
            let step = world.patients[i]
                .row
                .state
                .step()
                .map_or_else(String::new, |s| s.to_string());
            if let Some(failure) = how.failure() {
                let generation = attempt.generation;
                self.events.push(EngineEvent::AttemptFailed {
                    patient,
                    step,
                    generation,
                    failure,
                    retried: !settled,
                });
            }
        }
        if !settled {
            waiters
                .iter()
                .filter(|i| world.patients[**i].selected)
                .for_each(|&i| {
                    world
                        .ready
                        .insert((world.patients[i].row.position, attempt.task.clone()));
                });
            return Ok(());
        }
        self.published += u64::from(published);
        if let Some(task) = world.tasks.get_mut(&attempt.task) {
            task.waiters.clear();
        }
        for i in waiters {
            let step = world.patients[i].row.state.step();
            world.patient_event(
                i,
                PatientEvent::TaskSettled {
                    task: attempt.task.clone(),
                },
            )?;
            self.decide_after(world, i, step.filter(|_| published))?;
        }
        Ok(())
    }

    /// Counts a patient that was over as unfinished again.
    pub(super) fn reopen(&mut self, world: &World, i: usize) {
        if world.patients[i].selected && world.patients[i].row.state.is_final() {
            self.over -= 1;
        }
    }
}

/// Registers a patient as waiting for a task, and marks an open task as ready.
fn wait_for(world: &mut World, i: usize, key: &TaskKey) {
    let position = world.patients[i].row.position;
    let Some(task) = world.tasks.get_mut(key) else {
        return;
    };
    if !task.waiters.contains(&i) {
        task.waiters.push(i);
    }
    if matches!(task.state, Task::Open { .. }) {
        world.ready.insert((position, key.clone()));
    }
}

/// Result of a published step in a few words, for a person.
fn note(world: &World, i: usize, step: Step) -> String {
    let chain = &world.patients[i].chain;
    match step.stage {
        Stage::Step1 => match chain
            .iterations
            .get(step.number as usize - 1)
            .and_then(|it| it.cost)
        {
            Some(cost) => format!("cost {cost:.3}"),
            None => String::new(),
        },
        Stage::Step1Proposal => match chain.proposal(step.number) {
            Some(proposal) => format!("predicted cost {:.3}", proposal.predicted_cost),
            None => String::new(),
        },
        Stage::Step2 => chain
            .step2_cost
            .map_or_else(String::new, |cost| format!("cost {cost:.3}")),
        Stage::Verification => chain
            .verification_cost
            .map_or_else(String::new, |cost| format!("cost {cost:.3}")),
        Stage::Step3 => match chain
            .step3_iterations
            .get(step.number as usize - 1)
            .and_then(|it| it.verdict.as_ref())
        {
            Some(verdict) => verdict.to_string(),
            None => String::new(),
        },
        Stage::Step3Proposal => match chain.step3_proposal(step.number) {
            Some(proposal) => format!("predicted cost {:.3}", proposal.predicted_cost),
            None => String::new(),
        },
        _ => String::new(),
    }
}
