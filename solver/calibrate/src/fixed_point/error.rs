//! Invalid input to the decisions of the loop.

use cardiotwin_vocabulary::biomarkers::Biomarker;
use cardiotwin_vocabulary::step1::Step1Parameter;

/// Invalid input to [`super::decide`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FixedPointError {
    /// A setting outside its range.
    #[error("setting {key} is {value}, but must be {expected}")]
    Setting {
        /// Key of the setting.
        key: &'static str,
        /// Value that was given.
        value: f64,
        /// Range of admissible values, in words.
        expected: String,
    },
    /// An interval of a parameter whose ends are not positive, finite and in order.
    #[error(
        "bounds of {parameter} are {lower} to {upper}, but must be positive, finite and in order"
    )]
    Bounds {
        /// Parameter with these bounds.
        parameter: Step1Parameter,
        /// Lower end of the interval, in the parameter's unit.
        lower: f64,
        /// Upper end of the interval, in the parameter's unit.
        upper: f64,
    },
    /// A name that is not one of step 1's parameters.
    #[error("step1 names parameter {name}; expected one of {}", Step1Parameter::KEYS.join(", "))]
    UnknownParameter {
        /// Name that the settings give.
        name: String,
    },
    /// A key that is not one of step 1's biomarkers.
    #[error("step1.weights names biomarker {name}; expected one of {}", Biomarker::ORGAN_KEYS.join(", "))]
    UnknownBiomarker {
        /// Key that the settings give.
        name: String,
    },
    /// An initial value that the ratios of the update cannot move.
    #[error("initial {parameter} is {value}, but must be positive and finite")]
    Initial {
        /// Parameter with this initial value.
        parameter: Step1Parameter,
        /// Initial value, in the parameter's unit.
        value: f64,
    },
    /// A measured biomarker of pressure is missing, or a measured biomarker has the wrong sign.
    #[error("measured {biomarker} is {value:?}, but must be {expected}")]
    Measured {
        /// Biomarker that was measured.
        biomarker: Biomarker,
        /// Measured value, if any.
        value: Option<f64>,
        /// Expected sign of the value.
        expected: &'static str,
    },
    /// The loop was resumed after more iterations than are stored.
    #[error("the loop was resumed at iteration {resumed_at}, but only {n_iterations} are stored")]
    ResumedAt {
        /// Number of iterations said to precede the rerun.
        resumed_at: usize,
        /// Number of stored iterations.
        n_iterations: usize,
    },
}
