//! Decisions inside a job: which patient is taken, which attempt begins, what one that another job
//! began means, and why a patient is left.

use cardiotwin_schemas::allocation::DriverEnding;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::Ending;
use cardiotwin_workflow::attempt::AttemptEnding;
use cardiotwin_workflow::derivation::{self, Next, Teaching};
use cardiotwin_workflow::judge::judge;

use super::{Existing, FileRequest, InJobLoop, Observation, Wanted};
use crate::StopLevel;
use crate::dispatch::{AttemptFindings, Executor, News};

impl<E: Executor, W: Fn() -> bool> InJobLoop<'_, E, W> {
    /// Decides what follows from an observation.
    pub(super) fn take_up(&mut self, seen: Observation) {
        (self.is_fenced, self.now_ms) = (seen.is_fenced, seen.now_ms);
        self.leave_if_told(seen.stop, seen.is_warned);
        for patient in seen.taken {
            self.walk(patient);
        }
        for (attempt, existing) in seen.existing {
            self.take_over(&attempt, existing);
        }
        for (attempt, evidence) in seen.revoked {
            match evidence {
                Some(evidence) => self.adopt(&attempt, evidence),
                None => self.go_past(&attempt),
            }
        }
        for (attempt, why) in seen.hung {
            self.errands.push(FileRequest::Stop {
                attempt: attempt.clone(),
                by_force: true,
            });
            self.watch.kills(attempt, why);
        }
        for item in seen.news {
            match item {
                News::Ended {
                    attempt, evidence, ..
                } => self.ended(&attempt, evidence),
                News::Vanished { attempt } => self.leave(&attempt, "its worker disappeared"),
                News::Alive { .. } => {}
            }
        }
        self.take_patients(seen.room);
    }

    /// Makes workers write their checkpoints and end at the warning before the walltime, at a stop
    /// and at a fence.
    fn leave_if_told(&mut self, stop: StopLevel, is_warned: bool) {
        if self.leaving.is_some() {
            return;
        }
        self.leaving = if self.is_fenced {
            Some(DriverEnding::Fenced)
        } else if stop > StopLevel::Run || self.is_late(0.0) {
            Some(if is_warned || self.is_late(0.0) {
                DriverEnding::OutOfTime
            } else {
                DriverEnding::Stopped
            })
        } else {
            None
        };
        if self.leaving == Some(DriverEnding::Stopped) {
            self.errands.push(FileRequest::NoteAskedToEnd);
        }
        if self.leaving.is_some() {
            let running = self.running.keys().cloned();
            self.errands
                .extend(running.map(|attempt| FileRequest::Stop {
                    attempt,
                    by_force: false,
                }));
        }
    }

    /// Takes patients of the list as far as there is room for their attempts; at the job's end
    /// leaves those that nobody has taken.
    fn take_patients(&mut self, room: usize) {
        if self.leaving.is_some() {
            for patient in self.queue.drain(..) {
                let why = "not started: the job was at its end".to_owned();
                self.left.insert(patient, why);
            }
        }
        let room = room.saturating_sub(self.wanted.len());
        let n = room.min(self.queue.len());
        self.errands
            .extend(self.queue.drain(..n).map(FileRequest::Take));
    }

    /// Whether an activity of this duration would exceed the remaining time.
    fn is_late(&self, takes_s: f64) -> bool {
        let leave_at_ms = self.place.leave_at_ms;
        leave_at_ms.is_some_and(|at| self.now_ms as f64 + takes_s * 1000.0 >= at as f64)
    }

    /// Goes on with a patient: asks for its next attempt, or leaves it.
    fn walk(&mut self, patient: usize) {
        let of = &self.order.patients[patient];
        let teaching = match &of.lessons {
            Some(lessons) => Teaching::Lessons(lessons),
            None => Teaching::None,
        };
        let next = derivation::evaluate(&of.plan, &of.carried, &teaching, &|key| {
            self.ledger.settled(key)
        })
        .next;
        let Next::Run { key, spec, .. } = next else {
            return;
        };
        // Two patients may want the same task.
        let is_same = |attempt: &AttemptId| attempt.task == key;
        if let Some((_, waiters)) = self
            .running
            .iter_mut()
            .find(|(attempt, _)| is_same(attempt))
        {
            waiters.push(patient);
            return;
        }
        if let Some((_, wanted)) = self.wanted.iter_mut().find(|(attempt, _)| is_same(attempt)) {
            wanted.patients.push(patient);
            return;
        }
        if let Some(why) = self.hindrance(spec.kind()) {
            self.left.insert(patient, why);
            return;
        }
        let attempt = AttemptId {
            generation: self.ledger.generation(&key) + 1,
            task: key,
        };
        let patients = vec![patient];
        self.wanted.insert(
            attempt.clone(),
            Wanted {
                spec: *spec,
                patients,
            },
        );
        self.errands.push(FileRequest::Begin(attempt));
    }

    /// Why no task of this kind may begin.
    fn hindrance(&self, kind: &str) -> Option<String> {
        let expected_s = self
            .order
            .expected_s
            .get(kind)
            .copied()
            .unwrap_or(0.0)
            .max(self.ledger.longest_s(kind));
        if self.is_fenced {
            Some("the job was revoked".to_owned())
        } else if self.leaving.is_some() {
            Some("the job was at its end".to_owned())
        } else if self.is_late(expected_s) {
            Some(format!(
                "{kind} is expected to take {expected_s:.0} s, more than the job's remaining time"
            ))
        } else {
            None
        }
    }

    /// Decides about an attempt that another job has begun. Its result is adopted. If its job was
    /// revoked, the attempt is revoked and passed over. If its job may still run, the patient is
    /// left to it.
    fn take_over(&mut self, attempt: &AttemptId, existing: Existing) {
        if existing.is_revoked {
            // An attempt that is revoked has no outcome, now or later.
            self.errands.push(FileRequest::Revoke(attempt.clone()));
            return;
        }
        if let Some(evidence) = existing.evidence {
            self.adopt(attempt, evidence);
            return;
        }
        let job = existing.job;
        let owner = job.map_or("a local worker".to_owned(), |job| format!("job {job}"));
        for patient in self.waiters(attempt) {
            self.left
                .insert(patient, format!("{owner} is working on the same task"));
        }
    }

    /// Adopts the result of an attempt that another job has begun.
    fn adopt(&mut self, attempt: &AttemptId, evidence: AttemptFindings) {
        let is_cancelled = matches!(&evidence, AttemptFindings::Outcome { outcome, .. }
            if matches!(outcome.ending, Ending::Cancelled));
        if is_cancelled {
            self.go_past(attempt);
            return;
        }
        let Some(wanted) = self.wanted.remove(attempt) else {
            return;
        };
        self.ledger.start(attempt, wanted.spec.kind());
        self.settle(attempt, wanted.spec.kind(), evidence);
        wanted.patients.into_iter().for_each(|p| self.walk(p));
    }

    /// Passes over a generation that can publish nothing.
    fn go_past(&mut self, attempt: &AttemptId) {
        self.ledger.skip(&attempt.task);
        let patients = self.waiters(attempt);
        patients.into_iter().for_each(|p| self.walk(p));
    }

    /// Patients of an attempt that does not begin.
    fn waiters(&mut self, attempt: &AttemptId) -> Vec<usize> {
        let wanted = self.wanted.remove(attempt);
        wanted.map(|wanted| wanted.patients).unwrap_or_default()
    }

    fn ended(&mut self, attempt: &AttemptId, mut evidence: AttemptFindings) {
        self.watch.ended(attempt, &mut evidence);
        let Some(waiters) = self.running.remove(attempt) else {
            return;
        };
        let (reason, is_defect) = match &evidence {
            AttemptFindings::Nothing { reason, class } => {
                (reason.clone(), *class == FailureClass::Bug)
            }
            AttemptFindings::Outcome { .. } => ("its worker was stopped".to_owned(), false),
        };
        let kind = self.ledger.kind(&attempt.task);
        let is_settled = self.settle(attempt, &kind, evidence);
        for patient in waiters {
            if is_settled {
                self.walk(patient);
                continue;
            }
            // The coordinator decides on the class of the failure, because it also has the
            // scheduler's account.
            self.left.insert(patient, reason.clone());
            if is_defect {
                self.defects.insert(patient);
            }
        }
    }

    fn leave(&mut self, attempt: &AttemptId, why: &str) {
        self.watch.leaves(attempt);
        for patient in self.running.remove(attempt).unwrap_or_default() {
            self.left.insert(patient, why.to_owned());
        }
    }

    /// Records the end of an attempt in the ledger. Returns whether it settled its task.
    fn settle(&mut self, attempt: &AttemptId, kind: &str, evidence: AttemptFindings) -> bool {
        let (how, outcome) = match evidence {
            AttemptFindings::Outcome { outcome, .. } => {
                (judge(attempt, kind, &outcome), Some(*outcome))
            }
            AttemptFindings::Nothing { reason, .. } => (AttemptEnding::Lost { reason }, None),
        };
        self.ledger.ended(attempt, how, outcome)
    }
}
