//! Decisions of a run on this machine: what news, requests and examined attempts mean, and which
//! tasks begin.

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, ExternalId, PatientId};
use cardiotwin_schemas::progress::Progress;
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::attempt::{Attempt, AttemptEvent};
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use super::{Beginning, LocalLoop, Observation};
use crate::books::{AttemptEntry, Books};
use crate::decider::Circumstance;
use crate::dispatch::{AttemptFindings, Executor, Found, News};
use crate::{EngineError, EngineEvent, StopLevel, cores, requests, worker_identity};

/// Largest number of attempts begun in one commit, so that the first ones need not wait for the
/// commit of thousands.
const LARGEST_GROUP: usize = 2048;

impl<E: Executor> LocalLoop<E> {
    /// Takes up an observation.
    pub(super) fn take_up(&mut self, seen: Observation) -> Result<(), EngineError> {
        (self.at, self.room) = (seen.at, seen.room);
        if seen.beginning.is_some() {
            // Waiters are registered first, because the end of an attempt that is found now
            // concerns them.
            for i in 0..self.books.patients().len() {
                self.books.await_present_task(i);
            }
        }
        for news in seen.news {
            self.take_news(news)?;
        }
        let (told, applied) = requests::apply(&mut self.books, &mut self.decider, seen.requests)?;
        told.into_iter().for_each(|event| self.decider.tell(event));
        self.applied_requests.extend(applied);
        for (attempt, found) in seen.found {
            self.adopted += usize::from(self.take_found(&attempt, found)?);
        }
        for (attempt, found) in seen.stopped {
            // An attempt that is fenced and invisible from here can publish nothing.
            if self.books.attempts().contains_key(&attempt) && !self.take_found(&attempt, found)? {
                self.forget(&attempt)?;
            }
        }
        if let Some(Beginning { decided_by }) = seen.beginning {
            let is_settled = |books: &Books, i| matches!(books.patient(i).row.state, Patient::Done);
            self.decider
                .decide_all(&mut self.books, decided_by.as_ref(), is_settled)?;
        }
        for (attempt, progress) in seen.progress {
            self.tell_progress(&attempt, progress);
        }
        for (attempt, why) in seen.hung {
            self.to_end.push((attempt.clone(), true));
            self.watch.kills(attempt, why);
        }
        self.take_stop(seen.stop);
        Ok(())
    }

    /// Decides what depends on all decisions about patients.
    pub(super) fn conclude(&mut self) -> Result<(), EngineError> {
        if std::mem::take(&mut self.is_beginning) {
            worker_identity::need(self.refused_worker.take(), &self.books)?;
            self.cancel_unwanted()?;
            let started = EngineEvent::Started {
                patients: self.decider.of(),
                settled: self.decider.over(),
                adopted: self.adopted,
            };
            self.decider.tell_first(started);
        }
        self.begin_ready()
    }

    fn take_news(&mut self, news: News) -> Result<(), EngineError> {
        match news {
            News::Alive { attempt, claim } => {
                let id = ExternalId(claim.pid.to_string());
                self.books.claimed(&attempt, claim);
                self.books
                    .attempt_event(&attempt, AttemptEvent::Seen { id })
            }
            News::Vanished { attempt } => {
                let since_ms = self.books.now_ms();
                self.books
                    .attempt_event(&attempt, AttemptEvent::Vanished { since_ms })
            }
            News::Ended {
                attempt,
                mut evidence,
                claim,
            } => {
                self.watch.ended(&attempt, &mut evidence);
                if let Some(claim) = claim {
                    self.books.claimed(&attempt, claim);
                }
                let circumstance = if self.leave_until.is_some() {
                    Circumstance::Excused
                } else {
                    Circumstance::Watched
                };
                self.decider
                    .attempt_ended(&mut self.books, &attempt, evidence, circumstance)?;
                self.books.pause_after_failure(&attempt.task);
                Ok(())
            }
        }
    }

