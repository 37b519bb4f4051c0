//! Classes of failures of a job, and their consequences.
//!
//! Repeats are charged to one of two budgets: `infrastructure` for failures of the site's making,
//! and `free` for failed nodes and daemons, preemptions and used walltimes with progress. The second one is a
//! generous bound that keeps a broken partition from being fed for ever.

use cardiotwin_vocabulary::failure_cause::FailureCause;

use crate::cancelled::{Canceller, OwnTraces, by_whom};
use crate::job_status::Ended;
use crate::state::SlurmState;

/// Evidence of an ending.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// Report of the scheduler; `None` if it did not answer.
    pub scheduler: Option<&'a Ended>,
    /// Last part of the job's log; empty if there is none.
    pub log_tail: &'a str,
    /// Whether the coordinator requested the cancellation.
    pub we_cancelled: bool,
    /// Whether the job received the warning before its walltime.
    pub warned: bool,
    /// Evidence that distinguishes a person's cancellation from Slurm's.
    pub traces: OwnTraces,
}

/// Class of an ending; `None` if the coordinator cancelled the job or it completed.
#[must_use]
pub fn classify(evidence: &Evidence<'_>) -> Option<FailureCause> {
    let out_of_memory = ran_out_of_memory(evidence);
    let panicked = evidence.log_tail.contains("panicked at ");
    let Some(ended) = evidence.scheduler else {
        return Some(if out_of_memory {
            FailureCause::OutOfMemory
        } else if panicked {
            FailureCause::Defect
        } else if lost_a_node(evidence) {
            FailureCause::NodeFailure
        } else {
            FailureCause::Lost
        });
    };
    Some(match ended.state {
        SlurmState::Completed => return None,
        SlurmState::Timeout | SlurmState::Deadline => FailureCause::Walltime,
        SlurmState::OutOfMemory => FailureCause::OutOfMemory,
        SlurmState::NodeFail | SlurmState::BootFail => FailureCause::NodeFailure,
        SlurmState::Preempted => FailureCause::Preemption,
        SlurmState::Cancelled if evidence.we_cancelled => return None,
        // OverMemoryKill cancels the step, and an unmet dependency cancels the job. No person did
        // either.
        SlurmState::Cancelled if out_of_memory => FailureCause::OutOfMemory,
        SlurmState::Cancelled if ended.reason.starts_with("Dependency") => {
            FailureCause::Unexplained
        }
        SlurmState::Cancelled => match by_whom(ended, evidence.traces) {
            Canceller::Person => FailureCause::Cancelled,
            Canceller::Slurm | Canceller::Unclear => FailureCause::Lost,
        },
        _ if out_of_memory
            || ended.reason == "OutOfMemory"
            || ended.exit.is_some_and(|e| e.signal == 125) =>
        {
            FailureCause::OutOfMemory
        }
        _ if panicked => FailureCause::Defect,
        _ if lost_a_node(evidence) => FailureCause::NodeFailure,
        SlurmState::Failed if ended.reason == "BadConstraints" => FailureCause::Refused,
        // A script that exits from its own handler of the warning is FAILED or COMPLETED, not
        // TIMEOUT.
        _ if evidence.warned => FailureCause::Walltime,
        _ => FailureCause::Unexplained,
    })
}

/// Whether the canceller of a job is still unknown, so that the job must be looked at again before
/// [`classify`].
#[must_use]
pub fn is_open(evidence: &Evidence<'_>) -> bool {
    let cancelled = |ended: &&Ended| {
        ended.state == SlurmState::Cancelled && !ended.reason.starts_with("Dependency")
    };
    !evidence.we_cancelled
        && !ran_out_of_memory(evidence)
        && evidence
            .scheduler
            .filter(cancelled)
            .is_some_and(|e| by_whom(e, evidence.traces) == Canceller::Unclear)
}

fn ran_out_of_memory(evidence: &Evidence<'_>) -> bool {
    told_by(evidence.log_tail) == Some(FailureCause::OutOfMemory)
}

