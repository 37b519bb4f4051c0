//! Specification of a task, and its key.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{Biomarkers, CellBiomarkers};
use crate::discover::DiscoverSpec;
use crate::filling::FlowMeasurements;
use crate::finite_element::{AnatomySpec, OwnMesh};
use crate::hash::{canonical_json, sha256_hex};
use crate::ids::{AttemptId, PatientId, TaskKey};
use crate::organ::{EffectSpec, OneFibrePassive, OrganSpec, Step1Parameters, WindkesselParameters};
use crate::organ_law::{LawLesson, LawSamples};
use crate::posterior::PosteriorSpec;
use crate::samples::{BeatSamples, MeasuredTraces};
use crate::settings::{ActivationSettings, CellFitSettings, InstructionSet, StartMode};
use crate::sweep::CellDesign;

pub use crate::input_file::InputFile;
pub use crate::organ_beat::OrganBeatSpec;
pub use crate::step3::MovedParameter;

/// Work of one task with all of its inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum TaskSpec {
    /// Step 0: passive state, loads, measured biomarkers.
    PassiveState(Box<PassiveStateSpec>),
    /// One simulation of the organ: an iteration of step 1, or the verification beat.
    OrganBeat(Box<OrganBeatSpec>),
    /// The organ's law before a patient's first beat, from the beats of pilots.
    LearnLaw(Box<LearnLawSpec>),
    /// Choice of the next parameters in step 1, by space mapping.
    Step1Proposal(Box<Step1ProposalSpec>),
    /// Choice of the next parameters in step 3, by space mapping.
    Step3Proposal(Box<Step3ProposalSpec>),
    /// Posterior of the twin's parameters.
    Posterior(Box<PosteriorSpec>),
    /// Median nodal traces and the targets of step 2.
    Targets(TargetsSpec),
    /// Step 2: fit of the cell.
    CellFit(Box<CellFitSpec>),
    /// A part of a sensitivity sweep: complete Saltelli blocks of 0D cells.
    CellSweep(Box<CellSweepSpec>),
    /// Search for effects that the reduced ventricle lacks in a patient's traces.
    Discover(Box<DiscoverSpec>),
    /// No work, to measure the orchestration.
    Noop(NoopSpec),
}

impl TaskSpec {
    /// Number of parts of the mesh that the task asks for; 0 for one per thread or MPI rank.
    #[must_use]
    pub fn subdomains(&self) -> u32 {
        match self {
            Self::PassiveState(spec) => (spec.finite_element.as_ref()).map_or(0, |f| f.subdomains),
            Self::OrganBeat(spec) => spec.finite_element.map_or(0, |f| f.subdomains),
            _ => 0,
        }
    }

    /// Name of the kind in files and tables.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::PassiveState(_) => "passive-state",
            Self::OrganBeat(_) => "organ-beat",
            Self::LearnLaw(_) => LEARN_LAW,
            Self::Step1Proposal(_) => "step1-proposal",
            Self::Step3Proposal(_) => "step3-proposal",
            Self::Posterior(_) => "posterior",
            Self::Targets(_) => "targets",
            Self::CellFit(_) => "cell-fit",
            Self::CellSweep(_) => "cell-sweep",
            Self::Discover(_) => "discover",
            Self::Noop(_) => "noop",
        }
    }

    /// Whether this is a simulation of the 3D ventricle (step 0 or a beat), which can be divided
    /// among ranks.
    #[must_use]
    pub fn is_in_3d(&self) -> bool {
        match self {
            Self::PassiveState(spec) => spec.finite_element.is_some(),
            Self::OrganBeat(spec) => matches!(spec.organ, OrganSpec::FiniteElement(_)),
            _ => false,
        }
    }

    /// Version of the model, which is part of the key. It is raised by hand when the results of a
    /// kind change.
    #[must_use]
    pub fn model_version(&self) -> u32 {
        match self {
            Self::OrganBeat(_) => 15,
            Self::PassiveState(_) => 11,
            Self::Discover(_) => 10,
            Self::Step3Proposal(_) => 12,
            Self::Step1Proposal(_) => 10,
            Self::CellFit(_) => 6,
            Self::CellSweep(_) => 4,
            Self::Posterior(_) => 8,
            Self::Targets(_) => 3,
            Self::LearnLaw(_) | Self::Noop(_) => 1,
        }
    }

    /// Canonical JSON with the model version and without paths. The key is its hash, and `explain`
    /// compares it.
    ///
    /// # Panics
    /// Never: every spec can be represented in JSON.
    #[must_use]
    pub fn canonical(&self) -> String {
        let mut value = serde_json::to_value(self).expect("a task spec is JSON");
        strip_paths(&mut value);
        value["model_version"] = self.model_version().into();
        canonical_json(&value).expect("a JSON value is JSON")
    }

    /// Key of the task.
    #[must_use]
    pub fn key(&self) -> TaskKey {
        TaskKey(sha256_hex(self.canonical().as_bytes()))
    }
}

