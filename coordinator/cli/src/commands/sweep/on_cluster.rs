//! Options of sweeps on a cluster: the site, its account, and whether the command waits.

use cardiotwin_engine::RunSummary;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};
use clap::Args;

use crate::talk::Talk;

/// Options of sweeps that run on a cluster.
#[derive(Debug, Clone, Args)]
pub struct OnCluster {
    /// Run as jobs on a cluster with this site profile: archer2, generic, or a file
    /// (executor.slurm.site)
    #[arg(long, value_name = "SITE")]
    slurm: Option<String>,
    /// Account that the jobs are charged to (executor.slurm.account)
    #[arg(long, value_name = "NAME", requires = "slurm")]
    account: Option<String>,
    /// On a cluster, keep advancing until all jobs are finished, instead of one tick per call of
    /// the command
    #[arg(long)]
    pub watch: bool,
}

impl OnCluster {
    /// Applies the options to the executor's settings.
    pub fn apply(&self, executor: &mut ExecutorSettings) {
        if let Some(site) = &self.slurm {
            executor.kind = ExecutorKind::Slurm;
            site.clone_into(&mut executor.slurm.site);
            executor.slurm.account.clone_from(&self.account);
        }
    }
}

/// Prints how many members are over, and that jobs still wait or run.
pub fn tell(summary: &RunSummary, members: &str, talk: &Talk) {
    talk.say(&format!(
        "{} of {} {members} finished, {} jobs pending or running; the same command continues",
        summary.done + summary.failed + summary.cancelled,
        summary.patients,
        summary.jobs,
    ));
}
