//! The cost of an iteration: squared relative differences of its biomarkers to the measured ones.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One biomarker of step 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Biomarker {
    /// Largest pressure, mmHg.
    #[serde(rename = "P_max_mmHg")]
    PMax,
    /// Largest rate of pressure, mmHg/ms.
    #[serde(rename = "dPdt_max_mmHg_per_ms")]
    DpdtMax,
    /// Smallest rate of pressure, mmHg/ms.
    #[serde(rename = "dPdt_min_mmHg_per_ms")]
    DpdtMin,
    /// Duration of the pressure transient, ms.
    #[serde(rename = "PTD90_ms")]
    Ptd90,
    /// Decay time constant of ejection, ms.
    #[serde(rename = "tau_VD_ms")]
    TauVd,
    /// Rise time constant of filling, ms.
    #[serde(rename = "tau_VR_ms")]
    TauVr,
    /// Stroke volume, mL. Not in the cost: space mapping alone looks at it.
    #[serde(rename = "SV_mL")]
    Sv,
}

impl Biomarker {
    /// The biomarkers of the cost, those of pressure first.
    pub const OF_COST: [Self; 6] = [
        Self::PMax,
        Self::DpdtMax,
        Self::DpdtMin,
        Self::Ptd90,
        Self::TauVd,
        Self::TauVr,
    ];
    /// All biomarkers: those of the cost, then stroke volume.
    pub const ALL: [Self; 7] = [
        Self::PMax,
        Self::DpdtMax,
        Self::DpdtMin,
        Self::Ptd90,
        Self::TauVd,
        Self::TauVr,
        Self::Sv,
    ];

    /// Key with its unit, as in files.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::PMax => "P_max_mmHg",
            Self::DpdtMax => "dPdt_max_mmHg_per_ms",
            Self::DpdtMin => "dPdt_min_mmHg_per_ms",
            Self::Ptd90 => "PTD90_ms",
            Self::TauVd => "tau_VD_ms",
            Self::TauVr => "tau_VR_ms",
            Self::Sv => "SV_mL",
        }
    }

    /// The one of this key.
    #[must_use]
    pub fn named(key: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|biomarker| biomarker.key() == key)
    }

    /// Whether it comes from a volume trace: absent in a personalisation to pressure alone.
    #[must_use]
    pub fn is_of_volume(self) -> bool {
        matches!(self, Self::TauVd | Self::TauVr | Self::Sv)
    }
}

impl std::fmt::Display for Biomarker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.key())
    }
}

/// The biomarkers of step 1, measured or simulated; absent ones could not be computed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Biomarkers {
    /// Largest pressure.
    #[serde(rename = "P_max_mmHg")]
    pub p_max_mmhg: Option<f64>,
    /// Largest rate of pressure, mmHg/ms.
    #[serde(rename = "dPdt_max_mmHg_per_ms")]
    pub dpdt_max_mmhg_per_ms: Option<f64>,
    /// Smallest rate of pressure, mmHg/ms, negative.
    #[serde(rename = "dPdt_min_mmHg_per_ms")]
    pub dpdt_min_mmhg_per_ms: Option<f64>,
    /// Duration of the pressure transient.
    #[serde(rename = "PTD90_ms")]
    pub ptd90_ms: Option<f64>,
    /// Decay time constant of ejection.
    #[serde(rename = "tau_VD_ms")]
    pub tau_vd_ms: Option<f64>,
    /// Rise time constant of filling.
    #[serde(rename = "tau_VR_ms")]
    pub tau_vr_ms: Option<f64>,
    /// Stroke volume.
    #[serde(rename = "SV_mL")]
    pub sv_ml: Option<f64>,
}

impl Biomarkers {
    /// One value, in the unit of the biomarker's key.
    #[must_use]
    pub fn get(&self, biomarker: Biomarker) -> Option<f64> {
        match biomarker {
            Biomarker::PMax => self.p_max_mmhg,
            Biomarker::DpdtMax => self.dpdt_max_mmhg_per_ms,
            Biomarker::DpdtMin => self.dpdt_min_mmhg_per_ms,
            Biomarker::Ptd90 => self.ptd90_ms,
            Biomarker::TauVd => self.tau_vd_ms,
            Biomarker::TauVr => self.tau_vr_ms,
            Biomarker::Sv => self.sv_ml,
        }
    }

