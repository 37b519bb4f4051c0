//! Where a beat begins: the wall's geometry without load and at end-diastole, as numbers.

use cardiotwin_linalg::parallel::Part;

use super::passive_state::PassiveState;

/// A wall in equilibrium at end-diastolic pressure.
#[derive(Debug, Clone, PartialEq)]
pub struct EndDiastole {
    /// Unloaded node positions \[mm\].
    pub unloaded: Vec<[f64; 3]>,
    /// What the rim's springs rest away from the image \[mm\], three numbers a node.
    pub anchor: Vec<f64>,
    /// Displacement from the unloaded geometry \[mm\], three numbers a node.
    pub u: Vec<f64>,
    /// Cavity pressure \[kPa\].
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
    /// What a rank holds of it.
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
