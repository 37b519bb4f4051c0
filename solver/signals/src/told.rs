//! How often each kind of problem was met, so that a broken file does not print a thousand lines.

use crate::Problem;
use std::path::Path;

/// Lines of one kind of problem that are told one by one; the rest is counted in a last one.
pub(crate) const MAX_TOLD: usize = 5;

/// What is wrong with a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Text,
    Fields,
    Empty,
    NotFinite,
    NotANumber,
    Negative,
    Doubled,
    Backwards,
    Gap,
    SevereGap,
}

/// The kinds met so far.
#[derive(Default)]
pub(crate) struct Told(std::collections::BTreeMap<Kind, (usize, Option<Problem>)>);

impl Told {
    pub(crate) fn push(&mut self, kind: Kind, problem: Problem, problems: &mut Vec<Problem>) {
        let (n, last) = self.0.entry(kind).or_default();
        *n += 1;
        if *n <= MAX_TOLD {
            problems.push(problem);
        } else {
            *last = Some(problem);
        }
    }

    pub(crate) fn finish(self, file: &Path, problems: &mut Vec<Problem>) {
        for (n, last) in self.0.into_values() {
            let Some(last) = last else { continue };
            let found = format!(
                "{} more lines like those before, the last one with {}",
                n - MAX_TOLD,
                last.found
            );
            let summary = Problem {
                found,
                file: file.to_owned(),
                ..last
            };
            problems.push(summary);
        }
    }
}
