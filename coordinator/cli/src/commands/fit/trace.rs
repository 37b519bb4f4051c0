//! Reading of a trace named on the command line.

use std::path::Path;

use cardiotwin_input::Report;
use cardiotwin_signals::checks::{Facts, contradictions};
use cardiotwin_signals::{Origin, Problem, Quantity, Trace, read_trace_from};

use crate::error::CliError;
use crate::problems;
use crate::talk::Talk;

/// Reads a trace and prints every problem.
///
/// # Errors
/// [`CliError::Trace`] if any problem is an error.
pub fn read(file: &Path, quantity: Quantity, talk: &Talk) -> Result<Trace, CliError> {
    let reading = read_trace_from(Origin::CommandLine, file, quantity);
    let n_errors = say(reading.problems, talk);
    reading
        .trace
        .filter(|_| n_errors == 0)
        .ok_or_else(|| unusable(n_errors))
}

/// Rules of consistency that the command line accepts.
#[derive(Debug, Clone, Copy)]
pub struct Accepted<'a> {
    /// Names of the rules.
    pub rules: &'a [String],
    /// Option that gave them.
    pub option: &'static str,
}

impl Accepted<'_> {
    /// What the other rules find, in words of a command without a patient's file.
    pub fn doubts(&self, facts: &Facts<'_>, file: &Path) -> Vec<Problem> {
        let mut found = contradictions(facts, self.rules, file);
        for problem in &mut found {
            problem.key = Some(match problem.key.as_deref() {
                Some("measured.calcium") => "calcium_uM".to_owned(),
                Some("measured.aortic_flow") => Quantity::Flow.column().to_owned(),
                Some("measured.aortic_pressure") => Quantity::Pressure.column().to_owned(),
                _ => self.option.to_owned(),
            });
            if let Some((remedy, rule)) = problem.remedy.split_once("accept = [\"") {
                let rule = rule.trim_end_matches("\"]");
                problem.remedy = format!("{remedy}{} {rule}", self.option);
            }
        }
        found
    }
}

/// Prints what contradicts a trace.
///
/// # Errors
/// [`CliError::Trace`] if any problem is an error.
pub fn checked(found: Vec<Problem>, talk: &Talk) -> Result<(), CliError> {
    match say(found, talk) {
        0 => Ok(()),
        n_errors => Err(unusable(n_errors)),
    }
}

/// Prints why a fit refused the trace, and returns the error for it.
pub fn refused(problem: Problem, talk: &Talk) -> CliError {
    unusable(say(vec![problem], talk))
}

fn unusable(n_errors: usize) -> CliError {
    CliError::Trace { n_errors }
}

/// Both of two readings, or the errors of both as one.
///
/// # Errors
/// Those of the readings; the numbers of errors of two unusable traces are added.
pub fn both<T>(one: Result<T, CliError>, other: Result<T, CliError>) -> Result<(T, T), CliError> {
    match (one, other) {
        (Err(CliError::Trace { n_errors: n }), Err(CliError::Trace { n_errors: m })) => {
            Err(unusable(n + m))
        }
        (one, other) => Ok((one?, other?)),
    }
}

/// Prints the problems and returns the number of errors.
fn say(found: Vec<Problem>, talk: &Talk) -> usize {
    let mut report = Report::default();
    found
        .into_iter()
        .for_each(|problem| report.add(None, problem));
    let text = problems::text(&report, talk.colour_err, true);
    if !text.is_empty() {
        talk.say(text.trim_end());
    }
    report.n_errors()
}
