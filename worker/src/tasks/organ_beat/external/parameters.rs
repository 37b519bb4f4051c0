//! Input of an external solver: a file with all parameters, and files made from templates.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use cardiotwin_schemas::external::{
    ExternalContraction, ExternalOrgan, ExternalParameters, ParametersFormat,
};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::organ::{
    BeatCount, CELL_DEFAULTS, CELL_PARAMETERS, ContractionSpec, RICE_PARAMETERS,
};
use cardiotwin_schemas::task::OrganBeatSpec;
use serde_json::Value;

/// File with the calcium transient if it is a fixed input.
pub(super) const CALCIUM_FILE: &str = "calcium.csv";

/// All parameters of a simulation.
pub(super) fn of(spec: &OrganBeatSpec, organ: &ExternalOrgan) -> ExternalParameters {
    ExternalParameters {
        schema_version: formats::EXTERNAL_PARAMETERS.version,
        cycle_length_ms: spec.cycle_length_ms,
        time_step_ms: spec.time_step_ms,
        beats: match spec.beats {
            BeatCount::Fixed { n } => n,
            BeatCount::Periodic { max, .. } => max,
        },
        contraction: contraction(&spec.contraction),
        valves: spec.valves,
        start: organ.passive,
        activation: organ.activation,
        circulation: spec.circulation.clone(),
    }
}

fn contraction(spec: &ContractionSpec) -> ExternalContraction {
    match spec {
        ContractionSpec::Catalogue { name, parameters } => ExternalContraction {
            model: name.clone(),
            parameters: parameters.clone(),
            calcium_file: None,
        },
        ContractionSpec::Tanh { parameters } => {
            let named = serde_json::to_value(parameters).unwrap_or_default();
            let named = named.as_object().into_iter().flatten();
            let parameters = named
                .filter_map(|(name, value)| Some((name.clone(), value.as_f64()?)))
                .collect();
            ExternalContraction {
                model: "tanh".into(),
                parameters,
                calcium_file: None,
            }
        }
        ContractionSpec::Land2017Rice { parameters, .. } => ExternalContraction {
            model: "land2017-rice".into(),
            parameters: cell(parameters, true),
            calcium_file: None,
        },
        ContractionSpec::Land2017Trace { parameters, .. } => ExternalContraction {
            model: "land2017-trace".into(),
            parameters: cell(parameters, false),
            calcium_file: Some(CALCIUM_FILE.into()),
        },
    }
}

/// Land's active parameters and, with `with_rice`, those of Rice: the patient's values, otherwise
/// the defaults. `a_p_kPa` is left out because it belongs to the 0D cell.
fn cell(fitted: &BTreeMap<String, f64>, with_rice: bool) -> BTreeMap<String, f64> {
    let known = CELL_PARAMETERS.into_iter().zip(CELL_DEFAULTS);
    let wanted = known
        .filter(|(name, _)| *name != "a_p_kPa" && (with_rice || !RICE_PARAMETERS.contains(name)));
    wanted
        .map(|(name, default)| {
            (
                name.to_owned(),
                fitted.get(name).copied().unwrap_or(default),
            )
        })
        .collect()
}

/// Text of the file.
pub(super) fn text(parameters: &ExternalParameters, format: ParametersFormat) -> String {
    match format {
        // Both formats support the types of these plain values.
        ParametersFormat::Toml => toml::to_string(parameters).unwrap_or_default(),
        ParametersFormat::Json => {
            serde_json::to_string_pretty(parameters).unwrap_or_default() + "\n"
        }
    }
}

/// Values of all parameters by their placeholders in templates: numbers and texts by key,
/// parameters of effects as `EFFECT.KEY`.
pub(super) fn by_name(parameters: &ExternalParameters) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let value = serde_json::to_value(parameters).unwrap_or_default();
    collect(&value, "", &mut found);
    found
}

fn collect(value: &Value, key: &str, found: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(map) => {
            if let (Some(Value::String(name)), Some(Value::Object(parameters))) =
                (map.get("name"), map.get("parameters"))
            {
                parameters
                    .iter()
                    .for_each(|(key, value)| collect(value, &format!("{name}.{key}"), found));
                return;
            }
            map.iter()
                .for_each(|(key, value)| collect(value, key, found));
        }
        Value::Array(items) => items.iter().for_each(|item| collect(item, key, found)),
        Value::Number(number) => {
            let mut text = String::new();
            let _ = match number.as_f64().filter(|_| number.is_f64()) {
                Some(number) => write!(text, "{number}"),
                None => write!(text, "{number}"),
            };
            found.insert(key.to_owned(), text);
        }
        Value::String(text) => {
            found.insert(key.to_owned(), text.clone());
        }
        Value::Bool(_) | Value::Null => {}
    }
}
