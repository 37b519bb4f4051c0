//! The file `patient.toml`: measured data of a patient. The program never edits it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarkers;
use crate::cohort::SettingsLayer;
use crate::finite_element::MeshFibres;
use crate::organ::WindkesselParameters;

/// A patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatientFile {
    /// Pseudonym; equals the folder's name.
    pub id: String,
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// Measured data.
    pub measured: Measured,
    /// Anatomy.
    #[serde(default)]
    pub anatomy: Anatomy,
    /// Windkessel, where it was determined beforehand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub afterload: Option<WindkesselParameters>,
    /// Filling.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preload: Option<Preload>,
    /// Passive material, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passive: Option<PassiveMaterial>,
    /// Settings for this patient alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<SettingsLayer>,
}

/// Measured data; traces, or biomarkers where traces are absent.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Measured {
    /// File with columns `time_ms,pressure_mmHg`, relative to `patient.toml`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure: Option<String>,
    /// File with columns `time_ms,volume_mL`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<String>,
    /// File with columns `time_ms,Ca_uM` from activation on, for `step2.calcium = "median-trace"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calcium: Option<String>,
    /// End-diastolic pressure.
    #[serde(
        rename = "end_diastolic_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub end_diastolic_pressure_mmhg: Option<f64>,
    /// End-diastolic volume, where there is no volume trace.
    #[serde(
        rename = "end_diastolic_volume_mL",
        skip_serializing_if = "Option::is_none"
    )]
    pub end_diastolic_volume_ml: Option<f64>,
    /// Beats that were averaged into the traces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beats_averaged: Option<u32>,
    /// Biomarkers given directly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub biomarkers: Option<Biomarkers>,
    /// Noise of the traces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// Arm cuff or aortic catheter.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aortic_pressure: Option<AorticPressure>,
    /// Net forward flow per beat in the ascending aorta.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forward_stroke_volume: Option<VolumeWithError>,
    /// Whole-heart image: volume and the time at which it was taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diastasis: Option<Diastasis>,
}

/// Noise of averaged traces.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// rms of the pressure noise.
    #[serde(rename = "pressure_rms_mmHg", skip_serializing_if = "Option::is_none")]
    pub pressure_rms_mmhg: Option<f64>,
    /// Exponential correlation time of the pressure noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_correlation_ms: Option<f64>,
    /// rms of the volume noise per frame.
    #[serde(rename = "volume_rms_mL", skip_serializing_if = "Option::is_none")]
    pub volume_rms_ml: Option<f64>,
    /// Frames from which the volume trace was interpolated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_frames: Option<u32>,
}

/// Aortic pressure, independent of the ventricular catheter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AorticPressure {
    /// Systolic.
    #[serde(rename = "systolic_mmHg")]
    pub systolic_mmhg: f64,
    /// Diastolic.
    #[serde(rename = "diastolic_mmHg")]
    pub diastolic_mmhg: f64,
    /// Standard deviation.
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
    /// Standard deviation.
    #[serde(rename = "sd_mL", default, skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
}

/// The whole-heart image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Diastasis {
    /// Time from the trace's zero.
    pub time_ms: f64,
    /// Cavity volume.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Standard deviation.
    #[serde(rename = "sd_mL", default, skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
}

/// Anatomy.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Anatomy {
    /// Volume of the left ventricular wall.
    #[serde(rename = "wall_volume_mL", skip_serializing_if = "Option::is_none")]
    pub wall_volume_ml: Option<f64>,
    /// The patient's own mesh, for the finite-element ventricle; without one an ellipsoid is generated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PatientMesh>,
    /// Size of the mesh in the paper's Table 1, for runs at the paper's size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paper_mesh: Option<MeshSize>,
}

/// The patient's own mesh, as it was imaged: at diastasis where `measured.diastasis` says so, else at end-diastole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatientMesh {
    /// Stem of CARP files (`heart` for `heart.pts`, `heart.elem`, `heart.lon`, `heart.NAME.surf`), or a `.vtu`, `.msh` or `.mesh` file;
    /// relative to `patient.toml`. Surfaces `endocardium`, `epicardium`, `rim` and `septum` are taken where the mesh has them,
    /// else found.
    pub file: String,
    /// Unit of its coordinates: um, mm, cm or m.
    pub unit: String,
    /// Tags of contracting tissue; all other tissue is passive.
    pub left_ventricle: Vec<i32>,
    /// Where its fibres come from.
    #[serde(default)]
    pub fibres: MeshFibres,
    /// File of activation times, one number a node in the mesh's order; relative to `patient.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activation_times_ms: Option<String>,
    /// Where activation begins, without such a file: points near the endocardium.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub activation_sites_mm: Vec<[f64; 3]>,
    /// The passive right ventricle of a mesh of both, with its pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right_ventricle: Option<PatientRightVentricle>,
}

/// The right ventricle of the patient's own mesh: passive tissue, as all without a tag of `left_ventricle`, around a cavity whose pressure is given. One of
/// `pressure_mmHg` and `pressure`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatientRightVentricle {
    /// Surface of its endocardium, the right side of the septum included; closed, or open at the rim.
    pub surface: String,
    /// Pressure in its cavity, the same at all times.
    #[serde(
        rename = "pressure_mmHg",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub pressure_mmhg: Option<f64>,
    /// Trace of that pressure over one cycle, columns `time_ms` and `pressure_mmHg`; relative to `patient.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pressure: Option<String>,
}

/// Size of a tetrahedral mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshSize {
    /// Nodes.
    pub nodes: u64,
    /// Tetrahedra.
    pub elements: u64,
}

/// Filling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Preload {
    /// Constant filling pressure of the base model.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
}

/// Passive material, where known beforehand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PassiveMaterial {
    /// Guccione's C; the finite-element ventricle takes it as it is.
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
