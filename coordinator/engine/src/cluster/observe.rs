//! Observes jobs: the files that they left first, then one squeue, then at most one sacct.

use std::collections::HashMap;
use std::hash::Hash;

use cardiotwin_schemas::allocation::DriverEnding;
use cardiotwin_schemas::failure::FailureCause;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::access::folder::JobFolder;
use cardiotwin_slurm::answers::accounting::{self, AccountingRow};
use cardiotwin_slurm::answers::queue::{self, QueueRow};
use cardiotwin_slurm::answers::{NoAnswer, Table};
use cardiotwin_slurm::cancelled::OwnTraces;
use cardiotwin_slurm::commands;
use cardiotwin_slurm::failure::{Evidence, classify, failed_nodes, is_open};
use cardiotwin_slurm::job::JobName;
use cardiotwin_slurm::job_status::{self, Accounting, Alive, Ended, JobStatus, Unknown, Wanted};
use cardiotwin_slurm::state::SlurmState;
use cardiotwin_store::cluster_jobs::SeenElement;
use cardiotwin_workflow::cluster_job::{Element, Ending, JobEvent, Submission};

use super::Cluster;
use super::place::wants_place;
use crate::EngineError;
use crate::dispatch;

/// With more names than this, sacct is asked for all jobs of the user instead of a list.
const MOST_NAMES: usize = 1000;
/// Number of grace times to wait while accounting says that a job is alive and the queue does not
/// list it.
const GRACES_OF_A_DISPUTE: i64 = 10;

/// Rows by name and element, so that each element of a large array finds its own rows.
type Queued = HashMap<(String, Option<u32>), Table<QueueRow>>;
type Accounted = HashMap<String, Table<AccountingRow>>;

impl<S: Scheduler> Cluster<S> {
    /// Looks at every job that is not over.
    pub(super) async fn look_at_jobs(&mut self) -> Result<(), EngineError> {
        self.queue = None;
        for (name, element) in self.books.elements_at_work() {
            self.own_evidence(&name, element)?;
        }
        let names: Vec<String> = self.books.jobs().rows().keys().cloned().collect();
        for name in &names {
            self.interrupted_submission(name)?;
        }
        let asked = |row: &&cardiotwin_store::cluster_jobs::JobRow| {
            !row.state.is_over() && row.state.submission != Submission::Intended
        };
        let live = self.books.jobs().rows().values().filter(asked).count();
        if live == 0
            && !self.has_lingering()
            && !(0..self.books.patients().len()).any(|i| wants_place(&self.books, i))
        {
            return Ok(());
        }
        if self.leaves_slurm_alone() {
            return Ok(());
        }
        let queue = self.ask(commands::queue(), queue::read).await?;
        self.queue.clone_from(&queue);
        let queued = queue.map(|table| by_key(table, |row| (row.name.clone(), row.id.element)));
        if queued.is_some() {
            self.look_for_lingering(|name, element| {
                of_key(queued.as_ref(), &(name.to_owned(), element))
            });
        }
        let work = self.books.elements_at_work();
        let unclear: Vec<&String> = work
            .iter()
            .filter(|(name, element)| self.needs_accounting(name, *element, queued.as_ref()))
            .map(|w| &w.0)
            .collect();
        let accounted = match unclear.is_empty() {
            true => None,
            false => self
                .ask_accounting(&unclear)
                .await?
                .map(|table| by_key(table, |row| row.name.clone())),
        };
        for (name, element) in work {
            self.take_status(&name, element, queued.as_ref(), accounted.as_ref())?;
        }
        Ok(())
    }

    /// Runs a query and records whether squeue was answered.
    async fn ask<T>(
        &mut self,
        command: commands::Command,
        read: impl Fn(&cardiotwin_slurm::answers::Output) -> Result<T, NoAnswer>,
    ) -> Result<Option<T>, EngineError> {
        self.report.commands += 1;
        let output = self.run_command(&command).await?;
        Ok(match read(&output) {
            Ok(answer) => {
                if command.program == "squeue" {
                    self.report.answered_ms = Some(self.books.now_ms());
                    self.report.no_answer = None;
                    self.answered(None);
                }
                Some(answer)
            }
            Err(error) => {
                self.no_accounting |= error.says_no_accounting();
                // Without accounting sacct never answers, so its silence does not count: queue and
                // job folders have to suffice.
                if command.program == "squeue" {
                    self.report.no_answer = Some(error.to_string());
                    self.answered(Some(&error.to_string()));
                }
                None
            }
        })
    }

