//! Differential evolution and its polish against `SciPy`: 50 seeds per function in ten dimensions.
//! The header of `data/scipy_de.json` describes the script that recorded `SciPy`'s runs.

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::differential_evolution::{
    DifferentialEvolution, Outcome, Settings, Stage, StopReason, Updating,
};
use cardiotwin_calibrate::lbfgsb::{self, Lbfgsb};
use cardiotwin_calibrate::statistics::median;
use serde::Deserialize;
use std::f64::consts::{E, TAU};

const DIMENSION: usize = 10;
const N_SEEDS: usize = 50;
/// A run has found the minimum if its cost is within this distance of it.
const FOUND: f64 = 1e-6;

#[derive(Deserialize)]
struct Reference {
    differential_evolution: Vec<Evolution>,
    lbfgsb: Vec<Polish>,
}

#[derive(Deserialize)]
struct Evolution {
    function: String,
    updating: Updating,
    bounds: [f64; 2],
    nfev: Vec<f64>,
    nfev_polish: Vec<f64>,
    fun_above_minimum: Vec<f64>,
    converged: Vec<bool>,
}

#[derive(Deserialize)]
struct Polish {
    function: String,
    bounds: [f64; 2],
    x0: Vec<Vec<f64>>,
    nfev: Vec<f64>,
    fun: Vec<f64>,
}

fn reference() -> Reference {
    serde_json::from_str(include_str!("data/scipy_de.json")).unwrap()
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2)
        .map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2))
        .sum()
}

fn rastrigin(x: &[f64]) -> f64 {
    10.0 * x.len() as f64
        + x.iter()
            .map(|v| v * v - 10.0 * (TAU * v).cos())
            .sum::<f64>()
}

fn ackley(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let square = x.iter().map(|v| v * v).sum::<f64>() / n;
    let wave = x.iter().map(|v| (TAU * v).cos()).sum::<f64>() / n;
    -20.0 * (-0.2 * square.sqrt()).exp() - wave.exp() + 20.0 + E
}

fn function(name: &str) -> (fn(&[f64]) -> f64, f64) {
    match name {
        "sphere" => (|x| x.iter().map(|v| v * v).sum(), 0.0),
        "rosenbrock" => (rosenbrock, 0.0),
        "rastrigin" => (rastrigin, 0.0),
        "ackley" => (ackley, 0.0),
        "offset_rosenbrock" => (|x| 1.0 + rosenbrock(x), 1.0),
        "offset_rastrigin" => (|x| 1.0 + rastrigin(x), 1.0),
        other => panic!("no function {other}"),
    }
}

fn minimise(f: fn(&[f64]) -> f64, bounds: [f64; 2], updating: Updating, seed: u64) -> Outcome {
    let bounds = [Interval::new(bounds[0], bounds[1]); DIMENSION];
    let settings = Settings {
        updating,
        seed,
        ..Settings::default()
    };
    let mut de = DifferentialEvolution::new(&bounds, &[], settings).unwrap();
    while de.stage() != Stage::Ended {
        let costs: Vec<f64> = de.ask().iter().map(|p| f(p)).collect();
        de.tell(&costs).unwrap();
    }
    de.outcome().unwrap()
}

/// Standard normal deviate of the difference between two counts out of `N_SEEDS` each.
fn deviate(ours: usize, theirs: usize) -> f64 {
    let n = N_SEEDS as f64;
    let (a, b) = (ours as f64 / n, theirs as f64 / n);
    let pooled = 0.5 * (a + b);
    if pooled == 0.0 || pooled == 1.0 {
        0.0
    } else {
        (a - b) / (pooled * (1.0 - pooled) * 2.0 / n).sqrt()
    }
}