/// Removes each `path` next to a `sha256`, because the location of a file does not change its
/// content.
fn strip_paths(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Object(map) => {
            if map.contains_key("sha256") {
                map.remove("path");
            }
            map.values_mut().for_each(strip_paths);
        }
        serde_json::Value::Array(items) => items.iter_mut().for_each(strip_paths),
        _ => {}
    }
}

/// Role of a law file in tasks that start from it.
pub const LAW_FILE: &str = "organ's law";

/// Kind of the tasks that learn the organ's law from pilots.
pub const LEARN_LAW: &str = "learn-law";

/// The organ's law from the beats of pilots (`workflow.pilots`). Each patient who starts from it
/// has such a task of its own, so that patients in different jobs never wait for each other; the
/// tasks differ in `learner` alone, and their results are the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LearnLawSpec {
    /// Pseudonym of the patient who starts from the law.
    pub learner: PatientId,
    /// File of the law from which learning starts; absent for the law of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<InputFile>,
    /// What each pilot teaches, sorted by name. Pilots without a beat teach nothing.
    pub lessons: Vec<LawLesson>,
}

/// Input of step 0 (SPEC section 3, "passive state", and section 4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PassiveStateSpec {
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// File with the measured pressure trace.
    pub pressure: Option<InputFile>,
    /// File with the measured volume trace.
    pub volume: Option<InputFile>,
    /// Measured biomarkers that are given directly. They complement the biomarkers from traces and
    /// take precedence over them.
    pub biomarkers: Biomarkers,
    /// Measured end-diastolic pressure.
    #[serde(rename = "end_diastolic_pressure_mmHg")]
    pub end_diastolic_pressure_mmhg: Option<f64>,
    /// Measured end-diastolic volume, if there is no volume trace.
    #[serde(rename = "end_diastolic_volume_mL")]
    pub end_diastolic_volume_ml: Option<f64>,
    /// Time of the whole-heart image.
    pub diastasis_time_ms: Option<f64>,
    /// Volume of the whole-heart image.
    #[serde(rename = "diastasis_volume_mL")]
    pub diastasis_volume_ml: Option<f64>,
    /// Systolic pressure by cuff or in the aorta.
    #[serde(rename = "aortic_systolic_mmHg")]
    pub aortic_systolic_mmhg: Option<f64>,
    /// Diastolic pressure by cuff or in the aorta.
    #[serde(rename = "aortic_diastolic_mmHg")]
    pub aortic_diastolic_mmhg: Option<f64>,
    /// Volume of the left ventricular wall; estimated and marked as such if absent.
    #[serde(rename = "wall_volume_mL")]
    pub wall_volume_ml: Option<f64>,
    /// Exponent of the passive law, if known.
    pub passive_exponent: Option<f64>,
    /// Windkessel parameters, if they were determined beforehand.
    pub afterload: Option<WindkesselParameters>,
    /// Filling pressure, if known.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: Option<f64>,
    /// Atrial pressure, mitral flow and net forward volume, where they were measured.
    #[serde(default, skip_serializing_if = "FlowMeasurements::is_empty")]
    pub flows: FlowMeasurements,
    /// State at which the beat starts.
    pub start: StartMode,
    /// Activation of the reduced ventricle.
    pub activation: ActivationSettings,
    /// Factors on the measured biomarkers for a sample of uncertain data (Jung et al. 2022, section
    /// 2.5). They are applied after everything else has been derived from the data as measured.
    /// Keys are those of the biomarkers in the cost.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub biomarker_factors: BTreeMap<String, f64>,
    /// Passive law that was accepted for the patient and replaces the law through the measured
    /// points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passive_law: Option<OneFibrePassive>,
    /// Artefacts that are removed from the traces before they are used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub corrections: Vec<EffectSpec>,
    /// Input for the finite-element ventricle; absent for the reduced one.
    #[serde(
        default,
        deserialize_with = "crate::earlier::anatomy",
        skip_serializing_if = "Option::is_none"
    )]
    pub finite_element: Option<AnatomySpec>,
    /// Patient's own mesh, for the finite-element ventricle. If absent, a mesh is generated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_mesh: Option<OwnMesh>,
    /// Guccione's C from the patient file, for the finite-element ventricle. It is not fitted if
    /// given.
    #[serde(
        rename = "guccione_C_kPa",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub guccione_c_kpa: Option<f64>,
}

