//! A TOML file as a tree that contains the position of every key.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_signals::{Position, Problem};
use toml::de::{DeTable, DeValue};

use super::report::Report;

/// A value and the position of its key.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Position of the key; `None` for a value that is not from a file.
    pub at: Option<Position>,
    /// Value of the key.
    pub value: Tree,
}

/// A value of a TOML file; a container holds its entries with their positions.
#[derive(Debug, Clone, PartialEq)]
pub enum Tree {
    /// A table, written as `[table]` or `{ inline = "table" }`.
    Table(BTreeMap<String, Node>),
    /// A list such as `[1, 2]`.
    Array(Vec<Node>),
    /// A string such as `"text"`.
    Text(String),
    /// An integer such as `12`.
    Integer(i64),
    /// A float such as `1.5`, also `nan` and `inf`.
    Float(f64),
    /// One of the words `true` and `false`.
    Bool(bool),
    /// A date or a time, which no key of cardiotwin accepts.
    Datetime(String),
}

impl Tree {
    /// Description for messages, with the value if it is short.
    #[must_use]
    pub fn describe(&self) -> String {
        match self {
            Self::Table(_) => "a table".to_owned(),
            Self::Array(items) => format!("a list of {}", items.len()),
            Self::Text(text) => format!("the string {text:?}"),
            Self::Integer(number) => format!("the integer {number}"),
            Self::Float(number) => format!("the number {number}"),
            Self::Bool(value) => format!("the boolean {value}"),
            Self::Datetime(text) => format!("the date {text}"),
        }
    }
}

/// Remedy where a cohort's file was looked for in the folder of a patient.
fn of_patient(file: &Path) -> Option<String> {
    let folder = file.parent()?;
    let is_patient = file.file_name()? == "cohort.toml" && folder.join("patient.toml").exists();
    let name = std::path::absolute(folder)
        .ok()?
        .file_name()?
        .to_string_lossy()
        .into_owned();
    is_patient.then(|| {
        format!(
            "this is the folder of a patient: name its cohort, and `--patient {name}` for it alone"
        )
    })
}

/// A file that was read and parsed.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    /// Path as given, so that messages show it as the user wrote it.
    pub file: PathBuf,
    /// Content of the file.
    pub root: Node,
    /// Whether the syntax is correct. If not, a key that seems to be missing may be in a part that
    /// could not be parsed.
    pub sound: bool,
}

impl Document {
    /// Reads and parses `file`. Every problem goes to `report`. Returns the parts that could be
    /// parsed; `None` if the file cannot be read or is not UTF-8.
    pub fn read(file: &Path, patient: Option<&str>, report: &mut Report) -> Option<Self> {
        let bytes = match input_files::read(file, MaxBytes::TEXT) {
            Ok(bytes) => bytes,
            Err(error) => {
                let found = format!("no readable file ({error})");
                let remedy = of_patient(file).unwrap_or_else(|| {
                    "create it or make it readable; `cardiotwin init DIR` writes a template"
                        .to_owned()
                });
                report.add(patient, Problem::error(file, found, "a TOML file", remedy));
                return None;
            }
        };
        match String::from_utf8(bytes) {
            Ok(text) => Some(Self::parse(file, &text, patient, report)),
            Err(error) => {
                let good = &error.as_bytes()[..error.utf8_error().valid_up_to()];
                let line = 1 + good.iter().filter(|b| **b == b'\n').count();
                let problem = Problem::error(
                    file,
                    "bytes that are not UTF-8",
                    "UTF-8 text",
                    "save the file as UTF-8",
                );
                report.add(patient, problem.at_line(line));
                None
            }
        }
    }

