//! Comparison of differential evolution (both kinds of updating) and CMA-ES on four
//! functions of ten parameters. Each has a minimum of one away from the middle of the box. The
//! output is the number of successes (to 1e-6) and the evaluations over 50 seeds.
//!
//! `cargo run --release --manifest-path dev/Cargo.toml --example optimiser-comparison`

use cardiotwin_calibrate::cma_es::{self, CmaEs};
use cardiotwin_calibrate::differential_evolution::{self, DifferentialEvolution, Stage, Updating};
use cardiotwin_calibrate::{Interval, statistics::median};
use std::f64::consts::{E, TAU};

const DIMENSION: usize = 10;
const N_SEEDS: u64 = 50;

type Function = fn(&[f64]) -> f64;

fn sphere(x: &[f64]) -> f64 {
    1.0 + x.iter().map(|v| (v - 1.0).powi(2)).sum::<f64>()
}

fn rosenbrock(x: &[f64]) -> f64 {
    1.0 + x
        .windows(2)
        .map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2))
        .sum::<f64>()
}

fn rastrigin(x: &[f64]) -> f64 {
    1.0 + x
        .iter()
        .map(|v| 10.0 + (v - 1.0).powi(2) - 10.0 * (TAU * (v - 1.0)).cos())
        .sum::<f64>()
}

fn ackley(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let square = x.iter().map(|v| (v - 1.0).powi(2)).sum::<f64>() / n;
    let wave = x.iter().map(|v| (TAU * (v - 1.0)).cos()).sum::<f64>() / n;
    1.0 - 20.0 * (-0.2 * square.sqrt()).exp() - wave.exp() + 20.0 + E
}

/// Best cost and number of evaluations of one run.
fn run(strategy: &str, f: Function, bounds: &[Interval], seed: u64) -> (f64, usize) {
    let costs = |points: Vec<Vec<f64>>| points.iter().map(|p| f(p)).collect::<Vec<_>>();
    match strategy {
        "CMA-ES" => {
            let mut o = CmaEs::new(
                bounds,
                &[],
                cma_es::Settings {
                    seed,
                    ..Default::default()
                },
            )
            .unwrap();
            while !o.is_ended() {
                o.tell(&costs(o.ask())).unwrap();
            }
            (o.best().1, o.n_evaluations())
        }
        _ => {
            let updating = if strategy == "DE immediate" {
                Updating::Immediate
            } else {
                Updating::Deferred
            };
            let settings = differential_evolution::Settings {
                seed,
                updating,
                ..Default::default()
            };
            let mut o = DifferentialEvolution::new(bounds, &[], settings).unwrap();
            while o.stage() != Stage::Ended {
                o.tell(&costs(o.ask())).unwrap();
            }
            (o.best().1, o.n_evaluations())
        }
    }
}

fn main() {
    let functions: [(&str, Function, [f64; 2]); 4] = [
        ("sphere", sphere, [-5.0, 10.0]),
        ("rosenbrock", rosenbrock, [-5.0, 10.0]),
        ("rastrigin", rastrigin, [-5.12, 5.12]),
        ("ackley", ackley, [-30.0, 32.0]),
    ];
    println!(
        "{:<12}{:<14}{:>8}{:>20}{:>14}",
        "function", "strategy", "found", "median evaluations", "largest"
    );
    for (name, f, [low, high]) in functions {
        let bounds = [Interval::new(low, high); DIMENSION];
        for strategy in ["DE deferred", "DE immediate", "CMA-ES"] {
            let runs: Vec<(f64, usize)> = (0..N_SEEDS)
                .map(|seed| run(strategy, f, &bounds, seed))
                .collect();
            let found = runs.iter().filter(|r| r.0 - 1.0 < 1e-6).count();
            let evaluations: Vec<f64> = runs.iter().map(|r| r.1 as f64).collect();
            let largest = evaluations.iter().copied().fold(0.0, f64::max);
            println!(
                "{name:<12}{strategy:<14}{found:>5}/{N_SEEDS}{:>20}{largest:>14}",
                median(&evaluations)
            );
        }
    }
}
