//! The states of a cell in one array, and where each is in it.

use std::ops::Range;

use super::CellType;
use super::gates::{self, gate};

/// Number of states.
pub const N_STATES: usize = LAND.end;

/// Names of the states as in the authors' programs, in the order of [`State`]; Land's as in [`crate::contraction::land2017`].
pub const STATES: [&str; N_STATES] = [
    "v", "nai", "nass", "ki", "kss", "cai", "cass", "cansr", "cajsr", "CaMKt", "m", "h", "j", "hp",
    "jp", "mL", "hL", "hLp", "a", "iF", "iS", "ap", "iFp", "iSp", "d", "ff", "fs", "fcaf", "fcas",
    "ffp", "fcafp", "xs1", "xs2", "jca", "nca", "nca_i", "Jrel_np", "Jrel_p", "ikr_c0", "ikr_c1",
    "ikr_c2", "ikr_o", "ikr_i", "CaTRPN", "B", "W", "S", "zeta_W", "zeta_S",
];

/// Membrane potential \[mV\].
pub(super) const V: usize = 0;
/// Sodium of the cytosol \[mM\].
pub(super) const NA_I: usize = 1;
/// Sodium of the subspace \[mM\].
pub(super) const NA_SS: usize = 2;
/// Potassium of the cytosol \[mM\].
pub(super) const K_I: usize = 3;
/// Potassium of the subspace \[mM\].
pub(super) const K_SS: usize = 4;
/// Calcium of the cytosol \[mM\].
pub(super) const CA_I: usize = 5;
/// Calcium of the subspace \[mM\].
pub(super) const CA_SS: usize = 6;
/// Calcium of the network reticulum \[mM\].
pub(super) const CA_NSR: usize = 7;
/// Calcium of the junctional reticulum \[mM\].
pub(super) const CA_JSR: usize = 8;
/// CaMK trapped by phosphorylation, a share.
pub(super) const CAMK: usize = 9;
/// Number of potentials, concentrations and CaMK: states with a rate.
pub(super) const N_SLOW: usize = 10;
/// Gates and release: states that relax to a target.
pub(super) const GATES: Range<usize> = N_SLOW..N_SLOW + gate::N;
/// Markov states of hERG: three closed ones, open, inactivated.
pub(super) const HERG: Range<usize> = GATES.end..GATES.end + 5;
/// Land's states, in their own order.
pub(super) const LAND: Range<usize> = HERG.end..HERG.end + 6;

/// Potential, concentrations, gates, channels and cross-bridges of one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State(pub [f64; N_STATES]);

impl State {
    /// A cell at rest from which beats can begin: rounded concentrations of the type at 60 beats a minute, gates at their
    /// targets, and almost no calcium bound.
    pub(super) fn resting(cell_type: CellType) -> Self {
        let [na, k, store, camk] = match cell_type {
            CellType::Endocardial => [12.0, 142.0, 1.53, 0.011],
            CellType::Epicardial => [12.8, 142.0, 1.8, 0.013],
            CellType::MidMyocardial => [14.9, 143.0, 1.8, 0.018],
        };
        let mut x = [0.0; N_STATES];
        x[..N_SLOW].copy_from_slice(&[-88.5, na, na, k, k, 7.5e-5, 6.5e-5, store, store, camk]);
        let at_rest = gates::of_voltage(x[V], cell_type);
        x[GATES.start..=GATES.start + gate::J_CA].copy_from_slice(&at_rest.target[..=gate::J_CA]);
        // All hERG channels closed, all binding sites of myosin blocked.
        x[HERG.start] = 1.0;
        x[LAND.start..LAND.start + 2].copy_from_slice(&[8e-3, 1.0]);
        Self(x)
    }

    /// Membrane potential \[mV\].
    #[must_use]
    pub fn v_mv(&self) -> f64 {
        self.0[V]
    }

    /// Calcium of the cytosol \[µM\].
    #[must_use]
    pub fn ca_um(&self) -> f64 {
        1e3 * self.0[CA_I]
    }

    /// States of Land's model, in its order.
    #[must_use]
    pub fn land(&self) -> [f64; 6] {
        std::array::from_fn(|k| self.0[LAND.start + k])
    }

    pub(super) fn gates(&self) -> &[f64] {
        &self.0[GATES]
    }

    pub(super) fn herg(&self) -> [f64; 5] {
        std::array::from_fn(|k| self.0[HERG.start + k])
    }
}
