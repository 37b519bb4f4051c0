//! Slurm's commands as programs with arguments. The caller sets [`ENVIRONMENT`], gives each command
//! a time limit, and passes its output to [`crate::answers`].

use crate::answers::{accounting as sacct, qos as sacctmgr, queue as squeue, usage as sacct_usage};
use crate::job::{JobId, JobName};

/// Variables set for every command: times in seconds since 1970 (a local time has no zone) and
/// messages in English.
pub const ENVIRONMENT: &[(&str, &str)] = &[("SLURM_TIME_FORMAT", "%s"), ("LC_ALL", "C")];
/// Beginnings of the variables that Slurm's commands read as options, or that a job around this
/// program left.
const READ_BY_SLURM: [&str; 5] = ["SBATCH_", "SQUEUE_", "SACCT_", "SCANCEL_", "SLURM_"];
/// Variables of Slurm that name the cluster and the asker, and that stay.
const KEPT: [&str; 6] = [
    "SLURM_CONF",
    "SLURM_CONF_SERVER",
    "SLURM_JWT",
    "SLURM_SACK_KEY",
    "SLURM_SACK_JWKS",
    "SLURM_ROOT",
];

/// Whether a variable is removed for every command. Options in the environment go before those in a
/// script: with them, a job would go to another partition or budget than `plan` and the script say.
#[must_use]
pub fn is_removed(name: &str) -> bool {
    READ_BY_SLURM.iter().any(|begin| name.starts_with(begin)) && !KEPT.contains(&name)
}

/// The variables among `names` that would have changed a submission and are not passed on; a caller
/// shows them with their values. Variables of a job around this program are left out.
#[must_use]
pub fn without_effect<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut found: Vec<&str> = names
        .filter(|name| name.starts_with("SBATCH_") || *name == "SLURM_CLUSTERS")
        .collect();
    found.sort_unstable();
    found
}

/// A command to run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Command {
    /// Name of the program, found by `PATH`.
    pub program: &'static str,
    /// Arguments of the program.
    pub arguments: Vec<String>,
}

impl Command {
    fn new<A: Into<String>>(program: &'static str, arguments: impl IntoIterator<Item = A>) -> Self {
        Self {
            program,
            arguments: arguments.into_iter().map(Into::into).collect(),
        }
    }
}

/// Command that submits a script and prints only the number of the job, which runs in `folder`.
#[must_use]
pub fn submit(folder: &str, script: &str) -> Command {
    let folder = format!("--chdir={folder}");
    Command::new("sbatch", ["--parsable", &folder, script])
}

/// Asks whether a script would be accepted, without submitting it.
#[must_use]
pub fn test_only(script: &str) -> Command {
    Command::new("sbatch", ["--test-only", script])
}

/// Lists all jobs of the user, because limits count them all, and jobs that ended a short while
/// ago. A single call covers any number of jobs. `--jobs` is not used because it fails if one of
/// the jobs is unknown.
#[must_use]
pub fn queue() -> Command {
    Command::new(
        "squeue",
        [
            "--me",
            "--array",
            "--states=all",
            &format!("--format={}", squeue::FORMAT),
        ],
    )
}

/// Lists past jobs by name since the first intent (`since_s`, seconds since 1970); without names,
/// all jobs of the user. Without `--starttime` sacct begins at midnight; without `--duplicates` it
/// hides a NODE_FAIL behind a requeue.
///
/// The answer never contains jobs that were cancelled before they were eligible (held, or not
/// begun).
#[must_use]
pub fn accounting(names: &[JobName], since_s: i64) -> Command {
    let mut arguments = vec![
        "--allocations".to_owned(),
        "--duplicates".to_owned(),
        "--parsable".to_owned(),
        "--noconvert".to_owned(),
        format!("--starttime=uts{}", since_s.max(0)),
        format!("--format={}", sacct::COLUMNS),
    ];
    if !names.is_empty() {
        arguments.push(format!(
            "--name={}",
            names
                .iter()
                .map(JobName::as_str)
                .collect::<Vec<_>>()
                .join(",")
        ));
    }
    Command {
        program: "sacct",
        arguments,
    }
}

