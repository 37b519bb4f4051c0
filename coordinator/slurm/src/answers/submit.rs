//! Answers of `sbatch --parsable`: accepted, refused, or doubtful.
//!
//! A doubtful answer is not a failure, because an `sbatch` that timed out may have submitted. The
//! job is looked up by its name and adopted if it is found. A refusal is accepted only in the words
//! of the controller or of sbatch's own checks.

use super::{Exit, Output, first_line};
use crate::job::{JobId, number};
use crate::reason::{self, WaitsFor};

/// Result of a submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Submission {
    /// Slurm accepted the job under this number (of the array, for an array).
    Accepted {
        /// Number of the job.
        job: JobId,
        /// Cluster that sbatch named, in a federation.
        cluster: Option<String>,
    },
    /// Slurm refused the job for this reason. A demand for memory or nodes that no node meets may
    /// leave a row with the job's name in state FAILED and reason BadConstraints, although the job
    /// never ran.
    Refused(Refusal),
    /// Slurm may have accepted the job: its name must be looked up before anything else.
    Doubtful {
        /// Description of the answer.
        why: String,
    },
}

impl Submission {
    /// Whether the same job may be submitted again under its name: it was refused for now.
    #[must_use]
    pub fn may_be_repeated(&self) -> bool {
        matches!(self, Self::Refused(refusal) if refusal.may_pass())
    }
}

/// A refusal in Slurm's words, with its consequence for the next attempt.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Consequence for the next attempt.
    pub kind: RefusalKind,
    /// Message of Slurm, with the detail first.
    pub said: String,
}

impl Refusal {
    /// Whether the same job may be accepted later without a person's help.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        !matches!(self.kind, RefusalKind::Impossible | RefusalKind::Person)
    }

    /// What a person does about it, where the message names the fault.
    #[must_use]
    pub fn remedy(&self) -> Option<&'static str> {
        let words = self.said.to_lowercase();
        let (_, remedy) = REMEDIES.iter().find(|(of, _)| words.contains(of))?;
        Some(remedy)
    }
}

/// Remedies, by what a message is about; the first that fits counts.
const REMEDIES: &[(&str, &str)] = &[
    (
        "reservation",
        "`scontrol show reservation` lists those that hold, with begin and end; scripts name none, so that the \
         partition, the QoS or a plugin of the site chose it: correct the site profile, or ask the site",
    ),
    (
        "account",
        "check executor.slurm.account: `sacctmgr show assoc user=$USER` lists yours",
    ),
    (
        "qos",
        "correct qos in [[queue]] of the site profile: `sacctmgr show assoc user=$USER format=qos` lists yours",
    ),
    (
        "partition",
        "correct partition in [[queue]] of the site profile: `sinfo` lists the partitions",
    ),
];

/// Consequence of a refusal for the next attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalKind {
    /// A limit on all jobs of the user or account is reached. It passes once other jobs have ended.
    Limit,
    /// Slurm refers to a policy without naming it. It is treated as a limit, but reported to a
    /// person sooner.
    UnnamedPolicy,
    /// The controller accepts no jobs at present.
    Busy,
    /// A budget is spent or an account closed, so a person has to act.
    Person,
    /// The demand can never be met, so the same job is never submitted again.
    Impossible,
}

/// Messages after "Batch job submission failed:", with their consequences. Any other message is
/// doubtful.
const FAILURES: &[(&str, RefusalKind)] = {
    use RefusalKind::{Busy, Impossible, Person};
    &[
        (
            "Invalid account or account/partition combination specified",
            Person,
        ),
        ("Invalid qos specification", Impossible),
        ("Invalid partition name specified", Impossible),
        ("Requested node configuration is not available", Impossible),
        ("Node count specification invalid", Impossible),
        ("More processors requested than permitted", Impossible),
        ("Memory required by task is not available", Impossible),
        ("Requested time limit is invalid", Impossible),
        ("Requested partition configuration not available now", Busy),
        ("Required partition not available", Busy),
        ("Required node not available", Busy),
        ("Invalid job array specification", Impossible),
        ("Job dependency problem", Impossible),
        ("Invalid feature specification", Impossible),
        ("Requested reservation is invalid", Impossible),
        ("Requested reservation not usable now", Busy),
        ("Access denied to requested reservation", Person),
        ("Invalid license specification", Impossible),
        ("Invalid wckey specification", Impossible),
        ("Invalid generic resource (gres) specification", Impossible),
        (
            "Invalid Trackable RESource (TRES) specification",
            Impossible,
        ),
        ("Invalid node name specified", Impossible),
        ("Access/permission denied", Person),
        ("User's group not permitted to use this partition", Person),
        ("Invalid directory", Impossible),
        (
            "Pathname of a file, directory or other parameter too long",
            Impossible,
        ),
        ("Unspecified error", Busy),
        ("Slurm temporarily unable to accept job", Busy),
        ("Resource temporarily unavailable", Busy),
    ]
};

