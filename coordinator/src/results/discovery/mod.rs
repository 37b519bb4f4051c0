//! Findings of a search for missing effects: evidence of many patients together, faults of organ and cell, and words.

pub mod faults;
#[cfg(test)]
pub mod fixture;
pub mod pool;
pub mod words;
