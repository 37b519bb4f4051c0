//! Effect of clinical noise on measured biomarkers, and the resulting weights of step 1.

use std::collections::BTreeMap;

use crate::biomarkers::Biomarker;

/// Root mean square errors of measured biomarkers in percent, due to noise of 1 to 1.5 mmHg and of
/// 2 to 3 mL per frame, over 200 hearts of `tests/validation`
/// (`cargo run --release --manifest-path dev/Cargo.toml --example biomarker-noise`).
pub const NOISE_PERCENT: [(Biomarker, f64); 7] = [
    (Biomarker::PMax, 1.0),
    (Biomarker::DpdtMax, 3.9),
    (Biomarker::DpdtMin, 3.3),
    (Biomarker::Ptd90, 1.4),
    (Biomarker::Sv, 3.8),
    (Biomarker::TauVd, 9.1),
    (Biomarker::TauVr, 9.7),
];

/// Weights (1 %/σ)², rounded to two digits as in hand-written settings.
#[must_use]
pub fn weights() -> BTreeMap<String, f64> {
    let two_digits = |x: f64| format!("{x:.1e}").parse().unwrap_or(x);
    NOISE_PERCENT
        .iter()
        .map(|(biomarker, sd)| (biomarker.key().to_owned(), two_digits(sd.powi(-2))))
        .collect()
}
