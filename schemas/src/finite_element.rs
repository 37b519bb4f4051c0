//! The finite-element ventricle as it passes between processes: settings, what step 0 is asked for, what it made.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::muscle::{ActiveConvention, HolzapfelOgdenSettings, MuscleLaw, PassiveTissues};
use crate::organ::EffectSpec;
use crate::task::InputFile;

/// Effects of a patient's model that change the passive law: step 0 has to know them, since it fits the law's scale.
pub const EFFECTS_OF_THE_PASSIVE_LAW: [&str; 1] = ["passive_stiffening"];

/// Elements of the wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ElementKind {
    /// Linear tetrahedra whose change of volume is resisted by nodal averages.
    #[default]
    LinearNodal,
    /// Linear tetrahedra with a plain penalty (P1/P0): the paper's, which locks.
    LinearPointwise,
    /// Quadratic tetrahedra with nodal averages.
    QuadraticNodal,
}

/// How the linear systems of a time step are solved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LinearSolver {
    /// Conjugate gradients, block Jacobi.
    #[default]
    BlockJacobi,
    /// Conjugate gradients, symmetric block Gauss-Seidel.
    SymmetricSweep,
    /// Conjugate gradients, preconditioned by a factorisation that is kept.
    Direct,
}

/// What is computed of electrophysiology.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Electrophysiology {
    /// Activation times.
    #[default]
    Eikonal,
    /// Transmembrane potentials too, after the verification beat: nothing waits for them.
    ReactionEikonal,
}

/// Material, supports and damping of the wall. Those without a source are assumptions (docs/models.md).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WallSettings {
    /// Passive law of muscle.
    pub muscle_law: MuscleLaw,
    /// Guccione's C with which the search for the patient's begins.
    #[serde(rename = "guccione_C_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub guccione_c_kpa: f64,
    /// Exponent along the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_f: f64,
    /// Exponent across it.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_t: f64,
    /// Exponent of fibre shear.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_fs: f64,
    /// Constants of Holzapfel and Ogden's law; the search for the patient's moduli begins with them.
    pub holzapfel_ogden: HolzapfelOgdenSettings,
    /// Shear modulus of a neo-Hookean muscle with which the search for the patient's begins.
    #[serde(rename = "neo_hookean_mu_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub neo_hookean_mu_kpa: f64,
    /// Bulk modulus of muscle.
    #[serde(rename = "kappa_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e8))]
    pub kappa_kpa: f64,
    /// Share of it that resists each element's own change of volume, where the rest resists nodal averages; absent: a hundredth in
    /// linear elements, none in quadratic ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub pointwise_share: Option<f64>,
    /// How active stress acts along the fibre.
    pub active_convention: ActiveConvention,
    /// Share of the active stress that acts along the sheet, too; shares of effects come on top.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub cross_fibre_share: f64,
    /// How long contraction lasts at the epicardium over how long at the endocardium; linear in the depth between.
    #[schemars(extend("minimum" = 0.5, "maximum" = 2.0))]
    pub epicardial_duration_share: f64,
    /// Share of the active stress that acts along the normal of the sheet, across the fibre in the plane of the wall where
    /// sheets are transmural.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub sheet_normal_share: f64,
    /// Shear modulus of the aortic root, and of all passive tissue that has no entry in `passive`.
    #[serde(rename = "aorta_mu_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub aorta_mu_kpa: f64,
    /// Bulk modulus of the aortic root.
    #[serde(rename = "aorta_kappa_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e8))]
    pub aorta_kappa_kpa: f64,
    /// Passive tissue of its own by the mesh's tags.
    #[serde(
        skip_serializing_if = "PassiveTissues::is_empty",
        deserialize_with = "crate::muscle::by_tag"
    )]
    pub passive: PassiveTissues,
    /// Density.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1.0))]
    pub density_g_per_mm3: f64,
    /// Rayleigh damping by mass.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub mass_damping_per_ms: f64,
    /// Rayleigh damping by stiffness.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub stiffness_damping_ms: f64,
    /// Pericardium: springs along the normal of epicardium and septum, at the apex.
    #[serde(rename = "epicardial_spring_kPa_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub epicardial_spring_kpa_per_mm: f64,
    /// Pericardium: dashpots beside these springs.
    #[serde(rename = "epicardial_dashpot_kPa_ms_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub epicardial_dashpot_kpa_ms_per_mm: f64,
    /// Stiffness and damping of the pericardium at the base over those at the apex; linear in the height between.
    #[schemars(extend("minimum" = 0.0, "maximum" = 100.0))]
    pub epicardial_base_share: f64,
    /// Springs in all directions on the rim.
    #[serde(rename = "rim_spring_kPa_per_mm")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub rim_spring_kpa_per_mm: f64,
    /// Dashpots beside these springs.
    #[serde(rename = "rim_dashpot_kPa_ms_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub rim_dashpot_kpa_ms_per_mm: f64,
    /// Springs and dashpots of further surfaces of the patient's own mesh, by their names.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub surface: BTreeMap<String, SurfaceSpring>,
    /// Spectral radius of generalised-α: 0 damps the highest frequencies at once.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1.0))]
    pub spectral_radius: f64,
}

