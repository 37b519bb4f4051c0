//! Comparison of a document's keys and types with the JSON Schema of its Rust type. One traversal
//! serves every file, so that a key added to a type is known here at once.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use cardiotwin_schemas::json_schema::resolve;
use cardiotwin_schemas::ranges::Range;
use cardiotwin_signals::{Position, Problem};
use schemars::{JsonSchema, Schema, schema_for};
use serde_json::{Map, Value};

use super::document::{Document, Node, Tree};
use super::nearest::nearest;
use super::report::Report;

/// The parts of `document` that fit `schema`, as JSON. Other parts are reported and left out. A
/// required key gets a placeholder instead, and is marked as broken in `report`.
pub fn fit(
    document: &Document,
    schema: &Schema,
    patient: Option<&str>,
    report: &mut Report,
) -> Value {
    let root = schema.as_value();
    let mut walk = Walk {
        document,
        root,
        patient,
        report,
    };
    walk.node(&document.root, root, "")
        .unwrap_or(Value::Object(Map::new()))
}

/// The schema of a type, which is made once: a cohort of thousands reads each of its files by it.
pub fn schema_of<T: JsonSchema + 'static>() -> &'static Schema {
    static MADE: Mutex<BTreeMap<TypeId, &'static Schema>> = Mutex::new(BTreeMap::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    made.entry(TypeId::of::<T>())
        .or_insert_with(|| Box::leak(Box::new(schema_for!(T))))
}

/// Pattern by which a schema says that keys are whole numbers.
const WHOLE_NUMBER: &str = r"^-?\d+$";

struct Walk<'a> {
    document: &'a Document,
    root: &'a Value,
    patient: Option<&'a str>,
    report: &'a mut Report,
}

impl<'a> Walk<'a> {
    fn problem(
        &mut self,
        at: Option<Position>,
        key: &str,
        found: String,
        expected: String,
        remedy: String,
    ) {
        let problem = Problem::error(&self.document.file, found, expected, remedy);
        self.report
            .add_and_break(self.patient, problem.at_key(key).at(at));
    }

    /// The value if it fits; otherwise `None`, with the reason in the report.
    fn node(&mut self, node: &Node, schema: &'a Value, key: &str) -> Option<Value> {
        let schema = resolve(schema, self.root);
        let choices: Vec<&'a str> = choices(schema);
        let kind = schema
            .get("type")
            .and_then(type_name)
            .unwrap_or(if choices.is_empty() { "any" } else { "string" });
        match (&node.value, kind) {
            (Tree::Table(table), "object") => Some(self.table(node.at, table, schema, key)),
            (Tree::Array(items), "array") => self.array(node, items, schema, key),
            (Tree::Text(text), "string") => {
                if choices.is_empty() || choices.contains(&text.as_str()) {
                    return Some(Value::String(text.clone()));
                }
                let meant = nearest(text, choices.iter().copied());
                let remedy = meant.map_or("use one of these".to_owned(), |m| {
                    format!("did you mean `{m}`?")
                });
                let expected = format!("one of {}", quoted(&choices));
                self.problem(
                    node.at,
                    key,
                    format!("the string {text:?}"),
                    expected,
                    remedy,
                );
                None
            }
            (Tree::Bool(value), "boolean") => Some(Value::Bool(*value)),
            (Tree::Integer(number), "integer") => {
                // A number outside its range may not fit the type of its field.
                let range = Range::of(schema);
                if !range.contains(*number as f64) {
                    self.problem(
                        node.at,
                        key,
                        number.to_string(),
                        range.expected(),
                        "give a value in this range".to_owned(),
                    );
                    return None;
                }
                Some((*number).into())
            }
            (Tree::Integer(number), "number") => Some(Value::from(*number as f64)),
            (Tree::Float(number), "number") => {
                let value = serde_json::Number::from_f64(*number).map(Value::Number);
                if value.is_none() {
                    let remedy = "give a finite number, or remove the key".to_owned();
                    self.problem(
                        node.at,
                        key,
                        number.to_string(),
                        "a finite number".to_owned(),
                        remedy,
                    );
                }
                value
            }
            (found, kind) => {
                let remedy = match (found, kind) {
                    (Tree::Text(_), "number" | "integer") => {
                        "write the number without quotes; its unit is in the key's name".to_owned()
                    }
                    (_, "object") => format!("write it as a table: [{key}]"),
                    (_, "string") => "put the string in quotes".to_owned(),
                    _ => format!("give {}", kind_in_words(kind, &choices)),
                };
                self.problem(
                    node.at,
                    key,
                    found.describe(),
                    kind_in_words(kind, &choices),
                    remedy,
                );
                None
            }
        }
    }

