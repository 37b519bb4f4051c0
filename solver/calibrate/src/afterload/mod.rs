//! The afterload of a measured flow and pressure: three elements with intervals, and what they miss.
//!
//! Source of the three elements: Westerhof et al. 2009, Med Biol Eng Comput 47:131; that they are determined before step 1:
//! Jung et al. 2022, section 2.1, after Marx et al. 2020, Phil Trans A 378:20190342. The flow is taken as it was measured,
//! linear between its samples, and drives the load; the pressure is fitted by least squares.

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

pub use cardiotwin_vocabulary::statistics::EffectiveSampleSize;
pub use cuff::{CUFF_SD_MMHG, Cuff, CuffFit, USUAL_SHARE, fit_cuff};
pub use discover::{
    Candidate, Confusable, Discovery, DiscoverySettings, Found, Gap, Stage, discover,
};
pub use effects::{EFFECTS, Effect, HIDDEN, Kind};
pub use ejected::ejected;
pub use fit::fit_windkessel;
pub use nameless::{Dependence, Nameless};
pub use parameters::Parameter;
pub use record::Record;
pub use simulate::{Start, simulate};

use crate::least_squares::LeastSquaresError;

/// Why a record cannot be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AfterloadError {
    /// Times and values of different number, or too few.
    #[error(
        "the {trace} has {n_times} times and {n_values} values, but must have at least 20 of each, as many of both"
    )]
    Samples {
        /// Which trace.
        trace: &'static str,
        /// Number of times.
        n_times: usize,
        /// Number of values.
        n_values: usize,
    },
    /// A sample that is not finite, or a time not after the one before.
    #[error(
        "sample {idx} of the {trace} at {time_ms} ms is {value}: values must be finite, times increase"
    )]
    Sample {
        /// Which trace.
        trace: &'static str,
        /// Position of the sample.
        idx: usize,
        /// Its time.
        time_ms: f64,
        /// Its value.
        value: f64,
    },
    /// Too few pressures where flow was measured.
    #[error("{n_samples} pressure samples lie where flow was measured, but at least 20 are needed")]
    Overlap {
        /// Number of pressure samples within the flow's time.
        n_samples: usize,
        /// First and last time of the flow.
        flow_ms: [f64; 2],
        /// First and last time of the pressure.
        pressure_ms: [f64; 2],
    },
    /// A flow that does not eject.
    #[error(
        "the flow lies between {lowest_ml_per_s} and {highest_ml_per_s} mL/s: nothing is ejected"
    )]
    NoEjection {
        /// Smallest flow.
        lowest_ml_per_s: f64,
        /// Largest flow.
        highest_ml_per_s: f64,
    },
    /// Pressures of a cuff that are not in order.
    #[error(
        "cuff pressures {systolic_mmhg}/{diastolic_mmhg} (mean {mean_mmhg:?}) mmHg are not in order: diastolic, mean, systolic"
    )]
    Cuff {
        /// Systolic.
        systolic_mmhg: f64,
        /// Diastolic.
        diastolic_mmhg: f64,
        /// Mean.
        mean_mmhg: Option<f64>,
    },
    /// Pressures that no load has with this flow.
    #[error("no three elements have {systolic_mmhg}/{diastolic_mmhg} mmHg with this flow")]
    NoLoad {
        /// Systolic.
        systolic_mmhg: f64,
        /// Diastolic.
        diastolic_mmhg: f64,
    },
    /// A setting that makes no sense.
    #[error("the confidence level is {level}, but must be above 0 and below 1")]
    Confidence {
        /// The level.
        level: f64,
    },
    /// The minimisation failed.
    #[error("the afterload cannot be fitted")]
    LeastSquares(#[from] LeastSquaresError),
}

/// What may be set of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindkesselFitSettings {
    /// What the compliance's pressure is at the beginning.
    pub start: Start,
    /// Probability that an interval covers, dimensionless.
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

/// How well the record determines a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Determined {
    /// The interval's half width is at most 30 % of the value.
    #[default]
    Well,
    /// It is wider.
    Poorly,
    /// At least one end does not exist within the limits of the fit.
    Not,
}

/// One fitted quantity in its unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// Standard error of the linearised model, for the effective number of samples.
    pub standard_error: Option<f64>,
    /// Lower end of the profile's interval; none if the record sets none.
    pub lower: Option<f64>,
    /// Upper end of the profile's interval; none if the record sets none.
    pub upper: Option<f64>,
    /// What the interval says.
    pub determined: Determined,
}

/// A fitted three-element Windkessel.
#[derive(Debug, Clone, PartialEq)]
pub struct WindkesselFit {
    /// Characteristic resistance, mmHg s/mL.
    pub r1: Estimate,
    /// Peripheral resistance, mmHg s/mL.
    pub r2: Estimate,
    /// Compliance, mL/mmHg.
    pub compliance: Estimate,
    /// R2 C, s.
    pub time_constant: Estimate,
    /// Pressure of the compliance at the first pressure sample, mmHg.
    pub start: Estimate,
    /// Probability that an interval covers.
    pub confidence_level: f64,
    /// Correlations of the estimates R1-R2, R1-C, R2-C.
    pub correlations: [Option<f64>; 3],
    /// Number of pressure samples.
    pub n_samples: usize,
    /// Root of the mean squared residual, mmHg.
    pub root_mean_square_mmhg: f64,
    /// Of the residuals.
    pub sample_size: EffectiveSampleSize,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
    /// Model less measured pressure at the record's samples, mmHg.
    pub residuals_mmhg: Vec<f64>,
}
