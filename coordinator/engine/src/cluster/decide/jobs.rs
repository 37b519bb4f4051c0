//! Decisions on jobs: what the reports of drivers, the queue, accounting and the jobs' folders say of
//! each element, in this order.

use cardiotwin_schemas::allocation::{DriverEnd, DriverEnding};
use cardiotwin_slurm::answers::accounting::AccountingRow;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::answers::{NoAnswer, Table};
use cardiotwin_slurm::cancelled::OwnTraces;
use cardiotwin_slurm::job::JobName;
use cardiotwin_slurm::job_status::{Accounting, Alive, Ended, JobStatus, Unknown, Wanted};
use cardiotwin_slurm::judgement::{JobEvidence, Judgement, SlurmEvidence, judge};
use cardiotwin_slurm::state::SlurmState;
use cardiotwin_store::cluster_jobs::{JobRow, SeenElement};
use cardiotwin_workflow::cluster_job::{Element, Ending, JobEvent, Submission};

use super::super::waiting::wants_place;
use super::State;
use super::effects::ElementId;
use super::observation::{DriverReport, DriverReports, ElementFiles, Question, Traces};
use crate::EngineError;

/// With more names than this, sacct is asked for all jobs of the user instead of a list.
const MOST_NAMES: usize = 1000;
/// Number of grace times to wait while accounting says that a job is alive and the queue does not
/// list it.
const GRACES_OF_A_DISPUTE: i64 = 10;

impl State {
    /// Asks for the files that tell most about jobs that are not over.
    pub(super) fn driver_report_question(&self) -> Question {
        let is_accepted = |name: &str| {
            let row = self.books.jobs().rows().get(name);
            row.is_some_and(|row| matches!(row.state.submission, Submission::Accepted { .. }))
        };
        let elements = self.files_of(self.books.elements_at_work().into_iter());
        let rows = self.books.jobs().rows().values();
        let intended = rows.filter(|row| row.state.submission == Submission::Intended);
        Question::DriverReports {
            elements: elements
                .into_iter()
                .map(|files| {
                    let is_accepted = is_accepted(&files.id.0);
                    (files, is_accepted)
                })
                .collect(),
            intended: intended.map(|row| row.name.clone()).collect(),
        }
    }

    /// Elements with what has to be known to find their files.
    pub(super) fn files_of(&self, elements: impl Iterator<Item = ElementId>) -> Vec<ElementFiles> {
        let files = |id: ElementId| {
            let spec = &self.books.jobs().rows().get(&id.0)?.spec;
            Some(ElementFiles {
                n_drivers: spec.n_drivers(),
                is_array: spec.is_array,
                id,
            })
        };
        elements.filter_map(files).collect()
    }

    pub(super) fn take_driver_reports(&mut self, seen: DriverReports) -> Result<(), EngineError> {
        for ((name, element), report) in seen.elements {
            self.take_driver_report(&name, element, report)?;
        }
        for name in seen.submitting {
            self.take_interrupted_submission(&name)?;
        }
        Ok(())
    }

    fn take_driver_report(
        &mut self,
        name: &str,
        element: usize,
        report: DriverReport,
    ) -> Result<(), EngineError> {
        if report.has_started {
            let job = report.job;
            self.books.job_event(name, JobEvent::Accepted { job })?;
        }
        let Some(ends) = report.ends else {
            return Ok(());
        };
        // Only the scheduler knows who told the driver to stop.
        if ends.iter().any(|end| end.because == DriverEnding::Stopped) {
            return Ok(());
        }
        let out_of_time = ends
            .iter()
            .any(|end| end.because == DriverEnding::OutOfTime);
        let Some(judgement) = judge(&JobEvidence::Drivers { out_of_time }) else {
            return Ok(());
        };
        let elapsed_s = ends.iter().map(|end| end.wall_s).fold(0.0, f64::max) as u64;
        self.books.jobs_mut().see(name, element, |seen| {
            seen.elapsed_s = Some(elapsed_s);
            seen.why.clear();
        });
        let words = if out_of_time {
            "stopped at the end of its walltime"
        } else {
            "finished"
        };
        self.note_lingering(name, element);
        self.end(name, element, judgement, words.to_owned())
    }

