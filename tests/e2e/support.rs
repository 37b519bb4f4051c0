//! A small cohort in a temporary folder, and calls of the program on it.

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

pub use crate::built::binary;

/// Patients of the small cohort, taken from the bundled one.
pub const PATIENTS: [&str; 2] = ["01-CoA", "02-CoA"];

/// Settings under which both patients are done within seconds: step 2 need not be accurate here,
/// and step 3 is left out.
const QUICK: &str = "\nworkflow.until = \"step2-verification\"\n[step2]\nseed = 3\npopsize = 3\nmax_generations = 4\npolish = false\n";
/// Settings under which step 2 never ends by itself, however fast the cell is: the population is
/// too large to collapse.
const SLOW: &str =
    "\n[step2]\nseed = 3\npopsize = 500\nmax_generations = 1000000\ntol = 0.0\npolish = false\n";

/// Time limit far beyond the needs of a slow machine, which only a fault exceeds.
const PATIENCE: Duration = Duration::from_secs(600);

/// Exit code and output of a call.
#[derive(Debug)]
pub struct Said {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Said {
    /// Asserts that the call ended with this code. A run that is done counts as a success (0) even if a
    /// twin is off (7), which most are with settings as quick as those of tests;
    /// `output::a_twin_that_is_off_is_no_success` tells the two apart.
    #[track_caller]
    pub fn expect(self, code: i32) -> Self {
        if code == 0 && self.code == 7 {
            return self;
        }
        assert_eq!(
            self.code, code,
            "stdout:\n{}\nstderr:\n{}",
            self.out, self.err
        );
        self
    }

    /// Asserts that the call succeeded, and parses its JSON.
    #[track_caller]
    pub fn json(self) -> Value {
        let said = self.expect(0);
        serde_json::from_str(&said.out).unwrap_or_else(|error| panic!("{error} in\n{}", said.out))
    }