/// Asks what jobs of these names used since the first intent (`since_s`, seconds since 1970). Unlike
/// [`accounting`] it lists steps, too: Slurm 22.05 gives a job no processor time with `--allocations`.
#[must_use]
pub fn usage(names: &[JobName], since_s: i64) -> Command {
    let names: Vec<&str> = names.iter().map(JobName::as_str).collect();
    Command::new(
        "sacct",
        [
            "--duplicates".to_owned(),
            "--parsable".to_owned(),
            "--noconvert".to_owned(),
            format!("--starttime=uts{}", since_s.max(0)),
            format!("--format={}", sacct_usage::COLUMNS),
            format!("--name={}", names.join(",")),
        ],
    )
}

/// Cancels jobs by number. With `--quiet`, an ended job is no error of scancel.
#[must_use]
pub fn cancel(jobs: &[JobId]) -> Command {
    Command::new(
        "scancel",
        std::iter::once("--quiet".to_owned()).chain(jobs.iter().map(ToString::to_string)),
    )
}

/// Cancels all of the user's jobs of a name, for a submission with an unknown number.
#[must_use]
pub fn cancel_name(name: &JobName) -> Command {
    Command::new("scancel", ["--quiet", "--me", &format!("--name={name}")])
}

/// Shows the site's configuration.
#[must_use]
pub fn config() -> Command {
    Command::new("scontrol", ["show", "config"])
}

/// Shows the limits of every QoS.
#[must_use]
pub fn qos() -> Command {
    Command::new(
        "sacctmgr",
        [
            "--parsable",
            "show",
            "qos",
            &format!("format={}", sacctmgr::COLUMNS),
        ],
    )
}

/// Shows the accounts and limits of a user.
#[must_use]
pub fn associations(user: &str) -> Command {
    let columns = format!("format={}", sacctmgr::ASSOCIATION_COLUMNS);
    Command::new(
        "sacctmgr",
        [
            "--parsable",
            "show",
            "assoc",
            "where",
            &format!("user={user}"),
            &columns,
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::{accounting, is_removed, queue, usage, without_effect};

    /// A changed command requires its answers to be recorded again (tests/recorded/record.sh).
    #[test]
    fn the_commands_are_those_that_were_recorded() {
        let recorded = |name: &str| {
            let file = format!("{}/tests/recorded/{name}.txt", env!("CARGO_MANIFEST_DIR"));
            std::fs::read_to_string(file)
                .expect("a recorded answer")
                .lines()
                .next()
                .expect("its command")
                .to_owned()
        };
        assert_eq!(
            recorded("squeue-mixed"),
            format!("$ squeue {}", queue().arguments.join(" "))
        );
        let columns = format!(" --starttime=now-2days {}", accounting(&[], 0).arguments[5]);
        assert!(
            recorded("sacct-ended").ends_with(&columns),
            "{}",
            recorded("sacct-ended")
        );
        assert!(recorded("sacct-ended").contains(&accounting(&[], 0).arguments[..4].join(" ")));
        let used = usage(&[], 0).arguments;
        let recorded = recorded("sacct-usage");
        assert!(
            recorded.contains(&used[..3].join(" ")) && recorded.ends_with(&used[4]),
            "{recorded}"
        );
    }

    #[test]
    fn options_of_the_caller_are_removed_and_the_clusters_place_stays() {
        for name in [
            "SBATCH_ACCOUNT",
            "SBATCH_PARTITION",
            "SBATCH_QOS",
            "SBATCH_RESERVATION",
            "SBATCH_MEM_PER_CPU",
            "SLURM_JOB_ID",
            "SLURM_NTASKS",
            "SLURM_CLUSTERS",
            "SQUEUE_SORT",
            "SCANCEL_INTERACTIVE",
        ] {
            assert!(is_removed(name), "{name}");
        }
        for name in [
            "SLURM_CONF",
            "SLURM_JWT",
            "PATH",
            "CARDIOTWIN_LEAVE_AT",
            "MY_SBATCH_ACCOUNT",
        ] {
            assert!(!is_removed(name), "{name}");
        }
        let told =
            without_effect(["SLURM_JOB_ID", "SBATCH_QOS", "PATH", "SBATCH_ACCOUNT"].into_iter());
        assert_eq!(told, ["SBATCH_ACCOUNT", "SBATCH_QOS"]);
    }
}