/// Springs and dashpots along the normal of a surface, at rest in end-diastole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceSpring {
    /// Stiffness along the normal.
    #[serde(rename = "spring_kPa_per_mm")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub spring_kpa_per_mm: f64,
    /// Dashpots beside them.
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
            holzapfel_ogden: HolzapfelOgdenSettings::default(),
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

/// Angles of the Laplace-Dirichlet fibre rule (Bayer et al. 2012).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FibreSettings {
    /// Fibre angle at the endocardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub alpha_endo_deg: f64,
    /// Fibre angle at the epicardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub alpha_epi_deg: f64,
    /// Sheet angle at the endocardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub beta_endo_deg: f64,
    /// Sheet angle at the epicardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub beta_epi_deg: f64,
}

impl Default for FibreSettings {
    fn default() -> Self {
        Self {
            alpha_endo_deg: 60.0,
            alpha_epi_deg: -60.0,
            beta_endo_deg: -65.0,
            beta_epi_deg: 25.0,
        }
    }
}

/// Speeds of the eikonal activation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ConductionSettings {
    /// Along the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub along_m_per_s: f64,
    /// Across it.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub across_m_per_s: f64,
    /// Of the fast endocardial layer; 0 for none.
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

/// What keeps Newton's method on its way: `[solver.finite_element.newton]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NewtonSettings {
    /// An iteration's step is halved so often at most; then the time step fails, and is halved itself.
    #[schemars(range(min = 0, max = 30))]
    pub halvings: u32,
    /// It is halved when an element's volume would shrink below this share.
    #[schemars(extend("minimum" = 0.0, "maximum" = 0.9))]
    pub smallest_volume_ratio: f64,
    /// Farthest that an iteration moves a node; 0: as far as it likes.
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

/// The finite-element ventricle: `[solver.finite_element]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FiniteElementSettings {
    /// About how many nodes the generated mesh has.
    #[schemars(range(min = 500, max = 2_000_000))]
    pub mesh_nodes: u32,
    /// Which elements.
    pub element: ElementKind,
    /// Residual of a time step over the scale of its forces at which it has converged.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 0.1))]
    pub tolerance: f64,
    /// Newton iterations after which a step fails.
    #[schemars(range(min = 1, max = 1000))]
    pub newton_iterations: u32,
    /// What keeps Newton's method on its way.
    pub newton: NewtonSettings,
    /// How linear systems are solved.
    pub linear_solver: LinearSolver,
    /// Longest time step of late filling: after ejection, with the mitral valve open, while pressure changes by less than 0.1 mmHg
    /// a millisecond. 0: as any other.
    #[serde(skip_serializing_if = "crate::task::is_zero")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 20.0))]
    pub diastolic_step_ms: f64,
    /// The wall.
    pub wall: WallSettings,
    /// Fibres.
    pub fibres: FibreSettings,
    /// Activation.
    pub conduction: ConductionSettings,
    /// Whether transmembrane potentials are wanted.
    #[serde(skip_serializing_if = "is_eikonal")]
    pub ep: Electrophysiology,
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
            wall: WallSettings::default(),
            fibres: FibreSettings::default(),
            conduction: ConductionSettings::default(),
            ep: Electrophysiology::default(),
        }
    }
}

impl FiniteElementSettings {
    /// What step 0 needs of them, with those of the patient's effects that change the passive law.
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
            effects: effects.iter().filter(of_the_law).cloned().collect(),
        }
    }

    /// What a beat needs of them.
    #[must_use]
    pub fn equations(&self) -> EquationSettings {
        let Self {
            tolerance,
            newton,
            linear_solver,
            diastolic_step_ms,
            ..
        } = *self;
        EquationSettings {
            tolerance,
            newton,
            linear_solver,
            diastolic_step_ms,
            potentials: None,
        }
    }
}

/// What step 0 makes of a finite-element ventricle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AnatomySpec {
    /// About how many nodes.
    pub mesh_nodes: u32,
    /// Which elements.
    pub element: ElementKind,
    /// The wall.
    pub wall: WallSettings,
    /// Fibres.
    pub fibres: FibreSettings,
    /// Activation.
    pub conduction: ConductionSettings,
    /// Effects of the patient's model that change the passive law: [`EFFECTS_OF_THE_PASSIVE_LAW`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
}

