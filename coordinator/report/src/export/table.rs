//! A table of patients with mean and standard deviation, as CSV and as JSON.

use std::io::{self, Write};

use serde_json::{Map, Value, json};

use super::parquet::{Parquet, Values};
use crate::results::MeanSd;
use crate::table::{self, Cell, Column, Kind};

/// A row of a table. A patient may have several rows that differ in `kind` (measured, step 1, …).
pub struct Row {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Kind of the row. Either all rows of a table have one, or none has.
    pub kind: Option<&'static str>,
    /// Values in the order of the columns; null for missing ones.
    pub values: Vec<Value>,
}

/// A table of the export.
pub struct Table {
    /// File name without extension.
    pub name: &'static str,
    /// Caption of the table.
    pub caption: &'static str,
    /// Names of the columns, including units.
    pub columns: Vec<String>,
    /// Rows in the cohort's order.
    pub rows: Vec<Row>,
}

impl Table {
    /// Kinds of rows in their order; `[None]` if rows have no kind.
    fn kinds(&self) -> Vec<Option<&'static str>> {
        let mut kinds = Vec::new();
        for row in &self.rows {
            if !kinds.contains(&row.kind) {
                kinds.push(row.kind);
            }
        }
        kinds
    }

    /// Mean and SD of every column over the rows of a kind; `None` for columns of text.
    fn spread(&self, kind: Option<&'static str>) -> Vec<Option<MeanSd>> {
        let of = |column: usize| {
            MeanSd::of(
                self.rows
                    .iter()
                    .filter(|r| r.kind == kind)
                    .map(|r| r.values[column].as_f64()),
            )
        };
        (0..self.columns.len()).map(of).collect()
    }

    /// The rows below the columns `patient`, `row` (if rows have kinds), and the table's own.
    fn rows(&self) -> table::Table {
        let with_kind = self.rows.iter().any(|r| r.kind.is_some());
        let mut columns = vec![Column::words("patient")];
        columns.extend(with_kind.then(|| Column::words("row")));
        columns.extend(self.columns.iter().cloned().map(Column::numbers));
        let mut table = table::Table::new(self.name, self.caption, columns);
        let rows = self.rows.iter();
        table.rows = rows
            .map(|r| line(&r.patient, r.kind, r.values.clone()))
            .collect();
        table
    }

    /// The table as CSV. The patients are followed by rows `mean`, `SD` (with n − 1) and `n` (number
    /// of values).
    #[must_use]
    pub fn csv(&self) -> String {
        let mut table = self.rows();
        for kind in self.kinds() {
            let spread = self.spread(kind);
            let mut foot = |name, of: &dyn Fn(MeanSd) -> Option<f64>| {
                let value = |s: &Option<MeanSd>| s.and_then(of).map(|v| rounded(v).to_string());
                let values = spread.iter().map(|s| Value::from(value(s)));
                table.foot.push(line(name, kind, values));
            };
            foot("mean", &|s| Some(s.mean));
            foot("SD", &|s| s.sd);
            let n = spread.iter().map(|s| json!(s.map_or(0, |s| s.n)));
            table.foot.push(line("n", kind, n));
        }
        table::csv(&table)
    }

    /// Writes the patients' rows as Parquet, with the columns of [`Table::csv`].
    ///
    /// # Errors
    /// Any error of `out`.
    pub fn parquet(&self, out: &mut (dyn Write + Send)) -> io::Result<()> {
        let table = self.rows();
        let names: Vec<&str> = table.columns.iter().map(|c| c.key.as_ref()).collect();
        let values = |(k, column): (usize, &Column)| {
            let values: Vec<&Value> = table.rows.iter().map(|row| &row[k].value).collect();
            let text = |value: &&Value| value.as_str().map(str::to_owned);
            match column.kind {
                Kind::Words => Values::Text(values.iter().map(text).collect()),
                _ => Values::of(&values),
            }
        };
        let columns: Vec<Values> = table.columns.iter().enumerate().map(values).collect();
        let mut file = Parquet::begin(out, &names, &columns)?;
        file.rows(&columns)?;
        file.end()
    }

    /// The table as JSON: `caption`, `columns`, `rows` by patient (and kind), and `mean`, `SD`, `n`
    /// by kind.
    #[must_use]
    pub fn json(&self) -> String {
        let object = |values: &mut dyn Iterator<Item = Value>| {
            Value::Object(
                std::iter::zip(self.columns.iter().cloned(), values).collect::<Map<_, _>>(),
            )
        };
        let mut rows = Map::new();
        for row in &self.rows {
            let values = object(&mut row.values.iter().cloned());
            match row.kind {
                None => _ = rows.insert(row.patient.clone(), values),
                Some(kind) => {
                    let patient = rows.entry(row.patient.clone()).or_insert_with(|| json!({}));
                    patient[kind] = values;
                }
            }
        }
        let by_kind = |value: &dyn Fn(&Option<MeanSd>) -> Value| {
            let mut all = Map::new();
            for kind in self.kinds() {
                let values = object(&mut self.spread(kind).iter().map(value));
                match (kind, values) {
                    (Some(kind), values) => _ = all.insert(kind.to_owned(), values),
                    (None, Value::Object(values)) => all = values,
                    (None, _) => {}
                }
            }
            Value::Object(all)
        };
        let document = json!({
            "caption": self.caption,
            "columns": self.columns,
            "rows": rows,
            "mean": by_kind(&|s| s.map_or(Value::Null, |s| json!(rounded(s.mean)))),
            "SD": by_kind(&|s| s.and_then(|s| s.sd).map_or(Value::Null, |sd| json!(rounded(sd)))),
            "n": by_kind(&|s| json!(s.map_or(0, |s| s.n))),
        });
        let mut text = serde_json::to_string_pretty(&document).expect("JSON values are JSON");
        text.push('\n');
        text
    }
}

