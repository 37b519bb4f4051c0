//! Files of a crate about one patient.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::task::InputFile;
use serde_json::{Map, Value, json};

/// Keys whose values are places on the machine that computed the run.
const PLACES: [&str; 4] = ["path", "directory", "run_directory", "host"];

/// The record as JSON without paths and hosts, which readers of the crate cannot reach.
#[must_use]
pub fn json(patient: &PatientRecord) -> String {
    let value = serde_json::to_value(patient).unwrap_or_default();
    let mut text = serde_json::to_string_pretty(&without_paths(value)).unwrap_or_default();
    text.push('\n');
    text
}

/// Reduces paths to the name of the file, and removes directories and hosts.
#[must_use]
pub fn without_paths(value: Value) -> Value {
    match value {
        Value::Object(map) => {
            let cleaned = map.into_iter().filter_map(|(key, value)| {
                match (PLACES.contains(&key.as_str()), &value) {
                    (true, Value::String(place)) if key == "path" => {
                        let name = Path::new(place).file_name()?.to_string_lossy().into_owned();
                        Some((key, Value::String(name)))
                    }
                    (true, Value::String(_)) => None,
                    _ => Some((key, without_paths(value))),
                }
            });
            Value::Object(cleaned.collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(without_paths).collect()),
        // Error messages may contain paths.
        Value::String(text) if text.contains('/') => Value::String(names_of_files(&text)),
        other => other,
    }
}

/// Replaces absolute paths in a sentence by the names of their files.
fn names_of_files(text: &str) -> String {
    let name = |word: &str| -> String {
        let begin = word.find(|c: char| !"\"'`([<".contains(c)).unwrap_or(0);
        let (opening, path) = word.split_at(begin);
        match path
            .strip_prefix('/')
            .and_then(|rest| rest.rsplit_once('/'))
        {
            Some((_, name)) => format!("{opening}{name}"),
            None => word.to_owned(),
        }
    };
    text.split(' ').map(name).collect::<Vec<_>>().join(" ")
}

/// JSON text with the parameters of a patient's twin: step 1, step 2, loads, effects.
#[must_use]
pub fn parameters(patient: &PatientRecord) -> String {
    let mut found = Map::new();
    found.insert("patient".into(), json!(patient.plan.id));
    if let Some(step1) = &patient.step1 {
        found.insert(
            "step1".into(),
            json!({ "quality": step1.to_string(), "cost": step1.cost, "parameters": step1.parameters }),
        );
    }
    if let Some(fit) = &patient.cell_fit {
        let values: BTreeMap<&str, f64> = fit
            .result
            .parameters
            .iter()
            .map(|p| (p.name.as_str(), p.value))
            .collect();
        found.insert(
            "step2".into(),
            json!({ "cost": fit.result.cost, "parameters": values }),
        );
    }
    if let Some(step0) = &patient.step0 {
        found.insert("circulation".into(), json!(step0.result.circulation));
        found.insert("organ".into(), json!(step0.result.organ));
    }
    if !patient.plan.effects.is_empty() {
        found.insert("effects".into(), json!(patient.plan.effects));
    }
    let mut text =
        serde_json::to_string_pretty(&without_paths(Value::Object(found))).unwrap_or_default();
    text.push('\n');
    text
}

/// Files that were measured for the patient or are read by an external solver.
#[must_use]
pub fn inputs(patient: &PatientRecord) -> Vec<&InputFile> {
    let plan = &patient.plan;
    let measured = [&plan.step0.pressure, &plan.step0.volume, &plan.calcium];
    measured
        .into_iter()
        .flatten()
        .chain(&plan.external_files)
        .collect()
}

/// Content of an input, if it is still that with which the run was planned.
pub fn content(input: &InputFile) -> Result<Vec<u8>, String> {
    let bytes = std::fs::read(&input.path).map_err(|error| {
        format!(
            "{} cannot be read ({error}): the crate contains only its hash",
            input.path.display()
        )
    })?;
    if sha256_hex(&bytes) == input.sha256 {
        return Ok(bytes);
    }
    Err(format!(
        "{} has changed since the run: the crate contains only its hash",
        input.path.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_left_out_and_names_of_files_stay() {
        let value = json!({
            "path": "/data/anna/cohort/patients/P1/pressure.csv", "directory": "/scratch/x/run/attempts/1",
            "message": "cannot read '/data/anna/run/a.csv' at line 3/4", "list": [{"host": "n1", "wall_s": 1.5}], "unit": "mL/s"
        });
        let expected = json!({
            "path": "pressure.csv", "message": "cannot read 'a.csv' at line 3/4", "list": [{"wall_s": 1.5}], "unit": "mL/s"
        });
        assert_eq!(without_paths(value), expected);
    }
}
