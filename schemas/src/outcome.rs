//! What came of an attempt.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{Biomarkers, CellBiomarkers, NoiseWindows, TimePoints};
use crate::discover::Discovered;
use crate::failure::Failure;
use crate::ids::AttemptId;
use crate::motion::MotionMeasures;
use crate::organ::{CirculationSpec, OrganSpec, Step1Parameters};
use crate::posterior::PosteriorResult;
use crate::provenance::Provenance;
use crate::samples::BeatSamples;

/// `outcome.json` of an attempt, written once, atomically.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TaskOutcome {
    /// Format version.
    pub schema_version: u32,
    /// Which try of which task.
    pub attempt: AttemptId,
    /// How it ended.
    pub ending: Ending,
    /// Files beside `outcome.json`.
    pub artefacts: Vec<Artefact>,
    /// How it was made.
    pub provenance: Provenance,
}

/// `outcome.json` of an attempt that was revoked before its worker published: the coordinator took the name first.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RevokedAttempt {
    /// The revocation in an outcome's place.
    pub revoked: Revocation,
}

/// The coordinator's word that an attempt is to publish nothing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Revocation {
    /// Format version.
    pub schema_version: u32,
    /// Which try of which task.
    pub attempt: AttemptId,
    /// Why, for a person.
    pub reason: String,
    /// UTC, RFC 3339.
    pub at: String,
}

/// How an attempt ended. Divergence is an ending with data, not an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "ending", rename_all = "kebab-case")]
pub enum Ending {
    /// Finished; the checks inside the result say whether the science holds.
    Succeeded {
        /// What was computed.
        result: Box<TaskResult>,
    },
    /// The simulation could not be saved.
    Diverged {
        /// Simulated time of the last good state.
        last_good_ms: f64,
        /// Newton, non-finite, volume out of range, …
        reason: String,
    },
    /// Anything else.
    Failed {
        /// Why, with its class.
        failure: Failure,
    },
    /// Stopped on request before the end.
    Cancelled,
}

/// A file that an attempt made, relative to its directory.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Artefact {
    /// Role, for example `traces`, `nodal`, `median`.
    pub name: String,
    /// File name inside the attempt directory.
    pub file: String,
    /// SHA-256 of the content.
    pub sha256: String,
    /// Size.
    pub bytes: u64,
}

/// What was computed, by task kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum TaskResult {
    /// Step 0.
    PassiveState(PassiveStateResult),
    /// A simulation.
    OrganBeat(OrganBeatResult),
    /// What to simulate next in step 1.
    Step1Proposal(Step1ProposalResult),
    /// What to simulate next in step 3.
    Step3Proposal(Step3ProposalResult),
    /// How sure the twin is.
    Posterior(Box<PosteriorResult>),
    /// Step 2's targets.
    Targets(TargetsResult),
    /// Step 2.
    CellFit(CellFitResult),
    /// A chunk of a sensitivity sweep.
    CellSweep(CellSweepResult),
    /// What the reduced ventricle lacks in a patient's traces.
    Discover(Box<Discovered>),
    /// Nothing.
    Noop,
}

/// A quantity that the patient's file lacked and that was estimated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Estimate {
    /// Which key of the patient file it stands for.
    pub key: String,
    /// The value, in the unit that the key names.
    pub value: f64,
    /// How it was estimated.
    pub method: String,
}

/// Step 0: everything that the simulations of this patient share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PassiveStateResult {
    /// The organ, passive state fitted.
    pub organ: OrganSpec,
    /// The loads.
    pub circulation: CirculationSpec,
    /// Measured biomarkers, from the traces or as given, times `biomarker_factors`.
    pub measured: Biomarkers,
    /// Factors that `measured` holds, where it is a sample of uncertain data and not what was measured.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub biomarker_factors: BTreeMap<String, f64>,
    /// Windows over which noisy traces are read, measured and simulated alike; absent where measured traces are smooth.
    #[serde(default, skip_serializing_if = "NoiseWindows::are_none")]
    pub noise_windows: NoiseWindows,
    /// Their time points.
    pub time_points: TimePoints,
    /// Samples of the measured traces.
    #[serde(default)]
    pub samples: BeatSamples,
    /// What was estimated for lack of data.
    pub estimates: Vec<Estimate>,
    /// Volume at the diastasis pressure minus the measured diastasis volume, where both are known.
    #[serde(rename = "diastasis_volume_error_mL")]
    pub diastasis_volume_error_ml: Option<f64>,
    /// Biomarkers whose level was not reached before the beat's end, and other remarks.
    pub remarks: Vec<String>,
    /// What step 0 of a finite-element ventricle cost: iterations, passes, seconds of each phase, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub counters: BTreeMap<String, f64>,
}

