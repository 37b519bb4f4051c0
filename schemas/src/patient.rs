//! The file `patient.toml`: measured data of a patient. The program never edits it.

pub use cardiotwin_vocabulary::trace_noise::Noise;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarkers;
use crate::cohort::SettingsLayer;
use crate::finite_element::MeshFibres;
use crate::further::{FurtherTraces, LoadedBeat, QrsWidth, ValveTimes};
use crate::organ::WindkesselParameters;

/// A patient: measurements, anatomy and loads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatientFile {
    /// Pseudonym, which equals the name of the folder.
    pub id: String,
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// Measured traces and values.
    pub measured: Measured,
    /// Size and mesh of the wall.
    #[serde(default)]
    pub anatomy: Anatomy,
    /// Windkessel parameters, if they were determined beforehand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub afterload: Option<WindkesselParameters>,
    /// Pressure of the left atrium, which fills the ventricle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preload: Option<Preload>,
    /// Passive material, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passive: Option<PassiveMaterial>,
    /// Settings of this patient alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<SettingsLayer>,
}

/// Measured data: traces, or biomarkers if there are no traces.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Measured {
    /// File with the columns `time_ms,pressure_mmHg`, relative to `patient.toml`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure: Option<String>,
    /// File with the columns `time_ms,volume_mL`, relative to `patient.toml`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<String>,
    /// File with the columns `time_ms,Ca_uM`, from activation on, for `step2.calcium =
    /// "median-trace"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calcium: Option<String>,
    /// End-diastolic pressure.
    #[serde(
        rename = "end_diastolic_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub end_diastolic_pressure_mmhg: Option<f64>,
    /// End-diastolic volume, if there is no volume trace.
    #[serde(
        rename = "end_diastolic_volume_mL",
        skip_serializing_if = "Option::is_none"
    )]
    pub end_diastolic_volume_ml: Option<f64>,
    /// Rules of consistency that these data may break, by name (docs/prepare.md lists them).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub accept: Vec<String>,
    /// Number of beats that were averaged into the traces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beats_averaged: Option<u32>,
    /// Biomarkers that are given directly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub biomarkers: Option<Biomarkers>,
    /// Noise of the traces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// Aortic pressure by arm cuff or aortic catheter.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aortic_pressure: Option<AorticPressure>,
    /// Net forward flow per beat in the ascending aorta.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forward_stroke_volume: Option<VolumeWithError>,
    /// Volume in the whole-heart image and the time at which the image was taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diastasis: Option<Diastasis>,
    /// Further traces of the same beat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub traces: Option<FurtherTraces>,
    /// Times of the valves by heart sounds or echo.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valve_times: Option<ValveTimes>,
    /// Width of QRS in the electrocardiogram.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub qrs: Option<QrsWidth>,
    /// Steady beats of the same heart under changed load, as during an occlusion of the caval veins.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub loaded: Vec<LoadedBeat>,
}

/// Aortic pressure that was measured independently of the ventricular catheter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AorticPressure {
    /// Systolic pressure.
    #[serde(rename = "systolic_mmHg")]
    pub systolic_mmhg: f64,
    /// Diastolic pressure.
    #[serde(rename = "diastolic_mmHg")]
    pub diastolic_mmhg: f64,
    /// Standard deviation of the pressures.
    #[serde(rename = "sd_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub sd_mmhg: Option<f64>,
}

/// A volume with its standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VolumeWithError {
    /// Volume.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Standard deviation of the volume.
    #[serde(rename = "sd_mL", default, skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
}

/// Cavity volume in the whole-heart image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Diastasis {
    /// Time from the zero of the traces.
    pub time_ms: f64,
    /// Volume of the ventricle's cavity.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Standard deviation of the volume.
    #[serde(rename = "sd_mL", default, skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
}

/// Size and mesh of the wall.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Anatomy {
    /// Volume of the left ventricular wall.
    #[serde(rename = "wall_volume_mL", skip_serializing_if = "Option::is_none")]
    pub wall_volume_ml: Option<f64>,
    /// Patient's own mesh for the finite-element ventricle. Without it an ellipsoid is generated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PatientMesh>,
    /// Size of the mesh in Table 1 of the paper, for runs at that size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paper_mesh: Option<MeshSize>,
}

/// Patient's own mesh as imaged: at diastasis if `measured.diastasis` is given, otherwise at
/// end-diastole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatientMesh {
    /// Stem of CARP files (`heart` for `heart.pts`, `heart.elem`, `heart.lon`, `heart.NAME.surf`),
    /// or a `.vtu`, `.msh` or `.mesh` file; relative to `patient.toml`. Surfaces `endocardium`,
    /// `epicardium`, `rim` and `septum` are used if the mesh has them and determined from the
    /// geometry otherwise.
    pub file: String,
    /// Unit of the coordinates: um, mm, cm or m.
    pub unit: String,
    /// Tags of contracting tissue; all other tissue is passive.
    pub left_ventricle: Vec<i32>,
    /// Source of the fibres.
    #[serde(default)]
    pub fibres: MeshFibres,
    /// File of activation times, one number per node in the order of the mesh; relative to
    /// `patient.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activation_times_ms: Option<String>,
    /// Points near the endocardium where activation begins if there is no file of activation times.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub activation_sites_mm: Vec<[f64; 3]>,
    /// Passive right ventricle with its pressure, if the mesh contains both ventricles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right_ventricle: Option<PatientRightVentricle>,
}

/// Right ventricle of the patient's own mesh: passive tissue, like all tissue without a tag in
/// `left_ventricle`, around a cavity with a given pressure. Exactly one of `pressure_mmHg` and
/// `pressure` must be given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatientRightVentricle {
    /// Surface of the right ventricular endocardium, including the right side of the septum;
    /// closed, or open at the rim.
    pub surface: String,
    /// Constant pressure in the cavity.
    #[serde(
        rename = "pressure_mmHg",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub pressure_mmhg: Option<f64>,
    /// File with a trace of the cavity's pressure over one cycle, columns `time_ms` and
    /// `pressure_mmHg`; relative to `patient.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pressure: Option<String>,
}

/// Size of a tetrahedral mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshSize {
    /// Number of nodes.
    pub nodes: u64,
    /// Number of tetrahedra.
    pub elements: u64,
}

/// Pressure of the left atrium, which fills the ventricle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Preload {
    /// Constant filling pressure of the base model.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
}

/// Passive material, if it is known beforehand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PassiveMaterial {
    /// Guccione's C, which the finite-element ventricle uses unchanged.
    #[serde(
        rename = "guccione_C_kPa",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub guccione_c_kpa: Option<f64>,
    /// Exponent b of the one-fibre passive law.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<f64>,
}
