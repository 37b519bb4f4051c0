//! Why a job ended, judged once from all evidence, and why it left a patient unfinished.
//!
//! The first judgement ([`judge`]) is made when the job has ended, and is logged with its end. The
//! second one ([`judge_patient`]) adds what is known only after the job was fenced: which attempts it
//! left, and in which words its driver left each patient.

use cardiotwin_vocabulary::failure_cause::FailureCause;

use crate::cancelled::{Canceller, OwnTraces, by_whom};
use crate::job_status::Ended;
use crate::state::SlurmState;

/// Evidence of how a job, or an element of an array, ended.
#[derive(Debug, Clone, Copy)]
pub enum JobEvidence<'a> {
    /// All of its drivers reported that they ended by themselves.
    Drivers {
        /// Whether one of them ran out of time.
        out_of_time: bool,
    },
    /// Slurm reports its end.
    Slurm(SlurmEvidence<'a>),
}

/// Slurm's report of an end, with what the job left.
#[derive(Debug, Clone, Copy)]
pub struct SlurmEvidence<'a> {
    /// Report of Slurm.
    pub ended: &'a Ended,
    /// Last part of the job's log; empty if there is none.
    pub log_tail: &'a str,
    /// Whether the coordinator requested the cancellation.
    pub we_cancelled: bool,
    /// Whether the job received the warning before its walltime.
    pub warned: bool,
    /// Evidence that distinguishes a person's cancellation from Slurm's.
    pub traces: OwnTraces,
}

/// Judgement of an end.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Judgement {
    /// Cause of the failure; `None` if the job ended in order or the coordinator cancelled it.
    pub cause: Option<FailureCause>,
    /// Nodes that failed, as far as they are known, in Slurm's notation.
    pub failed_nodes: String,
}

/// Judges why a job ended; `None` while its canceller is still unknown, so that the job must be
/// looked at again.
#[must_use]
pub fn judge(evidence: &JobEvidence<'_>) -> Option<Judgement> {
    let evidence = match evidence {
        JobEvidence::Drivers { out_of_time } => {
            return Some(Judgement {
                cause: out_of_time.then_some(FailureCause::Walltime),
                ..Judgement::default()
            });
        }
        JobEvidence::Slurm(evidence) => evidence,
    };
    if is_open(evidence) {
        return None;
    }
    let cause = cause_by_slurm(evidence);
    let failed_nodes = match cause {
        Some(FailureCause::NodeFailure) => failed_nodes(&evidence.ended.nodes, evidence.log_tail),
        _ => String::new(),
    };
    Some(Judgement {
        cause,
        failed_nodes,
    })
}

/// Evidence about a patient that an ended job left unfinished.
#[derive(Debug, Clone, Copy)]
pub struct PatientEvidence<'a> {
    /// Whether the job was working on the patient when it ended.
    pub was_interrupted: bool,
    /// Whether the patient's worker died of a defect.
    pub has_defect: bool,
    /// Words in which the driver left the patient; empty if there are none.
    pub words: &'a str,
    /// Nodes of the job in Slurm's notation.
    pub nodes: &'a str,
}

/// Judges why a job left a patient unfinished. What ended the job ended the patient's work, except
/// for a job that ended in order or without an explanation.
#[must_use]
pub fn judge_patient(job: Judgement, evidence: &PatientEvidence<'_>) -> (FailureCause, String) {
    let cause = match job.cause {
        None | Some(FailureCause::Unexplained) if evidence.has_defect => FailureCause::Defect,
        Some(cause) => cause,
        // The job ended in order: its remaining patients had too little time, or a worker that
        // died.
        None if !evidence.was_interrupted => FailureCause::Walltime,
        // The step of a simulation says why it was killed, in the words that its driver left.
        None => cause_in_log(evidence.words).unwrap_or(FailureCause::Unexplained),
    };
    let nodes = match cause {
        FailureCause::NodeFailure if job.failed_nodes.is_empty() => {
            failed_nodes(evidence.nodes, evidence.words)
        }
        _ => job.failed_nodes,
    };
    (cause, nodes)
}