/// A check of the science with what was found and what is allowed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Check {
    /// For example `aortic valve opened and closed`.
    pub name: String,
    /// Whether it holds.
    pub passed: bool,
    /// What was found, with its unit.
    pub found: String,
    /// What is expected.
    pub expected: String,
}

/// One simulation of the organ. Artefacts: `traces` (`traces.csv`), `nodal` (`nodal.csv`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OrganBeatResult {
    /// Simulated biomarkers of the last beat.
    pub biomarkers: Biomarkers,
    /// Their time points.
    pub time_points: TimePoints,
    /// Pressure and volume of the last beat at a few times.
    #[serde(default)]
    pub samples: BeatSamples,
    /// SPEC section 5: the run counts only if all hold.
    pub checks: Vec<Check>,
    /// Beats simulated.
    pub beats: u32,
    /// Whether start and end of the last beat agree.
    pub periodic: bool,
    /// Levels not reached and other remarks.
    pub remarks: Vec<String>,
    /// Smallest stretch over nodes and time.
    pub lambda_min: f64,
    /// How a finite-element ventricle moved in the last beat; absent where it did not eject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionMeasures>,
    /// Time steps, cut steps, Newton iterations and such, by name.
    pub counters: BTreeMap<String, f64>,
}

/// Ending of the names of the checks that a valve opened and closed, for example `aortic valve opened and closed`.
const OF_A_VALVE: &str = " valve opened and closed";

impl std::fmt::Display for Check {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}: found {}, expected {}",
            self.name, self.found, self.expected
        )
    }
}

impl Check {
    /// Whether it says that a valve opened and closed.
    #[must_use]
    pub fn is_of_a_valve(&self) -> bool {
        self.name.ends_with(OF_A_VALVE)
    }
}

impl OrganBeatResult {
    /// The first check that does not hold of those without which the simulation cannot be believed: all but the valves'.
    #[must_use]
    pub fn failed_simulation(&self) -> Option<&Check> {
        self.checks
            .iter()
            .find(|check| !check.passed && !check.is_of_a_valve())
    }

    /// The first valve that did not open and close: no whole beat.
    #[must_use]
    pub fn failed_valve(&self) -> Option<&Check> {
        self.checks
            .iter()
            .find(|check| !check.passed && check.is_of_a_valve())
    }

    /// The first check that does not hold.
    #[must_use]
    pub fn failed_check(&self) -> Option<&Check> {
        self.checks.iter().find(|check| !check.passed)
    }
}

/// What to simulate next, and what the corrected one-fibre ventricle promises of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ProposalResult<P> {
    /// What to simulate.
    pub parameters: P,
    /// Biomarkers of the corrected one-fibre ventricle there: those of step 1.
    pub predicted: Biomarkers,
    /// Their cost.
    pub predicted_cost: f64,
    /// Their misfit, by the weights of the step.
    #[serde(default)]
    pub predicted_misfit: f64,
    /// The simulation, from 1, at which the correction is exact; absent where there was none of use.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_iteration: Option<u32>,
    /// Largest change of a parameter's logarithm from there that was allowed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trust_radius: Option<f64>,
    /// Largest change that was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// Factor of each biomarker of the one-fibre ventricle at that simulation.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub correction: BTreeMap<String, f64>,
    /// Beats of the one-fibre ventricle that it took.
    pub reduced_beats: u64,
}

/// What to simulate next in step 1.
pub type Step1ProposalResult = ProposalResult<Step1Parameters>;