    /// Parses `text` as the content of `file`.
    pub fn parse(file: &Path, text: &str, patient: Option<&str>, report: &mut Report) -> Self {
        let lines = Lines::of(text);
        let (_, errors) = DeTable::parse_recoverable(text);
        let sound = errors.is_empty();
        let mut numbers = text.to_owned();
        for unit in errors.iter().filter_map(|error| Unit::of(text, error)) {
            report.add(patient, unit.problem(file, &lines));
            numbers.replace_range(unit.at.clone(), &" ".repeat(unit.at.len()));
        }
        let (table, mut errors) = DeTable::parse_recoverable(&numbers);
        errors.sort_by_key(|error| error.span().map_or(0, |span| span.start));
        for error in errors {
            let is_duplicate = error.message() == "duplicate key";
            let named = error.span().filter(|_| is_duplicate);
            let named = named.map_or_else(String::new, |span| format!(" `{}`", &numbers[span]));
            let found = format!("a syntax error: {}{named}", error.message());
            let remedy = if is_duplicate {
                "a table or key can stand only once: move these lines to where it stands already"
            } else {
                "correct it: strings need quotes, numbers do not, and decimals use a point"
            };
            let mut problem = Problem::error(file, found, "TOML", remedy);
            if let Some(span) = error.span() {
                problem = problem.at(Some(lines.position_of(span.start)));
            }
            report.add(patient, problem);
        }
        let root = Node {
            at: Some(Position { line: 1, column: 1 }),
            value: convert_table(table.get_ref(), Some(&lines)),
        };
        Self {
            file: file.to_owned(),
            root,
            sound,
        }
    }
}

/// A value given as text, as after `--set key=`: parsed as TOML if possible, otherwise the text
/// itself.
#[must_use]
pub fn value_from_text(text: &str) -> Node {
    match DeValue::parse(text) {
        Ok(value) => convert(value.get_ref(), None, None),
        Err(_) => Node {
            at: None,
            value: Tree::Text(text.to_owned()),
        },
    }
}

impl Node {
    /// A JSON value as a tree without positions. `null` values are left out.
    #[must_use]
    pub fn from_json(value: &serde_json::Value) -> Option<Self> {
        use serde_json::Value;
        let value = match value {
            Value::Null => return None,
            Value::Bool(value) => Tree::Bool(*value),
            Value::String(text) => Tree::Text(text.clone()),
            Value::Number(number) => match number.as_i64() {
                Some(integer) => Tree::Integer(integer),
                None => Tree::Float(number.as_f64()?),
            },
            Value::Array(items) => Tree::Array(items.iter().filter_map(Self::from_json).collect()),
            Value::Object(map) => Tree::Table(
                map.iter()
                    .filter_map(|(k, v)| Some((k.clone(), Self::from_json(v)?)))
                    .collect(),
            ),
        };
        Some(Self { at: None, value })
    }
}

/// A text with the offsets at which its lines begin.
struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn of(text: &'a str) -> Self {
        let after_newlines = text
            .bytes()
            .enumerate()
            .filter(|(_, b)| *b == b'\n')
            .map(|(i, _)| i + 1);
        Self {
            text,
            starts: std::iter::once(0).chain(after_newlines).collect(),
        }
    }

    /// Position of a byte offset.
    fn position_of(&self, offset: usize) -> Position {
        let line = self.starts.partition_point(|start| *start <= offset);
        let before = self.text.get(self.starts[line - 1]..offset);
        Position {
            line,
            column: 1 + before.map_or(0, |text| text.chars().count()),
        }
    }
}

/// A unit that was written after a number, as in `95 mL`.
struct Unit<'a> {
    /// Place of the value in the text.
    value: std::ops::Range<usize>,
    /// Place of the unit and the blanks before it.
    at: std::ops::Range<usize>,
    text: &'a str,
}

impl<'a> Unit<'a> {
    /// The unit in the line of a syntax error.
    fn of(text: &'a str, error: &toml::de::Error) -> Option<Self> {
        let at = error.span()?.start;
        let begin = text.get(..at)?.rfind('\n').map_or(0, |newline| newline + 1);
        let line = text[begin..].lines().next()?.split('#').next()?;
        let (key, value) = line.split_once('=')?;
        let blanks = value.len() - value.trim_start().len();
        let value = value.trim();
        let begin = begin + key.len() + 1 + blanks;
        let is_of_number = |c: char| c.is_ascii_digit() || "+-.eE_".contains(c);
        let n = value.find(|c| !is_of_number(c))?;
        let is_of_unit = |c: char| c.is_alphanumeric() || " µμ%·*/^-⁵".contains(c);
        let is_unit = value[n..].chars().all(is_of_unit);
        let number = value[..n].parse::<f64>().ok()?;
        (is_unit && number.is_finite()).then_some(Self {
            value: begin..begin + value.len(),
            at: begin + n..begin + value.len(),
            text,
        })
    }

