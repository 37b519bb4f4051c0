//! Preparation of continuous recordings: from many beats to one beat of pressure and volume
//! (docs/prepare.md).
//!
//! Each step has a module with a pure function that reports its changes. Beats are found
//! ([`beats`]), selected ([`reject`]), corrected for drift ([`drift`]) and averaged ([`average`]),
//! with an estimate of the noise ([`noise`]). Cine volumes are adjusted to the whole-heart image
//! ([`volume`]), their cycle is adapted to the catheter's ([`cycle`]), and both are synchronised by
//! the events of the valves ([`events`], [`ejection`], [`synchronise`]). [`prepare()`] carries out
//! these steps in this order.
#![deny(missing_docs)]

pub mod average;
pub mod beats;
pub mod cine;
pub mod cycle;
pub mod drift;
pub mod ejection;
pub mod events;
mod filter;
pub mod hum;
mod landmarks;
pub mod noise;
pub mod prepare;
mod r_waves;
pub mod recording;
pub mod reject;
pub mod synchronise;
mod upstrokes;
pub mod volume;

pub use prepare::{Prepared, Raw, prepare};
pub use recording::Recording;
