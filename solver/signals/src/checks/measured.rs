//! Measurements of one patient, as the checks take them.

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
    /// Names of rules whose findings the patient's file accepts.
    pub accepted: &'a [String],
}

impl Measured<'_> {
    /// Adds a problem of a rule, unless its findings are accepted.
    pub(super) fn tell(&self, rule: &str, mut problem: Problem, problems: &mut Vec<Problem>) {
        if !self.accepts(rule) {
            problem.remedy += &format!("; if it is right, accept = [{rule:?}]");
            problems.push(problem);
        }
    }

    /// Whether the findings of a rule are accepted.
    pub(super) fn accepts(&self, rule: &str) -> bool {
        self.accepted.iter().any(|name| name == rule)
    }
}

/// Largest and smallest value.
pub(super) fn extremes(trace: &Trace) -> (f64, f64) {
    let values = trace.values().iter().copied();
    (
        values.clone().fold(f64::NEG_INFINITY, f64::max),
        values.fold(f64::INFINITY, f64::min),
    )
}
