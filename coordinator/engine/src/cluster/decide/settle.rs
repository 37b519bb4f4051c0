//! Consequences of the end of a job for its patients: none, another job with adjusted resources, or
//! a permanent failure.

use cardiotwin_schemas::failure::{Failure, FailureCause, FailureClass};
use cardiotwin_schemas::ids::{AttemptId, PatientId};
use cardiotwin_slurm::failure::{
    self, Budgets, NodeSharing, Resources, RetriesUsed, RetryDecision,
};
use cardiotwin_slurm::judgement::{Judgement, PatientEvidence, judge_patient};
use cardiotwin_store::cluster_jobs::{JobRow, JobSpec, Placed, id_text};
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::attempt::AttemptEnding;
use cardiotwin_workflow::cluster_job::{Element, Ending, JobEvent, Submission};
use cardiotwin_workflow::patient::Patient;

use super::super::waiting::present_task;
use super::State;
use super::effects::ElementId;
use crate::EngineError;
use crate::requests::Request;

/// A patient as its ended job left it.
struct PatientAfterJob {
    /// Index of the patient.
    i: usize,
    placed: Placed,
    /// The attempt of this job that was revoked before it published.
    interrupted: Option<AttemptId>,
    /// Whether tasks were settled, or a checkpoint was left.
    has_progressed: bool,
    /// Reason for which the driver left the patient.
    left: Option<String>,
    /// Whether the patient's worker died of a defect.
    has_defect: bool,
}

impl State {
    /// Elements that ended and whose patients were not dealt with yet.
    pub fn ended_elements(&self) -> Vec<ElementId> {
        let rows = self.books.jobs().rows().values();
        rows.flat_map(|row| {
            let states = row.state.elements.iter().enumerate();
            let open = states.filter(|(element, _)| !row.seen[*element].settled);
            let over = open.filter(|(_, state)| matches!(state, Element::Over { .. }));
            over.map(|(element, _)| (row.name.clone(), element))
        })
        .collect()
    }

    /// Attempts that ended elements left unfinished, each with the name of its job. An attempt that
    /// had not published before it is revoked never will.
    pub(super) fn unfinished(&self, ended: &[ElementId]) -> Vec<(String, AttemptId)> {
        let of_element = |id: &ElementId| {
            let attempts = self.patients_of(id).into_iter();
            let attempts = attempts.filter_map(|i| self.attempt_of(i, &id.0));
            let attempts: Vec<_> = attempts.map(|attempt| (id.0.clone(), attempt)).collect();
            attempts
        };
        ended.iter().flat_map(of_element).collect()
    }

