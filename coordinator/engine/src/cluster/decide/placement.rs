//! Places waiting patients in jobs whose names go into the next commit.

use cardiotwin_slurm::site::Queue;
use cardiotwin_workflow::cluster_job::Submission;

use super::super::budget::Budget;
use super::super::expect::Expectations;
use super::super::place::{PlannedJob, in_use, plan_jobs};
use super::super::waiting::waiting;
use super::State;
use crate::EngineError;

impl State {
    /// Packs waiting patients into jobs and puts these with their names into the next commit.
    pub(super) fn place(&mut self) -> Result<(), EngineError> {
        self.books.jobs_mut().set_holds(None);
        let waiting = waiting(&self.books);
        self.report.node_hours_left = 0.0;
        self.report.finish_after_s = None;
        if waiting.is_empty() {
            self.hold(None);
            return Ok(());
        }
        let Some(queue) = &self.queue else {
            // Limits apply to all jobs of the user, so without an answer the free room is unknown.
            let why = self.report.no_answer.clone().unwrap_or_default();
            self.hold(Some(format!(
                "no job is submitted until the queue answers: {why}"
            )));
            return Ok(());
        };
        let (rows, intended) = (queue.rows.clone(), self.intended());
        // Jobs whose names are committed but which are not yet in the queue take room, too.
        let in_use = |queue: &Queue| in_use(queue, &rows, intended);
        let expected = Expectations::of(&self.books, &self.settings, &self.site, &self.mesh_sizes);
        let jobs = plan_jobs(
            &self.books,
            &waiting,
            &self.site,
            &self.settings,
            &expected,
            &in_use,
        )?;
        self.report.node_hours_left = jobs.iter().map(|job| job.spec.expected_node_hours).sum();
        self.report.finish_after_s = jobs.iter().map(|job| job.predicted_s).reduce(f64::max);
        let n_patients = |job: &PlannedJob| job.patients.iter().map(Vec::len).sum::<usize>();
        let later: usize = jobs.iter().filter(|job| !job.now).map(n_patients).sum();
        let mut budget = Budget::of(&self.settings, self.books.jobs().rows().values());
        let mut unaffordable = 0;
        for job in jobs.into_iter().filter(|job| job.now) {
            if !budget.takes(&job.spec) {
                unaffordable += n_patients(&job);
                continue;
            }
            let name = self.fresh_name();
            self.books.intend_job(name, job.spec);
        }
        let full = (later > 0)
            .then(|| format!("{later} patients wait until jobs have ended: the queue is full"));
        let spent = (unaffordable > 0).then(|| budget.holds(unaffordable));
        self.hold(spent.or(full));
        Ok(())
    }

    fn intended(&self) -> u32 {
        let rows = self
            .books
            .jobs()
            .rows()
            .values()
            .filter(|row| row.state.submission == Submission::Intended);
        u32::try_from(rows.map(|row| row.spec.elements.len()).sum::<usize>()).unwrap_or(u32::MAX)
    }

    pub(super) fn hold(&mut self, why: Option<String>) {
        self.report.holds.clone_from(&why);
        self.books.jobs_mut().set_holds(why);
    }

    /// A name that no job has had: cohort, time, process id and a counter.
    fn fresh_name(&mut self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let run = self
            .books
            .run_dir()
            .parent()
            .and_then(|p| p.file_name())
            .unwrap_or_default()
            .to_string_lossy();
        let cohort: String = run.chars().map(plain).take(24).collect();
        loop {
            self.names += 1;
            let (now_ms, pid, n) = (self.books.now_ms(), self.process.pid, self.names);
            let name = format!("ct-{cohort}-{now_ms:x}-{pid:x}-{n:x}");
            if !self.books.jobs().rows().contains_key(&name) {
                return name;
            }
        }
    }
}
