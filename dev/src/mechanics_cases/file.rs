//! Structure of a benchmark file.

use std::path::PathBuf;

use cardiotwin_dev_solver::prescribed::TimeCourse;
use cardiotwin_mechanics::boundary::RobinDirection;
use cardiotwin_mechanics::material::Volumetric;
use cardiotwin_schemas::finite_element::{ElementKind, LinearSolver};
use cardiotwin_schemas::muscle::ActiveConvention;
use serde::Deserialize;

/// A benchmark: a body, its loads over time, and the requested output.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Title, printed in the summary.
    #[serde(default)]
    pub title: String,
    /// Mesh of the body.
    pub mesh: MeshTable,
    /// Kind of the finite elements.
    #[serde(default)]
    pub element: ElementTable,
    /// Tissues. An element belongs to the first one with its tag.
    pub tissue: Vec<TissueTable>,
    /// Source of the fibres.
    pub fibres: FibreTable,
    /// Springs and dashpots on surfaces.
    #[serde(default)]
    pub support: Vec<SupportTable>,
    /// Surfaces whose nodes are held.
    #[serde(default)]
    pub fixed: Vec<FixedTable>,
    /// Surfaces under a pressure that follows their deformation.
    #[serde(default)]
    pub pressure: Vec<PressureTable>,
    /// Active stress of contracting tissue.
    #[serde(default)]
    pub active_stress: Option<TimeCourse>,
    /// Cavities whose volume is computed.
    #[serde(default)]
    pub cavity: Vec<CavityTable>,
    /// Points whose displacement is computed.
    #[serde(default)]
    pub probe: Vec<ProbeTable>,
    /// Time integration, or equilibrium at one time.
    pub time: TimeTable,
    /// Tolerances and linear solver.
    #[serde(default)]
    pub solver: SolverTable,
}

/// File of the mesh, its unit and its refinement.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    /// Stem of CARP files, or a `.vtu` or `.msh` file; relative to the benchmark file.
    pub file: PathBuf,
    /// Unit of its coordinates: um, mm, cm or m.
    pub unit: String,
    /// Number of times that every edge is halved; at most 4.
    #[serde(default)]
    pub refine: u32,
    /// Ellipsoids onto which mid-edge nodes of boundary edges are moved.
    #[serde(default)]
    pub curved: Option<CurvedTable>,
}

/// Ellipsoids of revolution, one for each named surface.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvedTable {
    /// Common axis of revolution: x, y or z.
    pub axis: Axis,
    /// The surfaces with their half-axes.
    pub surface: Vec<CurvedSurface>,
}

/// A surface that is part of an ellipsoid around the origin.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvedSurface {
    /// Name of the surface in the mesh.
    pub name: String,
    /// Half-axis across the axis of revolution.
    pub short_mm: f64,
    /// Half-axis along the axis of revolution.
    pub long_mm: f64,
}

/// Coordinate axis of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Axis of the first coordinate.
    X,
    /// Axis of the second coordinate.
    Y,
    /// Axis of the third coordinate.
    Z,
}

/// Finite elements, selected by a cohort's name for them or by their parts.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ElementTable {
    /// Same as `solver.finite_element.element` of a cohort.
    pub kind: Option<ElementKind>,
    /// linear or quadratic; quadratic by default.
    pub degree: Option<Degree>,
    /// pointwise or nodal; nodal by default.
    pub volume: Option<VolumeName>,
    /// Share of κ that stays pointwise when volume changes are nodal; 0 by default.
    pub pointwise_share: Option<f64>,
}

/// Polynomial degree of the displacement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Degree {
    /// Tetrahedra with four nodes.
    Linear,
    /// Tetrahedra with ten nodes.
    Quadratic,
}

/// Measure of the volume change that the bulk modulus acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VolumeName {
    /// Volume ratio at every integration point.
    Pointwise,
    /// Nodal averages of the volume ratio.
    Nodal,
}

