//! Comparison of numbers with the ranges that the settings' types state.
//!
//! A field's range is an attribute beside it in `schemas/`, and becomes part of the JSON Schema.
//! Editors show it, and `check` reads it here. A new setting needs no further code.

use std::sync::LazyLock;

use cardiotwin_schemas::settings::Settings;
use serde_json::{Map, Value};

use super::ranges::Complaint;

static SCHEMA: LazyLock<Value> = LazyLock::new(|| schemars::schema_for!(Settings).to_value());

/// Problems of all numbers in `settings` that lie outside their range, by dotted key.
pub fn complaints(settings: &Settings) -> Vec<Complaint> {
    let value = serde_json::to_value(settings).expect("settings are JSON");
    let mut list = Vec::new();
    visit("", &value, &SCHEMA, &mut list);
    list
}

fn visit(key: &str, value: &Value, schema: &Value, list: &mut Vec<Complaint>) {
    let schema = resolved(schema);
    let below = |name: &str| match key {
        "" => name.to_owned(),
        key => format!("{key}.{name}"),
    };
    match value {
        Value::Object(fields) => {
            for (name, field) in fields {
                let stated = schema
                    .get("properties")
                    .and_then(|properties| properties.get(name))
                    .or_else(|| values_of(schema));
                if let Some(stated) = stated {
                    visit(&below(name), field, stated, list);
                }
            }
        }
        Value::Number(_) => list.extend(outside(key, value.as_f64(), schema)),
        // A null in the place of a number is a number that JSON cannot represent.
        Value::Null if schema.get("type").is_some_and(|kind| kind == "number") => {
            list.extend(outside(key, None, schema));
        }
        _ => {}
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

/// The definition to which a schema refers, also if the value is optional.
fn resolved(schema: &Value) -> &Value {
    let of_option = schema
        .get("anyOf")
        .and_then(Value::as_array)
        .and_then(|any| any.iter().find(|one| one.get("$ref").is_some()));
    let named = of_option.unwrap_or(schema).get("$ref");
    let name = named
        .and_then(Value::as_str)
        .and_then(|reference| reference.strip_prefix("#/$defs/"));
    match name.and_then(|name| SCHEMA.get("$defs")?.get(name)) {
        Some(definition) => definition,
        None => schema,
    }
}

fn outside(key: &str, value: Option<f64>, schema: &Value) -> Option<Complaint> {
    let bound = |name: &str| {
        schema
            .as_object()
            .and_then(|s: &Map<_, _>| s.get(name)?.as_f64())
    };
    let (above, low, high) = (
        bound("exclusiveMinimum"),
        bound("minimum"),
        bound("maximum"),
    );
    let high = high?;
    let is_inside = |value: f64| {
        above.is_none_or(|bound| value > bound)
            && low.is_none_or(|bound| value >= bound)
            && value <= high
    };
    if value.is_some_and(is_inside) {
        return None;
    }
    let expected = match (above, low) {
        (Some(above), _) => format!("a number above {above}, up to {high}"),
        (None, Some(low)) if schema.get("type").is_some_and(|kind| kind == "integer") => {
            format!("an integer from {low} to {high}")
        }
        (None, Some(low)) => format!("a number from {low} to {high}"),
        (None, None) => format!("a number up to {high}"),
    };
    Some(Complaint {
        key: key.to_owned(),
        against: None,
        found: value.unwrap_or(f64::NAN).to_string(),
        expected,
        remedy: "give a value in this range".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers without a range of their own: pairs that [`super::super::ranges`] compares with each
    /// other, seeds, and settings of a site.
    const FREE: [&str; 9] = [
        "step1.bounds",
        "step2.bounds",
        "step2.frozen",
        "step2.initial",
        "step2.mutation",
        "step2.seed",
        "step3.bounds",
        "executor.slurm",
        "solver.external",
    ];

    fn without_range(key: &str, schema: &Value, list: &mut Vec<String>) {
        let schema = resolved(schema);
        if FREE.contains(&key) {
            return;
        }
        let of = |name: &str| schema.get(name);
        for (name, field) in of("properties")
            .and_then(Value::as_object)
            .into_iter()
            .flatten()
        {
            let below = if key.is_empty() {
                name.clone()
            } else {
                format!("{key}.{name}")
            };
            without_range(&below, field, list);
        }
        if let Some(values) = values_of(schema) {
            without_range(&format!("{key}.NAME"), values, list);
        }
        let kinds = of("type").map(ToString::to_string).unwrap_or_default();
        let is_number = kinds.contains("number") || kinds.contains("integer");
        if is_number && of("maximum").is_none() {
            list.push(key.to_owned());
        }
    }

    #[test]
    fn every_number_among_the_settings_states_its_range() {
        let mut list = Vec::new();
        without_range("", &SCHEMA, &mut list);
        assert_eq!(list, Vec::<String>::new());
    }

    #[test]
    fn a_value_outside_its_range_is_told_with_the_range() {
        let mut settings = Settings::default();
        settings.step1.damping = 1.5;
        settings.step1.max_iterations = 0;
        settings.solver.slack_stretch = f64::NAN;
        settings.step1.weights.insert("SV_mL".into(), -1.0);
        let told: Vec<String> = complaints(&settings)
            .into_iter()
            .map(|c| format!("{}: {} is not {}", c.key, c.found, c.expected))
            .collect();
        assert_eq!(
            told,
            [
                "solver.slack_stretch: NaN is not a number from 0.8 to 1.3",
                "step1.damping: 1.5 is not a number above 0, up to 1",
                "step1.max_iterations: 0 is not an integer from 1 to 10000",
                "step1.weights.SV_mL: -1 is not a number from 0 to 1000000",
            ]
        );
    }
}
