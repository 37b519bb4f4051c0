//! Decisions on the in-memory mirror: a patient's next task, the consequences of an attempt's end,
//! the effects of a request.

use std::collections::HashSet;

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, PatientId, TaskKey};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::status::RefusedPatient;
use cardiotwin_store::outbox::Action;
use cardiotwin_store::patients::PlanRow;
use cardiotwin_workflow::attempt::{Attempt, AttemptEnding, AttemptEvent};
use cardiotwin_workflow::derivation::{self, Next};
use cardiotwin_workflow::judge::judge;
use cardiotwin_workflow::patient::{Patient, PatientEvent, Stage, Step};
use cardiotwin_workflow::pilots::has_taught;
use cardiotwin_workflow::task::{Task, TaskEvent};

use super::purged::Inputs;
use super::{Circumstance, Decider, Undecided};
use crate::books::{Books, TaskEntry};
use crate::dispatch::AttemptFindings;
use crate::program_identity::{self, DECIDED_BY};
use crate::{EngineError, EngineEvent, PatientEnding, settings};

impl Decider {
    /// Takes up the cohort's plans: new patients, changed inputs or settings, removed patients.
    ///
    /// - `unchanged`: stored patients with the plans that they have, and with their positions among
    ///   all, ascending
    pub fn take_up(
        &mut self,
        books: &mut Books,
        plans: &[ResolvedPatient],
        unchanged: &[(usize, PatientId)],
        refused: &[RefusedPatient],
    ) -> Result<(), EngineError> {
        let mut present = vec![false; books.patients().len()];
        for i in refused.iter().filter_map(|one| books.by_name(&one.patient)) {
            present[i] = true; // It is part of the cohort, and keeps its plan until it has another.
        }
        for (position, id) in unchanged {
            if let Some(i) = books.by_name(id.as_str()) {
                present[i] = true;
                books.enrol(i, *position as i64);
            }
        }
        let mut changed = HashSet::new();
        let mut taken = unchanged.iter().map(|(position, _)| *position).peekable();
        let free = (0..).filter(|position| taken.next_if_eq(position).is_none());
        for (position, given) in free.zip(plans) {
            let position = position as i64;
            let text = || serde_json::to_string(given).expect("a plan is JSON");
            let Some(i) = books.by_name(given.id.as_str()) else {
                let row = PlanRow {
                    patient_id: 0,
                    given: text(),
                    overrides: "{}".into(),
                    carried: "[]".into(),
                    plan: None,
                };
                books.add_patient(given.id.as_str(), position, row, given.clone());
                continue;
            };
            if let Some(present) = present.get_mut(i) {
                *present = true;
            }
            books.enrol(i, position);
            if !books.is_given(i, given) {
                let overrides = self.overrides(books, i)?;
                // Plans are parsed from their rows on first use. Parse the old plan now, before the
                // row is overwritten.
                let _ = books.plan(i);
                books.set_given(i, text());
                if self.replan(
                    books,
                    i,
                    given,
                    &overrides,
                    "inputs or settings changed",
                    false,
                )? {
                    changed.insert(&given.id);
                }
            }
        }
        self.choose_pilots(books, plans, refused, &changed)?;
        let mut vanished = Vec::new();
        for (i, present) in present.into_iter().enumerate() {
            if !present && books.retire(i) {
                vanished.push(PatientId(books.patient(i).row.status.patient.clone()));
            }
        }
        if !vanished.is_empty() {
            self.tell(EngineEvent::Vanished { patients: vanished });
        }
        Ok(())
    }

    pub(super) fn overrides(&self, books: &Books, i: usize) -> Result<SettingsLayer, EngineError> {
        let patient = books.patient(i);
        serde_json::from_str(&patient.plan_row.overrides).map_err(|source| EngineError::Plan {
            patient: patient.row.status.patient.clone(),
            source,
        })
    }

    /// Makes a patient's plan again. If it leads to other tasks, or with `force`, the chain is
    /// decided again. Returns whether it leads to other tasks.
    pub(super) fn replan(
        &mut self,
        books: &mut Books,
        i: usize,
        given: &ResolvedPatient,
        overrides: &SettingsLayer,
        reason: &str,
        force: bool,
    ) -> Result<bool, EngineError> {
        let plan = settings::plan(given, overrides).map_err(|error| EngineError::Request {
            message: format!("settings of {}: {error}", given.id),
        })?;
        let same = books
            .plan(i)
            .is_ok_and(|old| settings::same_tasks(old, &plan));
        let text = || serde_json::to_string(&plan).expect("a plan is JSON");
        let stored = (*overrides != SettingsLayer::default()).then(text);
        books.set_plan(i, plan, stored);
        if force || !same {
            books.plan_changed(i);
            books.patient_event(
                i,
                PatientEvent::Replan {
                    reason: reason.to_owned(),
                },
            )?;
        }
        Ok(!same)
    }

