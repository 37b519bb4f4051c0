//! Profiles of costs whose near-optimal sets are known.

use super::*;
use proptest::prelude::*;

fn profiled(
    f: impl Fn(&[f64]) -> f64,
    best: &[f64],
    bounds: &[Interval],
    settings: Settings,
) -> Profile {
    let mut profile = Profile::new(best, f(best), bounds, settings).unwrap();
    let mut n_batches = 0;
    while !profile.is_ended() {
        let points = profile.ask();
        assert!(
            points
                .iter()
                .all(|p| p.iter().zip(bounds).all(|(x, b)| b.contains(*x)))
        );
        profile
            .tell(&points.iter().map(|p| f(p)).collect::<Vec<_>>())
            .unwrap();
        n_batches += 1;
        assert!(n_batches < 2000);
    }
    assert!(profile.ask().is_empty());
    profile
}

fn settings(absolute_rise: f64) -> Settings {
    Settings {
        absolute_rise,
        relative_rise: 0.0,
        precision: 1e-3,
        ..Settings::default()
    }
}

fn value(end: ProfileEnd) -> f64 {
    match end {
        ProfileEnd::Value(v) => v,
        ProfileEnd::Bound => panic!("the profile has no end"),
    }
}

/// A tilted quadratic valley: the profile of x² + 2ρxy + y² is (1 - ρ²) x², wider than the cost
/// with y held.
#[test]
fn ends_of_a_correlated_quadratic() {
    let rho = 0.9;
    let f = |x: &[f64]| x[0] * x[0] + 2.0 * rho * x[0] * x[1] + x[1] * x[1];
    let bounds = [Interval::new(-4.0, 6.0), Interval::new(-5.0, 5.0)];
    let outcome = profiled(f, &[0.0, 0.0], &bounds, settings(0.1))
        .outcome()
        .unwrap();
    let expected = f64::sqrt(0.1 / (1.0 - rho * rho));
    for p in &outcome {
        assert!(
            (value(p.upper) - expected).abs() < 0.02 && (value(p.lower) + expected).abs() < 0.02,
            "{p:?}"
        );
        assert_eq!((p.mark, p.bound), (Mark::Determined, None));
        assert!((p.share - 0.2 * expected).abs() < 4e-3);
    }
}

/// x and y act only through their product; z is determined; the data push w beyond its bound; v has
/// no effect.
#[test]
fn marks_of_four_kinds() {
    let f = |x: &[f64]| {
        (x[0] * x[1] - 1.0).powi(2) + 10.0 * (x[2] - 3.0).powi(2) + (x[3] - 1.2).powi(2)
    };
    let bounds = [
        Interval::new(0.2, 5.0),
        Interval::new(0.2, 5.0),
        Interval::new(0.0, 10.0),
        Interval::new(0.0, 1.0),
        Interval::new(-1.0, 1.0),
    ];
    let profile = profiled(f, &[1.0, 1.0, 3.0, 1.0, 0.3], &bounds, settings(0.01));
    let outcome = profile.outcome().unwrap();
    let marks: Vec<Mark> = outcome.iter().map(|p| p.mark).collect();
    assert_eq!(
        marks,
        [
            Mark::Sloppy,
            Mark::Sloppy,
            Mark::Determined,
            Mark::AtBound,
            Mark::Sloppy
        ]
    );
    assert_eq!(
        (outcome[0].lower, outcome[0].upper),
        (ProfileEnd::Bound, ProfileEnd::Bound)
    );
    assert_eq!(
        (outcome[3].bound, outcome[3].upper),
        (Some(Bound::Upper), ProfileEnd::Bound)
    );
    // (w - 1.2)² rises from 0.04 to 0.05.
    assert!(
        (value(outcome[3].lower) - (1.2 - 0.05f64.sqrt())).abs() < 2e-3,
        "{:?}",
        outcome[3]
    );
    assert!((outcome[4].share - 1.0).abs() < 1e-12);
    assert!(
        profile.better().is_none() && profile.n_evaluations() < 3000,
        "{}",
        profile.n_evaluations()
    );
}

#[test]
fn a_fit_that_had_not_ended_shows() {
    let f = |x: &[f64]| (x[0] - 1.0).powi(2) + (x[1] + 1.0).powi(2);
    let profile = profiled(
        f,
        &[0.9, -0.8],
        &[Interval::new(-3.0, 3.0); 2],
        settings(0.01),
    );
    let (set, cost) = profile.better().unwrap();
    assert!(cost < f(&[0.9, -0.8]) && f(set) == cost);
}

#[test]
fn walls_of_failures_end_a_profile() {
    let f = |x: &[f64]| {
        if x[0] > 0.5 {
            f64::NAN
        } else {
            0.1 * x[1] * x[1]
        }
    };
    let outcome = profiled(
        f,
        &[0.0, 0.0],
        &[Interval::new(-1.0, 1.0); 2],
        settings(0.01),
    )
    .outcome()
    .unwrap();
    assert!(
        (value(outcome[0].upper) - 0.5).abs() < 2e-3 && outcome[0].lower == ProfileEnd::Bound,
        "{outcome:?}"
    );
}

