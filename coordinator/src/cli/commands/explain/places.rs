//! Places that set a changed value.

use std::path::PathBuf;

use crate::engine::LeafChange;
use crate::input::Patient;

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

/// A line with key, both values, and the places that set the new one.
pub fn line(change: &LeafChange, set_in: &[String]) -> String {
    let words = change.words();
    match set_in {
        [] => format!("  {words}\n"),
        _ => format!("  {words}   ({})\n", set_in.join("; ")),
    }
}
