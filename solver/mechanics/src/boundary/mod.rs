//! Loads and supports on surfaces.

mod cavity;
mod pressure;
mod robin;

pub use cavity::{Cavity, ValvePlane};
pub use pressure::{PressureSurface, SurfaceError};
pub use robin::{Robin, RobinDirection};
