//! Places that set a changed value.

use std::collections::HashSet;
use std::path::PathBuf;

use cardiotwin_engine::LeafChange;
use cardiotwin_input::Patient;
use cardiotwin_schemas::plan::ResolvedPatient;
use serde_json::Value;

/// Layers, or files and lines, that set the changed value. Where several keys end alike, those that
/// agree with most of the value's path.
pub fn places(
    change: &LeafChange,
    patient: Option<&Patient>,
    files: &[(String, PathBuf)],
) -> Vec<String> {
    let parts: Vec<&str> = change
        .path
        .split('.')
        .map(|part| part.split('[').next().unwrap_or(part))
        .collect();
    let mut places: Vec<String> = Vec::new();
    let names_a_file = |name: &str| parts.contains(&name) && parts.last() == Some(&"sha256");
    places.extend(
        files
            .iter()
            .filter(|(name, _)| names_a_file(name))
            .map(|(_, path)| path.display().to_string()),
    );
    if places.is_empty()
        && let Some(patient) = patient
        && is_accepted(change, patient)
    {
        places.push(format!(
            "accepted for {} by `discover --accept`, in its model.toml",
            patient.id
        ));
        return places;
    }
    if places.is_empty()
        && let (Some(patient), Some(name)) = (patient, parts.last())
    {
        let found = patient.places_of(name);
        let agreeing = |key: &str| {
            let ends = key.rsplit('.').zip(parts.iter().rev());
            ends.take_while(|(a, b)| a == *b).count()
        };
        let most = found.iter().map(|(key, _)| agreeing(key)).max();
        places.extend(
            found
                .iter()
                .filter(|(key, _)| Some(agreeing(key)) == most)
                .map(|(key, place)| match place.as_str() {
                    "default" => format!("default of {key}"),
                    place => format!("{key} in {place}"),
                }),
        );
    }
    places
}

/// Values of a patient's settings and files, each with the last part of its key.
#[derive(Debug, Default)]
pub struct PlanValues(HashSet<(String, String)>);

impl PlanValues {
    /// Values of the plan with everything that was accepted; `None` without a plan.
    pub fn of(patient: &Patient) -> Option<Self> {
        patient.resolved.as_ref().and_then(Self::of_plan)
    }

    fn of_plan(plan: &ResolvedPatient) -> Option<Self> {
        let plan = serde_json::to_value(plan).ok()?;
        let mut values = Self::default();
        values.collect("", &plan);
        Some(values)
    }

    fn collect(&mut self, name: &str, value: &Value) {
        match value {
            Value::Object(fields) => fields
                .iter()
                .for_each(|(name, value)| self.collect(name, value)),
            // A bound must not explain a fitted value that has reached it.
            Value::Array(items) => {
                let name = format!("{name}[]");
                items.iter().for_each(|item| self.collect(&name, item));
            }
            leaf => {
                self.0.insert((name.to_owned(), comparable(leaf)));
            }
        }
    }

    /// Whether the new value is one of the plan, and not a result of an earlier task.
    pub fn set(&self, change: &LeafChange) -> bool {
        let last = change.path.rsplit('.').next().unwrap_or(&change.path);
        let name = last.split('[').next().unwrap_or(last);
        let name = name.to_owned() + &"[]".repeat(last.matches('[').count());
        match &change.new {
            None => !change.path.contains('['),
            Some(new @ (Value::Object(_) | Value::Array(_))) => {
                let mut inner = Self::default();
                inner.collect(&name, new);
                inner.0.is_subset(&self.0)
            }
            Some(new) => self.0.contains(&(name, comparable(new))),
        }
    }
}

/// A value as text in which 1 and 1.0 are the same.
fn comparable(value: &Value) -> String {
    value
        .as_f64()
        .map_or_else(|| value.to_string(), |number| number.to_string())
}

/// Whether the new value is one that was accepted for the patient, and not that of its own file: the
/// plan has it, and the plan without anything accepted does not.
fn is_accepted(change: &LeafChange, patient: &Patient) -> bool {
    let (Some(measured), Some(resolved)) = (&patient.measured, &patient.resolved) else {
        return false;
    };
    let sets = |plan| PlanValues::of_plan(plan).is_some_and(|values| values.set(change));
    change.new.is_some() && sets(resolved) && !sets(measured)
}

/// A line with key, both values, and the places that set the new one.
pub fn line(change: &LeafChange, set_in: &[String]) -> String {
    let words = change.words();
    match set_in {
        [] => format!("  {words}\n"),
        _ => format!("  {words}   ({})\n", set_in.join("; ")),
    }
}
