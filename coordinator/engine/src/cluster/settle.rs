//! Consequences of the end of a job for its patients: none, another job with adjusted resources, or
//! a permanent failure.

use cardiotwin_protocol::closing;
use cardiotwin_schemas::allocation::DriverEnd;
use cardiotwin_schemas::failure::{Failure, FailureCause, FailureClass};
use cardiotwin_schemas::ids::{AttemptId, PatientId};
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::access::folder::{self, JobFolder};
use cardiotwin_slurm::failure::{self, Budgets, Given, Next, Spent};
use cardiotwin_store::cluster_jobs::{JobRow, Placed, id_text};
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::attempt::AttemptEnding;
use cardiotwin_workflow::cluster_job::{Element, Ending, JobEvent, Submission};
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use super::Cluster;
use super::place::present_task;
use super::standing::{Settlement, Standing};
use crate::EngineError;
use crate::dispatch;
use crate::requests::Request;

impl<S: Scheduler> Cluster<S> {
    /// Elements that ended and whose patients were not dealt with yet.
    pub(super) fn ended_elements(&self) -> Vec<(String, usize)> {
        let rows = self.books.jobs().rows().values();
        rows.flat_map(|row| {
            let states = row.state.elements.iter().enumerate();
            let open = states.filter(|(element, _)| !row.seen[*element].settled);
            let over = open.filter(|(_, state)| matches!(state, Element::Over { .. }));
            over.map(|(element, _)| (row.name.clone(), element))
        })
        .collect()
    }

    /// Revokes the elements that ended, and the attempts that they left unfinished: an attempt that
    /// had not published by then never will. The ends are committed before, so that a tick that is
    /// killed here does the same again.
    pub(super) async fn revoke_ended(&mut self) -> Result<(), EngineError> {
        for (name, element) in std::mem::take(&mut self.to_revoke) {
            JobFolder::of(self.books.run_dir(), &name).fence(element)?;
            self.pass("after an element was revoked")?;
            for i in self.patients_of(&name, element) {
                self.follow(i).await?;
                if let Some(attempt) = self.attempt_of(i, &name) {
                    let directory = self.books.directory(&attempt);
                    dispatch::revoke(&directory, &attempt, &format!("job {name} ended"))?;
                    self.pass("after an attempt was revoked")?;
                }
            }
        }
        Ok(())
    }

    /// Reads the standings of the patients of the elements that were revoked.
    pub(super) async fn settlements(&mut self) -> Result<Vec<Settlement>, EngineError> {
        let mut settlements = Vec::new();
        for (name, element) in self.ended_elements() {
            let patients = self.standings(&name, element).await?;
            settlements.push(Settlement {
                name,
                element,
                patients,
            });
        }
        Ok(settlements)
    }

