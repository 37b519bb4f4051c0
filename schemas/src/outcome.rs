//! Outcomes of attempts.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use cardiotwin_vocabulary::circulation::LoopContents;

use crate::biomarkers::{Biomarkers, CellBiomarkers, TimePoints};
use crate::discover::Discovered;
use crate::failure::Failure;
use crate::ids::AttemptId;
use crate::motion::MotionMeasures;
use crate::organ::Step1Parameters;
use crate::organ_law::{LawSamples, LawTeacher, LearnedLaw};
use crate::posterior::PosteriorResult;
use crate::provenance::Provenance;
use crate::samples::BeatSamples;

pub use crate::determination::Determination;
pub use crate::step0::{Estimate, PassiveStateResult};

/// `outcome.json` of an attempt, which is written once and atomically.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TaskOutcome {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Task and number of the attempt.
    pub attempt: AttemptId,
    /// Ending of the attempt with its result or failure.
    pub ending: Ending,
    /// Files in the directory of `outcome.json`.
    pub artefacts: Vec<Artefact>,
    /// Provenance of the outcome.
    pub provenance: Provenance,
    /// SHA-256 of the file with 64 zeros for this value. Absent in outcomes of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

/// `outcome.json` of an attempt that was revoked before its worker published. The coordinator
/// created the file first.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RevokedAttempt {
    /// Revocation in the place of an outcome.
    pub revoked: Revocation,
}

/// Revocation of an attempt by the coordinator. The attempt must not publish.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Revocation {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Task and number of the attempt.
    pub attempt: AttemptId,
    /// Reason of the revocation, for people.
    pub reason: String,
    /// Time of the revocation, UTC, RFC 3339.
    pub at: String,
}

/// Ending of an attempt. Divergence is an ending with data rather than an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "ending", rename_all = "kebab-case")]
pub enum Ending {
    /// The attempt finished. The checks in the result show whether it is scientifically valid.
    Succeeded {
        /// Result of the computation.
        result: Box<TaskResult>,
    },
    /// The simulation diverged.
    Diverged {
        /// Simulated time of the last converged state.
        last_good_ms: f64,
        /// Reason of the divergence, for example Newton's method, a non-finite value or a volume
        /// out of range.
        reason: String,
    },
    /// The attempt failed for another reason.
    Failed {
        /// Failure with its class.
        failure: Failure,
    },
    /// The attempt was stopped on request before its end.
    Cancelled,
}

/// A file made by an attempt, relative to the attempt's directory.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Artefact {
    /// Role of the file, for example `traces`, `nodal`, `median`.
    pub name: String,
    /// Name of the file in the directory of the attempt.
    pub file: String,
    /// SHA-256 of the content.
    pub sha256: String,
    /// Size of the file.
    pub bytes: u64,
}

/// Result of a task, by kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum TaskResult {
    /// Result of step 0.
    PassiveState(PassiveStateResult),
    /// Result of a simulation of the organ.
    OrganBeat(OrganBeatResult),
    /// The organ's law that pilots taught.
    LearnLaw(LearnLawResult),
    /// Parameters for the next simulation of step 1.
    Step1Proposal(Step1ProposalResult),
    /// Parameters for the next simulation of step 3.
    Step3Proposal(Step3ProposalResult),
    /// Posterior of the twin's parameters.
    Posterior(Box<PosteriorResult>),
    /// Targets of step 2.
    Targets(TargetsResult),
    /// Result of step 2.
    CellFit(CellFitResult),
    /// Result of a part of a sensitivity sweep.
    CellSweep(CellSweepResult),
    /// Effects that the reduced ventricle lacks in a patient's traces.
    Discover(Box<Discovered>),
    /// No result.
    Noop,
}

/// A scientific check with the found and the allowed value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Check {
    /// Name of the check, for example `aortic valve opened and closed`.
    pub name: String,
    /// Whether the check passed.
    pub passed: bool,
    /// Value that was found, with its unit.
    pub found: String,
    /// Value that is allowed.
    pub expected: String,
}

