//! A run directory, coordinators that are started and killed in it, and the claims that its workers leave.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use cardiotwin_schemas::progress::Claim;
use rustix::process::{Pid, Signal};

/// The coordinator's executable.
pub const DRIVER: &str = env!("CARGO_BIN_EXE_crash-driver");
/// Far longer than a slow machine takes: reached only where something is wrong.
const PATIENCE: Duration = Duration::from_secs(300);

/// The worker's executable, of the present source: one that an earlier build left beside the driver may be any.
pub fn worker() -> String {
    static WORKER: OnceLock<String> = OnceLock::new();
    let build = || {
        let path = Path::new(DRIVER).with_file_name("cardiotwin-worker");
        let mut build = Command::new(env!("CARGO"));
        // All binaries at once, as `make` does: the same features, so that nothing is compiled twice.
        build.args(["build", "--locked", "--workspace", "--bins"]);
        if Path::new(DRIVER)
            .parent()
            .is_some_and(|folder| folder.ends_with("release"))
        {
            build.arg("--release");
        }
        assert!(
            build.status().expect("cargo runs").success(),
            "cardiotwin-worker cannot be built"
        );
        path.to_string_lossy().into_owned()
    };
    WORKER.get_or_init(build).clone()
}

/// A run directory with what is to be run in it.
pub struct Scene {
    dir: tempfile::TempDir,
    patients: usize,
    sleep_ms: u64,
    executor: String,
}

/// What a coordinator left.
#[derive(Debug)]
pub struct Said {
    pub ok: bool,
    pub stdout: String,
    pub stderr: String,
}

/// What came of a coordinator that was to die.
#[derive(Debug)]
pub struct Crash {
    pub died: bool,
    pub last_words: String,
}

impl Scene {
    pub fn new(patients: usize, sleep_ms: u64, executor: &str) -> Self {
        let dir = tempfile::tempdir().expect("a directory");
        Self {
            dir,
            patients,
            sleep_ms,
            executor: executor.to_owned(),
        }
    }

    pub fn run_dir(&self) -> PathBuf {
        self.dir.path().join("run")
    }

    fn hold_file(&self) -> PathBuf {
        self.dir.path().join("hold")
    }

    /// From now on no task ends by itself.
    pub fn hold(&self) {
        fs::write(self.hold_file(), "").expect("a file can be made");
    }

    /// Tasks end again.
    pub fn release(&self) {
        fs::remove_file(self.hold_file()).expect("tasks are held");
    }

    fn command(&self) -> Command {
        let mut command = Command::new(DRIVER);
        command
            .arg(self.run_dir())
            .args([
                self.patients.to_string(),
                self.sleep_ms.to_string(),
                "2".to_owned(),
            ])
            .arg(&self.executor)
            .env_remove("CARDIOTWIN_CRASH_POINT")
            .env("CARDIOTWIN_NOOP_HOLD", self.hold_file())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// A coordinator that is left to run.
    pub fn start(&self) -> Coordinator {
        let mut child = self.command().spawn().expect("the driver starts");
        let stderr = BufReader::new(child.stderr.take().expect("a pipe"));
        let (tell, lines) = channel();
        std::thread::spawn(move || {
            stderr
                .lines()
                .map_while(Result::ok)
                .try_for_each(|line| tell.send(line))
        });
        Coordinator {
            child,
            lines,
            heard: String::new(),
        }
    }

    /// A coordinator that must get to the end.
    pub fn finish(&self) -> Said {
        self.finish_with(self.start())
    }

    /// This one must get to the end.
    pub fn finish_with(&self, coordinator: Coordinator) -> Said {
        let said = coordinator.end();
        let done = format!(r#"{{"done":{},"failed":0,"unfinished":0"#, self.patients);
        assert!(
            said.ok && said.stdout.starts_with(&done),
            "{}\n{}",
            said.stdout,
            said.stderr
        );
        said
    }

    /// A coordinator that dies at its n-th crash point, if it gets that far.
    pub fn run_until_crash_point(&self, n: usize) -> Crash {
        let output = self
            .command()
            .env("CARDIOTWIN_CRASH_POINT", n.to_string())
            .output()
            .expect("the driver starts");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        let died = !output.status.success();
        assert_eq!(
            died,
            stderr.contains("crash point"),
            "it failed of itself: {stderr}"
        );
        Crash {
            died,
            last_words: stderr.lines().last().unwrap_or_default().to_owned(),
        }
    }

    fn attempt_files(&self, name: &str) -> Vec<PathBuf> {
        let folders = |path: &Path| -> Vec<PathBuf> {
            fs::read_dir(path)
                .map(|entries| entries.flatten().map(|e| e.path()).collect())
                .unwrap_or_default()
        };
        let attempts = folders(&self.run_dir().join("attempts"))
            .iter()
            .flat_map(|p| folders(p))
            .collect::<Vec<_>>();
        attempts
            .into_iter()
            .map(|p| p.join(name))
            .filter(|p| p.exists())
            .collect()
    }

    /// How many attempts a worker ever claimed.
    pub fn claims(&self) -> usize {
        self.attempt_files("started.json").len()
    }

    /// The claim of a worker that lives, has no outcome yet and is none of these.
    pub fn wait_for_claim(&self, but: &[u32]) -> Claim {
        let began = Instant::now();
        while began.elapsed() < PATIENCE {
            for path in self.attempt_files("started.json") {
                let claim = fs::read(&path)
                    .ok()
                    .and_then(|bytes| serde_json::from_slice::<Claim>(&bytes).ok());
                let over = path.with_file_name("outcome.json").exists();
                if let Some(claim) =
                    claim.filter(|c| !over && !but.contains(&c.pid) && lives(c.pid))
                {
                    return claim;
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("no worker claimed an attempt within {PATIENCE:?}");
    }
}

/// A coordinator at work.
pub struct Coordinator {
    child: Child,
    /// Its stderr, line by line.
    lines: Receiver<String>,
    heard: String,
}

impl Coordinator {
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    pub fn signal(&self, signal: Signal) {
        kill(self.child.id(), signal);
    }

    /// Waits until it has said these words.
    pub fn wait_for_words(&mut self, words: &str) {
        while !self.heard.contains(words) {
            let Ok(line) = self.lines.recv_timeout(PATIENCE) else {
                panic!("never heard {words:?} in\n{}", self.heard)
            };
            self.heard += &line;
            self.heard.push('\n');
        }
    }

    /// SIGKILL, and waits until it is gone.
    pub fn kill(mut self) {
        self.child.kill().expect("our own child can be killed");
        self.child.wait().expect("our own child can be waited for");
    }

    /// Waits for its end.
    pub fn end(mut self) -> Said {
        let mut stdout = String::new();
        // One line, at its end: the pipe cannot fill up.
        let pipe = self.child.stdout.as_mut().expect("a pipe");
        pipe.read_to_string(&mut stdout)
            .expect("our own child says text");
        let ok = self
            .child
            .wait()
            .expect("our own child can be waited for")
            .success();
        let rest: String = self.lines.iter().map(|line| line + "\n").collect();
        Said {
            ok,
            stdout,
            stderr: self.heard + &rest,
        }
    }
}

pub fn kill(pid: u32, signal: Signal) {
    let pid = i32::try_from(pid)
        .ok()
        .and_then(Pid::from_raw)
        .expect("a process id");
    rustix::process::kill_process(pid, signal).expect("a process that we started can be signalled");
}

/// Whether a process runs; one that only waits to be reaped does not.
pub fn lives(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')')
        .next()
        .and_then(|rest| rest.split_whitespace().next())
        .is_some_and(|state| state != "Z")
}
