//! Tables `jobs` (submissions to a cluster) and `allotments` (what a patient's next job is given).

use std::collections::HashMap;

use cardiotwin_schemas::status::{ClusterStatus, JobStatus};
use cardiotwin_workflow::cluster_job::{ClusterJob, Element, Submission};
use serde::{Deserialize, Serialize};

use crate::clock;

/// A row of `jobs`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JobRow {
    /// Unique name.
    pub name: String,
    /// Guards updates.
    pub version: i64,
    /// Whether nothing of it can live any more, and everything that it left was taken up.
    pub over: bool,
    /// Where it stands.
    pub state: ClusterJob,
    /// What was asked for.
    pub spec: JobSpec,
    /// What the scheduler said last of each element.
    pub seen: Vec<SeenElement>,
    /// Milliseconds since 1970.
    pub intended_ms: i64,
}

/// What was asked for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct JobSpec {
    /// Queue of the site's profile.
    pub queue: String,
    /// QoS, where one was named.
    pub qos: Option<String>,
    /// Whether it is an array.
    pub is_array: bool,
    /// Elements at once.
    pub at_once: Option<u32>,
    /// Nodes of each element.
    pub n_nodes: u32,
    /// Cores of each, where single ones are given.
    pub n_cores: u32,
    /// Memory of each, MiB, where single cores are given.
    pub memory_mib: Option<u64>,
    /// Simulations at once on each node.
    pub lanes: u32,
    /// Threads of each.
    pub threads: u32,
    /// Walltime, s.
    pub walltime_s: u64,
    /// Expected node-hours of all elements.
    pub expected_node_hours: f64,
    /// Nodes, or parts of one, that an hour of an element is charged.
    pub nodes_charged: f64,
    /// Nodes to avoid.
    pub exclude: Vec<String>,
    /// Patients of each element.
    pub elements: Vec<Vec<Placed>>,
}

/// A patient in a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Placed {
    /// Whose.
    pub patient_id: i64,
    /// Tasks of the chain that were settled when it was submitted: more at the end is progress.
    pub settled: usize,
    /// Which plan of the patient's it was given ([`Allotment::plans`]): another one makes the job's work stale.
    pub plan: u64,
}

/// What the scheduler said last of an element.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct SeenElement {
    /// In words: what it waits for.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
    /// When it started, or is expected to, seconds since 1970.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_s: Option<i64>,
    /// How long it ran, s, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elapsed_s: Option<u64>,
    /// Its nodes.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub nodes: String,
    /// Whether its end was taken up for its patients.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub settled: bool,
}

/// What a patient's next job is given, and what its earlier ones cost.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Allotment {
    /// How often the plan changed to one that leads to other tasks.
    pub plans: u64,
    /// Repeats that were charged to the site.
    pub infrastructure: u32,
    /// Repeats that were charged to nothing.
    pub free: u32,
    /// Memory of its worker, MiB, where not as the settings say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_mib: Option<u64>,
    /// Simulations at once on its node, where fewer than fit by their cores.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lanes: Option<u32>,
    /// Nodes to avoid.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<String>,
    /// For a person: why it is tried again.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
}

/// A row of `allotments`.
#[derive(Debug, Serialize)]
pub struct AllotmentRow<'a> {
    /// Whose.
    pub patient_id: i64,
    /// What.
    pub allotment: &'a Allotment,
}

/// What a run knows of its cluster beyond jobs: kept beside the cohort's name, shown by `status`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ClusterReport {
    /// The site.
    pub site: String,
    /// When the queue answered last, milliseconds since 1970.
    pub answered_ms: Option<i64>,
    /// Why the last question had no answer.
    pub no_answer: Option<String>,
    /// Commands in a row that had none.
    pub silent: u32,
    /// Before this time nothing is asked, milliseconds since 1970.
    pub asks_again_ms: i64,
    /// Why nothing is submitted at present.
    pub holds: Option<String>,
    /// What a node-hour is charged, and in what.
    pub charge_per_node_hour: f64,
    /// As above.
    pub charge_unit: String,
    /// Node-hours that are expected to be needed for what waits.
    pub node_hours_left: f64,
    /// Seconds until the last job is expected to end, from `answered_ms` on.
    pub finish_after_s: Option<f64>,
    /// Commands that the last tick asked.
    pub commands: u32,
}

/// Key of [`ClusterReport`] among the single values.
pub const REPORT: &str = "cluster";

/// The scheduler's number of an element, or the job's name while there is none.
#[must_use]
pub fn id_text(row: &JobRow, element: usize) -> String {
    match row.state.submission {
        Submission::Accepted { job: Some(job) } if row.spec.is_array => format!("{job}_{element}"),
        Submission::Accepted { job: Some(job) } => job.to_string(),
        _ if row.spec.is_array => format!("{}_{element}", row.name),
        _ => row.name.clone(),
    }
}

/// What `status` shows of the cluster.
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
                state: row.state.word(element).to_owned(),
                why: seen.why.clone(),
                patients: patients.collect(),
            });
        }
    }
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

/// A job that a patient was in, for a person.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JobRecord {
    /// The scheduler's number, or the name while there is none.
    pub id: String,
    /// Unique name, also its folder's below `slurm`.
    pub name: String,
    /// Its folder: script, orders, logs.
    pub folder: std::path::PathBuf,
    /// `waiting`, `running`, …, `over`.
    pub state: String,
    /// What it waits for, or how it ended.
    pub why: String,
    /// Nodes that it had.
    pub nodes: String,
    /// How long it ran, s, where that is known.
    pub elapsed_s: Option<u64>,
    /// Element of the array, where it is one.
    pub element: Option<usize>,
}

/// Jobs that a patient was in, oldest first.
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
            state: row.state.word(element).to_owned(),
            why,
            nodes: seen.nodes.clone(),
            elapsed_s: seen.elapsed_s,
            element: row.spec.is_array.then_some(element),
        });
    }
    records
}

/// Expected node-hours of elements that are not over.
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