    /// Decides for every patient. Settled patients are skipped if this program decided last.
    ///
    /// - `program`: identity of the program that decided last
    /// - `is_settled`: whether a patient, by index, needs no new decision by the same program
    pub fn decide_all(
        &mut self,
        books: &mut Books,
        program: Option<&String>,
        is_settled: impl Fn(&Books, usize) -> bool,
    ) -> Result<(), EngineError> {
        let is_the_same = program_identity::is_this_program(program);
        let all = 0..books.patients().len();
        // Pilots come first, because the others learn from what is decided about them.
        let (pilots, others): (Vec<usize>, Vec<usize>) = all.partition(|i| books.is_pilot(*i));
        for i in pilots.into_iter().chain(others) {
            if !(is_the_same && is_settled(books, i)) {
                self.decide(books, i)?;
            }
        }
        // Patients that are not selected were not decided, so the identity is stored only after a
        // run of the whole cohort.
        if !is_the_same && books.patients().iter().all(|p| p.selected || !p.row.active) {
            books.put_meta(DECIDED_BY, program_identity::of_this_program());
        }
        Ok(())
    }

    /// Derives a patient's chain and requests the task that it needs next. The decision waits if it
    /// has to know whether files exist ([`Decider::questions`]).
    pub fn decide(&mut self, books: &mut Books, i: usize) -> Result<(), EngineError> {
        self.decide_after(books, i, None)
    }

