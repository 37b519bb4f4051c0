//! Search for effects that explain where measured traces differ from a ventricle model, with the
//! option that no effect can be named.
#![deny(missing_docs)]

pub mod activation;
pub mod bootstrap;
pub mod calibration;
pub mod channel;
mod classes;
pub mod confusion;
pub mod decide;
pub mod deciding;
pub mod discrepancy;
pub mod fit;
pub mod forward;
pub mod further;
pub mod held_out;
pub mod joint;
pub mod learnt;
pub mod least_squares;
pub mod locate;
pub mod measured;
pub mod measured_error;
pub mod moves;
pub mod noise;
pub mod parameter;
pub mod phases;
pub mod problem;
mod random;
pub mod ranked;
pub mod reduced;
pub mod result;
pub mod search;
pub mod series;
pub mod settings;
pub mod signal;
pub mod stage;
mod stepwise;
pub mod uncertain;
pub mod unexplained;
pub mod usual;
pub mod valves;

pub use decide::{DiscoverError, discover};
pub use measured::Measured;
pub use reduced::Reduced;
pub use result::Discovery;
pub use settings::Settings;
