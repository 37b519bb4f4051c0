//! A table: declared columns, and rows of cells.

use std::borrow::Cow;

use cardiotwin_schemas::biomarkers::Biomarker;
use serde::ser::{Serialize, SerializeMap, SerializeSeq, Serializer};
use serde_json::Value;

use super::digits::Digits;

/// What a cell's value means to its reader. Colour never adds information to words and signs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// Failures and errors.
    Bad,
    /// Stalled fits and warnings.
    Doubtful,
    /// Success.
    Good,
    /// Text of less importance.
    Quiet,
}

/// Content of a column, which decides how a medium shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Text.
    Words,
    /// Names with underscores, which a page shows as spaces.
    Names,
    /// Keys of quantities. A page shows the symbol and, in a column of its own, the unit.
    Keys,
    /// Text of less importance.
    Remarks,
    /// Text of numbers, on the right.
    Figures,
    /// Numbers, on the right.
    Numbers(Digits),
    /// Data for programs, which no reader sees.
    Data,
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Key in JSON and CSV.
    pub key: Cow<'static, str>,
    /// Heading in words, without its unit.
    pub label: Cow<'static, str>,
    /// Unit of all values; empty if they have none, or each its own.
    pub unit: &'static str,
    /// Content.
    pub kind: Kind,
    /// Heading that neighbouring columns share; empty for none.
    pub group: &'static str,
    /// Biomarker whose symbol is the heading of a page.
    pub symbol: Option<Biomarker>,
    /// Heading of a page that has little room; empty for the label.
    pub short: &'static str,
    /// Explanation in a few words; may be empty.
    pub meaning: &'static str,
}

impl Column {
    /// A column of this content. Its label is its key with spaces in place of underscores.
    pub fn new(key: impl Into<Cow<'static, str>>, kind: Kind) -> Self {
        let key = key.into();
        Self {
            label: key.replace('_', " ").into(),
            key,
            unit: "",
            kind,
            group: "",
            symbol: None,
            short: "",
            meaning: "",
        }
    }

    /// A column of [`Kind::Words`].
    pub fn words(key: impl Into<Cow<'static, str>>) -> Self {
        Self::new(key, Kind::Words)
    }

    /// A column of [`Kind::Figures`].
    pub fn figures(key: impl Into<Cow<'static, str>>) -> Self {
        Self::new(key, Kind::Figures)
    }

    /// A column of [`Kind::Numbers`] with as many digits as a table needs.
    pub fn numbers(key: impl Into<Cow<'static, str>>) -> Self {
        Self::new(key, Kind::Numbers(Digits::Auto))
    }

    /// A column of numbers with this many decimals.
    pub fn fixed(key: impl Into<Cow<'static, str>>, decimals: usize) -> Self {
        Self::new(key, Kind::Numbers(Digits::Fixed(decimals)))
    }

    /// The column with these digits.
    #[must_use]
    pub fn digits(self, digits: Digits) -> Self {
        let kind = Kind::Numbers(digits);
        Self { kind, ..self }
    }

    /// The column with a heading of its own.
    #[must_use]
    pub fn label(self, label: impl Into<Cow<'static, str>>) -> Self {
        let label = label.into();
        Self { label, ..self }
    }

    /// The column with a unit in its heading.
    #[must_use]
    pub fn unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    /// The column with an explanation.
    #[must_use]
    pub fn meaning(self, meaning: &'static str) -> Self {
        Self { meaning, ..self }
    }

    /// Whether the column stands on the right.
    #[must_use]
    pub fn is_right(&self) -> bool {
        matches!(self.kind, Kind::Figures | Kind::Numbers(_))
    }

    /// Whether the values are relative differences.
    #[must_use]
    pub fn is_difference(&self) -> bool {
        self.kind == Kind::Numbers(Digits::Difference)
    }

    /// Text of a cell for a reader. No other place formats a table's numbers.
    #[must_use]
    pub fn text(&self, cell: &Cell) -> String {
        self.digits_of(cell).write(&cell.value)
    }

    /// Format of a cell: its own, or the column's.
    #[must_use]
    pub fn digits_of(&self, cell: &Cell) -> Digits {
        match (cell.digits, self.kind) {
            (Some(digits), _) | (None, Kind::Numbers(digits)) => digits,
            (None, _) => Digits::Auto,
        }
    }
}

/// A cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cell {
    /// Number, text, or null for a missing value.
    pub value: Value,
    /// Format of the number, if it is not the column's.
    pub digits: Option<Digits>,
    /// What the value means.
    pub tone: Option<Tone>,
    /// Remark below the value on a page; may be empty.
    pub note: String,
    /// Explanation that a page shows on hover; may be empty.
    pub hint: String,
    /// Address of a page's link; may be empty.
    pub link: String,
}

