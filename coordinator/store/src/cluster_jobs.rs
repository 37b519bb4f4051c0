//! Tables `jobs` (submissions to a cluster) and `allotments` (resources for patients' next jobs).

use std::collections::HashMap;

use cardiotwin_schemas::allocation::Steps;
use cardiotwin_schemas::status::{ClusterStatus, JobState, JobStatus};
use cardiotwin_workflow::cluster_job::{ClusterJob, Element, Submission};
use serde::{Deserialize, Serialize};

use crate::clock;

/// A row of `jobs`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JobRow {
    /// Unique name of the job.
    pub name: String,
    /// Version of the row, which guards updates.
    pub version: i64,
    /// Whether no element of the job can be live any more and all their ends were dealt with.
    pub over: bool,
    /// State of the submission and of each element.
    pub state: ClusterJob,
    /// Requested resources and patients.
    pub spec: JobSpec,
    /// Last report of the scheduler on each element.
    pub seen: Vec<SeenElement>,
    /// Time of the decision to submit, milliseconds since 1970.
    pub intended_ms: i64,
}

/// Resources and patients of a job.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct JobSpec {
    /// Name of the queue in the site's profile.
    pub queue: String,
    /// QoS; `None` without a name.
    pub qos: Option<String>,
    /// Whether the job is an array.
    pub is_array: bool,
    /// Largest number of elements at once; `None` means no throttle.
    pub at_once: Option<u32>,
    /// Nodes of each element.
    pub n_nodes: u32,
    /// Cores of each element on a queue that gives single cores.
    pub n_cores: u32,
    /// Memory of each element on a queue that gives single cores, MiB.
    pub memory_mib: Option<u64>,
    /// Number of simulations side by side on each node.
    pub lanes: u32,
    /// Threads of each simulation.
    pub threads: u32,
    /// Steps on MPI ranks; `None` if simulations run on threads, with a driver on each node.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<Steps>,
    /// Walltime that the job requests \[s\].
    pub walltime_s: u64,
    /// Expected node-hours of all elements.
    pub expected_node_hours: f64,
    /// Number of nodes, or fraction of a node, that an element is charged for.
    pub nodes_charged: f64,
    /// Names of nodes on which the job must not run.
    pub exclude: Vec<String>,
    /// Patients of each element.
    pub elements: Vec<Vec<Placed>>,
}

impl JobSpec {
    /// Number of drivers of each element.
    #[must_use]
    pub fn n_drivers(&self) -> u32 {
        if self.steps.is_some() {
            1
        } else {
            self.n_nodes
        }
    }

    /// Number of processes that simulate on each node: MPI ranks, or one for each simulation.
    #[must_use]
    pub fn processes_per_node(&self) -> u32 {
        let of_each = self
            .steps
            .map_or(1, |steps| self.threads.div_ceil(steps.nodes.max(1)));
        (self.lanes * of_each).max(1)
    }
}

impl JobSpec {
    /// Node-hours of all elements if each of them takes its whole walltime.
    #[must_use]
    pub fn asked_node_hours(&self) -> f64 {
        self.elements.len() as f64 * self.asked_of_an_element()
    }

    fn asked_of_an_element(&self) -> f64 {
        self.walltime_s as f64 / 3600.0 * self.nodes_charged
    }
}

/// Node-hours that jobs have taken, and that they would take if each element that has not ended
/// took its whole walltime.
#[must_use]
pub fn committed_node_hours<'a>(jobs: impl Iterator<Item = &'a JobRow>) -> f64 {
    let of_job = |row: &JobRow| -> f64 {
        let of_element = |seen: &SeenElement| match seen.elapsed_s {
            Some(elapsed_s) if seen.settled || row.over => {
                elapsed_s as f64 / 3600.0 * row.spec.nodes_charged
            }
            None if seen.settled || row.over => 0.0,
            _ => row.spec.asked_of_an_element(),
        };
        row.seen.iter().map(of_element).sum()
    };
    jobs.map(of_job).sum()
}

/// A patient in a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Placed {
    /// Row id of the patient.
    pub patient_id: i64,
    /// Number of settled tasks of the chain at submission. A larger number at the end is progress.
    pub settled: usize,
    /// Number of the patient's plan at submission ([`Allotment::plans`]). If it has changed, the
    /// job's work is stale.
    pub plan: u64,
}

/// Last report of the scheduler on an element.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct SeenElement {
    /// Why it waits, in words.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
    /// Actual or expected start, seconds since 1970.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_s: Option<i64>,
    /// Elapsed time, s; `None` if it is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elapsed_s: Option<u64>,
    /// Nodes of the element in Slurm's notation.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub nodes: String,
    /// Whether its end was dealt with for its patients.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub settled: bool,
}

