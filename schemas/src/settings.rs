//! All settings of a run, with their defaults. The same keys occur in `cohort.toml`, in a patient's
//! `[settings]`, in the overrides of `rerun` and in `--set`. A later layer takes precedence key by
//! key; `config show --origin` shows the layer of each value.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::cell::{TABLE_A7, cell_parameter};
use crate::external::ExternalSettings;
use crate::finite_element::FiniteElementSettings;
use crate::notices::NoticeSettings;
use crate::organ::{RICE_PARAMETERS, StretchOrigin};
use crate::posterior_settings::PosteriorSettings;
use crate::step3::Step3Settings;
use crate::verdict::TwinTolerances;

pub use cardiotwin_vocabulary::step1_settings::{Step1Settings, StopRule, Update};
pub use cardiotwin_vocabulary::step2_settings::Updating;

/// All settings of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Settings of the organ and its simulation.
    pub solver: SolverSettings,
    /// Settings of step 1.
    pub step1: Step1Settings,
    /// Settings of step 2.
    pub step2: CellFitSettings,
    /// Settings of the verification beat.
    pub verification: VerificationSettings,
    /// Settings of step 3.
    pub step3: Step3Settings,
    /// Settings of the posterior's sampling.
    pub posterior: PosteriorSettings,
    /// Settings of the workflow.
    pub workflow: WorkflowSettings,
    /// Settings of the executor.
    pub executor: ExecutorSettings,
}

