//! Learns how the base model misses healthy hearts of other formulations.
//!
//! ```text
//! discrepancies FILE.json [--hearts N] [--seed N] [--jobs N] [--beats FILE] [--without FORMULATION]
//! ```
//!
//! `--beats` adds the finite-element ventricles of the worker's example `finite-element-hearts`;
//! `--without` leaves out `elastance`, `sarcomeres` or `finite-element`, to see how the search does
//! on a formulation from which nothing was learnt.
//!
//! For each formulation, the base is fitted to noise-free beats of N healthy hearts. The residuals
//! over the phases of the beat give one covariance a formulation, which is written as modes.

#[path = "../command/arguments.rs"]
mod arguments;
#[path = "../validation/self_consistent.rs"]
mod self_consistent;
#[path = "../validation/source.rs"]
#[allow(dead_code)]
mod source;
#[path = "../../../../solver/discover/tests/support/visibility.rs"]
#[allow(dead_code)]
mod visibility;

use cardiotwin_discover::Reduced;
use cardiotwin_discover::learnt::{Formulation, Learnt, Mode, NODES, place};
use cardiotwin_discover::least_squares::Settings;
use cardiotwin_discover::noise::{ErrorModel, Signal};
use cardiotwin_discover::phases::Phases;
use cardiotwin_discover::problem::{Data, Problem};
use cardiotwin_discover::search::fit_base;
use cardiotwin_validation::{Case, Hearts, Plan};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use source::Source;

/// Share of the variance that the modes keep.
const KEPT: f64 = 0.995;

fn main() -> Result<(), String> {
    let mut all = std::env::args().skip(1);
    let usage = "usage: discrepancies FILE.json [--hearts N] [--seed N] [--jobs N] [--beats FILE] [--without FORMULATION]";
    let file = all.next().ok_or(usage)?;
    let (mut n_hearts, mut seed, mut jobs) = (60usize, 900u64, 2usize);
    let (mut beats, mut without) = (None, String::new());
    for pair in arguments::pairs(all) {
        let (flag, value) = pair?;
        let number = || arguments::number(&flag, &value);
        match flag.as_str() {
            "--hearts" => n_hearts = number()?,
            "--seed" => seed = number()? as u64,
            "--jobs" => jobs = number()?,
            "--beats" => beats = Some(Source::beats(&value)?),
            "--without" => without = value,
            _ => return Err(format!("unknown argument {flag}\n{usage}")),
        }
    }
    let mut formulations = vec![
        ("elastance", Source::Loop(Hearts::Elastance)),
        ("sarcomeres", Source::Loop(Hearts::Sarcomeres)),
    ];
    formulations.extend(beats.map(|beats| ("finite-element", beats)));
    formulations.retain(|(name, _)| *name != without);
    arguments::limit_threads(jobs)?;
    let mut learnt = Learnt::default();
    for (name, source) in formulations {
        let cases = Plan::Nulls.cases(n_hearts, seed, source.hearts());
        let found: Vec<DVector<f64>> = cases
            .par_iter()
            .filter_map(|planned| residuals(&source.make(planned)?))
            .collect();
        eprintln!("{name}: {} of {n_hearts} hearts", found.len());
        let of_it = (found.iter())
            .map(|curve| curve * curve.transpose())
            .sum::<DMatrix<f64>>()
            / found.len() as f64;
        for (i, signal) in ["pressure", "volume"].iter().enumerate() {
            let sd: Vec<String> = (i * NODES..(i + 1) * NODES)
                .map(|k| format!("{:.2}", 100.0 * of_it[(k, k)].sqrt()))
                .collect();
            eprintln!("  {signal} sd, %: {}", sd.join(" "));
        }
        let modes = modes(of_it);
        eprintln!("  {} modes", modes.len());
        learnt.formulations.push(Formulation {
            name: name.to_owned(),
            modes,
        });
    }
    let text = serde_json::to_string(&learnt).map_err(|e| e.to_string())?;
    std::fs::write(&file, text + "\n").map_err(|e| format!("{file}: {e}"))
}

/// Residuals of a heart over the phases of the beat, data less model, in shares of the amplitude:
/// pressure, then volume.
fn residuals(case: &Case) -> Option<DVector<f64>> {
    let measured = visibility::noise_free(case);
    let forward = Reduced::new(&measured);
    let cycle = measured.cycle_ms;
    let data = Data::new(measured, &ErrorModel::default(), None);
    let problem = Problem {
        forward: &forward,
        data: &data,
    };
    let base = fit_base(&problem, &Settings::default())?;
    let beat = problem.predict(&base.structure, &base.values(), Some(&base.minimum.warm))?;
    let phases = Phases::of(&data.pressure, &data.volume, cycle);
    let over_nodes = |signal: &Signal, trace: &[f64]| {
        let residual = signal.residual(&beat.sampled(trace, &signal.time_ms));
        let (low, high) = signal.range();
        on_nodes(&residual, &signal.time_ms, &phases, cycle) / (high - low)
    };
    let both = [
        over_nodes(&data.pressure, &beat.pressure_mmhg),
        over_nodes(&data.volume, &beat.volume_ml),
    ];
    Some(DVector::from_iterator(
        2 * NODES,
        both.iter().flat_map(|curve| curve.iter().copied()),
    ))
}

/// Values at the nodes that are interpolated to the residuals with the least squares, and a little
/// smooth.
fn on_nodes(residual: &[f64], times_ms: &[f64], phases: &Phases, cycle_ms: f64) -> DVector<f64> {
    let mut normal = DMatrix::<f64>::zeros(NODES, NODES);
    let mut right = DVector::zeros(NODES);
    for (r, t) in residual.iter().zip(times_ms) {
        let (node, share) = place(phases, *t, cycle_ms);
        let next = (node + 1) % NODES;
        for (i, a) in [(node, 1.0 - share), (next, share)] {
            right[i] += a * r;
            for (j, b) in [(node, 1.0 - share), (next, share)] {
                normal[(i, j)] += a * b;
            }
        }
    }
    for i in 0..NODES {
        let (before, after) = ((i + NODES - 1) % NODES, (i + 1) % NODES);
        for (a, x) in [(before, -1.0), (i, 2.0), (after, -1.0)] {
            for (b, y) in [(before, -1.0), (i, 2.0), (after, -1.0)] {
                normal[(a, b)] += 0.05 * x * y;
            }
        }
    }
    normal.cholesky().expect("regular").solve(&right)
}

fn modes(covariance: DMatrix<f64>) -> Vec<Mode> {
    let eigen = covariance.symmetric_eigen();
    let mut order: Vec<usize> = (0..2 * NODES).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let total: f64 = eigen.eigenvalues.iter().sum();
    let mut kept = 0.0;
    let mut modes = Vec::new();
    for i in order {
        if kept >= KEPT * total {
            break;
        }
        kept += eigen.eigenvalues[i];
        let scale = eigen.eigenvalues[i].max(0.0).sqrt();
        let rounded = |v: &f64| (v * scale * 1e6).round() / 1e6;
        let mut both: Vec<f64> = eigen.eigenvectors.column(i).iter().map(rounded).collect();
        let volume = both.split_off(NODES);
        modes.push(Mode {
            pressure: both,
            volume,
        });
    }
    modes
}
