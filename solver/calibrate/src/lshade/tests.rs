use super::memory::{Memory, Success};
use super::*;
use crate::Interval;
use crate::random::{Purpose, generator};
use proptest::prelude::*;

fn finish(mut o: LShade, f: impl Fn(&[f64]) -> f64) -> LShade {
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

fn start(n: usize, settings: Settings) -> LShade {
    LShade::new(&vec![Interval::new(-5.0, 10.0); n], &[], settings).unwrap()
}

#[test]
fn finds_a_valley_s_end_and_a_corner() {
    let o = finish(start(5, Settings::default()), valley);
    assert!(
        o.best().1 - 1.0 < 1e-8 && o.is_converged(),
        "{:?}",
        o.best()
    );
    assert!(o.n_evaluations() <= 30_000 + 90 + 15_000);
    let corner = finish(start(3, Settings::default()), |x| x.iter().sum());
    assert!(
        corner.best().0.iter().all(|v| (v + 5.0).abs() < 1e-6),
        "{:?}",
        corner.best()
    );
}

#[test]
fn the_population_shrinks_with_the_budget() {
    let settings = Settings {
        max_evaluations: 2000,
        tol: 0.0,
        polish: vec![],
        ..Settings::default()
    };
    let mut o = start(4, settings);
    let mut sizes = vec![];
    while !o.is_ended() {
        let points = o.ask();
        sizes.push(points.len());
        o.tell(&points.iter().map(|p| valley(p)).collect::<Vec<_>>())
            .unwrap();
    }
    assert!(
        sizes[0] == 72 && sizes.windows(2).all(|w| w[1] <= w[0]) && *sizes.last().unwrap() <= 8,
        "{sizes:?}"
    );
    assert!((2000..2010).contains(&o.n_evaluations()) && !o.is_converged());
}

#[test]
fn guesses_begin_and_failures_do_not_survive() {
    let bounds = vec![Interval::new(-5.0, 10.0); 2];
    let o = LShade::new(&bounds, &[vec![1.0, 99.0]], Settings::default()).unwrap();
    assert!(
        o.ask()[0]
            .iter()
            .zip([1.0, 10.0])
            .all(|(a, b)| (a - b).abs() < 1e-12)
    );
    let f = |x: &[f64]| {
        if x[0] > 2.0 || x[1] < -3.0 {
            f64::NAN
        } else {
            valley(x)
        }
    };
    assert!(finish(o, f).best().1 - 1.0 < 1e-8);
    let settings = Settings {
        max_evaluations: 500,
        ..Settings::default()
    };
    let hopeless = finish(start(2, settings), |_| f64::INFINITY);
    assert!(hopeless.best().1.is_infinite() && !hopeless.is_converged());
}

#[test]
fn nonsense_is_refused() {
    let refused = |settings| {
        LShade::new(&[Interval::new(0.0, 1.0)], &[], settings)
            .unwrap_err()
            .to_string()
    };
    assert!(
        refused(Settings {
            popsize: 0,
            ..Settings::default()
        })
        .contains("popsize is 0")
    );
    assert!(
        refused(Settings {
            best_share: 0.0,
            ..Settings::default()
        })
        .contains("best_share")
    );
    assert!(
        refused(Settings {
            n_memory: 0,
            ..Settings::default()
        })
        .contains("n_memory")
    );
    assert!(
        refused(Settings {
            max_evaluations: 0,
            ..Settings::default()
        })
        .contains("max_evaluations")
    );
    let mut o = start(1, Settings::default());
    assert!(o.tell(&[1.0]).is_err());
}

/// A memory in which only large scales have succeeded draws large scales; weights count.
#[test]
fn memory_learns_what_succeeds() {
    let mut memory = Memory::new(2);
    let success = |scale, rate, fall| Success { scale, rate, fall };
    for _ in 0..2 {
        memory.learn(&[
            success(0.9, 0.2, 10.0),
            success(0.1, 0.2, 1e-9),
            success(0.9, 0.2, f64::INFINITY),
        ]);
    }
    let mut random = generator(1, Purpose::AdaptiveTrials, [0, 0]);
    let (mut scales, mut rates): (Vec<f64>, Vec<f64>) =
        (0..400).map(|_| memory.draw(&mut random)).unzip();
    scales.sort_by(f64::total_cmp);
    rates.sort_by(f64::total_cmp);
    assert!(
        (scales[200] - 0.9).abs() < 0.03 && (rates[200] - 0.2).abs() < 0.03,
        "{} {}",
        scales[200],
        rates[200]
    );
    assert!(
        scales.iter().all(|s| *s > 0.0 && *s <= 1.0)
            && rates.iter().all(|r| (0.0..=1.0).contains(r))
    );
    // A cell in which only a rate of zero has succeeded keeps that rate.
    for _ in 0..2 {
        memory.learn(&[success(0.5, 0.0, 1.0)]);
    }
    memory.learn(&[success(0.5, 0.7, 1.0)]);
    assert!((0..50).all(|_| memory.draw(&mut random).1 == 0.0));
}

proptest! {
    /// Points stay inside; storage after any batch does not change the rest of the run; the best
    /// cost never rises.
    #[test]
    fn stays_inside_and_continues_from_storage(n in 1usize..4, seed: u64, store_every in 1usize..10, wall in 0.0..12.0f64) {
        let bounds = vec![Interval::new(-5.0, 10.0); n];
        let settings = Settings { seed, max_evaluations: 1500, ..Settings::default() };
        let f = |x: &[f64]| if x[0] > wall { f64::NAN } else { valley(x) + x[0] * x[0] };
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
