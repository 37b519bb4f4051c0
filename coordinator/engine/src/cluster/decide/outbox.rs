//! Effects of the outbox's actions, and what follows from their results: which come first, how far
//! submissions go in this tick, and what an answer of sbatch means.

use std::collections::{BTreeMap, BTreeSet};

use cardiotwin_slurm::answers::submit::{self, Refusal, RefusalKind, Submission as Answer};
use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::commands::{self, Command};
use cardiotwin_slurm::job::{JobId, JobName};
use cardiotwin_store::cluster_jobs::JobRow;
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::cluster_job::{Element, JobEvent, Submission};

use super::effects::{Effect, EffectResult, ElementId, SubmissionResult};
use super::{State, StoppedAttempt};
use crate::EngineError;

impl State {
    /// Effects of committed actions, up to the next submission, whose answer is committed before
    /// anything else happens. Cancellations follow the last submission.
    pub(super) fn outbox_effects(&self) -> Vec<Effect> {
        let is_stopped = |id: i64| self.stopped.iter().any(|stopped| stopped.action == id);
        let open = self
            .books
            .outbox()
            .iter()
            .filter(|(id, _)| !is_stopped(*id));
        // Fences come first, because jobs that are submitted below may go past the attempts that
        // they stop.
        let (fences, others): (Vec<_>, Vec<_>) = open.partition(|(_, action)| {
            matches!(action, Action::FenceJob { .. } | Action::Stop { .. })
        });
        let mut effects = Vec::new();
        let mut cancelled: Vec<(i64, ElementId)> = Vec::new();
        for (action, what) in fences.into_iter().chain(others) {
            let action = *action;
            effects.push(match what.clone() {
                Action::FenceJob { job, element } => Effect::FenceByAction {
                    action,
                    element: (job, element),
                },
                Action::Stop { attempt } => Effect::Stop { action, attempt },
                Action::WriteOverlay { patient_id } => Effect::WriteOverlay { action, patient_id },
                Action::CancelJob { job, element } => {
                    cancelled.push((action, (job, element)));
                    continue;
                }
                Action::SubmitJob { .. } if self.takes_no_jobs => continue,
                Action::SubmitJob { job } if self.is_intended(&job) => {
                    effects.push(Effect::Submit { action, job });
                    return effects;
                }
                // The job was submitted before. Drivers begin the attempts of jobs.
                Action::SubmitJob { .. } | Action::Submit { .. } => Effect::Nothing { action },
            });
        }
        if !self.leaves_slurm_alone() {
            effects.extend(self.cancellation(&cancelled));
        }
        if !self.lingering.is_empty() {
            effects.push(Effect::CancelLingering(self.lingering.clone()));
        }
        effects
    }

    fn is_intended(&self, job: &str) -> bool {
        let row = self.books.jobs().rows().get(job);
        row.is_some_and(|row| row.state.submission == Submission::Intended)
    }

    /// Cancels all given elements with one scancel, an array of which nothing is to continue by its own
    /// number, and jobs without a known number by their names.
    fn cancellation(&self, wanted: &[(i64, ElementId)]) -> Option<Effect> {
        let mut of_jobs: BTreeMap<&str, BTreeSet<usize>> = BTreeMap::new();
        for (_, (name, element)) in wanted {
            of_jobs.entry(name).or_default().insert(*element);
        }
        let (mut numbers, mut names) = (Vec::new(), Vec::new());
        for (name, elements) in of_jobs {
            let Some(row) = self.books.jobs().rows().get(name) else {
                continue;
            };
            match row.state.submission {
                Submission::Accepted { job: Some(job) } if goes_on_without(row, &elements) => {
                    let number = |&element| u32::try_from(element).unwrap_or(u32::MAX);
                    let elements = elements.iter().map(number);
                    numbers.extend(elements.map(|element| JobId::element(job, element)));
                }
                Submission::Accepted { job: Some(job) } => numbers.push(JobId::single(job)),
                _ => names.extend(JobName::new(name).ok()),
            }
        }
        let by_number = (!numbers.is_empty()).then(|| commands::cancel(&numbers));
        let by_name = names.iter().map(commands::cancel_name);
        let commands: Vec<Command> = by_number.into_iter().chain(by_name).collect();
        (!wanted.is_empty()).then(|| Effect::Cancel {
            actions: wanted.iter().map(|(action, _)| *action).collect(),
            commands,
        })
    }

