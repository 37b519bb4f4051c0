//! The left ventricle as an organ: anatomy, passive state, contraction, and the beat together with the circulation.

pub mod anatomy;
mod census;
mod contraction;
mod end_diastole;
mod kernels;
pub mod motion;
pub mod passive_fit;
mod passive_job;
pub mod passive_state;
mod passive_state_error;
mod piece;
mod rank;
mod right_ventricle;
mod rigid;
mod search;
mod search_work;
mod share;
mod triangles;
mod ventricle;
pub mod wall;

pub use anatomy::{Anatomy, AnatomyError, ElementKind, LongAxis};
pub use contraction::PointContraction;
pub use end_diastole::EndDiastole;
pub use kernels::Kernel;
pub use passive_fit::{Fitted, PassiveFit, Slope};
pub use passive_job::{FoundState, PassiveJob};
pub use passive_state::PassiveState;
pub use passive_state_error::PassiveStateError;
pub use piece::{Piece, parts_of};
pub use rank::RankFigures;
pub use right_ventricle::{PressureCourse, RightPressure, RightVentricle};
pub use search::{Farthest, Search, SearchProgress, UnloadingSettings, Watch};
pub use search_work::SearchWork;
pub use ventricle::{FiniteElementVentricle, RankParts, VentricleParts, VentricleWork};
pub use wall::{PassiveTissue, Spring, SprungSurface, WallError, WallParameters};
