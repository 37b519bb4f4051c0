//! What rules of consistency compare, and what they find.

use crate::Trace;
use cardiotwin_vocabulary::circulation::WindkesselParameters;

/// Numbers that must agree with each other; `None` for those that nobody measured.
#[derive(Debug, Clone, Copy, Default)]
pub struct Facts<'a> {
    /// Length of the beat \[ms\].
    pub cycle_ms: f64,
    /// Pressure of the left ventricle over one beat \[mmHg\].
    pub pressure: Option<&'a Trace>,
    /// Recorded beats whose own top is cut, and the beats of the mean.
    pub cut_beats: Option<[usize; 2]>,
    /// Volume of the left ventricle over one beat \[mL\].
    pub volume: Option<&'a Trace>,
    /// Systolic and diastolic pressure of the aorta \[mmHg\].
    pub aorta: Option<[f64; 2]>,
    /// Pressure of the aorta over one beat \[mmHg\].
    pub aortic_pressure: Option<&'a Trace>,
    /// Mean pressure of an aorta's trace \[mmHg\].
    pub aortic_mean_mmhg: Option<f64>,
    /// Mean of an aorta's flow, positive out of the heart \[mL/s\].
    pub aortic_flow_ml_per_s: Option<f64>,
    /// Stated largest pressure of the left ventricle \[mmHg\].
    pub stated_p_max: Option<f64>,
    /// Stated end-diastolic volume \[mL\].
    pub stated_edv: Option<f64>,
    /// Stated end-systolic volume \[mL\].
    pub stated_esv: Option<f64>,
    /// Stated stroke volume \[mL\].
    pub stated_sv: Option<f64>,
    /// Stated end-diastolic pressure \[mmHg\].
    pub stated_edp: Option<f64>,
    /// Volume at diastasis \[mL\].
    pub diastasis_ml: Option<f64>,
    /// Net forward volume of a beat \[mL\].
    pub forward_ml: Option<f64>,
    /// Parameters of the Windkessel.
    pub windkessel: Option<WindkesselParameters>,
    /// Calcium of a cell over one beat \[µM\].
    pub calcium: Option<&'a Trace>,
}

/// What a rule finds.
pub(super) enum Verdict {
    Holds,
    Doubtful(String),
    Broken(String),
}

/// Least and largest value.
pub(super) fn extremes(trace: &Trace) -> [f64; 2] {
    trace
        .values()
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
            [low.min(*v), high.max(*v)]
        })
}