fn cause_by_slurm(evidence: &SlurmEvidence<'_>) -> Option<FailureCause> {
    let ended = evidence.ended;
    let in_log = cause_in_log(evidence.log_tail);
    let out_of_memory = in_log == Some(FailureCause::OutOfMemory);
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
        _ if evidence.log_tail.contains("panicked at ") => FailureCause::Defect,
        _ if in_log == Some(FailureCause::NodeFailure) => FailureCause::NodeFailure,
        SlurmState::Failed if ended.reason == "BadConstraints" => FailureCause::Refused,
        // A script that exits from its own handler of the warning is FAILED or COMPLETED, not
        // TIMEOUT.
        _ if evidence.warned => FailureCause::Walltime,
        _ => FailureCause::Unexplained,
    })
}

/// Whether the canceller of a job is still unknown.
fn is_open(evidence: &SlurmEvidence<'_>) -> bool {
    let ended = evidence.ended;
    ended.state == SlurmState::Cancelled
        && !ended.reason.starts_with("Dependency")
        && !evidence.we_cancelled
        && cause_in_log(evidence.log_tail) != Some(FailureCause::OutOfMemory)
        && by_whom(ended, evidence.traces) == Canceller::Unclear
}

/// Messages of slurmstepd and the kernel before they kill a process for its memory.
const OUT_OF_MEMORY: &[&str] = &[
    "exceeded memory limit",
    "oom-kill event",
    "oom_kill event",
    "Out Of Memory",
    "Out of memory",
];

/// Messages of srun and slurmstepd about a node that does not answer any more.
const NODE_FAILURE: &[&str] = &[
    "Node failure on",
    "DUE TO NODE FAILURE",
    "Aborting, io error and missing step",
];

