//! The benchmark file, as it is written.

use std::path::PathBuf;

use cardiotwin_schemas::finite_element::{ElementKind, LinearSolver};
use cardiotwin_schemas::muscle::ActiveConvention;
use serde::Deserialize;

/// A benchmark: one body, its loads in time, what is wanted of it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// What it is.
    #[serde(default)]
    pub title: String,
    /// Mesh.
    pub mesh: MeshTable,
    /// Elements.
    #[serde(default)]
    pub element: ElementTable,
    /// Tissues, first match by tag.
    pub tissue: Vec<TissueTable>,
    /// Where fibres come from.
    pub fibres: FibreTable,
    /// Springs and dashpots.
    #[serde(default)]
    pub support: Vec<SupportTable>,
    /// Held nodes.
    #[serde(default)]
    pub fixed: Vec<FixedTable>,
    /// Surfaces under pressure.
    #[serde(default)]
    pub pressure: Vec<PressureTable>,
    /// Active stress of contracting tissue.
    #[serde(default)]
    pub active_stress: Option<CourseTable>,
    /// Cavities whose volume is wanted.
    #[serde(default)]
    pub cavity: Vec<CavityTable>,
    /// Points whose displacement is wanted.
    #[serde(default)]
    pub probe: Vec<ProbeTable>,
    /// Motion or equilibrium.
    pub time: TimeTable,
    /// Tolerances.
    #[serde(default)]
    pub solver: SolverTable,
}

/// Where the mesh is.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    /// Stem of CARP files, or a `.vtu` or `.msh` file; relative to the benchmark file.
    pub file: PathBuf,
    /// Unit of its coordinates: um, mm, cm or m.
    pub unit: String,
    /// How often every edge is halved.
    #[serde(default)]
    pub refine: u32,
    /// Ellipsoids that mid-edge nodes of boundary edges are put on.
    #[serde(default)]
    pub curved: Option<CurvedTable>,
}

/// Ellipsoids of revolution, one for each named surface.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvedTable {
    /// x, y or z.
    pub axis: Axis,
    /// Surfaces.
    pub surface: Vec<CurvedSurface>,
}

/// A surface that is part of an ellipsoid around the origin.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvedSurface {
    /// Its name in the mesh.
    pub name: String,
    /// Half-axis across.
    pub short_mm: f64,
    /// Half-axis along.
    pub long_mm: f64,
}

/// A coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// First.
    X,
    /// Second.
    Y,
    /// Third.
    Z,
}

/// Elements: a cohort's by name, or by their parts.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ElementTable {
    /// As `solver.finite_element.element` of a cohort.
    pub kind: Option<ElementKind>,
    /// linear or quadratic, which is the default.
    pub degree: Option<Degree>,
    /// pointwise or nodal, which is the default.
    pub volume: Option<VolumeName>,
    /// Share of κ that stays pointwise with nodal volume change; 0 by default.
    pub pointwise_share: Option<f64>,
}

/// Degree of the displacement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Degree {
    /// Four nodes.
    Linear,
    /// Ten nodes.
    Quadratic,
}

/// How the change of volume is resisted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VolumeName {
    /// At every integration point.
    Pointwise,
    /// By nodal averages.
    Nodal,
}

/// A tissue.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TissueTable {
    /// Tags of its elements; all that no earlier tissue claims where absent.
    #[serde(default)]
    pub tags: Vec<i32>,
    /// Density.
    pub density_mg_per_mm3: f64,
    /// Viscosity.
    #[serde(default, rename = "viscosity_kPa_ms")]
    pub viscosity_kpa_ms: f64,
    /// Passive law with its constants.
    pub passive: PassiveTable,
    /// Volumetric law.
    pub volumetric: VolumetricTable,
    /// Whether and how active stress acts.
    #[serde(default)]
    pub active: Option<ActiveTable>,
}

