//! A run's record to numbers ([`results`]), to HTML ([`html`]), and to tables for other programs
//! ([`export`]). A [`table`] is written once for all of them. The crate accesses neither store nor
//! network.

pub mod export;
pub mod html;
pub mod results;
pub mod table;
