//! All settings of a run, with their defaults. The same keys occur in `cohort.toml`, in a patient's
//! `[settings]`, in the overrides of `rerun` and in `--set`. A later layer takes precedence key by
//! key; `config show --origin` shows the layer of each value.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cell::{TABLE_A7, cell_parameter};
use crate::external::ExternalSettings;
use crate::finite_element::FiniteElementSettings;
use crate::notices::NoticeSettings;
use crate::organ::{RICE_PARAMETERS, StretchOrigin};
use crate::posterior::PosteriorSettings;
use crate::step3::Step3Settings;
use crate::verdict::TwinTolerances;

pub use cardiotwin_vocabulary::step1_settings::{Step1Settings, StopRule, Update};

/// All settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The organ and its simulation.
    pub solver: SolverSettings,
    /// Step 1.
    pub step1: Step1Settings,
    /// Step 2.
    pub step2: CellFitSettings,
    /// The verification beat.
    pub verification: VerificationSettings,
    /// Step 3.
    pub step3: Step3Settings,
    /// How sure the twin is.
    pub posterior: PosteriorSettings,
    /// How far a patient goes.
    pub workflow: WorkflowSettings,
    /// Where tasks run.
    pub executor: ExecutorSettings,
}

impl Settings {
    /// Method by which step 1 finds the next parameters, with [`Update::Auto`] resolved.
    #[must_use]
    pub fn step1_update(&self) -> Update {
        match (self.step1.update, self.solver.fidelity) {
            (Update::Auto, Fidelity::FiniteElement | Fidelity::External) => Update::SpaceMapping,
            (Update::Auto, Fidelity::Reduced) => Update::FixedPoint,
            (given, _) => given,
        }
    }

    /// Settings of step 1 with [`Update::Auto`] resolved.
    #[must_use]
    pub fn step1_resolved(&self) -> Step1Settings {
        Step1Settings {
            update: self.step1_update(),
            ..self.step1.clone()
        }
    }
}

/// Which organ is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fidelity {
    /// One-fibre ventricle, milliseconds a beat.
    Reduced,
    /// 3D finite-element ventricle, seconds to hours a beat.
    FiniteElement,
    /// A solver that is not ours.
    External,
}

/// Where a simulated beat starts (SPEC section 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StartMode {
    /// At the measured end-diastolic volume and pressure.
    EndDiastole,
    /// The paper's way: the image volume is taken to be that at end-diastolic pressure.
    Diastasis,
}

/// The organ and its simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolverSettings {
    /// Which organ.
    pub fidelity: Fidelity,
    /// Largest time step.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10.0))]
    pub time_step_ms: f64,
    /// A step that fails is cut in halves down to this; then the simulation ends as diverged.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10.0))]
    pub shortest_step_ms: f64,
    /// A step of the reduced ventricle fails after so many Newton iterations.
    #[schemars(range(min = 1, max = 1000))]
    pub newton_iterations: u32,
    /// Where the beat starts.
    pub start: StartMode,
    /// How the reduced ventricle is activated; `onset_ms` holds for the finite-element ventricle, too.
    pub activation: ActivationSettings,
    /// The finite-element ventricle.
    pub finite_element: FiniteElementSettings,
    /// The solver of `fidelity = "external"`.
    pub external: ExternalSettings,
    /// The length from which a cell's stretch is counted.
    pub cell_stretch: StretchOrigin,
    /// Slack length of a cell over its length in the unloaded wall, with `cell_stretch = "unloaded"`.
    #[schemars(extend("minimum" = 0.8, "maximum" = 1.3))]
    pub slack_stretch: f64,
    /// Beats per simulation in step 1 and verification.
    #[schemars(range(min = 1, max = 1000))]
    pub beats: u32,
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self {
            fidelity: Fidelity::FiniteElement,
            time_step_ms: 1.0,
            shortest_step_ms: 1.0 / 64.0,
            newton_iterations: 60,
            start: StartMode::EndDiastole,
            activation: ActivationSettings::default(),
            finite_element: FiniteElementSettings::default(),
            external: ExternalSettings::default(),
            cell_stretch: StretchOrigin::Unloaded,
            slack_stretch: 1.08,
            beats: 1,
        }
    }
}

