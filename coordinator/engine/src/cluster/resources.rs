//! Threads or MPI ranks of a patient's simulations, and whether a queue has room for them.

use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::{ExecutorSettings, Fidelity};
use cardiotwin_slurm::site::{Queue, Site, Use};

use crate::cores::{self, ClusterNodes};
use crate::mesh_size;

/// Share of a cluster that each simulation of a patient takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ResourceRequest {
    pub in_3d: bool,
    /// Threads or MPI ranks.
    pub threads: u32,
    /// Largest number of MPI ranks on a node, if simulations run on ranks.
    pub ranks_per_node: Option<u32>,
}

impl ResourceRequest {
    /// - `mesh_nodes`: number of nodes of the patient's mesh
    /// - `ranks_per_node`: largest number of ranks on a node after earlier simulations ran out of
    ///   memory, in place of the setting
    pub(super) fn of(
        plan: &ResolvedPatient,
        mesh_nodes: u32,
        site: &Site,
        settings: &ExecutorSettings,
        ranks_per_node: Option<u32>,
    ) -> Self {
        let in_3d = plan.workflow == Workflow::Personalise
            && plan.settings.solver.fidelity != Fidelity::Reduced;
        let set = Some(settings.ranks_per_node).filter(|n| *n > 0);
        let ranks_per_node = ranks_per_node
            .or(set)
            .unwrap_or(u32::MAX)
            .min(site.node.cores);
        let of_ranks = site.queue(settings.slurm.queue.as_deref(), Use::Simulations);
        let nodes = ClusterNodes {
            cores: match settings.launcher[..] {
                [] => site.node.cores,
                _ => ranks_per_node,
            },
            most: of_ranks.and_then(most_nodes).unwrap_or(1),
        };
        let threads = cores::threads_in_job(settings, &plan.settings.solver, mesh_nodes, nodes);
        let has_ranks = in_3d && threads > 1 && !settings.launcher.is_empty();
        Self {
            in_3d,
            threads,
            ranks_per_node: has_ranks.then_some(ranks_per_node),
        }
    }

    /// Use of a queue that takes the simulations.
    fn used_for(self) -> Use {
        if self.in_3d {
            Use::Simulations
        } else {
            Use::Chunks
        }
    }

    /// Number of nodes of a simulation.
    pub(super) fn nodes(self) -> u32 {
        let ranks_per_node = self.ranks_per_node.unwrap_or(u32::MAX);
        self.threads.div_ceil(ranks_per_node.max(1)).max(1)
    }

    /// The queue for the simulations, followed by those of `fallback_queues` that can take them.
    ///
    /// # Errors
    /// As [`Self::queue`].
    pub(super) fn queues<'a>(
        self,
        site: &'a Site,
        settings: &ExecutorSettings,
    ) -> Result<Vec<&'a Queue>, NoQueue> {
        let mut queues = vec![self.queue(site, settings)?];
        for name in &settings.slurm.fallback_queues {
            let fallback = site.queue(Some(name), self.used_for());
            let fallback = fallback.filter(|queue| {
                queue.uses.contains(&self.used_for())
                    && self.nodes() <= most_of_job(queue)
                    && queues.iter().all(|known| known.name != queue.name)
            });
            queues.extend(fallback);
        }
        Ok(queues)
    }

    /// The queue for the simulations.
    ///
    /// # Errors
    /// What was found and what the site gives, if no queue takes such work or the queue is too small.
    pub(super) fn queue<'a>(
        self,
        site: &'a Site,
        settings: &ExecutorSettings,
    ) -> Result<&'a Queue, NoQueue> {
        let used_for = self.used_for();
        let name = &site.name;
        let queue = site
            .queue(settings.slurm.queue.as_deref(), used_for)
            .ok_or_else(|| NoQueue {
                key: "executor.slurm.queue",
                found: format!("site {name} has no queue for {used_for:?}"),
                expected: format!("a queue whose `uses` contain {used_for:?}"),
                remedy: "add it to the `uses` of a queue in the site's profile",
            })?;
        let (threads, cores) = (self.threads, site.node.cores);
        if self.ranks_per_node.is_none() && threads > cores {
            return Err(NoQueue {
                key: "executor.threads",
                found: format!("{threads} threads on a node"),
                expected: format!("at most {cores} threads, the cores of a node of site {name}"),
                remedy: "set fewer, or executor.launcher for MPI ranks on several nodes",
            });
        }
        let most = most_of_job(queue);
        if self.nodes() > most {
            let on_each = self.ranks_per_node.unwrap_or(cores);
            return Err(NoQueue {
                key: "executor.threads",
                found: format!(
                    "{threads} ranks on {} nodes, {on_each} on each",
                    self.nodes()
                ),
                expected: format!(
                    "at most {most} nodes, which queue {} of site {name} gives to a job",
                    queue.name
                ),
                remedy: "set fewer ranks (executor.threads), more on a node \
                         (executor.ranks_per_node), or another queue (executor.slurm.queue)",
            });
        }
        Ok(queue)
    }
}

/// Reason why no queue takes a simulation.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{found}, expected {expected}: {remedy}")]
pub struct NoQueue {
    /// Setting that asks for more than a queue gives.
    pub key: &'static str,
    /// Demand of the simulation.
    pub found: String,
    /// Demand that the site meets.
    pub expected: String,
    /// Change that helps.
    pub remedy: &'static str,
}

fn most_nodes(queue: &Queue) -> Option<u32> {
    queue.max_nodes_per_job.or(queue.nodes)
}

/// Largest number of nodes that a queue gives to a job; any number where its profile names none.
fn most_of_job(queue: &Queue) -> u32 {
    most_nodes(queue).unwrap_or(u32::MAX)
}

/// The first reason why a patient's simulations fit into no queue of the site; `None` if all fit.
#[must_use]
pub fn without_queue<'a>(
    plans: impl IntoIterator<Item = &'a ResolvedPatient>,
    site: &Site,
    settings: &ExecutorSettings,
) -> Option<NoQueue> {
    plans.into_iter().find_map(|plan| {
        let share = ResourceRequest::of(plan, mesh_size::nodes(plan), site, settings, None);
        share.queue(site, settings).err()
    })
}
