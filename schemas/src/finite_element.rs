//! Data of the finite-element ventricle that pass between processes: settings, input of step 0 and
//! its result.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::input_file::InputFile;
use crate::loads::EffectSpec;
use crate::muscle::{ActiveConvention, HolzapfelOgden, MuscleLaw, PassiveTissues};

pub use cardiotwin_vocabulary::fibres::FibreAngles;

/// Effects of a patient's model that change the passive law. Step 0 needs them because it fits the
/// scale of that law.
pub const EFFECTS_OF_THE_PASSIVE_LAW: [&str; 1] = ["passive_stiffening"];

/// Tetrahedral elements of the wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ElementKind {
    /// Linear tetrahedra whose change of volume is resisted by nodal averages.
    #[default]
    LinearNodal,
    /// Linear tetrahedra with a plain penalty (P1/P0), as in the paper. They suffer from volumetric
    /// locking.
    LinearPointwise,
    /// Quadratic tetrahedra whose change of volume is resisted by nodal averages.
    QuadraticNodal,
}

/// Solver of the linear systems of a time step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LinearSolver {
    /// Conjugate gradients with a block Jacobi preconditioner and rigid motions of groups of nodes. Quadratic elements take
    /// block Jacobi alone.
    #[default]
    RigidLevels,
    /// Conjugate gradients with a block Jacobi preconditioner.
    BlockJacobi,
    /// Conjugate gradients with a symmetric block Gauss-Seidel preconditioner.
    SymmetricSweep,
    /// Conjugate gradients preconditioned by a factorisation that is reused.
    Direct,
}

impl LinearSolver {
    /// Whether several ranks can share a beat with it.
    #[must_use]
    pub fn is_parallel(self) -> bool {
        matches!(self, Self::RigidLevels | Self::BlockJacobi)
    }
}

/// Model of the electrophysiology.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Electrophysiology {
    /// Activation times only.
    #[default]
    Eikonal,
    /// Activation times and, after the verification beat, transmembrane potentials. No other task
    /// waits for the potentials.
    ReactionEikonal,
}

/// Material, supports and damping of the wall. Values without a source are assumptions
/// (docs/models.md).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WallSettings {
    /// Passive law of muscle.
    pub muscle_law: MuscleLaw,
    /// Guccione's C at which the search for the patient's value begins.
    #[serde(rename = "guccione_C_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub guccione_c_kpa: f64,
    /// Exponent along the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_f: f64,
    /// Exponent across the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_t: f64,
    /// Exponent of fibre shear.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_fs: f64,
    /// Constants of Holzapfel and Ogden's law, at which the search for the patient's moduli begins.
    pub holzapfel_ogden: HolzapfelOgden,
    /// Shear modulus of neo-Hookean muscle at which the search for the patient's value begins.
    #[serde(rename = "neo_hookean_mu_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub neo_hookean_mu_kpa: f64,
    /// Bulk modulus of muscle.
    #[serde(rename = "kappa_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e8))]
    pub kappa_kpa: f64,
    /// Share of the bulk modulus that resists each element's own change of volume; the rest resists
    /// nodal averages. If absent, it is 0.01 in linear elements and 0 in quadratic ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub pointwise_share: Option<f64>,
    /// Stress tensor along the fibre that the contraction model's stress enters.
    pub active_convention: ActiveConvention,
    /// Share of the active stress that acts along the sheet, in addition to the stress along the
    /// fibre.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub cross_fibre_share: f64,
    /// Ratio of the contraction's duration at the epicardium to that at the endocardium; linear in
    /// the depth between.
    #[schemars(extend("minimum" = 0.5, "maximum" = 2.0))]
    pub epicardial_duration_share: f64,
    /// Share of the active stress that acts along the normal of the sheet. Where sheets are
    /// transmural, this direction lies across the fibre in the plane of the wall. Shares of effects
    /// are added to it.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub sheet_normal_share: f64,
    /// Shear modulus of the aortic root and of all passive tissue without an entry in `passive`.
    #[serde(rename = "aorta_mu_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub aorta_mu_kpa: f64,
    /// Bulk modulus of the aortic root.
    #[serde(rename = "aorta_kappa_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e8))]
    pub aorta_kappa_kpa: f64,
    /// Passive tissues with their own moduli, by the mesh's tags.
    #[serde(
        skip_serializing_if = "PassiveTissues::is_empty",
        deserialize_with = "crate::muscle::by_tag"
    )]
    pub passive: PassiveTissues,
    /// Density of the wall.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1.0))]
    pub density_g_per_mm3: f64,
    /// Rayleigh damping by mass.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub mass_damping_per_ms: f64,
    /// Rayleigh damping by stiffness.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub stiffness_damping_ms: f64,
    /// Stiffness of the pericardium at the apex: springs along the normal of epicardium and septum.
    #[serde(rename = "epicardial_spring_kPa_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub epicardial_spring_kpa_per_mm: f64,
    /// Damping of the pericardium at the apex: dashpots parallel to the springs.
    #[serde(rename = "epicardial_dashpot_kPa_ms_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub epicardial_dashpot_kpa_ms_per_mm: f64,
    /// Ratio of the pericardium's stiffness and damping at the base to those at the apex; linear in
    /// the height between.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub epicardial_base_share: f64,
    /// Stiffness of the springs in all directions on the rim.
    #[serde(rename = "rim_spring_kPa_per_mm")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub rim_spring_kpa_per_mm: f64,
    /// Damping of the dashpots parallel to the springs on the rim.
    #[serde(rename = "rim_dashpot_kPa_ms_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub rim_dashpot_kpa_ms_per_mm: f64,
    /// Springs and dashpots of further surfaces of the patient's own mesh, by surface name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub surface: BTreeMap<String, SurfaceSpring>,
    /// Spectral radius of the generalised-α method; 0 damps the highest frequencies within one
    /// step.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub spectral_radius: f64,
}

