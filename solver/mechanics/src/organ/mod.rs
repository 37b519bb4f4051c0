//! The left ventricle as an organ: anatomy, passive state, contraction, and the beat together with the circulation.

pub mod anatomy;
mod census;
mod contraction;
mod end_diastole;
mod kernels;
pub mod passive_fit;
pub mod passive_state;
mod rank;
mod search;
mod ventricle;
pub mod wall;

pub use anatomy::{Anatomy, AnatomyError, ElementKind};
pub use contraction::PointContraction;
pub use end_diastole::EndDiastole;
pub use kernels::Kernel;
pub use passive_fit::PassiveFit;
pub use passive_state::{PassiveState, PassiveStateError};
pub use rank::RankFigures;
pub use search::{Fitted, Search, SearchProgress, Slope, UnloadingSettings, Watch};
pub use ventricle::{FiniteElementVentricle, VentricleParts, VentricleWork};
pub use wall::{WallError, WallParameters};