    /// A submission that was interrupted by the end of the coordinator becomes doubtful.
    fn take_interrupted_submission(&mut self, name: &str) -> Result<(), EngineError> {
        let row = self.books.jobs().rows().get(name);
        if row.is_some_and(|row| row.state.submission == Submission::Intended) {
            let why = "the coordinator ended during the submission".to_owned();
            let at_ms = self.books.now_ms();
            self.books.job_event(name, JobEvent::Doubt { at_ms, why })?;
        }
        Ok(())
    }

    /// Whether the queue has to be asked, and may be.
    pub(super) fn wants_queue(&self) -> bool {
        let is_live =
            |row: &JobRow| !row.state.is_over() && row.state.submission != Submission::Intended;
        let is_needed = self.books.jobs().rows().values().any(is_live)
            || self.has_lingering()
            || (0..self.books.patients().len()).any(|i| wants_place(&self.books, i));
        is_needed && !self.leaves_slurm_alone()
    }

    pub(super) fn take_queue(&mut self, answer: Result<Table<QueueRow>, NoAnswer>) {
        match answer {
            Ok(table) => {
                self.report.answered_ms = Some(self.books.now_ms());
                self.report.no_answer = None;
                self.count_silence(None);
                self.queue = Some(table.clone());
                self.inquiry.take_queue(table);
                self.take_lingering();
            }
            Err(error) => {
                self.no_accounting |= error.says_no_accounting();
                self.report.no_answer = Some(error.to_string());
                self.count_silence(Some(&error.to_string()));
            }
        }
    }

    /// Asks accounting about the elements whose fate the queue does not show.
    pub(super) fn accounting_question(&self) -> Option<Question> {
        let work = self.books.elements_at_work();
        let needs = |(name, element): &&ElementId| self.needs_accounting(name, *element);
        let mut names: Vec<&String> = work.iter().filter(needs).map(|id| &id.0).collect();
        names.dedup();
        if names.is_empty() {
            return None;
        }
        let rows = names
            .iter()
            .filter_map(|name| self.books.jobs().rows().get(*name));
        let since_s = rows.map(|row| row.intended_ms).min().unwrap_or_default() / 1000 - 60;
        let mut names: Vec<JobName> = names
            .into_iter()
            .filter_map(|name| JobName::new(name).ok())
            .collect();
        if names.len() > MOST_NAMES {
            names.clear();
        }
        Some(Question::Accounting { names, since_s })
    }

    pub(super) fn take_accounting(&mut self, answer: Result<Table<AccountingRow>, NoAnswer>) {
        match answer {
            Ok(table) => self.inquiry.take_accounting(table),
            // Without accounting sacct never answers, so its silence does not count: queue and job
            // folders have to suffice.
            Err(error) => self.no_accounting |= error.says_no_accounting(),
        }
    }

    /// Whether the fate of an element cannot be told from the queue alone.
    fn needs_accounting(&self, name: &str, element: usize) -> bool {
        let wanted = self.submitted(name, element);
        match wanted.map(|wanted| self.inquiry.status_by_queue(wanted)) {
            None | Some(JobStatus::Alive(_)) => false,
            // Only accounting has the canceller and the exit code.
            Some(JobStatus::Ended(ended)) => {
                ended.exit.is_none()
                    && matches!(ended.state, SlurmState::Cancelled | SlurmState::Failed)
            }
            Some(JobStatus::Unknown(_)) => self.inquiry.has_queue(),
        }
    }

    /// Asks for the traces of the elements that have ended by Slurm's account, or are gone after
    /// they were asked to end. They are read only now, because a job writes its log until it ends.
    pub(super) fn trace_question(&self) -> Option<Question> {
        let needs = |(name, element): &ElementId| match self.status(name, *element) {
            Some(JobStatus::Ended(_)) => true,
            Some(JobStatus::Unknown(_)) => self.is_stopping(name, *element),
            _ => false,
        };
        let elements = self.books.elements_at_work().into_iter().filter(needs);
        let files = self.files_of(elements);
        (!files.is_empty()).then_some(Question::Traces(files))
    }

    fn is_stopping(&self, name: &str, element: usize) -> bool {
        let row = self.books.jobs().rows().get(name);
        row.is_some_and(|row| row.state.elements.get(element) == Some(&Element::Stopping))
    }

