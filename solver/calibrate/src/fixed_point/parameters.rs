//! The parameters that the fixed point updates, each paired with the biomarker that drives it.

use super::Biomarker;
use serde::{Deserialize, Serialize};

/// One parameter of step 1, by the key that files use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Parameter {
    /// Largest active stress of Tanh, kPa.
    #[serde(rename = "Smax_ref_kPa")]
    SmaxRef,
    /// Rise time constant of Tanh, ms.
    #[serde(rename = "tau_SR_ref_ms")]
    TauSrRef,
    /// Decay time constant of Tanh, ms.
    #[serde(rename = "tau_SD_ms")]
    TauSd,
    /// Duration of Tanh's contraction, ms.
    #[serde(rename = "t_CR_ms")]
    TCr,
    /// Forward resistance of the aortic valve, mmHg·s/mL.
    #[serde(rename = "R_AV_f_mmHg_s_per_mL")]
    RAvF,
    /// Forward resistance of the mitral valve, mmHg·s/mL.
    #[serde(rename = "R_MV_f_mmHg_s_per_mL")]
    RMvF,
}

/// All parameters in the order of eqs. 13 and 15.
pub const PARAMETERS: [Parameter; 6] = [
    Parameter::SmaxRef,
    Parameter::TauSrRef,
    Parameter::TauSd,
    Parameter::TCr,
    Parameter::RAvF,
    Parameter::RMvF,
];

impl Parameter {
    /// Key with its unit, as in files.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::SmaxRef => "Smax_ref_kPa",
            Self::TauSrRef => "tau_SR_ref_ms",
            Self::TauSd => "tau_SD_ms",
            Self::TCr => "t_CR_ms",
            Self::RAvF => "R_AV_f_mmHg_s_per_mL",
            Self::RMvF => "R_MV_f_mmHg_s_per_mL",
        }
    }

    /// The biomarker whose ratio drives the update (eqs. 13, 15), and the exponent of clinical/simulated.
    #[must_use]
    pub fn driver(self) -> (Biomarker, f64) {
        match self {
            Self::SmaxRef => (Biomarker::PMax, 1.0),
            Self::TauSrRef => (Biomarker::DpdtMax, -1.0),
            Self::TauSd => (Biomarker::DpdtMin, -1.0),
            Self::TCr => (Biomarker::Ptd90, 1.0),
            Self::RAvF => (Biomarker::TauVd, 1.0),
            Self::RMvF => (Biomarker::TauVr, 1.0),
        }
    }
}

impl std::fmt::Display for Parameter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.key())
    }
}

/// A value for each parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// Largest active stress of Tanh.
    #[serde(rename = "Smax_ref_kPa")]
    pub smax_ref_kpa: f64,
    /// Rise time constant of Tanh.
    #[serde(rename = "tau_SR_ref_ms")]
    pub tau_sr_ref_ms: f64,
    /// Decay time constant of Tanh.
    #[serde(rename = "tau_SD_ms")]
    pub tau_sd_ms: f64,
    /// Duration of Tanh's contraction.
    #[serde(rename = "t_CR_ms")]
    pub t_cr_ms: f64,
    /// Forward resistance of the aortic valve.
    #[serde(rename = "R_AV_f_mmHg_s_per_mL")]
    pub r_av_f_mmhg_s_per_ml: f64,
    /// Forward resistance of the mitral valve.
    #[serde(rename = "R_MV_f_mmHg_s_per_mL")]
    pub r_mv_f_mmhg_s_per_ml: f64,
}

impl Default for Parameters {
    /// Initial guesses of Table A1, and 0.01 mmHg·s/mL for both valves (section 2.3.1).
    fn default() -> Self {
        Self {
            smax_ref_kpa: 100.0,
            tau_sr_ref_ms: 40.0,
            tau_sd_ms: 110.0,
            t_cr_ms: 550.0,
            r_av_f_mmhg_s_per_ml: 0.01,
            r_mv_f_mmhg_s_per_ml: 0.01,
        }
    }
}

impl Parameters {
    /// The value of one parameter, in the unit of its key.
    #[must_use]
    pub fn get(&self, parameter: Parameter) -> f64 {
        match parameter {
            Parameter::SmaxRef => self.smax_ref_kpa,
            Parameter::TauSrRef => self.tau_sr_ref_ms,
            Parameter::TauSd => self.tau_sd_ms,
            Parameter::TCr => self.t_cr_ms,
            Parameter::RAvF => self.r_av_f_mmhg_s_per_ml,
            Parameter::RMvF => self.r_mv_f_mmhg_s_per_ml,
        }
    }

    /// Sets one parameter, in the unit of its key.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        match parameter {
            Parameter::SmaxRef => self.smax_ref_kpa = value,
            Parameter::TauSrRef => self.tau_sr_ref_ms = value,
            Parameter::TauSd => self.tau_sd_ms = value,
            Parameter::TCr => self.t_cr_ms = value,
            Parameter::RAvF => self.r_av_f_mmhg_s_per_ml = value,
            Parameter::RMvF => self.r_mv_f_mmhg_s_per_ml = value,
        }
    }

    /// Whether both would be the same simulation: every value equal to nine digits.
    #[must_use]
    pub fn same_as(&self, other: &Self) -> bool {
        self.close_to(other, 1e-9)
    }

    /// Whether every value is equal up to this share of it.
    #[must_use]
    pub fn close_to(&self, other: &Self, share: f64) -> bool {
        PARAMETERS
            .into_iter()
            .all(|p| (self.get(p) - other.get(p)).abs() <= share * self.get(p).abs())
    }
}

/// Interval that a parameter may take, both ends included, in the unit of the parameter's key.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

impl Bounds {
    /// Wide defaults of ours (the paper bounds none of step 1): what a simulation can make sense of at all.
    #[must_use]
    pub fn default_of(parameter: Parameter) -> Self {
        let (lower, upper) = match parameter {
            Parameter::SmaxRef => (1.0, 1000.0),
            Parameter::TauSrRef => (0.5, 1000.0),
            Parameter::TauSd => (1.0, 1000.0),
            Parameter::TCr => (50.0, 2000.0),
            Parameter::RAvF | Parameter::RMvF => (1e-4, 1.0),
        };
        Self { lower, upper }
    }

    /// Whether a value lies inside, ends included up to rounding.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        value >= self.lower * (1.0 - 1e-12) && value <= self.upper * (1.0 + 1e-12)
    }

    /// Whether a value sits on one of the ends, up to rounding.
    #[must_use]
    pub fn at_end(&self, value: f64) -> bool {
        value <= self.lower * (1.0 + 1e-9) || value >= self.upper * (1.0 - 1e-9)
    }
}