fn compare(name: &str, updating: Updating) {
    let reference = reference().differential_evolution;
    let theirs = reference
        .iter()
        .find(|e| e.function == name && e.updating == updating)
        .unwrap();
    let (f, minimum) = function(name);
    let ours: Vec<Outcome> = (0..N_SEEDS as u64)
        .map(|seed| minimise(f, theirs.bounds, updating, seed))
        .collect();

    for o in &ours {
        assert_eq!(
            o.n_evaluations - o.n_polish_evaluations,
            150 * (o.n_generations + 1),
            "{o:?}"
        );
        assert!(o.n_polish_evaluations.is_multiple_of(11), "{o:?}");
    }
    let without_polish = |all: &[f64], polish: &[f64]| -> Vec<f64> {
        all.iter().zip(polish).map(|(a, p)| a - p).collect()
    };
    let n: Vec<f64> = ours.iter().map(|o| o.n_evaluations as f64).collect();
    let n_polish: Vec<f64> = ours.iter().map(|o| o.n_polish_evaluations as f64).collect();
    let found = ours.iter().filter(|o| o.cost - minimum < FOUND).count();
    let found_theirs = theirs
        .fun_above_minimum
        .iter()
        .filter(|f| **f < FOUND)
        .count();
    let converged = ours
        .iter()
        .filter(|o| o.ending == StopReason::Converged)
        .count();
    let converged_theirs = theirs.converged.iter().filter(|c| **c).count();
    let evolution = median(&without_polish(&n, &n_polish));
    let evolution_theirs = median(&without_polish(&theirs.nfev, &theirs.nfev_polish));
    println!(
        "{name} {updating:?}: median evaluations {} (SciPy {}), without polish {evolution} ({evolution_theirs}), polish \
         {} ({}), found {found} ({found_theirs}), converged {converged} ({converged_theirs}) of {N_SEEDS}",
        median(&n),
        median(&theirs.nfev),
        median(&n_polish),
        median(&theirs.nfev_polish),
    );
    for (what, a, b) in [
        ("with polish", median(&n), median(&theirs.nfev)),
        ("without polish", evolution, evolution_theirs),
    ] {
        assert!(
            (a / b - 1.0).abs() <= 0.15,
            "{name} {updating:?}: {a} evaluations {what}, SciPy {b}"
        );
    }
    // One-sided at 1 %. The seeds are fixed, so that the result does not change between runs.
    assert!(
        deviate(found, found_theirs) > -2.33,
        "{name} {updating:?}: found {found}, SciPy {found_theirs}"
    );
    assert!(
        deviate(converged, converged_theirs) > -2.33,
        "{name} {updating:?}: {converged}, SciPy {converged_theirs}"
    );
}

macro_rules! comparisons {
    ($($test:ident: $name:literal $updating:ident;)*) => {
        $(#[test]
        fn $test() {
            compare($name, Updating::$updating);
        })*
    };
}

comparisons! {
    sphere: "sphere" Deferred;
    sphere_immediate: "sphere" Immediate;
    rosenbrock_valley: "rosenbrock" Deferred;
    rosenbrock_valley_immediate: "rosenbrock" Immediate;
    rastrigin_lattice: "rastrigin" Deferred;
    rastrigin_lattice_immediate: "rastrigin" Immediate;
    ackley_funnel: "ackley" Deferred;
    ackley_funnel_immediate: "ackley" Immediate;
    offset_rosenbrock: "offset_rosenbrock" Deferred;
    offset_rosenbrock_immediate: "offset_rosenbrock" Immediate;
    offset_rastrigin: "offset_rastrigin" Deferred;
    offset_rastrigin_immediate: "offset_rastrigin" Immediate;
}

#[test]
fn polish_alone_from_the_same_starts() {
    for theirs in reference().lbfgsb {
        let (f, _) = function(&theirs.function);
        let bounds = [Interval::new(theirs.bounds[0], theirs.bounds[1]); DIMENSION];
        let (mut n, mut lower) = (Vec::new(), 0);
        let mut n_success = 0;
        for (x0, fun) in theirs.x0.iter().zip(&theirs.fun) {
            let mut o = Lbfgsb::new(x0, &bounds, lbfgsb::Settings::default()).unwrap();
            while o.ending().is_none() {
                let costs: Vec<f64> = o.ask().iter().map(|p| f(p)).collect();
                o.tell(&costs).unwrap();
            }
            n.push(o.n_evaluations() as f64);
            n_success += usize::from(o.ending().unwrap().is_success());
            lower += usize::from(o.best().1 <= fun + 1e-4 * fun.abs().max(0.1));
        }
        let (ours, scipy) = (median(&n), median(&theirs.nfev));
        println!(
            "{} in {:?}: median evaluations {ours} (SciPy {scipy}), as low as SciPy in {lower}, success in {n_success}",
            theirs.function, theirs.bounds
        );
        assert!(
            (ours / scipy - 1.0).abs() <= 0.15,
            "{}: {ours} evaluations, SciPy {scipy}",
            theirs.function
        );
        // Rosenbrock's second minimum and Ackley's many minima trap some starts in either
        // implementation.
        assert!(
            lower >= 40,
            "{}: as low as SciPy in {lower} of {N_SEEDS} runs only",
            theirs.function
        );
        assert!(n_success >= 45, "{}: {n_success}", theirs.function);
    }
}
