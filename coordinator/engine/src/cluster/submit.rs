//! Executes the committed actions of a tick: fences, cancellations, submissions. Every action may
//! be executed twice.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use cardiotwin_schemas::allocation::{JobOrder, JobPatient, KnownTask, Standing};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::access::folder::JobFolder;
use cardiotwin_slurm::answers::submit::{self, Refusal, RefusalKind, Submission as Answer};
use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::commands;
use cardiotwin_slurm::job::{JobId, JobName};
use cardiotwin_slurm::script::{self, Array, Drivers, Job};
use cardiotwin_slurm::site::Site;
use cardiotwin_store::cluster_jobs::{JobRow, JobSpec};
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::cluster_job::{Element, JobEvent, Submission};
use cardiotwin_workflow::derivation::Teaching;
use cardiotwin_workflow::task::Task;

use super::{Cluster, Expectations};
use crate::books::Books;
use crate::dispatch::{self, Evidence};
use crate::turn::Engine as _;
use crate::{EngineError, overlay};

/// Whether submission continues in this tick.
enum Room {
    /// The queue takes jobs.
    Open,
    /// The queue is full, or the scheduler does not answer: the rest waits for the next tick.
    Closed,
}

impl<S: Scheduler> Cluster<S> {
    /// Executes the actions of committed batches.
    pub(super) async fn work_off_outbox(&mut self) -> Result<(), EngineError> {
        let mut cancelled: Vec<(i64, String, usize)> = Vec::new();
        let mut room = if self.leaves_slurm_alone() {
            Room::Closed
        } else {
            Room::Open
        };
        let actions = self.books.take_outbox();
        let mut kept = Vec::new();
        // Fences come first, because jobs that are submitted below may go past the attempts that
        // they stop.
        let (fences, others): (Vec<_>, Vec<_>) = actions.into_iter().partition(|(_, action)| {
            matches!(action, Action::FenceJob { .. } | Action::Stop { .. })
        });
        for (id, action) in fences.into_iter().chain(others) {
            self.pass("before an action")?;
            match action {
                Action::FenceJob { job, element } => {
                    JobFolder::of(self.books.run_dir(), &job).fence(element)?
                }
                Action::Stop { attempt } => {
                    let published = self.stop(&attempt)?;
                    self.pass("after an action")?;
                    // The action is done when the end of the attempt is taken up.
                    self.stopped.push((id, attempt, published));
                    continue;
                }
                Action::WriteOverlay { patient_id } => {
                    self.books
                        .recall_patient(&mut self.writer, patient_id)
                        .await?;
                    overlay::write_of(&self.books, patient_id)?;
                }
                Action::CancelJob { job, element } => {
                    cancelled.push((id, job, element));
                    continue;
                }
                Action::SubmitJob { job } => {
                    if matches!(room, Room::Open) {
                        room = self.submit(&job).await?;
                    }
                    let row = self.books.jobs().rows().get(&job);
                    if row.is_some_and(|row| row.state.submission == Submission::Intended) {
                        kept.push((id, Action::SubmitJob { job }));
                        continue;
                    }
                }
                // Drivers begin the attempts of jobs.
                Action::Submit { .. } => {}
            }
            self.pass("after an action")?;
            self.books.action_done(id);
        }
        self.cancel(cancelled, &mut kept).await?;
        self.books.keep_actions(kept);
        Ok(())
    }

    /// Revokes an attempt that is not wanted any more. An outcome that was published first is taken
    /// up.
    fn stop(&self, attempt: &AttemptId) -> Result<Option<Evidence>, EngineError> {
        let directory = self.books.directory(attempt);
        // An attempt that never began is revoked as well, so that no driver begins it.
        std::fs::create_dir_all(&directory).map_err(|source| EngineError::File {
            what: "create",
            path: directory.clone(),
            source,
        })?;
        let published = dispatch::revoke(&directory, attempt, "no longer needed")?;
        Ok(published)
    }

