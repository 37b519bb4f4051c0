//! Text of a batch script.
//!
//! Every script has `--no-requeue` (a retry is decided by the coordinator and runs in a new
//! directory), a unique job name, appended output and nothing of the submitter's environment. Slurm
//! sends it a warning before its walltime, which it passes on to the driver.
//!
//! Where simulations run on threads, each node has a driver. Where they run on MPI ranks, the script
//! itself starts one driver, which makes each simulation a step of the job on the nodes of its
//! place. The driver is no step, so that it takes no core and no memory of the job.

use crate::directives::{EXCLUDE, can_stand_in_directive};
use crate::job::JobName;
use crate::site::{Queue, Site, Unit};
use crate::walltime;

/// A job from which a script is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Unique name of the job.
    pub name: JobName,
    /// Name of the account; `None` if the site needs none.
    pub account: Option<String>,
    /// Absolute path of the submission's folder, in which the job runs and writes its log.
    pub folder: String,
    /// Walltime, s; rounded up to whole minutes, the unit in which Slurm counts.
    pub walltime_s: u64,
    /// Time between the warning and the end of the job, s. Slurm may warn up to 60 s too early.
    pub warning_s: u64,
    /// Number of nodes of a job, or of each element of an array.
    pub n_nodes: u32,
    /// Number of cores on a queue that gives single cores; otherwise whole nodes are taken.
    pub n_cores: u32,
    /// Memory of a node, MiB, on a queue that gives single cores.
    pub memory_mib: Option<u64>,
    /// Names of nodes on which the job must not run, such as nodes that failed before.
    pub exclude: Vec<String>,
    /// Array; `None` for a single job.
    pub array: Option<Array>,
    /// Path of the program that the job runs, then its arguments.
    pub command: Vec<String>,
    /// Processes that run the command.
    pub drivers: Drivers,
}

/// An array with indices from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Array {
    /// Number of elements, with indices 0 to `n` − 1.
    pub n: u32,
    /// Largest number of elements at once; `None` means no throttle.
    pub at_once: Option<u32>,
}

/// Processes that run the command of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drivers {
    /// One on every node: a driver that itself uses every core of its node. The index of the array
    /// is in `SLURM_ARRAY_TASK_ID`.
    PerNode,
    /// One, started by the script itself on the job's first node: a driver that makes steps. The
    /// names of the job's nodes are in [`HOSTS`].
    PerJob,
}

/// Name of the environment variable with the names of the job's nodes, separated by blanks.
pub const HOSTS: &str = "CARDIOTWIN_HOSTS";

/// Reason why no script is made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ScriptError {
    /// A text that cannot be part of a script.
    #[error("{what} '{found}' is not allowed in a batch script: {why}")]
    Text {
        /// Name of the text.
        what: &'static str,
        /// Text as it was given.
        found: String,
        /// Reason why it cannot be part of a script.
        why: &'static str,
    },
    /// The site needs an account, but the settings name none.
    #[error("site {site} needs an account: set executor.slurm.account")]
    NoAccount {
        /// Name of the site.
        site: String,
    },
    /// The job exceeds a limit of the queue.
    #[error("job {name}: {what} is {asked}, but queue '{queue}' allows {limit}")]
    Limit {
        /// Name of the job.
        name: String,
        /// Name of the measure.
        what: &'static str,
        /// Amount that the job requests of this measure.
        asked: u64,
        /// Name of the queue.
        queue: String,
        /// Limit of the queue.
        limit: u64,
    },
}

