//! A sampled quantity over time.

use cardiotwin_vocabulary::measurements::FurtherQuantity;
use serde::{Deserialize, Serialize};

/// Quantity of a trace, with its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Left-ventricular or arterial pressure, mmHg.
    Pressure,
    /// Volume of the ventricle's cavity, mL.
    Volume,
    /// Active stress along the fibre, kPa.
    ActiveStress,
    /// Intracellular calcium concentration, µM.
    Calcium,
    /// Fibre stretch from the reference length, dimensionless.
    Stretch,
    /// Flow through a valve, mL/s.
    Flow,
    /// Strain of the whole wall, %.
    Strain,
}

impl Quantity {
    /// Name of the column that holds the quantity in a measured file: the name carries the unit.
    #[must_use]
    pub fn column(self) -> &'static str {
        match self {
            Self::Pressure => "pressure_mmHg",
            Self::Volume => "volume_mL",
            Self::ActiveStress => "Sa_kPa",
            Self::Calcium => "Ca_uM",
            Self::Stretch => "lambda",
            Self::Flow => "flow_mL_per_s",
            Self::Strain => "strain_percent",
        }
    }

    /// Another name that the column may have in a measured file, where there is one.
    #[must_use]
    pub fn other_column(self) -> Option<&'static str> {
        (self == Self::Calcium).then_some("calcium_uM")
    }

    /// Unit as printed in messages; empty when dimensionless.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Pressure => "mmHg",
            Self::Volume => "mL",
            Self::ActiveStress => "kPa",
            Self::Calcium => "µM",
            Self::Stretch => "",
            Self::Flow => "mL/s",
            Self::Strain => "%",
        }
    }
}

/// Quantity in the file of a further trace.
impl From<FurtherQuantity> for Quantity {
    fn from(further: FurtherQuantity) -> Self {
        match further {
            FurtherQuantity::AorticPressure | FurtherQuantity::AtrialPressure => Self::Pressure,
            FurtherQuantity::AorticFlow | FurtherQuantity::MitralFlow => Self::Flow,
            FurtherQuantity::Strain => Self::Strain,
        }
    }
}

impl std::fmt::Display for Quantity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Pressure => "pressure",
            Self::Volume => "volume",
            Self::ActiveStress => "active stress",
            Self::Calcium => "calcium",
            Self::Stretch => "stretch",
            Self::Flow => "flow",
            Self::Strain => "strain",
        })
    }
}

/// Reasons why samples do not make a trace.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// There is not one time per value, or fewer than two of them.
    #[error(
        "a {quantity} trace needs at least 2 samples and one time per value, but has {n_times} times and {n_values} values"
    )]
    Length {
        /// Quantity of the trace.
        quantity: Quantity,
        /// Number of times that were given.
        n_times: usize,
        /// Number of values that were given.
        n_values: usize,
    },
    /// A time or a value that is not finite.
    #[error("sample {idx} of the {quantity} trace is not finite: time {time_ms} ms, value {value}")]
    NotFinite {
        /// Quantity of the trace.
        quantity: Quantity,
        /// Position of the sample.
        idx: usize,
        /// Time of the sample \[ms\].
        time_ms: f64,
        /// Value of the sample, in the quantity's unit.
        value: f64,
    },
    /// Times do not increase.
    #[error(
        "times of the {quantity} trace do not increase at sample {idx}: {time_ms} ms after {previous_ms} ms"
    )]
    NotIncreasing {
        /// Quantity of the trace.
        quantity: Quantity,
        /// Position of the sample.
        idx: usize,
        /// Time of the sample \[ms\].
        time_ms: f64,
        /// Time of the sample before \[ms\].
        previous_ms: f64,
    },
}

/// Samples of one quantity: at least two, finite, at strictly increasing times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawTrace")]
pub struct Trace {
    quantity: Quantity,
    time_ms: Vec<f64>,
    values: Vec<f64>,
}

/// A trace before it was looked at: what is read from a file passes [`Trace::new`] as well.
#[derive(Deserialize)]
struct RawTrace {
    quantity: Quantity,
    time_ms: Vec<f64>,
    values: Vec<f64>,
}