/// Resources for a patient's next job, and retries that its earlier jobs cost.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Allotment {
    /// Number of times that the plan changed to one with other tasks.
    pub plans: u64,
    /// Number of repeats charged to the site.
    pub infrastructure: u32,
    /// Number of repeats charged to nothing.
    pub free: u32,
    /// Memory of the patient's worker, MiB; `None` means the settings apply.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_mib: Option<u64>,
    /// Number of simulations side by side on its node; `None` means as many as its cores allow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lanes: Option<u32>,
    /// Largest number of its MPI ranks on a node; `None` means the settings apply.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ranks_per_node: Option<u32>,
    /// Names of nodes that failed earlier jobs of the patient, which the next job avoids.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<String>,
    /// Reason of the last repeat, for a person.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
}

/// A row of `allotments`.
#[derive(Debug, Serialize)]
pub struct AllotmentRow<'a> {
    /// Row id of the patient.
    pub patient_id: i64,
    /// The allotment, stored as JSON.
    pub allotment: &'a Allotment,
}

/// State of a run's cluster apart from its jobs, stored as a single value and shown by `status`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ClusterReport {
    /// Name of the site.
    pub site: String,
    /// Time of the queue's last answer, milliseconds since 1970.
    pub answered_ms: Option<i64>,
    /// Reason why the last query had no answer; `None` if it had one.
    pub no_answer: Option<String>,
    /// Number of consecutive commands without an answer.
    pub silent: u32,
    /// Time before which Slurm is not asked, milliseconds since 1970.
    pub asks_again_ms: i64,
    /// Why nothing is submitted at present; `None` if submission is possible.
    pub holds: Option<String>,
    /// Charge per node-hour, in `charge_unit`.
    pub charge_per_node_hour: f64,
    /// Unit of the charge.
    pub charge_unit: String,
    /// Expected node-hours of the patients that wait for a job.
    pub node_hours_left: f64,
    /// Time from `answered_ms` until the expected end of the last job, s.
    pub finish_after_s: Option<f64>,
    /// Number of commands in the last tick.
    pub commands: u32,
    /// Elements that ended by their drivers' word and that Slurm may still show as running.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lingering: Vec<Lingering>,
}

/// An element whose drivers have ended while Slurm may still show it as running.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lingering {
    /// Unique name of the job.
    pub name: String,
    /// Index in the array; `None` for a single job.
    pub element: Option<u32>,
    /// Time at which the end was taken up, milliseconds since 1970.
    pub since_ms: i64,
    /// Scheduler's number, once the queue has shown it after its end.
    pub id: Option<String>,
    /// Whether it was cancelled for lingering.
    pub is_cancelled: bool,
}

/// Key of [`ClusterReport`] among the store's single values.
pub const REPORT: &str = "cluster";

/// Scheduler's number of an element, or the job's name while the number is unknown.
#[must_use]
pub fn id_text(row: &JobRow, element: usize) -> String {
    match row.state.submission {
        Submission::Accepted { job: Some(job) } if row.spec.is_array => format!("{job}_{element}"),
        Submission::Accepted { job: Some(job) } => job.to_string(),
        _ if row.spec.is_array => format!("{}_{element}", row.name),
        _ => row.name.clone(),
    }
}

/// State of the cluster as `status` shows it.
#[must_use]
pub fn status(
    report: &ClusterReport,
    jobs: &[JobRow],
    names: &HashMap<i64, String>,
    now_ms: i64,
) -> ClusterStatus {
    let mut alive = Vec::new();
    let mut node_hours = 0.0;
    for row in jobs {
        for (element, seen) in row.seen.iter().enumerate() {
            let state = &row.state.elements[element];
            let since = seen
                .start_s
                .filter(|_| *state == Element::Running)
                .map(|start| (now_ms / 1000 - start).max(0) as f64);
            let hours = seen.elapsed_s.map(|s| s as f64).or(since).unwrap_or(0.0) / 3600.0;
            node_hours += hours * row.spec.nodes_charged;
            if seen.settled || row.over {
                continue;
            }
            let patients = row.spec.elements[element]
                .iter()
                .filter_map(|placed| names.get(&placed.patient_id).cloned());
            alive.push(JobStatus {
                id: if row.state.submission == Submission::Intended {
                    String::new()
                } else {
                    id_text(row, element)
                },
                name: row.name.clone(),
                state: row.state.shown(element),
                why: seen.why.clone(),
                patients: patients.collect(),
            });
        }
    }
    alive.extend(report.lingering.iter().filter_map(|one| {
        let why = if one.is_cancelled {
            "its driver has ended, but Slurm still shows it: it was cancelled"
        } else {
            "its driver has ended, but Slurm still shows it"
        };
        Some(JobStatus {
            id: one.id.clone()?,
            name: one.name.clone(),
            state: JobState::Stopping,
            why: why.to_owned(),
            patients: Vec::new(),
        })
    }));
    let as_of = report.answered_ms.map(clock::utc_text).unwrap_or_default();
    ClusterStatus {
        site: report.site.clone(),
        age_s: report
            .answered_ms
            .map_or(0.0, |at| (now_ms - at).max(0) as f64 / 1000.0),
        as_of,
        no_answer: report.no_answer.clone(),
        holds: report.holds.clone(),
        node_hours,
        node_hours_left: report.node_hours_left + alive_expected(jobs),
        charge: node_hours * report.charge_per_node_hour,
        charge_unit: report.charge_unit.clone(),
        expected_end: report
            .answered_ms
            .zip(report.finish_after_s)
            .map(|(at, s)| clock::utc_text(at + (s * 1000.0) as i64)),
        jobs: alive,
    }
}

