use super::*;
use crate::Interval;
use crate::lbfgsb;
use crate::polish::LocalSearch;
use crate::population::PopulationError;
use proptest::prelude::*;

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

/// A cost with an offset that meets the relative tolerance early, like the residual of a fit.
fn offset(x: &[f64]) -> f64 {
    1.0 + x
        .windows(2)
        .map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2))
        .sum::<f64>()
}

fn bounds(n: usize) -> Vec<Interval> {
    vec![Interval::new(-5.0, 10.0); n]
}

fn finish(mut de: DifferentialEvolution, f: impl Fn(&[f64]) -> f64) -> DifferentialEvolution {
    while de.stage() != Stage::Ended {
        let costs: Vec<f64> = de.ask().iter().map(|p| f(p)).collect();
        de.tell(&costs).unwrap();
    }
    de
}

fn start(n: usize, settings: Settings) -> DifferentialEvolution {
    DifferentialEvolution::new(&bounds(n), &[], settings).unwrap()
}

#[test]
fn evaluations_are_counted_as_in_the_paper() {
    // With D = 10, each population takes 150 evaluations and each gradient of the polish 11 (notes
    // to Table 1).
    for updating in [Updating::Deferred, Updating::Immediate] {
        let settings = Settings {
            updating,
            maxiter: 40,
            seed: 5,
            ..Settings::default()
        };
        let outcome = finish(start(10, settings), offset).outcome().unwrap();
        assert_eq!(outcome.ending, StopReason::Generations);
        assert_eq!(outcome.n_generations, 40);
        assert_eq!(
            outcome.n_evaluations,
            150 * 41 + outcome.n_polish_evaluations
        );
        assert!(
            outcome.n_polish_evaluations > 0 && outcome.n_polish_evaluations.is_multiple_of(11)
        );
    }
}

#[test]
fn a_batch_is_a_generation_or_a_point() {
    let mut deferred = start(3, Settings::default());
    let mut immediate = start(
        3,
        Settings {
            updating: Updating::Immediate,
            ..Settings::default()
        },
    );
    for de in [&mut deferred, &mut immediate] {
        assert_eq!((de.ask().len(), de.stage()), (45, Stage::FirstPopulation));
        let costs: Vec<f64> = de.ask().iter().map(|p| sphere(p)).collect();
        de.tell(&costs).unwrap();
    }
    assert_eq!((deferred.ask().len(), immediate.ask().len()), (45, 1));
}

#[test]
fn polish_lowers_the_cost_of_an_early_end() {
    let unpolished = finish(
        start(
            3,
            Settings {
                polish: vec![],
                ..Settings::default()
            },
        ),
        offset,
    )
    .outcome()
    .unwrap();
    let polished = finish(start(3, Settings::default()), offset)
        .outcome()
        .unwrap();
    assert_eq!(unpolished.ending, StopReason::Converged);
    assert!(!unpolished.polished && polished.polished);
    assert!(
        polished.cost < unpolished.cost && polished.cost - 1.0 < 1e-6,
        "{} {}",
        polished.cost,
        unpolished.cost
    );
    assert_eq!(
        polished.n_evaluations - polished.n_polish_evaluations,
        unpolished.n_evaluations
    );
}

#[test]
fn asking_twice_asks_the_same() {
    let mut de = start(2, Settings::default());
    for _ in 0..3 {
        let points = de.ask();
        assert_eq!(points, de.ask());
        de.tell(&points.iter().map(|p| sphere(p)).collect::<Vec<_>>())
            .unwrap();
    }
}

#[test]
fn seeds_differ_and_repeat() {
    let of = |seed| {
        finish(
            start(
                3,
                Settings {
                    seed,
                    maxiter: 20,
                    ..Settings::default()
                },
            ),
            sphere,
        )
    };
    assert_eq!(of(1), of(1));
    assert_ne!(of(1).best(), of(2).best());
}

#[test]
fn failures_are_the_worst_and_do_not_survive() {
    // A third of the box fails, in three ways.
    let f = |x: &[f64]| match x[0] {
        v if v < -3.0 => f64::NAN,
        v if v > 8.0 => f64::INFINITY,
        v if v > 6.0 => f64::NEG_INFINITY,
        _ => offset(x),
    };
    let outcome = finish(start(3, Settings::default()), f).outcome().unwrap();
    assert!(outcome.cost - 1.0 < 1e-6, "{outcome:?}");
    let hopeless = finish(
        start(
            2,
            Settings {
                maxiter: 5,
                ..Settings::default()
            },
        ),
        |_| f64::NAN,
    );
    let outcome = hopeless.outcome().unwrap();
    assert_eq!(
        (outcome.cost, outcome.ending, outcome.n_polish_evaluations),
        (f64::INFINITY, StopReason::Generations, 0)
    );
    assert_eq!(hopeless.spread(), f64::INFINITY);
}

