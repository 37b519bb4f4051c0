//! Places that set a changed value.

use std::path::PathBuf;

use cardiotwin_engine::LeafChange;
use cardiotwin_input::Patient;

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
        && let (Some(patient), Some(name)) = (patient, parts.last())
        && is_accepted(change, name, patient)
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

/// Whether the new value is one that was accepted for the patient, and not that of its own file: the
/// plan has it, and the plan without anything accepted has another.
fn is_accepted(change: &LeafChange, name: &str, patient: &Patient) -> bool {
    let (Some(measured), Some(resolved)) = (&patient.measured, &patient.resolved) else {
        return false;
    };
    let json = |plan| serde_json::to_value(plan).unwrap_or_default();
    cardiotwin_engine::leaf_changes(&json(measured), &json(resolved))
        .iter()
        .any(|accepted| {
            accepted.path.rsplit('.').next() == Some(name) && accepted.new == change.new
        })
}

/// A line with key, both values, and the places that set the new one.
pub fn line(change: &LeafChange, set_in: &[String]) -> String {
    let words = change.words();
    match set_in {
        [] => format!("  {words}\n"),
        _ => format!("  {words}   ({})\n", set_in.join("; ")),
    }
}
