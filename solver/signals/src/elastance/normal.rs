//! Values of human hearts, to show a patient's next to.
//!
//! Only numbers that were seen are here; each says in which form its publication was read. No publication with V0 or
//! Ea of healthy people was read, so neither is here.

use serde::Serialize;

/// Mean and standard deviation of a group of people.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NormalValue {
    /// Mean, in the unit of the constant's name.
    pub mean: f64,
    /// Standard deviation between people, in the same unit.
    pub standard_deviation: f64,
    /// Number of people.
    pub n_people: usize,
    /// People and method, with the publication.
    pub source: &'static str,
}

impl NormalValue {
    /// Standard deviations by which a value lies above the mean, dimensionless.
    #[must_use]
    pub fn z_score(self, value: f64) -> f64 {
        (value - self.mean) / self.standard_deviation
    }
}

/// mmHg of one dyn/cm².
const MMHG_PER_DYN_PER_CM2: f64 = 1.0 / 1_333.22;

/// End-systolic elastance \[mmHg/mL\].
pub const ELASTANCE_MMHG_PER_ML: NormalValue = NormalValue {
    mean: 2.10,
    standard_deviation: 0.67,
    n_people: 788,
    source: "adults of a community, single beat with echocardiography; Circ Heart Fail 2013, 6:944 (abstract)",
};

/// End-systolic elastance times body surface \[mmHg m²/mL\].
pub const INDEXED_ELASTANCE_MMHG_M2_PER_ML: NormalValue = NormalValue {
    mean: 4.16,
    standard_deviation: 2.3,
    n_people: 39,
    source: "patients with an ejection fraction of at least 50 %, occlusion of the vena cava with a conductance catheter; Eur Heart J 1992, 13 (suppl E):80 (abstract)",
};

/// Slope of preload-recruitable stroke work \[mmHg\]; printed as 109 ± 31 · 10³ dyn/cm².
pub const PRELOAD_RECRUITABLE_STROKE_WORK_MMHG: NormalValue = NormalValue {
    mean: 109e3 * MMHG_PER_DYN_PER_CM2,
    standard_deviation: 31e3 * MMHG_PER_DYN_PER_CM2,
    n_people: 39,
    source: INDEXED_ELASTANCE_MMHG_M2_PER_ML.source,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stroke_work_is_in_mmhg() {
        let work = PRELOAD_RECRUITABLE_STROKE_WORK_MMHG;
        assert!((work.mean - 81.8).abs() < 0.1, "{work:?}");
        assert!((work.z_score(work.mean + 23.25) - 1.0).abs() < 1e-3);
    }
}
