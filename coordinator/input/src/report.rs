//! The list that collects all problems of a cohort before any is printed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use cardiotwin_signals::Problem;
use serde::Serialize;

/// A problem and the patient whom it concerns.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Id of the patient; `None` for a problem of the cohort.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub patient: Option<String>,
    /// Description of the problem.
    #[serde(flatten)]
    pub problem: Problem,
}

/// All problems of a cohort in the order in which they were found, without duplicates.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    findings: Vec<Finding>,
    /// Files and keys with a known problem. Problems that follow from it are not reported.
    broken: BTreeSet<(PathBuf, String)>,
}

impl Report {
    /// Adds a problem, unless it is in the list or follows from one in the list.
    pub fn add(&mut self, patient: Option<&str>, problem: Problem) {
        let known = problem
            .key
            .as_ref()
            .is_some_and(|key| self.is_broken(&problem.file, key));
        let finding = Finding {
            patient: patient.map(str::to_owned),
            problem,
        };
        if !known && !self.findings.contains(&finding) {
            self.findings.push(finding);
        }
    }

    /// Takes over what a patient's own report has beyond its first `n_shared` findings.
    pub fn absorb(&mut self, of_patient: Self, n_shared: usize) {
        for finding in of_patient.findings.into_iter().skip(n_shared) {
            // Patients can find the same problem of the cohort, but no problem of each other.
            if finding.patient.is_some() || !self.findings.contains(&finding) {
                self.findings.push(finding);
            }
        }
        self.broken.extend(of_patient.broken);
    }

    /// Adds a problem and suppresses later ones at the same key.
    pub fn add_and_break(&mut self, patient: Option<&str>, problem: Problem) {
        let mark = problem.key.clone().map(|key| (problem.file.clone(), key));
        self.add(patient, problem);
        self.broken.extend(mark);
    }

    /// Suppresses later problems at a key whose problem was reported already.
    pub fn break_key(&mut self, file: &Path, key: &str) {
        self.broken.insert((file.to_owned(), key.to_owned()));
    }

    /// Whether the value at `key` of `file`, or a table around it, is marked as broken.
    #[must_use]
    pub fn is_broken(&self, file: &Path, key: &str) -> bool {
        let mut prefix = key;
        loop {
            if self.broken.contains(&(file.to_owned(), prefix.to_owned())) {
                return true;
            }
            match prefix.rfind('.') {
                Some(dot) => prefix = &prefix[..dot],
                None => return false,
            }
        }
    }

    /// Whether an error of a value in this table of a file was reported.
    #[must_use]
    pub fn has_error_in(&self, file: &Path, table: &str) -> bool {
        self.findings.iter().any(|finding| {
            let key = finding.problem.key.as_deref().unwrap_or_default();
            finding.problem.is_error()
                && finding.problem.file == file
                && key
                    .strip_prefix(table)
                    .is_some_and(|rest| rest.starts_with('.'))
        })
    }

    /// All findings in the order in which they were added.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// Number of places that keep the cohort from running. A finding that stands for many lines
    /// counts as many times.
    #[must_use]
    pub fn n_errors(&self) -> usize {
        self.count(true)
    }

    /// Number of places with problems that do not keep the cohort from running.
    #[must_use]
    pub fn n_warnings(&self) -> usize {
        self.count(false)
    }

    fn count(&self, errors: bool) -> usize {
        self.findings
            .iter()
            .filter(|f| f.problem.is_error() == errors)
            .map(|f| f.problem.n)
            .sum()
    }

    /// Whether the cohort as a whole has an error, apart from those of its patients.
    #[must_use]
    pub fn has_error_of_cohort(&self) -> bool {
        self.findings
            .iter()
            .any(|finding| finding.patient.is_none() && finding.problem.is_error())
    }

    /// Whether this patient, or the cohort as a whole, has an error.
    #[must_use]
    pub fn has_error_of(&self, patient: &str) -> bool {
        let concerns = |finding: &Finding| {
            finding
                .patient
                .as_deref()
                .is_none_or(|named| named == patient)
        };
        self.findings
            .iter()
            .any(|f| f.problem.is_error() && concerns(f))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(file: &str, key: Option<&str>) -> Problem {
        let problem = Problem::error(Path::new(file), "x", "y", "z");
        match key {
            Some(key) => problem.at_key(key),
            None => problem,
        }
    }

    #[test]
    fn what_follows_from_a_known_problem_is_not_said_again() {
        let mut report = Report::default();
        report.add_and_break(None, problem("cohort.toml", Some("step1")));
        report.add(None, problem("cohort.toml", Some("step1.tolerance")));
        report.add(None, problem("patient.toml", Some("step1.tolerance")));
        assert_eq!(report.n_errors(), 2);
    }

    #[test]
    fn a_problem_of_the_cohort_holds_every_patient() {
        let mut report = Report::default();
        report.add(Some("P1"), problem("a", None));
        assert!(report.has_error_of("P1") && !report.has_error_of("P2"));
        report.add(None, problem("a", None));
        assert!(report.has_error_of("P2"));
    }
}