/// Material of the elements with certain tags.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TissueTable {
    /// Tags of its elements. Without tags, the tissue takes all elements that no earlier tissue
    /// has.
    #[serde(default)]
    pub tags: Vec<i32>,
    /// Density of the undeformed tissue.
    pub density_mg_per_mm3: f64,
    /// Viscosity η of the viscous stress `S = η Ė`.
    #[serde(default, rename = "viscosity_kPa_ms")]
    pub viscosity_kpa_ms: f64,
    /// Passive law with its constants.
    pub passive: PassiveTable,
    /// Volumetric law with its bulk modulus.
    pub volumetric: Volumetric,
    /// Action of the active stress; `None` for passive tissue.
    #[serde(default)]
    pub active: Option<ActiveTable>,
}

/// Passive laws of muscle.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "law", rename_all = "kebab-case", deny_unknown_fields)]
pub enum PassiveTable {
    /// Guccione et al. 1995.
    Guccione {
        /// Stiffness `C` \[kPa\], a factor on all stress.
        #[serde(rename = "c_kPa")]
        c_kpa: f64,
        /// Exponent `b_f` of strain along the fibre.
        b_f: f64,
        /// Exponent `b_t` of strain across the fibre.
        b_t: f64,
        /// Exponent `b_fs` of shear along the fibre.
        b_fs: f64,
    },
    /// Holzapfel and Ogden 2009.
    HolzapfelOgden {
        /// Modulus `a` of the isotropic term \[kPa\].
        #[serde(rename = "a_kPa")]
        a_kpa: f64,
        /// Exponent `b` of the isotropic term.
        b: f64,
        /// Modulus `a_f` of fibre extension \[kPa\].
        #[serde(rename = "a_f_kPa")]
        a_f_kpa: f64,
        /// Exponent `b_f` of fibre extension.
        b_f: f64,
        /// Modulus `a_s` of sheet extension \[kPa\].
        #[serde(rename = "a_s_kPa")]
        a_s_kpa: f64,
        /// Exponent `b_s` of sheet extension.
        b_s: f64,
        /// Modulus `a_fs` of shear between fibre and sheet \[kPa\].
        #[serde(rename = "a_fs_kPa")]
        a_fs_kpa: f64,
        /// Exponent `b_fs` of shear between fibre and sheet.
        b_fs: f64,
        /// Sharpness of the switch that lets fibres bear tension alone.
        switch: f64,
    },
    /// Neo-Hookean law, isotropic and without exponents.
    NeoHookean {
        /// Shear modulus `μ` \[kPa\].
        #[serde(rename = "mu_kPa")]
        mu_kpa: f64,
    },
}

/// Action of the active stress on a tissue.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActiveTable {
    /// second-piola, first-piola or per-squared-stretch.
    pub convention: ActiveConvention,
    /// Share of the active stress that acts across the fibre.
    #[serde(default)]
    pub cross_fibre: f64,
}

/// Source of the fibres.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum FibreTable {
    /// Fibres of the mesh, one direction per element.
    FromMesh,
    /// One direction in the whole body.
    Constant {
        /// Direction of the fibres.
        fibre: [f64; 3],
        /// Direction of the sheets.
        sheet: [f64; 3],
    },
    /// Rule of Aróstica et al. 2025 on ellipsoids.
    Ellipsoid {
        /// Axis of revolution of the ellipsoids.
        axis: Axis,
        /// Short half-axis at endocardium and epicardium.
        short_mm: [f64; 2],
        /// Long half-axis at endocardium and epicardium.
        long_mm: [f64; 2],
        /// Fibre angle at endocardium and epicardium.
        alpha_deg: [f64; 2],
        /// Source of the transmural depth.
        depth: DepthTable,
    },
    /// Rule of Bayer et al. 2012 for a left ventricle.
    LaplaceDirichlet {
        /// Surface that encloses the cavity.
        endocardium: String,
        /// Surface of the mesh outside of the wall.
        epicardium: String,
        /// Surface at the base.
        base: String,
        /// Fibre angle at endocardium and epicardium.
        alpha_deg: [f64; 2],
        /// Sheet angle at endocardium and epicardium.
        beta_deg: [f64; 2],
    },
}