/// What to simulate next in step 3: parameters of the cell and of the valves, by name.
pub type Step3ProposalResult = ProposalResult<BTreeMap<String, f64>>;

/// Step 2's targets. Artefact: `median` (`median.csv`: time_ms, Sa_kPa, Ca_uM, lambda).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TargetsResult {
    /// First value of the median stretch trace.
    pub lambda_0: f64,
    /// Largest stretch of any node at any time. Earlier programs did not look for it; at 1 it asks nothing of Ca50.
    #[serde(default = "crate::organ::one")]
    pub lambda_max: f64,
    /// Biomarkers of the median traces.
    pub targets: CellBiomarkers,
    /// Nodes that entered the medians.
    pub n_nodes: u64,
    /// Whether the medians have calcium: the contraction model had it as a state or an input.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub has_calcium: bool,
}

/// What the data say of a fitted parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Determination {
    /// Near-optimal values fill at most a fifth of the interval between the bounds, away from them.
    Determined,
    /// They fill more.
    Sloppy,
    /// They fill at most a fifth, and the best one is a bound: the data would have it beyond.
    AtBound,
    /// They reach from bound to bound: the data say nothing.
    NotDetermined,
}

impl Determination {
    /// In words.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Determined => "determined",
            Self::Sloppy => "sloppy",
            Self::AtBound => "at bound",
            Self::NotDetermined => "not determined",
        }
    }
}

/// Values of a parameter with which a near-optimal cost is reached, all other parameters fitted anew (profile
/// likelihood; Raue et al. 2009, Bioinformatics 25:1923).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct NearOptimal {
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// What follows.
    pub mark: Determination,
}

/// How near-optimal values were found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Identifiability {
    /// Largest cost that counts as near-optimal.
    pub threshold: f64,
    /// Cell evaluations that it took, not among the fit's.
    pub evaluations: u64,
    /// Whether every interval's ends were found; else those left lie further out.
    pub complete: bool,
}

/// A fitted parameter.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FittedParameter {
    /// Name with unit.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Whether the value sits on a bound.
    pub at_bound: bool,
    /// What the data determine of it; absent where that was not looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_optimal: Option<NearOptimal>,
}

/// Step 2. Artefacts: `cell` (`cell.csv`: time_ms, Sa_kPa, Ca_uM, lambda), `convergence` (`convergence.csv`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellFitResult {
    /// Stretch at which the cell's beat begins: the median trace's first. Earlier programs began the beat in the organ at 1.
    #[serde(default = "crate::organ::one")]
    pub lambda_0: f64,
    /// Fitted parameters in the order of the settings.
    pub parameters: Vec<FittedParameter>,
    /// What the fit reached.
    pub reached: CellBiomarkers,
    /// What it should have reached.
    pub targets: CellBiomarkers,
    /// Weighted misfit and penalty.
    pub cost: f64,
    /// Terms of the cost by name, the penalty's terms among them.
    pub cost_terms: BTreeMap<String, f64>,
    /// Cell evaluations.
    pub evaluations: u64,
    /// Generations of differential evolution.
    pub generations: u64,
    /// Whether the population converged.
    pub converged: bool,
    /// Empty, or which target is out of reach and what would reach it.
    pub unreachable_targets: Vec<String>,
    /// How the parameters' near-optimal values were found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identifiability: Option<Identifiability>,
}

/// A chunk of a sensitivity sweep. Artefact: `samples` (`samples.csv`), a line a sample in the design's order.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellSweepResult {
    /// Samples computed; all other counts are parts of it.
    pub n_samples: u64,
    /// In their periodic state; of an organ: those whose beat ended.
    pub n_periodic: u64,
    /// Not periodic after the largest number of beats; their last beat is reported.
    pub n_not_periodic: u64,
    /// Without a result: the integration did not end.
    pub n_stuck: u64,
    /// Without a result: the equations have no meaning for the parameters.
    pub n_refused: u64,
    /// Instruction set of the cell engine, for example `avx512`: results agree between sets to rounding errors.
    pub arithmetic: String,
}
