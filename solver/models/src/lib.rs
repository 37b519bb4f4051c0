//! Models without a space coordinate: contraction, calcium, the coupled 0D cell, the circulation and the one-fibre ventricle.
//!
//! - [`contraction`]: Tanh and Land 2017 active stress behind [`contraction::Contraction`]
//! - [`calcium`]: the Rice transient behind [`calcium::Calcium`]
//! - [`cell0d`]: the electromechanical cell `Sa + S_p = 0` in its periodic state, and its biomarkers
//! - [`circulation`]: compartments and flow paths around one ventricle
//! - [`ventricle`]: the [`ventricle::Ventricle`] trait and its one-fibre implementation
//! - [`effects`]: the catalogue of what the base model lacks, and base model and effects put together
//! - [`parameter`]: a model's parameters, each declared once
//! - [`periodic`]: the periodic beat found quickly, and the base model in the parameters of a fit
//! - [`beat`]: one beat or several to periodicity, with traces and checks; [`step_control`]: the
//!   lengths of its steps; [`median_traces`]: step 2's targets
//!
//! Units: ms, kPa inside the wall, mmHg, mL and mL/s in the circulation, µM.

#![deny(missing_docs)]

pub mod beat;
pub mod calcium;
pub mod cell0d;
pub mod circulation;
pub mod contraction;
pub mod effects;
pub mod median_traces;
pub mod parameter;
pub mod periodic;
pub mod roots;
pub mod step_control;
pub mod tor_ord;
pub mod ventricle;
