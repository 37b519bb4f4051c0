//! Why jobs wait, in words, and whether waiting helps.

use crate::job::JobId;

/// Event that a waiting job needs before it can start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaitsFor {
    /// Free nodes, or its turn: waiting helps.
    Turn,
    /// A limit on the user's or the account's jobs: waiting helps once other jobs have ended.
    Limit,
    /// An act of a person: waiting does not help by itself.
    Person,
    /// Another job, or a requested time.
    Event,
    /// No event: the job can never start as it is.
    Never,
    /// Unknown, because Slurm's reason is not in the list.
    Unlisted,
}

/// A reason that Slurm gives for a waiting job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Why {
    /// Explanation for a person, in lower case and without a full stop. `JOB` stands for the job's number.
    pub words: String,
    /// Event that lets the job start; decisions depend on it, not on the words.
    pub waits_for: WaitsFor,
}

impl Why {
    /// The explanation with the number of the job, so that its commands can be copied.
    #[must_use]
    pub fn words_for(&self, job: JobId) -> String {
        let job = job.to_string();
        // Only where a word begins: a site's own reason may have these letters within a word.
        self.words
            .replace(" JOB", &format!(" {job}"))
            .replace("=JOB", &format!("={job}"))
    }
}

/// Reasons with explanations (squeue manual page, "job reason codes"). Reasons about limits are
/// composed, see [`limit`].
const REASONS: &[(&str, WaitsFor, &str)] = {
    use WaitsFor::{Event, Never, Person, Turn};
    &[
        ("None", Turn, "not yet considered by the scheduler"),
        (
            "WaitingForScheduling",
            Turn,
            "not yet considered by the scheduler",
        ),
        ("Priority", Turn, "jobs of higher priority come first"),
        ("Resources", Turn, "the nodes that it needs are in use"),
        (
            "Cleaning",
            Turn,
            "its earlier run is still being cleaned up",
        ),
        ("Prolog", Turn, "its nodes are being prepared"),
        (
            "Reservation",
            Turn,
            "waits for its reservation: `scontrol show reservation` tells when it begins and ends",
        ),
        (
            "ReservationDeleted",
            Person,
            "held because its reservation was deleted or has ended: name one that holds with \
             `scontrol update JobId=JOB ReservationName=NAME`, then scontrol release JOB; or scancel JOB",
        ),
        ("Licenses", Turn, "waits for a licence"),
        ("NodeDown", Turn, "a node that it needs is down"),
        (
            "ReqNodeNotAvail",
            Turn,
            "a node that it needs is down, drained or reserved, perhaps for maintenance",
        ),
        ("PartitionDown", Person, "the partition is down"),
        (
            "PartitionInactive",
            Person,
            "the partition accepts no jobs at present",
        ),
        ("FrontEndDown", Turn, "no front-end node is up"),
        (
            "JobArrayTaskLimit",
            Turn,
            "the array's own limit on simultaneous elements",
        ),
        (
            "BeginTime",
            Event,
            "its begin time is in the future, or it was just requeued",
        ),
        ("Dependency", Event, "waits for another job to end"),
        (
            "DependencyNeverSatisfied",
            Never,
            "waits for a job that did not end as required",
        ),
        (
            "JobHeldUser",
            Person,
            "held by its user: scontrol release JOB",
        ),
        (
            "JobHeldAdmin",
            Person,
            "held by an administrator, or by Slurm because its reservation has ended: \
             `scontrol show job JOB` names its reservation; else ask the site",
        ),
        (
            "JobHoldMaxRequeue",
            Person,
            "held after too many requeues: scontrol release JOB",
        ),
        (
            "launch failed requeued held",
            Person,
            "requeued and held after a failed start: scontrol release JOB",
        ),
        (
            "job requeued in held state",
            Person,
            "requeued and held: scontrol release JOB",
        ),
        (
            "JobLaunchFailure",
            Never,
            "failed to start, because of a file system, a missing program or a node",
        ),
        (
            "BadConstraints",
            Never,
            "no node of the site meets its constraints",
        ),
        ("InvalidAccount", Never, "the account is not valid"),
        ("InvalidQOS", Never, "the QoS is not valid"),
        (
            "AccountNotAllowed",
            Never,
            "the partition does not allow this account",
        ),
        (
            "QOSNotAllowed",
            Never,
            "the partition or account does not allow this QoS",
        ),
        (
            "PartitionNodeLimit",
            Never,
            "it needs more or fewer nodes than the partition allows, or its nodes are not up",
        ),
        (
            "PartitionTimeLimit",
            Never,
            "its walltime is longer than the partition allows",
        ),
        ("DeadLine", Never, "cannot end before its deadline"),
        ("TimeLimit", Never, "used up its walltime"),
        (
            "NonZeroExitCode",
            Never,
            "ended with an exit code other than 0",
        ),
        (
            "SystemFailure",
            Person,
            "a failure of Slurm, a file system or the network",
        ),
    ]
};