/// Reads the answer to [`crate::commands::submit`].
#[must_use]
pub fn read(output: &Output) -> Submission {
    match output.exit {
        Exit::Code(0) => accepted(&output.stdout),
        Exit::Code(code) => failed(code, &output.stderr),
        Exit::Signal(signal) => Submission::Doubtful {
            why: format!("sbatch was killed by signal {signal}"),
        },
        Exit::TimedOut => Submission::Doubtful {
            why: "sbatch timed out".to_owned(),
        },
    }
}

/// Reads `12` or `12;cluster`, alone on its line. Lines with different jobs are doubtful.
fn accepted(stdout: &str) -> Submission {
    let mut found = Vec::new();
    // Only whole lines count, because a cut number is a different number.
    for line in stdout
        .split_inclusive('\n')
        .filter_map(|line| line.strip_suffix('\n'))
    {
        let line = line.strip_suffix('\r').unwrap_or(line);
        let (id, cluster) = line
            .split_once(';')
            .map_or((line, None), |(id, cluster)| (id, Some(cluster)));
        let named = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        let good = cluster.is_none_or(|cluster| !cluster.is_empty() && cluster.chars().all(named));
        if let (true, Some(job)) = (good, number::<u64>(id).filter(|job| *job > 0)) {
            found.push((job, cluster.map(str::to_owned)));
        }
    }
    found.dedup();
    match found.as_slice() {
        [(job, cluster)] => Submission::Accepted {
            job: JobId::single(*job),
            cluster: cluster.clone(),
        },
        [] => Submission::Doubtful {
            why: format!(
                "sbatch succeeded but printed no job id: '{}'",
                first_line(stdout)
            ),
        },
        more => Submission::Doubtful {
            why: format!("sbatch printed {} different job ids", more.len()),
        },
    }
}

