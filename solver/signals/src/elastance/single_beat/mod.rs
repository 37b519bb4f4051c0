//! Estimates of end-systolic elastance from one beat.
//!
//! | method | what it reads |
//! |---|---|
//! | [`normalised_elastance`] (Chen et al. 2001) | cuff pressures, times of ejection after the QRS complex, volumes |
//! | [`bilinear`] (Hayashi et al. 2000) | diastolic arterial pressure, ventricular pressure and volume |
//! | [`isovolumic_maximum`] (ten Brinke et al. 2010) | ventricular pressure and volume alone |
//!
//! These are rough. In seven measured hearts the first and the last differ by a factor of 1.7 to 3.6
//! (`tests/elastance.rs`). In model hearts the last has 0.6 to 2.4 times the true Ees, and the first underestimates
//! strong hearts.
//!
//! Shishido et al. 2000, Circulation 102:1983, have a bilinear elastance too. Their regression for its slope ratio
//! could not be read, so their estimate is not here; Hayashi et al. are of the same group.

use super::beat::Beat;
use super::end_systole::InterceptError;

pub mod bilinear;
pub mod isovolumic_maximum;
pub mod normalised_elastance;

/// What a patient's recording has for an estimate.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    /// Ventricular pressure and volume.
    pub beat: &'a Beat,
    /// Begin of the QRS complex on the beat's clock \[ms\]; negative where the clock begins later.
    pub qrs_begins_ms: Option<f64>,
    /// Systolic arterial pressure \[mmHg\].
    pub arterial_systolic_mmhg: Option<f64>,
    /// Diastolic arterial pressure \[mmHg\].
    pub arterial_diastolic_mmhg: Option<f64>,
}

/// A measurement that an estimate needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measurement {
    /// Begin of the QRS complex.
    QrsBegin,
    /// Systolic arterial pressure.
    ArterialSystolicPressure,
    /// Diastolic arterial pressure.
    ArterialDiastolicPressure,
}

impl std::fmt::Display for Measurement {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::QrsBegin => "the begin of the QRS complex",
            Self::ArterialSystolicPressure => "the systolic arterial pressure",
            Self::ArterialDiastolicPressure => "the diastolic arterial pressure",
        })
    }
}

/// Reasons why a beat has no estimate.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SingleBeatError {
    /// A measurement is missing.
    #[error("{measurement} is missing")]
    Missing {
        /// Measurement to add.
        measurement: Measurement,
    },
    /// A value lies where the method does not hold.
    #[error("{quantity} is {value}, but the method needs {expected}")]
    OutOfRange {
        /// Quantity with its unit.
        quantity: &'static str,
        /// Value that was found.
        value: f64,
        /// Values for which the method holds.
        expected: &'static str,
    },
    /// An isovolumic phase has too few samples.
    #[error(
        "isovolumic contraction and relaxation have {n_samples} samples together, too few for a polynomial"
    )]
    TooFewSamples {
        /// Samples of both phases.
        n_samples: usize,
    },
    /// The intercept cannot be used or found.
    #[error(transparent)]
    Intercept(#[from] InterceptError),
}

impl Recording<'_> {
    fn qrs_begins_ms(&self) -> Result<f64, SingleBeatError> {
        needed(self.qrs_begins_ms, Measurement::QrsBegin)
    }

    fn arterial_systolic_mmhg(&self) -> Result<f64, SingleBeatError> {
        needed(
            self.arterial_systolic_mmhg,
            Measurement::ArterialSystolicPressure,
        )
    }

    fn arterial_diastolic_mmhg(&self) -> Result<f64, SingleBeatError> {
        needed(
            self.arterial_diastolic_mmhg,
            Measurement::ArterialDiastolicPressure,
        )
    }

    /// Pre-ejection period, from a time to the begin of ejection, and ejection time \[ms\].
    fn periods_ms(&self, begin_ms: f64) -> Result<[f64; 2], SingleBeatError> {
        let times = self.beat.systolic_times();
        let pre_ejection_ms = times.ejection_begins_ms - begin_ms;
        positive("the pre-ejection period in ms", pre_ejection_ms)?;
        Ok([
            pre_ejection_ms,
            times.ejection_ends_ms - times.ejection_begins_ms,
        ])
    }
}

fn needed(value: Option<f64>, measurement: Measurement) -> Result<f64, SingleBeatError> {
    value.ok_or(SingleBeatError::Missing { measurement })
}

fn positive(quantity: &'static str, value: f64) -> Result<f64, SingleBeatError> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(SingleBeatError::OutOfRange {
        quantity,
        value,
        expected: "a positive number",
    })
}

#[cfg(test)]
mod tests;