/// Explains the reason of a waiting job. `reason` is squeue's `%r`.
#[must_use]
pub fn why(reason: &str) -> Why {
    let plain = reason.trim_matches(['(', ')']);
    let key = plain.split_once(',').map_or(plain, |(key, _)| key).trim(); // "ReqNodeNotAvail, UnavailableNodes:n4"
    if let Some((_, waits_for, words)) = REASONS.iter().find(|(name, ..)| *name == key) {
        return Why {
            words: (*words).to_owned(),
            waits_for: *waits_for,
        };
    }
    if let Some(why) = limit(key) {
        return why;
    }
    let words = key.to_lowercase();
    // Plugins of sites have reasons of their own.
    if has_ended(&words) {
        return Why {
            words: format!(
                "Slurm says '{key}': what the job names has ended, so that it cannot start; scancel JOB, and \
                 name one that holds"
            ),
            waits_for: WaitsFor::Person,
        };
    }
    // Slurm composes such reasons: "user env retrieval failed requeued held".
    if words.split_whitespace().any(|word| word == "held") || words.starts_with("jobheld") {
        return Why {
            words: format!("held, Slurm says '{key}': scontrol release JOB"),
            waits_for: WaitsFor::Person,
        };
    }
    Why {
        words: format!("Slurm's reason '{reason}', which cardiotwin does not know"),
        waits_for: WaitsFor::Unlisted,
    }
}

/// Whether a message in lower case says that a reservation, account, QoS or partition has ended or was
/// deleted. Waiting, or asking again, does not help then.
#[must_use]
pub fn has_ended(words: &str) -> bool {
    const HOLDERS: [&str; 7] = [
        "reservation",
        "account",
        "project",
        "allocation",
        "budget",
        "qos",
        "partition",
    ];
    const ENDED: [&str; 6] = [
        "expired",
        "has ended",
        "no longer",
        "deleted",
        "does not exist",
        "in the past",
    ];
    let has_any = |list: &[&str]| list.iter().any(|word| words.contains(word));
    has_any(&HOLDERS) && has_any(&ENDED)
}

