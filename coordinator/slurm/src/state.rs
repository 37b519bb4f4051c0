//! All job states of Slurm, and what each of them says about the life of a job.

use serde::{Deserialize, Serialize};

macro_rules! states {
    ($($(#[$doc:meta])* $name:ident = $long:literal / $short:literal : $bearing:expr,)*) => {
        /// A state of a job (squeue and sacct manual pages, "job state codes").
        #[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[serde(from = "String", into = "String")]
        pub enum SlurmState {
            $($(#[$doc])* $name,)*
            /// A state that is not listed above, which is shown as it is and waited for.
            Unlisted(String),
        }

        impl SlurmState {
            /// Every state of the manual pages, without [`Self::Unlisted`].
            pub const LISTED: &'static [Self] = &[$(Self::$name),*];

            /// Reads a state's long or short name. sacct appends the canceller (`CANCELLED by
            /// 1001`), and other versions of Slurm join several states with `+`: the first word
            /// counts.
            #[must_use]
            pub fn parse(text: &str) -> Self {
                let word = text.split([' ', '+', ',']).next().unwrap_or_default();
                match word {
                    $($long | $short => Self::$name,)*
                    _ => Self::Unlisted(text.to_owned()),
                }
            }

            /// Long name of the state.
            #[must_use]
            pub fn as_str(&self) -> &str {
                match self {
                    $(Self::$name => $long,)*
                    Self::Unlisted(text) => text,
                }
            }

            /// Meaning of the state for the life of the job.
            #[must_use]
            pub fn bearing(&self) -> Liveness {
                match self {
                    $(Self::$name => $bearing,)*
                    Self::Unlisted(_) => Liveness::Unclear,
                }
            }
        }
    };
}

/// Meaning of a state for the life of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Liveness {
    /// The job waits for its start.
    Waiting,
    /// The job has nodes and may have processes.
    Running,
    /// The job has ended.
    Ended,
    /// The state shows neither life nor an end: wait, and show the state.
    Unclear,
}

states! {
    /// Ended because a node failed to boot.
    BootFail = "BOOT_FAIL" / "BF": Liveness::Ended,
    /// Cancelled by its user or an administrator.
    Cancelled = "CANCELLED" / "CA": Liveness::Ended,
    /// All processes ended with exit code 0.
    Completed = "COMPLETED" / "CD": Liveness::Ended,
    /// Waits for nodes that are being prepared.
    Configuring = "CONFIGURING" / "CF": Liveness::Waiting,
    /// Is ending, but processes may still exist.
    Completing = "COMPLETING" / "CG": Liveness::Running,
    /// Ended at its deadline.
    Deadline = "DEADLINE" / "DL": Liveness::Ended,
    /// Ended with an exit code other than 0.
    Failed = "FAILED" / "F": Liveness::Ended,
    /// Could not be started on its nodes, and Slurm may requeue it.
    LaunchFailed = "LAUNCH_FAILED" / "LF": Liveness::Unclear,
    /// Ended because one of its nodes failed, but its processes may be alive.
    NodeFail = "NODE_FAIL" / "NF": Liveness::Ended,
    /// Used more memory than it was given.
    OutOfMemory = "OUT_OF_MEMORY" / "OOM": Liveness::Ended,
    /// Waits for resources or its turn.
    Pending = "PENDING" / "PD": Liveness::Waiting,
    /// Waits for nodes that are being powered up.
    PowerUpNode = "POWER_UP_NODE" / "PU": Liveness::Waiting,
    /// Ended to make room for another job.
    Preempted = "PREEMPTED" / "PR": Liveness::Ended,
    /// Waits because its nodes could not be reconfigured, and Slurm may requeue it.
    ReconfigFail = "RECONFIG_FAIL" / "RCF": Liveness::Unclear,
    /// Runs on its nodes.
    Running = "RUNNING" / "R": Liveness::Running,
    /// Held because its reservation was deleted.
    ResvDelHold = "RESV_DEL_HOLD" / "RD": Liveness::Waiting,
    /// Is being requeued by a federation.
    RequeueFed = "REQUEUE_FED" / "RF": Liveness::Waiting,
    /// Queued again after a run, and held until a person releases it.
    RequeueHold = "REQUEUE_HOLD" / "RH": Liveness::Waiting,
    /// Ending, to be queued again under the same number.
    Requeued = "REQUEUED" / "RQ": Liveness::Waiting,
    /// Is about to change its size.
    Resizing = "RESIZING" / "RS": Liveness::Running,
    /// Taken over by another cluster of a federation.
    Revoked = "REVOKED" / "RV": Liveness::Unclear,
    /// Receives a signal from Slurm while it runs.
    Signaling = "SIGNALING" / "SI": Liveness::Running,
    /// Requeued in a special state, held.
    SpecialExit = "SPECIAL_EXIT" / "SE": Liveness::Waiting,
    /// Is staging out files.
    StageOut = "STAGE_OUT" / "SO": Liveness::Running,
    /// Stopped by SIGSTOP, but keeps its cores.
    Stopped = "STOPPED" / "ST": Liveness::Running,
    /// Suspended, with its cores given to other jobs.
    Suspended = "SUSPENDED" / "S": Liveness::Running,
    /// Ended at its time limit.
    Timeout = "TIMEOUT" / "TO": Liveness::Ended,
    /// Is reporting a change to the database.
    UpdateDb = "UPDATE_DB" / "UD": Liveness::Running,
}

impl From<String> for SlurmState {
    fn from(text: String) -> Self {
        Self::parse(&text)
    }
}

impl From<SlurmState> for String {
    fn from(state: SlurmState) -> Self {
        state.as_str().to_owned()
    }
}

/// User id of the canceller, if the state has one: `CANCELLED by 1001`.
#[must_use]
pub fn cancelled_by(text: &str) -> Option<u32> {
    crate::job::number(text.strip_prefix("CANCELLED by ")?)
}

#[cfg(test)]
mod tests {
    use super::{Liveness, SlurmState, cancelled_by};

    #[test]
    fn names_are_read_as_they_are_written() {
        for state in SlurmState::LISTED {
            assert_eq!(&SlurmState::parse(state.as_str()), state);
        }
        assert_eq!(
            SlurmState::parse("CANCELLED by 1001"),
            SlurmState::Cancelled
        );
        assert_eq!(SlurmState::parse("CANCELLED+"), SlurmState::Cancelled);
        assert_eq!(SlurmState::parse("OOM"), SlurmState::OutOfMemory);
        assert_eq!(cancelled_by("CANCELLED by 1001"), Some(1001));
        assert_eq!(cancelled_by("CANCELLED"), None);
    }

    #[test]
    fn what_is_not_listed_is_shown_and_waited_for() {
        let state = SlurmState::parse("TELEPORTED");
        assert_eq!(
            (state.as_str(), state.bearing()),
            ("TELEPORTED", Liveness::Unclear)
        );
        assert_eq!(SlurmState::parse("").bearing(), Liveness::Unclear);
    }

    #[test]
    fn every_state_has_its_bearing() {
        let table = SlurmState::LISTED
            .iter()
            .map(|state| format!("{:<14} {:?}\n", state.as_str(), state.bearing()))
            .collect::<String>();
        insta::assert_snapshot!(table);
    }
}
