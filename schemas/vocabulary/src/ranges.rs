//! Ranges that the settings' types state, and the numbers outside of them.
//!
//! A field's range is an attribute next to it and becomes part of the JSON Schema. Editors show it,
//! `cardiotwin check` and the solvers read it here. A new setting needs no further code.

use schemars::{JsonSchema, schema_for};
use serde::Serialize;
use serde_json::Value;

use crate::json_schema::resolve;

/// Range of a number, as stated by the schema of its field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    is_integer: bool,
    above: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    below: Option<f64>,
}

impl Range {
    /// The range of a field of `T`, by its key.
    ///
    /// # Panics
    /// If `T` has no field of this key.
    #[must_use]
    pub fn of_field<T: JsonSchema>(key: &str) -> Self {
        let schema = schema_for!(T).to_value();
        let field = schema["properties"].get(key).expect("a field of the type");
        Self::of(resolve(field, &schema))
    }

    /// The range that a field's schema states. The type of an integer limits it, too.
    #[must_use]
    pub fn of(schema: &Value) -> Self {
        let bound = |name: &str| schema.get(name).and_then(Value::as_f64);
        let largest = match schema.get("format").and_then(Value::as_str) {
            Some("uint8") => Some(f64::from(u8::MAX)),
            Some("uint16") => Some(f64::from(u16::MAX)),
            Some("uint32") => Some(f64::from(u32::MAX)),
            Some("int32") => Some(f64::from(i32::MAX)),
            _ => None,
        };
        Self {
            is_integer: schema.get("type").is_some_and(|kind| match kind {
                Value::Array(kinds) => kinds.iter().any(|kind| kind == "integer"),
                kind => kind == "integer",
            }),
            above: bound("exclusiveMinimum"),
            low: bound("minimum"),
            high: bound("maximum").or(largest),
            below: bound("exclusiveMaximum"),
        }
    }

    /// Whether `value` is finite and inside.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        value.is_finite()
            && self.above.is_none_or(|bound| value > bound)
            && self.low.is_none_or(|bound| value >= bound)
            && self.high.is_none_or(|bound| value <= bound)
            && self.below.is_none_or(|bound| value < bound)
    }

    /// The range in words.
    #[must_use]
    pub fn expected(&self) -> String {
        let number = if self.is_integer {
            "an integer"
        } else {
            "a number"
        };
        let upper = |word: &str| match (self.below, self.high) {
            (Some(below), _) => format!(", below {below}"),
            (None, Some(high)) => format!("{word} {high}"),
            (None, None) => String::new(),
        };
        match (self.above, self.low) {
            (Some(above), _) => format!("{number} above {above}{}", upper(", up to")),
            (None, Some(low)) if self.is_stated() => format!("{number} from {low}{}", upper(" to")),
            (None, Some(low)) => format!("{number} of {low} or more"),
            (None, None) if self.is_stated() => format!("{number}{}", upper(" up to")),
            (None, None) if self.is_integer => number.to_owned(),
            (None, None) => "a finite number".to_owned(),
        }
    }

    /// Whether the range has an upper end.
    fn is_stated(&self) -> bool {
        self.high.is_some() || self.below.is_some()
    }
}

/// A number outside its range.
#[derive(Debug, Clone, PartialEq)]
pub struct Outside {
    /// Dotted key of the number.
    pub key: String,
    /// The number; NaN if it is not finite.
    pub value: f64,
    /// The range in words.
    pub expected: String,
}

/// The ranges of a type's fields.
#[derive(Debug)]
pub struct Ranges {
    schema: Value,
}

impl Ranges {
    /// Reads the ranges of `T`.
    #[must_use]
    pub fn of<T: JsonSchema>() -> Self {
        Self {
            schema: schema_for!(T).to_value(),
        }
    }

    /// All numbers in `value` that lie outside their range, by dotted key.
    ///
    /// # Panics
    /// If `value` cannot be written as JSON. Structs of numbers and texts always can.
    #[must_use]
    pub fn outside<T: Serialize>(&self, value: &T) -> Vec<Outside> {
        let value = serde_json::to_value(value).expect("settings are JSON");
        let mut list = Vec::new();
        self.visit("", &value, &self.schema, &mut list);
        list
    }

