//! Status of a submission: alive, ended, or unknown. A job that is not listed has not necessarily
//! ended.
//!
//! The files that the job itself left take precedence and are read by the caller. Only the
//! scheduler's answers count here: one squeue and at most one sacct for any number of jobs.

use crate::answers::Table;
use crate::answers::accounting::{AccountingRow, ExitCode};
use crate::answers::queue::QueueRow;
use crate::job::{JobId, Jobs};
use crate::reason::{self, Why};
use crate::state::{Liveness, SlurmState};

/// Account of Slurm's database of a run that the queue shows as ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accounting {
    /// The database shows the same ending, which [`Ended`] describes.
    Agrees,
    /// The database shows the run as waiting or running.
    Disagrees,
    /// The database answered, but does not list the run.
    Unaware,
    /// The database did not answer, or was not asked.
    Silent,
}

/// Status of one job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JobStatus {
    /// The job waits or runs.
    Alive(Alive),
    /// The job has ended. No other run under the same name waits or runs.
    Ended(Ended),
    /// The scheduler's answers do not decide it: wait, and show the reason.
    Unknown(Unknown),
}

/// A job that waits or runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Alive {
    /// Number of the job.
    pub id: JobId,
    /// Whether the job has begun.
    pub runs: bool,
    /// State in Slurm's terms.
    pub state: SlurmState,
    /// Why it waits; `None` if it runs.
    pub why: Option<Why>,
    /// Actual or expected start, seconds since 1970.
    pub start: Option<i64>,
    /// Nodes of the job in Slurm's compressed notation; empty before the start.
    pub nodes: String,
}

/// A job that has ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ended {
    /// Number of the job.
    pub id: JobId,
    /// State in Slurm's terms.
    pub state: SlurmState,
    /// Exit of the job; `None` unless sacct reports it.
    pub exit: Option<ExitCode>,
    /// Reason that Slurm gives.
    pub reason: String,
    /// User id of the canceller; `None` unless sacct reports it.
    pub cancelled_by: Option<u32>,
    /// Whether the job ever began; `None` if this is unknown.
    pub began: Option<bool>,
    /// Elapsed time, s; `None` if it is unknown.
    pub elapsed_s: Option<u64>,
    /// Nodes of the job, to be avoided after NODE_FAIL.
    pub nodes: String,
    /// Account of Slurm's database.
    pub accounting: Accounting,
}

impl Ended {
    /// Whether processes of the job may still be alive and write, because the node was lost and not
    /// the process.
    #[must_use]
    pub fn may_have_orphans(&self) -> bool {
        matches!(self.state, SlurmState::NodeFail | SlurmState::BootFail)
    }
}

/// Reason why the status is unknown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Unknown {
    /// No source that answered lists the job.
    NotListed {
        /// Whether the queue answered, with every row readable.
        queue_answered: bool,
        /// Whether accounting answered, with every row readable.
        accounting_answered: bool,
    },
    /// Slurm's state shows neither life nor an end.
    State(SlurmState),
    /// The database shows the job as alive, but the queue answered and does not list it: one of
    /// them lags, or the queue's answer was cut. This is no reason to submit again.
    Disputed(SlurmState),
}

/// A job whose status is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted<'a> {
    /// Unique name, which identifies the job: after a crash of the controller its number may belong
    /// to another job.
    pub name: &'a str,
    /// Index in the array; `None` for a single job.
    pub element: Option<u32>,
}

