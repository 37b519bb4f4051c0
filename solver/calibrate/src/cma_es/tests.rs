use super::*;
use crate::Interval;
use proptest::prelude::*;

fn start(n: usize, settings: Settings) -> CmaEs {
    CmaEs::new(&vec![Interval::new(-5.0, 10.0); n], &[], settings).unwrap()
}

fn finish(mut o: CmaEs, f: impl Fn(&[f64]) -> f64) -> CmaEs {
    while !o.is_ended() {
        let costs: Vec<f64> = o.ask().iter().map(|p| f(p)).collect();
        o.tell(&costs).unwrap();
    }
    o
}

fn valley(x: &[f64]) -> f64 {
    1.0 + x
        .windows(2)
        .map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2))
        .sum::<f64>()
}

#[test]
fn finds_a_valley_s_end() {
    let o = finish(start(5, Settings::default()), valley);
    assert!(
        o.best().1 - 1.0 < 1e-8 && o.ending() == Some(StopReason::Agreement),
        "{:?} {:?}",
        o.best(),
        o.run_costs()
    );
    assert!(o.run_costs().len() >= 2);
}

/// A rotated ellipsoid with axes 1 to 1000: without its covariance a strategy needs far more
/// evaluations.
#[test]
fn adapts_to_a_turned_ellipsoid() {
    let n = 6;
    let f = |x: &[f64]| {
        let turned = |i: usize| {
            x.iter()
                .enumerate()
                .map(|(j, v)| ((i * j) as f64 * 0.7).cos() * v)
                .sum::<f64>()
        };
        (0..n)
            .map(|i| 10f64.powf(6.0 * i as f64 / 5.0) * turned(i).powi(2))
            .sum::<f64>()
    };
    let settings = Settings {
        n_agreeing_runs: 1,
        ..Settings::default()
    };
    let o = finish(start(n, settings), f);
    assert!(
        o.best().1 < 1e-8 && o.n_evaluations() < 8000,
        "{:?} {}",
        o.best(),
        o.n_evaluations()
    );
}

/// The minimum lies in a corner of the box, on a face and inside.
#[test]
fn bounds_are_reached_exactly() {
    let f = |x: &[f64]| {
        1.0 + (x[0] - 12.0).powi(2)
            + (x[1] + 6.0).powi(2)
            + (x[2] - 2.0).powi(2)
            + 0.5 * x[0] * x[2]
    };
    let o = finish(start(3, Settings::default()), f);
    let (x, _) = o.best();
    // At x0 = 10 the condition is 2 (x2 - 2) + 5 = 0.
    assert_eq!((x[0], x[1]), (10.0, -5.0));
    assert!((x[2] + 0.5).abs() < 1e-4, "{x:?}");
}

#[test]
fn guesses_are_starts_and_failures_are_passed() {
    let bounds = vec![Interval::new(-5.0, 10.0); 2];
    let settings = Settings {
        first_deviation: 0.01,
        ..Settings::default()
    };
    let o = CmaEs::new(&bounds, &[vec![1.0, 20.0]], settings).unwrap();
    assert!(
        o.ask()
            .iter()
            .all(|p| (p[0] - 1.0).abs() < 1.0 && p[1] > 9.0)
    );
    let f = |x: &[f64]| {
        if x[0] > 2.0 || x[1] < -3.0 {
            f64::NAN
        } else {
            valley(x)
        }
    };
    assert!(finish(start(2, Settings::default()), f).best().1 - 1.0 < 1e-8);
    let hopeless = finish(
        start(
            2,
            Settings {
                max_evaluations: 2000,
                ..Settings::default()
            },
        ),
        |_| f64::NAN,
    );
    assert!(hopeless.best().1.is_infinite() && hopeless.ending() == Some(StopReason::Evaluations));
}

#[test]
fn an_interval_without_width_keeps_its_value() {
    let bounds = [
        Interval::new(-5.0, 10.0),
        Interval::new(3.0, 3.0),
        Interval::new(-5.0, 10.0),
    ];
    let o = finish(
        CmaEs::new(&bounds, &[], Settings::default()).unwrap(),
        valley,
    );
    assert_eq!(o.best().0[1], 3.0);
    let fixed = finish(
        CmaEs::new(&bounds[1..2], &[], Settings::default()).unwrap(),
        |x| x[0],
    );
    assert_eq!(fixed.best(), (vec![3.0], 3.0));
}

#[test]
fn nonsense_is_refused() {
    let refused = |settings| {
        CmaEs::new(&[Interval::new(0.0, 1.0)], &[], settings)
            .unwrap_err()
            .to_string()
    };
    assert!(
        refused(Settings {
            n_candidates: Some(3),
            ..Settings::default()
        })
        .contains("n_candidates is 3")
    );
    assert!(
        refused(Settings {
            first_deviation: 0.0,
            ..Settings::default()
        })
        .contains("first_deviation")
    );
    assert!(
        refused(Settings {
            n_agreeing_runs: 0,
            ..Settings::default()
        })
        .contains("n_agreeing_runs")
    );
    assert!(start(1, Settings::default()).tell(&[1.0]).is_err());
}

proptest! {
    /// Points stay inside; storage after any batch does not change the rest of the run; the best
    /// cost never rises.
    #[test]
    fn stays_inside_and_continues_from_storage(n in 1usize..4, seed: u64, store_every in 1usize..10, wall in 0.0..12.0f64) {
        let bounds = vec![Interval::new(-5.0, 10.0); n];
        let settings = Settings { seed, max_evaluations: 1000, ..Settings::default() };
        let f = |x: &[f64]| if x[0] > wall { f64::NAN } else { valley(x) - x[0] };
        let whole = finish(start(n, settings.clone()), f);
        let mut o = start(n, settings);
        let (mut n_batches, mut best) = (0, f64::INFINITY);
        while !o.is_ended() {
            let points = o.ask();
            prop_assert!(points.iter().all(|p| p.iter().zip(&bounds).all(|(x, b)| b.contains(*x))));
            o.tell(&points.iter().map(|p| f(p)).collect::<Vec<_>>()).unwrap();
            prop_assert!(o.best().1 <= best);
            best = o.best().1;
            n_batches += 1;
            if n_batches % store_every == 0 {
                o = serde_json::from_str(&serde_json::to_string(&o).unwrap()).unwrap();
            }
        }
        prop_assert_eq!(o, whole);
    }
}
