//! A patient's ventricle for a command that simulates outside of any run: as the run left it where there is a run, else
//! made now.

use std::path::Path;
use std::process::{Command, Stdio};

use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec, ValveParameters};
use cardiotwin_schemas::outcome::{
    Ending, OrganBeatResult, PassiveStateResult, TaskOutcome, TaskResult,
};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::CalciumSource;
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_schemas::verdict::Verdict;

use super::error::CliError;
use super::place::Folders;
use super::problems;
use super::store::stored_overrides;
use super::talk::{Talk, count};
use crate::engine::{Reader, StoreError, contraction};
use crate::input::{self, Options, Report};
use crate::results::PatientView;

/// Which ventricle a worker simulates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AskedFor {
    /// The specification's.
    TheOrgan,
    /// The one-fibre ventricle of the same volumes, pressure and activation.
    OneFibre,
}

/// A patient after step 0.
#[derive(Debug)]
pub struct Ventricle {
    /// Inputs and settings.
    pub plan: ResolvedPatient,
    /// Passive state and loads.
    pub passive: PassiveStateResult,
    record: Option<PatientRecord>,
}

impl Ventricle {
    /// The patient's, with `settings` (`KEY=VALUE`) on top of the cohort's.
    ///
    /// # Errors
    /// [`CliError::Input`] for wrong input, [`CliError::Simulation`] where step 0 fails, [`CliError::Worker`].
    pub async fn of(
        folders: &Folders,
        patient: &str,
        settings: Vec<String>,
        worker: &Path,
        talk: &Talk,
    ) -> Result<Self, CliError> {
        let record = stored(folders, patient).await?;
        let overrides = stored_overrides(&folders.run, patient).await?;
        let options = Options {
            only: vec![patient.to_owned()],
            set: settings,
            overrides,
            meshes: true,
        };
        let plan = plan(folders, &options, record.as_ref(), talk)?;
        let passive = passive_state(&plan, record.as_ref(), worker)?;
        Ok(Self {
            plan,
            passive,
            record,
        })
    }

    /// The patient's as a run has it.
    ///
    /// # Errors
    /// [`CliError::Usage`] before step 0, beginning with `option`; the store's.
    pub async fn of_run(folders: &Folders, patient: &str, option: &str) -> Result<Self, CliError> {
        let record = Reader::open(&folders.run)
            .await?
            .patient_record(&PatientId::from(patient))
            .await?;
        let step0 = record.step0.as_ref().ok_or_else(|| {
            CliError::Usage(format!(
                "{option}: step 0 of {patient} is not done; `cardiotwin run` does it"
            ))
        })?;
        Ok(Self {
            plan: record.plan.clone(),
            passive: step0.result.clone(),
            record: Some(record),
        })
    }

    /// The beat of step 1's best iteration with Tanh; without a run, of its first guess.
    pub fn beat_of_step1(&self, beats: BeatCount) -> OrganBeatSpec {
        let best = self
            .record
            .as_ref()
            .and_then(|record| PatientView(record).best_iteration());
        let initial = || {
            (
                self.plan.settings.step1.initial,
                self.plan.settings.step1.valves,
            )
        };
        let (parameters, valves) = best.map_or_else(initial, |best| {
            (best.parameters.tanh, best.parameters.valves)
        });
        self.plan.beat_spec(
            &self.passive,
            ContractionSpec::Tanh { parameters },
            valves,
            beats,
        )
    }

    /// The verification beat: step 2's cell behind step 1's valves.
    ///
    /// # Errors
    /// [`CliError::Usage`] before step 2, beginning with `option`.
    pub fn beat_of_step2(&self, option: &str, beats: BeatCount) -> Result<OrganBeatSpec, CliError> {
        let fit = self
            .record
            .as_ref()
            .and_then(|record| record.cell_fit.as_ref())
            .ok_or_else(|| {
                CliError::Usage(format!(
                    "{option}: step 2 of {} is not done; `cardiotwin run` does it",
                    self.plan.id
                ))
            })?;
        let fixed = self.plan.settings.step2.calcium == CalciumSource::MedianTrace;
        let cell = contraction(
            &self.plan,
            &fit.result,
            self.plan.calcium.clone().filter(|_| fixed),
        );
        Ok(self
            .plan
            .beat_spec(&self.passive, cell, self.valves(), beats))
    }

    /// The twin's beat: the best one of step 3, else the verification beat.
    ///
    /// # Errors
    /// As for [`Self::beat_of_step2`].
    pub fn beat_of_twin(&self, option: &str, beats: BeatCount) -> Result<OrganBeatSpec, CliError> {
        let beat = self.beat_of_step2(option, beats)?;
        let of_step3 = self
            .record
            .as_ref()
            .and_then(|record| record.step3.as_ref());
        Ok(of_step3.map_or_else(
            || beat.clone(),
            |step3| beat.with_parameters(&step3.parameters),
        ))
    }

    /// The twin's own beat as the run published it, with its `traces.csv`.
    ///
    /// # Errors
    /// [`CliError::Usage`] where there is none; a file that cannot be read.
    pub fn twin(&self) -> Result<(&OrganBeatResult, String), CliError> {
        let twin = self.record.as_ref().and_then(PatientRecord::twin);
        let path = twin.and_then(|twin| twin.artefact("traces"));
        let (Some(twin), Some(path)) = (twin, path) else {
            return Err(CliError::Usage(format!(
                "{} has no twin yet: `cardiotwin run` makes it",
                self.plan.id
            )));
        };
        let text = std::fs::read_to_string(&path).map_err(CliError::file("read", &path))?;
        Ok((&twin.result, text))
    }

