//! Fits of synthetic traces with known parameters.

use super::*;
use crate::normal;
use crate::random::{Purpose, generator};
use rand::Rng;

fn truth(tau_cr_ms: f64, tau_cd_ms: f64) -> Rice2008Parameters {
    Rice2008Parameters {
        ca_res_um: 0.15,
        ca_max_um: 0.6,
        tau_cr_ms,
        tau_cd_ms,
    }
}

fn times() -> Vec<f64> {
    (0..100).map(|i| 10.0 * f64::from(i)).collect()
}

/// A trace with independent normal noise.
fn noisy(p: &Rice2008Parameters, standard_deviation: f64, seed: u64) -> Vec<f64> {
    let mut random = generator(seed, Purpose::LatinHypercube, [7, 7]);
    let mut noise =
        || standard_deviation * normal::quantile(random.random_range(1e-12..1.0 - 1e-12));
    p.transient_um(&times())
        .into_iter()
        .map(|v| v + noise())
        .collect()
}

fn fitted(trace: &[f64]) -> CalciumFit {
    fit_calcium(&times(), trace, CalciumFitSettings::default()).unwrap()
}

fn covers(estimate: &Estimate, truth: f64) -> bool {
    estimate.lower.is_none_or(|l| l <= truth) && estimate.upper.is_none_or(|u| u >= truth)
}

#[test]
fn an_exact_trace_gives_its_parameters_back() {
    let expected = truth(210.0, 55.0);
    let fit = fitted(&expected.transient_um(&times()));
    let p = fit.parameters;
    assert!(
        fit.converged && fit.time_constants == TimeConstants::Distinct,
        "{fit:?}"
    );
    assert!((p.ca_res_um - 0.15).abs() < 1e-8 && (p.ca_max_um - 0.6).abs() < 1e-8);
    assert!(
        (p.tau_cr_ms - 210.0).abs() < 1e-5 && (p.tau_cd_ms - 55.0).abs() < 1e-5,
        "{p:?}"
    );
    // Exchanged time constants give the same curve and the same result.
    let exchanged = fitted(&truth(55.0, 210.0).transient_um(&times()));
    assert!((exchanged.parameters.tau_cr_ms - 210.0).abs() < 1e-5);
}

#[test]
fn activation_is_taken_off() {
    let shifted: Vec<f64> = times().iter().map(|t| t - 40.0).collect();
    let trace = truth(180.0, 70.0).transient_um(&shifted);
    let settings = CalciumFitSettings {
        activation_ms: 40.0,
        ..CalciumFitSettings::default()
    };
    let fit = fit_calcium(&times(), &trace, settings).unwrap();
    assert!((fit.parameters.tau_cr_ms - 180.0).abs() < 1e-5, "{fit:?}");
}

/// Refitting the paper's data gives equal constants: a trace narrower than any transient presses
/// them together.
#[test]
fn a_narrow_trace_has_equal_time_constants() {
    let narrow = |s: f64| {
        let x = s / 65.0;
        // A gamma curve of a higher power, which is sharper than s e^{-s}.
        0.15 + 0.45 * (x / 2.0).powf(2.0) * (2.0 - x).exp()
    };
    let fit = fitted(&times().into_iter().map(narrow).collect::<Vec<_>>());
    assert_eq!(fit.time_constants, TimeConstants::Equal);
    assert_eq!(fit.parameters.tau_cr_ms, fit.parameters.tau_cd_ms);
    assert_eq!(
        (fit.tau_cr_ms.standard_error, fit.tau_cd_ms.standard_error),
        (None, None)
    );
    assert!(fit.tau_mean_ms.standard_error.is_some() && fit.tau_mean_ms.lower.is_some());
    // A misfit of the shape shows as correlated residuals, not as noise.
    assert!(fit.residual_correlation > 0.9, "{fit:?}");
    assert!(fit.time_constants.explanation().contains("equal"));
}

#[test]
fn equal_time_constants_in_noise_are_not_told_apart() {
    let (mut n_equal, mut n_covered) = (0, 0);
    for seed in 0..30 {
        let fit = fitted(&noisy(&truth(129.87, 129.87), 0.01, seed));
        assert!(fit.residual_correlation.abs() < 0.35, "{fit:?}");
        n_equal += usize::from(fit.time_constants != TimeConstants::Distinct);
        n_covered += usize::from(covers(&fit.tau_mean_ms, 129.87));
        // Each constant alone is far less certain than their mean.
        let width = |e: &Estimate| e.upper.unwrap() - e.lower.unwrap();
        assert!(
            width(&fit.tau_cr_ms) + width(&fit.tau_cd_ms) > 4.0 * width(&fit.tau_mean_ms),
            "{fit:?}"
        );
    }
    // Equal constants are at the edge of the admissible range, so half of the usual 5 % lie beyond.
    assert!(n_equal >= 26 && n_covered >= 25, "{n_equal} {n_covered}");
}

/// Intervals of 95 % cover the truth in about 95 % of noisy traces.
#[test]
fn intervals_cover() {
    let expected = truth(200.0, 60.0);
    let n = 100;
    let mut covered = [0; 5];
    let mut linear = 0;
    for seed in 0..n {
        let fit = fitted(&noisy(&expected, 0.02, 100 + seed));
        assert_eq!(fit.time_constants, TimeConstants::Distinct);
        let pairs = [
            (fit.ca_res_um, 0.15),
            (fit.ca_max_um, 0.6),
            (fit.tau_cr_ms, 200.0),
            (fit.tau_cd_ms, 60.0),
            (fit.tau_mean_ms, 130.0),
        ];
        for (count, (estimate, truth)) in covered.iter_mut().zip(pairs) {
            *count += usize::from(covers(&estimate, truth));
        }
        linear += usize::from(
            (fit.ca_max_um.value - 0.6).abs() <= 1.96 * fit.ca_max_um.standard_error.unwrap(),
        );
    }
    // Binomial with n = 100 and 0.95: below 88 with a probability of 0.4 %.
    assert!(covered.iter().all(|c| *c >= 88), "{covered:?}");
    assert!(linear >= 88, "{linear}");
    assert!(covered.iter().any(|c| *c < 100), "{covered:?}");
}

#[test]
fn what_is_no_transient_is_refused_by_name() {
    let refused = |times: &[f64], trace: &[f64]| {
        fit_calcium(times, trace, CalciumFitSettings::default())
            .unwrap_err()
            .to_string()
    };
    let t = times();
    assert!(refused(&t[..5], &[0.1; 5]).contains("5 times"));
    assert!(refused(&t, &[0.1; 99]).contains("99 values"));
    let falling: Vec<f64> = t.iter().map(|s| (-s / 100.0).exp()).collect();
    assert!(refused(&t, &falling).contains("no rise and fall"));
    // A trace that only falls or only rises is not a transient, wherever activation is set.
    let early = CalciumFitSettings {
        activation_ms: -20.0,
        ..CalciumFitSettings::default()
    };
    let rising: Vec<f64> = falling.iter().map(|c| 1.0 - c).collect();
    for trace in [falling, rising, vec![0.3; t.len()]] {
        assert!(
            matches!(
                fit_calcium(&t, &trace, early),
                Err(CalciumFitError::NoTransient { .. })
            ),
            "{trace:?}"
        );
    }
    let mut broken = noisy(&truth(100.0, 80.0), 0.01, 0);
    broken[17] = f64::NAN;
    assert!(refused(&t, &broken).contains("sample 17 at 170 ms"));
}
