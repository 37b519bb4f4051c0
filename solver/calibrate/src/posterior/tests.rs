use super::*;
use crate::Interval;
use crate::space_mapping::Prior;
use crate::statistics::{mean, quantile_of, standard_deviation};

fn wide(n: usize) -> Vec<TruncatedNormal> {
    vec![
        TruncatedNormal::new(
            Prior {
                centre: 0.0,
                width: 1.0
            },
            Interval::new(-9.0, 9.0)
        );
        n
    ]
}

fn drawn(target: &Target<'_, f64>, start: &[f64], n: u64) -> Vec<Draw<f64>> {
    let mode = mode(target, &target.standard(start), 30).expect("a mode");
    drawn_around(target, &mode, 1, n)
}

fn drawn_around<Q>(target: &Target<'_, Q>, mode: &Mode, seed: u64, n: u64) -> Vec<Draw<Q>> {
    let mut ensemble = Ensemble::new(target, mode, seed, n, 60);
    while !ensemble.pending().is_empty() {
        let results = ensemble
            .pending()
            .into_iter()
            .map(|i| ensemble.next(i))
            .collect();
        ensemble.tell(results);
    }
    ensemble.draws()
}

fn of(draws: &[Draw<f64>], pick: impl Fn(&Draw<f64>) -> f64) -> Vec<f64> {
    draws.iter().map(pick).collect()
}

#[test]
fn the_standard_coordinate_is_the_quantile_of_the_truncated_prior() {
    let prior = TruncatedNormal::new(
        Prior {
            centre: 2.0,
            width: 1.5,
        },
        Interval::new(1.0, 3.0),
    );
    for x in [1.0001, 1.5, 2.0, 2.7, 2.9999] {
        assert!(
            (prior.from_standard(prior.to_standard(x)) - x).abs() < 1e-9,
            "{x}"
        );
    }
    assert!(
        (prior.from_standard(0.0) - 2.0).abs() < 1e-12 && (prior.quantile(0.5) - 2.0).abs() < 1e-12
    );
    assert_eq!(
        (prior.from_standard(-40.0), prior.from_standard(40.0)),
        (1.0, 3.0)
    );
    // The share below 1.5: (Φ(−1/3) − Φ(−2/3)) / (Φ(2/3) − Φ(−2/3)).
    assert!(
        (prior.to_standard(1.5) - crate::normal::quantile((0.369_441 - 0.252_493) / 0.495_015))
            .abs()
            < 1e-5
    );
}

#[test]
fn a_linear_model_has_the_posterior_of_the_closed_form() {
    // One measurement of the sum with standard deviation 0.1, none of the difference.
    let model = |x: &[f64]| {
        Some(Evaluated {
            residuals: vec![(x[0] + x[1] - 1.0) / 0.1],
            seen: x[0] - x[1],
        })
    };
    let prior = wide(2);
    let target = Target {
        prior: &prior,
        model: &model,
    };
    let draws = drawn(&target, &[0.3, -0.2], 2000);
    let sum = of(&draws, |draw| draw.u[0] + draw.u[1]);
    // Prior variance of the sum is 2: precision 0.5 + 100.
    let (expected_mean, expected_sd) = (100.0 / 100.5, 1.0 / 100.5_f64.sqrt());
    assert!((mean(&sum) - expected_mean).abs() < 0.01, "{}", mean(&sum));
    assert!(
        (standard_deviation(&sum) / expected_sd - 1.0).abs() < 0.06,
        "{}",
        standard_deviation(&sum)
    );
    let difference = of(&draws, |draw| draw.seen);
    assert!(
        mean(&difference).abs() < 0.1
            && (standard_deviation(&difference) / 2.0_f64.sqrt() - 1.0).abs() < 0.06
    );
    // The datum is 1, while prior and error make values within √2.01 plausible.
    let left = mode(&target, &[0.0, 0.0], 30).expect("a mode").left(1.0);
    assert!((left - 1.0 / 2.01).abs() < 1e-3, "{left}");
    // χ² of one degree of freedom has a long tail.
    assert!(draws.iter().filter(|draw| draw.converged).count() > 1850);
}