    /// Sets one value, in the unit of the biomarker's key.
    pub fn set(&mut self, biomarker: Biomarker, value: Option<f64>) {
        match biomarker {
            Biomarker::PMax => self.p_max_mmhg = value,
            Biomarker::DpdtMax => self.dpdt_max_mmhg_per_ms = value,
            Biomarker::DpdtMin => self.dpdt_min_mmhg_per_ms = value,
            Biomarker::Ptd90 => self.ptd90_ms = value,
            Biomarker::TauVd => self.tau_vd_ms = value,
            Biomarker::TauVr => self.tau_vr_ms = value,
            Biomarker::Sv => self.sv_ml = value,
        }
    }

    /// Clinical over simulated value, where both exist, have one sign and are finite; else the update has no direction.
    #[must_use]
    pub fn ratio_to(&self, simulated: &Self, biomarker: Biomarker) -> Option<f64> {
        let ratio = self.get(biomarker)? / simulated.get(biomarker)?;
        (ratio.is_finite() && ratio > 0.0).then_some(ratio)
    }
}

/// One term of the cost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Term {
    /// Which biomarker.
    pub biomarker: Biomarker,
    /// (clinical − simulated)/clinical, dimensionless; 1 where the simulation has no such biomarker.
    pub relative_difference: f64,
}

/// Cost of an iteration, dimensionless, with its terms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Sum of the squared relative differences.
    pub total: f64,
    /// One term per measured biomarker, those of pressure first.
    pub terms: Vec<Term>,
}

impl Cost {
    /// Sum of squared relative differences (Jung 2022, eqs. 12, 14; unweighted, over all measured biomarkers).
    ///
    /// A biomarker that the simulation could not give counts as missed by all of it.
    #[must_use]
    pub fn of(measured: &Biomarkers, simulated: &Biomarkers) -> Self {
        let terms: Vec<Term> = Biomarker::OF_COST
            .into_iter()
            .filter_map(|biomarker| {
                let relative_difference =
                    difference(measured.get(biomarker)?, simulated.get(biomarker));
                Some(Term {
                    biomarker,
                    relative_difference,
                })
            })
            .collect();
        Self {
            total: terms.iter().map(|t| t.relative_difference.powi(2)).sum(),
            terms,
        }
    }
}

/// Weights of the squared relative differences in a misfit: by which of the iterations within the tolerance the best is
/// chosen, and what space mapping lowers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Weights([f64; Biomarker::ALL.len()]);

impl Default for Weights {
    /// Those of the cost: then the misfit is the cost.
    fn default() -> Self {
        Self(Biomarker::ALL.map(|biomarker| if biomarker == Biomarker::Sv { 0.0 } else { 1.0 }))
    }
}

impl Weights {
    /// The same with another weight of one biomarker: not negative, finite, dimensionless.
    #[must_use]
    pub fn with(mut self, biomarker: Biomarker, weight: f64) -> Self {
        self.0[biomarker as usize] = weight;
        self
    }

    /// One over the variance of each relative difference, from standard deviations in percent of the measured value by the
    /// biomarkers' keys; a biomarker that is absent does not count.
    #[must_use]
    pub fn of_uncertainty_percent(uncertainty_percent: &BTreeMap<String, f64>) -> Self {
        let weight = |biomarker: Biomarker| {
            uncertainty_percent
                .get(biomarker.key())
                .map(|sd| (0.01 * sd).powi(-2))
        };
        Self(Biomarker::ALL.map(|biomarker| weight(biomarker).unwrap_or(0.0)))
    }

    /// (clinical − simulated)/clinical times the root of its weight, of each measured biomarker that has one; 1 for the
    /// difference where the simulation has no such biomarker.
    #[must_use]
    pub fn residuals(&self, measured: &Biomarkers, simulated: &Biomarkers) -> Vec<f64> {
        let weighted = Biomarker::ALL
            .into_iter()
            .zip(self.0)
            .filter(|(_, weight)| *weight > 0.0);
        weighted
            .filter_map(|(b, weight)| {
                Some(weight.sqrt() * difference(measured.get(b)?, simulated.get(b)))
            })
            .collect()
    }

    /// Sum of the squared residuals.
    #[must_use]
    pub fn misfit(&self, measured: &Biomarkers, simulated: &Biomarkers) -> f64 {
        self.residuals(measured, simulated)
            .iter()
            .map(|r| r * r)
            .sum()
    }
}

/// (clinical − simulated)/clinical; 1, missed by all of it, where there is no finite one.
fn difference(clinical: f64, simulated: Option<f64>) -> f64 {
    simulated
        .map(|s| (clinical - s) / clinical)
        .filter(|d| d.is_finite())
        .unwrap_or(1.0)
}
