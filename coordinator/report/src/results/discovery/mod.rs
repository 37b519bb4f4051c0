//! Evaluation of a search for missing effects: pooled evidence of many patients, faults of organ
//! and cell, and sentences.

pub mod faults;
pub mod finite_element;
pub mod paragraph;
pub mod pool;
pub mod words;
