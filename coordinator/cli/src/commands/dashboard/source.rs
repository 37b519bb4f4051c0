//! Answers to the dashboard's questions, from the functions of `status`, `show`, `logs` and
//! `compare`.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cardiotwin_dashboard::{
    AttemptRow, CohortState, Drawing, Estimate, LogText, PatientPage, PatientRow, Source,
    SourceError,
};
use cardiotwin_engine::clock;
use cardiotwin_engine::{AttemptRecord, Reader, StoreError};
use cardiotwin_report::html;
use cardiotwin_report::results::HeartFile;
use cardiotwin_schemas::heart::HeartSurface;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::status::{PatientStatus, Status};
use tokio::sync::{Mutex, RwLock};

use crate::commands::compare::compare;
use crate::commands::logs::end_of_logs;
use crate::error::CliError;
use crate::estimate::estimate;
use crate::place::{Folders, is_cohort};
use crate::store::open;
use crate::talk::with_causes;

/// Largest part of each log file that the page shows, bytes.
const END_OF_LOG: u64 = 64 * 1024;
/// Time for which an expected end is kept, ms.
const ESTIMATE_PERIOD_MS: i64 = 5_000;

/// A run, and the runs that it may be compared with.
pub struct RunSource {
    folders: Folders,
    others: Vec<Folders>,
    /// The run's database; `None` while the run has not begun.
    opened: RwLock<Option<Opened>>,
    /// The last expected end, and the time at which it was estimated.
    estimated: Mutex<(i64, Option<Estimate>)>,
}

/// The database as it was found, with the marks of its files at that time.
struct Opened {
    reader: Arc<Reader>,
    files: Files,
}

/// Inode, length and time of the last change of each of the database's files.
type Files = Vec<Option<(u64, u64, i64, i64)>>;

fn files_of(run_dir: &Path) -> Files {
    let mark = |path: PathBuf| {
        let file = path.metadata().ok()?;
        Some((file.ino(), file.len(), file.mtime(), file.mtime_nsec()))
    };
    Reader::files(run_dir).into_iter().map(mark).collect()
}

/// Whether an open connection shows other files than those that are there now.
fn is_replaced(before: &Files, now: &Files, live: bool) -> bool {
    if live {
        let inode = |files: &Files| files[0].map(|file| file.0);
        inode(before) != inode(now)
    } else {
        before != now
    }
}

impl RunSource {
    /// Opens the run, and looks whether the others can be opened. A cohort whose run has not begun is
    /// waited for.
    ///
    /// # Errors
    /// Errors of the store.
    pub async fn open(folders: Folders, others: Vec<Folders>) -> Result<Self, CliError> {
        for other in &others {
            open(other).await?;
        }
        let files = files_of(&folders.run);
        let is_cohort = folders
            .cohort
            .as_ref()
            .is_some_and(|cohort| is_cohort(cohort));
        let opened = match Reader::open(&folders.run).await {
            Ok(reader) => Some(Opened {
                reader: Arc::new(reader),
                files,
            }),
            Err(StoreError::Missing { .. }) if is_cohort => None,
            Err(error) => return Err(error.into()),
        };
        Ok(Self {
            folders,
            others,
            opened: RwLock::new(opened),
            estimated: Mutex::default(),
        })
    }

    /// Whether there is a run to look at.
    pub async fn has_begun(&self) -> bool {
        self.opened.read().await.is_some()
    }

    async fn reader(&self) -> Result<Arc<Reader>, SourceError> {
        let opened = self.opened.read().await;
        let reader = opened.as_ref().map(|opened| Arc::clone(&opened.reader));
        reader.ok_or_else(|| SourceError::Unreadable("the run has not begun".to_owned()))
    }

    /// State of a cohort whose run has not begun: its name.
    fn waiting(&self) -> CohortState {
        let folder = self.folders.cohort.as_ref().unwrap_or(&self.folders.run);
        let whole = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        let name = whole.file_name().unwrap_or(whole.as_os_str());
        CohortState {
            cohort: name.to_string_lossy().into_owned(),
            waiting: true,
            ..CohortState::default()
        }
    }