    pub(super) fn wanted<'a>(&self, name: &'a str, element: usize) -> Wanted<'a> {
        let row = self.books.jobs().rows().get(name);
        let is_array = row.is_some_and(|row| row.spec.is_array);
        Wanted {
            name,
            element: is_array.then(|| u32::try_from(element).unwrap_or(u32::MAX)),
        }
    }

    /// The element to ask the answers about; `None` if its job was not submitted.
    fn submitted<'a>(&self, name: &'a str, element: usize) -> Option<Wanted<'a>> {
        let row = self.books.jobs().rows().get(name)?;
        let is_submitted = row.state.submission != Submission::Intended;
        is_submitted.then(|| self.wanted(name, element))
    }

    /// Status of an element by all answers; `None` for a job that was not submitted.
    fn status(&self, name: &str, element: usize) -> Option<JobStatus> {
        let wanted = self.submitted(name, element)?;
        Some(self.inquiry.status(wanted))
    }

    /// Takes up the states of all elements that are not over.
    pub(super) fn take_job_states(&mut self) -> Result<(), EngineError> {
        for (name, element) in self.books.elements_at_work() {
            match self.status(&name, element) {
                None => {}
                Some(JobStatus::Alive(alive)) => self.take_alive(&name, element, &alive)?,
                Some(JobStatus::Ended(ended)) => self.take_ended(&name, element, &ended)?,
                Some(JobStatus::Unknown(unknown)) => {
                    self.take_unknown(&name, element, &unknown)?;
                }
            }
        }
        Ok(())
    }

    fn take_alive(&mut self, name: &str, element: usize, alive: &Alive) -> Result<(), EngineError> {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(());
        };
        let known = matches!(row.state.submission, Submission::Accepted { job: Some(_) });
        let runs = alive.runs;
        let as_before = match row.state.elements.get(element) {
            Some(Element::Running) => runs,
            Some(Element::Waiting) => !runs,
            _ => false,
        };
        if !known {
            let job = Some(alive.id.job);
            self.books.job_event(name, JobEvent::Accepted { job })?;
        }
        if !as_before {
            self.books
                .job_event(name, JobEvent::Seen { element, runs })?;
        }
        let why = alive
            .why
            .as_ref()
            .map(|why| why.words_for(alive.id))
            .unwrap_or_default();
        self.see(name, element, |seen| {
            seen.why = why;
            seen.start_s = alive.start;
            seen.nodes.clone_from(&alive.nodes);
        });
        Ok(())
    }

    fn take_ended(&mut self, name: &str, element: usize, ended: &Ended) -> Result<(), EngineError> {
        let job = Some(ended.id.job);
        let Some(judgement) = self.judge_by_slurm(name, element, ended) else {
            let why = format!(
                "Slurm reports {}, but not yet by whom",
                ended.state.as_str()
            );
            self.books.job_event(name, JobEvent::Accepted { job })?;
            self.see(name, element, |seen| seen.why.clone_from(&why));
            return self.vanish(name, element, why);
        };
        let began = if ended.began == Some(false) {
            ", and it never began"
        } else {
            ""
        };
        let words = format!("Slurm reports {}{began}", ended.state.as_str());
        self.books.job_event(name, JobEvent::Accepted { job })?;
        self.see(name, element, |seen| {
            seen.elapsed_s = ended.elapsed_s;
            seen.nodes.clone_from(&ended.nodes);
            seen.why.clear();
        });
        self.end(name, element, judgement, words)
    }

    /// Judges an end that Slurm reports, with the element's traces; `None` while it is open.
    fn judge_by_slurm(&self, name: &str, element: usize, ended: &Ended) -> Option<Judgement> {
        let row = self.books.jobs().rows().get(name)?;
        let none = Traces::default();
        let traces = self.inquiry.traces.get(&(name.to_owned(), element));
        let traces = traces.unwrap_or(&none);
        let is_out_of_time = |end: &DriverEnd| end.because == DriverEnding::OutOfTime;
        // Accounting may never list a job that could not start. Any other job appears there,
        // however late.
        let graces = match ended.accounting {
            Accounting::Disagrees | Accounting::Silent if !self.no_accounting => {
                GRACES_OF_A_DISPUTE
            }
            _ => 1,
        };
        let waited = match row.state.elements.get(element) {
            Some(Element::Unknown { since_ms, .. }) => self.is_over_grace(*since_ms, graces),
            _ => false,
        };
        judge(&JobEvidence::Slurm(SlurmEvidence {
            ended,
            log_tail: &traces.log_tail,
            we_cancelled: self.is_stopping(name, element),
            warned: traces.ends.iter().flatten().any(is_out_of_time),
            traces: OwnTraces {
                began: traces.started.contains(&true),
                asked_to_end: traces.asked_to_end,
                uid: self.process.uid,
                no_accounting: self.no_accounting,
                waited,
            },
        }))
    }

    pub(super) fn grace_ms(&self) -> i64 {
        i64::try_from(self.settings.slurm.grace_s).unwrap_or(i64::MAX / 20_000) * 1000
    }

    /// Whether so many grace times have passed since a moment.
    fn is_over_grace(&self, since_ms: i64, graces: i64) -> bool {
        self.books.now_ms() - since_ms > self.grace_ms().saturating_mul(graces)
    }

    fn take_unknown(
        &mut self,
        name: &str,
        element: usize,
        unknown: &Unknown,
    ) -> Result<(), EngineError> {
        let (absent, graces, why) = match unknown {
            Unknown::NotListed {
                queue_answered: true,
                ..
            } => (true, 1, "unknown to Slurm".to_owned()),
            Unknown::NotListed { .. } => (false, 1, "Slurm does not answer".to_owned()),
            Unknown::State(state) => (
                false,
                1,
                format!("Slurm reports {}, which is inconclusive", state.as_str()),
            ),
            Unknown::Disputed(state) => (
                true,
                GRACES_OF_A_DISPUTE,
                format!(
                    "the queue does not list it, but accounting reports {}",
                    state.as_str()
                ),
            ),
        };
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(());
        };
        let over = |since_ms: i64| absent && self.is_over_grace(since_ms, graces);
        match (&row.state.submission, row.state.elements.get(element)) {
            (Submission::Doubtful { since_ms, .. }, _) if over(*since_ms) => {
                self.books.job_event(name, JobEvent::Absent)
            }
            (Submission::Doubtful { .. }, _) => Ok(()),
            (_, Some(Element::Unknown { since_ms, .. })) if over(*since_ms) => {
                self.books.job_event(name, JobEvent::GiveUp { element })
            }
            // The element was asked to end and is gone, as wanted.
            (_, Some(Element::Stopping)) if absent && self.left_final_report(name, element) => {
                let words = "ended by request".to_owned();
                self.end(name, element, Judgement::default(), words)
            }
            _ => {
                self.see(name, element, |seen| seen.why.clone_from(&why));
                // A silent scheduler says nothing about the job.
                let is_silent = matches!(
                    unknown,
                    Unknown::NotListed {
                        queue_answered: false,
                        ..
                    }
                );
                if is_silent {
                    return Ok(());
                }
                self.vanish(name, element, why)
            }
        }
    }

    /// Whether the first driver of an element never began, or left its final report.
    fn left_final_report(&self, name: &str, element: usize) -> bool {
        let traces = self.inquiry.traces.get(&(name.to_owned(), element));
        traces.is_some_and(|traces| {
            traces.started.first() != Some(&true)
                || traces.ends.first().is_some_and(Option::is_some)
        })
    }

    fn end(
        &mut self,
        name: &str,
        element: usize,
        judgement: Judgement,
        words: String,
    ) -> Result<(), EngineError> {
        let ending = Ending {
            cause: judgement.cause,
            words,
            failed_nodes: judgement.failed_nodes,
        };
        self.books
            .job_event(name, JobEvent::Ended { element, ending })
    }

    fn vanish(&mut self, name: &str, element: usize, why: String) -> Result<(), EngineError> {
        let at_ms = self.books.now_ms();
        let event = JobEvent::Vanished {
            element,
            at_ms,
            why,
        };
        self.books.job_event(name, event)
    }

    /// Updates what was seen of an element and marks its patients' rows, which show it.
    fn see(&mut self, name: &str, element: usize, change: impl FnOnce(&mut SeenElement)) {
        if self.books.jobs_mut().see(name, element, change) {
            self.books.touch_placed(name, Some(element));
        }
    }
}