/// Result of one simulation of the organ. Artefacts: `traces` (`traces.csv`), `nodal`
/// (`nodal.csv`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OrganBeatResult {
    /// Simulated biomarkers of the last beat.
    pub biomarkers: Biomarkers,
    /// Time points of the biomarkers.
    pub time_points: TimePoints,
    /// Samples of pressure and volume in the last beat.
    #[serde(default)]
    pub samples: BeatSamples,
    /// Scientific checks (SPEC section 5). The run counts only if all of them pass.
    pub checks: Vec<Check>,
    /// Number of simulated beats.
    pub beats: u32,
    /// Whether start and end of the last beat agree.
    pub periodic: bool,
    /// Remarks, such as levels that were not reached.
    pub remarks: Vec<String>,
    /// Smallest stretch of any node at any time.
    pub lambda_min: f64,
    /// Motion of a finite-element ventricle in the last beat; absent if the ventricle did not
    /// eject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionMeasures>,
    /// Samples from which the organ's law is learned; absent for a reduced ventricle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<LawSamples>,
    /// State of the loop that closes the circulation; absent for the open circuit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closed_loop: Option<LoopState>,
    /// Counters by name, such as time steps, cut steps and Newton iterations.
    pub counters: BTreeMap<String, f64>,
}

/// State of a closed loop in the last beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LoopState {
    /// Blood volume: what ventricle and chambers hold, and what vessels hold above their volume
    /// without pressure.
    #[serde(rename = "blood_volume_mL")]
    pub blood_volume_ml: f64,
    /// Mean pressure of the left atrium over the beat.
    #[serde(rename = "mean_left_atrial_pressure_mmHg")]
    pub mean_left_atrial_pressure_mmhg: f64,
    /// Contents of the loop at the end of the beat, from which a further beat can start.
    pub contents: LoopContents,
}

/// Suffix of the names of checks that a valve opened and closed, for example
/// `aortic valve opened and closed`.
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
    /// Whether this is the check that a valve opened and closed.
    #[must_use]
    pub fn is_of_a_valve(&self) -> bool {
        self.name.ends_with(OF_A_VALVE)
    }
}

impl OrganBeatResult {
    /// First failed check without which the simulation is not credible, i.e. any but those of
    /// valves.
    #[must_use]
    pub fn failed_simulation(&self) -> Option<&Check> {
        self.checks
            .iter()
            .find(|check| !check.passed && !check.is_of_a_valve())
    }

    /// First failed check of a valve; the beat is then not whole.
    #[must_use]
    pub fn failed_valve(&self) -> Option<&Check> {
        self.checks
            .iter()
            .find(|check| !check.passed && check.is_of_a_valve())
    }

    /// First failed check of any kind; `None` if the beat passes all of them.
    #[must_use]
    pub fn failed_check(&self) -> Option<&Check> {
        self.checks.iter().find(|check| !check.passed)
    }
}

/// Parameters for the next simulation, and the prediction of the corrected one-fibre ventricle for
/// them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ProposalResult<P> {
    /// Parameters to simulate.
    pub parameters: P,
    /// Biomarkers of step 1 that the corrected one-fibre ventricle predicts.
    pub predicted: Biomarkers,
    /// Cost of the predicted biomarkers.
    pub predicted_cost: f64,
    /// Misfit of the predicted biomarkers with the weights of the step.
    #[serde(default)]
    pub predicted_misfit: f64,
    /// Number of the simulation, from 1, at which the correction is exact; absent if there was no
    /// usable simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_iteration: Option<u32>,
    /// Largest allowed change of a parameter's logarithm from this simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trust_radius: Option<f64>,
    /// Largest change of a parameter's logarithm that was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// Factor on each biomarker of the one-fibre ventricle at this simulation.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub correction: BTreeMap<String, f64>,
    /// Number of beats from which the organ's law was learned; absent if the one-fibre ventricle
    /// made the proposal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law_beats: Option<u32>,
    /// The organ's law; absent if the one-fibre ventricle made the proposal, and in results of earlier
    /// programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned_law: Option<LearnedLaw>,
    /// Number of beats of the reduced ventricle that were computed.
    pub reduced_beats: u64,
}

/// Proposal of step 1 for the next simulation.
pub type Step1ProposalResult = ProposalResult<Step1Parameters>;

/// Proposal of step 3 for the next simulation: parameters of the cell and of the valves, by name.
pub type Step3ProposalResult = ProposalResult<BTreeMap<String, f64>>;

/// The organ's law that pilots taught. Artefact: `law` (`law.json`, a law file).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LearnLawResult {
    /// Organs that taught, sorted by name.
    pub organs: Vec<LawTeacher>,
}

impl LearnLawResult {
    /// Number of beats that taught.
    #[must_use]
    pub fn n_beats(&self) -> usize {
        self.organs.iter().map(|organ| organ.beats.len()).sum()
    }

