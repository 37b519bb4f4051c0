//! A run's record to numbers ([`results`]), to HTML ([`html`]), and to tables for other programs
//! ([`export`]). The crate accesses neither store nor network.

pub mod export;
pub mod html;
pub mod results;