/// Cause that a log names: the memory of a killed step, or else a node that failed; else `None`.
#[must_use]
pub fn cause_in_log(log: &str) -> Option<FailureCause> {
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
pub fn names_foreign_launcher(log: &str) -> bool {
    FOREIGN_LAUNCHER.iter().any(|words| log.contains(words))
}

/// Nodes that failed under a job, in Slurm's notation; empty if they cannot be distinguished from the
/// job's other nodes. Slurm gives no job to a node that is down: an unnamed one need not be avoided.
///
/// - `nodes`: all nodes of the job
fn failed_nodes(nodes: &str, log_tail: &str) -> String {
    if !nodes.contains(['[', ',']) {
        return nodes.to_owned();
    }
    let messages = log_tail.split(NODE_FAILURE[0]).skip(1);
    let mut named: Vec<&str> = messages
        .filter_map(|rest| rest.split_whitespace().next())
        .collect();
    named.sort_unstable();
    named.dedup();
    named.join(",")
}

#[cfg(test)]
mod tests {
    use super::{
        FailureCause, JobEvidence, Judgement, PatientEvidence, SlurmEvidence, failed_nodes, judge,
        judge_patient,
    };
    use crate::answers::{accounting, queue, recorded};
    use crate::cancelled::OwnTraces;
    use crate::job_status::{JobStatus, Wanted, of};

    const TRACES: OwnTraces = OwnTraces {
        began: true,
        asked_to_end: false,
        uid: 1001,
        no_accounting: false,
        waited: false,
    };

    fn cause_of(name: &str, log_tail: &str) -> Option<FailureCause> {
        let queue = queue::read(&recorded::output("squeue-ended")).expect("an answer");
        let rows = accounting::read(&recorded::output("sacct-ended")).expect("an answer");
        let wanted = Wanted {
            name,
            element: None,
        };
        let JobStatus::Ended(ended) = of(wanted, Some(&queue), Some(&rows)) else {
            panic!("{name}")
        };
        let evidence = JobEvidence::Slurm(SlurmEvidence {
            ended: &ended,
            log_tail,
            we_cancelled: false,
            warned: false,
            traces: TRACES,
        });
        judge(&evidence)
            .unwrap_or_else(|| panic!("accounting tells: {name}"))
            .cause
    }

    #[test]
    fn of_several_nodes_only_those_are_named_that_failed() {
        assert_eq!(failed_nodes("n3", ""), "n3");
        assert_eq!(failed_nodes("n[1-4]", "DUE TO NODE FAILURE, SEE"), "");
        let log = "srun: error: Node failure on n3\nsrun: error: Node failure on n3\n";
        assert_eq!(failed_nodes("n[1-4]", log), "n3");
        assert_eq!(failed_nodes("", ""), "");
    }

    #[test]
    fn endings_of_a_real_slurm() {
        assert_eq!(cause_of("ct-walltime", ""), Some(FailureCause::Walltime));
        assert_eq!(cause_of("ct-node", ""), Some(FailureCause::NodeFailure));
        assert_eq!(cause_of("ct-person", ""), Some(FailureCause::Cancelled));
        assert_eq!(cause_of("ct-short", ""), None);
        assert_eq!(cause_of("ct-exit3", ""), Some(FailureCause::Unexplained));
        assert_eq!(
            cause_of("ct-exit3", "thread 'main' panicked at worker/src/x.rs:1:1"),
            Some(FailureCause::Defect)
        );
        let killed = "slurmstepd: error: StepId=17.batch exceeded memory limit (77611008 > 20971520), being killed";
        assert_eq!(
            cause_of("ct-memory", killed),
            Some(FailureCause::OutOfMemory)
        );
        assert_eq!(
            cause_of("ct-after", ""),
            Some(FailureCause::Unexplained),
            "an unmet dependency is no person"
        );
    }

    #[test]
    fn drivers_that_ended_by_themselves_judge_their_job() {
        let cause = |out_of_time| judge(&JobEvidence::Drivers { out_of_time }).unwrap().cause;
        assert_eq!(
            (cause(true), cause(false)),
            (Some(FailureCause::Walltime), None)
        );
    }

    #[test]
    fn a_patient_is_judged_by_its_job_and_then_by_its_own_traces() {
        use FailureCause::{
            Cancelled, Defect, NodeFailure, OutOfMemory, Preemption, Unexplained, Walltime,
        };
        let memory = "killed: Detected 1 oom_kill event";
        let node = "srun: error: Node failure on n3";
        for (job, was_interrupted, has_defect, words, expected) in [
            (None, false, false, "", Walltime),
            (None, true, false, "", Unexplained),
            (None, true, false, memory, OutOfMemory),
            (None, true, false, node, NodeFailure),
            (None, false, true, "", Defect),
            (Some(Unexplained), true, true, memory, Defect),
            (Some(Unexplained), true, false, memory, Unexplained),
            (Some(Preemption), true, true, memory, Preemption),
            (Some(Cancelled), true, true, "", Cancelled),
        ] {
            let evidence = PatientEvidence {
                was_interrupted,
                has_defect,
                words,
                nodes: "n[1-4]",
            };
            let judgement = Judgement {
                cause: job,
                ..Judgement::default()
            };
            let (cause, nodes) = judge_patient(judgement, &evidence);
            assert_eq!(cause, expected, "{job:?} {evidence:?}");
            let expected = if cause == NodeFailure { "n3" } else { "" };
            assert_eq!(nodes, expected, "{job:?} {evidence:?}");
        }
        let known = Judgement {
            cause: Some(NodeFailure),
            failed_nodes: "n2".to_owned(),
        };
        let evidence = PatientEvidence {
            was_interrupted: true,
            has_defect: false,
            words: node,
            nodes: "n[1-4]",
        };
        assert_eq!(
            judge_patient(known, &evidence),
            (NodeFailure, "n2".to_owned()),
            "the job's judgement names the node"
        );
    }
}