/// Determines the status of a job. `None` stands for a source that did not answer or was not asked.
///
/// A live run anywhere in the answers takes precedence over ended ones: a requeued job is in the
/// database twice, and a submission that was repeated after a doubtful answer has two numbers.
#[must_use]
pub fn of(
    wanted: Wanted<'_>,
    queue: Option<&Table<QueueRow>>,
    accounting: Option<&Table<AccountingRow>>,
) -> JobStatus {
    let queued = || {
        queue
            .into_iter()
            .flat_map(|t| &t.rows)
            .filter(|row| row.name == wanted.name && row.id.element == wanted.element)
    };
    let accounted = || {
        let rows = accounting
            .into_iter()
            .flat_map(|t| &t.rows)
            .filter(|row| row.name == wanted.name);
        rows.filter_map(|row| Some((id_of(&row.jobs, wanted.element)?, row)))
    };
    if let Some(row) =
        queued().find(|row| matches!(row.state.bearing(), Liveness::Waiting | Liveness::Running))
    {
        return JobStatus::Alive(alive(row));
    }
    if let Some(row) = queued().find(|row| row.state.bearing() == Liveness::Unclear) {
        return JobStatus::Unknown(Unknown::State(row.state.clone()));
    }
    if let Some(row) = queued().max_by_key(|row| row.submitted) {
        // Accounting has more details of the same run: its exit code and its canceller.
        let same =
            || accounted().filter(|(id, more)| *id == row.id && more.submitted >= row.submitted);
        let more = same().filter(|(_, more)| more.state.bearing() == Liveness::Ended);
        return JobStatus::Ended(match more.max_by_key(|(_, more)| more.submitted) {
            // The accounting of an end may come before the start's, and then has no nodes.
            Some((id, more)) if more.nodes.is_empty() => Ended {
                began: Some(!row.nodes.is_empty()),
                nodes: row.nodes.clone(),
                ..ended(id, more)
            },
            Some((id, more)) => ended(id, more),
            None => Ended {
                id: row.id,
                state: row.state.clone(),
                exit: None,
                reason: row.reason.clone(),
                cancelled_by: None,
                // For a job that was cancelled while it waited, the queue shows its end as its
                // start, and no nodes.
                began: Some(!row.nodes.is_empty()),
                elapsed_s: row
                    .end
                    .zip(row.start)
                    .and_then(|(end, start)| u64::try_from(end - start).ok()),
                nodes: row.nodes.clone(),
                accounting: match accounting {
                    None => Accounting::Silent,
                    Some(_) if same().next().is_some() => Accounting::Disagrees,
                    Some(_) => Accounting::Unaware,
                },
            },
        });
    }
    // The queue forgot the job or did not answer. Accounting may still show it as alive, which
    // proves nothing because accounting lags.
    match accounted().max_by_key(|(_, row)| (row.submitted, row.start)) {
        Some((id, row)) => match row.state.bearing() {
            Liveness::Ended => JobStatus::Ended(ended(id, row)),
            Liveness::Unclear => JobStatus::Unknown(Unknown::State(row.state.clone())),
            runs if queue.is_none() => JobStatus::Alive(Alive {
                id,
                runs: runs == Liveness::Running,
                state: row.state.clone(),
                why: (runs == Liveness::Waiting).then(|| reason::why(&row.reason)),
                start: row.start,
                nodes: row.nodes.clone(),
            }),
            _ => JobStatus::Unknown(Unknown::Disputed(row.state.clone())),
        },
        None => not_listed(queue, accounting),
    }
}

fn not_listed(
    queue: Option<&Table<QueueRow>>,
    accounting: Option<&Table<AccountingRow>>,
) -> JobStatus {
    JobStatus::Unknown(Unknown::NotListed {
        queue_answered: queue.is_some_and(Table::is_whole),
        accounting_answered: accounting.is_some_and(Table::is_whole),
    })
}

fn id_of(jobs: &Jobs, element: Option<u32>) -> Option<JobId> {
    match jobs {
        Jobs::One(id) => (id.element == element).then_some(*id),
        Jobs::Waiting { job, .. } => {
            Some(JobId { job: *job, element }).filter(|id| jobs.contains(*id))
        }
    }
}

fn alive(row: &QueueRow) -> Alive {
    let runs = row.state.bearing() == Liveness::Running;
    Alive {
        id: row.id,
        runs,
        state: row.state.clone(),
        why: (!runs).then(|| reason::why(&row.reason)),
        start: row.start,
        nodes: row.nodes.clone(),
    }
}

