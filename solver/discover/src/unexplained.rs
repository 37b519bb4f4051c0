//! A gap without a name: its location and the variables that it depends on.

use crate::discrepancy::DiscrepancyTerm;
use crate::forward::Prediction;
use crate::locate::locate;
use crate::noise::slopes;
use crate::problem::{Data, Problem};
use cardiotwin_vocabulary::findings::{Dependence, Unexplained};
use nalgebra::{DMatrix, DVector};

/// Number of polynomial coefficients besides the constant.
const DEGREE: usize = 3;

/// Share of the variance of `y` that a cubic of `x` explains, corrected for its coefficients;
/// `None` for a constant x or y.
fn explained(x: &[f64], y: &[f64]) -> Option<f64> {
    let n = y.len();
    if n < 3 * (DEGREE + 1) {
        return None;
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n as f64;
    let (mx, my) = (mean(x), mean(y));
    let spread = x.iter().map(|v| (v - mx).abs()).fold(0.0, f64::max);
    let total: f64 = y.iter().map(|v| (v - my) * (v - my)).sum();
    if spread <= 0.0 || total <= 0.0 {
        return None;
    }
    let matrix = DMatrix::from_fn(n, DEGREE + 1, |r, c| ((x[r] - mx) / spread).powi(c as i32));
    let right = DVector::from_column_slice(y);
    let solution = matrix.clone().svd(true, true).solve(&right, 1e-10).ok()?;
    let rest = (right - matrix * solution).norm_squared();
    Some((1.0 - rest / total * (n - 1) as f64 / (n - DEGREE - 1) as f64).max(0.0))
}

/// A gap without a name: the competitor that explains it with its evidence, its largest discrepancy
/// from a beat, and the variables that it depends on.
///
/// # Panics
/// Never, because the table of places has rows.
#[must_use]
pub fn nameless_gap(
    problem: &Problem<'_>,
    beat: &Prediction,
    (kind, log_evidence): (DiscrepancyTerm, f64),
) -> Unexplained {
    let worst = locate(problem, beat)
        .into_iter()
        .max_by(|a, b| a.share.total_cmp(&b.share));
    let kind = match kind {
        DiscrepancyTerm::Activation => "activation",
        _ => "discrepancy",
    };
    Unexplained {
        kind: kind.to_owned(),
        log_evidence,
        place: worst.expect("the table has rows"),
        depends_on: depends_on(problem.data, beat),
    }
}

/// Variables on which the discrepancies of pressure and volume depend, best first within each
/// signal.
///
/// The variables are time, volume, dV/dt, aortic flow, its square, and pressure, with the values of
/// the model, as a new entry of the catalogue would use them.
#[must_use]
pub fn depends_on(data: &Data, beat: &Prediction) -> Vec<Dependence> {
    let n = beat.true_volume_ml.len();
    let grid: Vec<f64> = (0..n).map(|i| i as f64 * beat.step_ms).collect();
    let rate = slopes(&grid, &beat.true_volume_ml, 10.0);
    let square: Vec<f64> = beat
        .aortic_flow_ml_per_s
        .iter()
        .map(|q| q * q.abs())
        .collect();
    let variables: [(&str, &[f64]); 6] = [
        ("time", &grid),
        ("volume", &beat.true_volume_ml),
        ("volume_rate", &rate),
        ("aortic_flow", &beat.aortic_flow_ml_per_s),
        ("aortic_flow_squared", &square),
        ("pressure", &beat.true_pressure_mmhg),
    ];
    let mut list = Vec::new();
    for (name, signal, trace) in [
        ("pressure", &data.pressure, &beat.pressure_mmhg),
        ("volume", &data.volume, &beat.volume_ml),
    ] {
        let residual: Vec<f64> = signal
            .time_ms
            .iter()
            .zip(&signal.value)
            .map(|(t, v)| v - beat.at(trace, *t))
            .collect();
        let mut own: Vec<Dependence> = variables
            .iter()
            .filter_map(|(variable, values)| {
                let x: Vec<f64> = signal.time_ms.iter().map(|t| beat.at(values, *t)).collect();
                let share = explained(&x, &residual)?;
                Some(Dependence {
                    signal: name.to_owned(),
                    variable: (*variable).to_owned(),
                    share,
                })
            })
            .collect();
        own.sort_by(|a, b| b.share.total_cmp(&a.share));
        list.extend(own);
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_explains_itself_and_noise_little() {
        let x: Vec<f64> = (0..100).map(|i| f64::from(i) / 50.0 - 1.0).collect();
        let y: Vec<f64> = x.iter().map(|x| 2.0 - x + 0.5 * x.powi(3)).collect();
        assert!(explained(&x, &y).unwrap() > 0.999_999);
        let noise: Vec<f64> = (0..100)
            .map(|i| f64::from((i * 7919) % 101) - 50.0)
            .collect();
        assert!(explained(&x, &noise).unwrap() < 0.1);
        assert!(explained(&[1.0; 20], &noise[..20]).is_none());
    }
}