    fn problem(&self, file: &Path, lines: &Lines<'_>) -> Problem {
        let number = &self.text[self.value.start..self.at.start];
        let found = format!("`{}`", &self.text[self.value.clone()]);
        let remedy = format!("write {number} alone, in the unit of the key's name");
        Problem::error(file, found, "a number without a unit", remedy)
            .at(Some(lines.position_of(self.value.start)))
    }
}

fn convert_table(table: &DeTable<'_>, lines: Option<&Lines<'_>>) -> Tree {
    let entries = table.iter().map(|(key, value)| {
        let at = lines.map(|lines| lines.position_of(key.span().start));
        (
            key.get_ref().to_string(),
            convert(value.get_ref(), at, lines),
        )
    });
    Tree::Table(entries.collect())
}

fn convert(value: &DeValue<'_>, at: Option<Position>, lines: Option<&Lines<'_>>) -> Node {
    let value = match value {
        DeValue::String(text) => Tree::Text(text.to_string()),
        DeValue::Integer(number) => {
            let digits = number.as_str().replace('_', "");
            match i64::from_str_radix(&digits, number.radix()) {
                Ok(integer) => Tree::Integer(integer),
                Err(_) => Tree::Float(digits.parse().unwrap_or(f64::NAN)),
            }
        }
        DeValue::Float(number) => {
            Tree::Float(number.as_str().replace('_', "").parse().unwrap_or(f64::NAN))
        }
        DeValue::Boolean(value) => Tree::Bool(*value),
        DeValue::Datetime(date) => Tree::Datetime(date.to_string()),
        DeValue::Array(items) => Tree::Array(
            items
                .iter()
                .map(|item| {
                    let at = lines.map(|lines| lines.position_of(item.span().start));
                    convert(item.get_ref(), at, lines)
                })
                .collect(),
        ),
        DeValue::Table(table) => convert_table(table, lines),
    };
    Node { at, value }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> (Document, Report) {
        let mut report = Report::default();
        let document = Document::parse(Path::new("x.toml"), text, None, &mut report);
        (document, report)
    }

    #[test]
    fn every_key_keeps_its_position() {
        let (document, report) = parse("a = 1\n\n[b]\nc = { d = 2.5 }\ne = [\n  1,\n  2]\n");
        assert!(report.findings().is_empty());
        let place = |node: &Node| node.at.map(|at| (at.line, at.column));
        let Tree::Table(root) = &document.root.value else {
            panic!()
        };
        assert_eq!(place(&root["a"]), Some((1, 1)));
        let Tree::Table(b) = &root["b"].value else {
            panic!()
        };
        let Tree::Table(c) = &b["c"].value else {
            panic!()
        };
        assert_eq!(place(&c["d"]), Some((4, 7)));
        assert_eq!(c["d"].value, Tree::Float(2.5));
        let Tree::Array(e) = &b["e"].value else {
            panic!()
        };
        assert_eq!((place(&b["e"]), place(&e[1])), (Some((5, 1)), Some((7, 3))));
    }

    #[test]
    fn all_syntax_errors_are_reported_with_their_lines() {
        let (_, report) = parse("a = \nb = 1\nc = 1,5\n");
        let lines: Vec<_> = report.findings().iter().map(|f| f.problem.line).collect();
        assert_eq!(lines.first(), Some(&Some(1)), "{:?}", report.findings());
        assert!(lines.contains(&Some(3)), "{:?}", report.findings());
    }

    #[test]
    fn text_after_set_is_toml_where_it_is() {
        assert_eq!(value_from_text("0.5").value, Tree::Float(0.5));
        assert_eq!(value_from_text("1_000").value, Tree::Integer(1000));
        assert_eq!(
            value_from_text("first-converged").value,
            Tree::Text("first-converged".into())
        );
        assert!(matches!(value_from_text("[1, 2]").value, Tree::Array(_)));
        assert_eq!(value_from_text("0x10").value, Tree::Integer(16));
    }
}
