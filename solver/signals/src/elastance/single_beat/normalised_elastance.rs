//! Ees from a normalised elastance at the onset of ejection, after Chen et al. 2001.
//!
//! Elastance over its maximum at a time over the time of the maximum is much the same in all hearts. At the onset of
//! ejection, pressure is the arterial diastolic pressure and volume still end-diastolic, so that
//! ENd = Pd/[Ees (EDV − V0)] with EDV − V0 = Pes/Ees + SV gives Ees.
//!
//! Source: Chen et al. 2001, J Am Coll Cardiol 38:2028. The formula for Ees, its regression on measured Ees and the
//! scatter were read in the abstract; the polynomial and the correction of ENd in a public program that names the
//! publication.

use super::{Recording, SingleBeatError, positive};

/// Ratio of end-systolic to systolic arterial pressure.
const END_SYSTOLIC_SHARE: f64 = 0.9;
/// Group average of normalised elastance: a polynomial in tNd, constant first.
const GROUP_AVERAGE: [f64; 8] = [
    0.35695, -7.2266, 74.249, -307.39, 684.54, -856.92, 571.95, -159.1,
];
/// Correction of the average: constant, and factors of EF, Pd/Pes and the average.
const CORRECTION: [f64; 4] = [0.0275, -0.165, 0.3656, 0.515];

/// Regression of measured on estimated Ees: factor, and constant \[mmHg/mL\] (abstract).
pub const REGRESSION: [f64; 2] = [0.86, 0.40];
/// Standard error of that regression in 43 patients, some with dobutamine \[mmHg/mL\] (abstract).
pub const STANDARD_ERROR_MMHG_PER_ML: f64 = 0.64;

/// What the estimate reads; a cuff and an echocardiogram give it without a catheter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Time from the begin of QRS to the begin of ejection \[ms\].
    pub pre_ejection_ms: f64,
    /// Time from the begin to the end of ejection \[ms\].
    pub ejection_ms: f64,
    /// Ejection fraction, dimensionless.
    pub ejection_fraction: f64,
    /// Stroke volume \[mL\].
    pub stroke_volume_ml: f64,
    /// Systolic arterial pressure Ps \[mmHg\].
    pub arterial_systolic_mmhg: f64,
    /// Diastolic arterial pressure Pd \[mmHg\].
    pub arterial_diastolic_mmhg: f64,
}

/// Estimate of a beat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// End-systolic elastance Ees \[mmHg/mL\].
    pub elastance_mmhg_per_ml: f64,
    /// Ratio of the pre-ejection period to all of systole, tNd; dimensionless.
    pub time_ratio: f64,
    /// Normalised elastance ENd at the onset of ejection; dimensionless.
    pub normalised_elastance: f64,
    /// What it was made of.
    pub inputs: Inputs,
}

impl Estimate {
    /// Estimate of a recording.
    ///
    /// # Errors
    /// [`SingleBeatError`] when the begin of QRS or an arterial pressure is missing, or as [`Self::from_inputs`].
    pub fn of(recording: &Recording) -> Result<Self, SingleBeatError> {
        let [pre_ejection_ms, ejection_ms] = recording.periods_ms(recording.qrs_begins_ms()?)?;
        Self::from_inputs(Inputs {
            pre_ejection_ms,
            ejection_ms,
            ejection_fraction: recording.beat.ejection_fraction(),
            stroke_volume_ml: recording.beat.stroke_volume_ml(),
            arterial_systolic_mmhg: recording.arterial_systolic_mmhg()?,
            arterial_diastolic_mmhg: recording.arterial_diastolic_mmhg()?,
        })
    }

    /// Estimate from single values:
    /// Ees = (Pd − ENd · 0.9 Ps)/(ENd · SV), ENd = 0.0275 − 0.165 EF + 0.3656 Pd/(0.9 Ps) + 0.515 ENd,avg, and ENd,avg a
    /// polynomial in tNd.
    ///
    /// # Errors
    /// [`SingleBeatError::OutOfRange`] when an input is not positive, the ejection fraction exceeds one, or ENd or Ees
    /// is not positive.
    pub fn from_inputs(inputs: Inputs) -> Result<Self, SingleBeatError> {
        positive("the pre-ejection period in ms", inputs.pre_ejection_ms)?;
        positive("the ejection time in ms", inputs.ejection_ms)?;
        positive("the stroke volume in mL", inputs.stroke_volume_ml)?;
        positive(
            "the systolic arterial pressure in mmHg",
            inputs.arterial_systolic_mmhg,
        )?;
        positive(
            "the diastolic arterial pressure in mmHg",
            inputs.arterial_diastolic_mmhg,
        )?;
        if !(0.0..=1.0).contains(&inputs.ejection_fraction) {
            return Err(SingleBeatError::OutOfRange {
                quantity: "the ejection fraction",
                value: inputs.ejection_fraction,
                expected: "a number from 0 to 1",
            });
        }
        let end_systolic_mmhg = END_SYSTOLIC_SHARE * inputs.arterial_systolic_mmhg;
        let time_ratio = inputs.pre_ejection_ms / (inputs.pre_ejection_ms + inputs.ejection_ms);
        let average = GROUP_AVERAGE
            .iter()
            .rev()
            .fold(0.0, |sum, c| sum * time_ratio + c);
        let [constant, of_fraction, of_pressure, of_average] = CORRECTION;
        let normalised_elastance = positive(
            "the normalised elastance",
            constant
                + of_fraction * inputs.ejection_fraction
                + of_pressure * inputs.arterial_diastolic_mmhg / end_systolic_mmhg
                + of_average * average,
        )?;
        let elastance_mmhg_per_ml = positive(
            "the elastance in mmHg/mL",
            (inputs.arterial_diastolic_mmhg - normalised_elastance * end_systolic_mmhg)
                / (normalised_elastance * inputs.stroke_volume_ml),
        )?;
        Ok(Self {
            elastance_mmhg_per_ml,
            time_ratio,
            normalised_elastance,
            inputs,
        })
    }

    /// Ees that the publication's regression expects of this estimate \[mmHg/mL\].
    #[must_use]
    pub fn expected_mmhg_per_ml(&self) -> f64 {
        REGRESSION[0] * self.elastance_mmhg_per_ml + REGRESSION[1]
    }
}
