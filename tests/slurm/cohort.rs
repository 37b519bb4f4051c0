//! A small cohort that runs on the cluster.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal};
use serde_json::Value;

pub use crate::built::binary;
use crate::cluster::Cluster;

const PROFILE: &str = r#"
name = "one-machine"
description = "deploy/one-machine-slurm.sh"
scheduler = "slurm"
[node]
cores = 128
memory_mib = 256000
unit = "core"
[arrays]
allowed = true
[poll]
shortest_s = 1
longest_s = 2
[[queue]]
name = "main"
partition = "main"
qos = "normal"
uses = ["simulations", "chunks", "tick"]
walltime = "24:00:00"
[[queue]]
name = "scavenge"
partition = "scavenge"
qos = "normal"
uses = ["chunks"]
walltime = "24:00:00"
[[queue]]
name = "standard"
partition = "standard"
qos = "standard"
unit = "node"
uses = ["chunks"]
walltime = "24:00:00"
[[queue]]
name = "serial"
partition = "serial"
qos = "serial"
uses = ["chunks"]
walltime = "24:00:00"
"#;

/// Settings of step 2 that take less than a second.
pub const QUICK: &str = "popsize = 3\nmax_generations = 4\n";
/// Settings under which step 2 continues until it is stopped, and writes checkpoints.
pub const SLOW: &str = "popsize = 500\nmax_generations = 1000000\ntol = 0.0\n";

/// Exit code and output of a call.
#[derive(Debug)]
pub struct Said {
    pub code: i32,
    pub out: String,
    pub err: String,
}

/// A cohort in a temporary folder.
pub struct Cohort<'a> {
    pub cluster: &'a Cluster,
    pub folder: tempfile::TempDir,
    settings: Vec<String>,
    /// Worker in place of the one next to the coordinator.
    worker: Option<PathBuf>,
}

/// Process id in a claim; `None` if the claim is not complete yet.
pub fn pid_of(claim: &Path) -> Option<u32> {
    let claim: Value = serde_json::from_str(&fs::read_to_string(claim).ok()?).ok()?;
    // A driver's claim contains its process's claim.
    u32::try_from(claim["pid"].as_u64().or(claim["claim"]["pid"].as_u64())?).ok()
}

/// Sends a signal to the process that made a claim, if it is alive.
pub fn signal(claim: &Path, signal: Signal) {
    let pid = pid_of(claim)
        .and_then(|pid| Pid::from_raw(i32::try_from(pid).ok()?))
        .expect("a pid");
    // The process may have just ended.
    let _ = rustix::process::kill_process(pid, signal);
}

/// Counts of a run's tasks and attempts, by their directories.
#[derive(Debug, Default, Clone, Copy)]
pub struct Tally {
    /// Number of tasks with a result.
    pub published: usize,
    /// Number of tasks with more than one result.
    pub twice: usize,
    /// Number of tasks that were begun again after they had a result.
    pub again: usize,
    /// Number of attempts' directories, over all tasks.
    pub attempts: usize,
    /// Number of attempts other than the first of their task.
    pub repeated: usize,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.published += other.published;
        self.twice += other.twice;
        self.again += other.again;
        self.attempts += other.attempts;
        self.repeated += other.repeated;
    }
}

/// Whether a process is alive. A zombie does not count.
pub fn lives(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')')
        .next()
        .and_then(|rest| rest.split_whitespace().next())
        .is_some_and(|state| state != "Z")
}

impl<'a> Cohort<'a> {
    pub fn of(cluster: &'a Cluster, patients: &[&str], step2: &str) -> Self {
        // Every test runs below a name that is hard on scripts: blank, quote, percent sign.
        let folder = tempfile::Builder::new()
            .prefix("it's 50 % ")
            .tempdir_in("/tmp")
            .expect("a temporary folder");
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/coa-seven/patients");
        for id in patients {
            let (from, to) = (bundled.join(id), folder.path().join("patients").join(id));
            fs::create_dir_all(&to).expect("a folder");
            for entry in fs::read_dir(from).expect("the bundled cohort").flatten() {
                fs::copy(entry.path(), to.join(entry.file_name())).expect("a copy");
            }
        }
        let profile = folder.path().join("site.toml");
        fs::write(&profile, PROFILE).expect("a profile");
        let text = format!(
            "name = \"few\"\nworkflow.until = \"step2-verification\"\n[solver]\nfidelity = \"reduced\"\n[step2]\nseed = 3\npolish = false\n{step2}\
             [executor]\nkind = \"slurm\"\n[executor.slurm]\nsite = \"{}\"\ngrace_s = 3\nwarning_s = 60\njob_s = 1\n",
            profile.display()
        );
        fs::write(folder.path().join("cohort.toml"), text).expect("a cohort");
        Self {
            cluster,
            folder,
            settings: Vec::new(),
            worker: None,
        }
    }

