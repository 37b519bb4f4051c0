//! Errors of tasks, and the failure class and remedy of each.

use std::io;
use std::path::PathBuf;

use cardiotwin_calibrate::fixed_point::FixedPointError;
use cardiotwin_calibrate::identifiability::IdentifiabilityError;
use cardiotwin_calibrate::organ_law::OrganLawError;
use cardiotwin_calibrate::population::PopulationError;
use cardiotwin_calibrate::sobol::SobolError;
use cardiotwin_cell_engine::{EngineError, InputProblem};
use cardiotwin_discover::DiscoverError;
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::formats::FormatError;
use cardiotwin_schemas::organ::CELL_PARAMETERS;
use cardiotwin_schemas::outcome::Ending;

use cardiotwin_models::cell0d::CellError;
use cardiotwin_models::circulation::CirculationError;
use cardiotwin_models::circulation::estimate::EstimateError;
use cardiotwin_models::contraction::ContractionError;
use cardiotwin_models::effects::EffectError;
use cardiotwin_models::ventricle::VentricleError;
use cardiotwin_signals::resample::ResampleError;
use cardiotwin_signals::{BiomarkerError, TraceError};

use crate::finite_element::FiniteElementError;
use crate::nodal::NodalError;

/// Reasons why a task did not succeed.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// An input file cannot be read.
    #[error("cannot read {role} input {file}")]
    InputMissing {
        /// Role of the file in the task.
        role: String,
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// An input file changed after the task was planned.
    #[error("{role} input {file} has SHA-256 {found}, but the task was planned with {expected}")]
    InputChanged {
        /// Role of the file in the task.
        role: String,
        /// Path of the file.
        file: PathBuf,
        /// Hash of the file as it is now.
        found: String,
        /// Hash in the specification.
        expected: String,
    },
    /// A measured trace is not usable.
    #[error("{role} trace: {message}")]
    Measured {
        /// Role of the file in the task.
        role: String,
        /// File and line, with the found and the expected value.
        message: String,
    },
    /// A measured trace cannot be resampled to the common step.
    #[error("cannot resample the measured trace")]
    Resample(#[from] ResampleError),
    /// No biomarkers can be computed from the traces.
    #[error("cannot determine the biomarkers")]
    Biomarkers(#[from] BiomarkerError),
    /// A quantity is missing without which no beat can be simulated.
    #[error("no {what} was measured")]
    NotMeasured {
        /// Name of the quantity, in words.
        what: &'static str,
        /// Advice on the data to add.
        remedy: &'static str,
    },
    /// A factor of a sample of uncertain data cannot be applied to its biomarker.
    #[error("biomarker `{name}` cannot be multiplied by {factor}: {why}; step 1 fits {}", Biomarker::COST_KEYS.join(", "))]
    Factor {
        /// Key of the biomarker.
        name: String,
        /// Factor that the sample asks for.
        factor: f64,
        /// Reason why the factor cannot be applied.
        why: &'static str,
    },
    /// The settings of step 1 are invalid.
    #[error("invalid settings of step 1")]
    Step1(#[from] FixedPointError),
    /// A load or filling pressure cannot be estimated.
    #[error("cannot estimate a load that the patient file lacks")]
    Load(#[from] EstimateError),
    /// The measured points do not determine a passive law.
    #[error("cannot determine the passive state")]
    PassiveState(#[source] VentricleError),
    /// The organ model rejects its parameters.
    #[error("cannot simulate the organ")]
    Organ(#[source] VentricleError),
    /// A simulation found no further step.
    #[error("diverged after {last_good_ms} ms")]
    Diverged {
        /// Time of the last good state from the beginning of the simulation.
        last_good_ms: f64,
        /// Failure of the shortest step.
        source: VentricleError,
    },
    /// The contraction model rejects its parameters.
    #[error("the contraction model failed")]
    Contraction(#[source] ContractionError),
    /// openCARP has no plugin for the contraction model.
    #[error("openCARP has no plugin for contraction model `{model}`")]
    NoPlugin {
        /// Name of the model.
        model: String,
    },
    /// The circulation model rejects its parameters.
    #[error("the circulation failed")]
    Circulation(#[source] CirculationError),
    /// The 0D cell model rejects its parameters, or has no periodic beat.
    #[error("cannot compute the 0D cell")]
    Cell(#[from] CellError),
    /// A parameter is to be fitted but has no bounds.
    #[error("parameter `{name}` is to be fitted, but has no bounds")]
    NoBounds {
        /// Name of the parameter.
        name: String,
    },
    /// A weight is given for a name that is not a target.
    #[error("weight of `{name}`, which is not a target")]
    UnknownWeight {
        /// Name that the settings give a weight.
        name: String,
    },
    /// A target is not positive and finite, so that relative differences from it are undefined.
    #[error("target {name} = {value} must be positive and finite")]
    Target {
        /// Name of the target.
        name: &'static str,
        /// Value of the target.
        value: f64,
    },
    /// The design of a sweep is invalid.
    #[error("invalid design of the sweep")]
    Design(#[from] SobolError),
    /// The optimiser rejects its settings.
    #[error("the search of step 2 failed")]
    Population(#[from] PopulationError),
    /// The organ's law cannot be fitted to the given beats.
    #[error("the organ's law cannot be fitted")]
    OrganLaw(#[from] OrganLawError),
    /// The file of the organ's law cannot be read.
    #[error("the file of the organ's law cannot be used")]
    LawFile(#[from] FormatError),
    /// A file from which the organ's law is to be learned cannot be read.
    #[error("{path}: no readable file", path = path.display())]
    LawBeat {
        /// Path of the file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The profiles of the fitted parameters could not be computed.
    #[error("the analysis of identifiability failed")]
    Identifiability(#[from] IdentifiabilityError),
    /// The cell engine rejects its settings, or the processor lacks the requested instructions.
    #[error("the cell engine failed")]
    Engine(#[from] EngineError),
    /// The cell engine rejects the calcium samples.
    #[error("invalid calcium samples")]
    CalciumSamples(#[from] InputProblem),
    /// The fitted cell has no periodic beat.
    #[error("the fitted cell has no periodic beat ({status})")]
    NoBeat {
        /// Status with which the engine ended.
        status: String,
    },
    /// No cell within the bounds could be computed.
    #[error("no cell within the bounds could be computed")]
    NoCell,
    /// A checkpoint cannot be written.
    #[error("cannot write a checkpoint")]
    Checkpoint(#[source] io::Error),
    /// The threads cannot be started.
    #[error("cannot start threads")]
    Threads(#[source] rayon::ThreadPoolBuildError),
    /// An accepted effect cannot be simulated.
    #[error("cannot apply the effects of the patient's model")]
    Effect(#[source] EffectError),
    /// An external solver's ventricle, which has a circulation of its own, was given a closed one.
    #[error("a closed circulation does not surround the ventricle of an external solver")]
    ClosedLoop,
    /// The blood volume of a loop follows from the periodic beat, and a number of beats was asked for.
    #[error("a loop's blood volume is found with the periodic beat, not after a number of beats")]
    LoopWithoutPeriodicState,
    /// The finite-element ventricle failed.
    #[error(transparent)]
    FiniteElement(#[from] FiniteElementError),
    /// A simulated trace is invalid. States are checked to be finite beforehand, so this points to
    /// a bug.
    #[error("invalid simulated trace")]
    SimulatedTrace(#[source] TraceError),
    /// The medians of the nodal traces have no biomarkers.
    #[error("the medians of {n_nodes} nodal traces have no active stress")]
    NoMedian {
        /// Number of nodes whose traces were read.
        n_nodes: u64,
    },
    /// A file of nodal traces is not usable.
    #[error("cannot use {file}")]
    Nodal {
        /// Path of the file.
        file: PathBuf,
        /// Position of the error in the file, and the expected content.
        source: NodalError,
    },
    /// The cell model has no parameter of this name.
    #[error("the cell has no parameter `{name}`; it has {}", CELL_PARAMETERS.join(", "))]
    UnknownParameter {
        /// Name that was asked for.
        name: String,
    },
    /// The search for missing effects rejects its data or settings, or has no base fit.
    #[error("the search for missing effects failed")]
    Discover(#[from] DiscoverError),
    /// The thread of the search for missing effects died, or its answer lacks a base value.
    #[error("the search for missing effects ended without an answer")]
    SearchEnded,
    /// There is no further iterate to propose for step 1.
    #[error("nothing to simulate next: {0}")]
    NoProposal(&'static str),
    /// The one-fibre ventricle has no beat between the twin's parameters and the prior's centre, or too few draws.
    #[error(
        "the fast ventricle (the organ's law, or one fibre) has no beat near the twin's parameters, so the posterior cannot be sampled"
    )]
    NoPosterior,
    /// The settings of an external solver are invalid.
    #[error("solver.external: {0}")]
    External(String),
    /// An external solver cannot be started.
    #[error("the external solver `{program}` cannot be started")]
    ExternalStart {
        /// First word of the command.
        program: String,
        /// The operating system's error.
        source: io::Error,
    },
    /// An artefact cannot be written.
    #[error("cannot write {file}")]
    Write {
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The task was asked to stop.
    #[error("stopped on request")]
    Cancelled,
}

impl From<EffectError> for TaskError {
    /// Errors of the base model's parts keep their own variant, with or without effects.
    fn from(error: EffectError) -> Self {
        match error {
            EffectError::Circulation(error) => Self::Circulation(error),
            EffectError::Ventricle(error) => Self::Organ(error),
            EffectError::Contraction(error) => Self::Contraction(error),
            error => Self::Effect(error),
        }
    }
}

impl TaskError {
    fn class(&self) -> FailureClass {
        match self {
            Self::InputMissing { .. }
            | Self::InputChanged { .. }
            | Self::Measured { .. }
            | Self::Resample(_)
            | Self::Biomarkers(_)
            | Self::NotMeasured { .. }
            | Self::Factor { .. }
            | Self::Step1(_)
            | Self::Load(_)
            | Self::PassiveState(_)
            | Self::UnknownParameter { .. }
            | Self::NoBounds { .. }
            | Self::UnknownWeight { .. }
            | Self::Target { .. }
            | Self::External(_)
            | Self::ExternalStart { .. }
            | Self::Design(_)
            | Self::OrganLaw(_)
            | Self::LawFile(_)
            | Self::LawBeat { .. }
            | Self::Population(_)
            | Self::CalciumSamples(_)
            | Self::Engine(_) => FailureClass::Input,
            // If the organ overstretches a fitted cell, the patient's data are not at fault.
            Self::Organ(VentricleError::Contraction {
                source: ContractionError::Sensitivity { .. },
                ..
            }) => FailureClass::Numerics,
            Self::Organ(_)
            | Self::Contraction(_)
            | Self::NoPlugin { .. }
            | Self::Circulation(_)
            | Self::ClosedLoop
            | Self::LoopWithoutPeriodicState
            | Self::Effect(_) => FailureClass::Input,
            Self::Cell(error) => match error {
                CellError::Parameter { .. } | CellError::Contraction(_) | CellError::Calcium(_) => {
                    FailureClass::Input
                }
                _ => FailureClass::Numerics,
            },
            Self::FiniteElement(error) => error.class(),
            Self::Diverged { .. }
            | Self::NoMedian { .. }
            | Self::SimulatedTrace(_)
            | Self::NoCell
            | Self::NoBeat { .. }
            | Self::NoPosterior
            | Self::NoProposal(_) => FailureClass::Numerics,
            Self::Discover(DiscoverError::NoBaseFit) => FailureClass::Numerics,
            Self::Discover(_) => FailureClass::Input,
            Self::Nodal { .. } | Self::Identifiability(_) | Self::SearchEnded => FailureClass::Bug,
            Self::Write { .. } | Self::Checkpoint(_) | Self::Threads(_) | Self::Cancelled => {
                FailureClass::Site
            }
        }
    }

    fn remedy(&self) -> Option<&'static str> {
        match self {
            Self::InputMissing { .. } => {
                Some("put the file back, or run again so that the task is planned anew")
            }
            Self::InputChanged { .. } => Some(
                "the file was edited after planning: run again, so that the task is planned with the new content",
            ),
            Self::NotMeasured { remedy, .. } => Some(remedy),
            Self::Factor { .. } => Some("correct the sample's factors"),
            Self::Step1(_) => Some("correct the setting named in the message"),
            Self::Load(_) => {
                Some("correct the arterial pressures, or give [afterload] and [preload]")
            }
            Self::PassiveState(_) => {
                Some("correct end-diastolic pressure and volume, wall volume or diastasis")
            }
            Self::Measured { .. } | Self::Resample(_) | Self::Biomarkers(_) => {
                Some("`cardiotwin check` tells all that is wrong with the data")
            }
            Self::Effect(EffectError::Artefact { remedy, .. }) => Some(remedy),
            Self::Effect(EffectError::Unknown { .. }) => {
                Some("use a version that has it, or remove it from the patient's model")
            }
            Self::Effect(_) => Some("correct the effect in the patient's model"),
            Self::Contraction(
                ContractionError::UnknownModel { .. } | ContractionError::UnknownParameter { .. },
            ) => Some("correct the name in the contraction of the beat"),
            Self::NoPlugin { .. } => Some("export a beat with the Tanh or the Land model"),
            Self::Organ(_) | Self::Contraction(_) | Self::Circulation(_) | Self::Cell(_) => Some(
                "set bounds or start values so that the parameter stays inside the model's range",
            ),
            Self::ClosedLoop => Some("use the law, the reduced ventricle, or the open circulation"),
            Self::LoopWithoutPeriodicState => {
                Some("ask for periodic beats, or leave the filling of the loop out")
            }
            Self::FiniteElement(error) => error.remedy(),
            Self::Diverged { .. } | Self::NoMedian { .. } | Self::SimulatedTrace(_) => None,
            Self::NoProposal(_) => Some(
                "rerun from step1 with other initial values, bounds or update = \"fixed-point\"",
            ),
            Self::NoPosterior => {
                Some("set posterior.enabled = false, or rerun from step3 with other bounds")
            }
            Self::External(_) => Some("correct [solver.external] or the template"),
            Self::ExternalStart { .. } => {
                Some("correct solver.external.command, or PATH where workers run, then run again")
            }
            Self::NoBounds { .. } => Some("give it bounds in [step2.bounds]"),
            Self::UnknownWeight { .. } => Some("correct [step2.weights]"),
            Self::NoCell => Some("move the bounds in [step2.bounds] towards Table A5's"),
            Self::Population(_) => Some("correct [step2]"),
            Self::Engine(_) => {
                Some("set executor.instruction_set to \"auto\", or correct the sweep's settings")
            }
            Self::Design(_) => Some("sweep again with bounds and settings that make sense"),
            Self::CalciumSamples(_) => Some("correct measured.calcium"),
            Self::Discover(DiscoverError::UnknownEffect { .. }) => Some("correct --effects"),
            Self::Discover(_) => {
                Some("`cardiotwin check` tells what is wrong with a cohort's data")
            }
            Self::OrganLaw(_) => Some("rerun from step1"),
            Self::LawBeat { .. } => {
                Some("name the directory of a published attempt of an organ beat")
            }
            Self::LawFile(_) => Some("write the file again with `cardiotwin export --law`"),
            Self::NoBeat { .. } | Self::Identifiability(_) | Self::SearchEnded => None,
            Self::Threads(_) => Some("lower executor.threads, or raise the limit of processes"),
            Self::Nodal { .. } | Self::UnknownParameter { .. } | Self::Target { .. } => None,
            Self::Write { .. } | Self::Checkpoint(_) => {
                Some("free space or restore write access, then retry")
            }
            Self::Cancelled => None,
        }
    }

    /// The ending with which a task reports this error.
    #[must_use]
    pub fn into_ending(self) -> Ending {
        match self {
            Self::Cancelled => Ending::Cancelled,
            error => Ending::Failed {
                failure: Failure {
                    class: error.class(),
                    message: chain(&error),
                    remedy: error.remedy().map(ToOwned::to_owned),
                    cause: None,
                },
            },
        }
    }
}

/// Joins an error and its causes in one line, outermost first.
#[must_use]
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(source) = cause {
        text.push_str(": ");
        text.push_str(&source.to_string());
        cause = source.source();
    }
    text
}