impl Settings {
    /// Method of step 1 to find the next parameters, with [`Update::Auto`] resolved.
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

/// Lays settings over earlier ones: tables are merged key by key, every other value takes the place
/// of the earlier one. All layers of settings are merged by this function.
pub fn lay_over(below: &mut Map<String, Value>, above: &Map<String, Value>) {
    for (key, value) in above {
        match (below.get_mut(key), value) {
            (Some(Value::Object(below)), Value::Object(above)) => lay_over(below, above),
            _ => {
                below.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Organ that is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fidelity {
    /// One-fibre ventricle; milliseconds per beat.
    Reduced,
    /// 3D finite-element ventricle; seconds to hours per beat.
    FiniteElement,
    /// Ventricle of an external solver.
    External,
}

/// State at which a simulated beat starts (SPEC section 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StartMode {
    /// Measured end-diastolic volume and pressure.
    EndDiastole,
    /// Volume of the image, which is taken to be the volume at end-diastolic pressure (the paper's
    /// choice).
    Diastasis,
}

/// Settings of the organ and its simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolverSettings {
    /// Organ that is simulated.
    pub fidelity: Fidelity,
    /// Largest time step.
    #[schemars(extend("minimum" = 0.001, "maximum" = 10.0))]
    pub time_step_ms: f64,
    /// Shortest time step. A step that fails is halved down to this length; if it still fails, the
    /// simulation has diverged.
    #[schemars(extend("minimum" = 1e-6, "maximum" = 10.0))]
    pub shortest_step_ms: f64,
    /// Number of Newton iterations after which a step of the reduced ventricle fails.
    #[schemars(range(min = 1, max = 1000))]
    pub newton_iterations: u32,
    /// State at which the beat starts.
    pub start: StartMode,
    /// Activation of the reduced ventricle. `onset_ms` also applies to the finite-element
    /// ventricle.
    pub activation: ActivationSettings,
    /// Settings of the finite-element ventricle.
    pub finite_element: FiniteElementSettings,
    /// Settings of the solver with `fidelity = "external"`.
    pub external: ExternalSettings,
    /// Length at which the stretch of a cell is 1.
    pub cell_stretch: StretchOrigin,
    /// Ratio of a cell's slack length to its length in the unloaded wall, with `cell_stretch =
    /// "unloaded"`.
    #[schemars(extend("minimum" = 0.8, "maximum" = 1.3))]
    pub slack_stretch: f64,
    /// Number of beats per simulation in step 1 and verification.
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

/// Activation of the reduced ventricle, in place of an eikonal map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ActivationSettings {
    /// Time from the first to the last activation.
    #[schemars(extend("minimum" = 0.0, "maximum" = 300.0))]
    pub spread_ms: f64,
    /// Number of parts of the wall with their own activation time.
    #[schemars(range(min = 1, max = 1000))]
    pub groups: u32,
    /// First activation from the time zero of the traces; negative if it comes before. If absent,
    /// it is determined from the upstroke of the measured pressure.
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

/// Source of the calcium transient in step 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CalciumSource {
    /// Rice's transient, fitted together with the other parameters (the paper's choice).
    Rice,
    /// Fixed transient (eq. 18): `measured.calcium` of the patient, or else the median of the
    /// organ's nodal calcium. Rice's four parameters have no effect and are not fitted.
    MedianTrace,
}

/// Search method of step 2.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// SciPy's best1bin (the paper's choice).
    #[default]
    DifferentialEvolution,
    /// Covariance matrix adaptation with restarts (Hansen 2016).
    CmaEs,
}

impl Strategy {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Settings of step 2: fit of the cell (SPEC section 6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CellFitSettings {
    /// Seed of the random numbers. Each patient has its own stream.
    pub seed: u64,
    /// Method of the search.
    #[serde(skip_serializing_if = "Strategy::is_default")]
    pub strategy: Strategy,
    /// Members of the population per parameter.
    #[schemars(range(min = 1, max = 10_000))]
    pub popsize: u32,
    /// Relative tolerance: the search has converged when the standard deviation of the costs is at
    /// most this share of their mean (plus `atol`).
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub tol: f64,
    /// Absolute tolerance, which is added to the relative one.
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
    /// Whether successes take effect within the generation.
    pub updating: Updating,
    /// Whether local gradient searches from the best member follow the search.
    pub polish: bool,
    /// Whether the interval of near-optimal values of each parameter is computed after the fit.
    pub identifiability: bool,
    /// Source of the calcium transient.
    pub calcium: CalciumSource,
    /// Initial guess that is placed in the first population, clipped to the bounds. Fitted
    /// parameters without an entry start at their default (Tables A2 to A4).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub initial: BTreeMap<String, f64>,
    /// Fitted parameters in their order.
    pub parameters: Vec<String>,
    /// Bounds of the fitted parameters: lower, upper (Table A5).
    pub bounds: BTreeMap<String, [f64; 2]>,
    /// Weights of the squared relative differences, by biomarker.
    #[schemars(extend("additionalProperties" = { "type": "number", "minimum": 0.0, "maximum": 1e9 }))]
    pub weights: BTreeMap<String, f64>,
    /// Parameters that are held at a value other than the default.
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

/// Last step of a patient's workflow.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LastStep {
    /// The verification beat, with the cell of step 2 in the organ (the paper's workflow).
    Step2Verification,
    /// Step 3, after the verification beat.
    #[default]
    Step3,
}

/// Settings of the workflow.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WorkflowSettings {
    /// Last step that a patient runs through.
    pub until: LastStep,
    /// Where parameters of a finite-element ventricle are searched.
    pub surrogate: Surrogate,
    /// File with what other organs taught about the organ's law, from `cardiotwin export --law`. Its
    /// path is relative to the cohort's folder. Without it, the law of the program is the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<String>,
    /// Number of patients, the first by name of those who use the organ's law, whose 3D beats teach
    /// the law of all others. The others wait after step 0 until these pilots have ended. With 0,
    /// every patient is independent.
    pub pilots: u32,
}

/// Fast ventricle for the search of a finite-element ventricle's parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Surrogate {
    /// The organ's law: pressure and stretch as functions of volume and mean stress, learned from
    /// the patient's own beats. Step 2's cell is then fitted in the organ.
    #[default]
    OrganLaw,
    /// The one-fibre ventricle. Step 2's cell is fitted against a spring, as in the paper.
    OneFibre,
}

/// Settings of the verification beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VerificationSettings {
    /// Whether the verification beat is simulated. Without it there is no step 3.
    pub enabled: bool,
    /// Largest differences of the biomarkers at which a patient counts as personalised.
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

/// Place where tasks run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ExecutorKind {
    /// Worker processes on this computer.
    Local,
    /// No-op tasks inside the coordinator, to measure the orchestration.
    InProcess,
    /// Jobs on a cluster, which `cardiotwin advance` submits and observes.
    Slurm,
}

/// Instructions of the cell engine. AVX2 and AVX-512 give identical bits. `portable` rounds
/// differently, so that a fit may take another path and end elsewhere within its tolerance.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum InstructionSet {
    /// Best instruction set of the processor.
    #[default]
    Auto,
    /// Instructions of every processor.
    Portable,
    /// AVX2, with four lanes per register.
    Avx2,
    /// AVX-512, with eight lanes per register.
    Avx512,
}

impl InstructionSet {
    /// Whether the processor determines the instruction set.
    #[must_use]
    pub fn is_auto(&self) -> bool {
        *self == Self::Auto
    }
}

