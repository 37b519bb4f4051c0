//! Consequences of the failure of a job.
//!
//! Repeats are charged to one of two budgets: `infrastructure` for failures of the site's making,
//! and `free` for failed nodes and daemons, preemptions and used walltimes with progress. The second one is a
//! generous bound that keeps a broken partition from being fed for ever.

use cardiotwin_vocabulary::failure_cause::FailureCause;

/// Number of repeats that are allowed, by kind of reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budgets {
    /// Repeats charged to the site: memory, unexplained ends, and used walltimes without progress.
    pub infrastructure: u32,
    /// Repeats that are free: failed nodes and daemons, preemptions, and used walltimes with
    /// progress.
    pub free: u32,
}

/// Number of repeats so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RetriesUsed {
    /// Repeats charged to [`Budgets::infrastructure`].
    pub infrastructure: u32,
    /// Repeats charged to [`Budgets::free`].
    pub free: u32,
}

/// Resources of a job, as far as the next one may get others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Resources {
    /// Processes that share a node, and its memory.
    pub sharing: NodeSharing,
    /// Memory of a node, MiB.
    pub memory_per_node_mib: u64,
    /// Nodes to avoid, in Slurm's compressed notation.
    pub excluded: Vec<String>,
}

/// How processes that simulate share a node: ranks of MPI, or one process for each simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeSharing {
    /// Number of processes on each node.
    pub processes_per_node: u32,
    /// Memory of each process, MiB.
    pub memory_per_process_mib: u64,
}

/// Consequence of an ending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RetryDecision {
    /// Another job is submitted.
    Retry {
        /// Sharing of a node that gives each process more memory; `None` if it stays as it is.
        more_memory: Option<NodeSharing>,
        /// Nodes to avoid, in Slurm's compressed notation.
        excluded: Vec<String>,
        /// Repeats spent, the new one included.
        spent: RetriesUsed,
        /// Reason, for a person.
        why: String,
    },
    /// The failure stays until a person acts.
    Stays {
        /// Reason and advice, for a person.
        why: String,
    },
}

/// Decides on the consequence of an ending.
///
/// - `failed`: nodes that failed, as far as they are known, in Slurm's notation
/// - `progressed`: whether the job's patient got further than before
#[must_use]
pub fn decide_retry(
    cause: FailureCause,
    failed: &str,
    progressed: bool,
    resources: &Resources,
    spent: RetriesUsed,
    budgets: Budgets,
) -> RetryDecision {
    let stays = |why: &str| RetryDecision::Stays {
        why: why.to_owned(),
    };
    let retry = |more_memory, excluded, budget, why: String| match budgets.charge(spent, budget) {
        Ok(spent) => RetryDecision::Retry {
            more_memory,
            excluded,
            spent,
            why,
        },
        Err(used_up) => RetryDecision::Stays {
            why: format!("{why}; {used_up}"),
        },
    };
    let same =
        |budget: Budget, why: &str| retry(None, resources.excluded.clone(), budget, why.to_owned());
    match cause {
        FailureCause::Walltime if progressed => same(
            Budget::Free,
            "its walltime was used up: a new job continues",
        ),
        FailureCause::Walltime => same(
            Budget::Infrastructure,
            "its walltime was used up without progress",
        ),
        FailureCause::OutOfMemory => match more_memory(resources) {
            Some((sharing, how)) => retry(
                Some(sharing),
                resources.excluded.clone(),
                Budget::Infrastructure,
                format!("out of memory: {how}"),
            ),
            None => stays(
                "out of memory with one rank on a whole node: use more nodes or a coarser mesh",
            ),
        },
        FailureCause::NodeFailure if failed.is_empty() => same(
            Budget::Free,
            "node failure: Slurm gives no job to a node that is down",
        ),
        FailureCause::NodeFailure => {
            let mut excluded = resources.excluded.clone();
            if !excluded.iter().any(|nodes| nodes == failed) {
                excluded.push(failed.to_owned());
            }
            let why = format!("node failure on {failed}: excluded from now on");
            retry(None, excluded, Budget::Free, why)
        }
        FailureCause::Preemption => same(Budget::Free, "preempted"),
        FailureCause::Cancelled => stays("cancelled by a person: not repeated until requested"),
        FailureCause::Refused => stays("the data or settings are wrong: correct them"),
        FailureCause::Defect => stays("a defect of the program: see its log, and report it"),
        FailureCause::Lost => same(Budget::Free, "Slurm itself ended or lost it"),
        FailureCause::Unexplained => same(Budget::Infrastructure, "ended without an explanation"),
    }
}

/// Budget to which a repeat is charged.
#[derive(Debug, Clone, Copy)]
enum Budget {
    Infrastructure,
    Free,
}