/// Input of a proposal in step 1: search for the optimum of the one-fibre ventricle, corrected to
/// the simulations so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step1ProposalSpec {
    /// Beat for which parameters are sought. Its own parameters are the initial guess. For a
    /// finite-element ventricle, a one-fibre ventricle of the same volumes, pressure and activation
    /// is used.
    pub beat: OrganBeatSpec,
    /// Measured biomarkers to reach.
    pub measured: Biomarkers,
    /// Simulations so far, oldest first.
    pub runs: Vec<Step1Run>,
    /// Bounds of the updated parameters, lower and upper.
    pub bounds: BTreeMap<String, [f64; 2]>,
    /// Parameters that stay at their initial value.
    pub frozen: Vec<String>,
    /// Weights of the squared relative differences in the misfit, if they differ from those of the
    /// cost, which are 0 for `SV_mL` and 1 for the others.
    pub weights: BTreeMap<String, f64>,
    /// Beats from which the organ's law is learned, oldest first. The surrogate is the one-fibre
    /// ventricle if the field is absent, and the law of the prior if it is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<Vec<LawSamples>>,
    /// File of the law before the first beat ([`crate::organ_law::LawFile`]); absent for the law of
    /// the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<InputFile>,
    /// Seed of the points at which the searches start.
    pub seed: u64,
}

/// A simulation as input of a proposal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ProposalRun<P> {
    /// Parameters of the simulation.
    pub parameters: P,
    /// Simulated biomarkers; absent if the simulation failed.
    pub biomarkers: Option<Biomarkers>,
    /// Whether both valves opened and closed.
    pub whole_beat: bool,
    /// Misfit predicted by the proposal from which the simulation came.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_misfit: Option<f64>,
}

/// A simulation of step 1.
pub type Step1Run = ProposalRun<Step1Parameters>;

/// The verification beat or a simulation of step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step3Run {
    /// Parameters and biomarkers of the simulation.
    pub run: ProposalRun<BTreeMap<String, f64>>,
    /// Samples of pressure and volume; absent if the simulation failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<BeatSamples>,
}

/// Input of a proposal in step 3: search for the cell with which the organ agrees with the measured
/// biomarkers, in the one-fibre ventricle with that cell, corrected to the beats so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step3ProposalSpec {
    /// Beat with the cell of step 2. Only the figures of a finite-element ventricle are used.
    pub beat: OrganBeatSpec,
    /// Measured biomarkers to reach.
    pub measured: Biomarkers,
    /// Beats so far; the verification beat comes first.
    pub runs: Vec<Step3Run>,
    /// Parameters that may vary, by name.
    pub parameters: BTreeMap<String, MovedParameter>,
    /// Standard deviation of each measured biomarker, percent of its value. A biomarker without an
    /// entry does not count.
    pub uncertainty_percent: BTreeMap<String, f64>,
    /// Best beat of step 1, which shows the response of the organ near the measurements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step1: Option<Step1Beat>,
    /// Measured traces; absent if no trace counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traces: Option<MeasuredTraces>,
    /// Beats from which the organ's law is learned, as in step 1's proposals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<Vec<LawSamples>>,
    /// File of the law before the first beat ([`crate::organ_law::LawFile`]); absent for the law of
    /// the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<InputFile>,
    /// Seed of the points at which the searches start.
    pub seed: u64,
}

