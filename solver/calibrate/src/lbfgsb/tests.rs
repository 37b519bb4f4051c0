use super::*;
use crate::Interval;
use proptest::prelude::*;

pub(crate) fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2)
        .map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2))
        .sum()
}

fn run(
    start: &[f64],
    bounds: &[Interval],
    settings: Settings,
    f: impl Fn(&[f64]) -> f64,
) -> Lbfgsb {
    let mut o = Lbfgsb::new(start, bounds, settings).unwrap();
    while o.ending().is_none() {
        let points = o.ask();
        assert_eq!(points.len(), start.len() + 1);
        assert!(
            points
                .iter()
                .all(|p| p.iter().zip(bounds).all(|(x, b)| b.contains(*x))),
            "left the box"
        );
        let costs: Vec<f64> = points.iter().map(|p| f(p)).collect();
        o.tell(&costs).unwrap();
    }
    assert!(o.ask().is_empty());
    o
}

#[test]
fn quadratic_is_solved_in_a_few_gradients() {
    let centre = [0.3, -0.7, 1.1];
    let f = |x: &[f64]| {
        x.iter()
            .zip(&centre)
            .enumerate()
            .map(|(i, (x, c))| (i + 1) as f64 * (x - c).powi(2))
            .sum()
    };
    let o = run(
        &[0.0; 3],
        &[Interval::new(-2.0, 2.0); 3],
        Settings::default(),
        f,
    );
    assert!(o.ending().unwrap().is_success());
    assert!(
        o.best()
            .0
            .iter()
            .zip(&centre)
            .all(|(x, c)| (x - c).abs() < 1e-5),
        "{:?}",
        o.best()
    );
    assert!(o.n_evaluations() <= 12 * 4, "{}", o.n_evaluations());
}

#[test]
fn rosenbrock_valley_is_followed() {
    let o = run(
        &[-1.2, 1.0, -1.2, 1.0],
        &[Interval::new(-5.0, 10.0); 4],
        Settings::default(),
        rosenbrock,
    );
    assert!(o.ending().unwrap().is_success());
    assert!(o.best().1 < 1e-6, "{:?}", o.best());
}

#[test]
fn a_minimum_beyond_a_bound_is_found_on_it() {
    // The unbounded minimum is (1, 1); for x0 <= 0.5 it is (0.5, 0.25).
    let bounds = [Interval::new(-2.0, 0.5), Interval::new(-2.0, 2.0)];
    let o = run(&[-1.0, 1.5], &bounds, Settings::default(), rosenbrock);
    assert!(o.ending().unwrap().is_success());
    let (x, f) = o.best();
    assert!(
        (x[0] - 0.5).abs() < 1e-9 && (x[1] - 0.25).abs() < 1e-4 && (f - 0.25).abs() < 1e-6,
        "{x:?} {f}"
    );
}

#[test]
fn a_start_at_the_minimum_costs_one_gradient() {
    let o = run(
        &[1.0, 1.0],
        &[Interval::new(-5.0, 5.0); 2],
        Settings::default(),
        rosenbrock,
    );
    assert_eq!(
        (o.ending(), o.n_evaluations()),
        (Some(StopReason::Gradient), 3)
    );
}

#[test]
fn failures_on_the_way_halve_the_step() {
    // The first step from the wall of a steep valley leads to a region where the cost cannot be
    // computed.
    let f = |x: &[f64]| {
        if x[0] > 2.0 {
            f64::NAN
        } else {
            (x[0] - 1.9).powi(2) * 50.0 + x[1] * x[1]
        }
    };
    let o = run(
        &[-4.0, 3.0],
        &[Interval::new(-5.0, 5.0); 2],
        Settings::default(),
        f,
    );
    assert!(
        (o.best().0[0] - 1.9).abs() < 1e-3,
        "{:?} {:?}",
        o.best(),
        o.ending()
    );
    let never = run(
        &[-4.0, 3.0],
        &[Interval::new(-5.0, 5.0); 2],
        Settings::default(),
        |_| f64::INFINITY,
    );
    assert_eq!(never.ending(), Some(StopReason::StartNotFinite));
}

#[test]
fn noise_is_survived_with_a_step_of_the_width() {
    let noisy = |x: &[f64]| rosenbrock(x) + 1e-9 * (1e7 * x.iter().sum::<f64>()).sin();
    let with = |step| {
        let settings = Settings {
            step,
            ..Settings::default()
        };
        run(
            &[-1.2, 1.0],
            &[Interval::new(-5.0, 10.0); 2],
            settings,
            noisy,
        )
        .best()
        .1
    };
    let (wide, narrow) = (
        with(DifferenceStep::OfWidth(1e-6)),
        with(DifferenceStep::Absolute(1e-8)),
    );
    assert!(wide < 1e-3 && wide < narrow, "{wide} {narrow}");
}

#[test]
fn limits_end_it() {
    let settings = Settings {
        max_iterations: 2,
        ..Settings::default()
    };
    let o = run(
        &[-1.2, 1.0],
        &[Interval::new(-5.0, 10.0); 2],
        settings,
        rosenbrock,
    );
    assert_eq!(
        (o.ending(), o.n_iterations()),
        (Some(StopReason::Iterations), 2)
    );
    let settings = Settings {
        max_evaluations: 10,
        ..Settings::default()
    };
    let o = run(
        &[-1.2, 1.0],
        &[Interval::new(-5.0, 10.0); 2],
        settings,
        rosenbrock,
    );
    assert_eq!(o.ending(), Some(StopReason::Evaluations));
}

#[test]
fn nonsense_is_refused() {
    assert!(matches!(
        Lbfgsb::new(&[0.0], &[Interval::new(0.0, 1.0); 2], Settings::default()),
        Err(LbfgsbError::Dimension {
            n_start: 1,
            n_bounds: 2
        })
    ));
    assert!(Lbfgsb::new(&[0.0], &[Interval::new(1.0, 0.0)], Settings::default()).is_err());
    let mut o = Lbfgsb::new(&[0.5], &[Interval::new(0.0, 1.0)], Settings::default()).unwrap();
    assert_eq!(
        o.tell(&[1.0]),
        Err(LbfgsbError::Costs {
            n_costs: 1,
            n_points: 2
        })
    );
    o.tell(&[1.0, 1.0]).unwrap();
    assert_eq!(o.tell(&[1.0, 1.0]), Err(LbfgsbError::Ended));
}

proptest! {
    #[test]
    fn stays_inside_never_rises_and_continues_from_storage(
        start in prop::collection::vec(-6.0..6.0f64, 3), lower in -4.0..0.0f64, width in 0.0..5.0f64, store_at in 1usize..30,
    ) {
        let bounds = [Interval::new(lower, lower + width); 3];
        let whole = run(&start, &bounds, Settings::default(), rosenbrock);
        let start_cost = rosenbrock(&start.iter().map(|x| bounds[0].clamp(*x)).collect::<Vec<_>>());
        prop_assert!(whole.best().1 <= start_cost);
        prop_assert_eq!(whole.best().1, rosenbrock(whole.best().0));
        let mut o = Lbfgsb::new(&start, &bounds, Settings::default()).unwrap();
        let mut n = 0;
        while o.ending().is_none() {
            let costs: Vec<f64> = o.ask().iter().map(|p| rosenbrock(p)).collect();
            o.tell(&costs).unwrap();
            n += 1;
            if n == store_at {
                o = serde_json::from_str(&serde_json::to_string(&o).unwrap()).unwrap();
            }
        }
        prop_assert_eq!(o, whole);
    }
}