    /// Error of the pressure before an organ's first beat, in the mean of the organs, before and
    /// after learning \[mmHg\]; `None` without organs.
    #[must_use]
    pub fn errors_mmhg(&self) -> Option<(f64, f64)> {
        let n = self.organs.len() as f64;
        let before: f64 = (self.organs.iter())
            .map(|o| o.pressure_error_before_mmhg)
            .sum();
        let after: f64 = (self.organs.iter())
            .map(|o| o.pressure_error_after_mmhg)
            .sum();
        (n > 0.0).then(|| (before / n, after / n))
    }

    /// What was learned, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let counted = |n: usize, one: &str| match n {
            1 => format!("1 {one}"),
            n => format!("{n} {one}s"),
        };
        let Some((before, after)) = self.errors_mmhg() else {
            return "the pilots made no beat that teaches".to_owned();
        };
        format!(
            "{} and {}; error of the pressure before a first beat {before:.2} mmHg, then {after:.2} \
             mmHg",
            counted(self.organs.len(), "organ"),
            counted(self.n_beats(), "beat"),
        )
    }
}

/// Targets of step 2. Artefact: `median` (`median.csv`: time_ms, Sa_kPa, Ca_uM, lambda).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TargetsResult {
    /// First value of the median stretch trace.
    pub lambda_0: f64,
    /// Largest stretch of any node at any time. Earlier programs did not look for it; at 1 it asks nothing of Ca50.
    #[serde(default = "crate::absent::one")]
    pub lambda_max: f64,
    /// Biomarkers of the median traces.
    pub targets: CellBiomarkers,
    /// Number of nodes in the medians.
    pub n_nodes: u64,
    /// Whether the medians contain calcium. They do if calcium was a state or an input of the
    /// contraction model.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub has_calcium: bool,
}

/// Values of a parameter at which a near-optimal cost is reached with all other parameters refitted
/// (profile likelihood; Raue et al. 2009, Bioinformatics 25:1923).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct NearOptimal {
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Conclusion from the interval.
    pub mark: Determination,
}

/// Effort and completeness of the search for near-optimal values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Identifiability {
    /// Largest cost that counts as near-optimal.
    pub threshold: f64,
    /// Number of cell evaluations, which the count of the fit does not include.
    pub evaluations: u64,
    /// Whether all ends of the intervals were found. If not, the remaining ends lie further out.
    pub complete: bool,
}

/// A fitted parameter.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FittedParameter {
    /// Name with unit.
    pub name: String,
    /// Fitted value.
    pub value: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Whether the value lies on a bound.
    pub at_bound: bool,
    /// Near-optimal values; absent if they were not computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_optimal: Option<NearOptimal>,
}

/// Result of step 2. Artefacts: `cell` (`cell.csv`: time_ms, Sa_kPa, Ca_uM, lambda), `convergence`
/// (`convergence.csv`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellFitResult {
    /// Stretch at which the cell's beat begins: the median trace's first. Earlier programs began the beat in the organ at 1.
    #[serde(default = "crate::absent::one")]
    pub lambda_0: f64,
    /// Fitted parameters in the order of the settings.
    pub parameters: Vec<FittedParameter>,
    /// Biomarkers of the fitted cell.
    pub reached: CellBiomarkers,
    /// Targets of the fit.
    pub targets: CellBiomarkers,
    /// Weighted misfit plus penalty.
    pub cost: f64,
    /// Terms of the cost by name, including the penalty's terms.
    pub cost_terms: BTreeMap<String, f64>,
    /// Number of cell evaluations.
    pub evaluations: u64,
    /// Number of generations of differential evolution.
    pub generations: u64,
    /// Whether the population converged.
    pub converged: bool,
    /// Targets that the cell cannot reach and changes that would allow it; empty if all can be
    /// reached.
    pub unreachable_targets: Vec<String>,
    /// Effort and completeness of the search for near-optimal values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identifiability: Option<Identifiability>,
}

/// Result of a part of a sensitivity sweep. Artefact: `samples` (`samples.csv`), one line per
/// sample in the order of the design.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellSweepResult {
    /// Number of computed samples. All other counts are parts of it.
    pub n_samples: u64,
    /// Number of samples in their periodic state; for an organ, number of samples with a complete
    /// beat.
    pub n_periodic: u64,
    /// Number of samples that are not periodic after the largest number of beats. Their last beat
    /// is reported.
    pub n_not_periodic: u64,
    /// Number of samples without a result because the integration did not finish.
    pub n_stuck: u64,
    /// Number of samples without a result because the equations are not defined for the parameters.
    pub n_refused: u64,
    /// Instruction set of the cell engine, for example `avx512`. Results of different sets agree to
    /// within rounding errors.
    pub arithmetic: String,
}
