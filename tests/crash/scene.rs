//! A run directory, the coordinators that are started and killed in it, and the claims that its
//! workers leave.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use cardiotwin_schemas::progress::Claim;
use rustix::process::{Pid, Signal};
use sqlx::Connection as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

/// Path of the coordinator's executable.
pub const DRIVER: &str = env!("CARGO_BIN_EXE_crash-driver");
/// Time limit far beyond the needs of a slow machine, which only a fault exceeds.
const PATIENCE: Duration = Duration::from_secs(300);

/// Path of the worker's executable.
pub fn worker() -> String {
    let path = crate::built::binary("cardiotwin-worker");
    path.to_string_lossy().into_owned()
}

/// A run directory with the options of its runs.
pub struct Scene {
    dir: tempfile::TempDir,
    patients: usize,
    sleep_ms: u64,
    executor: String,
}

/// Exit status and output of a coordinator.
#[derive(Debug)]
pub struct Said {
    pub ok: bool,
    pub stdout: String,
    pub stderr: String,
}

/// Result of a coordinator that was to die at a crash point.
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

    /// Makes of the database one of format 1, as the first version left it.
    pub fn make_older(&self) {
        let file = SqliteConnectOptions::new().filename(self.run_dir().join("cardiotwin.db"));
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async {
            let mut connection = SqliteConnection::connect_with(&file)
                .await
                .expect("the database opens");
            let sql = "DROP TABLE jobs; DROP TABLE allotments; DELETE FROM _sqlx_migrations WHERE version = 2; PRAGMA user_version = 1";
            sqlx::raw_sql(sql)
                .execute(&mut connection)
                .await
                .expect("the tables can be dropped");
            connection.close().await.expect("the database closes");
        });
    }

    fn hold_file(&self) -> PathBuf {
        self.dir.path().join("hold")
    }

    /// Prevents tasks from ending until [`Scene::release`].
    pub fn hold(&self) {
        fs::write(self.hold_file(), "").expect("a file can be made");
    }

    /// Lets tasks end again.
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

    /// Starts a coordinator and lets it run.
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

    /// Starts a coordinator, which must reach the end.
    pub fn finish(&self) -> Said {
        self.finish_with(self.start())
    }

    /// Waits for this coordinator, which must reach the end.
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

    /// Starts a coordinator that dies at its n-th crash point, if it reaches it.
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

    /// Number of attempts that workers have claimed so far.
    pub fn claims(&self) -> usize {
        self.attempt_files("started.json").len()
    }

    /// Claim of a live worker that has no outcome yet and is not in `but`.
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

/// A coordinator's process with what it has printed.
pub struct Coordinator {
    child: Child,
    /// Lines of its standard error.
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

    /// Waits until stderr contains these words.
    pub fn wait_for_words(&mut self, words: &str) {
        while !self.heard.contains(words) {
            let Ok(line) = self.lines.recv_timeout(PATIENCE) else {
                panic!("never heard {words:?} in\n{}", self.heard)
            };
            self.heard += &line;
            self.heard.push('\n');
        }
    }

    /// Sends SIGKILL and waits for the end of the process.
    pub fn kill(mut self) {
        self.child.kill().expect("our own child can be killed");
        self.child.wait().expect("our own child can be waited for");
    }

    /// Waits for the end of the process.
    pub fn end(mut self) -> Said {
        let mut stdout = String::new();
        // The process prints a single line at its end, so the pipe cannot fill up.
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

/// Whether a process runs. A zombie does not count.
pub fn lives(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')')
        .next()
        .and_then(|rest| rest.split_whitespace().next())
        .is_some_and(|state| state != "Z")
}
