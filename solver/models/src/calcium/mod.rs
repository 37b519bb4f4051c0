//! Intracellular calcium transients, the input of calcium-driven contraction models.

pub mod rice2008;
pub mod sampled;

pub use rice2008::{Rice2008, Rice2008Parameters, Rice2008Shape};
pub use sampled::SampledCalcium;

/// A calcium transient as a function of the time since activation.
pub trait Calcium: std::fmt::Debug + Send + Sync {
    /// Calcium \[µM\] at `since_activation_ms` after activation; the resting value before
    /// activation.
    fn concentration_um(&self, since_activation_ms: f64) -> f64;

    /// Replaces times since activation \[ms\] by calcium \[µM\], to within round-off of
    /// [`Self::concentration_um`].
    fn of_times(&self, times_to_um: &mut [f64]) {
        for value in times_to_um {
            *value = self.concentration_um(*value);
        }
    }

    /// Calcium \[µM\] and its right-sided time derivative \[µM/ms\] at the same time.
    fn value_and_rate(&self, since_activation_ms: f64) -> (f64, f64);
}

/// Reasons why a calcium transient was rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalciumError {
    /// A time constant is not a positive finite number.
    #[error(
        "calcium time constants must be positive, but tau_CR is {tau_cr_ms} ms and tau_CD is {tau_cd_ms} ms"
    )]
    TimeConstants {
        /// Rise time constant \[ms\].
        tau_cr_ms: f64,
        /// Decay time constant \[ms\].
        tau_cd_ms: f64,
    },
    /// A concentration is not positive or not finite.
    #[error("calcium must be positive, but Ca_res is {ca_res_um} uM and Ca_max is {ca_max_um} uM")]
    Concentrations {
        /// Calcium at rest, Ca_res \[µM\].
        ca_res_um: f64,
        /// Calcium at the peak, Ca_max \[µM\].
        ca_max_um: f64,
    },
    /// A sampled transient is too short or has a sample that is not positive.
    #[error(
        "a sampled calcium transient needs at least 3 positive samples, but sample {index} of {n_samples} is \
         {value_um} uM"
    )]
    Samples {
        /// Number of samples given.
        n_samples: usize,
        /// Index of the first invalid sample.
        index: usize,
        /// Value of that sample \[µM\].
        value_um: f64,
    },
}
