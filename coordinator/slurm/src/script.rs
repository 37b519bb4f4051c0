//! Text of a batch script.
//!
//! Every script has `--no-requeue` (a retry is decided by the coordinator and runs in a new
//! directory), a unique job name, appended output and nothing of the submitter's environment. Slurm
//! sends it a warning before its walltime, which it passes on to its steps. A bundle starts one
//! step per simulation, in parallel, and takes the next one while the remaining time suffices.

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
    /// Commands of the job.
    pub work: Work,
}

/// An array with indices from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Array {
    /// Number of elements, with indices 0 to `n` − 1.
    pub n: u32,
    /// Largest number of elements at once; `None` means no throttle.
    pub at_once: Option<u32>,
}

/// Commands of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Work {
    /// One command, run once on every node: a worker that itself uses every core of its node. The
    /// index of the array is in `SLURM_ARRAY_TASK_ID`.
    PerNode {
        /// Path of the program, then its arguments.
        command: Vec<String>,
    },
    /// Many MPI steps, in parallel as far as they fit, and the others as places become free.
    Bundle {
        /// Steps in the order in which they are taken.
        steps: Vec<Step>,
        /// Number of nodes of each step.
        nodes_per_step: u32,
        /// Number of ranks on each of its nodes.
        ranks_per_node: u32,
    },
}

/// One step of a bundle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Path of the program, then its arguments.
    pub command: Vec<String>,
    /// Expected duration, s. The step is not started if less time is left before the warning.
    pub predicted_s: u64,
    /// Absolute path of its log.
    pub log: String,
}

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
    /// The site needs an account, and none is set.
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

/// Checks a value for a `#SBATCH` line. Slurm splits these lines at blanks, interprets quotes and
/// `\`, and replaces `%`.
fn directive(what: &'static str, value: &str) -> Result<String, ScriptError> {
    let bad =
        |c: char| c.is_whitespace() || c.is_control() || matches!(c, '"' | '\'' | '\\' | '#' | '%');
    if value.is_empty() || value.chars().any(bad) {
        let why = "it is empty or contains a blank, a quote, '\\', '#' or '%'";
        return Err(ScriptError::Text {
            what,
            found: value.to_owned(),
            why,
        });
    }
    Ok(value.to_owned())
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
    let words = match &job.work {
        Work::PerNode { command } => command.iter().collect::<Vec<_>>(),
        Work::Bundle { steps, .. } => steps
            .iter()
            .flat_map(|step| step.command.iter().chain([&step.log]))
            .collect(),
    };
    if let Some(word) = words
        .into_iter()
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
    match &job.work {
        Work::Bundle { ranks_per_node, .. } => {
            option(format!("--ntasks-per-node={ranks_per_node}"));
            option(format!(
                "--cpus-per-task={}",
                (site.node.cores / (*ranks_per_node).max(1))
                    .max(1)
                    .min(job.n_cores.max(1))
            ));
        }
        Work::PerNode { .. } => {
            option("--ntasks-per-node=1".to_owned());
            option(format!(
                "--cpus-per-task={}",
                if whole_nodes {
                    site.node.cores
                } else {
                    job.n_cores
                }
            ));
        }
    }
    if whole_nodes {
        option("--exclusive".to_owned());
    } else if let Some(memory) = job.memory_mib {
        option(format!("--mem={memory}M"));
    }
    if let Some(array) = job.array {
        let throttle = array.at_once.map(|n| format!("%{n}")).unwrap_or_default();
        option(format!("--array=0-{}{throttle}", array.n.saturating_sub(1)));
    }
    if !job.exclude.is_empty() {
        option(format!(
            "--exclude={}",
            directive("list of nodes", &job.exclude.join(","))?
        ));
    }
    option("--no-requeue".to_owned());
    option("--open-mode=append".to_owned());
    option("--export=NONE".to_owned());
    option(format!("--signal=B:USR1@{}", job.warning_s));
    option(format!("--chdir={}", directive("folder", &job.folder)?));
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
    let launcher = command_line(&site.launcher.command);
    match &job.work {
        Work::PerNode { command } => {
            lines.push(format!(
                "{launcher} --ntasks=\"$SLURM_NNODES\" --ntasks-per-node=1 {} &",
                command_line(command)
            ));
            lines.push("started_one".to_owned());
            lines.push("settle".to_owned());
            lines.push("exit \"$worst\"".to_owned());
        }
        Work::Bundle {
            steps,
            nodes_per_step,
            ranks_per_node,
        } => {
            let n_ranks = nodes_per_step * ranks_per_node;
            let mut options = vec![
                launcher,
                "--exact".to_owned(),
                format!("--nodes={nodes_per_step}"),
                format!("--ntasks={n_ranks}"),
            ];
            options.push(format!("--ntasks-per-node={ranks_per_node}"));
            if let Some(per_core) = site.launcher.memory_per_core_mib {
                let cores = u64::from((site.node.cores / (*ranks_per_node).max(1)).max(1))
                    * u64::from(*ranks_per_node);
                options.push(format!(
                    "--mem={}M",
                    (per_core * cores).min(site.node.memory_mib)
                ));
            }
            options.extend(site.launcher.mpi.iter().map(|word| quoted(word)));
            lines.push(format!(
                "at_once={}",
                (job.n_nodes / (*nodes_per_step).max(1)).max(1)
            ));
            lines.push(format!(
                "start() {{ exec {} \"$@\"; }} # exec, so that the warning reaches the step and not a shell",
                options.join(" ")
            ));
            for step in steps {
                let log = quoted(&step.log);
                lines.push(format!(
                    "take {} {log} {}",
                    step.predicted_s,
                    command_line(&step.command)
                ));
            }
            lines.push("settle".to_owned());
            lines.push("echo \"bundle: $started started, $left left for another job\"".to_owned());
            lines.push("exit \"$worst\"".to_owned());
        }
    }
    Ok(lines.join("\n") + "\n")
}

