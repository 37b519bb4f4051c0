//! Means of an aorta's traces: they find a wrong unit or sign.

use super::facts::Facts;
use super::facts::Verdict::{self, Broken, Holds};

/// Mean pressures of an aorta, mmHg: from shock to the highest crises. Those in kPa lie below.
const MMHG: std::ops::RangeInclusive<f64> = 25.0..=200.0;
/// Mean flows of an aorta, mL/s: 0.7 to 24 L/min. Those in L/min, 2 to 12 at rest, lie below.
const ML_PER_S: std::ops::RangeInclusive<f64> = 12.0..=400.0;

pub(super) fn pressure(facts: &Facts<'_>) -> Verdict {
    match facts.aortic_mean_mmhg {
        Some(mean) if !MMHG.contains(&mean) => Broken(format!("a mean pressure of {mean:.1} mmHg")),
        _ => Holds,
    }
}

pub(super) fn flow(facts: &Facts<'_>) -> Verdict {
    match facts.aortic_flow_ml_per_s {
        Some(mean) if !ML_PER_S.contains(&mean) => Broken(format!("a mean flow of {mean:.2} mL/s")),
        _ => Holds,
    }
}
