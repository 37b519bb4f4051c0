//! Parquet files of typed columns. Every value may be missing.

use std::io::{self, Write};
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use serde_json::Value;

/// Values of one column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// UTF-8.
    Text(Vec<Option<String>>),
    /// Double precision.
    Number(Vec<Option<f64>>),
    /// 64 bits.
    Integer(Vec<Option<i64>>),
    /// True or false.
    Flag(Vec<Option<bool>>),
}

impl Values {
    /// Column of JSON values: integers, numbers, flags or, if they differ in kind, text. Without
    /// any value it is a column of numbers.
    pub fn of(values: &[&Value]) -> Self {
        let present = || values.iter().filter(|value| !value.is_null());
        if present().next().is_some() && present().all(|value| value.is_i64()) {
            Self::Integer(values.iter().map(|value| value.as_i64()).collect())
        } else if present().all(|value| value.is_number()) {
            Self::Number(values.iter().map(|value| value.as_f64()).collect())
        } else if present().all(|value| value.is_boolean()) {
            Self::Flag(values.iter().map(|value| value.as_bool()).collect())
        } else {
            let text = |value: &&Value| match value {
                Value::Null => None,
                Value::String(text) => Some(text.clone()),
                value => Some(value.to_string()),
            };
            Self::Text(values.iter().map(text).collect())
        }
    }

    fn physical(&self) -> (Physical, Option<LogicalType>) {
        match self {
            Self::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Self::Number(_) => (Physical::DOUBLE, None),
            Self::Integer(_) => (Physical::INT64, None),
            Self::Flag(_) => (Physical::BOOLEAN, None),
        }
    }
}

fn failed(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(source) => *source,
            Err(source) => io::Error::other(source),
        },
        error => io::Error::other(error),
    }
}

/// A file in progress.
pub struct Parquet<W: Write + Send> {
    writer: SerializedFileWriter<W>,
}

impl<W: Write + Send> Parquet<W> {
    /// Begins a file with the names of its columns and their kinds, as in `like`.
    ///
    /// # Errors
    /// Any error of `out`.
    pub fn begin(out: W, names: &[&str], like: &[Values]) -> io::Result<Self> {
        let field = |(name, values): (&&str, &Values)| {
            let (physical, logical) = values.physical();
            Type::primitive_type_builder(name, physical)
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(logical)
                .build()
                .map(Arc::new)
        };
        let fields: Result<Vec<_>, _> = names.iter().zip(like).map(field).collect();
        let schema = Type::group_type_builder("rows")
            .with_fields(fields.map_err(failed)?)
            .build()
            .map_err(failed)?;
        let how = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .build();
        let writer = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(how));
        Ok(Self {
            writer: writer.map_err(failed)?,
        })
    }

    /// Appends rows, by column.
    ///
    /// # Errors
    /// Any error of the output.
    pub fn rows(&mut self, columns: &[Values]) -> io::Result<()> {
        let mut group = self.writer.next_row_group().map_err(failed)?;
        for values in columns {
            let written = match values {
                Values::Text(values) => column::<ByteArrayType, _>(&mut group, values, |text| {
                    ByteArray::from(text.as_str())
                }),
                Values::Number(values) => column::<DoubleType, _>(&mut group, values, |v| *v),
                Values::Integer(values) => column::<Int64Type, _>(&mut group, values, |v| *v),
                Values::Flag(values) => column::<BoolType, _>(&mut group, values, |v| *v),
            };
            written.map_err(failed)?;
        }
        group.close().map(drop).map_err(failed)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// Any error of the output.
    pub fn end(self) -> io::Result<()> {
        self.writer.close().map(drop).map_err(failed)
    }
}

fn column<T: DataType, V>(
    group: &mut SerializedRowGroupWriter<'_, impl Write + Send>,
    values: &[Option<V>],
    store: impl Fn(&V) -> T::T,
) -> Result<(), ParquetError> {
    let present: Vec<i16> = values.iter().map(|v| i16::from(v.is_some())).collect();
    let stored: Vec<T::T> = values.iter().flatten().map(store).collect();
    let Some(mut column) = group.next_column()? else {
        return Ok(());
    };
    column
        .typed::<T>()
        .write_batch(&stored, Some(&present), None)?;
    column.close()
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::Field;
    use serde_json::json;

    use super::*;

    #[test]
    fn a_column_has_the_kind_of_its_values() {
        let of = |values: &[Value]| Values::of(&values.iter().collect::<Vec<_>>());
        assert_eq!(
            of(&[json!(1), Value::Null]),
            Values::Integer(vec![Some(1), None])
        );
        assert_eq!(
            of(&[json!(1), json!(0.5)]),
            Values::Number(vec![Some(1.0), Some(0.5)])
        );
        assert_eq!(of(&[Value::Null]), Values::Number(vec![None]));
        assert_eq!(of(&[json!(true)]), Values::Flag(vec![Some(true)]));
        let mixed = of(&[json!("ü"), json!(2), Value::Null]);
        assert_eq!(
            mixed,
            Values::Text(vec![Some("ü".into()), Some("2".into()), None])
        );
    }

    #[test]
    fn rows_are_read_back() {
        let rows = |text: &str, number| {
            [
                Values::Text(vec![Some(text.into()), None]),
                Values::Number(vec![None, number]),
                Values::Integer(vec![Some(-3), None]),
                Values::Flag(vec![None, Some(true)]),
            ]
        };
        let out = tempfile::tempfile().unwrap();
        let first = rows("01-CoA", Some(0.25));
        let mut file = Parquet::begin(&out, &["a", "b_ms", "c", "d"], &first).unwrap();
        file.rows(&first).unwrap();
        file.rows(&rows("ü", Some(f64::MIN_POSITIVE))).unwrap();
        file.end().unwrap();
        let reader = SerializedFileReader::new(out).unwrap();
        let read: Vec<Vec<(String, Field)>> = reader
            .get_row_iter(None)
            .unwrap()
            .map(|row| row.unwrap().into_columns())
            .collect();
        assert_eq!(read.len(), 4);
        assert_eq!(read[0][0], ("a".into(), Field::Str("01-CoA".into())));
        assert_eq!(read[1][1], ("b_ms".into(), Field::Double(0.25)));
        assert_eq!(read[2][0].1, Field::Str("ü".into()));
        assert_eq!(read[3][1].1, Field::Double(f64::MIN_POSITIVE));
        assert_eq!(
            (&read[3][2].1, &read[3][3].1),
            (&Field::Null, &Field::Bool(true))
        );
    }
}
