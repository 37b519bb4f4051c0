//! The 0D electromechanical cell (Land active, Land passive, Rice calcium) for many parameter sets at once.
//!
//! Each cell takes a lane of a SIMD vector and runs there at its own pace: own time, own step length, own number of beats.
//! A lane that has finished takes the next cell, so no lane waits for another, and no result depends on another cell.
//!
//! - [`CellEngine::evaluate`]: inputs in, biomarkers and penalty terms of the periodic beat out, no allocation
//! - [`CellEngine::evaluate_bounded`]: the same for an optimiser, which needs only costs below a bound
//! - [`CellEngine::evaluate_with_traces`]: the beats themselves on the 1 ms grid
//! - [`CellEngine::evaluate_parallel`]: the batch over rayon's threads
//!
//! The scheme is RODAS on the index-1 differential-algebraic form (`model`), with the linear algebra eliminated by hand;
//! `docs/cell-engine.md` has its derivation, accuracy and speed.

#![deny(missing_docs)]

mod biomarkers;
mod calcium;
mod dispatch;
mod engine;
mod input;
mod input_problem;
mod job;
mod kink;
mod lanes;
mod model;
mod output;
mod periodic;
mod schedule;
mod settings;
mod start;
mod step;
mod trace;

pub use biomarkers::{CellReading, Penalty};
pub use calcium::SampledCalcium;
pub use dispatch::{PathMissing, SimdPath};
pub use engine::{CellEngine, EngineError, Workspace};
pub use input::{CellInput, DEFAULT_PARAMETERS, N_PARAMETERS, NegativeKwu, PARAMETER_NAMES};
pub use input_problem::InputProblem;
pub use output::{CellOutput, CellStatus, CellTrace, CostBound, Objective};
pub use settings::EngineSettings;