/// Activation of the reduced ventricle: stands for the eikonal map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ActivationSettings {
    /// First activation to last.
    #[schemars(extend("minimum" = 0.0, "maximum" = 300.0))]
    pub spread_ms: f64,
    /// Parts of the wall, each with its own time.
    #[schemars(range(min = 1, max = 1000))]
    pub groups: u32,
    /// First activation after the trace's time zero, before it where negative; absent: found from the measured pressure upstroke.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = -100.0, "maximum" = 1000.0))]
    pub onset_ms: Option<f64>,
}

impl Default for ActivationSettings {
    fn default() -> Self {
        Self {
            spread_ms: 40.0,
            groups: 16,
            onset_ms: None,
        }
    }
}

/// How the trial vectors of a generation see the population.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Updating {
    /// A generation is one batch.
    Deferred,
    /// SciPy's default: each success is seen at once. The reference mode.
    Immediate,
}

/// Where step 2's calcium comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CalciumSource {
    /// Fitted with the rest (the paper's choice).
    Rice,
    /// A fixed input (eq. 18): the patient's `measured.calcium`, else the median of the organ's nodal calcium. Rice's four
    /// parameters then have no effect and are not fitted.
    MedianTrace,
}

/// How step 2 searches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// The paper's: `SciPy`'s best1bin.
    #[default]
    DifferentialEvolution,
    /// Differential evolution that adapts its own settings (Tanabe and Fukunaga 2014).
    LShade,
    /// Covariance matrix adaptation with restarts (Hansen 2016).
    CmaEs,
}

impl Strategy {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Step 2: differential evolution at the cell (SPEC section 6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CellFitSettings {
    /// Seed; each patient draws from its own stream.
    pub seed: u64,
    /// How the bounds are searched.
    #[serde(skip_serializing_if = "Strategy::is_default")]
    pub strategy: Strategy,
    /// Population = this × number of parameters.
    #[schemars(range(min = 1, max = 10_000))]
    pub popsize: u32,
    /// Converged when the spread of costs is below this share of their mean.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub tol: f64,
    /// Absolute part of the same.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e6))]
    pub atol: f64,
    /// Largest number of generations.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub max_generations: u32,
    /// Range from which the mutation factor of a generation is drawn.
    pub mutation: [f64; 2],
    /// Crossover probability.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub recombination: f64,
    /// Batch or immediate.
    pub updating: Updating,
    /// Local gradient searches at the end, from the best member.
    pub polish: bool,
    /// After the fit: for each parameter the interval of values with which a cost nearly as low is reached.
    pub identifiability: bool,
    /// Where calcium comes from.
    pub calcium: CalciumSource,
    /// A guess that takes a place in the first population, cut to the bounds; fitted parameters that are absent from it
    /// are guessed at their default (Tables A2 to A4).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub initial: BTreeMap<String, f64>,
    /// Fitted parameters, in order.
    pub parameters: Vec<String>,
    /// Bounds of the fitted parameters, lower and upper (Table A5).
    pub bounds: BTreeMap<String, [f64; 2]>,
    /// Weights of the squared relative differences.
    #[schemars(extend("additionalProperties" = { "type": "number", "minimum": 0.0, "maximum": 1e9 }))]
    pub weights: BTreeMap<String, f64>,
    /// Parameters held at a value other than the default.
    pub frozen: BTreeMap<String, f64>,
}

impl Default for CellFitSettings {
    fn default() -> Self {
        let interval = |key| cell_parameter(key).and_then(|parameter| parameter.interval);
        let bounds: Vec<(&str, [f64; 2])> = TABLE_A7
            .into_iter()
            .filter_map(|key| Some((key, interval(key)?)))
            .chain([("a_p_kPa", [1.0, 100.0])])
            .collect();
        Self {
            seed: 1,
            strategy: Strategy::default(),
            popsize: 15,
            tol: 0.01,
            atol: 0.0,
            max_generations: 1000,
            mutation: [0.5, 1.0],
            recombination: 0.7,
            updating: Updating::Deferred,
            polish: true,
            identifiability: true,
            calcium: CalciumSource::Rice,
            initial: BTreeMap::new(),
            parameters: bounds.iter().map(|(name, _)| (*name).to_owned()).collect(),
            bounds: bounds
                .into_iter()
                .map(|(name, range)| (name.to_owned(), range))
                .collect(),
            weights: [
                ("Sa_max_kPa", 5.0),
                ("dSadt_max_kPa_per_ms", 1.0),
                ("STD30_ms", 5.0),
                ("STD50_ms", 1.0),
                ("STD90_ms", 1.0),
                ("lambda_min", 100.0),
            ]
            .into_iter()
            .map(|(name, weight)| (name.to_owned(), weight))
            .collect(),
            frozen: BTreeMap::new(),
        }
    }
}

impl CellFitSettings {
    /// Names of the fitted parameters: `parameters`, without Rice's four if calcium is a fixed
    /// input.
    #[must_use]
    pub fn fitted(&self) -> Vec<String> {
        let has_effect = |name: &&String| {
            self.calcium == CalciumSource::Rice || !RICE_PARAMETERS.contains(&name.as_str())
        };
        self.parameters.iter().filter(has_effect).cloned().collect()
    }
}

/// The last step of a patient's way.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LastStep {
    /// The paper's workflow: step 2's cell in the organ, once.
    Step2Verification,
    /// Step 3 after it.
    #[default]
    Step3,
}

/// How far a patient goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WorkflowSettings {
    /// The last step.
    pub until: LastStep,
}

