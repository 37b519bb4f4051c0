//! The blood volume of a closed loop, found together with its periodic beat.

use crate::circulation::closed_loop::SYSTEMIC_VEINS;
use crate::effects::Assembled;
use crate::ventricle::Ventricle as _;
use cardiotwin_units::{Ml, Mmhg};

/// Blood that the veins get for each millilitre of end-diastolic volume that a beat lacks \[mL/mL\]:
/// more than the ventricle itself takes, since most of it stays in veins and lungs.
const PER_END_DIASTOLIC: f64 = 3.0;
/// Blood that the veins get for each millimetre of mercury that the mean atrial pressure lacks
/// \[mL/mmHg\], of the order of the compliance of a whole circulation.
const PER_ATRIAL_PRESSURE: f64 = 30.0;

/// What the blood volume of a closed loop follows from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Filling {
    /// The blood volume itself, in ventricle, chambers and vessels.
    BloodVolume(Ml),
    /// Largest volume of the ventricle in the periodic beat.
    EndDiastolicVolume(Ml),
    /// Mean pressure of the left atrium over the periodic beat.
    LeftAtrialPressure(Mmhg),
}

/// A filling at work in a search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Control {
    filling: Filling,
    /// Index of the veins' volume in the state at the beat's start.
    pub(super) veins: usize,
}

/// What a beat misses of its target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Missing {
    /// Target less the beat's value (mL or mmHg).
    pub(super) of_target: f64,
    /// Blood that the veins get for it \[mL\].
    pub(super) blood_ml: f64,
}

/// Blood in ventricle and loop; `None` for an open circuit.
#[must_use]
pub fn blood_volume(model: &Assembled) -> Option<Ml> {
    let loop_ml = model.circulation.volume()?;
    Some(Ml(model.ventricle.volume().0 + loop_ml.0))
}

impl Control {
    /// The control of a model with this number of states of its ventricle; `None` for an open circuit.
    pub(super) fn new(filling: Filling, model: &Assembled, n_ventricle: usize) -> Option<Self> {
        blood_volume(model)?;
        let veins = model.circulation.first_state_of(SYSTEMIC_VEINS)?;
        Some(Self {
            filling,
            veins: n_ventricle + veins,
        })
    }

    /// Before a beat: the model has the state `x`. A given blood volume is kept to rounding, which the
    /// search's combinations of earlier states would else add up.
    pub(super) fn keep(&self, model: &mut Assembled, x: &mut [f64], n_ventricle: usize) {
        if let (Filling::BloodVolume(wanted), Some(now)) = (self.filling, blood_volume(model)) {
            x[self.veins] += wanted.0 - now.0;
            model.circulation.begin_beat(&x[n_ventricle..]);
        }
    }

    /// What a beat misses, from its volumes \[mL\] and atrial pressures \[mmHg\].
    pub(super) fn missing(&self, volume_ml: &[f64], atrial_pressure_mmhg: &[f64]) -> Missing {
        let (of_target, gain) = match self.filling {
            Filling::BloodVolume(_) => (0.0, 0.0),
            Filling::EndDiastolicVolume(wanted) => {
                let largest = volume_ml.iter().copied().fold(f64::MIN, f64::max);
                (wanted.0 - largest, PER_END_DIASTOLIC)
            }
            Filling::LeftAtrialPressure(wanted) => {
                let sum: f64 = atrial_pressure_mmhg.iter().sum();
                let mean = sum / atrial_pressure_mmhg.len() as f64;
                (wanted.0 - mean, PER_ATRIAL_PRESSURE)
            }
        };
        Missing {
            of_target,
            blood_ml: gain * of_target,
        }
    }
}