#[test]
fn intervals_of_a_curved_model_hold_true_values_as_often_as_they_say() {
    // The truth is repeatedly drawn from the prior and measured through a curve.
    let prior = wide(2);
    let truths =
        [0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95].map(crate::normal::quantile);
    let mut held = 0;
    for (i, a) in truths.iter().enumerate() {
        for (j, b) in truths.iter().enumerate() {
            let curve = |x: &[f64]| [(0.7 * x[0]).exp() + 0.3 * x[1], x[1] + 0.3 * x[0] * x[0]];
            let error = |k: usize| {
                0.3 * crate::normal::quantile(((7 * i + 3 * j + 5 * k) % 10) as f64 * 0.1 + 0.05)
            };
            let [p, q] = curve(&[*a, *b]);
            let data = [p + error(0), q + error(1)];
            let model = |x: &[f64]| {
                let found = curve(x);
                Some(Evaluated {
                    residuals: (0..2).map(|k| (found[k] - data[k]) / 0.3).collect(),
                    seen: x[0],
                })
            };
            let target = Target {
                prior: &prior,
                model: &model,
            };
            let mut draws = of(&drawn(&target, &[0.0, 0.0], 100), |draw| draw.seen);
            draws.sort_by(f64::total_cmp);
            held +=
                usize::from((quantile_of(&draws, 0.05)..=quantile_of(&draws, 0.95)).contains(a));
        }
    }
    assert!((82..=97).contains(&held), "{held} of 100");
}

#[test]
fn a_parameter_that_nothing_was_measured_of_keeps_its_prior_within_the_bounds() {
    let prior = vec![
        TruncatedNormal::new(
            Prior {
                centre: 0.2,
                width: 0.75
            },
            Interval::new(0.0, 1.0)
        );
        22
    ];
    let model = |x: &[f64]| {
        Some(Evaluated {
            residuals: vec![(x[0] - 0.5) / 0.02],
            seen: 0.0,
        })
    };
    let target = Target {
        prior: &prior,
        model: &model,
    };
    let mut free = of(&drawn(&target, &[0.4; 22], 1000), |draw| {
        prior[7].from_standard(draw.u[7])
    });
    free.sort_by(f64::total_cmp);
    for share in [0.05, 0.5, 0.95] {
        let (found, expected) = (quantile_of(&free, share), prior[7].quantile(share));
        assert!(
            (found - expected).abs() < 0.04,
            "{share}: {found} for {expected}"
        );
    }
    assert!(free.iter().all(|x| (0.0..=1.0).contains(x)));
}

#[test]
fn a_model_without_an_answer_is_left_out_and_the_same_seed_draws_the_same() {
    let model = |x: &[f64]| {
        (x[0] > 0.0).then(|| Evaluated {
            residuals: vec![3.0 * (x[0] - 0.2)],
            seen: x[0],
        })
    };
    let prior = wide(1);
    let target = Target {
        prior: &prior,
        model: &model,
    };
    let draws = of(&drawn(&target, &[0.5], 200), |draw| draw.seen);
    assert!(draws.len() > 150 && draws.iter().all(|x| *x > 0.0));
    assert_eq!(draws, of(&drawn(&target, &[0.5], 200), |draw| draw.seen));
    assert!(
        mode(
            &Target {
                prior: &prior,
                model: &|_| None::<Evaluated<f64>>
            },
            &[0.0],
            5
        )
        .is_none()
    );
}

#[test]
fn draws_are_of_both_valleys_that_serve_alike() {
    // The data determine only the magnitude, so that half of the posterior lies on each side; the
    // mode is on one of them.
    let prior = wide(2);
    let model = |x: &[f64]| {
        let residuals = vec![(x[0].abs() - 1.5) / 0.2, (x[1] - 0.3) / 0.5];
        Some(Evaluated {
            residuals,
            seen: (),
        })
    };
    let target = Target {
        prior: &prior,
        model: &model,
    };
    let mode = mode(&target, &[1.2, 0.0], 100).expect("a mode");
    let draws = drawn_around(&target, &mode, 3, 200);
    let on_the_other = draws.iter().filter(|draw| draw.u[0] < 0.0).count();
    assert!(
        draws.len() == 200 && (70..130).contains(&on_the_other),
        "{on_the_other} of {}",
        draws.len()
    );
}

#[test]
fn correlated_errors_are_worth_fewer_samples() {
    let covariance = |i: usize, j: usize| 4.0 * (-0.1 * i.abs_diff(j) as f64).exp();
    let errors = TraceErrors::new(&[10.0; 50], covariance).expect("a covariance");
    assert_eq!(errors.residuals(&[10.0; 50]), vec![0.0; 50]);
    // A shift by one standard deviation counts 1ᵀ C⁻¹ 1, which is 1 + (n − 1) (1 − r)/(1 + r) for an
    // Ornstein–Uhlenbeck process.
    let found: f64 = errors.residuals(&[12.0; 50]).iter().map(|r| r * r).sum();
    let r = (-0.1_f64).exp();
    assert!(
        (found - (1.0 + 49.0 * (1.0 - r) / (1.0 + r))).abs() < 1e-3,
        "{found}"
    );
    assert!(TraceErrors::new(&[], covariance).is_none());
}