/// A word for bash, quoted if necessary.
fn quoted(word: &str) -> String {
    let plain = |b: u8| {
        b.is_ascii_alphanumeric()
            || matches!(
                b,
                b'-' | b'_' | b'.' | b'/' | b'=' | b':' | b',' | b'+' | b'@'
            )
    };
    if !word.is_empty() && word.bytes().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

fn command_line(words: &[String]) -> String {
    words
        .iter()
        .map(|word| quoted(word))
        .collect::<Vec<_>>()
        .join(" ")
}

/// Checks a value for a `#SBATCH` line.
fn directive(what: &'static str, value: &str) -> Result<String, ScriptError> {
    if can_stand_in_directive(value) {
        return Ok(value.to_owned());
    }
    Err(ScriptError::Text {
        what,
        found: value.to_owned(),
        why: "it is empty or contains a blank, a quote, '\\', '#' or '%'",
    })
}

fn check(job: &Job, queue: &Queue, site: &Site) -> Result<(), ScriptError> {
    let limits = [
        (
            "walltime, s",
            job.walltime_s.div_ceil(60) * 60,
            Some(queue.walltime_s()),
        ),
        (
            "number of nodes",
            u64::from(job.n_nodes),
            queue.max_nodes_per_job.or(queue.nodes).map(u64::from),
        ),
        (
            "number of elements",
            job.array.map_or(0, |a| u64::from(a.n)),
            Some(u64::from(site.arrays.max_size)).filter(|_| site.arrays.allowed),
        ),
        (
            "number of elements",
            job.array.map_or(0, |a| u64::from(a.n)),
            (!site.arrays.allowed).then_some(0),
        ),
    ];
    for (what, asked, limit) in limits {
        if let Some(limit) = limit.filter(|limit| asked > *limit) {
            return Err(ScriptError::Limit {
                name: job.name.to_string(),
                what,
                asked,
                queue: queue.name.clone(),
                limit,
            });
        }
    }
    let words = job.command.iter();
    if let Some(word) = words
        .chain([&job.folder])
        .find(|word| word.contains(['\n', '\r', '\0']))
    {
        return Err(ScriptError::Text {
            what: "an argument",
            found: word.clone(),
            why: "it contains a line break",
        });
    }
    Ok(())
}

/// Writes the script.
///
/// # Errors
/// [`ScriptError`] if the site or the queue does not allow the job, or a text cannot be part of a
/// script.
pub fn write(job: &Job, queue: &Queue, site: &Site) -> Result<String, ScriptError> {
    check(job, queue, site)?;
    let mut lines = vec!["#!/bin/bash".to_owned()];
    let mut option = |line: String| lines.push(format!("#SBATCH {line}"));
    option(format!("--job-name={}", job.name));
    match &job.account {
        Some(account) => option(format!("--account={}", directive("account", account)?)),
        None if site.needs_account => {
            return Err(ScriptError::NoAccount {
                site: site.name.clone(),
            });
        }
        None => {}
    }
    if let Some(partition) = &queue.partition {
        option(format!(
            "--partition={}",
            directive("partition", partition)?
        ));
    }
    if let Some(qos) = &queue.qos {
        option(format!("--qos={}", directive("QoS", qos)?));
    }
    option(format!(
        "--time={}",
        walltime::text(job.walltime_s.div_ceil(60).max(1) * 60)
    ));
    option(format!("--nodes={}", job.n_nodes));
    let whole_nodes = queue.unit.unwrap_or(site.node.unit) == Unit::Node;
    let n_cores = if whole_nodes {
        site.node.cores
    } else {
        job.n_cores
    };
    // mpirun takes the number of tasks for the number of ranks that a node may have.
    let (n_tasks, n_cores_per_task) = match job.drivers {
        Drivers::PerJob => (n_cores, 1),
        Drivers::PerNode => (1, n_cores),
    };
    option(format!("--ntasks-per-node={n_tasks}"));
    option(format!("--cpus-per-task={n_cores_per_task}"));
    if whole_nodes {
        option("--exclusive".to_owned());
    } else if let Some(memory) = job.memory_mib {
        option(format!("--mem={memory}M"));
    }
    if let Some(array) = job.array {
        let throttle = array.at_once.map(|n| format!("%{n}")).unwrap_or_default();
        option(format!("--array=0-{}{throttle}", array.n.saturating_sub(1)));
    }
    let (excluded, further): (Vec<&String>, Vec<&String>) =
        (site.directives.iter()).partition(|text| text.starts_with(EXCLUDE));
    let exclude: Vec<&str> = (excluded.iter().map(|text| &text[EXCLUDE.len()..]))
        .chain(job.exclude.iter().map(String::as_str))
        .collect();
    if !exclude.is_empty() {
        option(format!(
            "{EXCLUDE}{}",
            directive("list of nodes", &exclude.join(","))?
        ));
    }
    for text in further {
        option(text.clone());
    }
    option("--no-requeue".to_owned());
    option("--open-mode=append".to_owned());
    option("--export=NONE".to_owned());
    option(format!("--signal=B:USR1@{}", job.warning_s));
    // sbatch gets the folder on its command line, too, which accepts any name.
    if let Ok(folder) = directive("folder", &job.folder) {
        option(format!("--chdir={folder}"));
    }
    option(format!(
        "--output={}",
        if job.array.is_some() {
            "slurm-%A_%a.log"
        } else {
            "slurm-%j.log"
        }
    ));
    lines.push(String::new());
    lines.push("set -u".to_owned());
    lines.push("unset SLURM_EXPORT_ENV # srun's steps get this script's environment".to_owned());
    lines.extend(site.setup.iter().cloned());
    lines.push(format!(
        "seconds=$(({}))",
        job.walltime_s.div_ceil(60).max(1) * 60
    ));
    lines.push(format!("warning={}", job.warning_s + 60));
    lines.push(COMMON.trim_end().to_owned());
    let command = command_line(&job.command);
    match job.drivers {
        Drivers::PerNode => {
            let launcher = command_line(&site.launcher.command);
            lines.push(format!(
                "{launcher} --ntasks=\"$SLURM_NNODES\" --ntasks-per-node=1 {command} &"
            ));
        }
        Drivers::PerJob => {
            lines.push(format!(
                "{HOSTS}=$(scontrol show hostnames \"$SLURM_JOB_NODELIST\" | tr '\\n' ' ')"
            ));
            lines.push(format!("export {HOSTS}"));
            lines.push(format!("{command} &"));
        }
    }
    lines.push(WAIT.trim_end().to_owned());
    Ok(lines.join("\n") + "\n")
}

/// Begin of every script's commands. bash handles a signal only between commands in the
/// foreground, which is why the script uses `wait`, and waits again after the warning.
const COMMON: &str = r#"began=$(date +%s) warned=0 driver=
export CARDIOTWIN_LEAVE_AT=$((began + seconds - warning)) # when the driver must have left
trap 'warned=1; [ -z "$driver" ] || kill -USR1 "$driver" 2>/dev/null' USR1
"#;

/// End of every script. A warning that arrived before the driver's process was known is passed on.
const WAIT: &str = r#"driver=$!
[ "$warned" = 0 ] || kill -USR1 "$driver" 2>/dev/null
wait "$driver"; code=$?
while kill -0 "$driver" 2>/dev/null; do wait "$driver"; code=$?; done
if [ "$code" -gt 128 ]; then # the warning's number, if the driver ended while it was passed on
    wait "$driver" 2>/dev/null; last=$?
    [ "$last" = 127 ] || code=$last
fi
exit "$code"
"#;

#[cfg(test)]
mod tests {
    use super::{Array, Drivers, Job, ScriptError, write};
    use crate::directives::check_directive;
    use crate::job::JobName;
    use crate::site::Use;
    use crate::site::tests::shipped as site;
    use std::process::Command;

    fn simulations(n_nodes: u32) -> Job {
        Job {
            name: JobName::new("ct-coa-b1-g1").expect("a name"),
            account: Some("t01".to_owned()),
            folder: "/data/run/slurm/ct-coa-b1-g1".to_owned(),
            walltime_s: 7201,
            warning_s: 120,
            n_nodes,
            n_cores: 128,
            memory_mib: None,
            exclude: vec!["n4".to_owned(), "n[7-8]".to_owned()],
            array: None,
            command: ["cardiotwin", "drive", "/data/my run/slurm/it's"]
                .map(str::to_owned)
                .to_vec(),
            drivers: Drivers::PerJob,
        }
    }

    fn chunks() -> Job {
        Job {
            n_nodes: 1,
            n_cores: 4,
            memory_mib: Some(4000),
            exclude: Vec::new(),
            array: Some(Array {
                n: 352,
                at_once: Some(16),
            }),
            command: vec![
                "cardiotwin-worker".to_owned(),
                "run".to_owned(),
                "chunk".to_owned(),
            ],
            drivers: Drivers::PerNode,
            ..simulations(1)
        }
    }

    #[test]
    fn scripts_as_they_are_submitted() {
        let archer2 = site("archer2");
        let taskfarm = archer2.queue(None, Use::Simulations).expect("a queue");
        insta::assert_snapshot!(
            "simulations_archer2",
            write(&simulations(8), taskfarm, &archer2).expect("a script")
        );
        insta::assert_snapshot!(
            "chunks_archer2",
            write(&chunks(), taskfarm, &archer2).expect("a script")
        );
        let generic = site("generic");
        let queue = generic.queue(None, Use::Chunks).expect("a queue");
        insta::assert_snapshot!(
            "chunks_generic",
            write(&chunks(), queue, &generic).expect("a script")
        );
    }

    #[test]
    fn bash_understands_them() {
        let archer2 = site("archer2");
        let taskfarm = archer2.queue(None, Use::Simulations).expect("a queue");
        for job in [simulations(8), chunks()] {
            let script = write(&job, taskfarm, &archer2).expect("a script");
            let output = Command::new("bash")
                .args(["-n", "-c", &script])
                .output()
                .expect("bash is there");
            assert!(
                output.status.success() && output.stderr.is_empty(),
                "{}",
                String::from_utf8_lossy(&output.stderr)
            );
        }
    }

    /// The warning reaches the driver, whose exit code is the job's. The driver sends the warning
    /// once everything is set up.
    #[test]
    fn a_warning_is_handed_on() {
        let mut archer2 = site("archer2");
        archer2.setup = Vec::new();
        archer2.launcher.command = vec!["env".to_owned()];
        let taskfarm = archer2
            .queue(None, Use::Simulations)
            .expect("a queue")
            .clone();
        let command =
            "sleep 600 & nap=$!; trap 'kill $nap; exit 7' USR1; kill -USR1 $PPID; wait; exit 8";
        for drivers in [Drivers::PerNode, Drivers::PerJob] {
            let job = Job {
                command: ["bash", "-c", command].map(str::to_owned).to_vec(),
                drivers,
                ..simulations(1)
            };
            let script = write(&job, &taskfarm, &archer2).expect("a script");
            // `env` does not accept srun's options, and there is no scontrol here.
            let script = script
                .replace(
                    "env --ntasks=\"$SLURM_NNODES\" --ntasks-per-node=1 bash",
                    "env bash",
                )
                .replace("scontrol show hostnames", "echo");
            let output = Command::new("bash")
                .args(["-c", &script])
                .env("SLURM_JOB_NODELIST", "n1")
                .output()
                .expect("bash is there");
            assert_eq!(String::from_utf8_lossy(&output.stderr), "");
            assert_eq!(output.status.code(), Some(7), "{script}");
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let archer2 = site("archer2");
        let taskfarm = archer2.queue(None, Use::Simulations).expect("a queue");
        let refused = |change: fn(&mut Job)| {
            let mut job = simulations(8);
            change(&mut job);
            write(&job, taskfarm, &archer2).expect_err("it cannot be")
        };
        assert!(matches!(
            refused(|job| job.account = None),
            ScriptError::NoAccount { .. }
        ));
        assert!(matches!(
            refused(|job| job.n_nodes = 17),
            ScriptError::Limit { .. }
        ));
        assert!(matches!(
            refused(|job| job.walltime_s = 86_401),
            ScriptError::Limit { .. }
        ));
        assert!(matches!(
            refused(|job| job.array = Some(Array {
                n: 1002,
                at_once: None
            })),
            ScriptError::Limit { .. }
        ));
        assert!(matches!(
            refused(|job| job.folder = "/data/my\nrun".to_owned()),
            ScriptError::Text { .. }
        ));
        let odd = Job {
            folder: "/data/it's 50 % \"run\"".to_owned(),
            ..simulations(8)
        };
        let script = write(&odd, taskfarm, &archer2).expect("a script");
        assert!(!script.contains("--chdir") && !script.contains("50 %"));
        assert!(matches!(
            refused(|job| job.account = Some("t01\n#SBATCH -N 99".to_owned())),
            ScriptError::Text { .. }
        ));
    }

    #[test]
    fn directives_of_profile_and_settings_stand_in_every_script() {
        let mut archer2 = site("archer2");
        archer2.directives = ["--reservation=dev", "--exclude=nid1", "--hint=multithread"]
            .map(str::to_owned)
            .to_vec();
        let queue = archer2
            .queue(None, Use::Simulations)
            .expect("a queue")
            .clone();
        let job = Job {
            exclude: vec!["nid2".to_owned()],
            ..simulations(1)
        };
        let text = write(&job, &queue, &archer2).expect("a script");
        let options: Vec<&str> = (text.lines())
            .filter_map(|line| line.strip_prefix("#SBATCH "))
            .collect();
        for option in [
            "--reservation=dev",
            "--exclude=nid1,nid2",
            "--hint=multithread",
        ] {
            let n = options.iter().filter(|found| **found == option).count();
            assert_eq!(n, 1, "{option}: {options:?}");
        }
    }

    /// Every option that a script can have is refused as a directive.
    #[test]
    fn no_directive_can_replace_an_option_of_the_script() {
        let archer2 = site("archer2");
        let queue = archer2
            .queue(None, Use::Simulations)
            .expect("a queue")
            .clone();
        let job = Job {
            exclude: Vec::new(),
            ..simulations(2)
        };
        let text = write(&job, &queue, &archer2).expect("a script");
        for line in text
            .lines()
            .filter_map(|line| line.strip_prefix("#SBATCH "))
        {
            assert!(check_directive(line).is_err(), "{line}");
        }
    }
}
