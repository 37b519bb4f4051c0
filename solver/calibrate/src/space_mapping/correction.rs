//! Correction factors for the biomarkers of the cheap model.

use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use nalgebra::{DMatrix, DVector};

/// Ridge for the slopes of the correction, as the square of a step in the logarithms. For two runs
/// closer than this, a slope mostly reflects the roughness of both models.
const RIDGE: f64 = 0.1 * 0.1;
/// Largest magnitude of a correction's logarithm.
const LARGEST: f64 = 2.0;

/// Number of biomarkers of the organ, each with a factor.
pub(super) const N: usize = Biomarker::OF_ORGAN.len();

/// ln(expensive/cheap) of each biomarker; `None` if either model lacks it.
pub(super) fn logarithms(expensive: &Biomarkers, cheap: &Biomarkers) -> [Option<f64>; N] {
    Biomarker::OF_ORGAN.map(|biomarker| expensive.ratio_to(cheap, biomarker).map(f64::ln))
}

/// Correction of each biomarker, exp(d + s·(x − x_b)).
///
/// d is the logarithm of the base's factor, or a value between it and the expected one. s fits all
/// runs as far as the ridge allows.
#[derive(Debug, Clone)]
pub(super) struct Correction {
    base: Vec<f64>,
    at_base: [f64; N],
    slopes: Vec<DVector<f64>>,
}

impl Correction {
    /// The correction before any run, from the logarithms of the expected factors.
    pub(super) fn expected(n_parameters: usize, expected: [f64; N]) -> Self {
        Self {
            base: vec![0.0; n_parameters],
            at_base: expected,
            slopes: vec![DVector::zeros(n_parameters); N],
        }
    }

    /// The correction from the logarithms of the runs' parameters and factors.
    ///
    /// `weights` is the weight of the base's own factor per biomarker; 1 makes the correction exact
    /// at the base. The remaining weight, and biomarkers that the base lacks, use the expected
    /// factor.
    pub(super) fn of(
        base: usize,
        runs: &[(Vec<f64>, [Option<f64>; N])],
        expected: [f64; N],
        weights: &[f64; N],
    ) -> Self {
        let (x_b, d_b) = &runs[base];
        let n = x_b.len();
        let slope = |j: usize| {
            let Some(d_b) = d_b[j] else {
                return DVector::zeros(n);
            };
            let others: Vec<(DVector<f64>, f64)> = (runs.iter().enumerate())
                .filter(|(i, _)| *i != base)
                .filter_map(|(_, (x, d))| {
                    let step = DVector::from_iterator(n, x.iter().zip(x_b).map(|(x, b)| x - b));
                    Some((step, d[j]? - d_b))
                })
                .collect();
            // The smallest slopes that explain the differences: s = X (XᵀX + ridge)⁻¹ Δd.
            let m = others.len();
            let gram = DMatrix::from_fn(m, m, |a, b| {
                others[a].0.dot(&others[b].0) + if a == b { RIDGE } else { 0.0 }
            });
            let differences = DVector::from_iterator(m, others.iter().map(|(_, d)| *d));
            let Some(cholesky) = gram.cholesky() else {
                return DVector::zeros(n);
            };
            let weights = cholesky.solve(&differences);
            others
                .iter()
                .zip(weights.iter())
                .fold(DVector::zeros(n), |sum, ((step, _), weight)| {
                    sum + step * *weight
                })
        };
        let slopes = (0..N).map(slope).collect();
        let at_base = std::array::from_fn(|j| {
            d_b[j].map_or(expected[j], |d| {
                expected[j] + weights[j] * (d - expected[j])
            })
        });
        Self {
            base: x_b.clone(),
            at_base,
            slopes,
        }
    }

    /// The corrected biomarkers of the cheap model at `x`.
    pub(super) fn apply(&self, x: &[f64], cheap: &Biomarkers) -> Biomarkers {
        let mut corrected = *cheap;
        for (j, biomarker) in Biomarker::OF_ORGAN.into_iter().enumerate() {
            let slope: f64 = self.slopes[j]
                .iter()
                .zip(x.iter().zip(&self.base))
                .map(|(s, (x, b))| s * (x - b))
                .sum();
            let factor = (self.at_base[j] + slope).clamp(-LARGEST, LARGEST).exp();
            corrected.set(biomarker, cheap.get(biomarker).map(|value| value * factor));
        }
        corrected
    }

    /// Factors at the base, by biomarker.
    pub(super) fn factors(&self) -> [f64; N] {
        self.at_base.map(|d| d.clamp(-LARGEST, LARGEST).exp())
    }
}