/// A job that got a patient, for a person.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JobRecord {
    /// Scheduler's number, or the job's name while the number is unknown.
    pub id: String,
    /// Unique name, which is also the name of its folder below `slurm`.
    pub name: String,
    /// Folder with script, orders and logs.
    pub folder: std::path::PathBuf,
    /// State of the element.
    pub state: JobState,
    /// Why it waits, or how it ended.
    pub why: String,
    /// Nodes of the element in Slurm's notation.
    pub nodes: String,
    /// Elapsed time, s; `None` if it is unknown.
    pub elapsed_s: Option<u64>,
    /// Element of the array; `None` for a single job.
    pub element: Option<usize>,
}

/// Jobs that got a patient, oldest first.
#[must_use]
pub fn of_patient(jobs: &[JobRow], patient_id: i64, run_dir: &std::path::Path) -> Vec<JobRecord> {
    let mut records = Vec::new();
    for row in jobs {
        let is_here =
            |list: &Vec<Placed>| list.iter().any(|placed| placed.patient_id == patient_id);
        let Some(element) = row.spec.elements.iter().position(is_here) else {
            continue;
        };
        let seen = &row.seen[element];
        let why = match &row.state.elements[element] {
            Element::Over { ending } => ending.words.clone(),
            _ => seen.why.clone(),
        };
        records.push(JobRecord {
            id: id_text(row, element),
            name: row.name.clone(),
            folder: run_dir.join("slurm").join(&row.name),
            state: row.state.shown(element),
            why,
            nodes: seen.nodes.clone(),
            elapsed_s: seen.elapsed_s,
            element: row.spec.is_array.then_some(element),
        });
    }
    records
}

/// Expected node-hours of the elements whose ends were not dealt with.
fn alive_expected(jobs: &[JobRow]) -> f64 {
    let share = |row: &JobRow| {
        let open = row.seen.iter().filter(|seen| !seen.settled).count();
        if row.over {
            0.0
        } else {
            open as f64 / row.seen.len().max(1) as f64
        }
    };
    jobs.iter()
        .map(|row| row.spec.expected_node_hours * share(row))
        .sum()
}

pub(super) const INSERT: &str = "
INSERT INTO jobs (name, version, over, state, spec, seen, intended_ms)
SELECT value->>'name', value->>'version', value->>'over', value->'state', value->'spec', value->'seen', value->>'intended_ms'
FROM json_each(?1)";

pub(super) const UPDATE: &str = "
UPDATE jobs
SET version = jobs.version + 1, over = value->>'over', state = value->'state', seen = value->'seen'
FROM json_each(?1) AS new
WHERE jobs.name = (new.value->>'name') AND jobs.version = (new.value->>'version')";

pub(super) const PUT_ALLOTMENT: &str = "
INSERT INTO allotments (patient_id, allotment) SELECT value->>'patient_id', value->'allotment' FROM json_each(?1) WHERE true
ON CONFLICT (patient_id) DO UPDATE SET allotment = excluded.allotment";

pub(super) const PUT_META: &str = "
INSERT INTO meta (key, value) SELECT value->>'key', value->>'value' FROM json_each(?1) WHERE true
ON CONFLICT (key) DO UPDATE SET value = excluded.value WHERE value <> excluded.value";

pub(super) const SELECT_AT_WORK: &str = "SELECT name, version, state, spec, seen, intended_ms FROM jobs WHERE over = 0 ORDER BY intended_ms, name";

pub(super) const SELECT_ALL: &str =
    "SELECT name, version, state, spec, seen, intended_ms FROM jobs ORDER BY intended_ms, name";

pub(super) const SELECT_ALLOTMENTS: &str = "SELECT patient_id, allotment FROM allotments";