    /// Takes up the result of an effect.
    pub(super) fn take_result(&mut self, result: EffectResult) -> Result<(), EngineError> {
        match result {
            EffectResult::Done(action) => self.books.action_done(action),
            // The action is done when the end of the attempt is taken up.
            EffectResult::Stopped {
                action,
                attempt,
                published,
            } => self.stopped.push(StoppedAttempt {
                action,
                attempt,
                published,
            }),
            EffectResult::Submitted {
                action,
                job,
                answer,
            } => {
                self.take_submission(&job, answer)?;
                // A job that was refused for now is submitted at a later tick.
                if !self.is_intended(&job) {
                    self.books.action_done(action);
                }
            }
            EffectResult::Cancelled { actions, accepted } => {
                // Otherwise the cancellation is repeated at the next tick.
                if accepted {
                    actions
                        .into_iter()
                        .for_each(|id| self.books.action_done(id));
                }
            }
        }
        Ok(())
    }

    fn take_submission(&mut self, name: &str, result: SubmissionResult) -> Result<(), EngineError> {
        match result {
            SubmissionResult::Answered(output) => self.take_answer(name, &output),
            SubmissionResult::BegunBefore => {
                let why = "the coordinator ended during the submission".to_owned();
                self.doubt(name, why)
            }
            SubmissionResult::NoScript(why) => {
                self.books.job_event(name, JobEvent::Refused { why })
            }
        }
    }

    fn take_answer(&mut self, name: &str, output: &Output) -> Result<(), EngineError> {
        let answer = submit::read(output);
        match &answer {
            Answer::Doubtful { why } => self.count_silence(Some(why)),
            _ => self.count_silence(None),
        }
        match answer {
            Answer::Accepted { job, .. } => {
                let row = self.books.jobs().rows().get(name);
                self.submitted += row.map_or(0, |row| row.spec.elements.len() as u64);
                let job = Some(job.job);
                self.books.job_event(name, JobEvent::Accepted { job })
            }
            Answer::Refused(refusal) if refusal.may_pass() => {
                let why = format!("refused for now: {}", refusal.said);
                let row = self.books.jobs().rows().get(name);
                for element in 0..row.map_or(0, |row| row.spec.elements.len()) {
                    self.books
                        .jobs_mut()
                        .see(name, element, |seen| seen.why.clone_from(&why));
                }
                self.books.touch_placed(name, None);
                let what = match refusal.kind {
                    RefusalKind::Busy => "Slurm takes no jobs at present",
                    _ => "the queue is full",
                };
                self.hold(Some(format!("{what}: {}", with_remedy(&refusal))));
                self.takes_no_jobs = true;
                Ok(())
            }
            Answer::Refused(refusal) => {
                let (end, said) = (end_of_sbatch(output), with_remedy(&refusal));
                let why = format!("refused by Slurm ({end}): {said}");
                self.books.job_event(name, JobEvent::Refused { why })
            }
            Answer::Doubtful { why } => {
                self.hold(Some(format!(
                    "no more jobs are submitted until Slurm answers: {why}"
                )));
                self.takes_no_jobs = true;
                self.doubt(name, why)
            }
        }
    }

    fn doubt(&mut self, name: &str, why: String) -> Result<(), EngineError> {
        let at_ms = self.books.now_ms();
        self.books.job_event(name, JobEvent::Doubt { at_ms, why })
    }
}

/// A refusal in Slurm's words, with what to do about it.
fn with_remedy(refusal: &Refusal) -> String {
    match refusal.remedy() {
        Some(remedy) => format!("{}; {remedy}", refusal.said),
        None => refusal.said.clone(),
    }
}

/// How sbatch ended, in words.
fn end_of_sbatch(output: &Output) -> String {
    match output.exit {
        Exit::Code(code) => format!("exit code {code} of sbatch"),
        Exit::Signal(signal) => format!("signal {signal} to sbatch"),
        Exit::TimedOut => "no answer of sbatch".to_owned(),
    }
}

/// Whether the job is an array of which elements continue that are not among these.
fn goes_on_without(row: &JobRow, elements: &BTreeSet<usize>) -> bool {
    let mut states = row.state.elements.iter().enumerate();
    row.spec.is_array
        && states.any(|(element, state)| {
            !matches!(state, Element::Over { .. }) && !elements.contains(&element)
        })
}