#[test]
fn guesses_enter_the_first_population_cut_to_the_box() {
    let guesses = vec![vec![1.0, 2.0], vec![-50.0, 3.0]];
    let de = DifferentialEvolution::new(&bounds(2), &guesses, Settings::default()).unwrap();
    let points = de.ask();
    for (point, expected) in points.iter().zip([[1.0, 2.0], [-5.0, 3.0]]) {
        assert!(
            point
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-12),
            "{point:?}"
        );
    }
}

#[test]
fn an_interval_without_width_keeps_its_value_and_takes_no_members() {
    let bounds = [
        Interval::new(-5.0, 10.0),
        Interval::new(3.0, 3.0),
        Interval::new(-5.0, 10.0),
    ];
    let de = DifferentialEvolution::new(&bounds, &[], Settings::default()).unwrap();
    assert_eq!(de.ask().len(), 30);
    let outcome = finish(de, offset).outcome().unwrap();
    assert_eq!(outcome.parameters[1], 3.0);
}

#[test]
fn nonsense_is_refused_by_name() {
    let refused = |settings| {
        DifferentialEvolution::new(&bounds(2), &[], settings)
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
            mutation: [0.5, 2.5],
            ..Settings::default()
        })
        .contains("mutation is 2.5")
    );
    assert!(
        refused(Settings {
            recombination: 1.5,
            ..Settings::default()
        })
        .contains("recombination")
    );
    assert!(
        refused(Settings {
            tol: f64::NAN,
            ..Settings::default()
        })
        .contains("tol")
    );
    assert!(
        refused(Settings {
            maxiter: 0,
            ..Settings::default()
        })
        .contains("maxiter")
    );
    assert!(DifferentialEvolution::new(&[], &[], Settings::default()).is_err());
    assert!(DifferentialEvolution::new(&bounds(2), &[vec![1.0]], Settings::default()).is_err());
    let mut de = start(2, Settings::default());
    assert_eq!(
        de.tell(&[1.0]),
        Err(PopulationError::Costs {
            n_costs: 1,
            n_points: 30
        })
    );
    let mut ended = finish(
        start(
            2,
            Settings {
                maxiter: 2,
                ..Settings::default()
            },
        ),
        sphere,
    );
    assert_eq!(ended.tell(&[]), Err(PopulationError::Ended));
    assert!(ended.ask().is_empty());
}

#[test]
fn settings_are_read_with_defaults() {
    let settings: Settings = serde_json::from_str(r#"{"updating":"immediate","seed":7}"#).unwrap();
    assert_eq!(
        settings,
        Settings {
            updating: Updating::Immediate,
            seed: 7,
            ..Settings::default()
        }
    );
    let without: Settings = serde_json::from_str(r#"{"polish":[]}"#).unwrap();
    assert_eq!(without.polish, []);
    assert!(serde_json::from_str::<Settings>(r#"{"pop_size":7}"#).is_err());
}

proptest! {
    /// Points stay inside; storage after any batch, including failed evaluations, does not change
    /// the rest of the run.
    #[test]
    fn stays_inside_and_continues_from_storage(
        lower in -10.0..0.0f64, width in 1e-6..20.0f64, n in 1usize..5, seed: u64, immediate: bool, store_every in 1usize..40,
        fails_above in 0.0..20.0f64,
    ) {
        let bounds = vec![Interval::new(lower, lower + width); n];
        let settings = Settings {
            seed,
            maxiter: 15,
            updating: if immediate { Updating::Immediate } else { Updating::Deferred },
            polish: vec![LocalSearch {
                settings: lbfgsb::Settings { max_evaluations: 200, ..lbfgsb::Settings::default() },
                ..LocalSearch::default()
            }],
            ..Settings::default()
        };
        let f = |x: &[f64]| if x[0] > fails_above { f64::INFINITY } else { offset(x) + sphere(x) };
        let whole = finish(DifferentialEvolution::new(&bounds, &[], settings.clone()).unwrap(), f);
        let mut de = DifferentialEvolution::new(&bounds, &[], settings).unwrap();
        let mut n_batches = 0;
        while de.stage() != Stage::Ended {
            let points = de.ask();
            prop_assert!(points.iter().all(|p| p.iter().zip(&bounds).all(|(x, b)| b.contains(*x))));
            de.tell(&points.iter().map(|p| f(p)).collect::<Vec<_>>()).unwrap();
            n_batches += 1;
            if n_batches % store_every == 0 {
                let restored = serde_json::from_str(&serde_json::to_string(&de).unwrap()).unwrap();
                prop_assert_eq!(&de, &restored);
                de = restored;
            }
        }
        prop_assert_eq!(de.outcome(), whole.outcome());
        prop_assert_eq!(de, whole);
    }

    /// The best cost never rises from one generation to the next.
    #[test]
    fn the_best_never_gets_worse(seed: u64) {
        let mut de = start(3, Settings { seed, maxiter: 30, ..Settings::default() });
        let mut best = f64::INFINITY;
        while de.stage() != Stage::Ended {
            let costs: Vec<f64> = de.ask().iter().map(|p| offset(p)).collect();
            de.tell(&costs).unwrap();
            prop_assert!(de.best().1 <= best);
            best = de.best().1;
            prop_assert_eq!(best, offset(&de.best().0));
        }
    }
}
