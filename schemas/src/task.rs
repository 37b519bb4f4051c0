//! What is wanted: a task's specification and its key.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{Biomarkers, CellBiomarkers, NoiseWindows};
use crate::discover::DiscoverSpec;
use crate::finite_element::{AnatomySpec, EquationSettings, OwnMesh};
use crate::hash::{canonical_json, sha256_hex};
use crate::ids::{AttemptId, TaskKey};
use crate::organ::{
    BeatCount, CellStretch, CirculationSpec, ContractionSpec, EffectSpec, OneFibrePassive,
    OrganSpec, Step1Parameters, VALVE_PARAMETERS, ValveParameters, WindkesselParameters,
};
use crate::posterior::PosteriorSpec;
use crate::samples::{BeatSamples, MeasuredTraces};
use crate::settings::{ActivationSettings, CellFitSettings, InstructionSet, StartMode};
use crate::sweep::CellDesign;

/// A file that a task reads. The path is where it lies now; only name and content enter the key.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct InputFile {
    /// Role, for example `pressure`.
    pub name: String,
    /// Absolute path.
    pub path: PathBuf,
    /// SHA-256 of the content.
    pub sha256: String,
}

/// One kind of work with everything that it depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum TaskSpec {
    /// Step 0: passive state, loads, measured biomarkers.
    PassiveState(Box<PassiveStateSpec>),
    /// One simulation of the organ: an iteration of step 1, or the verification beat.
    OrganBeat(Box<OrganBeatSpec>),
    /// What to simulate next in step 1, by space mapping.
    Step1Proposal(Box<Step1ProposalSpec>),
    /// What to simulate next in step 3, by space mapping.
    Step3Proposal(Box<Step3ProposalSpec>),
    /// How sure the twin is.
    Posterior(Box<PosteriorSpec>),
    /// Median nodal traces and step 2's targets.
    Targets(TargetsSpec),
    /// Step 2: differential evolution at the cell.
    CellFit(Box<CellFitSpec>),
    /// A chunk of a sensitivity sweep: complete Saltelli blocks of 0D cells.
    CellSweep(Box<CellSweepSpec>),
    /// What the reduced ventricle lacks in a patient's traces.
    Discover(Box<DiscoverSpec>),
    /// Nothing: measures orchestration.
    Noop(NoopSpec),
}

impl TaskSpec {
    /// The kind as in files and tables.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::PassiveState(_) => "passive-state",
            Self::OrganBeat(_) => "organ-beat",
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

    /// Whether it is a simulation of the 3D ventricle, which ranks can share: step 0 or a beat.
    #[must_use]
    pub fn is_in_3d(&self) -> bool {
        match self {
            Self::PassiveState(spec) => spec.finite_element.is_some(),
            Self::OrganBeat(spec) => matches!(spec.organ, OrganSpec::FiniteElement(_)),
            _ => false,
        }
    }

    /// Raised by hand when the results of a kind change; part of the key.
    #[must_use]
    pub fn model_version(&self) -> u32 {
        match self {
            Self::PassiveState(_) => 8,
            Self::Discover(_) => 5,
            Self::Step1Proposal(_) => 6,
            Self::CellFit(_) => 5,
            Self::OrganBeat(_) => 6,
            Self::Step3Proposal(_) => 5,
            Self::Targets(_) => 3,
            Self::CellSweep(_) | Self::Posterior(_) => 2,
            Self::Noop(_) => 1,
        }
    }

    /// Canonical JSON with the model version and without paths: what the key hashes and `explain` compares.
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

    /// The task's identity.
    #[must_use]
    pub fn key(&self) -> TaskKey {
        TaskKey(sha256_hex(self.canonical().as_bytes()))
    }
}

/// Removes `path` beside `sha256`: where a file lies does not change what it says.
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