    fn table(
        &mut self,
        at: Option<Position>,
        table: &BTreeMap<String, Node>,
        schema: &'a Value,
        key: &str,
    ) -> Value {
        let properties = schema.get("properties").and_then(Value::as_object);
        let further = schema
            .get("additionalProperties")
            .filter(|schema| schema.is_object());
        // Keys that are whole numbers, such as the tags of a mesh.
        let numbered = schema
            .get("patternProperties")
            .and_then(|patterns| patterns.get(WHOLE_NUMBER));
        let mut out = Map::new();
        for (name, node) in table {
            let inner = join(key, name);
            let of_number = numbered.filter(|_| name.parse::<i32>().is_ok());
            if let Some(inner_schema) = properties
                .and_then(|all| all.get(name))
                .or(of_number)
                .or(further)
            {
                if let Some(value) = self.node(node, inner_schema, &inner) {
                    out.insert(name.clone(), value);
                }
                continue;
            }
            let known: Vec<&str> = properties
                .into_iter()
                .flat_map(Map::keys)
                .map(String::as_str)
                .collect();
            let meant =
                nearest(name, known.iter().copied()).filter(|meant| !table.contains_key(*meant));
            let remedy = meant.map_or("remove the key".to_owned(), |meant| {
                format!("did you mean `{meant}`?")
            });
            let expected = match numbered {
                Some(_) => "a whole number, such as 3".to_owned(),
                None => format!("one of {}", quoted(&known)),
            };
            self.problem(
                node.at,
                &inner,
                "an unknown key".to_owned(),
                expected,
                remedy,
            );
            // The key that was probably meant does not count as missing.
            meant.into_iter().for_each(|meant| {
                self.report
                    .break_key(&self.document.file, &join(key, meant))
            });
        }
        let required = schema.get("required").and_then(Value::as_array);
        for name in required.into_iter().flatten().filter_map(Value::as_str) {
            if out.contains_key(name) {
                continue;
            }
            let Some(property) = properties.and_then(|all| all.get(name)) else {
                continue;
            };
            let inner_schema = resolve(property, self.root);
            if !table.contains_key(name) && self.document.sound {
                self.missing(at, &join(key, name), name, property);
            }
            self.report.break_key(&self.document.file, &join(key, name));
            out.insert(name.to_owned(), placeholder(inner_schema));
        }
        Value::Object(out)
    }

    fn missing(&mut self, at: Option<Position>, key: &str, name: &str, property: &'a Value) {
        let schema = resolve(property, self.root);
        let kind = schema.get("type").and_then(type_name).unwrap_or("any");
        let meaning = [property, schema]
            .iter()
            .find_map(|s| s.get("description").and_then(Value::as_str));
        let meaning = meaning.unwrap_or_default();
        let sentence = meaning.split(['.', ';', ':']).next().unwrap_or_default();
        let expected = kind_in_words(kind, &choices(schema));
        self.problem(
            at,
            key,
            "no such key".to_owned(),
            expected,
            format!("add `{name}` ({sentence})"),
        );
    }

    fn array(
        &mut self,
        node: &Node,
        items: &[Node],
        schema: &'a Value,
        key: &str,
    ) -> Option<Value> {
        let length = |name: &str| {
            schema
                .get(name)
                .and_then(Value::as_u64)
                .and_then(|n| usize::try_from(n).ok())
        };
        if length("minItems").is_some_and(|least| items.len() < least)
            || length("maxItems").is_some_and(|most| items.len() > most)
        {
            let expected = match length("minItems") {
                Some(2) => "two numbers, lower and upper".to_owned(),
                n => format!("a list of {}", n.unwrap_or_default()),
            };
            let remedy = "write [lower, upper]".to_owned();
            self.problem(
                node.at,
                key,
                format!("a list of {}", items.len()),
                expected,
                remedy,
            );
            return None;
        }
        let item_schema = schema.get("items").unwrap_or(&Value::Bool(true));
        let values: Vec<_> = items
            .iter()
            .map(|item| self.node(item, item_schema, key))
            .collect();
        values
            .into_iter()
            .collect::<Option<Vec<_>>>()
            .map(Value::Array)
    }
}

