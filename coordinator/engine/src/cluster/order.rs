//! What a job is submitted with: the orders for its drivers, and its script.

use std::path::Path;

use cardiotwin_schemas::allocation::{JobOrder, JobPatient, KnownTask, KnownTaskState};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::access::folder::JobFolder;
use cardiotwin_slurm::job::JobName;
use cardiotwin_slurm::script::{self, Array, Drivers, Job};
use cardiotwin_slurm::site::Site;
use cardiotwin_store::cluster_jobs::{JobRow, JobSpec};
use cardiotwin_workflow::derivation::Teaching;
use cardiotwin_workflow::task::Task;

use super::decide::State;
use super::expect::Expectations;
use crate::EngineError;
use crate::books::Books;

impl State {
    /// Orders for the driver of each element.
    pub(super) fn orders(&self, row: &JobRow, worker: &Path) -> Result<Vec<JobOrder>, EngineError> {
        let expected = Expectations::of(&self.books, &self.settings, &self.site, &self.mesh_sizes);
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
                    // The job was planned before the pilots were to teach again, and is not wanted
                    // any more.
                    Teaching::Awaited(_) => continue,
                };
                let plan = self.books.plan(i)?;
                for (kind, seconds) in expected.by_kind(plan, row.spec.threads) {
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
                worker: worker.to_owned(),
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
            Task::Open { generation, .. } => (*generation, KnownTaskState::Open),
            Task::Published { generation } => (*generation, KnownTaskState::Published),
            Task::Failed {
                generation,
                failure,
            } => (*generation, KnownTaskState::Failed(failure.clone())),
            // Another patient's driver works at it; this driver finds the attempt by its directory.
            Task::Attempting { generation, .. } => {
                (generation.saturating_sub(1), KnownTaskState::Open)
            }
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
