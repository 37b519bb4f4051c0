//! Discrepancies learnt on healthy hearts: how the base model misses a heart of another formulation
//! that lacks no effect of the catalogue.
//!
//! The base is fitted to noise-free beats of such hearts (`examples/discrepancies`). The residuals of
//! the fits give one covariance a formulation, over the phases of the beat and of both signals:
//! pressure in shares of its amplitude, volume in shares of the stroke volume. Each of them is a
//! nameless competitor of the effects ([`crate::discrepancy`]), so that an effect that only
//! resembles the gap between two formulations has no name (Kennedy and O'Hagan 2001, J R Stat Soc B 63:425; with a prior of the
//! discrepancy, as Brynjarsdottir and O'Hagan 2014, Inverse Probl 30:114007, ask for).

use crate::noise::Signal;
use crate::phases::Phases;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Nodes of a phase of the beat.
pub const PER_PHASE: usize = 4;
/// Nodes of the beat.
pub const NODES: usize = 7 * PER_PHASE;

/// Discrepancies of formulations of the heart.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Learnt {
    /// Formulations, in no order.
    pub formulations: Vec<Formulation>,
}

/// Discrepancy of one formulation. Each mode is an error that pressure and volume share, and the
/// covariance is the sum of their outer products.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Formulation {
    /// Name of the formulation.
    pub name: String,
    /// Modes, in no order.
    pub modes: Vec<Mode>,
}

/// An error of the model, over the nodes of the beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mode {
    /// Error of the pressure, in shares of its amplitude.
    pub pressure: Vec<f64>,
    /// Error of the volume, in shares of the stroke volume.
    pub volume: Vec<f64>,
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
    /// Discrepancies of the base model on healthy hearts of three formulations: an elastance,
    /// sarcomeres in a sphere, and finite-element ventricles with Land's cells (`make
    /// learn-discrepancies`).
    ///
    /// # Panics
    /// Never: a test reads the file.
    #[must_use]
    pub fn healthy_hearts() -> Self {
        serde_json::from_str(include_str!("learnt.json")).expect("the built-in modes are valid")
    }
}

impl Learnt {
    /// The same discrepancies, each error times a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        for mode in self.formulations.iter_mut().flat_map(|f| &mut f.modes) {
            let values = mode.pressure.iter_mut().chain(&mut mode.volume);
            values.for_each(|value| *value *= factor);
        }
        self
    }
}

impl Formulation {
    /// Errors at the times of pressure, then volume, in their units; one column for each mode.
    ///
    /// - `cycle_ms`: length of the cycle
    #[must_use]
    pub fn errors(&self, [pressure, volume]: [&Signal; 2], cycle_ms: f64) -> DMatrix<f64> {
        let phases = Phases::of(pressure, volume, cycle_ms);
        let scaled = |signal: &Signal, mode: &[f64]| {
            let (low, high) = signal.range();
            let curve = at(mode, &signal.time_ms, &phases, cycle_ms);
            curve
                .into_iter()
                .map(move |v| v * (high - low))
                .collect::<Vec<f64>>()
        };
        let columns: Vec<DVector<f64>> = (self.modes.iter())
            .map(|mode| {
                let both = [
                    scaled(pressure, &mode.pressure),
                    scaled(volume, &mode.volume),
                ];
                DVector::from_vec(both.concat())
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_modes_cover_the_beat_and_are_a_few_percent() {
        let learnt = Learnt::healthy_hearts();
        assert_eq!(learnt.formulations.len(), 3);
        for Formulation { name, modes } in &learnt.formulations {
            assert!(modes.len() > 5, "{name}");
            for mode in modes {
                assert_eq!((mode.pressure.len(), mode.volume.len()), (NODES, NODES));
            }
            for node in 0..NODES {
                let sd = |of: fn(&Mode) -> &Vec<f64>| {
                    let squares = modes.iter().map(|mode| of(mode)[node].powi(2));
                    squares.sum::<f64>().sqrt()
                };
                let (pressure, volume) = (sd(|m| &m.pressure), sd(|m| &m.volume));
                assert!(
                    pressure < 0.06 && volume < 0.06,
                    "{name} {node}: {pressure} {volume}"
                );
            }
        }
    }
}