impl Cell {
    /// The cell with a tone, if there is one.
    #[must_use]
    pub fn toned(self, tone: impl Into<Option<Tone>>) -> Self {
        let tone = tone.into();
        Self { tone, ..self }
    }

    /// The cell with a format of its own.
    #[must_use]
    pub fn digits(self, digits: Digits) -> Self {
        let digits = Some(digits);
        Self { digits, ..self }
    }

    /// The cell with an explanation.
    #[must_use]
    pub fn hint(self, hint: impl Into<String>) -> Self {
        let hint = hint.into();
        Self { hint, ..self }
    }
}

impl<T: Into<Value>> From<T> for Cell {
    fn from(value: T) -> Self {
        let value = value.into();
        Self {
            value,
            ..Self::default()
        }
    }
}

/// A row from values of different types.
#[macro_export]
macro_rules! cells {
    ($($value:expr),* $(,)?) => { vec![$($crate::table::Cell::from($value)),*] };
}
pub use crate::cells;

/// A table. It serialises as an array of objects, one for each row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// Name in files, and class on pages.
    pub key: &'static str,
    /// Caption on pages.
    pub title: Cow<'static, str>,
    /// Columns.
    pub columns: Vec<Column>,
    /// Rows, each with a cell for each column.
    pub rows: Vec<Vec<Cell>>,
    /// Rows about all rows, which end the table.
    pub foot: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows.
    pub fn new(
        key: &'static str,
        title: impl Into<Cow<'static, str>>,
        columns: impl IntoIterator<Item = Column>,
    ) -> Self {
        Self {
            key,
            title: title.into(),
            columns: columns.into_iter().collect(),
            ..Self::default()
        }
    }

    /// A table of rows that have JSON of their own: each column shows what stands under its key.
    pub fn of<T: Serialize>(
        key: &'static str,
        columns: impl IntoIterator<Item = Column>,
        rows: &[T],
    ) -> Self {
        let mut table = Self::new(key, "", columns);
        for row in rows {
            let row = serde_json::to_value(row).unwrap_or_default();
            let value = |column: &Column| row.get(column.key.as_ref()).cloned();
            let cells = table.columns.iter().map(value).map(Cell::from);
            table.rows.push(cells.collect());
        }
        table
    }

    /// Place of the column with a key.
    #[must_use]
    pub fn place(&self, key: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.key == key)
    }

    /// Values of the column with a key, from the rows.
    pub fn values(&self, key: &str) -> impl Iterator<Item = &Value> {
        let place = self.place(key);
        let rows = self.rows.iter();
        rows.filter_map(move |row| Some(&row.get(place?)?.value))
    }

    /// The table with a link from the first cell of each row.
    ///
    /// - `link`: address for the position and the first value of a row
    #[must_use]
    pub fn linked(mut self, link: impl Fn(usize, &str) -> String) -> Self {
        for (k, row) in self.rows.iter_mut().enumerate() {
            if let Some(first) = row.first_mut() {
                first.link = link(k, first.value.as_str().unwrap_or_default());
            }
        }
        self
    }

    /// The table without columns.
    #[must_use]
    pub fn without(mut self, is_left_out: impl Fn(&Column) -> bool) -> Self {
        let kept: Vec<bool> = self.columns.iter().map(|c| !is_left_out(c)).collect();
        for row in self.rows.iter_mut().chain(&mut self.foot) {
            keep(row, &kept);
        }
        keep(&mut self.columns, &kept);
        self
    }

    /// The table without rows that have no number.
    #[must_use]
    pub fn without_empty_rows(mut self) -> Self {
        self.rows
            .retain(|row| row.iter().any(|cell| cell.value.is_number()));
        self
    }
}

fn keep<T>(all: &mut Vec<T>, kept: &[bool]) {
    let mut kept = kept.iter();
    all.retain(|_| kept.next().is_none_or(|kept| *kept));
}

impl Serialize for Table {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        struct Row<'a>(&'a [Column], &'a [Cell]);
        impl Serialize for Row<'_> {
            fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
                let mut row = to.serialize_map(Some(self.0.len()))?;
                for (column, cell) in std::iter::zip(self.0, self.1) {
                    row.serialize_entry(&column.key, &cell.value)?;
                }
                row.end()
            }
        }
        let mut rows = to.serialize_seq(Some(self.rows.len()))?;
        for row in &self.rows {
            rows.serialize_element(&Row(&self.columns, row))?;
        }
        rows.end()
    }
}