/// Passive laws.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "law", rename_all = "kebab-case", deny_unknown_fields)]
pub enum PassiveTable {
    /// Guccione 1995.
    Guccione {
        /// Stiffness.
        #[serde(rename = "c_kPa")]
        c_kpa: f64,
        /// Exponent along the fibre.
        b_f: f64,
        /// Exponent across.
        b_t: f64,
        /// Exponent of shear.
        b_fs: f64,
    },
    /// Holzapfel and Ogden 2009.
    HolzapfelOgden {
        /// `a`.
        #[serde(rename = "a_kPa")]
        a_kpa: f64,
        /// `b`.
        b: f64,
        /// `a_f`.
        #[serde(rename = "a_f_kPa")]
        a_f_kpa: f64,
        /// `b_f`.
        b_f: f64,
        /// `a_s`.
        #[serde(rename = "a_s_kPa")]
        a_s_kpa: f64,
        /// `b_s`.
        b_s: f64,
        /// `a_fs`.
        #[serde(rename = "a_fs_kPa")]
        a_fs_kpa: f64,
        /// `b_fs`.
        b_fs: f64,
        /// Sharpness of the switch.
        switch: f64,
    },
    /// Neo-Hookean.
    NeoHookean {
        /// Shear modulus.
        #[serde(rename = "mu_kPa")]
        mu_kpa: f64,
    },
}

/// Volumetric law.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumetricTable {
    /// ln-squared, quadratic or quadratic-ln.
    pub law: VolumetricName,
    /// Bulk modulus.
    #[serde(rename = "kappa_kPa")]
    pub kappa_kpa: f64,
}

/// Names of volumetric laws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VolumetricName {
    /// `κ/2 (ln J)²`.
    LnSquared,
    /// `κ/2 (J − 1)²`.
    Quadratic,
    /// `κ/4 (J² − 1 − 2 ln J)`.
    QuadraticLn,
}

/// How active stress acts.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActiveTable {
    /// second-piola, first-piola or per-squared-stretch.
    pub convention: ActiveConvention,
    /// Share across the fibre.
    #[serde(default)]
    pub cross_fibre: f64,
}

/// Where fibres come from.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum FibreTable {
    /// The mesh's own.
    FromMesh,
    /// The same everywhere.
    Constant {
        /// Fibre.
        fibre: [f64; 3],
        /// Sheet.
        sheet: [f64; 3],
    },
    /// The benchmarks' rule on ellipsoids.
    Ellipsoid {
        /// Axis of revolution.
        axis: Axis,
        /// Short half-axis at endocardium and epicardium.
        short_mm: [f64; 2],
        /// Long half-axis at endocardium and epicardium.
        long_mm: [f64; 2],
        /// Angle at endocardium and epicardium.
        alpha_deg: [f64; 2],
        /// Where the depth of the wall comes from.
        depth: DepthTable,
    },
    /// Bayer 2012, for a left ventricle.
    LaplaceDirichlet {
        /// Surface of the cavity.
        endocardium: String,
        /// Outer surface.
        epicardium: String,
        /// Surface at the base.
        base: String,
        /// Fibre angle at endocardium and epicardium.
        alpha_deg: [f64; 2],
        /// Sheet angle at endocardium and epicardium.
        beta_deg: [f64; 2],
    },
}

/// Where the depth of the wall comes from.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "from", rename_all = "kebab-case", deny_unknown_fields)]
pub enum DepthTable {
    /// From the ellipsoid through the point.
    Geometry,
    /// From Laplace's equation between two surfaces.
    Laplace {
        /// Depth 0.
        endocardium: Vec<String>,
        /// Depth 1.
        epicardium: Vec<String>,
    },
}

/// Springs and dashpots.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SupportTable {
    /// Surface of the mesh.
    pub surface: String,
    /// normal or all.
    pub direction: DirectionName,
    /// Stiffness.
    #[serde(rename = "spring_kPa_per_mm")]
    pub spring_kpa_per_mm: f64,
    /// Damping.
    #[serde(default, rename = "dashpot_kPa_ms_per_mm")]
    pub dashpot_kpa_ms_per_mm: f64,
}

/// Directions of a support.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DirectionName {
    /// Along the reference normal.
    Normal,
    /// All.
    All,
}

