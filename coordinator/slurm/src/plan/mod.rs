//! Packing: which jobs a cohort becomes, what they cost, and when they are expected to end.
//!
//! A pure function of the work, the queue's limits and what the user already has in it. Every task is in exactly one
//! job; no limit is passed by the jobs of one wave. What does not fit into this wave is planned for later ones, once
//! jobs have ended.

mod bundles;
mod chunks;
mod schedule;

pub use bundles::{Bundle, Lane, Simulation, bundles};
pub use chunks::{ChunkArray, Chunks, Sweep, chunks};
pub use schedule::{Finish, finish};

use crate::site::{Node, Queue, Site, Unit};

/// What of a user is in the queue already, ours or not: limits count it all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct InUse {
    /// Jobs queued or running.
    pub queued: u32,
    /// Jobs running.
    pub running: u32,
    /// Nodes of running jobs.
    pub nodes: u32,
    /// Cores of running jobs.
    pub cores: u32,
}

/// Choices that are not the site's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choices {
    /// Walltime over prediction, at least 1.
    pub safety: f64,
    /// Start and end of a job beyond its work, s: modules, MPI, the warning before the walltime.
    pub overhead_s: u64,
    /// How long a job should take at least, if there is work enough: short jobs wait more than they run, s.
    pub good_length_s: u64,
    /// Nodes of a bundle, at most; the queue's limit where absent.
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

/// Why nothing can be planned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A task that no job of this queue can hold.
    #[error("{task} {needs}, queue '{queue}' gives {limit}")]
    DoesNotFit {
        /// Which task.
        task: String,
        /// What it needs.
        needs: String,
        /// Which queue.
        queue: String,
        /// What there is.
        limit: String,
    },
    /// A number that cannot be.
    #[error("{what} is {found}, expected {expected}")]
    Value {
        /// Which.
        what: &'static str,
        /// What it is.
        found: f64,
        /// What it should be.
        expected: &'static str,
    },
}

/// What of a queue is left for one wave of jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Room {
    /// More jobs that may be queued.
    jobs: u32,
    /// More jobs that may run.
    running: u32,
    /// More nodes of running jobs.
    nodes: u32,
    /// More cores of running jobs.
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

/// Walltime of a job with so much work on its fullest place, s; whole minutes, and what the queue allows.
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

/// A time that work takes.
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

/// Nodes that so many cores take.
fn nodes_for(cores: u32, node: Node) -> u32 {
    cores.div_ceil(node.cores).max(1)
}

#[cfg(test)]
mod tests;