/// Messages of slurmstepd and the kernel before they kill a process for its memory.
const OUT_OF_MEMORY: &[&str] = &[
    "exceeded memory limit",
    "oom-kill event",
    "oom_kill event",
    "Out Of Memory",
    "Out of memory",
];

/// Cause that a log names: the memory of a killed step, or else a node that failed; else `None`.
#[must_use]
pub fn told_by(log: &str) -> Option<FailureCause> {
    let has_any = |messages: &[&str]| messages.iter().any(|words| log.contains(words));
    if has_any(OUT_OF_MEMORY) {
        Some(FailureCause::OutOfMemory)
    } else {
        has_any(NODE_FAILURE).then_some(FailureCause::NodeFailure)
    }
}

/// Messages of ranks whose MPI does not understand the launcher: Open MPI's, and the worker's own.
const FOREIGN_LAUNCHER: &[&str] = &[
    "OMPI was not built with SLURM's PMI",
    "another MPI's launcher",
];

/// Whether a log says that the ranks' MPI does not understand the launcher.
#[must_use]
pub fn tells_foreign_launcher(log: &str) -> bool {
    FOREIGN_LAUNCHER.iter().any(|words| log.contains(words))
}

/// Whether a step says that one of its nodes, or the daemon of a node, failed.
fn lost_a_node(evidence: &Evidence<'_>) -> bool {
    told_by(evidence.log_tail) == Some(FailureCause::NodeFailure)
}

/// Nodes that failed under a job, in Slurm's notation; empty if they cannot be distinguished from the
/// job's other nodes. Slurm gives no job to a node that is down: an unnamed one need not be avoided.
///
/// - `nodes`: all nodes of the job
#[must_use]
pub fn failed_nodes(nodes: &str, log_tail: &str) -> String {
    if !nodes.contains(['[', ',']) {
        return nodes.to_owned();
    }
    let told = log_tail.split(NODE_FAILURE[0]).skip(1);
    let mut named: Vec<&str> = told
        .filter_map(|rest| rest.split_whitespace().next())
        .collect();
    named.sort_unstable();
    named.dedup();
    named.join(",")
}

/// Messages of srun and slurmstepd about a node that does not answer any more.
const NODE_FAILURE: &[&str] = &[
    "Node failure on",
    "DUE TO NODE FAILURE",
    "Aborting, io error and missing step",
];

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
pub struct Spent {
    /// Repeats charged to [`Budgets::infrastructure`].
    pub infrastructure: u32,
    /// Repeats charged to [`Budgets::free`].
    pub free: u32,
}

/// Resources of an attempt, as far as they can be changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Given {
    /// Number of ranks on each node.
    pub ranks_per_node: u32,
    /// Memory of each rank, MiB.
    pub memory_per_rank_mib: u64,
    /// Memory of a node, MiB.
    pub memory_per_node_mib: u64,
    /// Nodes to avoid, in Slurm's compressed notation.
    pub excluded: Vec<String>,
}