/// Where the fibres of a patient's own mesh come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MeshFibres {
    /// The mesh's own, where it has some, else the rule.
    #[default]
    Auto,
    /// The mesh's own.
    Mesh,
    /// The rule of `solver.finite_element.fibres`.
    Rule,
}

/// A patient's own mesh, by its files' contents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OwnMesh {
    /// The mesh's files; the first one's ending says of which format: `.pts`, `.vtu`, `.msh` or `.mesh`.
    pub files: Vec<InputFile>,
    /// Unit of its coordinates: um, mm, cm or m.
    pub unit: String,
    /// Tags of contracting tissue; all other tissue is passive.
    pub left_ventricle: Vec<i32>,
    /// Where its fibres come from.
    pub fibres: MeshFibres,
    /// File of activation times, one number a node.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activation_times: Option<InputFile>,
    /// Where activation begins, without such a file.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub activation_sites_mm: Vec<[f64; 3]>,
    /// Its right ventricle, where that has a pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right_ventricle: Option<OwnRightVentricle>,
}

/// The passive right ventricle of a patient's own mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OwnRightVentricle {
    /// Surface of its endocardium.
    pub surface: String,
    /// Pressure in its cavity.
    pub pressure: RightPressureSpec,
}

/// Pressure in the right ventricle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(deny_unknown_fields)]
pub enum RightPressureSpec {
    /// The same at all times.
    Constant {
        /// Pressure at all times.
        #[serde(rename = "pressure_mmHg")]
        pressure_mmhg: f64,
    },
    /// A trace over one cycle.
    Trace {
        /// Columns `time_ms` and `pressure_mmHg`.
        file: InputFile,
    },
}

/// How the equations of a beat are solved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct EquationSettings {
    /// Residual of a time step over the scale of its forces.
    pub tolerance: f64,
    /// What keeps Newton's method on its way.
    #[serde(default, skip_serializing_if = "NewtonSettings::are_default")]
    pub newton: NewtonSettings,
    /// How linear systems are solved.
    pub linear_solver: LinearSolver,
    /// Longest time step of late filling \[ms\]; 0: as any other.
    #[serde(default, skip_serializing_if = "crate::task::is_zero")]
    pub diastolic_step_ms: f64,
    /// Speeds of the wave whose transmembrane potentials are wanted after the beat; absent: none are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub potentials: Option<ConductionSettings>,
}

/// A finite-element ventricle that step 0 made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FiniteElementOrgan {
    /// Mesh, fibres, activation, unloaded geometry and end-diastolic state (artefact `ventricle` of step 0).
    pub ventricle: InputFile,
    /// What is in it.
    pub figures: VentricleFigures,
}

/// Figures of a finite-element ventricle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct VentricleFigures {
    /// Nodes of the mesh.
    pub nodes: u64,
    /// Tetrahedra.
    pub elements: u64,
    /// Displacements that are solved for.
    pub degrees_of_freedom: u64,
    /// Mean length of an edge in the image.
    pub mean_edge_mm: f64,
    /// Volume of the contracting wall.
    #[serde(rename = "wall_volume_mL")]
    pub wall_volume_ml: f64,
    /// Cavity volume of the image that the mesh was made for.
    #[serde(rename = "image_volume_mL")]
    pub image_volume_ml: f64,
    /// Pressure that the image is in equilibrium with.
    #[serde(rename = "image_pressure_mmHg")]
    pub image_pressure_mmhg: f64,
    /// Cavity volume without pressure.
    #[serde(rename = "unloaded_volume_mL")]
    pub unloaded_volume_ml: f64,
    /// Cavity volume at end-diastole, where the beat starts and the active stretch is 1.
    #[serde(rename = "end_diastolic_volume_mL")]
    pub end_diastolic_volume_ml: f64,
    /// Pressure at end-diastole.
    #[serde(rename = "end_diastolic_pressure_mmHg")]
    pub end_diastolic_pressure_mmhg: f64,
    /// Stiffness of the muscle's law, fitted or given: Guccione's C, Holzapfel and Ogden's a, the neo-Hookean µ.
    #[serde(rename = "stiffness_kPa")]
    pub stiffness_kpa: f64,
    /// Factor of all exponents of the law; 1 for one without.
    pub exponent_factor: f64,
    /// First activation after the beat's start.
    pub onset_ms: f64,
    /// First activation of muscle to last.
    pub spread_ms: f64,
}
