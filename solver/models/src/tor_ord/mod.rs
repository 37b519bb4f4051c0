//! ToR-ORd: potential and calcium of a human ventricular cell (Tomek et al. 2019, eLife 8:e48890), with the cross-bridges of
//! Land 2017 as their troponin (Margara et al. 2021, Prog Biophys Mol Biol 159:58).
//!
//! The cell is held at a stretch and paced until its beat repeats; its calcium then drives contraction in the organ.

mod cell;
mod currents;
mod gates;
mod parameters;
mod rates;
mod state;
mod step;
mod table;

pub use cell::{PacedBeat, PacingError, TOLERANCE, TorOrd};
pub use parameters::{CellType, Factors, Outside, Troponin};
pub use state::{N_STATES, STATES, State};
pub use step::SAMPLE_MS;