/// Springs and dashpots along the normal of a surface. The springs are unloaded at end-diastole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceSpring {
    /// Stiffness along the normal.
    #[serde(rename = "spring_kPa_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub spring_kpa_per_mm: f64,
    /// Damping along the normal.
    #[serde(rename = "dashpot_kPa_ms_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub dashpot_kpa_ms_per_mm: f64,
}

impl Default for WallSettings {
    fn default() -> Self {
        Self {
            muscle_law: MuscleLaw::default(),
            guccione_c_kpa: 0.42,
            b_f: 18.48,
            b_t: 3.58,
            b_fs: 1.627,
            holzapfel_ogden: HolzapfelOgden::default(),
            neo_hookean_mu_kpa: 5.0,
            kappa_kpa: 1000.0,
            pointwise_share: None,
            active_convention: ActiveConvention::default(),
            cross_fibre_share: 0.0,
            epicardial_duration_share: 0.9,
            sheet_normal_share: 0.2,
            aorta_mu_kpa: 26.66,
            aorta_kappa_kpa: 1000.0,
            passive: PassiveTissues::new(),
            density_g_per_mm3: 1.06e-3,
            mass_damping_per_ms: 0.1,
            stiffness_damping_ms: 0.1,
            epicardial_spring_kpa_per_mm: 0.2,
            epicardial_dashpot_kpa_ms_per_mm: 5.0,
            epicardial_base_share: 0.2,
            rim_spring_kpa_per_mm: 0.05,
            rim_dashpot_kpa_ms_per_mm: 0.0,
            surface: BTreeMap::new(),
            spectral_radius: 0.0,
        }
    }
}

/// Conduction velocities of the eikonal activation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ConductionSettings {
    /// Velocity along the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub along_m_per_s: f64,
    /// Velocity across the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub across_m_per_s: f64,
    /// Velocity in the fast endocardial layer; 0 for no such layer.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub endocardium_m_per_s: f64,
}

impl Default for ConductionSettings {
    fn default() -> Self {
        Self {
            along_m_per_s: 0.6,
            across_m_per_s: 0.3,
            endocardium_m_per_s: 4.0,
        }
    }
}

