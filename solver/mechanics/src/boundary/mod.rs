//! Loads and supports on surfaces.

mod pressure;
mod robin;

pub use pressure::{PressureSurface, SurfaceError};
pub use robin::{Robin, RobinDirection};
