//! A paced cell and its periodic beat.

use super::currents::Strengths;
use super::rates::Cell;
use super::state::State;
use super::step::{SAMPLE_MS, beat};
use super::table::Table;
use super::{CellType, Factors, Outside, Troponin};
use crate::contraction::land2017::Equations;

/// Error of a step of first order, relative to a state's size, at which the step of second order is accepted. Steps of half
/// the length move peak calcium and the action potential by less than half a percent (`steps_of_half_the_length_…`).
pub const TOLERANCE: f64 = 3e-3;
/// Beats across which calcium must have stayed the same.
const N_COMPARED: usize = 10;
/// Change of calcium, relative to its peak, that counts as the same, from one beat to the next and across [`N_COMPARED`].
const SAME: f64 = 5e-4;
/// Beats after which a cell that still changes is given up: it alternates.
const N_MOST: usize = 1000;

/// A cell that is held at one stretch and paced.
#[derive(Debug, Clone)]
pub struct TorOrd {
    cell: Cell,
}

/// A beat of a cell that repeats itself.
#[derive(Debug, Clone, PartialEq)]
pub struct PacedBeat {
    /// State at the stimulus.
    pub start: State,
    /// Calcium of the cytosol every [`SAMPLE_MS`] from the stimulus on \[µM\].
    pub ca_um: Vec<f64>,
    /// Membrane potential at the same times \[mV\].
    pub v_mv: Vec<f64>,
    /// Number of beats before this one.
    pub n_beats: usize,
}

/// Reasons why a cell has no periodic beat.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PacingError {
    /// A state is not finite.
    #[error(
        "the cell's state is not finite in beat {beat} at a cycle of {cycle_ms} ms; give it less extreme factors"
    )]
    NotFinite {
        /// Number of the beat.
        beat: usize,
        /// Cycle length \[ms\].
        cycle_ms: f64,
    },
    /// The beat never repeats.
    #[error(
        "after {beats} beats at a cycle of {cycle_ms} ms the cell's calcium still changes by {percent:.2} % from beat to \
         beat; give it a longer cycle or less extreme factors"
    )]
    NotPeriodic {
        /// Number of beats.
        beats: usize,
        /// Cycle length \[ms\].
        cycle_ms: f64,
        /// Largest change of calcium in its last beat, in percent of the peak.
        percent: f64,
    },
}

impl TorOrd {
    /// A cell of one type.
    ///
    /// - `land`: its cross-bridges; `stretch`: fibre stretch at which it is held
    #[must_use]
    pub fn new(
        cell_type: CellType,
        factors: Factors,
        outside: Outside,
        troponin: Troponin,
        land: &Equations,
        stretch: f64,
    ) -> Self {
        let strengths = Strengths::new(cell_type, &factors, &outside, troponin);
        Self {
            cell: Cell {
                table: Table::new(cell_type),
                cell_type,
                factors,
                outside,
                strengths,
                land: *land,
                troponin,
                stretch,
            },
        }
    }

    /// One beat from `start`, with the state every [`SAMPLE_MS`] and at its end given to `sample`.
    ///
    /// Returns the end; a state that is not finite ends the beat early, and is returned.
    pub fn beat(
        &self,
        start: &State,
        cycle_ms: f64,
        tolerance: f64,
        sample: impl FnMut(f64, &State),
    ) -> State {
        beat(&self.cell, start, cycle_ms, tolerance, sample)
    }

    /// Paces the cell from rest until its calcium repeats.
    ///
    /// Chloride is constant, so that its currents carry a charge that no concentration counts: potassium rises by about a
    /// millimole in a thousand beats for ever, and calcium by a permille of its peak in a hundred. "Repeats" allows for it.
    ///
    /// # Errors
    /// [`PacingError`] for a cell whose state is not finite, or that alternates.
    pub fn periodic(&self, cycle_ms: f64) -> Result<PacedBeat, PacingError> {
        let mut start = State::resting(self.cell.cell_type);
        let mut history: Vec<Vec<f64>> = Vec::new();
        let mut change = f64::INFINITY;
        for n_beats in 0..N_MOST {
            let (mut ca_um, mut v_mv) = (Vec::new(), Vec::new());
            let end = self.beat(&start, cycle_ms, TOLERANCE, |time_ms, state| {
                // A cycle that is no multiple of the interval has a last state between two samples.
                if time_ms == ca_um.len() as f64 * SAMPLE_MS {
                    ca_um.push(state.ca_um());
                    v_mv.push(state.v_mv());
                }
            });
            if end.0.iter().any(|x| !x.is_finite()) {
                let beat = n_beats + 1;
                return Err(PacingError::NotFinite { beat, cycle_ms });
            }
            change = history
                .last()
                .map_or(f64::INFINITY, |last| difference(last, &ca_um));
            let earlier = history.len().checked_sub(N_COMPARED);
            let since = earlier.map_or(f64::INFINITY, |k| difference(&history[k], &ca_um));
            if change.max(since) <= SAME {
                return Ok(PacedBeat {
                    start,
                    ca_um,
                    v_mv,
                    n_beats,
                });
            }
            history.push(ca_um);
            if history.len() > N_COMPARED {
                history.remove(0);
            }
            start = end;
        }
        Err(PacingError::NotPeriodic {
            beats: N_MOST,
            cycle_ms,
            percent: 100.0 * change,
        })
    }
}

/// Largest difference of two transients, relative to the peak of the second.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let peak = b.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let largest = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    largest.fold(0.0, f64::max) / peak
}
