//! Loads and supports on surfaces.

mod cavity;
mod pressure;
mod robin;

pub use cavity::{Cavity, NOT_HERE, ValvePlane};
pub use pressure::{PressureSurface, SurfaceError};
pub use robin::{Robin, RobinDirection};
