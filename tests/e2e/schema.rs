//! A validator for the part of JSON Schema that the project's schemas use: types, required and
//! known keys, items, references, enumerations.

use serde_json::Value;

/// Parts of `value` that do not fit `schema`; empty if all of it does.
pub fn misfits(value: &Value, schema: &Value) -> Vec<String> {
    let mut out = Vec::new();
    check(value, schema, schema, "$", &mut out);
    out
}

fn check(value: &Value, schema: &Value, root: &Value, at: &str, out: &mut Vec<String>) {
    if let Some(name) = schema["$ref"]
        .as_str()
        .and_then(|r| r.strip_prefix("#/$defs/"))
    {
        return check(value, &root["$defs"][name], root, at, out);
    }
    for word in ["anyOf", "oneOf"] {
        if let Some(choices) = schema[word].as_array() {
            let fits = |choice: &Value| {
                let mut inner = Vec::new();
                check(value, choice, root, at, &mut inner);
                inner.is_empty()
            };
            if !choices.iter().any(fits) {
                out.push(format!("{at}: {value} fits none of {word}"));
            }
        }
    }
    if schema
        .get("const")
        .is_some_and(|constant| constant != value)
    {
        out.push(format!("{at}: {value} is not {}", schema["const"]));
    }
    let types: Vec<&str> = match &schema["type"] {
        Value::String(one) => vec![one],
        Value::Array(many) => many.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    if !types.is_empty() && !types.iter().any(|kind| is(value, kind)) {
        out.push(format!("{at}: {value} is not {types:?}"));
    }
    if let Value::Object(map) = value {
        for name in schema["required"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
        {
            if !map.contains_key(name) {
                out.push(format!("{at}.{name} is missing"));
            }
        }
        for (name, inner) in map {
            match (
                schema["properties"].get(name),
                schema.get("additionalProperties"),
            ) {
                (Some(known), _) => check(inner, known, root, &format!("{at}.{name}"), out),
                (None, Some(Value::Bool(false))) => out.push(format!("{at}.{name} is not known")),
                (None, Some(further)) => check(inner, further, root, &format!("{at}.{name}"), out),
                (None, None) => {}
            }
        }
    }
    if let Value::Array(items) = value {
        for (i, item) in items.iter().enumerate() {
            let prefix = schema["prefixItems"].get(i);
            if let Some(inner) = prefix.or_else(|| schema.get("items").filter(|s| s.is_object())) {
                check(item, inner, root, &format!("{at}[{i}]"), out);
            }
        }
    }
}

fn is(value: &Value, kind: &str) -> bool {
    match kind {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        _ => false,
    }
}

#[test]
fn the_validator_finds_what_does_not_fit() {
    let schema = serde_json::json!({"type": "object", "required": ["a"], "additionalProperties": false,
        "properties": {"a": {"$ref": "#/$defs/A"}, "b": {"type": ["number", "null"]}},
        "$defs": {"A": {"oneOf": [{"type": "string", "const": "x"}, {"type": "string", "const": "y"}]}}});
    let fits = |text: &str| misfits(&serde_json::from_str(text).unwrap(), &schema).len();
    assert_eq!(
        [
            fits(r#"{"a": "x", "b": null}"#),
            fits(r#"{"a": "z"}"#),
            fits(r#"{"b": "1", "c": 2}"#)
        ],
        [0, 1, 3]
    );
}