    async fn standings(
        &mut self,
        name: &str,
        element: usize,
    ) -> Result<Vec<Standing>, EngineError> {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(Vec::new());
        };
        let patients = row.spec.elements[element].clone();
        let folder = JobFolder::of(self.books.run_dir(), name);
        let ends: Vec<DriverEnd> = (0..row.spec.n_drivers())
            .filter_map(|node| folder.ended(element, node))
            .collect();
        let mut standings = Vec::new();
        for placed in patients {
            let Some(i) = self.books.by_id(placed.patient_id) else {
                continue;
            };
            // An outcome that was published before the revocation counts.
            self.follow(i).await?;
            let interrupted = self
                .attempt_of(i, name)
                .filter(|attempt| closing::is_revoked(&self.books.directory(attempt)));
            let has_progressed = self.settled_tasks(i) > placed.settled
                || interrupted
                    .as_ref()
                    .is_some_and(|a| folder::has_checkpoint(&self.books.directory(a)));
            let id = PatientId(self.books.patient(i).row.status.patient.clone());
            standings.push(Standing {
                i,
                placed,
                interrupted,
                has_progressed,
                left: ends.iter().find_map(|end| end.left.get(&id).cloned()),
                has_defect: ends.iter().any(|end| end.defects.contains(&id)),
            });
        }
        Ok(standings)
    }

    /// Deals with the patients of the elements that were revoked.
    pub(super) fn settle_all(&mut self, settlements: Vec<Settlement>) -> Result<(), EngineError> {
        settlements
            .into_iter()
            .try_for_each(|settlement| self.settle(settlement))
    }

    fn patients_of(&self, job: &str, element: usize) -> Vec<usize> {
        let row = self.books.jobs().rows().get(job);
        let placed = row.map(|row| &row.spec.elements[element]);
        placed
            .into_iter()
            .flatten()
            .filter_map(|placed| self.books.by_id(placed.patient_id))
            .collect()
    }

    fn settle(&mut self, settlement: Settlement) -> Result<(), EngineError> {
        let (name, element) = (&settlement.name, settlement.element);
        let Some(row) = self.books.jobs().rows().get(name).cloned() else {
            return Ok(());
        };
        let Some(Element::Over { ending }) = row.state.elements.get(element) else {
            return Ok(());
        };
        let is_begun = |s: &Standing| s.interrupted.is_some() || s.has_progressed;
        let anybody = settlement.patients.iter().any(is_begun);
        for standing in settlement.patients {
            let (i, placed) = (standing.i, &standing.placed);
            let stale = placed.plan != self.books.jobs().allotment(placed.patient_id).plans;
            let over =
                self.books.patient(i).row.state.is_final() || !self.books.patient(i).row.active;
            if over || stale {
                if let Some(attempt) = standing.interrupted {
                    self.interrupt(&attempt, "its job ended")?;
                }
                continue;
            }
            if !is_begun(&standing)
                && (anybody || matches!(row.state.submission, Submission::Void { .. }))
                && ending.cause != Some(FailureCause::Refused)
            {
                // The patient's turn did not come, or the job never existed: nothing happened to
                // the patient.
                if ending.cause == Some(FailureCause::Cancelled) {
                    self.cancelled_by_person(i, name)?;
                }
                continue;
            }
            self.follows(&row, element, ending, standing)?;
        }
        self.books.element_settled(name, element);
        Ok(())
    }

    /// The attempt at a patient's present task, if this job began it.
    fn attempt_of(&self, i: usize, job: &str) -> Option<AttemptId> {
        let task = present_task(&self.books, i)?;
        let Task::Attempting { generation, .. } = self.books.task(&task)?.state else {
            return None;
        };
        let attempt = AttemptId { task, generation };
        let allocation = folder::allocation_of(&self.books.directory(&attempt))?;
        (allocation.job == job).then_some(attempt)
    }

    /// Number of settled tasks of a patient's chain.
    pub(super) fn settled_tasks(&self, i: usize) -> usize {
        self.books.patient(i).chain.steps().count()
    }

    /// Consequences for a patient whose chain the job did not finish.
    fn follows(
        &mut self,
        row: &JobRow,
        element: usize,
        ending: &Ending,
        standing: Standing,
    ) -> Result<(), EngineError> {
        let Standing {
            i,
            interrupted,
            left,
            has_progressed,
            ..
        } = standing;
        let patient_id = self.books.patient(i).row.id;
        let cause = match ending.cause {
            Some(FailureCause::Cancelled) => return self.cancelled(i, &row.name, interrupted),
            None | Some(FailureCause::Unexplained) if standing.has_defect => FailureCause::Defect,
            Some(cause) => cause,
            // The job ended in order: its remaining patients had too little time, or a worker that
            // died.
            None if interrupted.is_none() => FailureCause::Walltime,
            // The step of a simulation says why it was killed, in the words that its driver left.
            None => {
                let told = left.as_deref().and_then(failure::told_by);
                told.unwrap_or(FailureCause::Unexplained)
            }
        };
        let mut allotment = self.books.jobs().allotment(patient_id);
        let n_per_node = row.spec.processes_per_node();
        let memory_mib = row.spec.memory_mib.unwrap_or(self.site.node.memory_mib);
        let given = Given {
            ranks_per_node: n_per_node,
            memory_per_rank_mib: memory_mib / u64::from(n_per_node),
            memory_per_node_mib: self.site.node.memory_mib,
            excluded: allotment.exclude.clone(),
        };
        let spent = Spent {
            infrastructure: allotment.infrastructure,
            free: allotment.free,
        };
        let budgets = Budgets {
            infrastructure: self.settings.site_retries,
            free: self.settings.slurm.free_repeats,
        };
        let said = |why: &str| {
            let left = left
                .as_ref()
                .map(|left| format!("; {left}"))
                .unwrap_or_default();
            format!(
                "job {}: {why} ({}{left})",
                id_text(row, element),
                ending.words
            )
        };
        let failed = match (&ending.failed_nodes, cause) {
            (named, FailureCause::NodeFailure) if named.is_empty() => {
                let words = left.as_deref().unwrap_or_default();
                failure::failed_nodes(&row.seen[element].nodes, words)
            }
            (named, _) => named.clone(),
        };
        match failure::next(cause, &failed, has_progressed, &given, spent, budgets) {
            Next::Again {
                given: more,
                spent,
                why,
                ..
            } => {
                if more.memory_per_rank_mib != given.memory_per_rank_mib {
                    if row.spec.steps.is_some() {
                        allotment.ranks_per_node = Some(more.ranks_per_node);
                    } else {
                        allotment.memory_mib = Some(more.memory_per_rank_mib);
                        allotment.lanes = Some(more.ranks_per_node);
                    }
                }
                allotment.exclude = more.excluded;
                (allotment.infrastructure, allotment.free) = (spent.infrastructure, spent.free);
                allotment.why = said(&why);
                let event = crate::EngineEvent::AttemptFailed {
                    patient: PatientId(self.books.patient(i).row.status.patient.clone()),
                    step: self
                        .books
                        .patient(i)
                        .row
                        .state
                        .step()
                        .map_or_else(String::new, |s| s.to_string()),
                    generation: interrupted.as_ref().map_or(0, |a| a.generation),
                    failure: Failure {
                        cause: ending.cause,
                        ..Failure::new(FailureClass::Site, allotment.why.clone())
                    },
                    retried: true,
                };
                self.decider.tell(event);
                self.books.jobs_mut().set_allotment(patient_id, allotment);
                match interrupted {
                    Some(attempt) => self.interrupt(&attempt, "its job ended"),
                    None => Ok(()),
                }
            }
            Next::Stays { why } => {
                let (class, cause) = match cause {
                    FailureCause::Defect => (FailureClass::Bug, None),
                    cause => (FailureClass::Site, Some(cause)),
                };
                let failure = Failure {
                    cause,
                    ..Failure::new(class, said(&why))
                };
                self.fail(i, interrupted, failure)
            }
        }
    }

    /// Fails a patient's present task for good: through the interrupted attempt, or through a new
    /// one that never began.
    fn fail(
        &mut self,
        i: usize,
        interrupted: Option<AttemptId>,
        failure: Failure,
    ) -> Result<(), EngineError> {
        let Some(key) = present_task(&self.books, i) else {
            return Ok(());
        };
        let attempt = match interrupted {
            Some(attempt) => attempt,
            None => {
                let generation = self.books.tasks()[&key].state.generation() + 1;
                let attempt = self.books.begin_found(&key, generation)?;
                // No driver may begin this generation any more.
                self.books.put_action(Action::Stop {
                    attempt: attempt.clone(),
                });
                attempt
            }
        };
        self.decider.attempt_over(
            &mut self.books,
            &attempt,
            AttemptEnding::Failed { failure },
            None,
            0,
        )
    }

    /// A person cancelled the job with `scancel`. This counts as `cardiotwin cancel` of its
    /// patient.
    fn cancelled(
        &mut self,
        i: usize,
        job: &str,
        interrupted: Option<AttemptId>,
    ) -> Result<(), EngineError> {
        if let Some(attempt) = interrupted {
            self.interrupt(&attempt, "its job was cancelled")?;
        }
        self.cancelled_by_person(i, job)
    }

    fn cancelled_by_person(&mut self, i: usize, job: &str) -> Result<(), EngineError> {
        let patient = PatientId(self.books.patient(i).row.status.patient.clone());
        let text = format!("{patient}: a person cancelled job {job}; cancelled until `retry`");
        self.decider.request(
            &mut self.books,
            &Request::Cancel {
                patient: Some(patient),
            },
        )?;
        self.decider.tell(crate::EngineEvent::Request { text });
        Ok(())
    }

    /// Cancels elements at the scheduler that have unwanted patients and no wanted ones.
    pub(super) fn cancel_unwanted(&mut self) -> Result<(), EngineError> {
        for (name, element) in self.books.elements_at_work() {
            let row = &self.books.jobs().rows()[&name];
            if row.state.elements[element] == Element::Stopping {
                continue;
            }
            let mut wanted = false;
            // A job whose patients are all done is about to end by itself.
            let mut unwanted = false;
            for placed in &row.spec.elements[element] {
                match self.wish(placed) {
                    Wish::Wanted => wanted = true,
                    Wish::Unwanted => unwanted = true,
                    Wish::Done => {}
                }
            }
            if unwanted && !wanted {
                self.books.job_event(&name, JobEvent::Cancel { element })?;
            }
        }
        Ok(())
    }

    fn wish(&self, placed: &Placed) -> Wish {
        let Some(i) = self.books.by_id(placed.patient_id) else {
            return Wish::Unwanted;
        };
        let row = &self.books.patient(i).row;
        match row.state {
            Patient::Done | Patient::Failed { .. } => Wish::Done,
            Patient::Cancelled { .. } => Wish::Unwanted,
            _ if !row.active
                || placed.plan != self.books.jobs().allotment(placed.patient_id).plans =>
            {
                Wish::Unwanted
            }
            _ => Wish::Wanted,
        }
    }
}

enum Wish {
    Wanted,
    Unwanted,
    Done,
}
