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
            pub fn bearing(&self) -> Bearing {
                match self {
                    $(Self::$name => $bearing,)*
                    Self::Unlisted(_) => Bearing::Unclear,
                }
            }
        }
    };
}

/// Meaning of a state for the life of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bearing {
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
    BootFail = "BOOT_FAIL" / "BF": Bearing::Ended,
    /// Cancelled by its user or an administrator.
    Cancelled = "CANCELLED" / "CA": Bearing::Ended,
    /// All processes ended with exit code 0.
    Completed = "COMPLETED" / "CD": Bearing::Ended,
    /// Waits for nodes that are being prepared.
    Configuring = "CONFIGURING" / "CF": Bearing::Waiting,
    /// Is ending, but processes may still exist.
    Completing = "COMPLETING" / "CG": Bearing::Running,
    /// Ended at its deadline.
    Deadline = "DEADLINE" / "DL": Bearing::Ended,
    /// Ended with an exit code other than 0.
    Failed = "FAILED" / "F": Bearing::Ended,
    /// Could not be started on its nodes, and Slurm may requeue it.
    LaunchFailed = "LAUNCH_FAILED" / "LF": Bearing::Unclear,
    /// Ended because one of its nodes failed, but its processes may be alive.
    NodeFail = "NODE_FAIL" / "NF": Bearing::Ended,
    /// Used more memory than it was given.
    OutOfMemory = "OUT_OF_MEMORY" / "OOM": Bearing::Ended,
    /// Waits for resources or its turn.
    Pending = "PENDING" / "PD": Bearing::Waiting,
    /// Waits for nodes that are being powered up.
    PowerUpNode = "POWER_UP_NODE" / "PU": Bearing::Waiting,
    /// Ended to make room for another job.
    Preempted = "PREEMPTED" / "PR": Bearing::Ended,
    /// Waits because its nodes could not be reconfigured, and Slurm may requeue it.
    ReconfigFail = "RECONFIG_FAIL" / "RCF": Bearing::Unclear,
    /// Runs on its nodes.
    Running = "RUNNING" / "R": Bearing::Running,
    /// Held because its reservation was deleted.
    ResvDelHold = "RESV_DEL_HOLD" / "RD": Bearing::Waiting,
    /// Is being requeued by a federation.
    RequeueFed = "REQUEUE_FED" / "RF": Bearing::Waiting,
    /// Queued again after a run, and held until a person releases it.
    RequeueHold = "REQUEUE_HOLD" / "RH": Bearing::Waiting,
    /// Ending, to be queued again under the same number.
    Requeued = "REQUEUED" / "RQ": Bearing::Waiting,
    /// Is about to change its size.
    Resizing = "RESIZING" / "RS": Bearing::Running,
    /// Taken over by another cluster of a federation.
    Revoked = "REVOKED" / "RV": Bearing::Unclear,
    /// Receives a signal from Slurm while it runs.
    Signaling = "SIGNALING" / "SI": Bearing::Running,
    /// Requeued in a special state, held.
    SpecialExit = "SPECIAL_EXIT" / "SE": Bearing::Waiting,
    /// Is staging out files.
    StageOut = "STAGE_OUT" / "SO": Bearing::Running,
    /// Stopped by SIGSTOP, but keeps its cores.
    Stopped = "STOPPED" / "ST": Bearing::Running,
    /// Suspended, with its cores given to other jobs.
    Suspended = "SUSPENDED" / "S": Bearing::Running,
    /// Ended at its time limit.
    Timeout = "TIMEOUT" / "TO": Bearing::Ended,
    /// Is reporting a change to the database.
    UpdateDb = "UPDATE_DB" / "UD": Bearing::Running,
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
    use super::{Bearing, SlurmState, cancelled_by};

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
            ("TELEPORTED", Bearing::Unclear)
        );
        assert_eq!(SlurmState::parse("").bearing(), Bearing::Unclear);
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
