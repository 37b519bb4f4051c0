//! A table as CSV.

use serde_json::Value;

use super::model::{Cell, Table};

/// The table as CSV: the columns' keys, then all rows with unrounded numbers. A missing value is an
/// empty cell.
#[must_use]
pub fn csv(table: &Table) -> String {
    let mut out = csv::WriterBuilder::new().from_writer(Vec::new());
    let mut line = |cells: &mut dyn Iterator<Item = String>| {
        out.write_record(cells)
            .expect("memory takes any row of this width");
    };
    line(&mut table.columns.iter().map(|column| column.key.to_string()));
    for row in table.rows.iter().chain(&table.foot) {
        line(&mut row.iter().map(text));
    }
    String::from_utf8(out.into_inner().expect("memory is flushed")).expect("CSV of text is text")
}

fn text(cell: &Cell) -> String {
    match &cell.value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        value => value.to_string(),
    }
}
