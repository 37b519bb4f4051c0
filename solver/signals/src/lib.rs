//! Traces of a heartbeat: reading them, resampling them alike, their biomarkers, and checks of measured data.
//!
//! Everything here is pure apart from reading a file: the same trace gives the same biomarkers, whether it was
//! measured or simulated. The only difference between the two is stated by [`Continuation`]: a measured trace continues
//! periodically, a single simulated beat ends where it ends.

#![deny(missing_docs)]

pub mod active_stress;
pub mod biomarkers;
pub mod checks;
mod cycle;
pub mod elastance;
pub mod image;
pub mod noise_windows;
pub mod pressure_volume_loop;
pub mod problem;
pub mod read;
pub mod resample;
mod told;
pub mod trace;

pub use active_stress::{CalciumDurations, StressReading};
pub use biomarkers::{BeatBiomarkers, BiomarkerError, Flag};
pub use cardiotwin_vocabulary::biomarkers::NoiseWindows;
pub use cycle::Continuation;
pub use problem::{Position, Problem, Severity};
pub use read::{Origin, Reading, parse_trace, parse_trace_from, read_trace, read_trace_from};
pub use resample::resample;
pub use trace::{Quantity, Trace, TraceError};
