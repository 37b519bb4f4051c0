//! The state from which a beat starts: the wall's unloaded geometry and its displacement at end-diastole.

use cardiotwin_linalg::parallel::Part;

use super::passive_state::PassiveState;

/// A wall in equilibrium at end-diastolic pressure.
#[derive(Debug, Clone, PartialEq)]
pub struct EndDiastole {
    /// Unloaded node positions \[mm\].
    pub unloaded: Vec<[f64; 3]>,
    /// Displacement from the image at which the rim's springs are at rest \[mm\], three numbers a node.
    pub anchor: Vec<f64>,
    /// Displacement from the unloaded geometry \[mm\], three numbers a node.
    pub u: Vec<f64>,
    /// Pressure in the left cavity \[kPa\].
    pub pressure_kpa: f64,
}

impl From<PassiveState> for EndDiastole {
    fn from(state: PassiveState) -> Self {
        let (unloaded, anchor) = (state.unloaded().to_vec(), state.anchor().to_vec());
        Self {
            unloaded,
            anchor,
            u: state.u,
            pressure_kpa: state.pressure_kpa,
        }
    }
}

impl EndDiastole {
    /// The values at the nodes of one rank.
    #[must_use]
    pub fn part(&self, part: &Part) -> Self {
        Self {
            unloaded: part.take(1, &self.unloaded),
            anchor: part.take(3, &self.anchor),
            u: part.take(3, &self.u),
            pressure_kpa: self.pressure_kpa,
        }
    }
}