#[test]
fn one_parameter_and_one_without_width() {
    let single = profiled(
        |x| x[0] * x[0],
        &[0.0],
        &[Interval::new(-2.0, 2.0)],
        settings(0.04),
    )
    .outcome()
    .unwrap();
    assert!(
        (value(single[0].upper) - 0.2).abs() < 4e-3 && (value(single[0].lower) + 0.2).abs() < 4e-3
    );
    let bounds = [Interval::new(-2.0, 2.0), Interval::new(7.0, 7.0)];
    let outcome = profiled(|x| x[0] * x[0] + x[1], &[0.0, 7.0], &bounds, settings(0.04))
        .outcome()
        .unwrap();
    assert_eq!(outcome.len(), 1);
    assert!((value(outcome[0].upper) - 0.2).abs() < 4e-3);
}

#[test]
fn nonsense_is_refused() {
    let bounds = [Interval::new(0.0, 1.0)];
    let refused =
        |best: &[f64], cost, settings| Profile::new(best, cost, &bounds, settings).unwrap_err();
    assert_eq!(
        refused(&[0.5], f64::INFINITY, Settings::default()),
        IdentifiabilityError::NoBest
    );
    assert!(matches!(
        refused(&[], 0.0, Settings::default()),
        IdentifiabilityError::Dimension { .. }
    ));
    let error = refused(
        &[0.5],
        0.0,
        Settings {
            first_step: 0.0,
            ..Settings::default()
        },
    );
    assert!(error.to_string().contains("first_step is 0"));
    let mut profile = Profile::new(&[0.5], 0.0, &bounds, Settings::default()).unwrap();
    assert!(matches!(
        profile.tell(&[]),
        Err(IdentifiabilityError::Costs {
            n_costs: 0,
            n_points: 2
        })
    ));
    assert_eq!(
        near_optimal(&[], &bounds, &Settings::default()),
        Err(IdentifiabilityError::NoBest)
    );
    let infinite = [(vec![0.5], f64::INFINITY)];
    assert_eq!(
        near_optimal(&infinite, &bounds, &Settings::default()),
        Err(IdentifiabilityError::NoBest)
    );
    assert!(near_optimal(&[(vec![], 0.0)], &bounds, &Settings::default()).is_err());
}

/// Results of six seeds, one of them stuck elsewhere.
#[test]
fn spread_of_results() {
    let bounds = [
        Interval::new(0.0, 10.0),
        Interval::new(0.0, 1.0),
        Interval::new(0.0, 1.0),
    ];
    let sets: Vec<(Vec<f64>, f64)> = vec![
        (vec![5.0, 0.2, 1.0], 0.100),
        (vec![5.1, 0.9, 0.999_5], 0.101),
        (vec![4.9, 0.5, 1.0], 0.104),
        (vec![5.0, 0.7, 0.98], 0.109),
        (vec![9.0, 0.1, 0.1], 0.2),
        (vec![1.0, 0.1, 0.1], f64::NAN),
    ];
    let near = near_optimal(&sets, &bounds, &Settings::default()).unwrap();
    assert_eq!(
        (near.n_near_optimal, near.n_sets, near.best_cost),
        (4, 6, 0.1)
    );
    let marks: Vec<Mark> = near.parameters.iter().map(|p| p.mark).collect();
    assert_eq!(marks, [Mark::Determined, Mark::Sloppy, Mark::AtBound]);
    let first = near.parameters[0];
    assert_eq!(
        (first.best, first.minimum, first.maximum, first.mean),
        (5.0, 4.9, 5.1, 5.0)
    );
    assert!((first.standard_deviation.unwrap() - (0.02f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!((near.parameters[1].share - 0.7).abs() < 1e-12);
    assert_eq!(near.parameters[2].bound, Some(Bound::Upper));
}

proptest! {
    /// Storage after any batch does not change the rest of the run.
    #[test]
    fn continues_from_storage(a in 0.2..3.0f64, b in -0.9..0.9f64, store_every in 1usize..5) {
        let f = |x: &[f64]| a * x[0] * x[0] + b * x[0] * x[1] + x[1] * x[1];
        let bounds = [Interval::new(-2.0, 3.0); 2];
        let settings = Settings { precision: 0.02, ..settings(0.05) };
        let whole = profiled(f, &[0.0, 0.0], &bounds, settings);
        let mut profile = Profile::new(&[0.0, 0.0], 0.0, &bounds, settings).unwrap();
        let mut n_batches = 0;
        while !profile.is_ended() {
            let costs: Vec<f64> = profile.ask().iter().map(|p| f(p)).collect();
            profile.tell(&costs).unwrap();
            n_batches += 1;
            if n_batches % store_every == 0 {
                profile = serde_json::from_str(&serde_json::to_string(&profile).unwrap()).unwrap();
            }
        }
        prop_assert_eq!(profile, whole);
    }
}
