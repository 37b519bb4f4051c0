//! Findings of a search for missing effects: evidence of many patients together, and words.

#[cfg(test)]
pub mod fixture;
pub mod pool;
pub mod words;
