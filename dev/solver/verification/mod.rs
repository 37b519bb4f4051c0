//! Meshes and problems of the verification, shared by tests, examples and benchmarks.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each of the three uses a part of it"
)]

pub mod beat;
pub mod land_cube;
pub mod meshes;
pub mod motion;
pub mod patches;
pub mod problems;
pub mod sphere;
pub mod symmetric;
pub mod volume_trials;
