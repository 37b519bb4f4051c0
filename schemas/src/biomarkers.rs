//! Pressure, volume, stress and calcium biomarkers as they pass between processes (SPEC: Jung et al. 2022, Appendix C).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Biomarkers of one beat of the left ventricle. Absent where the trace is absent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Biomarkers {
    /// Peak pressure.
    #[serde(rename = "P_max_mmHg", skip_serializing_if = "Option::is_none")]
    pub p_max_mmhg: Option<f64>,
    /// Largest pressure rate before the peak.
    #[serde(
        rename = "dPdt_max_mmHg_per_ms",
        skip_serializing_if = "Option::is_none"
    )]
    pub dpdt_max_mmhg_per_ms: Option<f64>,
    /// Smallest (negative) pressure rate after the peak.
    #[serde(
        rename = "dPdt_min_mmHg_per_ms",
        skip_serializing_if = "Option::is_none"
    )]
    pub dpdt_min_mmhg_per_ms: Option<f64>,
    /// Pressure transient duration at 90 % decay, t3 − t1.
    #[serde(rename = "PTD90_ms", skip_serializing_if = "Option::is_none")]
    pub ptd90_ms: Option<f64>,
    /// Stroke volume.
    #[serde(rename = "SV_mL", skip_serializing_if = "Option::is_none")]
    pub sv_ml: Option<f64>,
    /// Time constant of ejection.
    #[serde(rename = "tau_VD_ms", skip_serializing_if = "Option::is_none")]
    pub tau_vd_ms: Option<f64>,
    /// Time constant of rapid filling.
    #[serde(rename = "tau_VR_ms", skip_serializing_if = "Option::is_none")]
    pub tau_vr_ms: Option<f64>,
    /// Volume at the beat's start.
    #[serde(rename = "EDV_mL", skip_serializing_if = "Option::is_none")]
    pub edv_ml: Option<f64>,
    /// Smallest volume.
    #[serde(rename = "ESV_mL", skip_serializing_if = "Option::is_none")]
    pub esv_ml: Option<f64>,
    /// Pressure at the beat's start.
    #[serde(rename = "EDP_mmHg", skip_serializing_if = "Option::is_none")]
    pub edp_mmhg: Option<f64>,
    /// Measured EDV minus simulated volume at the beat's end.
    #[serde(rename = "end_of_beat_gap_mL", skip_serializing_if = "Option::is_none")]
    pub end_of_beat_gap_ml: Option<f64>,
}

/// Keys of the biomarkers that step 1 fits, and that a robustness sweep of kind `data` perturbs: the terms of step 1's
/// cost (SPEC section 5).
pub const STEP1_BIOMARKERS: [&str; 6] = [
    "P_max_mmHg",
    "dPdt_max_mmHg_per_ms",
    "dPdt_min_mmHg_per_ms",
    "PTD90_ms",
    "tau_VD_ms",
    "tau_VR_ms",
];

impl Biomarkers {
    /// Keys and values of the biomarkers that steps 1 and 3 look at.
    #[must_use]
    pub fn of_organ(&self) -> [(&'static str, Option<f64>); 7] {
        [
            ("P_max_mmHg", self.p_max_mmhg),
            ("dPdt_max_mmHg_per_ms", self.dpdt_max_mmhg_per_ms),
            ("dPdt_min_mmHg_per_ms", self.dpdt_min_mmhg_per_ms),
            ("PTD90_ms", self.ptd90_ms),
            ("tau_VD_ms", self.tau_vd_ms),
            ("tau_VR_ms", self.tau_vr_ms),
            ("SV_mL", self.sv_ml),
        ]
    }

    /// Biomarkers with these values in the order of [`Self::of_organ`], and no others.
    #[must_use]
    pub fn with_organ(values: [Option<f64>; 7]) -> Self {
        let [
            p_max_mmhg,
            dpdt_max_mmhg_per_ms,
            dpdt_min_mmhg_per_ms,
            ptd90_ms,
            tau_vd_ms,
            tau_vr_ms,
            sv_ml,
        ] = values;
        Self {
            p_max_mmhg,
            dpdt_max_mmhg_per_ms,
            dpdt_min_mmhg_per_ms,
            ptd90_ms,
            tau_vd_ms,
            tau_vr_ms,
            sv_ml,
            ..Self::default()
        }
    }

    /// The place of a biomarker that step 1 fits, by its key in [`STEP1_BIOMARKERS`].
    pub fn step1_target_mut(&mut self, key: &str) -> Option<&mut Option<f64>> {
        Some(match key {
            "P_max_mmHg" => &mut self.p_max_mmhg,
            "dPdt_max_mmHg_per_ms" => &mut self.dpdt_max_mmhg_per_ms,
            "dPdt_min_mmHg_per_ms" => &mut self.dpdt_min_mmhg_per_ms,
            "PTD90_ms" => &mut self.ptd90_ms,
            "tau_VD_ms" => &mut self.tau_vd_ms,
            "tau_VR_ms" => &mut self.tau_vr_ms,
            _ => return None,
        })
    }
}

/// The time points that define the biomarkers (paper, Figure A1), ms from the beat's start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct TimePoints {
    /// Upstroke crossing of min P + 10 % of the amplitude.
    pub t1_ms: Option<f64>,
    /// Peak pressure.
    pub t2_ms: Option<f64>,
    /// Downstroke crossing of the same level.
    pub t3_ms: Option<f64>,
    /// Ejection begins.
    pub t4_ms: Option<f64>,
    /// Ejection ends.
    pub t5_ms: Option<f64>,
    /// Filling begins.
    pub t6_ms: Option<f64>,
    /// 80 % of the volume is recovered.
    pub t7_ms: Option<f64>,
}

/// Biomarkers of the active stress, the stretch and the calcium of a cell or of median nodal traces: step 2's targets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CellBiomarkers {
    /// Peak active stress.
    #[serde(rename = "Sa_max_kPa")]
    pub sa_max_kpa: f64,
    /// Largest rate of the active stress before its peak.
    #[serde(rename = "dSadt_max_kPa_per_ms")]
    pub dsadt_max_kpa_per_ms: f64,
    /// Stress transient duration at 30 % decay.
    #[serde(rename = "STD30_ms")]
    pub std30_ms: f64,
    /// Stress transient duration at 50 % decay.
    #[serde(rename = "STD50_ms")]
    pub std50_ms: f64,
    /// Stress transient duration at 90 % decay.
    #[serde(rename = "STD90_ms")]
    pub std90_ms: f64,
    /// Smallest fibre stretch.
    pub lambda_min: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_target_of_step_1_has_a_place_of_its_own() {
        let mut biomarkers = Biomarkers::default();
        for (key, value) in STEP1_BIOMARKERS.iter().zip([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) {
            *biomarkers.step1_target_mut(key).unwrap() = Some(value);
        }
        let written = serde_json::to_value(biomarkers).unwrap();
        assert_eq!(written.as_object().unwrap().len(), 6);
        for (key, value) in STEP1_BIOMARKERS.iter().zip([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) {
            assert_eq!(written[key], value, "{key}");
        }
        assert_eq!(biomarkers.step1_target_mut("EDV_mL"), None);
    }
}

/// Windows over which biomarkers of noisy traces are read; absent where samples are taken as they are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseWindows {
    /// Of the pressure: its largest value and its rates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_ms: Option<f64>,
    /// Of the volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_ms: Option<f64>,
}

impl NoiseWindows {
    /// Whether samples of both traces are taken as they are.
    #[must_use]
    pub fn are_none(&self) -> bool {
        *self == Self::default()
    }
}