    /// Keys of numbers without a stated largest value. Tables in `free` are left out.
    #[must_use]
    pub fn unstated(&self, free: &[&str]) -> Vec<String> {
        let mut list = Vec::new();
        self.visit_schema("", &self.schema, free, &mut list);
        list
    }

    fn visit(&self, key: &str, value: &Value, schema: &Value, list: &mut Vec<Outside>) {
        let schema = resolve(schema, &self.schema);
        match value {
            Value::Object(fields) => {
                for (name, field) in fields {
                    let stated = schema
                        .get("properties")
                        .and_then(|properties| properties.get(name))
                        .or_else(|| values_of(schema));
                    if let Some(stated) = stated {
                        self.visit(&join(key, name), field, stated, list);
                    }
                }
            }
            Value::Number(number) => list.extend(outside(key, number.as_f64(), schema)),
            // A null in the place of a number is a number that JSON cannot represent.
            Value::Null if schema.get("type").is_some_and(|kind| kind == "number") => {
                list.extend(outside(key, None, schema));
            }
            _ => {}
        }
    }

    fn visit_schema(&self, key: &str, schema: &Value, free: &[&str], list: &mut Vec<String>) {
        let schema = resolve(schema, &self.schema);
        if free.contains(&key) {
            return;
        }
        let properties = schema.get("properties").and_then(Value::as_object);
        for (name, field) in properties.into_iter().flatten() {
            self.visit_schema(&join(key, name), field, free, list);
        }
        if let Some(values) = values_of(schema) {
            self.visit_schema(&join(key, "NAME"), values, free, list);
        }
        let kinds = schema
            .get("type")
            .map(ToString::to_string)
            .unwrap_or_default();
        let is_number = kinds.contains("number") || kinds.contains("integer");
        let has_upper_end = ["maximum", "exclusiveMaximum"]
            .iter()
            .any(|name| schema.get(name).is_some());
        if is_number && !has_upper_end {
            list.push(key.to_owned());
        }
    }
}

fn join(key: &str, name: &str) -> String {
    match key {
        "" => name.to_owned(),
        key => format!("{key}.{name}"),
    }
}

/// Schema of a map's values. Its keys are strings or, by one pattern, integers.
fn values_of(schema: &Value) -> Option<&Value> {
    let by_pattern = || {
        schema
            .get("patternProperties")?
            .as_object()?
            .values()
            .next()
    };
    schema
        .get("additionalProperties")
        .filter(|values| values.is_object())
        .or_else(by_pattern)
}

fn outside(key: &str, value: Option<f64>, schema: &Value) -> Option<Outside> {
    let range = Range::of(schema);
    if !range.is_stated() || value.is_some_and(|value| range.contains(value)) {
        return None;
    }
    Some(Outside {
        key: key.to_owned(),
        value: value.unwrap_or(f64::NAN),
        expected: range.expected(),
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_range_is_read_from_the_schema_and_said_in_words() {
        let words = |schema: Value| Range::of(&schema).expected();
        assert_eq!(
            words(json!({"type": "integer", "minimum": 40, "maximum": 100})),
            "an integer from 40 to 100"
        );
        assert_eq!(
            words(json!({"type": "integer", "format": "uint32", "minimum": 0})),
            "an integer from 0 to 4294967295"
        );
        assert_eq!(
            words(json!({"type": "number", "exclusiveMinimum": 0, "maximum": 1})),
            "a number above 0, up to 1"
        );
        let range = Range::of(&json!({"type": "number", "exclusiveMinimum": 0, "maximum": 1}));
        assert!(range.contains(1.0) && !range.contains(0.0) && !range.contains(f64::NAN));
        let share = json!({"type": "number", "minimum": 0, "exclusiveMaximum": 1});
        assert_eq!(words(share.clone()), "a number from 0, below 1");
        assert!(Range::of(&share).contains(0.0) && !Range::of(&share).contains(1.0));
    }
}
