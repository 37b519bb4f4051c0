//! A body under prescribed active stress and surface pressures, as in mechanics benchmarks.
//!
//! - [`time_course`]: prescribed values over time, among them the equations of Aróstica et al. 2025
//! - [`ellipsoid_fibres`]: the fibre rule of Land et al. 2015 and of Aróstica et al. 2025
//! - [`problem`]: the body with its supports, loads, probes and cavities
//! - [`run()`]: motion in time, or equilibrium at full load

pub mod ellipsoid_fibres;
pub mod problem;
pub mod run;
pub mod time_course;

pub use ellipsoid_fibres::EllipsoidFibres;
pub use problem::{Problem, ProblemError, Setup, SurfaceSupport};
pub use run::{RunCost, RunError, Sample, Schedule, run, settle};
pub use time_course::{Course, TimeCourse, TimeCourseError};