fn failed(code: i32, stderr: &str) -> Submission {
    let said = |wanted: &str| {
        stderr
            .lines()
            .find_map(|line| line.split_once(wanted).map(|(_, rest)| rest.trim()))
    };
    // With `--test-only` the message is "allocation failure: …".
    let last = said("Batch job submission failed: ").or_else(|| said("allocation failure: "));
    if let Some(last) = last {
        let mut details = stderr
            .lines()
            .filter_map(|line| line.trim().strip_prefix("sbatch: error: "))
            .map(str::trim);
        let detail = details.rfind(|detail| !detail.starts_with("Batch job submission failed"));
        let said = detail.map_or_else(|| last.to_owned(), |detail| format!("{detail} ({last})"));
        if last.starts_with("Job violates accounting/QOS policy") {
            let kind = match detail.and_then(reason::limit).map(|why| why.waits_for) {
                Some(WaitsFor::Limit) => RefusalKind::Limit,
                Some(WaitsFor::Never) => RefusalKind::Impossible,
                Some(WaitsFor::Person) => RefusalKind::Person,
                _ => RefusalKind::UnnamedPolicy,
            };
            return Submission::Refused(Refusal { kind, said });
        }
        if let Some((_, kind)) = FAILURES.iter().find(|(start, _)| last.starts_with(start)) {
            // A plugin of the site says what has ended; Slurm itself adds "Unspecified error" to it, which
            // would pass.
            let kind = match *kind {
                RefusalKind::Busy if reason::has_ended(&said.to_lowercase()) => RefusalKind::Person,
                kind => kind,
            };
            return Submission::Refused(Refusal { kind, said });
        }
        return Submission::Doubtful { why: said };
    }
    // Messages of sbatch's own checks, which precede its contact with the controller.
    for own in [
        "unrecognized option",
        "invalid option",
        "option requires an argument",
        "Unable to open file",
    ] {
        if let Some(line) = stderr
            .lines()
            .find(|line| line.starts_with("sbatch: ") && line.contains(own))
        {
            let said = line
                .trim_start_matches("sbatch: ")
                .trim_start_matches("error: ")
                .to_owned();
            return Submission::Refused(Refusal {
                kind: RefusalKind::Impossible,
                said,
            });
        }
    }
    Submission::Doubtful {
        why: format!(
            "sbatch ended with exit code {code}: '{}'",
            first_line(stderr)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::recorded;
    use super::{Exit, Output, RefusalKind, Submission, read};
    use proptest::prelude::*;

    fn good(stdout: &str) -> Submission {
        read(&Output {
            exit: Exit::Code(0),
            stdout: stdout.to_owned(),
            stderr: String::new(),
        })
    }

    #[test]
    fn what_a_real_slurm_answered() {
        let mut table = String::new();
        for name in recorded::names("sbatch-") {
            if !name.contains("test-only") || name.contains("refused") {
                table += &format!("{name}: {:?}\n", read(&recorded::output(&name)));
            }
        }
        insta::assert_snapshot!(table);
    }

    #[test]
    fn banners_and_clusters() {
        let banner = "** Maintenance on 12 March **\n\n4711;archer2\n";
        let Submission::Accepted { job, cluster } = good(banner) else {
            panic!("an id below a banner")
        };
        assert_eq!(
            (job.to_string().as_str(), cluster.as_deref()),
            ("4711", Some("archer2"))
        );
        for odd in [
            "",
            "\n",
            "12",
            "Submitted batch job 12",
            "12\n13\n",
            "0",
            "-3",
            "12 ",
            "12;",
            "12;a b",
            "99999999999999999999",
        ] {
            assert!(matches!(good(odd), Submission::Doubtful { .. }), "{odd:?}");
        }
        let cut = read(&Output {
            exit: Exit::TimedOut,
            stdout: "12\n".to_owned(),
            stderr: String::new(),
        });
        assert!(
            matches!(cut, Submission::Doubtful { .. }),
            "who did not end well is not believed"
        );
    }

    #[test]
    fn a_limit_passes_and_a_demand_does_not() {
        let kind = |name: &str| match read(&recorded::output(name)) {
            Submission::Refused(refusal) => refusal.kind,
            other => panic!("{name}: {other:?}"),
        };
        assert_eq!(kind("sbatch-refused-submit-limit"), RefusalKind::Limit);
        assert_eq!(kind("sbatch-refused-walltime"), RefusalKind::Impossible);
        assert_eq!(kind("sbatch-refused-qos-size"), RefusalKind::Impossible);
        assert_eq!(kind("sbatch-refused-account"), RefusalKind::Person);
        assert!(matches!(
            read(&recorded::output("sbatch-frozen")),
            Submission::Doubtful { .. }
        ));
        assert!(matches!(
            read(&recorded::output("sbatch-no-slurmctld")),
            Submission::Doubtful { .. }
        ));
    }

    #[test]
    fn what_a_person_must_mend_is_told_apart_from_what_passes() {
        let kind = |why: &str| {
            let stderr = format!("sbatch: error: Batch job submission failed: {why}\n");
            match read(&Output {
                exit: Exit::Code(1),
                stdout: String::new(),
                stderr,
            }) {
                Submission::Refused(refusal) => (refusal.said == why).then_some(refusal.kind),
                _ => None,
            }
        };
        for (why, wanted) in [
            ("Requested reservation is invalid", RefusalKind::Impossible),
            (
                "Access denied to requested reservation",
                RefusalKind::Person,
            ),
            (
                "Invalid account or account/partition combination specified",
                RefusalKind::Person,
            ),
            ("Invalid partition name specified", RefusalKind::Impossible),
            ("Invalid qos specification", RefusalKind::Impossible),
            ("Requested reservation not usable now", RefusalKind::Busy),
            (
                "Slurm temporarily unable to accept job, sleeping and retrying",
                RefusalKind::Busy,
            ),
        ] {
            assert_eq!(kind(why), Some(wanted), "{why}");
        }
        // The first line is the site's own, from its plugin.
        let expired = read(&Output {
            exit: Exit::Code(1),
            stdout: String::new(),
            stderr: "sbatch: error: reservation course_12 of your project expired on 1 March\n\
                     sbatch: error: Batch job submission failed: Unspecified error\n"
                .to_owned(),
        });
        let Submission::Refused(refusal) = expired else {
            panic!("{expired:?}")
        };
        assert_eq!(refusal.kind, RefusalKind::Person);
        assert!(
            refusal
                .said
                .starts_with("reservation course_12 of your project expired on 1 March"),
            "{}",
            refusal.said
        );
        assert!(
            refusal
                .remedy()
                .unwrap()
                .contains("scontrol show reservation")
        );
        assert_eq!(
            kind("Zero Bytes were transmitted or received"),
            None,
            "what no table has is looked up"
        );
    }

    proptest! {
        #[test]
        fn a_job_is_never_invented(stdout in "(\\PC|\n){0,80}", stderr in "(\\PC|\n){0,80}", code in 0..3_i32) {
            let output = Output { exit: Exit::Code(code), stdout: stdout.clone(), stderr };
            if let Submission::Accepted { job, .. } = read(&output) {
                prop_assert_eq!(code, 0);
                let said = stdout.lines().any(|line| line.split(';').next().and_then(|id| id.parse::<u64>().ok()) == Some(job.job));
                prop_assert!(said);
            }
        }

        #[test]
        fn an_id_survives_any_banner(before in "([^;\n]*[a-z* ]\n){0,3}", id in 1_u64..1_000_000_000) {
            let said = format!("{before}{id}\n");
            match good(&said) {
                Submission::Accepted { job, .. } => prop_assert_eq!(job.job, id),
                other => prop_assert!(false, "{:?}", other),
            }
        }
    }
}
