//! Discrepancies learnt on healthy hearts: how the base model misses a heart of another formulation
//! that lacks no effect of the catalogue.
//!
//! The base is fitted to noise-free beats of such hearts (`examples/discrepancies`). What the fits
//! leave is averaged over the formulations with equal weights, as covariances over the phases of the
//! beat: of pressure in shares of its amplitude, and of volume in shares of the stroke volume. They
//! may be part of the covariance of every fit ([`crate::settings::Settings::learnt`]), so that an
//! effect that only resembles the gap between two formulations has no evidence (Kennedy and O'Hagan 2001, J R Stat Soc B 63:425; with a prior
//! of the discrepancy, as Brynjarsdottir and O'Hagan 2014, Inverse Probl 30:114007, ask for).

use crate::noise::Signal;
use crate::phases::Phases;
use serde::{Deserialize, Serialize};

/// Nodes of a phase of the beat.
pub const PER_PHASE: usize = 4;
/// Nodes of the beat.
pub const NODES: usize = 7 * PER_PHASE;

/// Modes of the discrepancy of pressure and volume: each is a curve over the nodes of the beat, and
/// the covariance is the sum of their outer products.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Learnt {
    /// Modes of the pressure, in shares of its amplitude.
    pub pressure: Vec<Vec<f64>>,
    /// Modes of the volume, in shares of the stroke volume.
    pub volume: Vec<Vec<f64>>,
}

/// Node before a time of the beat, and the way to the next one.
#[must_use]
pub fn place(phases: &Phases, time_ms: f64, cycle_ms: f64) -> (usize, f64) {
    let begin = phases.beginnings();
    let i = phases.at(time_ms, cycle_ms);
    let since = (time_ms - begin[i]).rem_euclid(cycle_ms);
    let length = (begin[(i + 1) % 7] - begin[i])
        .rem_euclid(cycle_ms)
        .max(1e-3);
    let x = (since / length).clamp(0.0, 1.0 - 1e-9) * PER_PHASE as f64;
    (i * PER_PHASE + x as usize, x.fract())
}

/// Values of a mode at some times.
fn at(mode: &[f64], times_ms: &[f64], phases: &Phases, cycle_ms: f64) -> Vec<f64> {
    times_ms
        .iter()
        .map(|t| {
            let (node, share) = place(phases, *t, cycle_ms);
            mode[node] * (1.0 - share) + mode[(node + 1) % NODES] * share
        })
        .collect()
}

impl Learnt {
    /// Pressure and volume of a cycle of this length \[ms\], whose covariances have the modes, too.
    #[must_use]
    pub fn widen(&self, [pressure, volume]: [Signal; 2], cycle_ms: f64) -> [Signal; 2] {
        if self.pressure.is_empty() && self.volume.is_empty() {
            return [pressure, volume];
        }
        let phases = Phases::of(&pressure, &volume, cycle_ms);
        let widened = |signal: Signal, modes: &[Vec<f64>]| {
            let (low, high) = signal.range();
            let curve = |mode: &Vec<f64>| {
                let curve = at(mode, &signal.time_ms, &phases, cycle_ms);
                curve.into_iter().map(|v| v * (high - low)).collect()
            };
            let curves: Vec<Vec<f64>> = modes.iter().map(curve).collect();
            signal.widened(&curves)
        };
        [
            widened(pressure, &self.pressure),
            widened(volume, &self.volume),
        ]
    }
}