    /// Decides for a patient and reports the step that was published, now or when its files were
    /// looked for.
    pub(super) fn decide_after(
        &mut self,
        books: &mut Books,
        i: usize,
        published: Option<Step>,
    ) -> Result<(), EngineError> {
        let at = self.events.len();
        if !self.try_to_decide(books, i)? {
            self.undecided.push(Undecided {
                patient: i,
                published,
                recalls: std::mem::take(&mut self.recalls),
                is_asked: false,
            });
            return Ok(());
        }
        if let Some(step) = published {
            let patient = PatientId(books.patient(i).row.status.patient.clone());
            let note = note(books, i, step);
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

    /// Returns false if it is not known whether the files exist that the next task reads, or if
    /// outcomes are not in memory. The decision is made again with the answer.
    fn try_to_decide(&mut self, books: &mut Books, i: usize) -> Result<bool, EngineError> {
        if !books.patient(i).selected
            || matches!(books.patient(i).row.state, Patient::Cancelled { .. })
        {
            return Ok(true);
        }
        if books.awaits_pilots(i)? {
            books.gather_lessons()?;
            if self.must_recall(books, i) {
                return Ok(false);
            }
        }
        let evaluation = loop {
            let (plan, carried) = (books.plan(i)?, &books.patient(i).carried);
            let teaching = books.teaching(i)?;
            let evaluation =
                derivation::evaluate(plan, carried, &teaching, &|key| books.settled(key));
            if self.must_recall(books, i) {
                return Ok(false);
            }
            match self.open_purged(books, i, &evaluation.next)? {
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
            books.link(i, step, &key);
        }
        let patient = books.patient(i);
        let id = PatientId(patient.row.status.patient.clone());
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
            books.set_chain(i, evaluation.chain);
        }
        self.align(books, i, &evaluation.next)?;
        match evaluation.next {
            Next::Run { step, key, spec } => {
                books.add_task(&key, &spec);
                books.link(i, step, &key);
                if !matches!(books.patient(i).row.state, Patient::Working { .. }) {
                    books.patient_event(
                        i,
                        PatientEvent::Want {
                            step,
                            task: key.clone(),
                        },
                    )?;
                }
                wait_for(books, i, &key);
            }
            // The patient keeps its place in the chain; the end of the last pilot decides again.
            Next::Waits { .. } => books.touch(i),
            Next::Finished => self.end(books, i, PatientEvent::Finish, PatientEnding::Done)?,
            Next::Failed { step, failure } => {
                let ending = PatientEnding::Failed(failure.clone());
                self.end(books, i, PatientEvent::Fail { step, failure }, ending)?;
            }
        }
        if books.is_pilot(i) && has_taught(&books.patient(i).row.state) {
            self.teach(books)?;
            if self.must_recall(books, i) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Replaces a stored state that the derivation does not confirm, because another version
    /// decides differently or a shared task was tried again.
    fn align(&mut self, books: &mut Books, i: usize, next: &Next) -> Result<(), EngineError> {
        let settled = match &books.patient(i).row.state {
            Patient::Working { task, .. } => books
                .task(task)
                .is_some_and(|t| t.state.is_final())
                .then(|| task.clone()),
            _ => None,
        };
        if let Some(task) = settled {
            books.patient_event(i, PatientEvent::TaskSettled { task })?;
        }
        let fits = match (&books.patient(i).row.state, next) {
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
            if books.is_pilot(i) {
                // Its beats may be others now.
                self.forget_lessons(books)?;
            }
            self.reopen(books, i);
            books.patient_event(
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
        books: &mut Books,
        i: usize,
        event: PatientEvent,
        ending: PatientEnding,
    ) -> Result<(), EngineError> {
        if books.patient(i).row.state.is_final() {
            return Ok(());
        }
        books.patient_event(i, event)?;
        if books.plan(i)?.workflow == Workflow::Personalise {
            books.put_action(Action::WriteOverlay {
                patient_id: books.patient(i).row.id,
            });
        }
        self.ended(books, i, ending);
        Ok(())
    }

    pub(super) fn ended(&mut self, books: &Books, i: usize, ending: PatientEnding) {
        self.over += 1;
        let patient = PatientId(books.patient(i).row.status.patient.clone());
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
        books: &mut Books,
        attempt: &AttemptId,
        evidence: AttemptFindings,
        circumstance: Circumstance,
    ) -> Result<(), EngineError> {
        let Some(task) = books.task(&attempt.task) else {
            return Ok(());
        };
        let (how, outcome) = match evidence {
            AttemptFindings::Outcome { outcome, text } => {
                (judge(attempt, &task.kind, &outcome), Some((outcome, text)))
            }
            AttemptFindings::Nothing { .. } if circumstance == Circumstance::Excused => {
                (AttemptEnding::Interrupted, None)
            }
            AttemptFindings::Nothing {
                class: FailureClass::Site,
                reason,
            } => (AttemptEnding::Lost { reason }, None),
            AttemptFindings::Nothing { class, reason } => {
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
            books,
            attempt,
            how,
            outcome.map(|(outcome, text)| (*outcome, text)),
            self.site_retries,
        )
    }

    /// Enters the judged end of an attempt for its task and the waiting patients.
    pub fn attempt_over(
        &mut self,
        books: &mut Books,
        attempt: &AttemptId,
        how: AttemptEnding,
        outcome: Option<(TaskOutcome, String)>,
        site_retries: u32,
    ) -> Result<(), EngineError> {
        let Some(task) = books.task(&attempt.task) else {
            return Ok(());
        };
        // Late news of an older generation, or of an attempt that is over, changes nothing.
        let current = matches!(task.state, Task::Attempting { generation, .. } if generation == attempt.generation);
        books.attempt_event(attempt, AttemptEvent::Ended { how: how.clone() })?;
        if !current {
            return Ok(());
        }
        // The attempt's machine may have changed the ending: an attempt that was being cancelled is
        // not lost.
        let how = match books.attempt(attempt).map(|a| &a.state) {
            Some(Attempt::Done { how }) => how.clone(),
            _ => how,
        };
        let settles = matches!(how, AttemptEnding::Succeeded | AttemptEnding::Failed { .. });
        if let Some((outcome, text)) = outcome.filter(|_| settles) {
            books.keep_outcome(&attempt.task, outcome, text);
        }
        let generation = attempt.generation;
        books.task_event(
            &attempt.task,
            TaskEvent::Ended {
                generation,
                how: how.clone(),
                site_retries,
            },
        )?;
        self.task_moved(books, attempt, &how)
    }

    fn task_moved(
        &mut self,
        books: &mut Books,
        attempt: &AttemptId,
        how: &AttemptEnding,
    ) -> Result<(), EngineError> {
        let task = &books.tasks()[&attempt.task];
        let settled = task.state.is_final();
        let published = matches!(task.state, Task::Published { .. });
        let waiters = task.waiters.clone();
        for &i in &waiters {
            let patient = PatientId(books.patient(i).row.status.patient.clone());
            let step = books
                .patient(i)
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
            for i in waiters {
                if books.patient(i).selected {
                    let position = books.patient(i).row.position;
                    books.make_ready(position, attempt.task.clone());
                }
            }
            return Ok(());
        }
        self.published += u64::from(published);
        books.clear_waiters(&attempt.task);
        for i in waiters {
            let step = books.patient(i).row.state.step();
            books.patient_event(
                i,
                PatientEvent::TaskSettled {
                    task: attempt.task.clone(),
                },
            )?;
            self.decide_after(books, i, step.filter(|_| published))?;
        }
        Ok(())
    }

    /// Counts a patient that was over as unfinished again.
    pub(super) fn reopen(&mut self, books: &Books, i: usize) {
        if books.patient(i).selected && books.patient(i).row.state.is_final() {
            self.over -= 1;
        }
    }
}

/// Registers a patient as waiting for a task, and marks an open task as ready.
fn wait_for(books: &mut Books, i: usize, key: &TaskKey) {
    books.add_waiter(key, i);
    let is_open = |task: &TaskEntry| matches!(task.state, Task::Open { .. });
    if books.tasks().get(key).is_some_and(is_open) {
        let position = books.patient(i).row.position;
        books.make_ready(position, key.clone());
    }
}

/// Result of a published step in a few words, for a person.
fn note(books: &Books, i: usize, step: Step) -> String {
    let chain = &books.patient(i).chain;
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
        Stage::LearnLaw => "law learned from pilots".to_owned(),
        Stage::Step2Organ => "cell fitted in the organ's law".to_owned(),
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
