//! Questions of the server about a run, and their answers.

use std::collections::BTreeMap;
use std::future::Future;

use cardiotwin_schemas::heart::HeartSurface;
use cardiotwin_schemas::status::{ClusterStatus, PatientState, PatientStatus, RefusedPatient};
use serde::Serialize;

/// A run that can be looked at. Its answers change nothing.
pub trait Source: Send + Sync + 'static {
    /// Mark of the run's state: it changes whenever [`Source::state`] may have changed. It is asked
    /// several times a second and has to be cheap.
    ///
    /// # Errors
    /// [`SourceError::Unreadable`] if the run cannot be read.
    fn mark(&self) -> impl Future<Output = Result<String, SourceError>> + Send;

    /// State of the whole run.
    ///
    /// # Errors
    /// [`SourceError::Unreadable`] if the run cannot be read.
    fn state(&self) -> impl Future<Output = Result<CohortState, SourceError>> + Send;

    /// Results of a patient, drawn.
    ///
    /// # Errors
    /// [`SourceError`] for an unknown patient or an unreadable run.
    fn patient(
        &self,
        patient: &str,
    ) -> impl Future<Output = Result<PatientPage, SourceError>> + Send;

    /// End of the logs of an attempt, named as in [`AttemptRow::name`], or of the last one.
    ///
    /// # Errors
    /// [`SourceError`] for an unknown patient or attempt, or a log that cannot be read.
    fn log(
        &self,
        patient: &str,
        attempt: Option<&str>,
    ) -> impl Future<Output = Result<LogText, SourceError>> + Send;

    /// Surface of a patient's wall; `None` if no simulation left one.
    ///
    /// # Errors
    /// [`SourceError`] for an unknown patient or an unreadable file.
    fn heart(
        &self,
        patient: &str,
    ) -> impl Future<Output = Result<Option<HeartSurface>, SourceError>> + Send;

    /// Names of the runs with which this one can be compared.
    fn other_runs(&self) -> Vec<String>;

    /// Comparison with one of [`Source::other_runs`], as JSON of `cardiotwin compare --json`.
    ///
    /// # Errors
    /// [`SourceError`] if there is no such run or one of both cannot be read.
    fn compare(&self, index: usize) -> impl Future<Output = Result<String, SourceError>> + Send;

    /// Style sheet and scripts of the drawings in [`PatientPage::html`].
    fn drawing(&self) -> Drawing;
}

/// Reason why a question has no answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SourceError {
    /// The named patient, attempt or run does not exist.
    #[error("{0}")]
    Unknown(String),
    /// A database or file cannot be read.
    #[error("{0}")]
    Unreadable(String),
}

/// State of a run.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct CohortState {
    /// Name of the cohort.
    pub cohort: String,
    /// Whether the run has not begun, so that there is nothing to see yet.
    pub waiting: bool,
    /// Whether a coordinator holds the run at present.
    pub coordinator_running: bool,
    /// Number of patients by state.
    pub counts: BTreeMap<PatientState, u64>,
    /// Patients that the last run left out because of errors in their files.
    pub refused: Vec<RefusedPatient>,
    /// Jobs on the cluster, if the run has any.
    pub cluster: Option<ClusterStatus>,
    /// Expected end, if something is left to do and enough is known.
    pub estimate: Option<Estimate>,
    /// Every patient. They are sent apart from the rest, and only those that changed.
    #[serde(skip)]
    pub patients: Vec<PatientRow>,
}

/// Expected end of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Time of the expected end, milliseconds since 1970.
    pub end_ms: i64,
    /// Basis of the estimate in words.
    pub basis: String,
}

/// A row of the cohort's table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatientRow {
    /// Columns that `status` shows. `for_s` is 0, since it follows from `since_ms`: a moment stands
    /// still, unlike a duration, so that unchanged rows stay equal.
    #[serde(flatten)]
    pub status: PatientStatus,
    /// Beginning of the present state, milliseconds since 1970.
    pub since_ms: i64,
}

/// Results of a patient.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatientPage {
    /// The patient's section of the report: an HTML element without scripts and inline styles.
    pub html: String,
    /// Attempts at the patient's tasks, in the order of the chain.
    pub attempts: Vec<AttemptRow>,
    /// Duration of the measured cardiac cycle, ms.
    pub cycle_length_ms: f64,
    /// Mark of the surface that [`Source::heart`] has, if it has one. Another surface has another
    /// mark.
    pub heart: Option<String>,
}

/// An attempt at a task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AttemptRow {
    /// Name by which its log is asked for.
    pub name: String,
    /// Step of the chain.
    pub step: String,
    /// Number of the attempt, from 1.
    pub generation: u32,
    /// State in a word.
    pub state: String,
    /// Time of planning, UTC, RFC 3339.
    pub planned: String,
    /// Time of the end, UTC, RFC 3339; `None` if it is not over.
    pub ended: Option<String>,
}

/// End of the logs of an attempt.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LogText {
    /// Name of the attempt; empty if the patient has none.
    pub attempt: String,
    /// The last lines.
    pub text: String,
}

/// Style sheet and scripts of the drawings.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// Style sheet of the report.
    pub css: String,
    /// Script that reads values off plots.
    pub js: &'static str,
    /// Viewer of the heart.
    pub heart_js: &'static str,
}
