//! Checks of a trace against the numbers of the patient's file, and against the limits of any left
//! ventricle. Thresholds are ours and wide: they find a wrong unit, file or cycle, not an unusual
//! heart.
//!
//! Defects that a single file shows by itself (header, cells, order of times, gaps) are found by
//! [`crate::read`].

mod aortic_means;
mod clipped;
mod consistency;
mod coverage;
mod facts;
mod further;
mod lone_volume;
mod measured;
mod pressure_volume;
mod range;
#[cfg(test)]
mod tests;

use crate::Problem;
use cardiotwin_units::Ms;
use measured::extremes;

pub use clipped::top_is_cut;
pub use consistency::{COMPARISONS, Facts, RULES, Rule, contradictions};
pub use further::check_further;
pub use lone_volume::VOLUME_KEY;
pub use measured::{Measured, MeasuredVolume, Source};
pub use range::LARGEST_ML;

/// All problems of a patient's measured data, errors first.
///
/// A trace whose unit or file is wrong is not compared any further: what else it would show follows from that.
#[must_use]
pub fn check(measured: &Measured) -> Vec<Problem> {
    let mut problems = Vec::new();
    let times_sound = coverage::check(measured, &mut problems);
    let values_sound = range::check(measured, &mut problems);
    if times_sound && values_sound {
        pressure_volume::check(measured, &mut problems);
    }
    if values_sound {
        pressure_volume::check_numbers(measured, &mut problems);
    }
    problems.sort_by_key(|p| p.severity);
    problems
}

/// Pressures that a right ventricle can have, mmHg.
pub const RIGHT_PRESSURE_MMHG: std::ops::RangeInclusive<f64> = -10.0..=150.0;

/// All problems of a right ventricle's pressure trace, errors first.
#[must_use]
pub fn check_right_pressure(source: Source, cycle_length: Ms) -> Vec<Problem> {
    let mut problems = Vec::new();
    coverage::of_pressure(source, cycle_length.0, &mut problems);
    let (most, least) = extremes(source.trace);
    if !(RIGHT_PRESSURE_MMHG.contains(&most) && RIGHT_PRESSURE_MMHG.contains(&least)) {
        let (low, high) = (RIGHT_PRESSURE_MMHG.start(), RIGHT_PRESSURE_MMHG.end());
        let problem = Problem::error(
            source.file,
            format!("pressures of {least:.1} to {most:.1} mmHg"),
            format!("{low} to {high} mmHg in a right ventricle"),
            "is it in mmHg, and the right ventricle's? correct or convert the values",
        );
        problems.push(problem.at_key("pressure_mmHg"));
    }
    problems.sort_by_key(|p| p.severity);
    problems
}