/// Step 0 (SPEC section 3, "passive state", and section 4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PassiveStateSpec {
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// Measured pressure trace.
    pub pressure: Option<InputFile>,
    /// Measured volume trace.
    pub volume: Option<InputFile>,
    /// Measured biomarkers given directly; they fill what traces do not give, and win over them.
    pub biomarkers: Biomarkers,
    /// Measured end-diastolic pressure.
    #[serde(rename = "end_diastolic_pressure_mmHg")]
    pub end_diastolic_pressure_mmhg: Option<f64>,
    /// Measured end-diastolic volume where there is no volume trace.
    #[serde(rename = "end_diastolic_volume_mL")]
    pub end_diastolic_volume_ml: Option<f64>,
    /// Time of the whole-heart image.
    pub diastasis_time_ms: Option<f64>,
    /// Volume of the whole-heart image.
    #[serde(rename = "diastasis_volume_mL")]
    pub diastasis_volume_ml: Option<f64>,
    /// Cuff or aortic pressure, systolic.
    #[serde(rename = "aortic_systolic_mmHg")]
    pub aortic_systolic_mmhg: Option<f64>,
    /// Cuff or aortic pressure, diastolic.
    #[serde(rename = "aortic_diastolic_mmHg")]
    pub aortic_diastolic_mmhg: Option<f64>,
    /// Wall volume; estimated and flagged when absent.
    #[serde(rename = "wall_volume_mL")]
    pub wall_volume_ml: Option<f64>,
    /// Passive exponent, where known.
    pub passive_exponent: Option<f64>,
    /// Windkessel, where determined beforehand.
    pub afterload: Option<WindkesselParameters>,
    /// Filling pressure, where known.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: Option<f64>,
    /// Where the beat starts.
    pub start: StartMode,
    /// Activation of the reduced ventricle.
    pub activation: ActivationSettings,
    /// Factors by which measured biomarkers are multiplied once everything else is derived from the data as measured: a
    /// sample of uncertain data (Jung et al. 2022, section 2.5). Keys: [`crate::biomarkers::Biomarker::OF_COST`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub biomarker_factors: BTreeMap<String, f64>,
    /// Passive law that was accepted for the patient, in place of the one through the measured points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passive_law: Option<OneFibrePassive>,
    /// Artefacts that the traces are corrected for before anything is taken from them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub corrections: Vec<EffectSpec>,
    /// The finite-element ventricle to be made; absent: the reduced one.
    #[serde(
        default,
        deserialize_with = "crate::earlier::anatomy",
        skip_serializing_if = "Option::is_none"
    )]
    pub finite_element: Option<AnatomySpec>,
    /// The patient's own mesh; absent: one is generated. Finite-element ventricle only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_mesh: Option<OwnMesh>,
    /// Guccione's C where the patient file gives it: then it is not fitted. Finite-element ventricle only.
    #[serde(
        rename = "guccione_C_kPa",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub guccione_c_kpa: Option<f64>,
}

/// One simulation of the organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OrganBeatSpec {
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// Largest time step.
    pub time_step_ms: f64,
    /// Shortest time step: below it the simulation has diverged.
    pub shortest_step_ms: f64,
    /// Newton iterations after which a step fails.
    pub newton_iterations: u32,
    /// Which organ, with its passive state.
    pub organ: OrganSpec,
    /// Loads.
    pub circulation: CirculationSpec,
    /// Valves.
    pub valves: ValveParameters,
    /// Active stress.
    pub contraction: ContractionSpec,
    /// The stretch that its cells know.
    #[serde(default)]
    pub cell_stretch: CellStretch,
    /// How many beats.
    pub beats: BeatCount,
    /// For `end_of_beat_gap`.
    #[serde(rename = "measured_end_diastolic_volume_mL")]
    pub measured_end_diastolic_volume_ml: Option<f64>,
    /// Windows over which traces are read, as the measured ones are.
    #[serde(default, skip_serializing_if = "NoiseWindows::are_none")]
    pub noise_windows: NoiseWindows,
    /// How the equations of the finite-element ventricle are solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finite_element: Option<EquationSettings>,
}

impl OrganBeatSpec {
    /// The same with other parameters of the cell and of the valves, by name; those that are absent stay.
    #[must_use]
    pub fn with_parameters(&self, parameters: &BTreeMap<String, f64>) -> Self {
        let mut beat = self.clone();
        beat.valves = beat.valves.with(parameters);
        if let ContractionSpec::Land2017Rice {
            parameters: cell, ..
        }
        | ContractionSpec::Land2017Trace {
            parameters: cell, ..
        } = &mut beat.contraction
        {
            let of_cell = parameters
                .iter()
                .filter(|(name, _)| !VALVE_PARAMETERS.contains(&name.as_str()));
            cell.extend(of_cell.map(|(name, value)| (name.clone(), *value)));
        }
        beat
    }
}

/// What to simulate next in step 1: the optimum of the one-fibre ventricle, corrected to the simulations so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step1ProposalSpec {
    /// The beat whose parameters are sought; its own are the initial guess. Of a finite-element ventricle the figures are
    /// used: those of a one-fibre ventricle of the same volumes, pressure and activation.
    pub beat: OrganBeatSpec,
    /// What is to be reached.
    pub measured: Biomarkers,
    /// Simulations so far, oldest first.
    pub runs: Vec<Step1Run>,
    /// Bounds of the updated parameters, lower and upper.
    pub bounds: BTreeMap<String, [f64; 2]>,
    /// Parameters that stay at their initial value.
    pub frozen: Vec<String>,
    /// Weights of the squared relative differences that are to be lowered, where they are not those of the cost: 1, and 0
    /// for `SV_mL`.
    pub weights: BTreeMap<String, f64>,
    /// Seed of the points from which the optimum is sought.
    pub seed: u64,
}

