//! Checks of step 1's settings, and the stop rule and weights that follow from the kind of update.

use std::sync::LazyLock;

use super::{FixedPointError, Weights};
use cardiotwin_vocabulary::ranges::Range;
use cardiotwin_vocabulary::step1::Step1Parameter;
use cardiotwin_vocabulary::step1_settings::{Step1Settings, StopRule, Update};

/// Rule by which the loop ends with success.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    /// The first iteration whose cost is within the tolerance ends the loop, as in the paper.
    FirstConverged,
    /// The cost is within the tolerance and the next parameters of another rule promise little: see
    /// [`super::content`].
    NoPromise,
    /// The loop runs to the limit or to stagnation and takes the best iteration.
    BestOfLimit,
}

/// Selects the rule that ends the loop. [`Update::Auto`] counts as the fixed point.
pub(super) fn stop(settings: &Step1Settings) -> Stop {
    match (settings.stop, settings.update) {
        (StopRule::Auto, Update::SpaceMapping) => Stop::NoPromise,
        (StopRule::Auto | StopRule::FirstConverged, _) => Stop::FirstConverged,
        (StopRule::BestOfLimit, _) => Stop::BestOfLimit,
    }
}

/// Weights that select the best iteration. The fixed point has none: its misfit is the cost.
///
/// # Errors
/// [`FixedPointError::UnknownBiomarker`] if step 1 does not compare a biomarker of that key.
pub(super) fn weights(settings: &Step1Settings) -> Result<Weights, FixedPointError> {
    match settings.update {
        Update::SpaceMapping => Weights::of(&settings.weights),
        Update::Auto | Update::FixedPoint => Ok(Weights::default()),
    }
}

/// A number of the settings: its key, its value, and the range that the type states.
type Number = (&'static str, fn(&Step1Settings) -> f64, Range);

/// Numbers of the settings. The ranges are read once, because a replay decides many times.
static NUMBERS: LazyLock<[Number; 5]> = LazyLock::new(|| {
    fn number(key: &'static str, value: fn(&Step1Settings) -> f64) -> Number {
        (key, value, Range::of_field::<Step1Settings>(key))
    }
    [
        number("tolerance", |s| s.tolerance),
        number("damping", |s| s.damping),
        number("max_iterations", |s| f64::from(s.max_iterations)),
        number("stall_iterations", |s| f64::from(s.stall_iterations)),
        number("stall_improvement", |s| s.stall_improvement),
    ]
});

/// Checks the numbers against the ranges that their type states, and names, bounds and weights.
///
/// # Errors
/// [`FixedPointError`] with the setting, its value and the expected range.
pub fn validate(settings: &Step1Settings) -> Result<(), FixedPointError> {
    for (key, value, range) in NUMBERS.iter() {
        let value = value(settings);
        if !range.contains(value) {
            return Err(FixedPointError::Setting {
                key,
                value,
                expected: range.expected(),
            });
        }
    }
    let named = settings.bounds.keys().chain(&settings.frozen);
    for name in named {
        if Step1Parameter::named(name).is_none() {
            return Err(FixedPointError::UnknownParameter { name: name.clone() });
        }
    }
    for parameter in Step1Parameter::ALL {
        let b = settings.bounds_of(parameter);
        if !(b.lower > 0.0 && b.lower <= b.upper && b.upper.is_finite()) {
            return Err(FixedPointError::Bounds {
                parameter,
                lower: b.lower,
                upper: b.upper,
            });
        }
    }
    weights(settings).map(|_| ())
}
