//! The coupled 0D electromechanical cell, `Sa(Ca, λ, dλ/dt) + S_p(λ) = 0` with λ(0) = λ0 (Jung 2022, eqs. 16-17).
//!
//! Land 2017 active stress, Land passive element, calcium restarted every cycle. The passive strain is relative to the
//! initial length, `C = λ/λ0 − 1`, so that rest at λ0 is an equilibrium. A beat is given in its periodic steady state.

pub mod biomarkers;
mod cell;
mod equilibrium;
pub mod passive;
mod periodic;
mod rodas;
mod system;
pub mod tableau;

pub use biomarkers::CalciumBiomarkers;
pub use cell::{
    CalciumInput, Cell0d, CellBeat, CellError, CellParameters, CellSolverSettings, CellState,
};
pub use passive::{LandPassive, LandPassiveParameters};
