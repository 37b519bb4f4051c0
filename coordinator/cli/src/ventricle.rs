//! A patient's ventricle for commands that simulate outside any run: taken from the run if there is
//! one, otherwise computed.

use std::path::Path;
use std::process::{Command, Stdio};

use cardiotwin_engine::{Reader, StoreError, contraction};
use cardiotwin_input::{self as input, Options, Report};
use cardiotwin_report::results::PatientView;
use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec, ValveParameters};
use cardiotwin_schemas::organ_law::{LawKnowledge, LawSamples};
use cardiotwin_schemas::outcome::{
    Ending, OrganBeatResult, PassiveStateResult, TaskOutcome, TaskResult,
};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::CalciumSource;
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_schemas::verdict::Verdict;
use clap::ValueEnum;
use serde::Serialize;
use tempfile::TempDir;

use super::error::CliError;
use super::kept;
use super::place::Folders;
use super::problems;
use super::store::stored_overrides;
use super::talk::{Talk, count};

/// Most beats to the periodic state of a reduced ventricle, and the tolerance (mmHg and mL) at which a beat
/// counts as periodic.
pub const PERIODIC: BeatCount = BeatCount::Periodic {
    max: 100,
    tolerance: 0.05,
};
/// The same for a finite-element ventricle, whose beats take seconds to minutes.
pub const PERIODIC_IN_3D: BeatCount = BeatCount::Periodic {
    max: 10,
    tolerance: 0.5,
};

/// The ventricle that a worker simulates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AskedFor<'a> {
    /// The one in the task's specification.
    TheOrgan,
    /// A one-fibre ventricle with the same volumes, pressure and activation.
    OneFibre,
    /// The law of the organ from a file with what is known about it.
    Law(&'a Path),
}

/// Circulation around the ventricle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum CirculationKind {
    /// An atrium at constant pressure and a Windkessel
    Open,
    /// A loop whose blood goes round
    Closed,
}

impl CirculationKind {
    /// The circuit by its name in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Closed => "closed",
        }
    }

    /// The circuit in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Open => "open circuit",
            Self::Closed => "closed loop",
        }
    }
}

/// A patient after step 0.
#[derive(Debug)]
pub struct Ventricle {
    /// Inputs and settings of the patient.
    pub plan: ResolvedPatient,
    /// Passive state and loads from step 0.
    pub passive: PassiveStateResult,
    record: Option<PatientRecord>,
    /// Folder with the files of a passive state that was computed for this command.
    _scratch: Option<TempDir>,
}

impl Ventricle {
    /// The ventricle of a patient, with `settings` (`KEY=VALUE`) on top of the cohort's.
    ///
    /// # Errors
    /// [`CliError::Input`] for invalid input, [`CliError::Simulation`] if step 0 fails,
    /// [`CliError::Worker`] if the worker cannot be run.
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
            kept: kept::assignments(&folders.run).await?,
            set: settings,
            overrides,
            meshes: true,
            ..Options::default()
        };
        let plan = plan(folders, &options, record.as_ref(), talk)?;
        let (passive, scratch) = passive_state(&plan, record.as_ref(), worker)?;
        Ok(Self {
            plan,
            passive,
            record,
            _scratch: scratch,
        })
    }

    /// The ventricle of a patient as stored in a run.
    ///
    /// # Errors
    /// [`CliError::Usage`] before step 0 is done, with a message that begins with `option`; errors
    /// of the store.
    pub async fn of_run(folders: &Folders, patient: &str, option: &str) -> Result<Self, CliError> {
        let record = Reader::open(&folders.run)
            .await?
            .patient_record(&PatientId::from(patient))
            .await?;
        let step0 = record.step0.as_ref().ok_or_else(|| {
            CliError::Usage(format!(
                "{option}: step 0 of {patient} is not done; run `cardiotwin run` first"
            ))
        })?;
        Ok(Self {
            plan: record.plan.clone(),
            passive: step0.result.clone(),
            record: Some(record),
            _scratch: None,
        })
    }

    /// The Tanh beat of step 1's best iteration; without a run, the beat of the first guess.
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

    /// Where the parameters of [`Self::beat_of_step1`] come from.
    pub fn origin_of_step1(&self) -> String {
        let record = self.record.as_ref();
        match record.and_then(|record| PatientView(record).best_iteration()) {
            Some(best) => format!("step 1's best iteration, number {}", best.number),
            None if record.is_some() => {
                "step 1's first guess, since no iteration is done".to_owned()
            }
            None => "step 1's first guess, since there is no run".to_owned(),
        }
    }

    /// Where the parameters of [`Self::beat_of_twin`] come from.
    pub fn origin_of_twin(&self) -> &'static str {
        let record = self.record.as_ref();
        match record.and_then(|record| record.step3.as_ref()) {
            Some(_) => "the twin, the best of step 3",
            None => "the twin, which is step 2's cell: there is no step 3",
        }
    }

    /// The verification beat: step 2's cell with step 1's valves.
    ///
    /// # Errors
    /// [`CliError::Usage`] before step 2 is done, with a message that begins with `option`.
    pub fn beat_of_step2(&self, option: &str, beats: BeatCount) -> Result<OrganBeatSpec, CliError> {
        let fit = self
            .record
            .as_ref()
            .and_then(|record| record.cell_fit.as_ref())
            .ok_or_else(|| {
                CliError::Usage(format!(
                    "{option}: step 2 of {} is not done; run `cardiotwin run` first",
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

    /// The twin's beat: the best one of step 3, or the verification beat without step 3.
    ///
    /// # Errors
    /// The same as for [`Self::beat_of_step2`].
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

    /// The twin's own beat as the run published it, with the text of its `traces.csv`.
    ///
    /// # Errors
    /// [`CliError::Usage`] if the run has no twin of the patient; a file that cannot be read.
    pub fn twin(&self) -> Result<(&OrganBeatResult, String), CliError> {
        let twin = self.record.as_ref().and_then(PatientRecord::twin);
        let path = twin.and_then(|twin| twin.artefact("traces"));
        let (Some(twin), Some(path)) = (twin, path) else {
            return Err(CliError::Usage(format!(
                "{} has no twin yet: run `cardiotwin run` first",
                self.plan.id
            )));
        };
        let text = std::fs::read_to_string(&path).map_err(CliError::file("read", &path))?;
        Ok((&twin.result, text))
    }

    /// The organ's law of step 1's beats and of the twin's, as for the posterior; `None` without a
    /// finite-element beat.
    pub fn law(&self) -> Option<LawKnowledge> {
        let record = self.record.as_ref()?;
        let of_step1 = record.iterations.iter().filter_map(|i| i.run.as_ref());
        let beats: Vec<LawSamples> = of_step1
            .chain(record.twin())
            .filter_map(|run| run.result.law.clone())
            .collect();
        let prior = self.plan.law.clone();
        (!beats.is_empty()).then_some(LawKnowledge { beats, prior })
    }

    /// The twin's posterior; `None` if the run has not sampled it.
    pub fn posterior(&self) -> Option<&PosteriorResult> {
        self.record
            .as_ref()
            .and_then(|record| record.posterior.as_ref())
            .map(|task| &task.result)
    }

    /// Verdict on the twin's beat; `None` before the verification.
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

/// The patient's record in the run; `None` without a run, or if the run lacks a patient of the
/// cohort.
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

/// The patient's plan from the cohort's files, or from the run if only a run was named.
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
                "a setting needs the cohort: name it with --cohort".to_owned(),
            )),
        };
    };
    let mut report = Report::default();
    let plan = input::load(cohort, options, &mut report).and_then(|cohort| cohort.plans().pop());
    problems::say(&report, talk);
    plan.filter(|_| report.n_errors() == 0)
        .ok_or_else(|| CliError::Input {
            errors: count(report.n_errors(), "error"),
        })
}