/// Part of every script: the warning is passed on to the steps, and waiting continues after it.
/// bash handles a signal only between commands in the foreground, which is why the script uses
/// `wait`.
const COMMON: &str = r#"began=$(date +%s) warned=0 worst=0 started=0 left=0 steps=()
export CARDIOTWIN_LEAVE_AT=$((began + seconds - warning)) # when the driver or worker must have left
trap 'warned=1; for step in "${steps[@]}"; do kill -USR1 "$step" 2>/dev/null; done' USR1
reap() { # waits for the end of a step or for the warning
    local step code still=()
    wait -n
    for step in "${steps[@]}"; do
        if kill -0 "$step" 2>/dev/null; then still+=("$step"); continue; fi
        wait "$step"; code=$?
        [ "$code" -le "$worst" ] || worst=$code
    done
    steps=("${still[@]}")
}
started_one() { # passes on a warning that arrived before the step was recorded
    steps+=($!); started=$((started + 1))
    [ "$warned" = 0 ] || kill -USR1 "$!" 2>/dev/null
}
settle() { while [ "${#steps[@]}" -gt 0 ]; do reap; done; }
take() { # predicted seconds, log, command: starts it when a slot is free, if the remaining time suffices
    local predicted=$1 log=$2
    shift 2
    while [ "${#steps[@]}" -ge "$at_once" ]; do reap; done
    if [ "$warned" = 1 ] || [ $((began + seconds - warning - $(date +%s))) -lt "$predicted" ]; then left=$((left + 1)); return; fi
    start "$@" >>"$log" 2>&1 &
    started_one
}
"#;

#[cfg(test)]
mod tests {
    use super::{Array, Job, ScriptError, Step, Work, write};
    use crate::job::JobName;
    use crate::site::Use;
    use crate::site::tests::shipped as site;
    use std::os::unix::fs::PermissionsExt;
    use std::process::Command;

