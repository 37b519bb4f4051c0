//! Verdict on a twin: the biomarkers of its beat against stated tolerances.

use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{Biomarker, Biomarkers};

/// Largest relative differences at which a twin counts as personalised, percent of the measured
/// value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TwinTolerances {
    /// Tolerance of the peak pressure.
    #[serde(rename = "P_max")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub p_max: f64,
    /// Tolerance of the largest pressure rate.
    #[serde(rename = "dPdt_max")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub dpdt_max: f64,
    /// Tolerance of the smallest pressure rate.
    #[serde(rename = "dPdt_min")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub dpdt_min: f64,
    /// Tolerance of the pressure transient duration.
    #[serde(rename = "PTD90")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub ptd90: f64,
    /// Tolerance of the stroke volume.
    #[serde(rename = "SV")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub sv: f64,
    /// Largest volume left open at the end of the beat, percent of the measured stroke volume.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub volume_gap: f64,
}

impl Default for TwinTolerances {
    fn default() -> Self {
        Self {
            p_max: 5.0,
            dpdt_max: 15.0,
            dpdt_min: 15.0,
            ptd90: 3.0,
            sv: 5.0,
            volume_gap: 20.0,
        }
    }
}

impl TwinTolerances {
    /// Tolerance of each biomarker.
    #[must_use]
    pub fn of_biomarkers(&self) -> [(Biomarker, f64); 5] {
        [
            (Biomarker::PMax, self.p_max),
            (Biomarker::DpdtMax, self.dpdt_max),
            (Biomarker::DpdtMin, self.dpdt_min),
            (Biomarker::Ptd90, self.ptd90),
            (Biomarker::Sv, self.sv),
        ]
    }
}

/// Agreement of a twin's beat with the measured biomarkers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Verdict {
    /// Whether every measured biomarker and the volume at the end of the beat are within their
    /// tolerances.
    pub personalised: bool,
    /// Relative differences (simulated − measured) / measured, percent, of the biomarkers that are
    /// out of tolerance, by the tolerances' names. `volume_gap` is measured end-diastolic minus final
    /// volume over the measured stroke volume.
    pub off_percent: BTreeMap<String, f64>,
}

impl Verdict {
    /// Judges a beat, and the volume that it leaves open at its end. A biomarker that was not measured is not judged; one that the beat lacks
    /// counts with a difference of 100 %.
    #[must_use]
    pub fn of(measured: &Biomarkers, simulated: &Biomarkers, tolerances: &TwinTolerances) -> Self {
        let mut off_percent: BTreeMap<String, f64> = tolerances
            .of_biomarkers()
            .into_iter()
            .filter_map(|(biomarker, tolerance)| {
                let measured = measured.get(biomarker)?;
                let off = simulated.get(biomarker).map_or(-100.0, |simulated| {
                    100.0 * (simulated - measured) / measured
                });
                (off.is_nan() || off.abs() > tolerance).then(|| (biomarker.name().to_owned(), off))
            })
            .collect();
        if let (Some(gap_ml), Some(stroke_ml)) = (simulated.end_of_beat_gap_ml, measured.sv_ml) {
            let gap = 100.0 * gap_ml / stroke_ml;
            if gap.is_nan() || gap.abs() > tolerances.volume_gap {
                off_percent.insert(VOLUME_GAP.to_owned(), gap);
            }
        }
        Self {
            personalised: off_percent.is_empty(),
            off_percent,
        }
    }
}

/// Name of the volume left open at the end of the beat, among the tolerances.
const VOLUME_GAP: &str = "volume_gap";

/// Words for a verified twin outside of its tolerances, with which its verdict begins.
pub const OFF: &str = "not personalised";

/// A relative difference from the measurement in words.
fn difference(name: &str, percent: f64) -> String {
    if name == VOLUME_GAP {
        return format!("volume gap {percent:.0} %");
    }
    if percent <= -100.0 {
        return format!("{name} missing");
    }
    let (above, below) = match name {
        "dPdt_max" | "dPdt_min" => ("too steep", "too flat"),
        "PTD90" => ("too long", "too short"),
        _ => ("too high", "too low"),
    };
    let side = if percent > 0.0 { above } else { below };
    format!("{name} {:.0} % {side}", percent.abs())
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.personalised {
            return f.write_str("personalised");
        }
        // The largest difference comes first, because readers need it most.
        let mut off: Vec<(&String, &f64)> = self.off_percent.iter().collect();
        off.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        let off: Vec<String> = off
            .into_iter()
            .map(|(name, percent)| difference(name, *percent))
            .collect();
        write!(f, "{OFF}: {}", off.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beat_is_judged_by_what_was_measured() {
        let measured = Biomarkers {
            p_max_mmhg: Some(100.0),
            sv_ml: Some(80.0),
            ..Biomarkers::default()
        };
        let near = Biomarkers {
            p_max_mmhg: Some(104.9),
            sv_ml: Some(77.0),
            ptd90_ms: Some(1.0),
            ..measured
        };
        let tolerances = TwinTolerances::default();
        assert_eq!(
            Verdict::of(&measured, &near, &tolerances).to_string(),
            "personalised"
        );
        let far = Biomarkers {
            p_max_mmhg: Some(94.0),
            sv_ml: Some(41.6),
            ..measured
        };
        let verdict = Verdict::of(&measured, &far, &tolerances);
        assert!(!verdict.personalised);
        assert_eq!(
            verdict.to_string(),
            "not personalised: SV 48 % too low, P_max 6 % too low"
        );
        let none = Verdict::of(
            &measured,
            &Biomarkers {
                sv_ml: None,
                ..near
            },
            &tolerances,
        );
        assert_eq!(none.to_string(), "not personalised: SV missing");
    }

    #[test]
    fn a_volume_left_open_counts_beyond_its_limit() {
        let measured = Biomarkers {
            sv_ml: Some(80.0),
            ..Biomarkers::default()
        };
        let verdict = |gap_ml: f64, volume_gap: f64| {
            let simulated = Biomarkers {
                end_of_beat_gap_ml: Some(gap_ml),
                ..measured
            };
            let tolerances = TwinTolerances {
                volume_gap,
                ..TwinTolerances::default()
            };
            Verdict::of(&measured, &simulated, &tolerances)
        };
        assert!(verdict(15.9, 20.0).personalised && verdict(-15.9, 20.0).personalised);
        assert_eq!(
            verdict(18.4, 20.0).to_string(),
            "not personalised: volume gap 23 %"
        );
        assert_eq!(verdict(-20.0, 20.0).off_percent["volume_gap"], -25.0);
        assert!(!verdict(f64::NAN, 20.0).personalised && !verdict(9.0, 10.0).personalised);
    }
}
