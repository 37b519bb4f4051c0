//! Parameters of the organ models as they pass between processes. The equations are in `docs/models.md`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::external::ExternalOrgan;
use crate::finite_element::FiniteElementOrgan;
use crate::task::InputFile;

/// Tanh active stress (Jung et al. 2022, eqs. A1-A3).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TanhParameters {
    /// Peak isometric stress.
    #[serde(rename = "Smax_ref_kPa")]
    pub smax_ref_kpa: f64,
    /// Time constant of the stress rise.
    #[serde(rename = "tau_SR_ref_ms")]
    pub tau_sr_ref_ms: f64,
    /// Time constant of the stress decay.
    #[serde(rename = "tau_SD_ms")]
    pub tau_sd_ms: f64,
    /// Duration of the stress transient.
    #[serde(rename = "t_CR_ms")]
    pub t_cr_ms: f64,
    /// Stretch dependence of the rise.
    pub a4_ms: f64,
    /// Electromechanical delay.
    pub t_emd_ms: f64,
    /// Slope of the stretch dependence.
    pub a6: f64,
    /// Stretch of zero stress.
    pub a7: f64,
}

impl Default for TanhParameters {
    /// Table A1.
    fn default() -> Self {
        Self {
            smax_ref_kpa: 100.0,
            tau_sr_ref_ms: 40.0,
            tau_sd_ms: 110.0,
            t_cr_ms: 550.0,
            a4_ms: 500.0,
            t_emd_ms: 15.0,
            a6: 5.0,
            a7: 0.7,
        }
    }
}

/// Names, with units, of the cell model's parameters in files: Land active (17), Rice calcium (4), passive scale.
pub const CELL_PARAMETERS: [&str; 22] = [
    "k_TRPN_per_ms",
    "n_TRPN",
    "Ca50_ref_uM",
    "k_U_per_ms",
    "n_Tm",
    "TRPN50",
    "k_UW_per_ms",
    "k_WS_per_ms",
    "r_W",
    "r_S",
    "gamma_S_per_ms",
    "gamma_W_per_ms",
    "phi",
    "A_eff",
    "beta_0",
    "beta_1_uM",
    "Smax_ref_kPa",
    "Ca_res_uM",
    "Ca_max_uM",
    "tau_CR_ms",
    "tau_CD_ms",
    "a_p_kPa",
];

/// Those of them that describe Rice's calcium transient.
pub const RICE_PARAMETERS: [&str; 4] = ["Ca_res_uM", "Ca_max_uM", "tau_CR_ms", "tau_CD_ms"];

/// Defaults of [`CELL_PARAMETERS`], in their order and units (Tables A2 and A4; the passive scale is that of the paper's
/// sensitivity analysis, not Table A3's, which is that of isolated tissue).
pub const CELL_DEFAULTS: [f64; 22] = [
    0.1, 2.0, 0.805, 1.0, 5.0, 0.35, 0.182, 0.012, 0.5, 0.25, 0.0085, 0.615, 2.23, 25.0, 2.3, -2.4,
    120.0, 0.15, 0.6, 129.0, 128.0, 42.0,
];

/// Default of a parameter of the cell model.
#[must_use]
pub fn cell_default(name: &str) -> Option<f64> {
    CELL_PARAMETERS
        .iter()
        .position(|known| *known == name)
        .map(|idx| CELL_DEFAULTS[idx])
}

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

/// Forward and backward resistances of the diode valves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ValveParameters {
    /// Aortic valve, forward.
    #[serde(rename = "R_AV_f_mmHg_s_per_mL")]
    pub r_av_f_mmhg_s_per_ml: f64,
    /// Mitral valve, forward.
    #[serde(rename = "R_MV_f_mmHg_s_per_mL")]
    pub r_mv_f_mmhg_s_per_ml: f64,
    /// Both valves, backward.
    #[serde(rename = "R_b_mmHg_s_per_mL")]
    pub r_b_mmhg_s_per_ml: f64,
}

/// Names of the valves' forward resistances.
pub const VALVE_PARAMETERS: [&str; 2] = ["R_AV_f_mmHg_s_per_mL", "R_MV_f_mmHg_s_per_mL"];

/// Whether the organ with a cell has a parameter of this name: one of the cell's or of the valves'.
#[must_use]
pub fn is_parameter(name: &str) -> bool {
    // The passive stress of a 0D cell: the organ has its own.
    name != "a_p_kPa" && (CELL_PARAMETERS.contains(&name) || VALVE_PARAMETERS.contains(&name))
}

impl ValveParameters {
    /// The place of one of [`VALVE_PARAMETERS`]; none for another name.
    pub fn named_mut(&mut self, name: &str) -> Option<&mut f64> {
        match name {
            "R_AV_f_mmHg_s_per_mL" => Some(&mut self.r_av_f_mmhg_s_per_ml),
            "R_MV_f_mmHg_s_per_mL" => Some(&mut self.r_mv_f_mmhg_s_per_ml),
            _ => None,
        }
    }

    /// The same with other values of those that `parameters` names.
    #[must_use]
    pub fn with(mut self, parameters: &BTreeMap<String, f64>) -> Self {
        for (name, value) in parameters {
            if let Some(place) = self.named_mut(name) {
                *place = *value;
            }
        }
        self
    }
}

impl Default for ValveParameters {
    fn default() -> Self {
        Self {
            r_av_f_mmhg_s_per_ml: 0.01,
            r_mv_f_mmhg_s_per_ml: 0.01,
            r_b_mmhg_s_per_ml: 1000.0,
        }
    }
}

/// Three-element Windkessel: P = R1 Q + Pc, C dPc/dt = Q − Pc/R2.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WindkesselParameters {
    /// R1.
    #[serde(rename = "characteristic_resistance_mmHg_s_per_mL")]
    pub characteristic_resistance_mmhg_s_per_ml: f64,
    /// R2.
    #[serde(rename = "peripheral_resistance_mmHg_s_per_mL")]
    pub peripheral_resistance_mmhg_s_per_ml: f64,
    /// C.
    #[serde(rename = "compliance_mL_per_mmHg")]
    pub compliance_ml_per_mmhg: f64,
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

/// What step 1 personalises: the Tanh model and the valves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step1Parameters {
    /// Active stress.
    pub tanh: TanhParameters,
    /// Valves.
    pub valves: ValveParameters,
}

impl Step1Parameters {
    /// The updated six in the order of [`crate::settings::STEP1_PARAMETERS`].
    #[must_use]
    pub fn updated(&self) -> [f64; 6] {
        [
            self.tanh.smax_ref_kpa,
            self.tanh.tau_sr_ref_ms,
            self.tanh.tau_sd_ms,
            self.tanh.t_cr_ms,
            self.valves.r_av_f_mmhg_s_per_ml,
            self.valves.r_mv_f_mmhg_s_per_ml,
        ]
    }

    /// The same parameters with the six replaced.
    #[must_use]
    pub fn with_updated(mut self, values: [f64; 6]) -> Self {
        [
            self.tanh.smax_ref_kpa,
            self.tanh.tau_sr_ref_ms,
            self.tanh.tau_sd_ms,
            self.tanh.t_cr_ms,
            self.valves.r_av_f_mmhg_s_per_ml,
            self.valves.r_mv_f_mmhg_s_per_ml,
        ] = values;
        self
    }
}
