//! Ees/Ea from an elastance of two straight lines, after Hayashi et al. 2000.
//!
//! Elastance rises along one line until ejection begins and along another until it ends; k is the ratio of their
//! slopes. Pressures at the corners give Ees/Ea = (Pad/Pes) (1 + k ET/PEP) − 1, and in dogs k = 0.53 (Ees/Ea)^0.51.
//!
//! Source: Hayashi et al. 2000, Anesthesiology 92:1769 (abstract). It has no definition of the pre-ejection period, but
//! estimates Ees/Ea from ventricular and aortic pressure. Here it begins with the foot of ventricular pressure, where
//! elastance begins to rise.

use super::super::arterial::arterial_elastance_mmhg_per_ml;
use super::super::end_systole::{EndSystole, settle};
use super::{Recording, SingleBeatError, positive};

/// Factor and exponent of the slope ratio k as a function of Ees/Ea.
const SLOPE_RATIO: [f64; 2] = [0.53, 0.51];
/// Ratio Ees/Ea above which no solution is sought; dimensionless.
const LARGEST_RATIO: f64 = 100.0;

/// Estimate of a beat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// End-systolic elastance Ees \[mmHg/mL\].
    pub elastance_mmhg_per_ml: f64,
    /// Volume intercept V0 = Ves − Pes/Ees \[mL\].
    pub intercept_ml: f64,
    /// Ees/Ea, dimensionless.
    pub coupling: f64,
    /// Time from the foot of pressure to the begin of ejection, PEP \[ms\].
    pub pre_ejection_ms: f64,
    /// Time from the begin to the end of ejection, ET \[ms\].
    pub ejection_ms: f64,
    /// Diastolic arterial pressure Pad \[mmHg\].
    pub arterial_diastolic_mmhg: f64,
    /// End-systolic point.
    pub end_systole: EndSystole,
}

impl Estimate {
    /// Estimate of a recording. The end-systolic point depends on V0 and is found with it.
    ///
    /// # Errors
    /// [`SingleBeatError`] when the diastolic arterial pressure is missing, no Ees/Ea solves the equations, or V0 is not below all
    /// volumes.
    pub fn of(recording: &Recording) -> Result<Self, SingleBeatError> {
        let beat = recording.beat;
        let [pre_ejection_ms, ejection_ms] =
            recording.periods_ms(beat.systolic_times().pressure_rises_ms)?;
        let diastolic = positive(
            "the diastolic arterial pressure in mmHg",
            recording.arterial_diastolic_mmhg()?,
        )?;
        let (points, intercept_ml, (coupling, elastance_mmhg_per_ml)) =
            settle(&[beat], |points| {
                let point = points[0];
                let coupling = coupling(
                    diastolic / point.pressure_mmhg,
                    ejection_ms / pre_ejection_ms,
                )?;
                let elastance = coupling * arterial_elastance_mmhg_per_ml(beat, point);
                let intercept_ml = point.volume_ml - point.pressure_mmhg / elastance;
                Ok::<_, SingleBeatError>((intercept_ml, (coupling, elastance)))
            })?;
        Ok(Self {
            elastance_mmhg_per_ml,
            intercept_ml,
            coupling,
            pre_ejection_ms,
            ejection_ms,
            arterial_diastolic_mmhg: diastolic,
            end_systole: points[0],
        })
    }
}

/// The larger solution x = Ees/Ea of x = p (1 + k(x) t) − 1, by bisection. The smaller one belongs to a heart that
/// hardly ejects.
///
/// - `pressure_ratio`: p = Pad/Pes
/// - `time_ratio`: t = ET/PEP
fn coupling(pressure_ratio: f64, time_ratio: f64) -> Result<f64, SingleBeatError> {
    let [factor, exponent] = SLOPE_RATIO;
    let excess = |x: f64| pressure_ratio * (1.0 + factor * x.powf(exponent) * time_ratio) - 1.0 - x;
    // The excess is concave: where its slope is zero it is largest, and the larger solution follows.
    let top = (pressure_ratio * factor * exponent * time_ratio).powf(1.0 / (1.0 - exponent));
    if !(excess(top) >= 0.0 && excess(LARGEST_RATIO) < 0.0) {
        return Err(SingleBeatError::OutOfRange {
            quantity: "diastolic arterial over end-systolic pressure",
            value: pressure_ratio,
            expected: "a larger one, or a longer ejection, for Ees/Ea to exist",
        });
    }
    let (mut below, mut above) = (top, LARGEST_RATIO);
    while above - below > 1e-12 * above {
        let middle = 0.5 * (below + above);
        if middle <= below || middle >= above {
            break;
        }
        if excess(middle) >= 0.0 {
            below = middle;
        } else {
            above = middle;
        }
    }
    Ok(0.5 * (below + above))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_solves_both_equations() {
        let (p, t) = (0.78, 3.5);
        let x = coupling(p, t).unwrap();
        let k = 0.53 * x.powf(0.51);
        assert!((p * (1.0 + k * t) - 1.0 - x).abs() < 1e-9, "{x}");
        assert!(x > 0.5 && x < 3.0, "{x}");
        assert!(coupling(0.2, 1.0).is_err());
    }
}