    /// How sure the twin is, where the run sampled that.
    pub fn posterior(&self) -> Option<&PosteriorResult> {
        self.record
            .as_ref()
            .and_then(|record| record.posterior.as_ref())
            .map(|task| &task.result)
    }

    /// What the twin's beat says of it.
    pub fn verdict(&self) -> Option<&Verdict> {
        self.record
            .as_ref()
            .and_then(|record| record.verdict.as_ref())
    }

    fn valves(&self) -> ValveParameters {
        let best = self
            .record
            .as_ref()
            .and_then(|record| PatientView(record).best_iteration());
        best.map_or(self.plan.settings.step1.valves, |best| {
            best.parameters.valves
        })
    }
}

/// What a run knows of the patient, where there is one.
async fn stored(folders: &Folders, patient: &str) -> Result<Option<PatientRecord>, CliError> {
    let reader = match Reader::open(&folders.run).await {
        Ok(reader) => reader,
        Err(StoreError::Missing { .. }) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    match reader.patient_record(&PatientId::from(patient)).await {
        Ok(record) => Ok(Some(record)),
        Err(StoreError::NoPatient { .. }) if folders.cohort.is_some() => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The patient as the files have it, or, where only a run was named, as the run has it.
fn plan(
    folders: &Folders,
    options: &Options,
    record: Option<&PatientRecord>,
    talk: &Talk,
) -> Result<ResolvedPatient, CliError> {
    let Some(cohort) = &folders.cohort else {
        return match record {
            Some(record) if options.set.is_empty() => Ok(record.plan.clone()),
            _ => Err(CliError::Usage(
                "settings need the cohort: name it with --cohort".to_owned(),
            )),
        };
    };
    let mut report = Report::default();
    let plan = input::load(cohort, options, &mut report).and_then(|cohort| cohort.plans().pop());
    let said = problems::text(&report, talk.colour_err);
    if !said.is_empty() {
        talk.say(said.trim_end());
    }
    plan.filter(|_| report.n_errors() == 0)
        .ok_or_else(|| CliError::Input {
            errors: count(report.n_errors(), "error"),
        })
}

/// The run's passive state where it is that of these inputs, else made now.
fn passive_state(
    plan: &ResolvedPatient,
    record: Option<&PatientRecord>,
    worker: &Path,
) -> Result<PassiveStateResult, CliError> {
    let task = TaskSpec::PassiveState(Box::new(plan.step0_spec()));
    if let Some(step0) = record
        .and_then(|record| record.step0.as_ref())
        .filter(|step0| step0.key == task.key())
    {
        return Ok(step0.result.clone());
    }
    let scratch =
        tempfile::tempdir().map_err(CliError::file("make a folder in", std::env::temp_dir()))?;
    match ask_worker(worker, &task, scratch.path(), 0.0, AskedFor::TheOrgan)?.ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::PassiveState(result) => Ok(result),
            _ => Err(unexpected(worker)),
        },
        other => Err(CliError::Simulation {
            message: format!("passive state: {}", describe(&other)),
        }),
    }
}

/// The outcome of a task that a worker does at once, with its files in `out`.
///
/// # Errors
/// [`CliError::Worker`] where it does not answer; files that cannot be written.
pub fn ask_worker(
    worker: &Path,
    task: &TaskSpec,
    out: &Path,
    vtu_every_ms: f64,
    asked: AskedFor,
) -> Result<TaskOutcome, CliError> {
    let said = |message: String| CliError::Worker {
        worker: worker.to_owned(),
        message,
    };
    std::fs::create_dir_all(out).map_err(CliError::file("make", out))?;
    let spec = out.join("spec.json");
    let text = serde_json::to_string_pretty(task).map_err(|error| said(error.to_string()))?;
    std::fs::write(&spec, text).map_err(CliError::file("write", &spec))?;
    let output = Command::new(worker)
        .args([
            "simulate".as_ref(),
            spec.as_os_str(),
            "--out".as_ref(),
            out.as_os_str(),
        ])
        .args(["--vtu-every", &vtu_every_ms.to_string()])
        .args((asked == AskedFor::OneFibre).then_some("--one-fibre"))
        .stdin(Stdio::null())
        .output()
        .map_err(CliError::file("start", worker))?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        return Err(said(format!("{}, {}", output.status, words.trim())));
    }
    let outcome = out.join("outcome.json");
    std::fs::write(&outcome, &output.stdout).map_err(CliError::file("write", &outcome))?;
    let read = OUTCOME.read(&"its answer", &output.stdout);
    read.map_err(|error| said(error.in_full()))
}

/// An answer that does not belong to the question.
pub fn unexpected(worker: &Path) -> CliError {
    CliError::Worker {
        worker: worker.to_owned(),
        message: "an outcome of another task, or without its files".to_owned(),
    }
}

/// How a task ended, in words.
pub fn describe(ending: &Ending) -> String {
    match ending {
        Ending::Diverged {
            last_good_ms,
            reason,
        } => format!("diverged after {last_good_ms} ms: {reason}"),
        Ending::Failed { failure } => {
            format!("failed [{}]: {}", failure.class.as_str(), failure.message)
        }
        Ending::Cancelled => "stopped".to_owned(),
        Ending::Succeeded { .. } => "succeeded".to_owned(),
    }
}
