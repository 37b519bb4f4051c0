//! Pressure and volume traces of any origin: which column is what, in which unit, and where the beat
//! begins. What the file does not tell is inferred from the numbers and said; what cannot be inferred
//! is asked for.

mod beat;
mod columns;
mod facts;
mod read;
mod rises;
mod told;
mod units;

pub use facts::{Fact, Origin, facts};
pub use read::{OwnTraces, read};
pub use told::{AsksFor, Choices, NotUnderstood, Question};
