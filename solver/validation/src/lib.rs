//! Test patients with known hidden effects, from another formulation than the model that is fitted to them.
//!
//! A closed loop of four chambers: ventricles by time-varying elastance with a Hill-and-cosine activation and a curved
//! end-systolic relation, an atrium of its own, valves with inertia, an aorta of two compartments, veins and lungs. Nothing
//! of the fitted model is imported, and each effect is written anew in terms of this one: where both agree, it is not
//! because they share code. Pure: seeds in, arrays and labels out.
#![deny(missing_docs)]

pub mod activation;
pub mod circulation;
pub mod hidden;
pub mod measure;
pub mod patient;
pub mod plan;
pub mod random;
pub mod valve;

pub use measure::{Case, Side, Stated};
pub use plan::{Plan, PlannedCase};
