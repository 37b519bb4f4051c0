//! Elastance of the left ventricle and of its load: how a heart answers another load.
//!
//! - [`mod@line`]: end-systolic elastance Ees and volume intercept V0 of two or more beats at different
//!   loads, and preload-recruitable stroke work
//! - [`internal_resistance`]: pressure that a ventricle loses to its own ejection, of beats at
//!   different loads
//! - [`single_beat`]: estimates of Ees from one beat, as a clinic has it
//! - [`arterial`]: effective arterial elastance
//! - [`normal`]: values of human hearts
//! - [`summary`]: all of them for one patient
//!
//! Pressure is in mmHg, volume in mL, time in ms. `docs/sources.md` says what was read of each
//! publication.

pub mod arterial;
pub mod beat;
pub mod end_systole;
pub mod internal_resistance;
pub mod line;
pub mod normal;
mod regression;
pub mod single_beat;
pub mod summary;

#[cfg(test)]
mod model_heart;
#[cfg(test)]
mod properties;

pub use beat::{Beat, BeatError};
pub use end_systole::{EndSystole, InterceptError, end_systole};
pub use line::{EndSystolicLine, LineError, PreloadRecruitableStrokeWork};
