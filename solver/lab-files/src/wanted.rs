//! Quantities to read, and the columns that were read.

use std::collections::BTreeMap;

use cardiotwin_signals::Problem;

/// A quantity to read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Wanted {
    /// Name of the quantity in messages, for example `lv_pressure`.
    pub quantity: &'static str,
    /// Accepted column names with their factors to our unit, for example `lv_pressure_mmHg` with 1.
    pub names: Vec<(String, f64)>,
    /// Whether the names come from `prepare.toml`, so that no other name counts.
    pub given: bool,
    /// Whether the file must have it.
    pub required: bool,
    /// Whether samples may be missing: an empty cell, `nan` or `NA`.
    pub may_lack: bool,
}

impl Wanted {
    /// A quantity that may be absent and may have gaps, under any name of a laboratory.
    #[must_use]
    pub fn new(quantity: &'static str) -> Self {
        Self {
            quantity,
            may_lack: true,
            ..Self::default()
        }
    }

    /// A quantity that the file must have without gaps, under any name of a laboratory.
    #[must_use]
    pub fn required(quantity: &'static str) -> Self {
        Self {
            quantity,
            required: true,
            ..Self::default()
        }
    }
}

/// Columns that were read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Values of the quantities in our units; NaN for a missing sample.
    pub columns: BTreeMap<&'static str, Vec<f64>>,
    /// Name of the column for each quantity.
    pub names: BTreeMap<&'static str, String>,
    /// Decisions in words: format, encoding, separator, and which column became which quantity.
    pub said: Vec<String>,
    /// Line numbers, from 1, as pairs of the first row in a run of consecutive lines and the line
    /// of that row. Comments end a run.
    pub(crate) lines: Vec<(usize, usize)>,
}

impl Table {
    /// Line number of a row, from 1; row of the sheet in a spreadsheet.
    #[must_use]
    pub fn line(&self, row: usize) -> usize {
        line_of(&self.lines, row)
    }
}

pub(crate) fn line_of(lines: &[(usize, usize)], row: usize) -> usize {
    let run = lines.partition_point(|(first, _)| *first <= row);
    run.checked_sub(1)
        .map_or(1, |run| lines[run].1 + row - lines[run].0)
}

/// The table if it could be read, and all problems.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TableReading {
    /// The table; `None` if the problems include an error.
    pub table: Option<Table>,
    /// Problems in the order of their lines.
    pub problems: Vec<Problem>,
}

/// The wanted quantities for a file with times of its own, whatever prepare.toml calls them.
pub(crate) fn times_of_the_file(wanted: &[Wanted]) -> Vec<Wanted> {
    let mut wanted = wanted.to_vec();
    for one in wanted.iter_mut().filter(|one| one.quantity == "time") {
        one.names = vec![("time_ms".to_owned(), 1.0)];
        one.given = false;
    }
    wanted
}