/// The verification beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VerificationSettings {
    /// Whether it is run; without it there is no step 3.
    pub enabled: bool,
    /// Up to which differences of its biomarkers a patient counts as personalised.
    pub tolerance_percent: TwinTolerances,
}

impl Default for VerificationSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            tolerance_percent: TwinTolerances::default(),
        }
    }
}

/// Where tasks run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ExecutorKind {
    /// Worker processes on this machine.
    Local,
    /// No-op tasks inside the coordinator: measures orchestration.
    InProcess,
    /// Jobs of a cluster; `cardiotwin advance` brings them on.
    Slurm,
}

/// Which instructions the cell engine uses. AVX2 and AVX-512 give the same bits; `portable` rounds differently, so that a
/// fit may take another way and end elsewhere within its tolerance.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum InstructionSet {
    /// The best of the processor.
    #[default]
    Auto,
    /// What every processor has.
    Portable,
    /// Four lanes a register.
    Avx2,
    /// Eight lanes a register.
    Avx512,
}

impl InstructionSet {
    /// Whether the processor determines the instruction set.
    #[must_use]
    pub fn is_auto(&self) -> bool {
        *self == Self::Auto
    }
}

/// Where tasks run and how many at once. Never part of a task's key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExecutorSettings {
    /// Which executor.
    pub kind: ExecutorKind,
    /// Workers at once; 0 is one for each core.
    #[schemars(range(min = 0, max = 4096))]
    pub workers: u32,
    /// Threads of each worker; 0: on this machine all cores for step 0 and a beat of the 3D ventricle on 8,000 nodes or more, beside
    /// which nothing else runs, and one for anything else.
    #[schemars(range(min = 0, max = 1024))]
    pub threads: u32,
    /// Launcher of MPI with its arguments, `["mpirun"]` or `["srun", "--mpi=pmix"]` for one: a 3D simulation with several threads then
    /// runs on as many ranks of `cardiotwin-worker-mpi` instead, `LAUNCHER -n THREADS cardiotwin-worker-mpi run …`; in a job of a
    /// cluster, within the node that the driver has.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub launcher: Vec<String>,
    /// Instructions of the cell engine; recorded in every outcome.
    pub instruction_set: InstructionSet,
    /// How often a task that failed for the site's sake (killed, disk full) is tried again by itself.
    #[schemars(range(min = 0, max = 100))]
    pub site_retries: u32,
    /// Simulated time between frames of a series of VTU files that each beat of the finite-element ventricle leaves; 0: none.
    #[serde(skip_serializing_if = "crate::task::is_zero")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub vtu_every_ms: f64,
    /// A worker that writes no progress and does not end for so long is taken for hung and killed; 0 is never.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e7))]
    pub hang_timeout_s: f64,
    /// Mask of permissions that new files of a run do not get, octal: `0077` keeps them to their owner. Absent: what the shell
    /// says, and nothing for others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub umask: Option<String>,
    /// Group of the run's folder and of all that is made in it; absent: as the file system has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Where attempts lie, absolute: a folder on a file system for working files; the run's folder has a link to it. Absent: in the
    /// run's folder, beside the database.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scratch: Option<PathBuf>,
    /// Where `archive` puts its copies, absolute, if it is not told; absent: it has to be told.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub archive: Option<PathBuf>,
    /// Who is told when a run is done, stalls, fails or runs out of room.
    #[serde(skip_serializing_if = "NoticeSettings::is_default")]
    pub notices: NoticeSettings,
    /// Jobs of a cluster, for `kind = "slurm"`.
    #[serde(skip_serializing_if = "SlurmSettings::is_default")]
    pub slurm: SlurmSettings,
}

