//! Checks of the worker next to this program and of a launch on two ranks.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use cardiotwin_engine::first_line;

use super::finding::{Finding, Level};

/// Time limit for two ranks to find each other; a busy machine takes less.
const PATIENCE: Duration = Duration::from_secs(60);

/// Checks the worker's version and the launch of two ranks.
pub fn look(worker: Option<&Path>) -> Vec<Finding> {
    let own = std::env::current_exe().unwrap_or_default();
    let worker = worker.map_or_else(|| own.with_file_name("cardiotwin-worker"), Path::to_owned);
    vec![
        same_version(&worker),
        ranks(&own.with_file_name("cardiotwin-worker-mpi")),
    ]
}

fn same_version(worker: &Path) -> Finding {
    let check = "worker";
    let at = worker.display().to_string();
    let Some(said) = first_line(&at, &["--version"]) else {
        let remedy = "build it with `make build`, or name it with --worker";
        return Finding::bad(check, Level::Error, format!("{at} does not run"), remedy);
    };
    let ours = env!("CARGO_PKG_VERSION");
    if said.split_ascii_whitespace().any(|word| word == ours) {
        return Finding::ok(check, format!("{at}: {said}"));
    }
    Finding::bad(
        check,
        Level::Error,
        format!("{at}: {said}, this program is {ours}"),
        "build or install both programs together",
    )
}

fn ranks(worker: &Path) -> Finding {
    let check = "MPI on two ranks";
    if !worker.is_file() {
        let found = format!("{} does not exist", worker.display());
        return Finding::bad(
            check,
            Level::Note,
            found,
            "only needed for beats on several nodes: docs/mpi.md, Building",
        );
    }
    let remedy = "start it by hand with the launcher of the MPI that it was built with: \
                  docs/mpi.md, Running";
    let launched = Command::new("mpirun")
        .args(["-n", "2", "--oversubscribe"])
        .arg(worker)
        .args(["check", "--ranks", "2", "--json"])
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = match launched {
        Err(error) => {
            return Finding::bad(
                check,
                Level::Warning,
                format!("mpirun cannot be started: {error}"),
                remedy,
            );
        }
        Ok(child) => child,
    };
    let began = Instant::now();
    while matches!(child.try_wait(), Ok(None)) {
        if began.elapsed() > PATIENCE {
            let _ = child.kill();
            let _ = child.wait();
            return Finding::bad(
                check,
                Level::Warning,
                format!("no answer within {} s", PATIENCE.as_secs()),
                remedy,
            );
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    match child.wait_with_output() {
        Ok(output) if output.status.success() => {
            let said: serde_json::Value =
                serde_json::from_slice(&output.stdout).unwrap_or_default();
            let reduction = said["reduction_us"]
                .as_f64()
                .map(|us| format!(", a reduction takes {us:.1} µs"));
            Finding::ok(
                check,
                format!("found each other{}", reduction.unwrap_or_default()),
            )
        }
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            let line = said
                .lines()
                .find(|line| !line.trim().is_empty())
                .unwrap_or("no message")
                .trim()
                .to_owned();
            Finding::bad(check, Level::Warning, line, remedy)
        }
        Err(error) => Finding::bad(check, Level::Warning, error.to_string(), remedy),
    }
}