/// Explains a reason about a limit: `QOSMaxJobsPerUserLimit` and some hundred others consist of a
/// holder, a measure and a scope.
///
/// A job that exceeds a limit on a single job never fits; a limit on all jobs of a user or account
/// passes.
#[must_use]
pub fn limit(key: &str) -> Option<Why> {
    let (holder, measure) = if let Some(rest) = key.strip_prefix("QOS") {
        ("the QoS's", rest)
    } else if let Some(rest) = key.strip_prefix("Assoc") {
        ("the account's", rest)
    } else if key.starts_with("MaxBillingPerAccount") {
        ("the account's", key)
    } else {
        return None;
    };
    const KINDS: &[(&str, WaitsFor, &str)] = &[
        (
            "MaxWallDurationPerJobLimit",
            WaitsFor::Never,
            "limit on a job's walltime: request less",
        ),
        (
            "TimeLimit",
            WaitsFor::Never,
            "limit on a job's walltime: request less",
        ),
        (
            "MaxSubmitJob",
            WaitsFor::Limit,
            "limit on jobs in the queue",
        ),
        (
            "GrpSubmitJobsLimit",
            WaitsFor::Limit,
            "limit on jobs in the queue",
        ),
        ("MaxJobsPer", WaitsFor::Limit, "limit on running jobs"),
        ("MaxJobsLimit", WaitsFor::Limit, "limit on running jobs"),
        ("JobLimit", WaitsFor::Limit, "limit on running jobs"),
        ("GrpJobsLimit", WaitsFor::Limit, "limit on running jobs"),
        (
            "UsageThreshold",
            WaitsFor::Person,
            "threshold on usage: the budget may be used up",
        ),
        (
            "GrpWallLimit",
            WaitsFor::Person,
            "budget of walltime, which is used up",
        ),
        (
            "NotAllowed",
            WaitsFor::Never,
            "list of allowed values does not include this one",
        ),
    ];
    if let Some((_, waits_for, words)) = KINDS.iter().find(|(start, ..)| measure.starts_with(start))
    {
        return Some(Why {
            words: format!("{holder} {words}"),
            waits_for: *waits_for,
        });
    }
    let resource = [
        "Node", "Cpu", "CPU", "Memory", "Mem", "Billing", "GRES", "Energy", "License", "BB",
    ]
    .into_iter()
    .find(|resource| measure.contains(resource))?;
    let of = match resource {
        "Cpu" | "CPU" => "cores",
        "Memory" | "Mem" => "memory",
        "Node" => "nodes",
        "Billing" => "charge",
        "License" => "licences",
        "BB" => "burst buffer",
        other => other,
    };
    Some(if measure.contains("Minutes") || measure.contains("Mins") {
        Why {
            words: format!("{holder} budget of {of}, which is used up or reserved"),
            waits_for: WaitsFor::Person,
        }
    } else if measure.contains("Min") {
        Why {
            words: format!("{holder} minimum of {of} per job: request more"),
            waits_for: WaitsFor::Never,
        }
    } else if measure.contains("PerJob") || measure.contains("PerNode") {
        Why {
            words: format!("{holder} limit on {of} per job: request less"),
            waits_for: WaitsFor::Never,
        }
    } else {
        Why {
            words: format!("{holder} limit on {of} in use at a time"),
            waits_for: WaitsFor::Limit,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::{JobId, WaitsFor, why};

    #[test]
    fn limits_that_pass_are_told_from_those_that_do_not() {
        for (reason, waits_for) in [
            ("QOSMaxJobsPerUserLimit", WaitsFor::Limit),
            ("QOSMaxSubmitJobPerUserLimit", WaitsFor::Limit),
            ("QOSMaxNodePerUserLimit", WaitsFor::Limit),
            ("AssocGrpCpuLimit", WaitsFor::Limit),
            ("AssocMaxJobsLimit", WaitsFor::Limit),
            ("QOSMaxCpuPerUserLimit", WaitsFor::Limit),
            ("QOSMaxWallDurationPerJobLimit", WaitsFor::Never),
            ("QOSMaxNodePerJobLimit", WaitsFor::Never),
            ("QOSMinNode", WaitsFor::Never),
            ("AssocGrpCPUMinutesLimit", WaitsFor::Person),
            ("AssocGrpCpuMinutesLimit", WaitsFor::Person),
            ("ReqNodeNotAvail, UnavailableNodes:n4", WaitsFor::Turn),
            ("Priority", WaitsFor::Turn),
            ("DependencyNeverSatisfied", WaitsFor::Never),
            ("Moonphase", WaitsFor::Unlisted),
            ("user env retrieval failed requeued held", WaitsFor::Person),
            ("JobHeldByPlugin", WaitsFor::Person),
            ("ReservationDeleted", WaitsFor::Person),
            ("Reservation", WaitsFor::Turn),
            ("reservation maint_12 expired", WaitsFor::Person),
            ("(Reservation_Expired)", WaitsFor::Person),
        ] {
            assert_eq!(
                why(reason).waits_for,
                waits_for,
                "{reason}: {}",
                why(reason).words
            );
        }
        assert!(why("Moonphase").words.contains("Moonphase"));
        let held = why("user env retrieval failed requeued held").words;
        assert!(
            held.starts_with("held, ") && held.contains("scontrol release"),
            "{held}"
        );
        let gone = why("ReservationDeleted").words;
        assert!(
            gone.contains("was deleted or has ended") && gone.contains("scontrol release JOB"),
            "{gone}"
        );
        let job = JobId {
            job: 4711,
            element: Some(2),
        };
        let told = why("ReservationDeleted").words_for(job);
        for command in [
            "scontrol update JobId=4711_2 ReservationName=NAME",
            "scontrol release 4711_2",
            "scancel 4711_2",
        ] {
            assert!(told.contains(command), "{told}");
        }
        assert!(!told.contains("JOB"), "{told}");
        // Slurm holds a job of a reservation that ended as an administrator does.
        let held = why("JobHeldAdmin").words;
        assert!(held.contains("its reservation has ended"), "{held}");
        let own = why("reservation maint_12 expired").words;
        assert!(
            own.contains("'reservation maint_12 expired'") && own.contains("scancel"),
            "{own}"
        );
    }
}