    async fn ask_accounting(
        &mut self,
        names: &[&String],
    ) -> Result<Option<Table<AccountingRow>>, EngineError> {
        let rows = names
            .iter()
            .filter_map(|name| self.books.jobs().rows().get(*name));
        let since_s = rows.map(|row| row.intended_ms).min().unwrap_or_default() / 1000 - 60;
        let mut listed: Vec<JobName> = names
            .iter()
            .filter_map(|name| JobName::new(name).ok())
            .collect();
        listed.dedup();
        if listed.len() > MOST_NAMES {
            listed.clear();
        }
        self.ask(commands::accounting(&listed, since_s), accounting::read)
            .await
    }

    /// Takes up the files that an element left in its folder.
    fn own_evidence(&mut self, name: &str, element: usize) -> Result<(), EngineError> {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(());
        };
        let (n_drivers, accepted) = (
            row.spec.n_drivers(),
            matches!(row.state.submission, Submission::Accepted { .. }),
        );
        let folder = JobFolder::of(self.books.run_dir(), name);
        if !accepted {
            let Some(started) = folder.started(element, 0) else {
                return Ok(());
            };
            let job = started
                .job
                .and_then(|id| id.split('_').next()?.parse().ok());
            self.books.job_event(name, JobEvent::Accepted { job })?;
        }
        let Some(ends) = (0..n_drivers)
            .map(|node| folder.ended(element, node))
            .collect::<Option<Vec<_>>>()
        else {
            return Ok(());
        };
        // Only the scheduler knows who told the driver to stop.
        if ends.iter().any(|end| end.because == DriverEnding::Stopped) {
            return Ok(());
        }
        let late = ends
            .iter()
            .any(|end| end.because == DriverEnding::OutOfTime);
        let elapsed_s = ends.iter().map(|end| end.wall_s).fold(0.0, f64::max) as u64;
        self.books.jobs_mut().see(name, element, |seen| {
            seen.elapsed_s = Some(elapsed_s);
            seen.why.clear();
        });
        let words = if late {
            "stopped at the end of its walltime"
        } else {
            "finished"
        };
        let ending = Ending {
            cause: late.then_some(FailureCause::Walltime),
            words: words.to_owned(),
            ..Ending::default()
        };
        self.ended_by_its_word(name, element);
        self.books
            .job_event(name, JobEvent::Ended { element, ending })
    }

    /// A submission that was interrupted by the end of the coordinator becomes doubtful.
    fn interrupted_submission(&mut self, name: &str) -> Result<(), EngineError> {
        let intended = self
            .books
            .jobs()
            .rows()
            .get(name)
            .is_some_and(|row| row.state.submission == Submission::Intended);
        if intended && JobFolder::of(self.books.run_dir(), name).was_submitting() {
            let why = "the coordinator ended during the submission".to_owned();
            let at_ms = self.books.now_ms();
            self.books.job_event(name, JobEvent::Doubt { at_ms, why })?;
        }
        Ok(())
    }

    pub(super) fn wanted<'a>(&self, name: &'a str, element: usize) -> Wanted<'a> {
        let is_array = self
            .books
            .jobs()
            .rows()
            .get(name)
            .is_some_and(|row| row.spec.is_array);
        Wanted {
            name,
            element: is_array.then(|| u32::try_from(element).unwrap_or(u32::MAX)),
        }
    }

    fn key(&self, name: &str, element: usize) -> (String, Option<u32>) {
        (name.to_owned(), self.wanted(name, element).element)
    }

    /// Whether the fate of an element cannot be told from the queue alone.
    fn needs_accounting(&self, name: &str, element: usize, queued: Option<&Queued>) -> bool {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return false;
        };
        if row.state.submission == Submission::Intended {
            return false;
        }
        match job_status::of(
            self.wanted(name, element),
            of_key(queued, &self.key(name, element)),
            None,
        ) {
            JobStatus::Alive(_) => false,
            // Only accounting has the canceller and the exit code.
            JobStatus::Ended(ended) => {
                ended.exit.is_none()
                    && matches!(ended.state, SlurmState::Cancelled | SlurmState::Failed)
            }
            JobStatus::Unknown(_) => queued.is_some(),
        }
    }

    fn take_status(
        &mut self,
        name: &str,
        element: usize,
        queued: Option<&Queued>,
        accounted: Option<&Accounted>,
    ) -> Result<(), EngineError> {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(());
        };
        if row.state.submission == Submission::Intended {
            return Ok(());
        }
        let accounting = of_key(accounted, &name.to_owned());
        match job_status::of(
            self.wanted(name, element),
            of_key(queued, &self.key(name, element)),
            accounting,
        ) {
            JobStatus::Alive(alive) => self.alive(name, element, &alive),
            JobStatus::Ended(ended) => self.ended(name, element, &ended),
            JobStatus::Unknown(unknown) => self.unknown(name, element, &unknown),
        }
    }

    fn alive(&mut self, name: &str, element: usize, alive: &Alive) -> Result<(), EngineError> {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(());
        };
        let known = matches!(row.state.submission, Submission::Accepted { job: Some(_) });
        let as_before = match row.state.elements.get(element) {
            Some(Element::Running) => alive.runs,
            Some(Element::Waiting) => !alive.runs,
            _ => false,
        };
        if !known {
            self.books.job_event(
                name,
                JobEvent::Accepted {
                    job: Some(alive.id.job),
                },
            )?;
        }
        if !as_before {
            self.books.job_event(
                name,
                JobEvent::Seen {
                    element,
                    runs: alive.runs,
                },
            )?;
        }
        let why = alive
            .why
            .as_ref()
            .map(|why| why.words_for(alive.id))
            .unwrap_or_default();
        self.look(name, element, |seen| {
            seen.why = why;
            seen.start_s = alive.start;
            seen.nodes.clone_from(&alive.nodes);
        });
        Ok(())
    }

    fn ended(&mut self, name: &str, element: usize, ended: &Ended) -> Result<(), EngineError> {
        let Some(row) = self.books.jobs().rows().get(name) else {
            return Ok(());
        };
        let folder = JobFolder::of(self.books.run_dir(), name);
        let stopping = row.state.elements.get(element) == Some(&Element::Stopping);
        let array_element = row.spec.is_array.then_some(element);
        let warned = (0..row.spec.n_drivers()).any(|node| {
            folder
                .ended(element, node)
                .is_some_and(|end| end.because == DriverEnding::OutOfTime)
        });
        // Accounting may never list a job that could not start. Any other job appears there,
        // however late.
        let graces = match ended.accounting {
            Accounting::Disagrees | Accounting::Silent if !self.no_accounting => {
                GRACES_OF_A_DISPUTE
            }
            _ => 1,
        };
        let traces = OwnTraces {
            began: (0..row.spec.n_drivers()).any(|node| folder.started(element, node).is_some()),
            asked_to_end: (0..row.spec.n_drivers())
                .any(|node| folder.was_asked_to_end(element, node)),
            uid: dispatch::own_uid(),
            no_accounting: self.no_accounting,
            waited: match row.state.elements.get(element) {
                Some(Element::Unknown { since_ms, .. }) => {
                    self.books.now_ms() - since_ms > self.grace_ms().saturating_mul(graces)
                }
                _ => false,
            },
        };
        let log_tail = folder.log_tail(array_element);
        let evidence = Evidence {
            scheduler: Some(ended),
            log_tail: &log_tail,
            we_cancelled: stopping,
            warned,
            traces,
        };
        if is_open(&evidence) {
            let why = format!(
                "Slurm reports {}, but not yet by whom",
                ended.state.as_str()
            );
            self.books.job_event(
                name,
                JobEvent::Accepted {
                    job: Some(ended.id.job),
                },
            )?;
            self.look(name, element, |seen| seen.why.clone_from(&why));
            let at_ms = self.books.now_ms();
            return self.books.job_event(
                name,
                JobEvent::Vanished {
                    element,
                    at_ms,
                    why,
                },
            );
        }
        let cause = classify(&evidence);
        let began = if ended.began == Some(false) {
            ", and it never began"
        } else {
            ""
        };
        let words = format!("Slurm reports {}{began}", ended.state.as_str());
        let failed_nodes = match cause {
            Some(FailureCause::NodeFailure) => failed_nodes(&ended.nodes, &log_tail),
            _ => String::new(),
        };
        self.books.job_event(
            name,
            JobEvent::Accepted {
                job: Some(ended.id.job),
            },
        )?;
        self.look(name, element, |seen| {
            seen.elapsed_s = ended.elapsed_s;
            seen.nodes.clone_from(&ended.nodes);
            seen.why.clear();
        });
        self.books.job_event(
            name,
            JobEvent::Ended {
                element,
                ending: Ending {
                    cause,
                    words,
                    failed_nodes,
                },
            },
        )
    }

    pub(super) fn grace_ms(&self) -> i64 {
        i64::try_from(self.settings.slurm.grace_s).unwrap_or(i64::MAX / 20_000) * 1000
    }

    fn unknown(
        &mut self,
        name: &str,
        element: usize,
        unknown: &Unknown,
    ) -> Result<(), EngineError> {
        let now_ms = self.books.now_ms();
        let grace_ms = self.grace_ms();
        let (absent, graces, why) = match unknown {
            Unknown::NotListed { queue_answered, .. } => (
                *queue_answered,
                1,
                if *queue_answered {
                    "unknown to Slurm"
                } else {
                    "Slurm does not answer"
                }
                .to_owned(),
            ),
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
        let over = |since_ms: i64| absent && now_ms - since_ms > grace_ms.saturating_mul(graces);
        match (&row.state.submission, row.state.elements.get(element)) {
            (Submission::Doubtful { since_ms, .. }, _) if over(*since_ms) => {
                self.books.job_event(name, JobEvent::Absent)
            }
            (Submission::Doubtful { .. }, _) => Ok(()),
            (_, Some(Element::Unknown { since_ms, .. })) if over(*since_ms) => {
                self.books.job_event(name, JobEvent::GiveUp { element })
            }
            // The element was asked to end and is gone, as wanted.
            (_, Some(Element::Stopping)) if absent && self.left_its_last_word(name, element) => {
                let ending = Ending {
                    cause: None,
                    words: "ended by request".to_owned(),
                    ..Ending::default()
                };
                self.books
                    .job_event(name, JobEvent::Ended { element, ending })
            }
            _ => {
                self.look(name, element, |seen| seen.why.clone_from(&why));
                // A silent scheduler says nothing about the job.
                if !matches!(
                    unknown,
                    Unknown::NotListed {
                        queue_answered: false,
                        ..
                    }
                ) {
                    self.books.job_event(
                        name,
                        JobEvent::Vanished {
                            element,
                            at_ms: now_ms,
                            why,
                        },
                    )?;
                }
                Ok(())
            }
        }
    }

    fn left_its_last_word(&self, name: &str, element: usize) -> bool {
        let folder = JobFolder::of(self.books.run_dir(), name);
        folder.started(element, 0).is_none() || folder.ended(element, 0).is_some()
    }

    /// Updates what was seen of an element and marks its patients' rows, which show it.
    fn look(&mut self, name: &str, element: usize, change: impl FnOnce(&mut SeenElement)) {
        if self.books.jobs_mut().see(name, element, change) {
            self.books.touch_placed(name, Some(element));
        }
    }
}

/// Groups the rows of a table by a key. Unreadable lines may concern any row, so they are kept with
/// every group and alone under the default key.
fn by_key<Row, Key: Hash + Eq + Default>(
    table: Table<Row>,
    key: impl Fn(&Row) -> Key,
) -> HashMap<Key, Table<Row>> {
    let mut tables: HashMap<Key, Table<Row>> = HashMap::new();
    let unreadable = table.unreadable;
    for row in table.rows {
        let entry = tables.entry(key(&row));
        entry
            .or_insert_with(|| Table {
                rows: Vec::new(),
                unreadable: unreadable.clone(),
            })
            .rows
            .push(row);
    }
    tables.entry(Key::default()).or_insert_with(|| Table {
        rows: Vec::new(),
        unreadable,
    });
    tables
}

/// Rows of one key. Without any, the group of the default key still shows that there was an answer.
fn of_key<'a, Row, Key: Hash + Eq + Default>(
    tables: Option<&'a HashMap<Key, Table<Row>>>,
    key: &Key,
) -> Option<&'a Table<Row>> {
    let tables = tables?;
    tables.get(key).or_else(|| tables.get(&Key::default()))
}