fn ended(id: JobId, row: &AccountingRow) -> Ended {
    Ended {
        id,
        state: row.state.clone(),
        exit: row.exit,
        reason: row.reason.clone(),
        cancelled_by: row.cancelled_by,
        began: Some(!row.nodes.is_empty()),
        elapsed_s: row.elapsed_s,
        nodes: row.nodes.clone(),
        accounting: Accounting::Agrees,
    }
}

#[cfg(test)]
mod tests {
    use super::{Accounting, JobStatus, Unknown, Wanted, of};
    use crate::answers::{accounting, queue, recorded};
    use crate::state::SlurmState;

    fn wanted(name: &str) -> Wanted<'_> {
        Wanted {
            name,
            element: None,
        }
    }

    #[test]
    fn absence_is_no_ending() {
        let queue = queue::read(&recorded::output("squeue-empty")).expect("an answer");
        let unknown = of(wanted("ct-gone"), Some(&queue), None);
        assert_eq!(
            unknown,
            JobStatus::Unknown(Unknown::NotListed {
                queue_answered: true,
                accounting_answered: false
            })
        );
        assert!(matches!(
            of(wanted("ct-gone"), None, None),
            JobStatus::Unknown(_)
        ));
    }

    #[test]
    fn a_requeued_job_lives_although_the_database_has_it_as_ended() {
        let rows = accounting::read(&recorded::output("sacct-node-failed")).expect("an answer");
        let live = queue::read(&recorded::output("squeue-node-failed")).expect("an answer");
        let JobStatus::Alive(alive) = of(wanted("ct-requeued"), Some(&live), Some(&rows)) else {
            panic!("it waits again")
        };
        assert!(!alive.runs);
        let JobStatus::Ended(ended) = of(wanted("ct-node"), Some(&live), Some(&rows)) else {
            panic!("it was not to be requeued")
        };
        assert!(ended.may_have_orphans() && ended.nodes == "n4");
    }

    #[test]
    fn without_a_queue_accounting_is_asked_and_without_it_the_queue_remembers_for_a_while() {
        let rows = accounting::read(&recorded::output("sacct-ended")).expect("an answer");
        let queue = queue::read(&recorded::output("squeue-ended")).expect("an answer");
        for (name, state) in [
            ("ct-short", SlurmState::Completed),
            ("ct-walltime", SlurmState::Timeout),
            ("ct-person", SlurmState::Cancelled),
            ("ct-exit3", SlurmState::Failed),
        ] {
            for (queue, rows) in [
                (Some(&queue), None),
                (None, Some(&rows)),
                (Some(&queue), Some(&rows)),
            ] {
                let JobStatus::Ended(ended) = of(wanted(name), queue, rows) else {
                    panic!("{name} has ended")
                };
                assert_eq!(ended.state, state, "{name}");
                assert_eq!(
                    ended.exit.is_some(),
                    rows.is_some(),
                    "{name}: only accounting tells the exit code"
                );
            }
        }
        let element = Wanted {
            name: "ct-array",
            element: Some(7),
        };
        assert!(matches!(
            of(element, Some(&queue), None),
            JobStatus::Ended(_)
        ));
        assert!(matches!(
            of(
                Wanted {
                    element: Some(8),
                    ..element
                },
                Some(&queue),
                Some(&rows)
            ),
            JobStatus::Unknown(_)
        ));
    }

    #[test]
    fn a_held_job_that_was_cancelled_is_known_to_the_queue_alone() {
        let rows = accounting::read(&recorded::output("sacct-ended")).expect("an answer");
        let queue = queue::read(&recorded::output("squeue-ended")).expect("an answer");
        let JobStatus::Ended(ended) = of(wanted("ct-held"), Some(&queue), Some(&rows)) else {
            panic!("squeue knows")
        };
        assert_eq!(
            (ended.began, ended.state, ended.accounting),
            (Some(false), SlurmState::Cancelled, Accounting::Unaware)
        );
        assert!(
            matches!(
                of(wanted("ct-held"), None, Some(&rows)),
                JobStatus::Unknown(_)
            ),
            "sacct never tells"
        );
    }
}