    /// The patients of an element as its job left them.
    fn patients_after(&self, id: &ElementId) -> Vec<PatientAfterJob> {
        let (name, element) = id;
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Vec::new();
        };
        let none = Vec::new();
        let ends = self.remains.driver_ends.get(id).unwrap_or(&none);
        let after = |placed: &Placed| {
            let i = self.books.by_id(placed.patient_id)?;
            let interrupted = self
                .attempt_of(i, name)
                .filter(|attempt| self.remains.attempts[attempt].is_revoked);
            let has_checkpoint = interrupted
                .as_ref()
                .is_some_and(|attempt| self.remains.attempts[attempt].has_checkpoint);
            let id = PatientId(self.books.patient(i).row.status.patient.clone());
            Some(PatientAfterJob {
                i,
                placed: *placed,
                interrupted,
                has_progressed: self.settled_tasks(i) > placed.settled || has_checkpoint,
                left: ends.iter().find_map(|end| end.left.get(&id).cloned()),
                has_defect: ends.iter().any(|end| end.defects.contains(&id)),
            })
        };
        row.spec.elements[*element]
            .iter()
            .filter_map(after)
            .collect()
    }

    /// Deals with the patients of the elements that were revoked.
    pub(super) fn settle_all(&mut self, ended: &[ElementId]) -> Result<(), EngineError> {
        // All are looked at first, because the consequences for one may change another's chain.
        let patients: Vec<_> = ended.iter().map(|id| self.patients_after(id)).collect();
        for (id, patients) in ended.iter().zip(patients) {
            self.settle(id, patients)?;
        }
        Ok(())
    }

    /// Patients that were placed in an element.
    pub(super) fn patients_of(&self, (job, element): &ElementId) -> Vec<usize> {
        let row = self.books.jobs().rows().get(job);
        let placed = row.map(|row| &row.spec.elements[*element]);
        placed
            .into_iter()
            .flatten()
            .filter_map(|placed| self.books.by_id(placed.patient_id))
            .collect()
    }

    fn settle(
        &mut self,
        (name, element): &ElementId,
        patients: Vec<PatientAfterJob>,
    ) -> Result<(), EngineError> {
        let element = *element;
        let Some(row) = self.books.jobs().rows().get(name).cloned() else {
            return Ok(());
        };
        let Some(Element::Over { ending }) = row.state.elements.get(element) else {
            return Ok(());
        };
        let is_begun =
            |after: &PatientAfterJob| after.interrupted.is_some() || after.has_progressed;
        let anybody = patients.iter().any(is_begun);
        for after in patients {
            let (i, placed) = (after.i, &after.placed);
            let stale = placed.plan != self.books.jobs().allotment(placed.patient_id).plans;
            let over =
                self.books.patient(i).row.state.is_final() || !self.books.patient(i).row.active;
            if over || stale {
                if let Some(attempt) = after.interrupted {
                    self.interrupt(&attempt, "its job ended")?;
                }
                continue;
            }
            if !is_begun(&after)
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
            self.retry_or_fail(&row, element, ending, after)?;
        }
        self.books.element_settled(name, element);
        Ok(())
    }

    /// The attempt at a patient's present task, if this job began it.
    fn attempt_of(&self, i: usize, job: &str) -> Option<AttemptId> {
        let attempt = self.present_attempt(i)?;
        let remains = self.remains.attempts.get(&attempt)?;
        (remains.job.as_deref() == Some(job)).then_some(attempt)
    }

    /// Number of settled tasks of a patient's chain.
    fn settled_tasks(&self, i: usize) -> usize {
        self.books.patient(i).chain.steps().count()
    }

    /// Consequences for a patient whose chain the job did not finish.
    fn retry_or_fail(
        &mut self,
        row: &JobRow,
        element: usize,
        ending: &Ending,
        after: PatientAfterJob,
    ) -> Result<(), EngineError> {
        let PatientAfterJob {
            i,
            interrupted,
            left,
            has_progressed,
            has_defect,
            ..
        } = after;
        let job = Judgement {
            cause: ending.cause,
            failed_nodes: ending.failed_nodes.clone(),
        };
        let evidence = PatientEvidence {
            was_interrupted: interrupted.is_some(),
            has_defect,
            words: left.as_deref().unwrap_or_default(),
            nodes: &row.seen[element].nodes,
        };
        let (cause, failed_nodes) = judge_patient(job, &evidence);
        if cause == FailureCause::Cancelled {
            return self.cancelled(i, &row.name, interrupted);
        }
        let with_job = |why: &str| {
            let left = left.as_deref().map(|left| format!("; {left}"));
            let (id, words, left) = (
                id_text(row, element),
                &ending.words,
                left.unwrap_or_default(),
            );
            format!("job {id}: {why} ({words}{left})")
        };
        match self.retry_decision(i, &row.spec, cause, &failed_nodes, has_progressed) {
            RetryDecision::Retry {
                more_memory,
                excluded,
                spent,
                why,
            } => {
                let patient_id = self.books.patient(i).row.id;
                let mut allotment = self.books.jobs().allotment(patient_id);
                if let Some(sharing) = more_memory {
                    if row.spec.steps.is_some() {
                        allotment.ranks_per_node = Some(sharing.processes_per_node);
                    } else {
                        allotment.memory_mib = Some(sharing.memory_per_process_mib);
                        allotment.lanes = Some(sharing.processes_per_node);
                    }
                }
                allotment.exclude = excluded;
                (allotment.infrastructure, allotment.free) = (spent.infrastructure, spent.free);
                allotment.why = with_job(&why);
                let failure = Failure {
                    cause: ending.cause,
                    ..Failure::new(FailureClass::Site, allotment.why.clone())
                };
                let generation = interrupted.as_ref().map_or(0, |a| a.generation);
                self.tell_retry(i, generation, failure);
                self.books.jobs_mut().set_allotment(patient_id, allotment);
                match interrupted {
                    Some(attempt) => self.interrupt(&attempt, "its job ended"),
                    None => Ok(()),
                }
            }
            RetryDecision::Stays { why } => {
                let (class, cause) = match cause {
                    FailureCause::Defect => (FailureClass::Bug, None),
                    cause => (FailureClass::Site, Some(cause)),
                };
                let failure = Failure {
                    cause,
                    ..Failure::new(class, with_job(&why))
                };
                self.fail(i, interrupted, failure)
            }
        }
    }

    /// Whether another job is submitted for a patient, and with which resources.
    fn retry_decision(
        &self,
        i: usize,
        spec: &JobSpec,
        cause: FailureCause,
        failed_nodes: &str,
        has_progressed: bool,
    ) -> RetryDecision {
        let allotment = self.books.jobs().allotment(self.books.patient(i).row.id);
        let processes_per_node = spec.processes_per_node();
        let memory_mib = spec.memory_mib.unwrap_or(self.site.node.memory_mib);
        let resources = Resources {
            sharing: NodeSharing {
                processes_per_node,
                memory_per_process_mib: memory_mib / u64::from(processes_per_node),
            },
            memory_per_node_mib: self.site.node.memory_mib,
            excluded: allotment.exclude,
        };
        let spent = RetriesUsed {
            infrastructure: allotment.infrastructure,
            free: allotment.free,
        };
        let budgets = Budgets {
            infrastructure: self.settings.site_retries,
            free: self.settings.slurm.free_repeats,
        };
        failure::decide_retry(
            cause,
            failed_nodes,
            has_progressed,
            &resources,
            spent,
            budgets,
        )
    }

    /// Sends a notice that a patient's attempt failed and is repeated.
    fn tell_retry(&mut self, i: usize, generation: u32, failure: Failure) {
        let row = &self.books.patient(i).row;
        let event = crate::EngineEvent::AttemptFailed {
            patient: PatientId(row.status.patient.clone()),
            step: row.state.step().map_or_else(String::new, |s| s.to_string()),
            generation,
            failure,
            retried: true,
        };
        self.decider.tell(event);
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
                match self.interest(placed) {
                    JobInterest::Wanted => wanted = true,
                    JobInterest::Unwanted => unwanted = true,
                    JobInterest::Done => {}
                }
            }
            if unwanted && !wanted {
                self.books.job_event(&name, JobEvent::Cancel { element })?;
            }
        }
        Ok(())
    }

    fn interest(&self, placed: &Placed) -> JobInterest {
        let Some(i) = self.books.by_id(placed.patient_id) else {
            return JobInterest::Unwanted;
        };
        let row = &self.books.patient(i).row;
        match row.state {
            Patient::Done | Patient::Failed { .. } => JobInterest::Done,
            Patient::Cancelled { .. } => JobInterest::Unwanted,
            _ if !row.active
                || placed.plan != self.books.jobs().allotment(placed.patient_id).plans =>
            {
                JobInterest::Unwanted
            }
            _ => JobInterest::Wanted,
        }
    }
}

/// Whether a patient still wants the job that it was placed in.
enum JobInterest {
    Wanted,
    Unwanted,
    Done,
}