    /// Asserts that stderr contains all of these.
    #[track_caller]
    pub fn complains_of(self, parts: &[&str]) -> Self {
        for part in parts {
            assert!(self.err.contains(part), "{part:?} is not in\n{}", self.err);
        }
        self
    }
}

/// Calls `cardiotwin` in a folder.
pub fn cardiotwin(folder: &Path, arguments: &[&str]) -> Said {
    let output = command(folder, arguments)
        .output()
        .expect("the program starts");
    // A process that was killed by a signal has no code.
    let code = output.status.code().unwrap_or(-1);
    assert_listed(arguments, code);
    Said {
        code,
        out: String::from_utf8_lossy(&output.stdout).into_owned(),
        err: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// Asserts that docs/operations.md lists this exit code for the command.
#[track_caller]
fn assert_listed(arguments: &[&str], code: i32) {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/operations.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let table = page
        .split_once("\n| commands | exit codes, 70 aside |\n")
        .expect("the table of commands")
        .1;
    let row = |command: &str| {
        let name = format!("`{command}`");
        let mut rows = table.lines().take_while(|line| line.starts_with('|'));
        rows.find_map(|line| {
            let (commands, codes) = line.trim_matches('|').split_once(" | ")?;
            let is_its = commands.split(',').any(|one| one.trim() == name);
            is_its.then(|| codes.trim().to_owned())
        })
    };
    let Some(codes) = arguments.iter().find_map(|argument| row(argument)) else {
        return; // --help, --version, and commands that only programs call
    };
    let is_listed = codes.split(", ").any(|one| one == code.to_string());
    assert!(
        is_listed || code == -1,
        "{arguments:?} gave {code}; docs/operations.md lists {codes}"
    );
}

/// A call of `cardiotwin` in a folder, not yet started.
pub fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(binary("cardiotwin"));
    binary("cardiotwin-worker");
    command
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .env_remove("CARDIOTWIN_LOG");
    command
}

/// Starts `cardiotwin` in a folder without waiting for its end.
pub fn start(folder: &Path, arguments: &[&str]) -> Running {
    let mut child = command(folder, arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let stderr = BufReader::new(child.stderr.take().expect("a pipe"));
    let (tell, lines) = channel();
    std::thread::spawn(move || {
        stderr
            .lines()
            .map_while(Result::ok)
            .try_for_each(|line| tell.send(line))
    });
    Running {
        child,
        lines,
        heard: String::new(),
    }
}

/// A small cohort, of two patients by default.
pub struct Cohort {
    folder: TempDir,
}

impl Cohort {
    /// Both patients, done within seconds.
    pub fn quick() -> Self {
        Self::with(QUICK)
    }

    /// Both patients, with a step 2 that continues until it is stopped, for tests that interrupt
    /// it.
    pub fn slow() -> Self {
        Self::with(SLOW)
    }

    /// Another patient of the bundled cohort, done within seconds.
    pub fn quick_of(id: &str) -> Self {
        Self::of(&[id], QUICK)
    }

    /// Other patients of the bundled cohort, done within seconds.
    pub fn quick_of_these(ids: &[&str]) -> Self {
        Self::of(ids, QUICK)
    }

    /// Patients of the bundled cohort with the program's defaults, except for the one-fibre
    /// ventricle and no posterior.
    pub fn by_default(ids: &[&str]) -> Self {
        Self::of(ids, "")
    }

    fn with(settings: &str) -> Self {
        Self::of(&PATIENTS, settings)
    }

    /// Settings come at the end of the file, so that lines keep their numbers.
    fn of(patients: &[&str], settings: &str) -> Self {
        // The posterior costs most of a whole chain, and has a test of its own in `runs`.
        const NO_POSTERIOR: &str = "\n[posterior]\nenabled = false\n";
        let folder = tempfile::tempdir().expect("a temporary folder");
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/coa-seven/patients");
        for id in patients {
            let patient = folder.path().join("patients").join(id);
            std::fs::create_dir_all(&patient).unwrap();
            for name in ["patient.toml", "pressure.csv", "volume.csv"] {
                std::fs::copy(bundled.join(id).join(name), patient.join(name)).unwrap();
            }
        }
        let head = "name = \"two\"\nsolver.fidelity = \"reduced\"\n";
        std::fs::write(
            folder.path().join("cohort.toml"),
            format!("{head}{}{NO_POSTERIOR}", settings.trim_start()),
        )
        .unwrap();
        Self { folder }
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn run_dir(&self) -> PathBuf {
        self.path().join("run")
    }

    /// Calls `cardiotwin` in the cohort's folder.
    pub fn call(&self, arguments: &[&str]) -> Said {
        cardiotwin(self.path(), arguments)
    }

    /// Starts `cardiotwin run` without waiting for its end.
    pub fn start(&self, arguments: &[&str]) -> Running {
        let mut all = vec!["run"];
        all.extend(arguments);
        start(self.path(), &all)
    }

    /// Starts a command in the cohort's folder without waiting for its end.
    pub fn start_command(&self, arguments: &[&str]) -> Running {
        start(self.path(), arguments)
    }

    /// Replaces a text in a file of the cohort.
    #[track_caller]
    pub fn edit(&self, file: &str, from: &str, to: &str) {
        let path = self.path().join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from:?} is not in {file}");
        std::fs::write(path, text.replace(from, to)).unwrap();
    }

    /// Record of a patient, from `show --json`.
    pub fn patient(&self, id: &str) -> Value {
        self.call(&["show", id, "--json"]).json()
    }

    /// Waits until the status of a run satisfies `wanted`.
    #[track_caller]
    pub fn wait_for_run(&self, run: &str, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let began = Instant::now();
        loop {
            let said = self.call(&["status", run, "--json"]);
            if let Ok(status) = serde_json::from_str::<Value>(&said.out)
                && wanted(&status)
            {
                return status;
            }
            assert!(
                began.elapsed() < PATIENCE,
                "never saw {what}; last:\n{}{}",
                said.out,
                said.err
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until a patient of a running coordinator is at work in this step. The step must be one
    /// that does not end by itself, because a slow machine would miss any other.
    #[track_caller]
    pub fn wait_for_step(&self, step: &str) -> Value {
        self.wait_for_step_of_run(".", step)
    }

    /// The same for a run other than the cohort's own.
    #[track_caller]
    pub fn wait_for_step_of_run(&self, run: &str, step: &str) -> Value {
        let wanted = |status: &Value| {
            let patients = status["patients"].as_array().cloned().unwrap_or_default();
            status["coordinator_running"] == true
                && patients
                    .iter()
                    .any(|patient| patient["step"] == step && patient["state"] == "running")
        };
        self.wait_for_run(run, &format!("a patient running {step}"), wanted)
    }
}

/// A coordinator that runs next to the test. It is killed if the test ends first.
pub struct Running {
    child: Child,
    /// Its stderr, line by line.
    lines: Receiver<String>,
    heard: String,
}

impl Running {
    pub fn signal(&self, signal: rustix::process::Signal) {
        let pid = i32::try_from(self.child.id())
            .ok()
            .and_then(rustix::process::Pid::from_raw);
        rustix::process::kill_process(pid.expect("a process has an id"), signal)
            .expect("it is running");
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Waits until stderr contains these words.
    #[track_caller]
    pub fn wait_for_words(&mut self, words: &str) {
        while !self.heard.contains(words) {
            let Ok(line) = self.lines.recv_timeout(PATIENCE) else {
                panic!("never heard {words:?} in\n{}", self.heard)
            };
            self.heard += &line;
            self.heard.push('\n');
        }
    }

    /// Waits until a condition holds or the coordinator ends. Returns whether it held before the
    /// coordinator ended.
    #[track_caller]
    pub fn wait_until(&mut self, what: &str, is_so: impl Fn() -> bool) -> bool {
        let began = Instant::now();
        loop {
            let has_ended = self.child.try_wait().expect("our own child").is_some();
            if is_so() {
                return !has_ended;
            }
            if has_ended {
                return false;
            }
            assert!(began.elapsed() < PATIENCE, "never saw {what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits for the end of the process.
    pub fn end(mut self) -> Said {
        let mut out = String::new();
        self.child
            .stdout
            .take()
            .unwrap()
            .read_to_string(&mut out)
            .unwrap();
        let code = self.child.wait().unwrap().code().unwrap_or(-1);
        let rest: String = self.lines.iter().map(|line| line + "\n").collect();
        Said {
            code,
            out,
            err: format!("{}{rest}", self.heard),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Step, task key and generation of every published task of a patient.
pub fn published(patient: &Value) -> Vec<(String, String, u64)> {
    let mut tasks = Vec::new();
    let mut push = |name: String, task: &Value| {
        if let Some(key) = task["key"].as_str() {
            tasks.push((name, key.to_owned(), task["generation"].as_u64().unwrap()));
        }
    };
    push("step-0".into(), &patient["step0"]);
    for iteration in patient["iterations"].as_array().unwrap() {
        push(
            format!("step-1 iteration {}", iteration["number"]),
            &iteration["run"],
        );
    }
    push("targets".into(), &patient["targets"]);
    push("step-2".into(), &patient["cell_fit"]);
    push("verification".into(), &patient["verification"]);
    tasks
}
