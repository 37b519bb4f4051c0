//! `cardiotwin logs`: the logs of a patient's workers.

use std::collections::BTreeMap;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_engine::{AttemptRecord, JobRecord};
use cardiotwin_schemas::formats::PROGRESS;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::progress::Progress;
use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::OfCohort;
use crate::store::open;
use crate::talk::Talk;

/// Show the logs of a patient's workers
#[derive(Debug, Args)]
pub struct LogsArgs {
    /// Name of the patient
    patient: String,
    /// Show the logs of all attempts, not only of the last one
    #[arg(long)]
    all: bool,
    /// Keep showing new lines until the patient is finished
    #[arg(long)]
    follow: bool,
    #[command(flatten)]
    of: OfCohort,
}

/// Files of an attempt that `logs` shows.
const FILES: [&str; 2] = ["progress.jsonl", "stderr.log"];

/// Prints logs on stdout.
///
/// # Errors
/// Errors of the store; [`CliError::File`] if a log exists but cannot be read.
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
            talk.say(&format!("{id} has no attempt of any task yet"));
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
        if !args.follow || Talk::reader_left() || state.is_over() {
            return Ok(Exit::Ok);
        }
        tokio::time::sleep(Duration::from_millis(500)).await;
    }
}

/// The patient's last job, or all jobs.
fn last_jobs(jobs: &[JobRecord], all: bool) -> &[JobRecord] {
    &jobs[if all { 0 } else { jobs.len().saturating_sub(1) }..]
}

/// Log files of a job's script and driver.
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

/// Text appended since byte `seen`, as whole lines only, so that a line that is being written is
/// not torn.
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

/// The end of an attempt's logs: at most `n_bytes` of each file, as whole lines.
///
/// # Errors
/// [`CliError::File`] if a log exists but cannot be read.
pub(super) fn end_of_logs(attempt: &AttemptRecord, n_bytes: u64) -> Result<String, CliError> {
    let mut all = String::new();
    for name in FILES {
        let path = attempt.directory.join(name);
        let length = path.metadata().map_or(0, |file| file.len());
        let mut from = length.saturating_sub(n_bytes);
        let mut text = new_text(&path, &mut from)?;
        if length > n_bytes {
            // The first line is torn.
            let at = text.find('\n').map_or(0, |at| at + 1);
            text = format!("…\n{}", &text[at..]);
        }
        if !text.is_empty() {
            all += &heading(attempt, &path);
            all += &if name == "progress.jsonl" {
                readable(&text)
            } else {
                text
            };
        }
    }
    Ok(all)
}

/// Progress reports as readable lines. A line that is not a progress report is kept unchanged.
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
    fn the_end_of_a_long_log_begins_with_a_whole_line() {
        let folder = tempfile::tempdir().unwrap();
        let attempt = AttemptRecord {
            step: "step-2".into(),
            task: cardiotwin_schemas::ids::TaskKey("ab".into()),
            generation: 1,
            state: serde_json::from_str(r#"{"state":"planned"}"#).unwrap(),
            directory: folder.path().to_owned(),
            external_id: None,
            claim: None,
            planned: "T".into(),
            ended: None,
        };
        assert_eq!(end_of_logs(&attempt, 10).unwrap(), "");
        std::fs::write(folder.path().join("stderr.log"), "first\nsecond\nthird\n").unwrap();
        let short = end_of_logs(&attempt, 10).unwrap();
        assert!(short.ends_with("<==\n…\nthird\n"), "{short}");
        let whole = end_of_logs(&attempt, 1000).unwrap();
        assert!(whole.ends_with("<==\nfirst\nsecond\nthird\n"), "{whole}");
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