    /// Expected end of a local run. It is kept for a while, because its question looks at every
    /// attempt.
    async fn estimate(
        &self,
        reader: &Reader,
        now_ms: i64,
    ) -> Result<Option<Estimate>, SourceError> {
        let mut estimated = self.estimated.lock().await;
        if now_ms - estimated.0 >= ESTIMATE_PERIOD_MS {
            let pace = reader.pace(now_ms).await.map_err(of_store)?;
            *estimated = (now_ms, estimate(&pace, now_ms));
        }
        Ok(estimated.1.clone())
    }

    async fn record(&self, patient: &str) -> Result<PatientRecord, SourceError> {
        let reader = self.reader().await?;
        reader
            .patient_record(&PatientId::from(patient))
            .await
            .map_err(of_store)
    }
}

impl Source for RunSource {
    async fn mark(&self) -> Result<String, SourceError> {
        let now = files_of(&self.folders.run);
        if !self.has_begun().await {
            let reader = match Reader::open(&self.folders.run).await {
                Err(StoreError::Missing { .. }) => return Ok("not begun".to_owned()),
                opened => Arc::new(opened.map_err(of_store)?),
            };
            let files = now.clone();
            *self.opened.write().await = Some(Opened { reader, files });
        }
        let mut reader = self.reader().await?;
        let mut version = reader.data_version().await.map_err(of_store)?;
        let is_old = |opened: &Opened| is_replaced(&opened.files, &now, version.is_some());
        if self.opened.read().await.as_ref().is_some_and(is_old) {
            reader = Arc::new(Reader::open(&self.folders.run).await.map_err(of_store)?);
            version = reader.data_version().await.map_err(of_store)?;
            *self.opened.write().await = Some(Opened {
                reader: Arc::clone(&reader),
                files: now.clone(),
            });
        }
        let contents = match version {
            // A commit of this moment would be missed by the times of files, never by SQLite.
            Some(version) => format!("{version} of {:?}", now[0].map(|file| file.0)),
            None => format!("{now:?}"),
        };
        Ok(format!("{contents}, driven: {}", reader.is_driven()))
    }

    async fn state(&self) -> Result<CohortState, SourceError> {
        if !self.has_begun().await {
            return Ok(self.waiting());
        }
        let now_ms = clock::now_ms();
        let reader = self.reader().await?;
        let status = reader
            .screen_at(usize::MAX, now_ms)
            .await
            .map_err(of_store)?;
        let mut state = state_of(status, now_ms);
        if state.coordinator_running && state.cluster.is_none() {
            state.estimate = self.estimate(&reader, now_ms).await?;
        }
        Ok(state)
    }

    async fn patient(&self, patient: &str) -> Result<PatientPage, SourceError> {
        let record = self.record(patient).await?;
        let reader = self.reader().await?;
        let attempts = reader.attempts(&record.plan.id).await.map_err(of_store)?;
        let attempts = attempts.iter().map(attempt_row).collect();
        // Traces are read and drawn, which takes longer than an answer to others may wait.
        in_background(move || {
            Ok(PatientPage {
                html: html::patient_section(&record),
                attempts,
                cycle_length_ms: record.plan.step0.cycle_length_ms,
                heart: HeartFile::beat(&record).map(|(_, run)| run.key.to_string()),
            })
        })
        .await
    }

    async fn log(&self, patient: &str, attempt: Option<&str>) -> Result<LogText, SourceError> {
        let reader = self.reader().await?;
        let mut attempts = reader
            .attempts(&PatientId::from(patient))
            .await
            .map_err(of_store)?;
        let wanted = match attempt {
            None => attempts.pop(),
            Some(name) => Some(
                attempts
                    .into_iter()
                    .find(|attempt| name_of(attempt) == name)
                    .ok_or_else(|| {
                        SourceError::Unknown(format!("{patient} has no attempt {name}"))
                    })?,
            ),
        };
        let Some(attempt) = wanted else {
            return Ok(LogText {
                attempt: String::new(),
                text: String::new(),
            });
        };
        in_background(move || {
            Ok(LogText {
                attempt: name_of(&attempt),
                text: end_of_logs(&attempt, END_OF_LOG).map_err(|error| unreadable(&error))?,
            })
        })
        .await
    }