    /// Cancels all given elements with one scancel, an array of which nothing is to go on by its own
    /// number, and jobs without a known number by their names.
    async fn cancel(
        &mut self,
        wanted: Vec<(i64, String, usize)>,
        kept: &mut Vec<(i64, Action)>,
    ) -> Result<(), EngineError> {
        let mut of_jobs: BTreeMap<&str, BTreeSet<usize>> = BTreeMap::new();
        for (_, name, element) in &wanted {
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
        let numbers = (!numbers.is_empty()).then(|| commands::cancel(&numbers));
        let mut done = !self.leaves_slurm_alone();
        if done {
            for command in numbers
                .into_iter()
                .chain(names.iter().map(commands::cancel_name))
            {
                self.report.commands += 1;
                done &= self.run_command(&command).await?.exit == Exit::Code(0);
            }
        }
        for (id, job, element) in wanted {
            match done {
                true => self.books.action_done(id),
                // The cancellation is repeated at the next tick.
                false => kept.push((id, Action::CancelJob { job, element })),
            }
        }
        Ok(())
    }

    async fn submit(&mut self, name: &str) -> Result<Room, EngineError> {
        let Some(row) = self.books.jobs().rows().get(name).cloned() else {
            return Ok(Room::Open);
        };
        let folder = JobFolder::of(self.books.run_dir(), name);
        if row.state.submission != Submission::Intended || folder.was_submitting() {
            return Ok(Room::Open); // submitted before: the next tick looks it up
        }
        let text = match script_of(
            &row.spec,
            name,
            &folder,
            &self.site,
            &self.settings,
            &self.program,
        ) {
            Ok(text) => text,
            Err(error) => {
                self.books.job_event(
                    name,
                    JobEvent::Refused {
                        why: error.to_string(),
                    },
                )?;
                return Ok(Room::Open);
            }
        };
        folder.write(&self.orders(&row)?, &text)?;
        self.pass("after a job's files were written")?;
        folder.mark_submitting()?;
        self.report.commands += 1;
        let output = self
            .run_command(&commands::submit(
                &folder.path().to_string_lossy(),
                &folder.script().to_string_lossy(),
            ))
            .await?;
        let answer = submit::read(&output);
        match &answer {
            Answer::Doubtful { why } => self.answered(Some(why)),
            _ => self.answered(None),
        }
        let room = match answer {
            Answer::Accepted { job, .. } => {
                self.submitted += row.spec.elements.len() as u64;
                self.books
                    .job_event(name, JobEvent::Accepted { job: Some(job.job) })?;
                Room::Open
            }
            Answer::Refused(refusal)
                if matches!(refusal.kind, RefusalKind::Impossible | RefusalKind::Person) =>
            {
                let why = format!("refused by Slurm ({}): {}", ended(&output), told(&refusal));
                self.books.job_event(name, JobEvent::Refused { why })?;
                Room::Open
            }
            Answer::Refused(refusal) => {
                // The refusal is definite, so the same name may be submitted again.
                folder.unmark_submitting()?;
                self.pass("after a mark was taken back")?;
                let why = format!("refused for now: {}", refusal.said);
                for element in 0..row.spec.elements.len() {
                    self.books
                        .jobs_mut()
                        .see(name, element, |seen| seen.why.clone_from(&why));
                }
                self.books.touch_placed(name, None);
                let what = match refusal.kind {
                    RefusalKind::Busy => "Slurm takes no jobs at present",
                    _ => "the queue is full",
                };
                self.hold(Some(format!("{what}: {}", told(&refusal))));
                Room::Closed
            }
            Answer::Doubtful { why } => {
                let at_ms = self.books.now_ms();
                self.books.job_event(
                    name,
                    JobEvent::Doubt {
                        at_ms,
                        why: why.clone(),
                    },
                )?;
                self.hold(Some(format!(
                    "no more jobs are submitted until Slurm answers: {why}"
                )));
                Room::Closed
            }
        };
        self.commit().await?;
        Ok(room)
    }

    /// Orders for the driver of each element.
    fn orders(&self, row: &JobRow) -> Result<Vec<JobOrder>, EngineError> {
        let expected = Expectations::of(&self.books, &self.settings, &self.mesh_sizes);
        let mut orders = Vec::with_capacity(row.spec.elements.len());
        for element in &row.spec.elements {
            let mut expected_s = std::collections::BTreeMap::new();
            let mut patients = Vec::with_capacity(element.len());
            for placed in element {
                let Some(i) = self.books.by_id(placed.patient_id) else {
                    continue;
                };
                let lessons = match self.books.teaching(i)? {
                    Teaching::None => None,
                    Teaching::Lessons(lessons) => Some(lessons.to_vec()),
                    // The job was planned before the pilots were to teach anew, and is not wanted
                    // any more.
                    Teaching::Awaited(_) => continue,
                };
                let plan = self.books.plan(i)?;
                for (kind, seconds) in expected.by_kind(plan) {
                    let longest: &mut f64 = expected_s.entry(kind).or_default();
                    *longest = longest.max(seconds);
                }
                patients.push(JobPatient {
                    plan: plan.clone(),
                    carried: self.books.patient(i).carried.clone(),
                    lessons,
                    known: known_tasks(&self.books, i),
                });
            }
            orders.push(JobOrder {
                schema_version: formats::JOB_ORDER.version,
                job: row.name.clone(),
                run_dir: self.books.run_dir().to_owned(),
                worker: self.worker.clone(),
                lanes: row.spec.lanes,
                threads: row.spec.threads,
                launcher: self.site.launcher.of_steps(&self.settings.launcher),
                steps: row.spec.steps,
                instruction_set: self.settings.instruction_set,
                vtu_every_ms: self.settings.vtu_every_ms,
                expected_s,
                patients,
            });
        }
        Ok(orders)
    }
}

/// Tasks of a patient that its driver must know: those of its chain and the one that it waits for.
/// Tasks without any attempt are left out.
fn known_tasks(books: &Books, i: usize) -> Vec<KnownTask> {
    let mut keys: Vec<_> = books.patient(i).steps.values().collect();
    keys.sort();
    keys.dedup();
    let known = |key: &&cardiotwin_schemas::ids::TaskKey| {
        let (generation, standing) = match &books.task(key)?.state {
            Task::Open { generation: 0, .. } => return None,
            Task::Open { generation, .. } => (*generation, Standing::Open),
            Task::Published { generation } => (*generation, Standing::Published),
            Task::Failed {
                generation,
                failure,
            } => (*generation, Standing::Failed(failure.clone())),
            // Another patient's driver works at it; this driver finds the attempt by its directory.
            Task::Attempting { generation, .. } => (generation.saturating_sub(1), Standing::Open),
        };
        Some(KnownTask {
            task: (*key).clone(),
            generation,
            standing,
        })
    };
    keys.iter().filter_map(known).collect()
}

/// The exact batch script of a job.
///
/// # Errors
/// [`script::ScriptError`] if the site does not allow the job, or a path cannot stand in a script.
pub fn script_of(
    spec: &JobSpec,
    name: &str,
    folder: &JobFolder,
    site: &Site,
    settings: &ExecutorSettings,
    program: &Path,
) -> Result<String, script::ScriptError> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let refused = |error: cardiotwin_slurm::job::NotAName| script::ScriptError::Text {
        what: "job's name",
        found: error.0,
        why: "it is not a valid job name",
    };
    let queue = site
        .queue
        .iter()
        .find(|queue| queue.name == spec.queue)
        .ok_or_else(|| script::ScriptError::Text {
            what: "queue",
            found: spec.queue.clone(),
            why: "the site's profile has no such queue",
        })?;
    let job = Job {
        name: JobName::new(name).map_err(refused)?,
        account: settings.slurm.account.clone(),
        folder: text(folder.path()),
        walltime_s: spec.walltime_s,
        warning_s: settings.slurm.warning_s,
        n_nodes: spec.n_nodes,
        n_cores: spec.n_cores,
        memory_mib: spec.memory_mib,
        exclude: spec.exclude.clone(),
        array: spec.is_array.then(|| Array {
            n: u32::try_from(spec.elements.len()).unwrap_or(u32::MAX),
            at_once: spec.at_once,
        }),
        command: vec![text(program), "drive".to_owned(), text(folder.path())],
        drivers: match spec.steps {
            Some(_) => Drivers::PerJob,
            None => Drivers::PerNode,
        },
    };
    script::write(&job, queue, site)
}

/// A refusal in Slurm's words, with what to do about it.
fn told(refusal: &Refusal) -> String {
    match refusal.remedy() {
        Some(remedy) => format!("{}; {remedy}", refusal.said),
        None => refusal.said.clone(),
    }
}

/// How sbatch ended, in words.
fn ended(output: &Output) -> String {
    match output.exit {
        Exit::Code(code) => format!("exit code {code} of sbatch"),
        Exit::Signal(signal) => format!("signal {signal} to sbatch"),
        Exit::TimedOut => "no answer of sbatch".to_owned(),
    }
}

/// Whether the job is an array of which elements go on that are not among these.
fn goes_on_without(row: &JobRow, elements: &BTreeSet<usize>) -> bool {
    let mut states = row.state.elements.iter().enumerate();
    row.spec.is_array
        && states.any(|(element, state)| {
            !matches!(state, Element::Over { .. }) && !elements.contains(&element)
        })
}
