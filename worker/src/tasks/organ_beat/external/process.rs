//! Process of the external solver. It runs in a folder of its own, is monitored, and is ended when
//! its result is no longer needed.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::context::Context;
use crate::error::TaskError;

/// Interval at which the process is polled.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Interval at which the last line of its output is reported.
const TELL_EVERY: Duration = Duration::from_secs(1);
/// Time that the process may take to exit after SIGTERM.
const GRACE: Duration = Duration::from_secs(10);
/// Number of bytes at the end of the log that are searched for the last line.
const TAIL: u64 = 4096;

/// Runs `command` in `folder` and writes its output to `log`.
///
/// # Errors
/// [`TaskError::ExternalStart`] when the command cannot be started, [`TaskError::Cancelled`] when
/// it was ended on request.
pub(super) fn run(
    command: &[String],
    folder: &Path,
    log: &Path,
    context: &mut Context,
) -> Result<ExitStatus, TaskError> {
    let (program, arguments) = command
        .split_first()
        .ok_or(TaskError::External("no command".into()))?;
    let refused = |source| TaskError::ExternalStart {
        program: program.clone(),
        source,
    };
    let out = File::create(log).map_err(|source| TaskError::Write {
        file: log.to_owned(),
        source,
    })?;
    let errors = out.try_clone().map_err(refused)?;
    let mut child = dying_with_us(program)
        .args(arguments)
        .current_dir(folder)
        .env("CARDIOTWIN_THREADS", context.threads.to_string())
        .stdin(Stdio::null())
        .stdout(out)
        .stderr(errors)
        .spawn()
        .map_err(refused)?;
    let begun = Instant::now();
    let mut told = begun;
    loop {
        if let Some(status) = child.try_wait().map_err(refused)? {
            return Ok(status);
        }
        if context.check_stop().is_err() {
            end(&mut child);
            return Err(TaskError::Cancelled);
        }
        if told.elapsed() >= TELL_EVERY {
            told = Instant::now();
            let line = last_line(log).unwrap_or_default();
            context.progress.report(
                "external solver",
                begun.elapsed().as_secs_f64(),
                None,
                || line,
            );
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// The program, wrapped by `setpriv` (util-linux) if available, so that the kernel ends it when
/// this process dies. Without it, the solver of a killed worker runs to its end, and its results
/// are ignored.
fn dying_with_us(program: &str) -> Command {
    match found("setpriv").zip(found(program)) {
        Some((setpriv, program)) => {
            let mut command = Command::new(setpriv);
            command
                .arg("--pdeathsig")
                .arg("KILL")
                .arg("--")
                .arg(program);
            command
        }
        None => Command::new(program),
    }
}

/// Path of a program, which is given or searched in `PATH`.
fn found(program: &str) -> Option<PathBuf> {
    if program.contains('/') {
        return Path::new(program).is_file().then(|| program.into());
    }
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders)
        .map(|folder| folder.join(program))
        .find(|path| path.is_file())
}

fn end(child: &mut Child) {
    if let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
        // The process may exit before the signal; this is not an error.
        let _ = kill_process(pid, Signal::TERM);
    }
    let asked = Instant::now();
    while asked.elapsed() < GRACE {
        if !matches!(child.try_wait(), Ok(None)) {
            return;
        }
        std::thread::sleep(LOOK_EVERY);
    }
    let _ = child.kill();
    let _ = child.wait();
}

/// Last line of the solver's output.
pub(super) fn last_line(log: &Path) -> Option<String> {
    let tail = || -> io::Result<Vec<u8>> {
        let mut file = File::open(log)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let text = String::from_utf8_lossy(&tail().ok()?).into_owned();
    let last = text
        .lines()
        .rev()
        .map(str::trim)
        .find(|line| !line.is_empty())?;
    Some(last.chars().take(300).collect())
}