/// Consequence of an ending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Next {
    /// A new attempt is made.
    Again {
        /// Whether it continues from the checkpoint, if there is one.
        continues: bool,
        /// Resources of the new attempt.
        given: Given,
        /// Repeats spent, the new one included.
        spent: Spent,
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
/// - `progressed`: whether the checkpoint is further than the previous attempt's
#[must_use]
pub fn next(
    class: FailureCause,
    failed: &str,
    progressed: bool,
    given: &Given,
    spent: Spent,
    budgets: Budgets,
) -> Next {
    let stays = |why: &str| Next::Stays {
        why: why.to_owned(),
    };
    let again = |continues: bool, given: Given, charge: fn(&mut Spent) -> &mut u32, why: String| {
        let mut spent = spent;
        *charge(&mut spent) += 1;
        if spent.infrastructure > budgets.infrastructure {
            return Next::Stays {
                why: format!(
                    "{why}; its {} repeats after failures of the site are used up",
                    budgets.infrastructure
                ),
            };
        }
        if spent.free > budgets.free {
            return Next::Stays {
                why: format!(
                    "{why}; not repeated again after {} repeats without a charge: check the site",
                    budgets.free
                ),
            };
        }
        Next::Again {
            continues,
            given,
            spent,
            why,
        }
    };
    let free: fn(&mut Spent) -> &mut u32 = |spent| &mut spent.free;
    let charged: fn(&mut Spent) -> &mut u32 = |spent| &mut spent.infrastructure;
    match class {
        FailureCause::Walltime if progressed => again(
            true,
            given.clone(),
            free,
            "its walltime was used up: a new job continues".to_owned(),
        ),
        FailureCause::Walltime => again(
            true,
            given.clone(),
            charged,
            "its walltime was used up without progress".to_owned(),
        ),
        FailureCause::OutOfMemory => match more_memory(given) {
            Some((given, how)) => again(true, given, charged, format!("out of memory: {how}")),
            None => stays(
                "out of memory with one rank on a whole node: use more nodes or a coarser mesh",
            ),
        },
        FailureCause::NodeFailure if failed.is_empty() => again(
            true,
            given.clone(),
            free,
            "node failure: Slurm gives no job to a node that is down".to_owned(),
        ),
        FailureCause::NodeFailure => {
            let mut given = given.clone();
            if !given.excluded.iter().any(|nodes| nodes == failed) {
                given.excluded.push(failed.to_owned());
            }
            let why = format!("node failure on {failed}: excluded from now on");
            again(true, given, free, why)
        }
        FailureCause::Preemption => again(true, given.clone(), free, "preempted".to_owned()),
        FailureCause::Cancelled => stays("cancelled by a person: not repeated until requested"),
        FailureCause::Refused => stays("the data or settings are wrong: correct them"),
        FailureCause::Defect => stays("a defect of the program: see its log, and report it"),
        FailureCause::Lost => again(
            true,
            given.clone(),
            free,
            "Slurm itself ended or lost it".to_owned(),
        ),
        FailureCause::Unexplained => again(
            true,
            given.clone(),
            charged,
            "ended without an explanation".to_owned(),
        ),
    }
}

/// Halves the number of ranks on a node. With a single rank, doubles its memory up to the node's.
/// `None` if it had all of it.
fn more_memory(given: &Given) -> Option<(Given, String)> {
    let mut more = given.clone();
    if given.ranks_per_node > 1 {
        more.ranks_per_node = given.ranks_per_node / 2;
        more.memory_per_rank_mib = given.memory_per_node_mib / u64::from(more.ranks_per_node);
        let how = format!(
            "{} ranks on a node instead of {}",
            more.ranks_per_node, given.ranks_per_node
        );
        return Some((more, how));
    }
    let doubled = given
        .memory_per_rank_mib
        .saturating_mul(2)
        .min(given.memory_per_node_mib);
    more.memory_per_rank_mib = doubled;
    (doubled > given.memory_per_rank_mib).then(|| {
        (
            more,
            format!("{doubled} MiB instead of {}", given.memory_per_rank_mib),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::{
        Budgets, Evidence, FailureCause, Given, Next, Spent, classify, failed_nodes, is_open, next,
    };
    use crate::answers::{accounting, queue, recorded};
    use crate::cancelled::OwnTraces;
    use crate::job_status::{JobStatus, Wanted, of};
    use proptest::prelude::*;

    const NOTHING: Evidence<'_> = Evidence {
        scheduler: None,
        log_tail: "",
        we_cancelled: false,
        warned: false,
        traces: OwnTraces {
            began: true,
            asked_to_end: false,
            uid: 1001,
            no_accounting: false,
            waited: false,
        },
    };
    const BUDGETS: Budgets = Budgets {
        infrastructure: 2,
        free: 5,
    };

    fn given() -> Given {
        Given {
            ranks_per_node: 128,
            memory_per_rank_mib: 2000,
            memory_per_node_mib: 256_000,
            excluded: Vec::new(),
        }
    }

    fn class_of(name: &str, log_tail: &str) -> Option<FailureCause> {
        let queue = queue::read(&recorded::output("squeue-ended")).expect("an answer");
        let rows = accounting::read(&recorded::output("sacct-ended")).expect("an answer");
        let JobStatus::Ended(ended) = of(
            Wanted {
                name,
                element: None,
            },
            Some(&queue),
            Some(&rows),
        ) else {
            panic!("{name}")
        };
        let evidence = Evidence {
            scheduler: Some(&ended),
            log_tail,
            ..NOTHING
        };
        assert!(!is_open(&evidence), "accounting tells: {name}");
        classify(&evidence)
    }

    #[test]
    fn of_several_nodes_only_those_are_avoided_that_failed() {
        assert_eq!(failed_nodes("n3", ""), "n3");
        assert_eq!(failed_nodes("n[1-4]", "DUE TO NODE FAILURE, SEE"), "");
        let log = "srun: error: Node failure on n3\nsrun: error: Node failure on n3\n";
        assert_eq!(failed_nodes("n[1-4]", log), "n3");
        assert_eq!(failed_nodes("", ""), "");
        let unnamed = next(
            FailureCause::NodeFailure,
            "",
            true,
            &given(),
            Spent::default(),
            BUDGETS,
        );
        assert!(
            matches!(&unnamed, Next::Again { given: same, .. } if *same == given()),
            "{unnamed:?}"
        );
    }

    #[test]
    fn endings_of_a_real_slurm() {
        assert_eq!(class_of("ct-walltime", ""), Some(FailureCause::Walltime));
        assert_eq!(class_of("ct-node", ""), Some(FailureCause::NodeFailure));
        assert_eq!(class_of("ct-person", ""), Some(FailureCause::Cancelled));
        assert_eq!(class_of("ct-short", ""), None);
        assert_eq!(class_of("ct-exit3", ""), Some(FailureCause::Unexplained));
        assert_eq!(
            class_of("ct-exit3", "thread 'main' panicked at worker/src/x.rs:1:1"),
            Some(FailureCause::Defect)
        );
        let killed = "slurmstepd: error: StepId=17.batch exceeded memory limit (77611008 > 20971520), being killed";
        assert_eq!(
            class_of("ct-memory", killed),
            Some(FailureCause::OutOfMemory)
        );
        assert_eq!(
            class_of("ct-after", ""),
            Some(FailureCause::Unexplained),
            "an unmet dependency is no person"
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
                next(class, "n4", true, &given(), Spent::default(), BUDGETS)
            );
        }
        insta::assert_snapshot!(table);
    }

    proptest! {
        /// Every series of failures ends, and the given resources stay within a node.
        #[test]
        fn every_series_of_failures_ends(classes in proptest::collection::vec(0_usize..5, 40), progress in any::<u64>()) {
            let all = [FailureCause::Walltime, FailureCause::OutOfMemory, FailureCause::NodeFailure, FailureCause::Preemption, FailureCause::Unexplained];
            let (mut spent, mut given, mut n) = (Spent::default(), given(), 0);
            for (i, class) in classes.into_iter().enumerate() {
                match next(all[class], "n1", progress >> i & 1 == 1, &given, spent, BUDGETS) {
                    Next::Again { given: more, spent: now, .. } => {
                        prop_assert!(now.infrastructure + now.free == spent.infrastructure + spent.free + 1);
                        prop_assert!(u64::from(more.ranks_per_node) * more.memory_per_rank_mib <= more.memory_per_node_mib);
                        prop_assert!(more.ranks_per_node >= 1 && more.excluded.len() <= 1);
                        (given, spent, n) = (more, now, n + 1);
                    }
                    Next::Stays { .. } => break,
                }
            }
            prop_assert!(n <= BUDGETS.infrastructure + BUDGETS.free);
        }
    }
}