/// A simulation, as a proposal sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ProposalRun<P> {
    /// What was simulated.
    pub parameters: P,
    /// What came out; absent where the simulation failed.
    pub biomarkers: Option<Biomarkers>,
    /// Whether both valves opened and closed.
    pub whole_beat: bool,
    /// The misfit that the proposal which led to it promised.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_misfit: Option<f64>,
}

/// A simulation of step 1.
pub type Step1Run = ProposalRun<Step1Parameters>;

/// The verification beat or a simulation of step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step3Run {
    /// Parameters and biomarkers.
    pub run: ProposalRun<BTreeMap<String, f64>>,
    /// Pressure and volume; none where the simulation failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<BeatSamples>,
}

/// What to simulate next in step 3: the cell whose organ meets the measured biomarkers, by the one-fibre ventricle
/// with that cell, corrected to the beats so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step3ProposalSpec {
    /// The beat with step 2's cell; of a finite-element ventricle the figures are used.
    pub beat: OrganBeatSpec,
    /// What is to be reached.
    pub measured: Biomarkers,
    /// Beats so far, the verification beat first.
    pub runs: Vec<Step3Run>,
    /// What may move, by name.
    pub parameters: BTreeMap<String, MovedParameter>,
    /// Standard deviation of each measured biomarker, percent of its value; one that is absent does not count.
    pub uncertainty_percent: BTreeMap<String, f64>,
    /// Step 1's best beat: what the organ makes of a beat near the measurements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step1: Option<Step1Beat>,
    /// Measured traces; none where none counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traces: Option<MeasuredTraces>,
    /// Seed of the points from which the optimum is sought.
    pub seed: u64,
}

/// A beat of step 1, as step 3 sees it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step1Beat {
    /// What was simulated.
    pub parameters: Step1Parameters,
    /// What came out.
    pub biomarkers: Biomarkers,
}

/// A patient's cell in the organ: what step 3 begins with.
#[derive(Debug, Clone, PartialEq)]
pub struct CellInOrgan {
    /// The verification beat.
    pub beat: OrganBeatSpec,
    /// Step 1's best beat.
    pub step1: Option<Step1Beat>,
}

/// A parameter of step 3: the logarithm of its magnitude is sought within bounds, and has a normal distribution before
/// any measurement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct MovedParameter {
    /// Smallest value, in the unit that the name says.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Value in the middle of the prior.
    pub centre: f64,
    /// Standard deviation of the logarithm.
    pub log_sd: f64,
}

/// Median nodal traces and step 2's targets from an organ simulation's nodal traces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TargetsSpec {
    /// `nodal.csv` of the simulation.
    pub nodal: InputFile,
}

/// Step 2 (SPEC section 6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellFitSpec {
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// First value of the median stretch trace.
    pub lambda_0: f64,
    /// Largest stretch of any node: Ca50 stays above the resting calcium up to there. Earlier programs did not ask for that; at 1
    /// every Ca50 within its bounds fulfils it.
    #[serde(default = "crate::organ::one")]
    pub lambda_max: f64,
    /// What is to be reached.
    pub targets: CellBiomarkers,
    /// Method, parameters, bounds, weights, frozen values.
    pub settings: CellFitSettings,
    /// Seed of every random number of this fit.
    pub seed: u64,
    /// Parameters that are not fitted and differ from the defaults.
    pub fixed: BTreeMap<String, f64>,
    /// Calcium from activation on, columns `time_ms` and `Ca_uM`, where it is a fixed input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calcium: Option<InputFile>,
}

/// Some blocks of a Saltelli design. The design's own length is no part of it: a longer one has the same first blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellSweepSpec {
    /// The design.
    pub design: CellDesign,
    /// First block, from 0.
    pub first_block: u32,
    /// Number of blocks, of 2D + 2 samples each.
    pub n_blocks: u32,
}

/// Nothing to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct NoopSpec {
    /// Makes tasks distinct.
    pub label: String,
    /// How long it pretends to work.
    pub sleep_ms: u64,
}

/// `spec.json` of an attempt: the task, and which try this is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AttemptSpec {
    /// Format version.
    pub schema_version: u32,
    /// Which try of which task.
    pub attempt: AttemptId,
    /// Threads that the worker may use.
    pub threads: u32,
    /// Instructions of the cell engine.
    #[serde(default, skip_serializing_if = "InstructionSet::is_auto")]
    pub instruction_set: InstructionSet,
    /// Simulated time between frames of a series of VTU files of a finite-element beat; 0 for none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub vtu_every_ms: f64,
    /// The task.
    pub task: TaskSpec,
}

/// Whether a number is left out of files.
pub(crate) fn is_zero(value: &f64) -> bool {
    *value == 0.0
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
