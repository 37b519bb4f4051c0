//! The circulation around one ventricle, assembled from components.
//!
//! Compartments (an atrium, an arterial load, a right ventricle) are connected to the ventricle by
//! flow paths (valves, leaks, stenoses). Each kind is one file that implements [`Compartment`] or
//! [`FlowPath`], and an effect is one more entry in the lists. Components hold only parameters. The
//! circulation keeps their states as numbers, so that it can try, commit, roll back and restore a
//! step without the components.
//!
//! An open circuit ends at its compartments: an atrium at constant pressure, a Windkessel that
//! drains ([`LeftHeart`]). Paths between compartments close it ([`ClosedLoop`]): the blood then goes
//! round, and its volume stays.
//!
//! Units here: mmHg, mL, mL/s, mmHg·s/mL, mL/mmHg; time in ms.

pub mod atrium;
mod circuit;
pub mod closed_loop;
mod component;
mod contents;
mod coupled;
pub mod elastance;
pub mod estimate;
pub mod filling;
pub mod left_heart;
pub mod orifice;
pub mod split_windkessel;
pub mod valve;
pub mod vessel;
pub mod windkessel;

pub use atrium::ConstantPressure;
pub use circuit::{Circulation, CirculationState, Direction, NetFlow};
pub use closed_loop::{ClosedLoop, LoopTable};
pub(crate) use component::positive;
pub use component::{CirculationError, Compartment, FlowPath, TimeStep};
pub use elastance::{Elastance, ElastanceChamber};
pub use left_heart::{LeftHeart, StartPressure};
pub use orifice::Orifice;
pub use split_windkessel::{ArterialJunction, SplitWindkessel};
pub use valve::DiodeValve;
pub use vessel::{Compliance, Resistance};
pub use windkessel::Windkessel3;