impl Budgets {
    /// Charges a repeat. The error says that the budget is used up.
    fn charge(self, mut spent: RetriesUsed, budget: Budget) -> Result<RetriesUsed, String> {
        match budget {
            Budget::Infrastructure => spent.infrastructure += 1,
            Budget::Free => spent.free += 1,
        }
        if spent.infrastructure > self.infrastructure {
            return Err(format!(
                "its {} repeats after failures of the site are used up",
                self.infrastructure
            ));
        }
        if spent.free > self.free {
            return Err(format!(
                "not repeated again after {} repeats without a charge: check the site",
                self.free
            ));
        }
        Ok(spent)
    }
}

/// Halves the number of processes on a node. With a single process, doubles its memory up to the
/// node's. `None` if it had all of it.
fn more_memory(resources: &Resources) -> Option<(NodeSharing, String)> {
    let NodeSharing {
        processes_per_node: n,
        memory_per_process_mib: memory_mib,
    } = resources.sharing;
    if n > 1 {
        let sharing = NodeSharing {
            processes_per_node: n / 2,
            memory_per_process_mib: resources.memory_per_node_mib / u64::from(n / 2),
        };
        return Some((sharing, format!("{} ranks on a node instead of {n}", n / 2)));
    }
    let doubled = memory_mib
        .saturating_mul(2)
        .min(resources.memory_per_node_mib);
    let sharing = NodeSharing {
        processes_per_node: n,
        memory_per_process_mib: doubled,
    };
    let how = format!("{doubled} MiB instead of {memory_mib}");
    (doubled > memory_mib).then_some((sharing, how))
}

#[cfg(test)]
mod tests {
    use super::{
        Budgets, FailureCause, NodeSharing, Resources, RetriesUsed, RetryDecision, decide_retry,
    };
    use proptest::prelude::*;

    const BUDGETS: Budgets = Budgets {
        infrastructure: 2,
        free: 5,
    };

    fn resources() -> Resources {
        Resources {
            sharing: NodeSharing {
                processes_per_node: 128,
                memory_per_process_mib: 2000,
            },
            memory_per_node_mib: 256_000,
            excluded: Vec::new(),
        }
    }

    #[test]
    fn a_failed_node_that_is_not_named_is_not_avoided() {
        let unnamed = decide_retry(
            FailureCause::NodeFailure,
            "",
            true,
            &resources(),
            RetriesUsed::default(),
            BUDGETS,
        );
        assert!(
            matches!(&unnamed, RetryDecision::Retry { more_memory: None, excluded, .. } if excluded.is_empty()),
            "{unnamed:?}"
        );
    }

    #[test]
    fn what_follows_from_each_class() {
        let mut table = String::new();
        for class in [
            FailureCause::Walltime,
            FailureCause::OutOfMemory,
            FailureCause::NodeFailure,
            FailureCause::Preemption,
            FailureCause::Cancelled,
            FailureCause::Refused,
            FailureCause::Defect,
            FailureCause::Lost,
            FailureCause::Unexplained,
        ] {
            table += &format!(
                "{class:?}: {:?}\n",
                decide_retry(
                    class,
                    "n4",
                    true,
                    &resources(),
                    RetriesUsed::default(),
                    BUDGETS
                )
            );
        }
        insta::assert_snapshot!(table);
    }

    proptest! {
        /// Every series of failures ends, and the given resources stay within a node.
        #[test]
        fn every_series_of_failures_ends(classes in proptest::collection::vec(0_usize..5, 40), progress in any::<u64>()) {
            let all = [FailureCause::Walltime, FailureCause::OutOfMemory, FailureCause::NodeFailure, FailureCause::Preemption, FailureCause::Unexplained];
            let (mut spent, mut resources, mut n) = (RetriesUsed::default(), resources(), 0);
            for (i, class) in classes.into_iter().enumerate() {
                match decide_retry(all[class], "n1", progress >> i & 1 == 1, &resources, spent, BUDGETS) {
                    RetryDecision::Retry { more_memory, excluded, spent: now, .. } => {
                        prop_assert!(now.infrastructure + now.free == spent.infrastructure + spent.free + 1);
                        resources.sharing = more_memory.unwrap_or(resources.sharing);
                        let NodeSharing { processes_per_node, memory_per_process_mib } = resources.sharing;
                        prop_assert!(u64::from(processes_per_node) * memory_per_process_mib <= resources.memory_per_node_mib);
                        prop_assert!(processes_per_node >= 1 && excluded.len() <= 1);
                        resources.excluded = excluded;
                        (spent, n) = (now, n + 1);
                    }
                    RetryDecision::Stays { .. } => break,
                }
            }
            prop_assert!(n <= BUDGETS.infrastructure + BUDGETS.free);
        }
    }
}
