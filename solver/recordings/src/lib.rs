//! From continuous recordings of many beats to one beat of pressure and volume (docs/prepare.md).
//!
//! One file a step, each a pure function that says what it changed: beats are found ([`beats`]), judged ([`reject`]), freed of
//! drift ([`drift`]), averaged ([`average`]) with what they differ by ([`noise`]); cine volumes are adjusted to the whole-heart
//! image ([`volume`]), their cycle is brought to the catheter's ([`cycle`]), and both are synchronised by the valves'
//! events ([`events`], [`ejection`], [`synchronise`]). [`prepare()`] does them in this order.
#![deny(missing_docs)]

pub mod average;
pub mod beats;
pub mod cine;
pub mod cycle;
pub mod drift;
pub mod ejection;
pub mod events;
mod filter;
mod landmarks;
pub mod noise;
pub mod prepare;
mod r_waves;
pub mod recording;
pub mod reject;
pub mod synchronise;
pub mod table;
mod upstrokes;
pub mod volume;

pub use prepare::{Prepared, Raw, Settings, prepare};
pub use recording::Recording;