/// How a cohort becomes jobs of a cluster.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SlurmSettings {
    /// Site profile: `archer2`, `generic`, or the path of a file like those of deploy/sites.
    pub site: String,
    /// Account that is charged; needed where the site demands one.
    pub account: Option<String>,
    /// Queue of the profile; the first that serves the work where absent.
    pub queue: Option<String>,
    /// Longest walltime of a job, `HH:MM:SS`; the queue's where absent.
    pub walltime: Option<String>,
    /// How long before the end of its walltime a job is warned, so that it can leave a checkpoint.
    pub warning_s: u64,
    /// Memory of each worker, where the queue gives single cores.
    #[serde(rename = "memory_MiB")]
    pub memory_mib: u64,
    /// How long one simulated beat takes, until some were measured; 0: a guess from fidelity and mesh.
    pub simulation_s: f64,
    /// Nodes of a job at most, where the queue gives whole nodes; 0: the queue's limit.
    pub bundle_nodes: u32,
    /// A job is meant to last so long at least, where there is work enough: patients are put together up to it.
    pub job_s: u64,
    /// How long a job may be nowhere to be found before it is given up, s.
    pub grace_s: u64,
    /// Free repeats of a patient after failed nodes, preemptions and used walltimes that brought progress.
    pub free_repeats: u32,
}

impl SlurmSettings {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for SlurmSettings {
    fn default() -> Self {
        Self {
            site: "generic".into(),
            account: None,
            queue: None,
            walltime: None,
            warning_s: 120,
            memory_mib: 2000,
            simulation_s: 0.0,
            bundle_nodes: 0,
            job_s: 3600,
            grace_s: 120,
            free_repeats: 10,
        }
    }
}

impl Default for ExecutorSettings {
    fn default() -> Self {
        Self {
            kind: ExecutorKind::Local,
            workers: 0,
            threads: 0,
            launcher: vec![],
            instruction_set: InstructionSet::Auto,
            site_retries: 2,
            vtu_every_ms: 0.0,
            hang_timeout_s: 0.0,
            umask: None,
            group: None,
            scratch: None,
            archive: None,
            notices: NoticeSettings::default(),
            slurm: SlurmSettings::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_key_is_refused_by_name() {
        let error = serde_json::from_str::<Settings>(r#"{"step1":{"toleranse":1}}"#).unwrap_err();
        assert!(error.to_string().contains("toleranse"), "{error}");
    }

    #[test]
    fn defaults_are_the_papers() {
        let settings = Settings::default();
        assert_eq!(settings.step2.parameters.len(), 10);
        assert_eq!(settings.step2.popsize * 10, 150);
        assert_eq!(settings.step1.tolerance, 0.1);
    }

    #[test]
    fn fixed_calcium_leaves_rices_parameters_out() {
        let settings = CellFitSettings {
            calcium: CalciumSource::MedianTrace,
            ..CellFitSettings::default()
        };
        assert_eq!(
            settings.fitted(),
            [
                "n_TRPN",
                "beta_1_uM",
                "n_Tm",
                "Ca50_ref_uM",
                "k_UW_per_ms",
                "a_p_kPa"
            ]
        );
        assert_eq!(
            CellFitSettings::default().fitted(),
            CellFitSettings::default().parameters
        );
    }
}