/// Step control of Newton's method: `[solver.finite_element.newton]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NewtonSettings {
    /// Largest number of times that an iteration's step is halved. After that the time step fails
    /// and is halved itself.
    #[schemars(range(min = 0, max = 30))]
    pub halvings: u32,
    /// Ratio of an element's deformed volume to its reference volume at or below which an
    /// iteration's step is halved.
    #[schemars(extend("minimum" = 0.0, "maximum" = 0.9))]
    pub smallest_volume_ratio: f64,
    /// Largest displacement of a node in an iteration; 0 for no limit.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e3))]
    pub farthest_mm: f64,
}

impl Default for NewtonSettings {
    fn default() -> Self {
        Self {
            halvings: 4,
            smallest_volume_ratio: 0.1,
            farthest_mm: 0.0,
        }
    }
}

impl NewtonSettings {
    fn are_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Settings of the finite-element ventricle: `[solver.finite_element]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FiniteElementSettings {
    /// Approximate number of nodes of the generated mesh.
    #[schemars(range(min = 500, max = 2_000_000))]
    pub mesh_nodes: u32,
    /// Elements of the wall.
    pub element: ElementKind,
    /// Ratio of a time step's residual to the scale of its forces at which the step has converged.
    #[schemars(extend("minimum" = 1e-12, "maximum" = 0.1))]
    pub tolerance: f64,
    /// Number of Newton iterations after which a step fails.
    #[schemars(range(min = 1, max = 1000))]
    pub newton_iterations: u32,
    /// Step control of Newton's method.
    pub newton: NewtonSettings,
    /// Solver of the linear systems.
    pub linear_solver: LinearSolver,
    /// Longest time step of late filling, that is after ejection, with the mitral valve open and
    /// four fifths of the volume back, while the pressure changes by less than 0.1 mmHg per
    /// millisecond. 0 for no separate limit.
    #[serde(skip_serializing_if = "crate::absent::is_zero")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 20.0))]
    pub diastolic_step_ms: f64,
    /// Longest time step where an estimate of the error controls the steps; they are output intervals times powers of two. 0
    /// for steps of one length.
    #[serde(skip_serializing_if = "is_usual_longest")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 20.0))]
    pub longest_step_ms: f64,
    /// Tolerated error of a controlled step over its length, of the cavity's pressure \[mmHg/s\] and volume \[mL/s\].
    #[serde(skip_serializing_if = "is_usual_tolerance")]
    #[schemars(extend("minimum" = 1e-3, "maximum" = 1000.0))]
    pub step_tolerance: f64,
    /// Number of parts into which the mesh is cut, each computed by a thread; 0 for one part per thread or MPI rank. Sums
    /// follow the parts, so that results are the same to the bit for any number of threads, and for any number of MPI ranks
    /// that divides it.
    #[serde(skip_serializing_if = "crate::absent::is_zero_count")]
    #[schemars(range(min = 0, max = 63))]
    pub subdomains: u32,
    /// Material, supports and damping of the wall.
    pub wall: WallSettings,
    /// Angles of the fibres.
    pub fibres: FibreAngles,
    /// Conduction velocities of the activation.
    pub conduction: ConductionSettings,
    /// Whether transmembrane potentials are computed besides the activation times.
    #[serde(skip_serializing_if = "is_eikonal")]
    pub ep: Electrophysiology,
}

/// Default of the longest controlled step \[ms\].
const LONGEST_STEP_MS: f64 = 4.0;

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes a reference"
)]
fn is_usual_longest(longest_step_ms: &f64) -> bool {
    *longest_step_ms == LONGEST_STEP_MS
}

/// Default of the tolerated error of controlled steps \[mmHg/s and mL/s\].
const STEP_TOLERANCE: f64 = 2.0;

fn usual_tolerance() -> f64 {
    STEP_TOLERANCE
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes a reference"
)]
fn is_usual_tolerance(tolerance: &f64) -> bool {
    *tolerance == STEP_TOLERANCE
}

fn is_eikonal(ep: &Electrophysiology) -> bool {
    *ep == Electrophysiology::Eikonal
}

impl Default for FiniteElementSettings {
    fn default() -> Self {
        Self {
            mesh_nodes: 1000,
            element: ElementKind::default(),
            tolerance: 1e-4,
            newton_iterations: 12,
            newton: NewtonSettings::default(),
            linear_solver: LinearSolver::default(),
            diastolic_step_ms: 0.0,
            longest_step_ms: LONGEST_STEP_MS,
            step_tolerance: STEP_TOLERANCE,
            subdomains: 0,
            wall: WallSettings::default(),
            fibres: FibreAngles::default(),
            conduction: ConductionSettings::default(),
            ep: Electrophysiology::default(),
        }
    }
}

impl FiniteElementSettings {
    /// Input of step 0: the settings that it needs, with the patient's effects that change the
    /// passive law.
    #[must_use]
    pub fn anatomy(&self, effects: &[EffectSpec]) -> AnatomySpec {
        let of_the_law =
            |effect: &&EffectSpec| EFFECTS_OF_THE_PASSIVE_LAW.contains(&effect.name.as_str());
        AnatomySpec {
            mesh_nodes: self.mesh_nodes,
            element: self.element,
            wall: self.wall.clone(),
            fibres: self.fibres,
            conduction: self.conduction,
            subdomains: self.subdomains,
            effects: effects.iter().filter(of_the_law).cloned().collect(),
        }
    }

    /// Settings that a beat needs.
    #[must_use]
    pub fn equations(&self) -> EquationSettings {
        let Self {
            tolerance,
            newton,
            linear_solver,
            diastolic_step_ms,
            longest_step_ms,
            step_tolerance,
            subdomains,
            ..
        } = *self;
        EquationSettings {
            tolerance,
            newton,
            linear_solver,
            diastolic_step_ms,
            longest_step_ms,
            step_tolerance: if longest_step_ms > 0.0 {
                step_tolerance
            } else {
                STEP_TOLERANCE
            },
            subdomains,
            potentials: None,
        }
    }
}

/// Input from which step 0 makes a finite-element ventricle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AnatomySpec {
    /// Approximate number of nodes.
    pub mesh_nodes: u32,
    /// Elements of the wall.
    pub element: ElementKind,
    /// Material, supports and damping of the wall.
    pub wall: WallSettings,
    /// Angles of the fibres.
    pub fibres: FibreAngles,
    /// Conduction velocities of the activation.
    pub conduction: ConductionSettings,
    /// Number of parts of the mesh; 0 for one per thread or MPI rank.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero_count")]
    pub subdomains: u32,
    /// Effects of the patient's model that change the passive law, such as `passive_stiffening`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
}

/// Source of the fibres of a patient's own mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MeshFibres {
    /// Fibres of the mesh if it has any, otherwise fibres of the rule.
    #[default]
    Auto,
    /// Fibres of the mesh.
    Mesh,
    /// Fibres of the rule with the angles of `solver.finite_element.fibres`.
    Rule,
}

/// A patient's own mesh, identified by the contents of its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OwnMesh {
    /// Files of the mesh. The extension of the first file determines the format: `.pts`, `.vtu`,
    /// `.msh` or `.mesh`.
    pub files: Vec<InputFile>,
    /// Unit of the coordinates: um, mm, cm or m.
    pub unit: String,
    /// Tags of contracting tissue; all other tissue is passive.
    pub left_ventricle: Vec<i32>,
    /// Source of the fibres.
    pub fibres: MeshFibres,
    /// File of activation times, one number per node.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activation_times: Option<InputFile>,
    /// Points where activation begins if there is no file of activation times.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub activation_sites_mm: Vec<[f64; 3]>,
    /// Right ventricle of the mesh, if its pressure is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right_ventricle: Option<OwnRightVentricle>,
}

/// The passive right ventricle of a patient's own mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OwnRightVentricle {
    /// Surface of the right ventricular endocardium.
    pub surface: String,
    /// Pressure in the right ventricular cavity.
    pub pressure: RightPressureSpec,
}

/// Pressure in the right ventricle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(deny_unknown_fields)]
pub enum RightPressureSpec {
    /// A pressure that stays the same over the cycle.
    Constant {
        /// Pressure at all times.
        #[serde(rename = "pressure_mmHg")]
        pressure_mmhg: f64,
    },
    /// Trace over one cycle.
    Trace {
        /// File with the columns `time_ms` and `pressure_mmHg`.
        file: InputFile,
    },
}

/// Settings of the solution of a beat's equations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct EquationSettings {
    /// Ratio of a time step's residual to the scale of its forces at which the step has converged.
    pub tolerance: f64,
    /// Step control of Newton's method.
    #[serde(default, skip_serializing_if = "NewtonSettings::are_default")]
    pub newton: NewtonSettings,
    /// Solver of the linear systems.
    pub linear_solver: LinearSolver,
    /// Longest time step of late filling \[ms\]; 0 for no separate limit.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero")]
    pub diastolic_step_ms: f64,
    /// Longest time step where an estimate of the error controls the steps \[ms\]; 0 for steps of one length.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero")]
    pub longest_step_ms: f64,
    /// Tolerated error of a controlled step over its length \[mmHg/s and mL/s\].
    #[serde(
        default = "usual_tolerance",
        skip_serializing_if = "is_usual_tolerance"
    )]
    pub step_tolerance: f64,
    /// Number of parts of the mesh; 0 for one per thread or MPI rank.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero_count")]
    pub subdomains: u32,
    /// Conduction velocities of the wave for transmembrane potentials, which are computed after the
    /// beat; absent if no potentials are computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub potentials: Option<ConductionSettings>,
}

/// A finite-element ventricle from step 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FiniteElementOrgan {
    /// Mesh, fibres, activation, unloaded geometry and end-diastolic state (artefact `ventricle` of
    /// step 0).
    pub ventricle: InputFile,
    /// Figures of this ventricle.
    pub figures: VentricleFigures,
}

/// Figures of a finite-element ventricle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct VentricleFigures {
    /// Nodes of the mesh.
    pub nodes: u64,
    /// Number of tetrahedra of the mesh.
    pub elements: u64,
    /// Number of unknown displacements.
    pub degrees_of_freedom: u64,
    /// Mean length of the edges in the image's geometry.
    pub mean_edge_mm: f64,
    /// Volume of the contracting wall.
    #[serde(rename = "wall_volume_mL")]
    pub wall_volume_ml: f64,
    /// Cavity volume of the image from which the mesh was made.
    #[serde(rename = "image_volume_mL")]
    pub image_volume_ml: f64,
    /// Pressure with which the image is in equilibrium.
    #[serde(rename = "image_pressure_mmHg")]
    pub image_pressure_mmhg: f64,
    /// Cavity volume at zero pressure.
    #[serde(rename = "unloaded_volume_mL")]
    pub unloaded_volume_ml: f64,
    /// Cavity volume at end-diastole, where the beat starts and the stretch of the active law is 1.
    #[serde(rename = "end_diastolic_volume_mL")]
    pub end_diastolic_volume_ml: f64,
    /// Pressure at end-diastole.
    #[serde(rename = "end_diastolic_pressure_mmHg")]
    pub end_diastolic_pressure_mmhg: f64,
    /// Stiffness of the muscle's law, fitted or given: Guccione's C, Holzapfel and Ogden's a or the
    /// neo-Hookean µ.
    #[serde(rename = "stiffness_kPa")]
    pub stiffness_kpa: f64,
    /// Factor on all exponents of the law; 1 for a law without exponents.
    pub exponent_factor: f64,
    /// First activation, from the start of the beat.
    pub onset_ms: f64,
    /// Time from the first to the last activation of muscle.
    pub spread_ms: f64,
    /// Duration of the contraction at the epicardium over that at the endocardium.
    #[serde(default = "crate::absent::epicardial_duration_share")]
    pub epicardial_duration_share: f64,
}
