//! Progress reports in `progress.jsonl`: one line each, appended, at most about four per second.

use std::fs::{File, OpenOptions};
use std::io::{IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cardiotwin_schemas::progress::Progress;

use crate::clock;

/// Shortest time between two reports of one phase.
const INTERVAL: Duration = Duration::from_millis(250);

/// Log of progress reports. A report that cannot be written is dropped, because the loss of a
/// report is no reason to fail.
#[derive(Debug)]
pub struct ProgressLog {
    path: Option<PathBuf>,
    file: Option<File>,
    echo: bool,
    last: Option<(String, Instant)>,
}

impl ProgressLog {
    /// Reports to `progress.jsonl` in `directory`. The first report creates the file. With `echo`,
    /// reports also go to stderr if that is a terminal: in a log they would stand twice.
    #[must_use]
    pub fn in_directory(directory: &Path, echo: bool) -> Self {
        Self {
            path: Some(directory.join(cardiotwin_protocol::names::PROGRESS)),
            file: None,
            echo: echo && std::io::stderr().is_terminal(),
            last: None,
        }
    }

    /// A log that drops all reports.
    #[must_use]
    pub fn silent() -> Self {
        Self {
            path: None,
            file: None,
            echo: false,
            last: None,
        }
    }

    /// Whether a report of `phase` would be written now. A new phase is reported at once, the same
    /// phase again only after an interval.
    #[must_use]
    pub fn is_due(&self, phase: &str) -> bool {
        self.last
            .as_ref()
            .is_none_or(|(last, at)| last != phase || at.elapsed() >= INTERVAL)
    }

    /// Writes a report if one is due. `note` is called only in this case.
    pub fn report(
        &mut self,
        phase: &str,
        done: f64,
        total: Option<f64>,
        note: impl FnOnce() -> String,
    ) {
        if !self.is_due(phase) {
            return;
        }
        self.last = Some((phase.to_owned(), Instant::now()));
        let progress = Progress {
            at: clock::now(),
            phase: phase.to_owned(),
            done,
            total,
            note: note(),
        };
        if self.echo {
            eprintln!("{}: {}", progress.phase, progress.note);
        }
        if self.file.is_none()
            && let Some(path) = &self.path
        {
            self.file = OpenOptions::new().append(true).create(true).open(path).ok();
        }
        if let (Some(file), Ok(mut line)) = (&mut self.file, serde_json::to_string(&progress)) {
            line.push('\n');
            // One write call per line, so that a reader never sees half a line when two writers
            // append.
            let _ = file.write_all(line.as_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_of_one_phase_are_thinned_and_a_new_phase_is_written_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let mut log = ProgressLog::in_directory(dir.path(), false);
        for generation in 0..1000 {
            log.report("fit", f64::from(generation), Some(1000.0), || {
                format!("generation {generation}")
            });
        }
        log.report("polish", 0.0, None, || "started".to_owned());
        let text = std::fs::read_to_string(dir.path().join("progress.jsonl")).unwrap();
        let lines: Vec<Progress> = text
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert!(lines.len() < 100, "{} lines", lines.len());
        assert_eq!(
            (lines[0].note.as_str(), lines[0].total),
            ("generation 0", Some(1000.0))
        );
        assert_eq!(lines.last().unwrap().phase, "polish");
    }
}
