//! How far a clinic's noise moves measured biomarkers, and the weights of step 1 that follow.

use std::collections::BTreeMap;

/// Root mean square errors that noise of 1 to 1.5 mmHg and of 2 to 3 mL a frame makes of measured biomarkers, in percent: of
/// 200 hearts of `solver/validation` (`cargo run --release -p cardiotwin-recordings --example biomarker-noise`).
pub const NOISE_PERCENT: [(&str, f64); 7] = [
    ("P_max_mmHg", 1.0),
    ("dPdt_max_mmHg_per_ms", 3.9),
    ("dPdt_min_mmHg_per_ms", 3.3),
    ("PTD90_ms", 1.4),
    ("SV_mL", 3.8),
    ("tau_VD_ms", 9.1),
    ("tau_VR_ms", 9.7),
];

/// (1 %/σ)² to two digits, as a person would write them.
#[must_use]
pub fn weights() -> BTreeMap<String, f64> {
    let two_digits = |x: f64| format!("{x:.1e}").parse().unwrap_or(x);
    NOISE_PERCENT
        .iter()
        .map(|(name, sd)| ((*name).to_owned(), two_digits(sd.powi(-2))))
        .collect()
}
