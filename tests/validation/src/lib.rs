//! Test patients with known hidden effects, from a formulation that differs from the fitted model.
//!
//! The heart is a closed loop of four chambers. Ventricles have a time-varying elastance with a
//! Hill-and-cosine activation and a curved end-systolic relation; the loop also has an atrium,
//! valves with inertia, an aorta of two compartments, veins and lungs. Nothing of the fitted model
//! is imported, and each effect is formulated again for this heart, so that agreement cannot come
//! from shared code. The functions are pure: they map seeds to arrays and labels.
#![deny(missing_docs)]

pub mod activation;
pub mod circulation;
pub mod further;
pub mod hidden;
pub mod measure;
pub mod patient;
pub mod plan;
pub mod random;
pub mod sarcomere;
pub mod simulated;
pub mod valve;

pub use further::{Further, Measurement};
pub use measure::{Case, Side, Stated};
pub use patient::Hearts;
pub use plan::{Plan, PlannedCase};