    fn bundle(n_nodes: u32, n_steps: usize) -> Job {
        let step = |i: usize| Step {
            command: vec!["echo".to_owned(), format!("it's {i}")],
            predicted_s: 3600,
            log: format!("/data/run/attempts/a b{i}/stderr.log"),
        };
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
            work: Work::Bundle {
                steps: (0..n_steps).map(step).collect(),
                nodes_per_step: 1,
                ranks_per_node: 128,
            },
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
            work: Work::PerNode {
                command: vec![
                    "cardiotwin-worker".to_owned(),
                    "run".to_owned(),
                    "chunk".to_owned(),
                ],
            },
            ..bundle(1, 0)
        }
    }

    #[test]
    fn scripts_as_they_are_submitted() {
        let archer2 = site("archer2");
        let taskfarm = archer2.queue(None, Use::Simulations).expect("a queue");
        insta::assert_snapshot!(
            "bundle_archer2",
            write(&bundle(8, 3), taskfarm, &archer2).expect("a script")
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
        for job in [bundle(8, 3), chunks()] {
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

    /// The script is run by bash with a launcher that only runs its command. Checks places, order,
    /// remaining time and the worst exit code.
    #[test]
    fn a_bundle_pulls_while_the_time_holds() {
        let mut archer2 = site("archer2");
        let taskfarm = archer2
            .queue(None, Use::Simulations)
            .expect("a queue")
            .clone();
        let folder = tempfile::tempdir().expect("a folder");
        let srun = folder.path().join("srun");
        std::fs::write(
            &srun,
            "#!/bin/bash\nwhile [[ $1 == --* ]]; do shift; done\nexec \"$@\"\n",
        )
        .expect("a launcher");
        std::fs::set_permissions(&srun, std::fs::Permissions::from_mode(0o755))
            .expect("it can be run");
        archer2.setup = Vec::new();
        archer2.launcher.command[0] = srun.to_string_lossy().into_owned();
        let log = folder
            .path()
            .join("log of all")
            .to_string_lossy()
            .into_owned();
        let mut job = bundle(2, 0);
        let step = |text: &str, predicted_s: u64| Step {
            command: ["bash", "-c", text].map(str::to_owned).to_vec(),
            predicted_s,
            log: log.clone(),
        };
        let too_long = job.walltime_s;
        job.work = Work::Bundle {
            steps: vec![
                step("echo 'one'; exit 3", 10),
                step("echo two", 10),
                step("echo 'never: too long'", too_long),
                step("echo three", 10),
            ],
            nodes_per_step: 1,
            ranks_per_node: 1,
        };
        let script = write(&job, &taskfarm, &archer2).expect("a script");
        let output = Command::new("bash")
            .args(["-c", &script])
            .env("SLURM_NNODES", "2")
            .output()
            .expect("bash is there");
        assert_eq!(String::from_utf8_lossy(&output.stderr), "");
        assert_eq!(
            String::from_utf8_lossy(&output.stdout),
            "bundle: 3 started, 1 left for another job\n"
        );
        assert_eq!(output.status.code(), Some(3), "the worst of its steps");
        let text = std::fs::read_to_string(&log).expect("the log");
        let mut lines = text.lines().collect::<Vec<_>>();
        lines.sort_unstable();
        assert_eq!(lines, ["one", "three", "two"]);
    }

    /// The warning reaches the running steps, and no further one is taken. The first step sends it
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
        let mut job = chunks();
        (job.array, job.n_nodes) = (None, 1);
        job.work = Work::PerNode {
            command: ["bash", "-c", command].map(str::to_owned).to_vec(),
        };
        let script = write(&job, &taskfarm, &archer2).expect("a script");
        // `env` does not accept srun's options.
        let script = script.replace(
            "env --ntasks=\"$SLURM_NNODES\" --ntasks-per-node=1 bash",
            "env bash",
        );
        let output = Command::new("bash")
            .args(["-c", &script])
            .output()
            .expect("bash is there");
        assert_eq!(String::from_utf8_lossy(&output.stderr), "");
        assert_eq!(
            output.status.code(),
            Some(7),
            "the step ended in order, and its code is the job's"
        );
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let archer2 = site("archer2");
        let taskfarm = archer2.queue(None, Use::Simulations).expect("a queue");
        let refused = |change: fn(&mut Job)| {
            let mut job = bundle(8, 1);
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
            refused(|job| job.folder = "/data/my run".to_owned()),
            ScriptError::Text { .. }
        ));
        assert!(matches!(
            refused(|job| job.account = Some("t01\n#SBATCH -N 99".to_owned())),
            ScriptError::Text { .. }
        ));
    }
}
