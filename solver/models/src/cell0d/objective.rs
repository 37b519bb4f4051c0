//! Cost and penalty of step 2 (Jung 2022, eqs. 18-19).

use super::biomarkers::{ActiveStressBiomarkers, CalciumBiomarkers};
use serde::{Deserialize, Serialize};

/// Targets of step 2: biomarkers of the median traces.
pub use cardiotwin_vocabulary::biomarkers::CellBiomarkers as CellTargets;

/// Weights of the cost's terms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CellWeights {
    /// Weight of the largest active stress Sa_max.
    pub sa_max: f64,
    /// Weight of the largest stress rate dSadt_max.
    pub dsadt_max: f64,
    /// Weight of the duration STD30.
    pub std30: f64,
    /// Weight of the duration STD50.
    pub std50: f64,
    /// Weight of the duration STD90.
    pub std90: f64,
    /// Weight of the smallest stretch λ_min.
    pub lambda_min: f64,
}

impl Default for CellWeights {
    /// Jung 2022, eq. 18.
    fn default() -> Self {
        Self {
            sa_max: 5.0,
            dsadt_max: 1.0,
            std30: 5.0,
            std50: 1.0,
            std90: 1.0,
            lambda_min: 100.0,
        }
    }
}

/// Weighted terms of the cost.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CellCost {
    /// Term of the largest active stress Sa_max.
    pub sa_max: f64,
    /// Term of the largest stress rate dSadt_max.
    pub dsadt_max: f64,
    /// Term of the duration STD30.
    pub std30: f64,
    /// Term of the duration STD50.
    pub std50: f64,
    /// Term of the duration STD90.
    pub std90: f64,
    /// Term of the smallest stretch λ_min.
    pub lambda_min: f64,
}

/// Terms of the penalty, units kPa and ms, no weights.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CellPenalty {
    /// Square of the stress at the start of the beat.
    pub sa_res: f64,
    /// Integral of the squared negative stress.
    pub negative_stress: f64,
    /// Integral of the squared rise after the maximum.
    pub rise_after_max: f64,
    /// Squared violation of 120 ≤ CTD50 ≤ 420 ms.
    pub ctd50: f64,
    /// Squared violation of 220 ≤ CTD90 ≤ 785 ms.
    pub ctd90: f64,
}

impl From<ActiveStressBiomarkers> for CellTargets {
    fn from(b: ActiveStressBiomarkers) -> Self {
        Self {
            sa_max_kpa: b.sa_max_kpa,
            dsadt_max_kpa_per_ms: b.dsadt_max_kpa_per_ms,
            std30_ms: b.std30_ms,
            std50_ms: b.std50_ms,
            std90_ms: b.std90_ms,
            lambda_min: b.lambda_min,
        }
    }
}

impl CellCost {
    /// Weighted squared relative differences `((target − simulated)/target)²` (eq. 18).
    #[must_use]
    pub fn new(
        target: &CellTargets,
        simulated: &ActiveStressBiomarkers,
        weights: &CellWeights,
    ) -> Self {
        let term = |weight: f64, target: f64, simulated: f64| {
            weight * ((target - simulated) / target).powi(2)
        };
        Self {
            sa_max: term(weights.sa_max, target.sa_max_kpa, simulated.sa_max_kpa),
            dsadt_max: term(
                weights.dsadt_max,
                target.dsadt_max_kpa_per_ms,
                simulated.dsadt_max_kpa_per_ms,
            ),
            std30: term(weights.std30, target.std30_ms, simulated.std30_ms),
            std50: term(weights.std50, target.std50_ms, simulated.std50_ms),
            std90: term(weights.std90, target.std90_ms, simulated.std90_ms),
            lambda_min: term(weights.lambda_min, target.lambda_min, simulated.lambda_min),
        }
    }

    /// Sum of the terms.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.sa_max + self.dsadt_max + self.std30 + self.std50 + self.std90 + self.lambda_min
    }
}

impl CellPenalty {
    /// Penalty of a beat (eq. 19, CTD50's second bound read as 420): integrals by trapezoids on the samples, the rise by one
    /// slope an interval.
    ///
    /// - `time_ms`, `sa_kpa`: samples of one beat, equally long
    #[must_use]
    pub fn new(time_ms: &[f64], sa_kpa: &[f64], calcium: &CalciumBiomarkers) -> Self {
        let mut penalty = Self {
            sa_res: sa_kpa.first().map_or(0.0, |sa| sa * sa),
            ctd50: outside(calcium.ctd50_ms, 120.0, 420.0),
            ctd90: outside(calcium.ctd90_ms, 220.0, 785.0),
            ..Self::default()
        };
        let mut peak = 0;
        for (i, &sa) in sa_kpa.iter().enumerate() {
            if sa > sa_kpa[peak] {
                peak = i;
            }
        }
        for i in 1..sa_kpa.len().min(time_ms.len()) {
            let interval = time_ms[i] - time_ms[i - 1];
            let (a, b) = (sa_kpa[i - 1].min(0.0), sa_kpa[i].min(0.0));
            penalty.negative_stress += 0.5 * interval * (a * a + b * b);
            if i > peak && interval > 0.0 {
                let slope = ((sa_kpa[i] - sa_kpa[i - 1]) / interval).max(0.0);
                penalty.rise_after_max += interval * slope * slope;
            }
        }
        penalty
    }

    /// Sum of the terms.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.sa_res + self.negative_stress + self.rise_after_max + self.ctd50 + self.ctd90
    }
}

/// Squared distance to the interval.
fn outside(value: f64, low: f64, high: f64) -> f64 {
    (value - value.clamp(low, high)).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALCIUM: CalciumBiomarkers = CalciumBiomarkers {
        ctd50_ms: 422.0,
        ctd90_ms: 210.0,
    };

    #[test]
    fn penalty_terms_by_hand() {
        let p = CellPenalty::new(
            &[0.0, 1.0, 2.0, 3.0, 4.0],
            &[0.5, 4.0, 1.0, 3.0, -2.0],
            &CALCIUM,
        );
        assert_eq!(p.sa_res, 0.25);
        assert_eq!(p.rise_after_max, 4.0);
        assert_eq!(p.negative_stress, 2.0);
        assert_eq!((p.ctd50, p.ctd90), (4.0, 100.0));
        assert_eq!(p.total(), 110.25);
    }
}