    async fn heart(&self, patient: &str) -> Result<Option<HeartSurface>, SourceError> {
        let record = self.record(patient).await?;
        in_background(move || match HeartFile::read(&record) {
            Ok(file) => Ok(file.map(|file| file.heart)),
            Err(error) => Err(unreadable(&error)),
        })
        .await
    }

    fn other_runs(&self) -> Vec<String> {
        let name = |folders: &Folders| {
            let folder = folders.cohort.as_ref().unwrap_or(&folders.run);
            folder.display().to_string()
        };
        self.others.iter().map(name).collect()
    }

    async fn compare(&self, index: usize) -> Result<String, SourceError> {
        let other = self
            .others
            .get(index)
            .ok_or_else(|| SourceError::Unknown(format!("there is no other run {index}")))?;
        let other = open(other).await.map_err(|error| unreadable(&error))?;
        let before = other.record().await.map_err(of_store)?;
        let after = self.reader().await?.record().await.map_err(of_store)?;
        in_background(move || {
            serde_json::to_string(&compare(&before, &after)).map_err(|error| unreadable(&error))
        })
        .await
    }

    fn drawing(&self) -> Drawing {
        Drawing {
            css: html::style_sheet(),
            js: html::script(),
            heart_js: html::heart_viewer(),
        }
    }
}

/// Runs reading and drawing on a thread that may wait.
async fn in_background<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, SourceError> + Send + 'static,
) -> Result<T, SourceError> {
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result,
        Err(error) => Err(unreadable(&error)),
    }
}

fn of_store(error: StoreError) -> SourceError {
    match error {
        StoreError::NoPatient { .. } => SourceError::Unknown(error.to_string()),
        _ => unreadable(&error),
    }
}

fn unreadable(error: &dyn std::error::Error) -> SourceError {
    SourceError::Unreadable(with_causes(error))
}

fn state_of(status: Status, now_ms: i64) -> CohortState {
    // The age of the queue's answer changes all the time; the page counts from `as_of`.
    let cluster = status.cluster.map(|mut cluster| {
        cluster.age_s = 0.0;
        cluster
    });
    CohortState {
        cohort: status.cohort,
        waiting: false,
        coordinator_running: status.coordinator_running,
        counts: status.counts,
        refused: status.refused,
        cluster,
        estimate: None,
        patients: status
            .patients
            .into_iter()
            .map(|patient| row(patient, now_ms))
            .collect(),
    }
}

fn row(mut status: PatientStatus, now_ms: i64) -> PatientRow {
    let since_ms = now_ms - (status.for_s * 1e3).round() as i64;
    status.for_s = 0.0;
    PatientRow { status, since_ms }
}

fn name_of(attempt: &AttemptRecord) -> String {
    format!("{}-g{}", attempt.task, attempt.generation)
}

fn attempt_row(attempt: &AttemptRecord) -> AttemptRow {
    AttemptRow {
        name: name_of(attempt),
        step: attempt.step.clone(),
        generation: attempt.generation,
        state: attempt.state.word().to_owned(),
        planned: attempt.planned.clone(),
        ended: attempt.ended.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unchanged_row_stays_equal_while_time_goes_on() {
        let at = |now_ms: i64| {
            let patient = PatientStatus {
                for_s: (now_ms - 1_700_000_000_123) as f64 / 1000.0,
                ..PatientStatus::default()
            };
            row(patient, now_ms)
        };
        assert_eq!(at(1_700_000_000_123).since_ms, 1_700_000_000_123);
        assert_eq!(at(1_700_000_000_124), at(1_799_999_999_999));
    }

    #[test]
    fn a_live_connection_is_kept_until_another_file_takes_the_place() {
        let before = vec![Some((1, 10, 0, 0)), None, None];
        let written = vec![Some((1, 20, 1, 0)), Some((2, 5, 1, 0)), None];
        let replaced = vec![Some((3, 10, 0, 0)), None, None];
        assert!(!is_replaced(&before, &written, true));
        assert!(is_replaced(&before, &written, false));
        assert!(is_replaced(&before, &replaced, true));
    }
}
