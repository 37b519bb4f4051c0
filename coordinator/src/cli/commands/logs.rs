//! `cardiotwin logs`: what the workers of a patient said.

use std::collections::BTreeMap;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_schemas::formats::PROGRESS;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::progress::Progress;
use clap::Args;

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::OfCohort;
use crate::cli::store::open;
use crate::cli::talk::Talk;
use crate::engine::{AttemptRecord, JobRecord};

/// What the workers of a patient said
#[derive(Debug, Args)]
pub struct LogsArgs {
    /// Whose
    patient: String,
    /// Every attempt, not the last one alone
    #[arg(long)]
    all: bool,
    /// Go on showing what is written until the patient is over
    #[arg(long)]
    follow: bool,
    #[command(flatten)]
    of: OfCohort,
}

/// Files of an attempt that people read.
const FILES: [&str; 2] = ["progress.jsonl", "stderr.log"];

/// Shows logs on stdout.
///
/// # Errors
/// The store's; [`CliError::File`] for a log that is there and cannot be read.
pub async fn execute(args: &LogsArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let reader = open(&folders).await?;
    let id = PatientId(args.patient.clone());
    let mut shown: BTreeMap<PathBuf, u64> = BTreeMap::new();
    let mut last_heading: Option<PathBuf> = None;
    loop {
        let attempts = reader.attempts(&id).await?;
        for job in last_jobs(&reader.jobs(&id).await?.0, args.all) {
            for path in logs_of(job) {
                let seen = shown.entry(path.clone()).or_default();
                let text = new_text(&path, seen)?;
                if !text.is_empty() {
                    talk.data(&format!(
                        "==> job {}, {}: {} <==\n{text}",
                        job.id,
                        job.state,
                        path.display()
                    ))?;
                }
            }
        }
        if attempts.is_empty() && !args.follow {
            talk.say(&format!("no attempt at any task of {id} yet"));
        }
        let first = if args.all {
            0
        } else {
            attempts.len().saturating_sub(1)
        };
        for attempt in &attempts[first..] {
            for name in FILES {
                let path = attempt.directory.join(name);
                let seen = shown.entry(path.clone()).or_default();
                let text = new_text(&path, seen)?;
                if text.is_empty() {
                    continue;
                }
                if last_heading.as_ref() != Some(&path) {
                    talk.data(&heading(attempt, &path))?;
                    last_heading = Some(path);
                }
                talk.data(&if name == "progress.jsonl" {
                    readable(&text)
                } else {
                    text
                })?;
            }
        }
        let state = reader.patient_record(&id).await?.status.state;
        if !args.follow
            || Talk::reader_left()
            || ["done", "failed", "cancelled"].contains(&state.as_str())
        {
            return Ok(Exit::Ok);
        }
        tokio::time::sleep(Duration::from_millis(500)).await;
    }
}

/// The last job of a patient's, or all.
fn last_jobs(jobs: &[JobRecord], all: bool) -> &[JobRecord] {
    &jobs[if all { 0 } else { jobs.len().saturating_sub(1) }..]
}

/// What a job's script and driver said.
fn logs_of(job: &JobRecord) -> Vec<PathBuf> {
    let end = job
        .element
        .map_or_else(|| ".log".to_owned(), |element| format!("_{element}.log"));
    let entries = std::fs::read_dir(&job.folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let mut logs: Vec<PathBuf> = entries
        .filter(|path| path.to_string_lossy().ends_with(&end))
        .collect();
    logs.sort();
    logs
}

fn heading(attempt: &AttemptRecord, path: &Path) -> String {
    format!(
        "==> {}, try {}, {}: {} <==\n",
        attempt.step,
        attempt.generation,
        attempt.state.word(),
        path.display()
    )
}

/// What was appended since `seen`; only whole lines, so that a line that is being written is not torn.
fn new_text(path: &Path, seen: &mut u64) -> Result<String, CliError> {
    let mut file = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(String::new()),
        Err(error) => return Err(CliError::file("read", path)(error)),
    };
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(*seen))
        .map_err(CliError::file("read", path))?;
    file.read_to_end(&mut bytes)
        .map_err(CliError::file("read", path))?;
    let whole = bytes
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |at| at + 1);
    *seen += whole as u64;
    Ok(String::from_utf8_lossy(&bytes[..whole]).into_owned())
}

/// Progress reports as lines for people; a line that is none is shown as it is.
fn readable(text: &str) -> String {
    let line = |line: &str| match PROGRESS.read::<Progress>(&"progress", line.as_bytes()) {
        Ok(report) => {
            let total = report
                .total
                .map(|total| format!("/{total}"))
                .unwrap_or_default();
            format!(
                "{}  {} {}{total}  {}\n",
                report.at, report.phase, report.done, report.note
            )
        }
        Err(_) => format!("{line}\n"),
    };
    text.lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_new_lines_are_shown() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stderr.log");
        let mut seen = 0;
        assert_eq!(new_text(&path, &mut seen).unwrap(), "");
        std::fs::write(&path, "one\ntwo").unwrap();
        assert_eq!(new_text(&path, &mut seen).unwrap(), "one\n");
        std::fs::write(&path, "one\ntwo\n").unwrap();
        assert_eq!(new_text(&path, &mut seen).unwrap(), "two\n");
        assert_eq!(new_text(&path, &mut seen).unwrap(), "");
    }

    #[test]
    fn progress_is_readable_and_damage_is_shown() {
        let text = r#"{"at":"T","phase":"differential evolution","done":41,"total":1000,"note":"cost 0.04"}"#;
        assert_eq!(
            readable(&format!("{text}\nxx\n")),
            "T  differential evolution 41/1000  cost 0.04\nxx\n"
        );
    }
}