/// The run's passive state if it was computed from these inputs; otherwise the worker computes it
/// into a temporary folder, which holds the mesh of a finite-element ventricle.
fn passive_state(
    plan: &ResolvedPatient,
    record: Option<&PatientRecord>,
    worker: &Path,
) -> Result<(PassiveStateResult, Option<TempDir>), CliError> {
    let task = TaskSpec::PassiveState(Box::new(plan.step0_spec()));
    if let Some(step0) = record
        .and_then(|record| record.step0.as_ref())
        .filter(|step0| step0.key == task.key())
    {
        return Ok((step0.result.clone(), None));
    }
    let scratch =
        tempfile::tempdir().map_err(CliError::file("create a folder in", std::env::temp_dir()))?;
    match ask_worker(worker, &task, scratch.path(), 0.0, AskedFor::TheOrgan)?.ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::PassiveState(result) => Ok((result, Some(scratch))),
            _ => Err(unexpected(worker)),
        },
        other => Err(CliError::Simulation {
            message: format!("passive state: {}", describe(&other)),
        }),
    }
}

/// What a command of the worker prints.
///
/// # Errors
/// [`CliError::File`] if the worker does not start, [`CliError::Worker`] with its words if it fails.
pub fn stdout_of(worker: &Path, command: &mut Command) -> Result<Vec<u8>, CliError> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(CliError::file("start", worker))?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    let words = String::from_utf8_lossy(&output.stderr);
    Err(CliError::Worker {
        worker: worker.to_owned(),
        message: format!("{}, {}", output.status, words.trim()),
    })
}

/// Has the worker execute a task at once, and returns its outcome. Its files go to `out`.
///
/// # Errors
/// [`CliError::Worker`] if the worker fails or its answer cannot be parsed; files that cannot be
/// written.
pub fn ask_worker(
    worker: &Path,
    task: &TaskSpec,
    out: &Path,
    vtu_every_ms: f64,
    asked: AskedFor<'_>,
) -> Result<TaskOutcome, CliError> {
    let said = |message: String| CliError::Worker {
        worker: worker.to_owned(),
        message,
    };
    std::fs::create_dir_all(out).map_err(CliError::file("create", out))?;
    let spec = out.join("spec.json");
    let text = serde_json::to_string_pretty(task).map_err(|error| said(error.to_string()))?;
    std::fs::write(&spec, text).map_err(CliError::file("write", &spec))?;
    let law = match asked {
        AskedFor::Law(file) => Some(file),
        AskedFor::TheOrgan | AskedFor::OneFibre => None,
    };
    let stdout = stdout_of(
        worker,
        Command::new(worker)
            .args([
                "simulate".as_ref(),
                spec.as_os_str(),
                "--out".as_ref(),
                out.as_os_str(),
            ])
            .args(["--vtu-every", &vtu_every_ms.to_string()])
            .args((asked == AskedFor::OneFibre).then_some("--one-fibre"))
            .args(
                law.iter()
                    .flat_map(|file| ["--law".as_ref(), file.as_os_str()]),
            ),
    )?;
    let outcome = out.join("outcome.json");
    std::fs::write(&outcome, &stdout).map_err(CliError::file("write", &outcome))?;
    let read = OUTCOME.read(&"its answer", &stdout);
    read.map_err(|error| said(error.in_full()))
}

/// Error for an outcome that does not belong to the task.
pub fn unexpected(worker: &Path) -> CliError {
    CliError::Worker {
        worker: worker.to_owned(),
        message: "the outcome belongs to another task, or lacks its files".to_owned(),
    }
}

/// Description of how a task ended.
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
