//! Electrophysiology of the left ventricle: the membrane model of Luo and Rudy 1991, and
//! transmembrane potentials by the reaction-eikonal model, in which an eikonal solution determines
//! the activation time of each point.
//!
//! Units: mm, ms, mV; currents per membrane area in µA/cm² and capacitance in µF/cm², whose
//! quotient is mV/ms; conductivities in mS/mm (= S/m); concentrations in mM.
//! `docs/electrophysiology.md` is the guide.

pub mod crossings;
pub mod diffusion;
pub mod foot;
pub mod luo_rudy1991;
pub mod reaction_eikonal;
pub mod tissue;

pub use crossings::Crossings;
pub use foot::FootCurrent;
pub use luo_rudy1991::cells::{Cells, Membrane};
pub use luo_rudy1991::{Parameters, State};
pub use reaction_eikonal::{ElectrophysiologyError, ReactionEikonal, Settings, Snapshot};
pub use tissue::Tissue;
