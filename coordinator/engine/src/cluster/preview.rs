//! Shows what a tick would submit, before anything is submitted: jobs, node-hours, expected end and
//! the exact scripts.

use std::path::Path;

use cardiotwin_schemas::settings::SlurmSettings;
use cardiotwin_slurm::access::folder::JobFolder;
use cardiotwin_slurm::access::{Installed, Scheduler};
use cardiotwin_slurm::answers::queue;
use cardiotwin_slurm::commands;
use cardiotwin_slurm::plan::finish;
use cardiotwin_slurm::site::{Queue, Site};
use cardiotwin_store::Writer;
use cardiotwin_store::clock;
use serde::Serialize;

use super::budget::Budget;
use super::disk_need::DiskNeed;
use super::expect::Expectations;
use super::order::script_of;
use super::place::{PlannedJob, in_use, plan_jobs};
use super::profile::{discover_now, load_site};
use super::waiting::waiting;
use crate::books::Books;
use crate::foresee::decide_unwritten;
use crate::mesh_size::MeshSizes;
use crate::{EngineError, RunOptions};

/// Jobs and costs that a tick would cause.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedRun {
    /// Name of the site.
    pub site: String,
    /// Limits that the site reported beyond its profile, and queries that failed.
    pub remarks: Vec<String>,
    /// Jobs, those of this wave first.
    pub jobs: Vec<PlannedRow>,
    /// Number of selected patients that are over or already in jobs.
    pub others: usize,
    /// Expected node-hours of all jobs.
    pub node_hours: f64,
    /// Charge for these node-hours, in `charge_unit`.
    pub charge: f64,
    /// Unit of `charge`, from the site's profile.
    pub charge_unit: String,
    /// Time from the start of the first job to the end of the last, s, if the queue granted at once
    /// all that its limits allow.
    pub finish_after_s: f64,
    /// Disk space that the attempts of all unfinished patients will take.
    pub disk: DiskNeed,
}

/// A job that would be submitted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedRow {
    /// Name of the queue in the profile.
    pub queue: String,
    /// Number of elements of the array; 1 for a single job.
    pub elements: usize,
    /// Largest number of elements at once, if the array is throttled.
    pub at_once: Option<u32>,
    /// Nodes of each element.
    pub nodes: u32,
    /// Cores of each element on a queue that gives single cores.
    pub cores: u32,
    /// Walltime that the job would request \[s\].
    pub walltime_s: u64,
    /// Expected working time of each element, s.
    pub predicted_s: f64,
    /// Expected node-hours of all elements.
    pub node_hours: f64,
    /// Number of patients in all elements.
    pub patients: usize,
    /// Whether it would be submitted now. Other jobs follow once earlier ones have ended.
    pub now: bool,
    /// The batch script, with a provisional name: the real one is made at submission.
    pub script: String,
}

/// What the plan assumes of a machine of which no site tells anything.
fn assumed(settings: &SlurmSettings, site: &Site) -> Option<String> {
    (settings.site == SlurmSettings::default().site).then(|| {
        format!(
            "site {} is an assumption: a Slurm with {} cores and {} MiB of memory a node; name your \
             site by executor.slurm.site",
            site.name, site.node.cores, site.node.memory_mib
        )
    })
}

/// Plans as a tick would, without submitting anything.
///
/// # Errors
/// [`EngineError`] if the profile, the store or a plan cannot be read, or a patient fits into no
/// job.
pub async fn preview(options: &RunOptions, program: &Path) -> Result<PlannedRun, EngineError> {
    let run_dir = std::path::absolute(&options.run_dir).unwrap_or_else(|_| options.run_dir.clone());
    let mut site = load_site(&options.executor.slurm)?;
    let mut books = Books::new(&run_dir, Writer::look(&run_dir).await?, clock::now_ms())?;
    decide_unwritten(&mut books, options.patients.as_deref())?;
    let mut scheduler = Installed::default();
    let mut remarks = discover_now(&mut site, &mut scheduler).await;
    remarks.extend(assumed(&options.executor.slurm, &site));
    let rows = match queue::read(&scheduler.ask(&commands::queue()).await) {
        Ok(table) => table.rows,
        Err(error) => {
            remarks.push(format!("the plan assumes an empty queue: {error}"));
            Vec::new()
        }
    };
    let patients = waiting(&books);
    let open: Vec<usize> = (0..books.patients().len())
        .filter(|i| books.patient(*i).selected && !books.patient(*i).row.state.is_final())
        .collect();
    let mut mesh_sizes = MeshSizes::default();
    for &i in &patients {
        mesh_sizes.learn(books.plan(i)?);
    }
    let expected = Expectations::of(&books, &options.executor, &site, &mesh_sizes);
    let used = |queue: &Queue| in_use(queue, &rows, 0);
    let jobs = plan_jobs(
        &books,
        &patients,
        &site,
        &options.executor,
        &expected,
        &used,
    )?;
    let mut planned = Vec::with_capacity(jobs.len());
    for (n, job) in jobs.iter().enumerate() {
        let name = format!("ct-plan-{}", n + 1);
        let folder = JobFolder::of(&run_dir, &name);
        let script = script_of(&job.spec, &name, &folder, &site, &options.executor, program)
            .map_err(|error| EngineError::Site {
                message: error.to_string(),
            })?;
        planned.push(row_of(job, script));
    }
    let budget = Budget::of(&options.executor, books.jobs().rows().values());
    remarks.extend(budget.remark(&jobs.iter().map(|job| &job.spec).collect::<Vec<_>>()));
    planned.sort_by_key(|job| !job.now);
    // The sum of nothing is -0.
    let node_hours = planned.iter().map(|job| job.node_hours).sum::<f64>() + 0.0;
    let finish_after_s = match jobs
        .first()
        .and_then(|job| site.queue.iter().find(|queue| queue.name == job.spec.queue))
    {
        Some(queue) => {
            let each =
                |job: &PlannedJob| vec![(job.spec.n_nodes, job.predicted_s); job.patients.len()];
            finish(
                &jobs.iter().flat_map(each).collect::<Vec<_>>(),
                queue,
                used(queue),
            )
            .after_s
        }
        None => 0.0,
    };
    Ok(PlannedRun {
        remarks,
        others: books.patients().iter().filter(|p| p.selected).count() - patients.len(),
        node_hours,
        charge: node_hours * site.charge_per_node_hour,
        charge_unit: site.charge_unit.clone(),
        finish_after_s,
        disk: DiskNeed::of(&books, open.into_iter())?,
        jobs: planned,
        site: site.name,
    })
}

fn row_of(job: &PlannedJob, script: String) -> PlannedRow {
    PlannedRow {
        queue: job.spec.queue.clone(),
        elements: job.spec.elements.len(),
        at_once: job.spec.at_once,
        nodes: job.spec.n_nodes,
        cores: job.spec.n_cores,
        walltime_s: job.spec.walltime_s,
        predicted_s: job.predicted_s,
        node_hours: job.spec.expected_node_hours,
        patients: job.patients.iter().map(Vec::len).sum(),
        now: job.now,
        script,
    }
}