    /// Takes up what was found of an attempt that is not over. Returns whether its worker lives.
    fn take_found(&mut self, attempt: &AttemptId, found: Found) -> Result<bool, EngineError> {
        match found {
            Found::Alive(claim) => {
                let id = ExternalId(claim.pid.to_string());
                self.books.claimed(attempt, claim);
                self.books
                    .attempt_event(attempt, AttemptEvent::Seen { id })?;
                let directory = self.books.directory(attempt);
                self.watch.begin(attempt, &directory);
                return Ok(true);
            }
            Found::Over { evidence, claim } => {
                if let Some(claim) = claim {
                    self.books.claimed(attempt, claim);
                }
                self.decider.attempt_ended(
                    &mut self.books,
                    attempt,
                    evidence,
                    Circumstance::Excused,
                )?;
            }
            Found::Elsewhere(claim) => {
                self.books.claimed(attempt, claim);
                let since_ms = self.books.now_ms();
                self.books
                    .attempt_event(attempt, AttemptEvent::Vanished { since_ms })?;
            }
            Found::BeingClaimed => {
                let since_ms = self.books.now_ms();
                self.books
                    .attempt_event(attempt, AttemptEvent::Vanished { since_ms })?;
            }
            // The attempt was decided on, perhaps even spawned, but not claimed. Submitting it
            // again is harmless, since only one process can claim it.
            Found::Unclaimed => {
                let pending = |action: &Action| matches!(action, Action::Submit { attempt: a } if a == attempt);
                let state = &self.books.attempts()[attempt].state;
                if matches!(state, Attempt::Cancelling) {
                    self.forget(attempt)?;
                } else if !self
                    .books
                    .outbox()
                    .iter()
                    .any(|(_, action)| pending(action))
                {
                    self.books.put_action(Action::Submit {
                        attempt: attempt.clone(),
                    });
                }
            }
        }
        Ok(false)
    }

    /// Closes the books on an attempt that was ended before any worker claimed it, or that is
    /// fenced and out of sight.
    fn forget(&mut self, attempt: &AttemptId) -> Result<(), EngineError> {
        let evidence = AttemptFindings::Nothing {
            class: FailureClass::Site,
            reason: "ended by the coordinator".into(),
        };
        self.decider
            .attempt_ended(&mut self.books, attempt, evidence, Circumstance::Excused)
    }

    fn tell_progress(&mut self, attempt: &AttemptId, progress: Progress) {
        let task = self.books.task(&attempt.task);
        let Some(&i) = task.and_then(|task| task.waiters.first()) else {
            return;
        };
        let row = &self.books.patient(i).row;
        self.decider.tell(EngineEvent::Progress {
            patient: PatientId(row.status.patient.clone()),
            step: row
                .state
                .step()
                .map_or_else(String::new, |step| step.to_string()),
            phase: progress.phase,
            done: progress.done,
            total: progress.total,
            note: progress.note,
        });
    }

    /// Cancels attempts whose tasks have no waiters any more because inputs changed while no
    /// coordinator ran.
    fn cancel_unwanted(&mut self) -> Result<(), EngineError> {
        let unwanted: Vec<AttemptId> = self
            .books
            .attempts()
            .iter()
            .filter(|(_, attempt)| {
                !attempt.state.is_final() && !matches!(attempt.state, Attempt::Cancelling)
            })
            .filter(|(id, _)| {
                self.books
                    .task(&id.task)
                    .is_none_or(|task| task.waiters.is_empty())
            })
            .map(|(id, _)| id.clone())
            .collect();
        unwanted
            .iter()
            .try_for_each(|id| self.books.attempt_event(id, AttemptEvent::Cancel))
    }

    /// Begins ready tasks as far as the executor has room.
    fn begin_ready(&mut self) -> Result<(), EngineError> {
        if self.seen_stop > StopLevel::Run {
            return Ok(());
        }
        // Attempts that are decided on but not yet submitted take room, too.
        let waiting = |a: &&AttemptEntry| matches!(a.state, Attempt::Planned | Attempt::Submitting);
        let mut free = self
            .room
            .saturating_sub(self.books.attempts().values().filter(waiting).count());
        free = free.min(LARGEST_GROUP);
        let active = self
            .books
            .attempts()
            .iter()
            .filter(|(_, attempt)| !attempt.state.is_final());
        let (mut others, mut alone) = (0, false);
        for (id, _) in active {
            others += 1;
            alone |= self
                .books
                .task(&id.task)
                .is_some_and(|task| cores::takes_all(&self.settings, task));
        }
        let (now_ms, mut paused) = (self.books.now_ms(), Vec::new());
        while free > 0 && !alone {
            let Some((position, key)) = self.books.pop_ready() else {
                break;
            };
            let task = &self.books.tasks()[&key];
            if !matches!(task.state, Task::Open { .. }) || task.waiters.is_empty() {
                continue;
            }
            if task.is_paused(now_ms) {
                paused.push((position, key));
                continue;
            }
            alone = cores::takes_all(&self.settings, task);
            if alone && others > 0 {
                // No other task begins until all cores are free for this one.
                self.books.make_ready(position, key);
                break;
            }
            others += 1;
            let waiters = task.waiters.clone();
            let attempt = self.books.begin(&key)?;
            free -= 1;
            for i in waiters {
                let row = &self.books.patient(i).row;
                self.decider.tell(EngineEvent::TaskStarted {
                    patient: PatientId(row.status.patient.clone()),
                    step: row
                        .state
                        .step()
                        .map_or_else(String::new, |step| step.to_string()),
                    generation: attempt.generation,
                });
            }
        }
        for (position, key) in paused {
            self.books.make_ready(position, key);
        }
        Ok(())
    }
}
