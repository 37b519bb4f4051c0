//! Node-hours that a run may take.

use std::fmt;

use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_store::cluster_jobs::{JobRow, JobSpec, committed_node_hours};

/// Node-hours that the run's jobs have taken or asked for, and their limit.
#[derive(Debug, Clone, Copy)]
pub struct Budget {
    limit_node_hours: Option<f64>,
    committed_node_hours: f64,
}

impl Budget {
    /// The budget after the run's jobs so far.
    pub fn of<'a>(settings: &ExecutorSettings, jobs: impl Iterator<Item = &'a JobRow>) -> Self {
        let limit = settings.slurm.max_node_hours;
        Self {
            limit_node_hours: (limit > 0.0).then_some(limit),
            committed_node_hours: committed_node_hours(jobs),
        }
    }

    /// Whether another job is within the limit. If so, it counts from now on.
    pub fn takes(&mut self, job: &JobSpec) -> bool {
        let with_job = self.committed_node_hours + job.asked_node_hours();
        let is_within = self.limit_node_hours.is_none_or(|limit| with_job <= limit);
        if is_within {
            self.committed_node_hours = with_job;
        }
        is_within
    }

    /// Why patients wait whose jobs the limit excludes.
    pub fn holds(&self, n_patients: usize) -> String {
        format!("{n_patients} patients wait: their jobs would exceed {self}; raise it to continue")
    }

    /// Remark of a plan whose jobs exceed the limit.
    pub fn remark(mut self, jobs: &[&JobSpec]) -> Option<String> {
        let beyond = jobs.iter().filter(|job| !self.takes(job)).count();
        (beyond > 0).then(|| {
            format!(
                "{beyond} of {} jobs exceed {self}: they are not submitted before it is raised",
                jobs.len(),
            )
        })
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let limit = self.limit_node_hours.unwrap_or_default();
        write!(
            f,
            "executor.slurm.max_node_hours ({limit}), of which {:.2} are spent or asked for",
            self.committed_node_hours
        )
    }
}
