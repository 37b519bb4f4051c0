//! Checks of a trace against the numbers of the patient's file, and against the limits of any left
//! ventricle. Thresholds are ours and wide: they find a wrong unit, file or cycle, not an unusual
//! heart.
//!
//! Defects that a single file shows by itself (header, cells, order of times, gaps) are found by
//! [`crate::read`].

mod coverage;
mod pressure_volume;
mod range;
#[cfg(test)]
mod tests;

use crate::{Problem, Trace};
use cardiotwin_units::{Ml, Mmhg, Ms};
use std::path::Path;

/// A trace and the file that it came from.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// File named in problems.
    pub file: &'a Path,
    /// Trace that was read from the file.
    pub trace: &'a Trace,
}

/// A measured volume and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredVolume {
    /// Measured value of the volume.
    pub volume: Ml,
    /// Standard deviation; zero where none is stated.
    pub sd: Ml,
}

/// Measurements of one patient: the traces, and the numbers that must agree with them.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// The patient's file, named in problems of its keys.
    pub patient_file: &'a Path,
    /// Cycle length, from the key `cycle_length_ms`.
    pub cycle_length: Ms,
    /// The pressure trace, mmHg.
    pub pressure: Option<Source<'a>>,
    /// The volume trace, mL.
    pub volume: Option<Source<'a>>,
    /// Pressure at end-diastole, from the key `measured.end_diastolic_pressure_mmHg`.
    pub end_diastolic_pressure: Option<Mmhg>,
    /// Filling pressure, from the key `preload.left_atrial_pressure_mmHg`.
    pub left_atrial_pressure: Option<Mmhg>,
    /// Volume per beat that leaves through the aorta, from the key
    /// `measured.forward_stroke_volume`.
    pub forward_stroke_volume: Option<MeasuredVolume>,
}

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

/// Largest and smallest value.
fn extremes(trace: &Trace) -> (f64, f64) {
    let values = trace.values().iter().copied();
    (
        values.clone().fold(f64::NEG_INFINITY, f64::max),
        values.fold(f64::INFINITY, f64::min),
    )
}
