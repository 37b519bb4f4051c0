//! Why a task failed, and what that asks for.

use std::io;
use std::path::PathBuf;

use cardiotwin_calibrate::fixed_point::FixedPointError;
use cardiotwin_calibrate::identifiability::IdentifiabilityError;
use cardiotwin_calibrate::population::PopulationError;
use cardiotwin_calibrate::sobol::SobolError;
use cardiotwin_cell_engine::{EngineError, InputProblem};
use cardiotwin_discover::DiscoverError;
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::failure::{Failure, FailureClass};
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

/// Why a task did not succeed.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// An input file cannot be read.
    #[error("cannot read {role} input {file}")]
    InputMissing {
        /// What the file is for.
        role: String,
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// An input file is not the one that the task was planned with.
    #[error("{role} input {file} has SHA-256 {found}, but the task was planned with {expected}")]
    InputChanged {
        /// What the file is for.
        role: String,
        /// Which file.
        file: PathBuf,
        /// Hash of what lies there now.
        found: String,
        /// Hash in the specification.
        expected: String,
    },
    /// A measured trace cannot be used.
    #[error("{role} trace: {message}")]
    Measured {
        /// What the file is for.
        role: String,
        /// File, line, what was found and expected.
        message: String,
    },
    /// A measured trace cannot be brought to the common step.
    #[error("measured trace cannot be resampled")]
    Resample(#[from] ResampleError),
    /// Traces give no biomarkers.
    #[error("no biomarkers")]
    Biomarkers(#[from] BiomarkerError),
    /// Something without which no beat can be simulated.
    #[error("no {what} was measured")]
    NotMeasured {
        /// What is missing.
        what: &'static str,
        /// What to add.
        remedy: &'static str,
    },
    /// A factor of a sample of uncertain data that cannot be applied.
    #[error("biomarker `{name}` cannot be multiplied by {factor}: {why}; step 1 fits {}", Biomarker::COST_KEYS.join(", "))]
    Factor {
        /// The biomarker's key.
        name: String,
        /// Its factor.
        factor: f64,
        /// What is wrong.
        why: &'static str,
    },
    /// Settings of step 1 make no sense.
    #[error("settings of step 1")]
    Step1(#[from] FixedPointError),
    /// A load or filling pressure cannot be estimated.
    #[error("a load that the patient file lacks cannot be estimated")]
    Load(#[from] EstimateError),
    /// The measured points determine no passive law.
    #[error("passive state")]
    PassiveState(#[source] VentricleError),
    /// The organ refused its parameters.
    #[error("organ")]
    Organ(#[source] VentricleError),
    /// The contraction model refused its parameters.
    #[error("contraction model")]
    Contraction(#[source] ContractionError),
    /// The circulation refused its parameters.
    #[error("circulation")]
    Circulation(#[source] CirculationError),
    /// The 0D cell refused its parameters, or has no periodic beat.
    #[error("0D cell")]
    Cell(#[from] CellError),
    /// A parameter is to be fitted that has no bounds.
    #[error("parameter `{name}` is to be fitted, but has no bounds")]
    NoBounds {
        /// Its name.
        name: String,
    },
    /// A weight for something that is no target.
    #[error("there is no target `{name}` to weigh")]
    UnknownWeight {
        /// Its name.
        name: String,
    },
    /// A target from which no relative difference can be taken.
    #[error("target {name} = {value} must be positive and finite")]
    Target {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The design of a sweep makes no sense.
    #[error("design of the sweep")]
    Design(#[from] SobolError),
    /// The optimiser refused its settings.
    #[error("step 2's strategy")]
    Population(#[from] PopulationError),
    /// The profiles of the fitted parameters could not be made.
    #[error("identifiability")]
    Identifiability(#[from] IdentifiabilityError),
    /// The cell engine refused its settings, or this processor lacks the instructions that were asked for.
    #[error("cell engine")]
    Engine(#[from] EngineError),
    /// The cell engine refused the calcium samples.
    #[error("calcium")]
    CalciumSamples(#[from] InputProblem),
    /// A cell that was computed before has no periodic beat.
    #[error("the fitted cell has no periodic beat ({status})")]
    NoBeat {
        /// How it ended.
        status: String,
    },
    /// No parameters within the bounds gave a cell that could be computed.
    #[error("no cell within the bounds could be computed")]
    NoCell,
    /// Work in hand cannot be kept.
    #[error("cannot write a checkpoint")]
    Checkpoint(#[source] io::Error),
    /// The threads could not be started.
    #[error("cannot start threads")]
    Threads(#[source] rayon::ThreadPoolBuildError),
    /// An accepted effect cannot be simulated.
    #[error("effects of the patient's model")]
    Effect(#[source] EffectError),
    /// No finite-element ventricle.
    #[error(transparent)]
    FiniteElement(#[from] FiniteElementError),
    /// A simulated trace is not one: finite states were checked before.
    #[error("simulated trace")]
    SimulatedTrace(#[source] TraceError),
    /// Nodal traces without a median that has biomarkers.
    #[error("the medians of {n_nodes} nodal traces have no active stress to be characterised")]
    NoMedian {
        /// Number of nodes.
        n_nodes: u64,
    },
    /// A file of nodal traces cannot be used.
    #[error("{file}")]
    Nodal {
        /// Which file.
        file: PathBuf,
        /// Line and reason.
        source: NodalError,
    },
    /// A parameter that the cell model does not have.
    #[error("the cell has no parameter `{name}`; it has {}", CELL_PARAMETERS.join(", "))]
    UnknownParameter {
        /// The name given.
        name: String,
    },
    /// The search refused its data or settings, or has no base fit.
    #[error("search for missing effects")]
    Discover(#[from] DiscoverError),
    /// The search came to no answer, or to one that its own model does not repeat.
    #[error("the search for missing effects ended without an answer")]
    SearchEnded,
    /// Nothing can be proposed for step 1.
    #[error("nothing to simulate next: {0}")]
    NoProposal(&'static str),
    /// The one-fibre ventricle has no beat with the twin's parameters, or none near them.
    #[error(
        "the one-fibre ventricle makes no beat near the twin's parameters: its posterior cannot be sampled"
    )]
    NoPosterior,
    /// The settings of an external solver make no sense.
    #[error("solver.external: {0}")]
    External(String),
    /// An external solver cannot be started.
    #[error("the external solver `{program}` cannot be started")]
    ExternalStart {
        /// The command's first word.
        program: String,
        /// Why.
        source: io::Error,
    },
    /// An artefact cannot be written.
    #[error("cannot write {file}")]
    Write {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Stopping was asked for.
    #[error("stopped on request")]
    Cancelled,
}

impl From<EffectError> for TaskError {
    /// What the base model's parts refuse is theirs, whether or not there are effects.
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
            | Self::Population(_)
            | Self::CalciumSamples(_)
            | Self::Engine(_) => FailureClass::Input,
            // A fitted cell that the organ stretches too far says nothing of the patient's data.
            Self::Organ(VentricleError::Contraction {
                source: ContractionError::Sensitivity { .. },
                ..
            }) => FailureClass::Numerics,
            Self::Organ(_) | Self::Contraction(_) | Self::Circulation(_) | Self::Effect(_) => {
                FailureClass::Input
            }
            Self::Cell(error) => match error {
                CellError::Parameter { .. } | CellError::Contraction(_) | CellError::Calcium(_) => {
                    FailureClass::Input
                }
                _ => FailureClass::Numerics,
            },
            Self::FiniteElement(error) => error.class(),
            Self::NoMedian { .. }
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
            Self::Organ(_) | Self::Contraction(_) | Self::Circulation(_) | Self::Cell(_) => Some(
                "set bounds or start values so that the parameter stays inside the model's range",
            ),
            Self::FiniteElement(error) => error.remedy(),
            Self::NoMedian { .. } | Self::SimulatedTrace(_) => None,
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
            Self::NoBeat { .. } | Self::Identifiability(_) | Self::SearchEnded => None,
            Self::Threads(_) => Some("lower executor.threads, or raise the limit of processes"),
            Self::Nodal { .. } | Self::UnknownParameter { .. } | Self::Target { .. } => None,
            Self::Write { .. } | Self::Checkpoint(_) => {
                Some("free space or restore write access, then retry")
            }
            Self::Cancelled => None,
        }
    }

    /// The ending that this error means.
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

/// An error with its causes, outermost first, on one line.
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
