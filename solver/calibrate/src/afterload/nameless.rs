//! Nameless competitor of the effects: any pressure that every beat repeats, as harmonics of the
//! beat.

use super::AfterloadError;
use super::noise::Scale;
use super::problem::{Problem, TOLERANCE};
use super::record::Record;
use crate::least_squares::{self, Fit};
use cardiotwin_vocabulary::fits::AfterloadUnexplained;
use nalgebra::{DMatrix, DVector};

/// Numbers of harmonics to compare.
const HARMONICS: [usize; 5] = [2, 4, 6, 9, 12];

/// Orthonormal columns: cosines and sines of the beat's phase at the samples that count.
fn basis(record: &Record, counts: &[bool], n_harmonics: usize) -> DMatrix<f64> {
    let phases: Vec<f64> = record
        .pressure_time_s
        .iter()
        .zip(counts)
        .filter(|(_, counts)| **counts)
        .map(|(t, _)| std::f64::consts::TAU * record.phase_of(*t))
        .collect();
    let columns = DMatrix::from_fn(phases.len(), 2 * n_harmonics, |i, k| {
        let angle = (k / 2 + 1) as f64 * phases[i];
        if k % 2 == 0 { angle.cos() } else { angle.sin() }
    });
    columns.qr().q()
}

/// Joint fit of the load and its harmonics.
pub(super) struct NamelessFit {
    pub(super) fit: Fit,
    pub(super) n_harmonics: usize,
}

impl NamelessFit {
    /// Fall of BIC against a model without harmonics.
    pub(super) fn delta_bic(&self, scale: Scale, without: f64, n_effective: f64) -> f64 {
        scale.delta_bic(
            without,
            self.fit.sum_of_squares,
            2 * self.n_harmonics,
            n_effective,
        )
    }
}

/// Fits each number of harmonics that the effective number of samples allows, and returns the fit
/// with the lowest BIC.
pub(super) fn fit(
    problem: &Problem<'_>,
    from: &Fit,
    n_effective: f64,
) -> Result<NamelessFit, AfterloadError> {
    let mut best: Option<(f64, NamelessFit)> = None;
    for n_harmonics in HARMONICS {
        // More coefficients than this would merely trace the record.
        if n_harmonics > HARMONICS[0] && 4 * n_harmonics > n_effective as usize {
            break;
        }
        let basis = basis(problem.record, &problem.counts, n_harmonics);
        let residuals = |x: &[f64]| {
            let r = DVector::from_vec(problem.residuals(x));
            let explained = &basis * basis.tr_mul(&r);
            (r - explained).as_slice().to_vec()
        };
        let fit = least_squares::fit(&residuals, &from.parameters, &problem.bounds(), TOLERANCE)?;
        let found = NamelessFit { fit, n_harmonics };
        let evidence =
            found.delta_bic(Scale::new(problem.record), from.sum_of_squares, n_effective);
        if best.as_ref().is_none_or(|(highest, _)| evidence > *highest) {
            best = Some((evidence, found));
        }
    }
    Ok(best
        .expect("the first number of harmonics is always tried")
        .1)
}

/// Describes the discrepancy and the quantities that it depends on.
pub(super) fn describe(
    problem: &Problem<'_>,
    model: &Fit,
    found: &NamelessFit,
    delta_bic: f64,
) -> AfterloadUnexplained {
    let record = problem.record;
    let n = record.n_samples();
    let basis = basis(record, &vec![true; n], found.n_harmonics);
    // Residuals of the fixed model are used, because next to the harmonics its parameters could
    // drift.
    let r = DVector::from_vec(problem.all_residuals(&model.parameters));
    let discrepancy = -(&basis * basis.tr_mul(&r));
    let largest = discrepancy.iamax();
    let phase = record.phase_of(record.pressure_time_s[largest]);
    let flow: Vec<f64> = record
        .pressure_time_s
        .iter()
        .map(|t| at(&record.flow_time_s, &record.flow, *t))
        .collect();
    let rate = slopes(&record.pressure_time_s, &flow);
    let squared: Vec<f64> = flow.iter().map(|q| q * q.abs()).collect();
    let phases: Vec<f64> = record
        .pressure_time_s
        .iter()
        .map(|t| record.phase_of(*t))
        .collect();
    let leads = [
        ("time in the beat", &phases),
        ("flow", &flow),
        ("flow squared", &squared),
        ("rate of flow", &rate),
        ("pressure", &record.pressure),
    ];
    AfterloadUnexplained {
        delta_bic,
        n_harmonics: found.n_harmonics,
        size_mmhg: (discrepancy.norm_squared() / n as f64).sqrt(),
        largest_at_ms: phase * record.cycle_ms(),
        depends_on: leads
            .into_iter()
            .map(|(on, x)| (on.to_owned(), cubic_share(x, discrepancy.as_slice())))
            .collect(),
    }
}

/// Share of the variance of `y` that a cubic of `x` explains.
fn cubic_share(x: &[f64], y: &[f64]) -> f64 {
    let scale = x
        .iter()
        .fold(0.0_f64, |m, v| m.max(v.abs()))
        .max(f64::MIN_POSITIVE);
    let columns = DMatrix::from_fn(x.len(), 4, |i, k| (x[i] / scale).powi(k as i32));
    let y = DVector::from_column_slice(y);
    let mean = y.mean();
    let total = y.map(|v| (v - mean).powi(2)).sum();
    let q = columns.qr().q();
    let rest = (&y - &q * q.tr_mul(&y)).norm_squared();
    if total > 0.0 {
        (1.0 - rest / total).max(0.0)
    } else {
        0.0
    }
}

fn at(time: &[f64], value: &[f64], t: f64) -> f64 {
    let i = time.partition_point(|x| *x <= t).clamp(1, time.len() - 1);
    let share = ((t - time[i - 1]) / (time[i] - time[i - 1])).clamp(0.0, 1.0);
    value[i - 1] + share * (value[i] - value[i - 1])
}

fn slopes(time: &[f64], value: &[f64]) -> Vec<f64> {
    let last = time.len() - 1;
    (0..=last)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (value[b] - value[a]) / (time[b] - time[a])
        })
        .collect()
}