    /// Adds a setting `KEY=VALUE` to every command.
    pub fn set(mut self, setting: &str) -> Self {
        self.settings.push(setting.to_owned());
        self
    }

    /// Lets ticks start another worker.
    pub fn with_worker(mut self, worker: &Path) -> Self {
        self.worker = Some(worker.to_owned());
        self
    }

    /// Path of the site's profile.
    pub fn site(&self) -> String {
        self.folder.path().join("site.toml").display().to_string()
    }

    /// Rewrites the profile with `from` replaced.
    pub fn change_profile(&self, from: &str, to: &str) {
        let text = fs::read_to_string(self.site()).expect("the profile");
        assert!(text.contains(from), "{from} is not in {text}");
        fs::write(self.site(), text.replace(from, to)).expect("the profile");
    }

    pub fn make_quick(&self) {
        let path = self.folder.path().join("cohort.toml");
        let text = fs::read_to_string(&path).expect("the cohort");
        fs::write(&path, text.replace(SLOW, QUICK)).expect("the cohort");
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        binary("cardiotwin-worker");
        let mut command = Command::new(binary("cardiotwin"));
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .stdin(Stdio::null())
            .env("SLURM_CONF", &self.cluster.conf);
        command
    }

    pub fn with_settings<'b>(&'b self, first: &[&'b str]) -> Vec<&'b str> {
        let mut arguments = first.to_vec();
        self.settings
            .iter()
            .for_each(|setting| arguments.extend(["--set", setting]));
        arguments
    }

    pub fn call(&self, arguments: &[&str]) -> Said {
        let output = self
            .command(arguments)
            .output()
            .expect("the program starts");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Said {
            code: output.status.code().unwrap_or(-1),
            out: text(&output.stdout),
            err: text(&output.stderr),
        }
    }

    /// Runs one tick to its end.
    pub fn advance(&self) -> Said {
        let mut arguments = self.with_settings(&["advance"]);
        if let Some(worker) = &self.worker {
            arguments.extend(["--worker", worker.to_str().expect("a path in UTF-8")]);
        }
        self.call(&arguments)
    }

    /// Starts a coordinator that ticks until the run is over.
    pub fn watch(&self) -> Child {
        let arguments = self.with_settings(&["run", "--watch", "--no-report"]);
        self.command(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts")
    }

    /// Ticks until nothing is left to do, and returns the last exit code.
    #[track_caller]
    pub fn finish(&self) -> i32 {
        let began = std::time::Instant::now();
        loop {
            let said = self.advance();
            match said.code {
                8 => {}
                // 7: done, and a twin of these quick settings is off.
                7 => return 0,
                0 | 1 => return said.code,
                _ => panic!("{said:?}"),
            }
            assert!(
                began.elapsed() < crate::cluster::PATIENCE,
                "it does not end: {said:?}\n{:#}",
                self.status()
            );
            std::thread::sleep(std::time::Duration::from_millis(300));
        }
    }

    pub fn status(&self) -> Value {
        let said = self.call(&["status", "--json"]);
        serde_json::from_str(&said.out).unwrap_or_else(|error| panic!("{error}: {said:?}"))
    }

    /// Ticks until a job of this run is running, and returns its number.
    #[track_caller]
    pub fn running_job(&self) -> String {
        let began = std::time::Instant::now();
        loop {
            self.advance();
            let status = self.status();
            let jobs = status["cluster"]["jobs"]
                .as_array()
                .cloned()
                .unwrap_or_default();
            if let Some(job) = jobs.iter().find(|job| job["state"] == "running") {
                return job["id"].as_str().unwrap_or_default().to_owned();
            }
            assert!(
                began.elapsed() < crate::cluster::PATIENCE,
                "no job runs: {status:#}"
            );
            std::thread::sleep(std::time::Duration::from_millis(200));
        }
    }

    /// Folders of jobs, oldest first.
    pub fn jobs(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.folder.path().join("run/slurm"))
            .into_iter()
            .flatten()
            .flatten();
        let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        folders.sort_by_key(|path| path.metadata().and_then(|m| m.created()).ok());
        folders
    }

    /// A job's batch script.
    pub fn script(&self, n: usize) -> String {
        fs::read_to_string(self.jobs()[n].join("job.sh")).expect("a script")
    }

    /// Attempt directories that contain this file.
    pub fn attempts_with(&self, name: &str) -> Vec<PathBuf> {
        let folders = |path: &Path| -> Vec<PathBuf> {
            fs::read_dir(path)
                .map(|entries| entries.flatten().map(|e| e.path()).collect())
                .unwrap_or_default()
        };
        let all = folders(&self.folder.path().join("run/attempts"))
            .iter()
            .flat_map(|p| folders(p))
            .collect::<Vec<_>>();
        all.into_iter()
            .filter(|path| path.join(name).exists())
            // A revocation takes the place of an outcome.
            .filter(|path| name != "outcome.json" || !is_revoked(path))
            .collect()
    }

    /// Claims of the workers that are at work.
    pub fn workers(&self) -> Vec<PathBuf> {
        let begun = self
            .attempts_with("started.json")
            .into_iter()
            .filter(|path| !path.join("outcome.json").exists());
        begun
            .map(|path| path.join("started.json"))
            .filter(|claim| pid_of(claim).is_some_and(lives))
            .collect()
    }

    /// Waits until a worker has written a checkpoint of step 2, and returns its process id.
    #[track_caller]
    pub fn wait_for_checkpoint(&self) -> u32 {
        let found = || {
            self.attempts_with("checkpoint")
                .into_iter()
                .find_map(|path| {
                    let journal = fs::read_dir(path.join("checkpoint"))
                        .ok()?
                        .flatten()
                        .next()?
                        .path();
                    (journal.metadata().ok()?.len() > 2000 && !path.join("outcome.json").exists())
                        .then_some(path)
                })
        };
        self.cluster
            .wait("a checkpoint of step 2", || found().is_some());
        pid_of(&found().expect("it was there").join("started.json")).expect("a pid")
    }

    /// Asserts that every patient is done, and that no published task was begun again.
    #[track_caller]
    pub fn assert_done(&self) {
        let status = self.status();
        for patient in status["patients"].as_array().expect("patients") {
            assert_eq!(patient["state"], "done", "{patient:#}");
        }
        let tally = self.tally();
        assert!(
            tally.published > 0 && tally.twice + tally.again == 0,
            "{tally:?}"
        );
    }

    /// Counts the run's tasks and attempts.
    pub fn tally(&self) -> Tally {
        let mut tasks: BTreeMap<String, Vec<(u32, bool)>> = BTreeMap::new();
        for folder in self.attempts_with("spec.json") {
            let name = folder
                .file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned();
            let (task, generation) = name.rsplit_once("-g").expect("task and generation");
            let outcome = fs::read_to_string(folder.join("outcome.json")).unwrap_or_default();
            let attempt = (
                generation.parse().expect("a number"),
                outcome.contains("\"succeeded\""),
            );
            tasks.entry(task.to_owned()).or_default().push(attempt);
        }
        let mut tally = Tally::default();
        for attempts in tasks.values() {
            let published: Vec<u32> = attempts
                .iter()
                .filter(|(_, done)| *done)
                .map(|(n, _)| *n)
                .collect();
            tally.published += usize::from(!published.is_empty());
            tally.twice += usize::from(published.len() > 1);
            tally.again += usize::from(
                published
                    .iter()
                    .any(|done| attempts.iter().any(|(n, _)| n > done)),
            );
            tally.attempts += attempts.len();
            tally.repeated += attempts.iter().filter(|(n, _)| *n > 1).count();
        }
        tally
    }
}

impl Cohort<'_> {
    /// What the logs say of repeated tasks: why each driver left a patient, and how each attempt
    /// before the last one ended, with the end of its worker's output.
    pub fn story(&self) -> String {
        let mut lines = Vec::new();
        for job in self.jobs() {
            let ends = fs::read_dir(&job).into_iter().flatten().flatten();
            for end in ends.filter(|e| e.file_name().to_string_lossy().starts_with("ended-")) {
                lines.push(fs::read_to_string(end.path()).unwrap_or_default());
            }
        }
        for attempt in self.attempts_with("spec.json") {
            let outcome = fs::read_to_string(attempt.join("outcome.json")).unwrap_or_default();
            if outcome.contains("\"succeeded\"") {
                continue;
            }
            lines.push(format!("{}: {outcome}", attempt.display()));
            for log in ["stderr.log", "stdout.log"] {
                let text = fs::read_to_string(attempt.join(log)).unwrap_or_default();
                let last: Vec<&str> = text.lines().rev().take(20).collect();
                lines.extend(last.into_iter().rev().map(|line| format!("  {line}")));
            }
        }
        lines.join("\n")
    }
}

/// Whether the coordinator revoked an attempt before its worker published.
pub fn is_revoked(attempt: &Path) -> bool {
    let text = fs::read_to_string(attempt.join("outcome.json")).unwrap_or_default();
    serde_json::from_str::<serde_json::Value>(&text)
        .is_ok_and(|outcome| outcome.get("revoked").is_some())
}