fn line(
    patient: &str,
    kind: Option<&'static str>,
    values: impl IntoIterator<Item = Value>,
) -> Vec<Cell> {
    let names = std::iter::once(patient).chain(kind);
    let values = values.into_iter().map(Cell::from);
    names.map(Cell::from).chain(values).collect()
}

/// A value with twelve significant digits, because the last bits of a sum depend on the order of
/// its terms.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

/// A number with twelve significant digits, or null for a value that is missing or not finite.
#[must_use]
pub fn number(value: Option<f64>) -> Value {
    value.filter(|v| v.is_finite()).map_or(Value::Null, |v| {
        if v == 0.0 {
            json!(0)
        } else {
            json!(rounded(v))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let row = |patient: &str, values| Row {
            patient: patient.into(),
            kind: None,
            values,
        };
        Table {
            name: "t",
            caption: "c",
            columns: vec!["a_ms".into(), "note".into()],
            rows: vec![
                row("P1", vec![json!(1.0), json!("x, y")]),
                row("P2", vec![json!(2.0), Value::Null]),
                row("P3", vec![Value::Null, Value::Null]),
            ],
        }
    }

    #[test]
    fn mean_and_sd_leave_out_what_is_missing_and_say_how_many_there_were() {
        let csv = table().csv();
        let lines: Vec<_> = csv.lines().collect();
        assert_eq!(
            lines[..4],
            ["patient,a_ms,note", "P1,1.0,\"x, y\"", "P2,2.0,", "P3,,"]
        );
        assert_eq!(lines[4..], ["mean,1.5,", "SD,0.707106781187,", "n,2,0"]);
    }

    #[test]
    fn json_holds_the_same_numbers() {
        let json: Value = serde_json::from_str(&table().json()).unwrap();
        assert_eq!(json["rows"]["P2"]["a_ms"], 2.0);
        assert_eq!(json["rows"]["P3"]["a_ms"], Value::Null);
        assert_eq!(
            (&json["mean"]["a_ms"], &json["n"]["a_ms"]),
            (&json!(1.5), &json!(2))
        );
    }
}