fn placeholder(schema: &Value) -> Value {
    match schema.get("type").and_then(type_name) {
        Some("number") => Value::from(0.0),
        Some("integer") => Value::from(0),
        Some("object") => Value::Object(Map::new()),
        Some("array") => Value::Array(Vec::new()),
        _ => Value::String(String::new()),
    }
}

/// The type, or the type next to `null`.
fn type_name(kind: &Value) -> Option<&str> {
    match kind {
        Value::String(name) => Some(name),
        Value::Array(names) => names
            .iter()
            .filter_map(Value::as_str)
            .find(|name| *name != "null"),
        _ => None,
    }
}

/// The values of an enumeration.
fn choices(schema: &Value) -> Vec<&str> {
    let constants = schema
        .get("oneOf")
        .and_then(Value::as_array)
        .into_iter()
        .flatten();
    let constants = constants.filter_map(|one| one.get("const").and_then(Value::as_str));
    let listed = schema
        .get("enum")
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .filter_map(Value::as_str);
    constants.chain(listed).collect()
}

fn kind_in_words(kind: &str, choices: &[&str]) -> String {
    match kind {
        _ if !choices.is_empty() => format!("one of {}", quoted(choices)),
        "object" => "a table".to_owned(),
        "array" => "a list".to_owned(),
        "string" => "a string".to_owned(),
        "number" => "a number".to_owned(),
        "integer" => "an integer".to_owned(),
        "boolean" => "true or false".to_owned(),
        other => other.to_owned(),
    }
}

fn quoted(words: &[&str]) -> String {
    words
        .iter()
        .map(|word| format!("`{word}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// A dotted key. A part that contains a dot is quoted as in TOML.
#[must_use]
pub fn join(key: &str, name: &str) -> String {
    let name = if name.contains('.') {
        format!("\"{name}\"")
    } else {
        name.to_owned()
    };
    if key.is_empty() {
        name
    } else {
        format!("{key}.{name}")
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use cardiotwin_schemas::patient::PatientFile;

    use super::*;

    fn problems(text: &str) -> (Value, Vec<Problem>) {
        let mut report = Report::default();
        let document = Document::parse(Path::new("patient.toml"), text, None, &mut report);
        let value = fit(&document, &schema_for!(PatientFile), None, &mut report);
        (
            value,
            report
                .findings()
                .iter()
                .map(|f| f.problem.clone())
                .collect(),
        )
    }

    #[test]
    fn a_good_file_passes_and_becomes_the_type() {
        let (value, problems) =
            problems("id = 'P'\ncycle_length_ms = 800\n[measured]\npressure = 'p.csv'\n");
        assert_eq!(problems, []);
        assert_eq!(
            serde_json::from_value::<PatientFile>(value)
                .unwrap()
                .cycle_length_ms,
            800.0
        );
    }

    #[test]
    fn keys_that_are_tags_are_whole_numbers() {
        let passive = |tag: &str| {
            problems(&format!(
                "id = 'P'\ncycle_length_ms = 800\n[measured]\n[settings.solver.finite_element.wall.passive.{tag}]\n\
                 mu_kPa = 5\nkappa_kPa = 300\n"
            ))
        };
        let (value, found) = passive("2");
        assert_eq!(found, []);
        let tissue = &value["settings"]["solver"]["finite_element"]["wall"]["passive"]["2"];
        assert_eq!(tissue["mu_kPa"].as_f64(), Some(5.0));
        let (_, found) = passive("two");
        assert!(
            found[0].to_string().contains("expected a whole number"),
            "{}",
            found[0]
        );
    }

    #[test]
    fn unknown_keys_wrong_types_and_missing_keys_are_all_named() {
        let (value, problems) = problems(
            "id = 3\n[measured]\npresure = 'p.csv'\n[preload]\n[settings.step1]\nstop = 'first'\n\
             bounds = { t_CR_ms = [1] }\ndamping = '0.5'\nmax_iterations = -1\n[settings.step2.weights]\nx = nan\n",
        );
        let said: Vec<String> = problems.iter().map(ToString::to_string).collect();
        insta::assert_snapshot!(said.join("\n"));
        serde_json::from_value::<PatientFile>(value)
            .expect("what is broken is replaced, so that the rest is looked at");
    }
}