/// Settings of the executor. They never enter a task's key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExecutorSettings {
    /// Place where tasks run.
    pub kind: ExecutorKind,
    /// Number of concurrent workers; 0 for one per core.
    #[schemars(range(min = 0, max = 4096))]
    pub workers: u32,
    /// Threads of each worker. With 0 on this computer, step 0 and beats of a 3D ventricle with
    /// 8,000 nodes or more use all cores and run alone; all other tasks use one thread.
    #[schemars(range(min = 0, max = 16384))]
    pub threads: u32,
    /// MPI launcher with its arguments, for example `["mpirun"]` or `["srun", "--mpi=pmix"]`. A 3D
    /// simulation with several threads then runs on as many ranks of `cardiotwin-worker-mpi`
    /// instead. In a job of a cluster each simulation is a step of the job, on nodes of its own or
    /// on a share of a node, and the launcher gets the nodes. Options of the site's profile come
    /// first where both name the same program.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub launcher: Vec<String>,
    /// Largest number of MPI ranks on a node of a cluster; 0 for the node's cores. A simulation
    /// with more ranks runs on several nodes.
    #[serde(skip_serializing_if = "crate::absent::is_zero_count")]
    #[schemars(range(min = 0, max = 1024))]
    pub ranks_per_node: u32,
    /// Instructions of the cell engine, which every outcome records.
    pub instruction_set: InstructionSet,
    /// Number of automatic repeats of a task that failed because of the site (process killed, disk
    /// full).
    #[schemars(range(min = 0, max = 100))]
    pub site_retries: u32,
    /// Simulated time between frames of the series of VTU files that each beat of the
    /// finite-element ventricle writes; 0 for the first and last frame of beats with the fitted
    /// cell, and no others.
    #[serde(skip_serializing_if = "crate::absent::is_zero")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub vtu_every_ms: f64,
    /// Time without progress after which a running worker is considered hung and killed; 0 for no
    /// limit. If absent, ten times the longest time between two of the worker's own reports and at
    /// least ten minutes, or half an hour before its second report.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e7))]
    pub hang_timeout_s: Option<f64>,
    /// Permission mask of new files of a run, octal. `0077` restricts them to their owner. If
    /// absent, the mask of the shell applies and others get no access.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub umask: Option<String>,
    /// Group of the run's folder and of all files in it. If absent, the file system determines the
    /// group.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Absolute path of the folder for attempts, on a file system for working files. The run's
    /// folder contains a link to it. If absent, attempts lie in the run's folder next to the
    /// database.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scratch: Option<PathBuf>,
    /// Absolute path of the folder for copies of `archive`. If absent, the command line must
    /// name a folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub archive: Option<PathBuf>,
    /// Notices about a run that is done, stalls, fails or runs out of space.
    #[serde(skip_serializing_if = "NoticeSettings::is_default")]
    pub notices: NoticeSettings,
    /// Settings of the cluster's jobs, for `kind = "slurm"`.
    #[serde(skip_serializing_if = "SlurmSettings::is_default")]
    pub slurm: SlurmSettings,
}

/// Settings of a cohort's jobs on a cluster.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SlurmSettings {
    /// Site profile: `archer2`, `generic`, `laptop`, `levante`, `lumi`, `roihu`, or the path of a
    /// file like those in deploy/sites.
    pub site: String,
    /// Account that is charged. Some sites require one.
    pub account: Option<String>,
    /// Queue of the profile; by default the first one that suits the work.
    pub queue: Option<String>,
    /// Queues that take jobs for which the first one has no room, in this order, such as the same
    /// partition with another QoS.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub fallback_queues: Vec<String>,
    /// Longest walltime of a job, `HH:MM:SS`; by default the queue's.
    pub walltime: Option<String>,
    /// Further options of every job, as on sbatch's command line, such as `--reservation=NAME`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub directives: Vec<String>,
    /// Largest number of your jobs in a queue at a time, waiting or running; 0 for the limit of the
    /// queue.
    #[serde(skip_serializing_if = "crate::absent::is_zero_count")]
    #[schemars(range(max = 1_000_000))]
    pub max_jobs: u32,
    /// Largest number of node-hours of the run's jobs; 0 for no limit. What is spent counts, and the
    /// walltimes of jobs that wait or run.
    #[serde(skip_serializing_if = "crate::absent::is_zero")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e12))]
    pub max_node_hours: f64,
    /// Time before the end of the walltime at which a job is warned, so that it can write a
    /// checkpoint.
    #[schemars(range(max = 86_400))]
    pub warning_s: u64,
    /// Memory of each worker, if the queue allocates single cores.
    #[serde(rename = "memory_MiB")]
    #[schemars(range(max = 100_000_000))]
    pub memory_mib: u64,
    /// Expected time of a simulated beat until some have been measured; 0 for an estimate from
    /// fidelity and mesh.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e7))]
    pub simulation_s: f64,
    /// Largest number of nodes of a job, if the queue allocates whole nodes; 0 for the limit of the
    /// queue.
    #[schemars(range(max = 100_000))]
    pub bundle_nodes: u32,
    /// Shortest intended duration of a job, if there is enough work. Patients are combined in a job
    /// up to this duration.
    #[schemars(range(max = 10_000_000))]
    pub job_s: u64,
    /// Time after which a job that cannot be found is given up, s.
    #[schemars(range(max = 86_400))]
    pub grace_s: u64,
    /// Number of repeats of a patient that are not charged to it, after failed nodes, preemptions
    /// and walltimes in which it made progress.
    #[schemars(range(max = 1000))]
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
            fallback_queues: Vec::new(),
            directives: Vec::new(),
            max_jobs: 0,
            max_node_hours: 0.0,
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
            ranks_per_node: 0,
            instruction_set: InstructionSet::Auto,
            site_retries: 2,
            vtu_every_ms: 0.0,
            hang_timeout_s: None,
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
