//! Parameters of the organ models as they pass between processes. The equations are in `docs/models.md`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::external::ExternalOrgan;
use crate::finite_element::FiniteElementOrgan;
use crate::task::InputFile;

pub use cardiotwin_vocabulary::cell::{
    CELL_DEFAULTS, CELL_PARAMETERS, RICE_PARAMETERS, cell_default,
};
pub use cardiotwin_vocabulary::circulation::WindkesselParameters;
pub use cardiotwin_vocabulary::step1::{
    Step1Parameters, TanhParameters, VALVE_PARAMETERS, ValveParameters,
};

/// What produces the active stress. Land's and Rice's parameters go by the names in [`CELL_PARAMETERS`]
/// (Tables A2, A4); names that are absent keep their default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "model", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ContractionSpec {
    /// Phenomenological, step 1.
    Tanh {
        /// Its parameters.
        parameters: TanhParameters,
    },
    /// Land 2017 driven by Rice's calcium transient, verification.
    Land2017Rice {
        /// Parameters that differ from the defaults, by the paper's names.
        parameters: BTreeMap<String, f64>,
        /// Stretch at which the cell's periodic beat begins.
        #[serde(default = "one")]
        lambda_0: f64,
    },
    /// Land 2017 driven by a given calcium transient, verification.
    Land2017Trace {
        /// Parameters that differ from the defaults, by the paper's names.
        parameters: BTreeMap<String, f64>,
        /// Stretch at which the cell's periodic beat begins.
        #[serde(default = "one")]
        lambda_0: f64,
        /// Calcium from activation on, columns `time_ms` and `Ca_uM`.
        calcium: InputFile,
    },
}

impl ContractionSpec {
    /// The cell's parameters that differ from their defaults; none for the Tanh model, which has no cell.
    #[must_use]
    pub fn cell_parameters(&self) -> Option<&BTreeMap<String, f64>> {
        match self {
            Self::Tanh { .. } => None,
            Self::Land2017Rice { parameters, .. } | Self::Land2017Trace { parameters, .. } => {
                Some(parameters)
            }
        }
    }
}

const fn one() -> f64 {
    1.0
}

/// The length from which a cell's stretch is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StretchOrigin {
    /// Its own slack length, which follows from the unloaded wall.
    Unloaded,
    /// Its length at end-diastole, where the stretch is one (the paper's).
    EndDiastole,
}

/// The stretch that a cell in the organ knows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CellStretch {
    /// Where it is counted from.
    pub origin: StretchOrigin,
    /// Slack length over the length in the unloaded wall; of no effect from end-diastole.
    pub slack_stretch: f64,
}

impl Default for CellStretch {
    fn default() -> Self {
        Self {
            origin: StretchOrigin::EndDiastole,
            slack_stretch: 1.0,
        }
    }
}

/// Whether the organ with a cell has a parameter of this name: one of the cell's or of the valves'.
#[must_use]
pub fn is_parameter(name: &str) -> bool {
    // The passive stress of a 0D cell: the organ has its own.
    name != "a_p_kPa" && (CELL_PARAMETERS.contains(&name) || VALVE_PARAMETERS.contains(&name))
}

/// An effect beyond the base model, by its catalogue name, with its parameters (keys carry units).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EffectSpec {
    /// Catalogue name, for example `atrial_kick`.
    pub name: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, f64>,
}

/// What the cavity is coupled to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CirculationSpec {
    /// The arterial load.
    pub afterload: WindkesselParameters,
    /// Windkessel pressure Pc at the beat's start.
    #[serde(rename = "initial_windkessel_pressure_mmHg")]
    pub initial_windkessel_pressure_mmhg: f64,
    /// Constant filling pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Accepted effects, in the order in which they were accepted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
}

/// The passive one-fibre ventricle after step 0 (Arts 1991; SPEC section 4).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OneFibrePassive {
    /// Volume of the wall.
    #[serde(rename = "wall_volume_mL")]
    pub wall_volume_ml: f64,
    /// Volume at zero pressure.
    #[serde(rename = "unloaded_volume_mL")]
    pub unloaded_volume_ml: f64,
    /// Volume at end-diastole, where the beat starts and the active stretch is 1.
    #[serde(rename = "end_diastolic_volume_mL")]
    pub end_diastolic_volume_ml: f64,
    /// Pressure at end-diastole.
    #[serde(rename = "end_diastolic_pressure_mmHg")]
    pub end_diastolic_pressure_mmhg: f64,
    /// Scale s of σ_p = s (e^{bE} − 1).
    #[serde(rename = "stiffness_kPa")]
    pub stiffness_kpa: f64,
    /// Exponent b.
    pub exponent: f64,
}

/// How the wall is activated: a fixed distribution of `groups` equal parts over `spread_ms`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ActivationSpec {
    /// First activation to last.
    pub spread_ms: f64,
    /// Number of parts, each with its own time.
    pub groups: u32,
    /// First activation after the beat's start, before it where negative.
    pub onset_ms: f64,
}

/// The organ that is simulated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "fidelity", rename_all = "kebab-case", deny_unknown_fields)]
pub enum OrganSpec {
    /// The reduced one-fibre ventricle.
    Reduced {
        /// Its passive state.
        passive: OneFibrePassive,
        /// Its activation.
        activation: ActivationSpec,
    },
    /// The 3D finite-element ventricle.
    FiniteElement(Box<FiniteElementOrgan>),
    /// Whatever another solver simulates.
    External(Box<ExternalOrgan>),
}

/// How many beats are simulated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "mode", rename_all = "kebab-case", deny_unknown_fields)]
pub enum BeatCount {
    /// Exactly `n`, the last one reported; one beat is never taken as periodic.
    Fixed {
        /// Number of beats.
        n: u32,
    },
    /// Until the beat's start and end agree, at most `max`.
    Periodic {
        /// Largest number of beats.
        max: u32,
        /// Largest change of pressure (mmHg) and volume (mL) over a beat.
        tolerance: f64,
    },
}