/// Held nodes.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedTable {
    /// Surface of the mesh.
    pub surface: String,
    /// Components.
    pub components: Vec<Axis>,
}

/// A surface under pressure.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PressureTable {
    /// Surface of the mesh.
    pub surface: String,
    /// Pressure in time.
    pub course: CourseTable,
}

/// Values in time.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum CourseTable {
    /// Always the same.
    Constant {
        /// Value.
        #[serde(rename = "value_kPa")]
        value_kpa: f64,
    },
    /// Straight from zero.
    Ramp {
        /// Value at the end.
        #[serde(rename = "value_kPa")]
        value_kpa: f64,
        /// End.
        until_s: f64,
    },
    /// Points.
    Table {
        /// Times.
        t_s: Vec<f64>,
        /// Values.
        #[serde(rename = "value_kPa")]
        value_kpa: Vec<f64>,
    },
    /// The benchmark's active stress.
    Activation {
        /// σ₀.
        #[serde(rename = "contractility_kPa")]
        contractility_kpa: f64,
        /// Rise.
        rise_per_s: f64,
        /// Fall, negative.
        fall_per_s: f64,
        /// Onset.
        on_s: f64,
        /// End.
        off_s: f64,
        /// Width of the switches.
        switch_s: f64,
    },
    /// The benchmark's cavity pressure.
    ChamberPressure {
        /// σ_mid.
        #[serde(rename = "systolic_kPa")]
        systolic_kpa: f64,
        /// σ_pre.
        #[serde(rename = "filling_kPa_per_s")]
        filling_kpa_per_s: f64,
        /// α_pre.
        filling_per_s: f64,
        /// α_mid.
        middle_per_s: f64,
        /// Rise.
        rise_per_s: f64,
        /// Fall, negative.
        fall_per_s: f64,
        /// Onset.
        on_s: f64,
        /// End.
        off_s: f64,
        /// Width of the switches.
        switch_s: f64,
    },
}

/// A cavity.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CavityTable {
    /// Heads its column.
    pub name: String,
    /// Surfaces that enclose it but for openings.
    pub surfaces: Vec<String>,
}

/// A probe.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeTable {
    /// Heads its columns.
    pub name: String,
    /// Place in the reference configuration.
    pub at_mm: [f64; 3],
}

/// Motion or equilibrium.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "mode", rename_all = "lowercase", deny_unknown_fields)]
pub enum TimeTable {
    /// Generalised-α from rest.
    Dynamic {
        /// Step.
        dt_ms: f64,
        /// End.
        end_ms: f64,
        /// Time between rows of the output.
        output_every_ms: f64,
        /// Weight of the old acceleration.
        alpha_m: f64,
        /// Weight of the old forces.
        alpha_f: f64,
        /// Rayleigh damping by mass.
        #[serde(default)]
        mass_damping_per_ms: f64,
        /// Rayleigh damping by stiffness.
        #[serde(default)]
        stiffness_damping_ms: f64,
    },
    /// Equilibrium at the loads of one time.
    Static {
        /// That time.
        #[serde(default = "one_second")]
        at_ms: f64,
        /// First share of the load.
        #[serde(default = "a_tenth")]
        first_load_step: f64,
    },
}

fn one_second() -> f64 {
    1000.0
}

fn a_tenth() -> f64 {
    0.1
}

/// Tolerances.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverTable {
    /// Residual over the size of the loads.
    pub relative_tolerance: f64,
    /// Smallest pressure that the size of the loads counts.
    #[serde(rename = "least_pressure_kPa")]
    pub least_pressure_kpa: f64,
    /// Most Newton iterations of a step.
    pub max_iterations: usize,
    /// Linear solver.
    pub linear: LinearSolver,
}

impl Default for SolverTable {
    fn default() -> Self {
        Self {
            relative_tolerance: 1e-4,
            least_pressure_kpa: 0.5,
            max_iterations: 15,
            linear: LinearSolver::BlockJacobi,
        }
    }
}
