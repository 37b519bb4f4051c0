//! Packing of a cohort into jobs, with their cost and expected end.
//!
//! The plan is a pure function of the work, the queue's limits and the user's present jobs. Every
//! task is in exactly one job, and the jobs of one wave exceed no limit. Work that does not fit
//! into this wave is planned for later ones, once jobs have ended.

mod bundles;
mod chunks;
mod ranks;
mod schedule;

pub use bundles::{Bundle, Lane, Simulation, bundles};
pub use chunks::{ChunkArray, Chunks, Sweep, chunks};
pub use ranks::{beat_s, ranks_for};
pub use schedule::{Finish, finish};

use crate::site::{Node, Queue, Site, Unit};

/// The user's present jobs in the queue, from this run or not, because limits count them all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct InUse {
    /// Number of jobs that are queued or running.
    pub queued: u32,
    /// Number of running jobs.
    pub running: u32,
    /// Number of nodes of running jobs.
    pub nodes: u32,
    /// Number of cores of running jobs.
    pub cores: u32,
}

/// Choices of the packing that do not come from the site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choices {
    /// Ratio of walltime to predicted duration, at least 1.
    pub safety: f64,
    /// Time of a job beyond its work, s: modules, MPI, the warning before the walltime.
    pub overhead_s: u64,
    /// Least duration of a job if there is enough work, s: short jobs wait more than they run.
    pub good_length_s: u64,
    /// Largest number of nodes of a bundle; `None` means the queue's limit.
    pub bundle_nodes: Option<u32>,
}

impl Default for Choices {
    fn default() -> Self {
        Self {
            safety: 1.3,
            overhead_s: 300,
            good_length_s: 3600,
            bundle_nodes: None,
        }
    }
}

/// Reason why the work cannot be packed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A task fits into no job of this queue.
    #[error("{task} {needs}, but queue '{queue}' allows {limit}")]
    DoesNotFit {
        /// Identifier or description of the task.
        task: String,
        /// Demand of the task.
        needs: String,
        /// Name of the queue.
        queue: String,
        /// Limit of the queue.
        limit: String,
    },
    /// A number is out of its range.
    #[error("{what} is {found}, expected {expected}")]
    Value {
        /// Name of the number.
        what: &'static str,
        /// Number that was given.
        found: f64,
        /// Range of admissible numbers, in words.
        expected: &'static str,
    },
}

/// Room in a queue for one wave of jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Room {
    /// Number of further jobs that may be queued.
    jobs: u32,
    /// Number of further jobs that may run.
    running: u32,
    /// Number of further nodes for running jobs.
    nodes: u32,
    /// Number of further cores for running jobs.
    cores: u32,
}

fn room(queue: &Queue, in_use: InUse) -> Room {
    let left = |limit: Option<u32>, used: u32| limit.unwrap_or(u32::MAX).saturating_sub(used);
    Room {
        jobs: left(queue.max_queued, in_use.queued),
        running: left(queue.max_running, in_use.running),
        nodes: left(queue.max_nodes_per_user, in_use.nodes).min(queue.nodes.unwrap_or(u32::MAX)),
        cores: left(queue.max_cores_per_user, in_use.cores),
    }
}

fn unit(site: &Site, queue: &Queue) -> Unit {
    queue.unit.unwrap_or(site.node.unit)
}

/// Longest work that fits into a job, s.
fn longest_work_s(queue: &Queue, choices: &Choices) -> f64 {
    queue.walltime_s().saturating_sub(choices.overhead_s) as f64 / choices.safety
}

/// Walltime of a job whose fullest place has work for `work_s`, s: whole minutes, within the
/// queue's limits.
fn walltime_s(work_s: f64, queue: &Queue, choices: &Choices) -> u64 {
    let wanted = (work_s * choices.safety).ceil() as u64 + choices.overhead_s;
    (wanted.div_ceil(60).max(1) * 60).clamp(
        queue.least_walltime_s(),
        queue.walltime_s().max(queue.least_walltime_s()),
    )
}

fn check(choices: &Choices) -> Result<(), PlanError> {
    if choices.safety.is_finite() && choices.safety >= 1.0 {
        return Ok(());
    }
    Err(PlanError::Value {
        what: "safety",
        found: choices.safety,
        expected: "a factor of at least 1",
    })
}

fn check_time(what: &'static str, seconds: f64) -> Result<(), PlanError> {
    if seconds.is_finite() && seconds > 0.0 {
        return Ok(());
    }
    Err(PlanError::Value {
        what,
        found: seconds,
        expected: "a time above 0 s",
    })
}

/// Number of nodes for this number of cores.
fn nodes_for(cores: u32, node: Node) -> u32 {
    cores.div_ceil(node.cores).max(1)
}

#[cfg(test)]
mod tests;
