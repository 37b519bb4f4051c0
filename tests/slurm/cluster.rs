//! The Slurm on which the tests run.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Time limit far beyond the needs of a slow machine, which only a fault exceeds.
pub const PATIENCE: Duration = Duration::from_secs(300);

/// Exit code of the script if Slurm's packages are missing and cannot be installed.
const MISSING: i32 = 3;

/// A Slurm started by deploy/one-machine-slurm.sh.
pub struct Cluster {
    folder: PathBuf,
    pub conf: PathBuf,
    ours: bool,
}

fn script() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/one-machine-slurm.sh")
}

impl Cluster {
    /// The running Slurm, or a new one. `Err` has the reason if Slurm's packages are missing and
    /// cannot be installed.
    ///
    /// # Panics
    /// If Slurm is installed but does not start: its tests could not run, which must not count as
    /// success.
    pub fn get() -> Result<Self, String> {
        if let Some(conf) = std::env::var_os("SLURM_CONF").map(PathBuf::from) {
            let folder = conf
                .parent()
                .and_then(Path::parent)
                .unwrap_or(&conf)
                .to_owned();
            if folder.join(".one-machine-slurm").exists() {
                return Ok(Self {
                    folder,
                    conf,
                    ours: false,
                });
            }
        }
        Self::start("ct-slurm", &[])
    }

    /// A Slurm of its own.
    ///
    /// - `name`: of its folder, which is short because paths of sockets must be short
    /// - `options`: of the script's `start`
    pub fn start(name: &str, options: &[&str]) -> Result<Self, String> {
        let folder = PathBuf::from(format!("/tmp/{name}.{}", std::process::id()));
        let output = Command::new(script())
            .arg("start")
            .arg(&folder)
            .args(options)
            .output()
            .map_err(|e| e.to_string())?;
        let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        if output.status.code() == Some(MISSING) {
            return Err(said);
        }
        assert!(output.status.success(), "Slurm does not start: {said}");
        Ok(Self {
            conf: folder.join("etc/slurm.conf"),
            folder,
            ours: true,
        })
    }

    fn deploy(&self, what: &str, name: Option<&str>) -> Output {
        let mut command = Command::new(script());
        command.arg(what).arg(&self.folder).args(name);
        command.output().expect("bash is there")
    }

    /// Revives daemons and nodes, so that each test begins with all of them up.
    pub fn recover(&self) {
        let _ = self.slurm("scancel", &["--me"]);
        for daemon in ["slurmdbd", "slurmctld", "n1", "n2", "n3", "n4"] {
            if !self.lives(daemon) {
                self.deploy("revive", Some(daemon));
            }
        }
        let _ = self.slurm("scontrol", &["update", "partitionname=main", "state=up"]);
        for node in ["n1", "n2", "n3", "n4"] {
            self.resume(node);
        }
        self.wait("idle nodes and an empty queue", || {
            let idle = self.slurm(
                "sinfo",
                &["-h", "-N", "-p", "main", "-t", "idle", "-o", "%N"],
            );
            idle.lines().count() == 4 && self.slurm("squeue", &["--me", "-h"]).is_empty()
        });
    }

    /// Resumes nodes that Slurm drained for a job number that was given twice, as sites do: a
    /// controller that is killed before it has saved its last jobs gives their numbers again.
    pub fn resume_drained(&self) {
        if !self.lives("slurmctld") {
            return;
        }
        let reasons = self.slurm("sinfo", &["-h", "-R", "-o", "%E|%N"]);
        for nodes in reasons
            .lines()
            .filter_map(|row| row.strip_prefix("Duplicate jobid|"))
        {
            self.resume(nodes);
        }
    }

    fn resume(&self, nodes: &str) {
        let update = ["update", &format!("nodename={nodes}"), "state=resume"];
        let _ = self.slurm("scontrol", &update);
    }

    fn pid(&self, daemon: &str) -> Option<u32> {
        std::fs::read_to_string(self.folder.join(format!("run/{daemon}.pid")))
            .ok()?
            .trim()
            .parse()
            .ok()
    }

    fn lives(&self, daemon: &str) -> bool {
        self.pid(daemon).is_some_and(crate::cohort::lives)
    }

    /// Kills a daemon with `kill -9`.
    pub fn kill(&self, daemon: &str) {
        self.deploy("kill", Some(daemon));
    }

    /// Ends a node with all its processes.
    pub fn crash(&self, node: &str) {
        self.deploy("crash", Some(node));
    }

    /// Starts a killed daemon again.
    pub fn revive(&self, daemon: &str) {
        self.deploy("revive", Some(daemon));
    }

    /// Sends a signal to a daemon.
    pub fn signal(&self, daemon: &str, signal: rustix::process::Signal) {
        let pid = self
            .pid(daemon)
            .and_then(|pid| rustix::process::Pid::from_raw(i32::try_from(pid).ok()?));
        rustix::process::kill_process(pid.expect("the daemon runs"), signal).expect("it is ours");
    }

    /// Runs one of Slurm's commands and returns its output.
    pub fn slurm(&self, program: &str, arguments: &[&str]) -> String {
        let output = Command::new(program)
            .args(arguments)
            .env("SLURM_CONF", &self.conf)
            .output();
        output
            .map(|o| String::from_utf8_lossy(&o.stdout).into_owned())
            .unwrap_or_default()
    }

    /// Runs one of Slurm's commands that must be refused, and returns its error message.
    #[track_caller]
    pub fn refused(&self, program: &str, arguments: &[&str]) -> String {
        let output = Command::new(program)
            .args(arguments)
            .env("SLURM_CONF", &self.conf)
            .output()
            .expect("it is there");
        assert!(
            !output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stdout)
        );
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    /// Waits until a condition holds.
    #[track_caller]
    pub fn wait(&self, what: &str, holds: impl FnMut() -> bool) {
        self.wait_for(PATIENCE, what, holds);
    }

    /// Waits for at most `patience` until a condition holds.
    #[track_caller]
    pub fn wait_for(&self, patience: Duration, what: &str, mut holds: impl FnMut() -> bool) {
        let began = Instant::now();
        while !holds() {
            assert!(
                began.elapsed() < patience,
                "{what} did not come; the queue:\n{}",
                self.slurm("squeue", &[])
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        if self.ours {
            self.deploy("stop", None);
        }
    }
}
