//! Afterload from a measured flow and pressure: three elements with intervals, and effects beyond
//! them.
//!
//! Sources: Westerhof et al. 2009, Med Biol Eng Comput 47:131 for the three elements; Jung et al.
//! 2022, section 2.1, after Marx et al. 2020, Phil Trans A 378:20190342, for their determination
//! before step 1. The measured flow, linear between its samples, drives the load, and the pressure
//! is fitted by least squares.

mod cuff;
mod discover;
mod effects;
mod ejected;
mod fit;
mod held_out;
mod nameless;
mod noise;
mod parameters;
mod problem;
mod record;
mod simulate;
#[cfg(test)]
mod tests;

pub use cardiotwin_vocabulary::circulation::CuffPressures;
pub use cardiotwin_vocabulary::fits::Determined;
pub use cardiotwin_vocabulary::statistics::EffectiveSampleSize;
pub use cuff::{CUFF_SD_MMHG, CuffFit, USUAL_SHARE, fit_cuff};
pub use discover::{
    Candidate, Confusable, Discovery, DiscoverySettings, Found, Gap, Stage, discover,
};
pub use effects::{EFFECTS, Effect, HIDDEN, Kind};
pub use ejected::ejected;
pub use fit::fit_windkessel;
pub use parameters::Parameter;
pub use record::Record;
pub use simulate::{Start, simulate};

use crate::least_squares::LeastSquaresError;

/// Reasons why a record cannot be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AfterloadError {
    /// Times and values differ in number or are too few.
    #[error(
        "the {trace} with {n_times} times and {n_values} values instead of equal numbers of at least 20"
    )]
    Samples {
        /// Name of the trace.
        trace: &'static str,
        /// Number of times of the trace.
        n_times: usize,
        /// Number of values of the trace.
        n_values: usize,
    },
    /// A sample is not finite, or its time does not exceed the previous one.
    #[error(
        "sample {idx} of the {trace} at {time_ms} ms with value {value}: values must be finite and times must increase"
    )]
    Sample {
        /// Name of the trace.
        trace: &'static str,
        /// Index of the sample.
        idx: usize,
        /// Time of the sample, ms.
        time_ms: f64,
        /// Value of the sample.
        value: f64,
    },
    /// Too few pressure samples lie within the time of the flow.
    #[error(
        "{n_samples} pressure samples at times with a measured flow, but at least 20 are needed"
    )]
    Overlap {
        /// Number of pressure samples within the time of the flow.
        n_samples: usize,
        /// First and last time of the flow.
        flow_ms: [f64; 2],
        /// First and last time of the pressure.
        pressure_ms: [f64; 2],
    },
    /// The flow does not eject.
    #[error("a flow between {lowest_ml_per_s} and {highest_ml_per_s} mL/s without an ejection")]
    NoEjection {
        /// Smallest flow of the record \[mL/s\].
        lowest_ml_per_s: f64,
        /// Largest flow of the record \[mL/s\].
        highest_ml_per_s: f64,
    },
    /// Cuff pressures are out of order.
    #[error(
        "cuff pressures of {systolic_mmhg}/{diastolic_mmhg} (mean {mean_mmhg:?}) mmHg that are not in the order diastolic < mean < systolic"
    )]
    Cuff {
        /// Systolic pressure of the cuff \[mmHg\].
        systolic_mmhg: f64,
        /// Diastolic pressure of the cuff \[mmHg\].
        diastolic_mmhg: f64,
        /// Mean pressure of the cuff \[mmHg\], if given.
        mean_mmhg: Option<f64>,
    },
    /// No load has these pressures with this flow.
    #[error("no three-element Windkessel with {systolic_mmhg}/{diastolic_mmhg} mmHg for this flow")]
    NoLoad {
        /// Systolic pressure of the cuff \[mmHg\].
        systolic_mmhg: f64,
        /// Diastolic pressure of the cuff \[mmHg\].
        diastolic_mmhg: f64,
    },
    /// The confidence level is not between 0 and 1.
    #[error("the confidence level is {level}, but must be above 0 and below 1")]
    Confidence {
        /// Confidence level that was given.
        level: f64,
    },
    /// The least-squares solver rejects its start.
    #[error("the afterload cannot be fitted")]
    LeastSquares(#[from] LeastSquaresError),
}

/// Settings of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindkesselFitSettings {
    /// Pressure of the compliance at the beginning.
    pub start: Start,
    /// Probability that an interval covers the truth, dimensionless.
    pub confidence_level: f64,
}

impl Default for WindkesselFitSettings {
    fn default() -> Self {
        Self {
            start: Start::Free,
            confidence_level: 0.95,
        }
    }
}

/// One fitted quantity, in its unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Value at which the sum of squares is smallest.
    pub value: f64,
    /// Standard error of the linearised model, for the effective number of samples.
    pub standard_error: Option<f64>,
    /// Lower end of the profile's interval; `None` if the record sets none.
    pub lower: Option<f64>,
    /// Upper end of the profile's interval; `None` if the record sets none.
    pub upper: Option<f64>,
    /// Precision according to the interval.
    pub determined: Determined,
}

/// A fitted three-element Windkessel.
#[derive(Debug, Clone, PartialEq)]
pub struct WindkesselFit {
    /// Characteristic resistance, mmHg s/mL.
    pub r1: Estimate,
    /// Peripheral resistance, mmHg s/mL.
    pub r2: Estimate,
    /// Arterial compliance C \[mL/mmHg\].
    pub compliance: Estimate,
    /// Time constant R2 C, s.
    pub time_constant: Estimate,
    /// Pressure of the compliance at the first pressure sample, mmHg.
    pub start: Estimate,
    /// Probability that an interval covers the truth, dimensionless.
    pub confidence_level: f64,
    /// Correlations of the estimates: R1-R2, R1-C, R2-C.
    pub correlations: [Option<f64>; 3],
    /// Number of pressure samples.
    pub n_samples: usize,
    /// Root of the mean squared residual, mmHg.
    pub root_mean_square_mmhg: f64,
    /// Effective number of samples and correlations of the residuals.
    pub sample_size: EffectiveSampleSize,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
    /// Model minus measured pressure at the samples of the record, mmHg.
    pub residuals_mmhg: Vec<f64>,
}
