//! What decisions ask, and the answers: queue, accounting, and the contents of folders, as plain
//! data.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use cardiotwin_schemas::allocation::{AttemptAllocation, DriverEnd};
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_slurm::answers::accounting::AccountingRow;
use cardiotwin_slurm::answers::config::SiteConfig;
use cardiotwin_slurm::answers::qos::QosRow;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::answers::{NoAnswer, Table};
use cardiotwin_slurm::job::JobName;

use super::effects::{EffectResult, ElementId};
use crate::dispatch::AttemptFindings;
use crate::files_seen::{Asked, FilesSeen};
use crate::requests::Pending;

/// An element and the files to look for in its job's folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ElementFiles {
    pub id: ElementId,
    /// Number of drivers that may have left files.
    pub n_drivers: u32,
    pub is_array: bool,
}

/// What a decision has to know.
#[derive(Debug)]
pub enum Question {
    /// Files and outcomes that decisions on chains need.
    Chain(Asked),
    /// What became of the attempt at a task.
    Attempt {
        attempt: AttemptId,
        /// Whether the books know that it has begun.
        is_begun: bool,
    },
    /// Reports of drivers, and marks of submissions that were interrupted.
    DriverReports {
        /// Elements that are not over, each with whether Slurm is known to have accepted its job.
        elements: Vec<(ElementFiles, bool)>,
        /// Jobs of which no submission is known.
        intended: Vec<String>,
    },
    /// All jobs of the user.
    Queue,
    /// Past jobs by name since a time in seconds since 1970; all jobs of the user without names.
    Accounting { names: Vec<JobName>, since_s: i64 },
    /// Traces that elements left in their jobs' folders.
    Traces(Vec<ElementFiles>),
    /// What elements that ended left of their drivers and attempts.
    Remains {
        attempts: Vec<AttemptId>,
        elements: Vec<ElementFiles>,
    },
    /// The site.
    Site {
        /// Whether the limits are needed.
        wants_limits: bool,
        /// Files of meshes whose numbers of nodes are unknown.
        meshes: Vec<PathBuf>,
    },
}

/// What was observed.
#[derive(Debug)]
pub enum Observation {
    Requests(Vec<Pending>),
    Chain(FilesSeen),
    Attempt(AttemptSeen),
    DriverReports(DriverReports),
    Queue(Result<Table<QueueRow>, NoAnswer>),
    Accounting(Result<Table<AccountingRow>, NoAnswer>),
    Traces(BTreeMap<ElementId, Traces>),
    Remains(Remains),
    Site(SiteSeen),
    /// Results of the effects of the last turn.
    Results(Vec<EffectResult>),
}

/// What was seen of an attempt.
#[derive(Debug)]
pub enum AttemptSeen {
    /// Nothing that the books do not know.
    Nothing,
    /// A driver has begun it, in this allocation if that is readable.
    Begun(Option<AttemptAllocation>),
    /// It published an outcome.
    Ended(AttemptFindings),
    /// It published nothing, was revoked, and a later job has begun the next attempt.
    Superseded,
}

/// Reports of drivers.
#[derive(Debug, Default)]
pub struct DriverReports {
    /// Reports by element.
    pub elements: BTreeMap<ElementId, DriverReport>,
    /// Jobs whose submission had begun.
    pub submitting: Vec<String>,
}

/// Report of the drivers of an element.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DriverReport {
    /// Whether a driver has begun, looked for unless Slurm is known to have accepted the job.
    pub has_started: bool,
    /// Slurm's number of the job, as the driver knows it.
    pub job: Option<u64>,
    /// Final reports of all drivers; `None` while one is missing.
    pub ends: Option<Vec<DriverEnd>>,
}

/// Traces that an element left in its job's folder.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Traces {
    /// For each driver whether it has begun.
    pub started: Vec<bool>,
    /// Final report of each driver; `None` for one that left none.
    pub ends: Vec<Option<DriverEnd>>,
    /// Whether a driver was asked to end, other than by the warning before the walltime.
    pub asked_to_end: bool,
    /// End of the logs.
    pub log_tail: String,
}

/// What elements that ended left.
#[derive(Debug, Default)]
pub struct Remains {
    pub attempts: HashMap<AttemptId, AttemptRemains>,
    /// Final reports of drivers, by element.
    pub driver_ends: BTreeMap<ElementId, Vec<DriverEnd>>,
}

/// What is left of an attempt.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttemptRemains {
    /// Name of the job that began it; `None` for an attempt outside a job.
    pub job: Option<String>,
    /// Whether it was revoked before it published.
    pub is_revoked: bool,
    pub has_checkpoint: bool,
}

/// What was seen of the site.
#[derive(Debug, Default)]
pub struct SiteSeen {
    /// Configuration, if the site answered, and limits.
    pub limits: Option<(Option<SiteConfig>, Vec<QosRow>)>,
    /// Number of nodes of each mesh; `None` for a file that does not state it.
    pub mesh_nodes: Vec<(PathBuf, Option<u32>)>,
}
