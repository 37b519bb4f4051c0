//! Channels of a file that are already numbers, and the choice among them.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::columns::Header;
use crate::delimited::{not_increasing, too_few};
use crate::headers::Label;
use crate::told::Told;
use crate::wanted::{Table, TableReading, Wanted, line_of};

/// Channels with their labels; NaN for a missing sample.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Grid {
    pub(crate) labels: Vec<Label>,
    /// Values of each channel in the channel's unit.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Line of the header, from 1; `None` in a binary file.
    pub(crate) header_line: Option<usize>,
    /// Runs of rows in consecutive lines, as in [`Table`]; empty in a binary file.
    pub(crate) lines: Vec<(usize, usize)>,
    /// Decisions in words.
    pub(crate) said: Vec<String>,
}

impl Grid {
    /// Chooses the columns for `wanted` and converts them to the program's units.
    pub(crate) fn choose(self, file: &Path, wanted: &[Wanted]) -> TableReading {
        let header = Header {
            file,
            line: self.header_line,
            labels: &self.labels,
            warn_of_others: false,
        };
        let chosen = header.choose(wanted);
        let mut told = Told::default();
        chosen
            .problems
            .into_iter()
            .for_each(|problem| told.add(problem));
        let mut table = Table {
            said: [self.said, chosen.said].concat(),
            lines: self.lines,
            ..Table::default()
        };
        for column in &chosen.columns {
            let one = &wanted[column.wanted];
            let name = &self.labels[column.place].full;
            let values: Vec<f64> = self.columns[column.place]
                .iter()
                .map(|v| v * column.factor)
                .collect();
            let at = |problem: Problem, row: usize| {
                let problem = problem.at_key(name.clone());
                if table.lines.is_empty() {
                    Problem {
                        found: format!("{} (sample {})", problem.found, row + 1),
                        ..problem
                    }
                } else {
                    problem.at_line(line_of(&table.lines, row))
                }
            };
            if !one.may_lack {
                for row in (0..values.len()).filter(|row| !values[*row].is_finite()) {
                    let problem = Problem::error(
                        file,
                        "an empty cell or a word",
                        "a number",
                        "fill in the number, or remove the row",
                    );
                    told.tell("missing", at(problem, row));
                }
            }
            if column.wanted == 0 {
                for (row, pair) in values.windows(2).enumerate().filter(|(_, p)| p[1] <= p[0]) {
                    told.tell("times", at(not_increasing(file, pair[1], pair[0]), row + 1));
                }
            }
            if values.len() < 2 {
                told.add(too_few(file, values.len()));
            }
            table.names.insert(one.quantity, name.clone());
            table.columns.insert(one.quantity, values);
        }
        let problems = told.problems();
        let sound = !problems.iter().any(Problem::is_error);
        TableReading {
            table: Some(table).filter(|table| sound && !table.columns.is_empty()),
            problems,
        }
    }
}
