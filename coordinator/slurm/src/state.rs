//! Slurm's job states, complete, and what each says about whether a job lives.

use serde::{Deserialize, Serialize};

macro_rules! states {
    ($($(#[$doc:meta])* $name:ident = $long:literal / $short:literal : $bearing:expr,)*) => {
        /// A state of a job (squeue and sacct manual pages, "job state codes").
        #[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[serde(from = "String", into = "String")]
        pub enum SlurmState {
            $($(#[$doc])* $name,)*
            /// A state that is not listed above: shown as it is, and waited for.
            Unlisted(String),
        }

        impl SlurmState {
            /// Every listed state.
            pub const LISTED: &'static [Self] = &[$(Self::$name),*];

            /// Reads a state's long or short name. sacct writes who cancelled behind it (`CANCELLED by 1001`), other
            /// versions of Slurm several states joined by `+`: the first word counts.
            #[must_use]
            pub fn parse(text: &str) -> Self {
                let word = text.split([' ', '+', ',']).next().unwrap_or_default();
                match word {
                    $($long | $short => Self::$name,)*
                    _ => Self::Unlisted(text.to_owned()),
                }
            }

            /// The long name.
            #[must_use]
            pub fn as_str(&self) -> &str {
                match self {
                    $(Self::$name => $long,)*
                    Self::Unlisted(text) => text,
                }
            }

            /// What the state says about the job's life.
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

/// What a state says about a job's life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bearing {
    /// It waits for its start.
    Waiting,
    /// It has nodes and may have processes.
    Running,
    /// It has ended.
    Ended,
    /// Neither can be told: wait, and show the state.
    Unclear,
}

states! {
    /// Ended because a node failed to boot.
    BootFail = "BOOT_FAIL" / "BF": Bearing::Ended,
    /// Cancelled by its user or an administrator.
    Cancelled = "CANCELLED" / "CA": Bearing::Ended,
    /// All processes ended with exit code 0.
    Completed = "COMPLETED" / "CD": Bearing::Ended,
    /// Has nodes that are being made ready.
    Configuring = "CONFIGURING" / "CF": Bearing::Waiting,
    /// Is ending; processes may still be there.
    Completing = "COMPLETING" / "CG": Bearing::Running,
    /// Ended at its deadline.
    Deadline = "DEADLINE" / "DL": Bearing::Ended,
    /// Ended with an exit code other than 0.
    Failed = "FAILED" / "F": Bearing::Ended,
    /// Could not be started on its nodes; Slurm may requeue it.
    LaunchFailed = "LAUNCH_FAILED" / "LF": Bearing::Unclear,
    /// A node of it failed. Its processes may be alive.
    NodeFail = "NODE_FAIL" / "NF": Bearing::Ended,
    /// Used more memory than it was given.
    OutOfMemory = "OUT_OF_MEMORY" / "OOM": Bearing::Ended,
    /// Waits.
    Pending = "PENDING" / "PD": Bearing::Waiting,
    /// Its nodes are being powered up.
    PowerUpNode = "POWER_UP_NODE" / "PU": Bearing::Waiting,
    /// Had to make room for another.
    Preempted = "PREEMPTED" / "PR": Bearing::Ended,
    /// The nodes could not be reconfigured for it; Slurm may requeue it.
    ReconfigFail = "RECONFIG_FAIL" / "RCF": Bearing::Unclear,
    /// Runs.
    Running = "RUNNING" / "R": Bearing::Running,
    /// Held because its reservation was deleted.
    ResvDelHold = "RESV_DEL_HOLD" / "RD": Bearing::Waiting,
    /// Is being requeued by a federation.
    RequeueFed = "REQUEUE_FED" / "RF": Bearing::Waiting,
    /// Requeued and held.
    RequeueHold = "REQUEUE_HOLD" / "RH": Bearing::Waiting,
    /// Ending, to be queued again under the same number.
    Requeued = "REQUEUED" / "RQ": Bearing::Waiting,
    /// Is about to change its size.
    Resizing = "RESIZING" / "RS": Bearing::Running,
    /// Taken over by another cluster of a federation.
    Revoked = "REVOKED" / "RV": Bearing::Unclear,
    /// Is being signalled.
    Signaling = "SIGNALING" / "SI": Bearing::Running,
    /// Requeued in a special state, held.
    SpecialExit = "SPECIAL_EXIT" / "SE": Bearing::Waiting,
    /// Files are being staged out.
    StageOut = "STAGE_OUT" / "SO": Bearing::Running,
    /// Stopped by SIGSTOP, keeps its cores.
    Stopped = "STOPPED" / "ST": Bearing::Running,
    /// Suspended, its cores given to others.
    Suspended = "SUSPENDED" / "S": Bearing::Running,
    /// Ended at its time limit.
    Timeout = "TIMEOUT" / "TO": Bearing::Ended,
    /// The database is being told of a change.
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

/// Who cancelled, where the state says so: `CANCELLED by 1001`.
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