impl TryFrom<RawTrace> for Trace {
    type Error = TraceError;
    fn try_from(raw: RawTrace) -> Result<Self, TraceError> {
        Self::new(raw.quantity, raw.time_ms, raw.values)
    }
}

impl Trace {
    /// A trace of times (ms) and values (in the quantity's unit).
    ///
    /// # Errors
    /// [`TraceError`] when lengths differ, fewer than two samples are given, one is not finite, or times do not increase.
    pub fn new(
        quantity: Quantity,
        time_ms: Vec<f64>,
        values: Vec<f64>,
    ) -> Result<Self, TraceError> {
        if values.len() < 2 || time_ms.len() != values.len() {
            return Err(TraceError::Length {
                quantity,
                n_times: time_ms.len(),
                n_values: values.len(),
            });
        }
        for (idx, (t, v)) in time_ms.iter().zip(&values).enumerate() {
            if !t.is_finite() || !v.is_finite() {
                return Err(TraceError::NotFinite {
                    quantity,
                    idx,
                    time_ms: *t,
                    value: *v,
                });
            }
            if idx > 0 && *t <= time_ms[idx - 1] {
                return Err(TraceError::NotIncreasing {
                    quantity,
                    idx,
                    time_ms: *t,
                    previous_ms: time_ms[idx - 1],
                });
            }
        }
        Ok(Self {
            quantity,
            time_ms,
            values,
        })
    }

    /// A trace sampled every `step_ms` from time zero.
    ///
    /// # Errors
    /// As [`Trace::new`].
    pub fn uniform(quantity: Quantity, step_ms: f64, values: Vec<f64>) -> Result<Self, TraceError> {
        let time_ms = (0..values.len()).map(|i| i as f64 * step_ms).collect();
        Self::new(quantity, time_ms, values)
    }

    /// Quantity of the trace, which gives the unit of its values.
    #[must_use]
    pub fn quantity(&self) -> Quantity {
        self.quantity
    }

    /// Times in ms, strictly increasing.
    #[must_use]
    pub fn time_ms(&self) -> &[f64] {
        &self.time_ms
    }

    /// Values in the quantity's unit, one per time.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Number of samples, at least two.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.values.len()
    }

    /// Time of the last sample, ms.
    #[must_use]
    pub fn end_ms(&self) -> f64 {
        self.time_ms[self.time_ms.len() - 1]
    }

    /// Value at a time (ms) by linear interpolation, the first or last value beyond the ends.
    #[must_use]
    pub fn at(&self, time_ms: f64) -> f64 {
        let i = self.time_ms.partition_point(|t| *t <= time_ms);
        if i == 0 {
            return self.values[0];
        }
        if i == self.time_ms.len() {
            return self.values[i - 1];
        }
        let (t0, t1) = (self.time_ms[i - 1], self.time_ms[i]);
        self.values[i - 1] + (self.values[i] - self.values[i - 1]) * (time_ms - t0) / (t1 - t0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_finite_increasing_samples_make_a_trace() {
        let p = Quantity::Pressure;
        assert!(matches!(
            Trace::new(p, vec![0.0], vec![1.0]),
            Err(TraceError::Length { .. })
        ));
        assert!(matches!(
            Trace::new(p, vec![0.0, 1.0], vec![1.0, f64::NAN]),
            Err(TraceError::NotFinite { idx: 1, .. })
        ));
        assert!(matches!(
            Trace::new(p, vec![0.0, 0.0], vec![1.0, 2.0]),
            Err(TraceError::NotIncreasing { idx: 1, .. })
        ));
    }

    #[test]
    fn deserialising_validates_too() {
        let bad = r#"{"quantity":"volume","time_ms":[0,-1],"values":[1,2]}"#;
        assert!(
            serde_json::from_str::<Trace>(bad)
                .unwrap_err()
                .to_string()
                .contains("do not increase")
        );
    }

    #[test]
    fn interpolates_between_samples_and_holds_the_ends() {
        let t = Trace::uniform(Quantity::Volume, 2.0, vec![1.0, 3.0]).unwrap();
        assert_eq!(
            [t.at(-1.0), t.at(0.0), t.at(1.0), t.at(2.0), t.at(9.0)],
            [1.0, 1.0, 2.0, 3.0, 3.0]
        );
    }
}