/// Source of the transmural depth.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "from", rename_all = "kebab-case", deny_unknown_fields)]
pub enum DepthTable {
    /// Depth of the ellipsoid through the point, with half-axes linear in depth.
    Geometry,
    /// Solution of Laplace's equation between two sets of surfaces.
    Laplace {
        /// Surfaces at depth 0.
        endocardium: Vec<String>,
        /// Surfaces at depth 1.
        epicardium: Vec<String>,
    },
}

/// Springs and dashpots on a surface, per reference area.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SupportTable {
    /// Surface of the mesh.
    pub surface: String,
    /// Direction in which the springs act: `normal` or `all`.
    pub direction: RobinDirection,
    /// Stiffness of the springs per area \[kPa/mm\].
    #[serde(rename = "spring_kPa_per_mm")]
    pub spring_kpa_per_mm: f64,
    /// Damping of the dashpots per area \[kPa·ms/mm\].
    #[serde(default, rename = "dashpot_kPa_ms_per_mm")]
    pub dashpot_kpa_ms_per_mm: f64,
}

/// A surface whose nodes are held at zero displacement.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedTable {
    /// Surface of the mesh.
    pub surface: String,
    /// Components of the displacement that are zero; the others are free.
    pub components: Vec<Axis>,
}

/// A surface under pressure.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PressureTable {
    /// Surface of the mesh.
    pub surface: String,
    /// Course of the pressure over time.
    pub course: TimeCourse,
}

/// A cavity whose volume is computed.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CavityTable {
    /// Name of the cavity, which heads its column.
    pub name: String,
    /// Surfaces that enclose the cavity; openings are closed by flat fans.
    pub surfaces: Vec<String>,
}

/// A point whose displacement is computed.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeTable {
    /// Name of the point, which heads its columns.
    pub name: String,
    /// Position in the reference configuration.
    pub at_mm: [f64; 3],
}

/// Time integration, or equilibrium at one time.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "mode", rename_all = "lowercase", deny_unknown_fields)]
pub enum TimeTable {
    /// Time integration by the generalised-α method, from rest.
    Dynamic {
        /// Length of a time step \[ms\].
        dt_ms: f64,
        /// Time at which the computation ends \[ms\].
        end_ms: f64,
        /// Time between two rows of the table \[ms\].
        output_every_ms: f64,
        /// Weight α_m of the old acceleration.
        alpha_m: f64,
        /// Weight α_f of the old forces.
        alpha_f: f64,
        /// Coefficient of the mass in the Rayleigh damping \[1/ms\].
        #[serde(default)]
        mass_damping_per_ms: f64,
        /// Coefficient of the stiffness in the Rayleigh damping \[ms\].
        #[serde(default)]
        stiffness_damping_ms: f64,
    },
    /// Static equilibrium under the loads of one time.
    Static {
        /// Time at which the loads are taken \[ms\].
        #[serde(default = "one_second")]
        at_ms: f64,
        /// First load step, as a share of the load.
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

/// Tolerances and linear solver.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverTable {
    /// Tolerance of the residual, relative to the size of the loads.
    pub relative_tolerance: f64,
    /// Lower bound of the pressures that enter the size of the loads \[kPa\].
    #[serde(rename = "least_pressure_kPa")]
    pub least_pressure_kpa: f64,
    /// Largest number of Newton iterations in a step.
    pub max_iterations: usize,
    /// Solver of the linear systems in Newton's method.
    pub linear: LinearSolver,
}

impl Default for SolverTable {
    fn default() -> Self {
        Self {
            relative_tolerance: 1e-4,
            least_pressure_kpa: 0.5,
            max_iterations: 15,
            linear: LinearSolver::default(),
        }
    }
}
