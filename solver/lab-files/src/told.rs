//! Problems of lines: the first ones of each kind one by one, the others as a number.

use std::collections::BTreeMap;

use cardiotwin_signals::Problem;

/// Number of lines that are reported individually for each kind of problem; further ones are
/// counted.
pub(crate) const MOST: usize = 5;

/// Problems of a file.
#[derive(Debug, Default)]
pub(crate) struct Told {
    problems: Vec<Problem>,
    kinds: BTreeMap<&'static str, (usize, Option<Problem>)>,
}

impl Told {
    /// Adds a problem that occurs once.
    pub(crate) fn add(&mut self, problem: Problem) {
        self.problems.push(problem);
    }

    /// Adds a problem of a line.
    pub(crate) fn tell(&mut self, kind: &'static str, problem: Problem) {
        let (n, last) = self.kinds.entry(kind).or_default();
        *n += 1;
        if *n <= MOST {
            self.problems.push(problem);
        } else {
            *last = Some(problem);
        }
    }

    /// Whether there is no problem.
    pub(crate) fn is_empty(&self) -> bool {
        self.problems.is_empty()
    }

    /// All problems in the order of their lines.
    pub(crate) fn problems(mut self) -> Vec<Problem> {
        for (n, last) in std::mem::take(&mut self.kinds).into_values() {
            let Some(last) = last else { continue };
            let n = n - MOST;
            let lines = if n == 1 {
                "line like those"
            } else {
                "lines like those"
            };
            let found = format!("{n} more {lines} before, the last one with {}", last.found);
            self.problems.push(Problem { found, n, ..last });
        }
        self.problems.sort_by_key(|p| p.line);
        self.problems
    }
}

/// Text of a line or cell, cut to 60 characters.
pub(crate) fn shown(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(text);
    let text = text.trim();
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).chain("...".chars()).collect()
    }
}