/// A beat of step 1 as input of step 3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step1Beat {
    /// Parameters of the beat.
    pub parameters: Step1Parameters,
    /// Biomarkers of the simulated beat.
    pub biomarkers: Biomarkers,
}

/// A patient's cell in the organ, the start of step 3.
#[derive(Debug, Clone, PartialEq)]
pub struct CellInOrgan {
    /// Verification beat, with the cell of step 2.
    pub beat: OrganBeatSpec,
    /// Best beat of step 1; `None` if step 1 gave none.
    pub step1: Option<Step1Beat>,
    /// Beats of step 1 from which the organ's law is learned; `None` for the one-fibre ventricle.
    pub law: Option<Vec<LawSamples>>,
}

impl CellInOrgan {
    /// Beats from which the organ's law is learned: step 1's, then `others`. `None` for the one-fibre
    /// ventricle.
    #[must_use]
    pub fn law_with(&self, others: &[LawSamples]) -> Option<Vec<LawSamples>> {
        let step1 = self.law.as_ref()?;
        Some(step1.iter().chain(others).cloned().collect())
    }
}

/// Input for the median nodal traces and the targets of step 2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TargetsSpec {
    /// File `nodal.csv` of the simulation.
    pub nodal: InputFile,
}

/// Input of step 2 (SPEC section 6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellFitSpec {
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// First value of the median stretch trace.
    pub lambda_0: f64,
    /// Largest stretch of any node: Ca50 stays above the resting calcium up to there. Earlier programs did not ask for that; at 1
    /// every Ca50 within its bounds fulfils it.
    #[serde(default = "crate::absent::one")]
    pub lambda_max: f64,
    /// Biomarkers to reach.
    pub targets: CellBiomarkers,
    /// Method, parameters, bounds, weights and frozen values.
    pub settings: CellFitSettings,
    /// Seed of all random numbers of this fit.
    pub seed: u64,
    /// Parameters that are not fitted and have values other than the defaults.
    pub fixed: BTreeMap<String, f64>,
    /// File with calcium from activation on, columns `time_ms` and `Ca_uM`, if calcium is a fixed
    /// input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calcium: Option<InputFile>,
}

/// Some blocks of a Saltelli design. The number of blocks in the design is not included, because a
/// longer design has the same first blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellSweepSpec {
    /// Design of the sweep.
    pub design: CellDesign,
    /// Index of the first block, from 0.
    pub first_block: u32,
    /// Number of blocks, of 2D + 2 samples each.
    pub n_blocks: u32,
}

/// A task without work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct NoopSpec {
    /// Label that makes the task distinct.
    pub label: String,
    /// How long the task sleeps.
    pub sleep_ms: u64,
}

/// `spec.json` of an attempt: the task and the number of the attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AttemptSpec {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Task and number of the attempt.
    pub attempt: AttemptId,
    /// Number of threads that the worker may use.
    pub threads: u32,
    /// Instructions of the cell engine.
    #[serde(default, skip_serializing_if = "InstructionSet::is_auto")]
    pub instruction_set: InstructionSet,
    /// Simulated time between frames of the series of VTU files of a finite-element beat; 0 for the
    /// first and last frame of a beat with a cell model, and no others.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero")]
    pub vtu_every_ms: f64,
    /// Work to be done.
    pub task: TaskSpec,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn targets(path: &str, sha256: &str) -> TaskSpec {
        TaskSpec::Targets(TargetsSpec {
            nodal: InputFile {
                name: "nodal".into(),
                path: path.into(),
                sha256: sha256.into(),
            },
        })
    }

    #[test]
    fn a_moved_file_keeps_the_key_and_a_changed_one_does_not() {
        assert_eq!(targets("/a", "1").key(), targets("/b", "1").key());
        assert_ne!(targets("/a", "1").key(), targets("/a", "2").key());
    }

    #[test]
    fn spec_survives_json() {
        let spec = targets("/a", "1");
        let text = serde_json::to_string(&spec).unwrap();
        assert_eq!(serde_json::from_str::<TaskSpec>(&text).unwrap(), spec);
    }
}
