//! JSON Schemas of all file formats, generated from the types and committed under `schemas/json`.

use schemars::{Schema, schema_for};

/// File name and schema of each format.
#[must_use]
pub fn all() -> Vec<(&'static str, Schema)> {
    vec![
        ("cohort.schema.json", schema_for!(crate::cohort::CohortFile)),
        (
            "patient.schema.json",
            schema_for!(crate::patient::PatientFile),
        ),
        (
            "model.schema.json",
            schema_for!(crate::overlay::ModelOverlay),
        ),
        ("law.schema.json", schema_for!(crate::organ_law::LawFile)),
        ("spec.schema.json", schema_for!(crate::task::AttemptSpec)),
        (
            "outcome.schema.json",
            schema_for!(crate::outcome::TaskOutcome),
        ),
        (
            "revoked.schema.json",
            schema_for!(crate::outcome::RevokedAttempt),
        ),
        (
            "external-parameters.schema.json",
            schema_for!(crate::external::ExternalParameters),
        ),
        ("heart.schema.json", schema_for!(crate::heart::HeartSurface)),
        (
            "progress.schema.json",
            schema_for!(crate::progress::Progress),
        ),
        ("claim.schema.json", schema_for!(crate::progress::Claim)),
        ("notice.schema.json", schema_for!(crate::notices::Notice)),
        ("status.schema.json", schema_for!(crate::status::Status)),
        ("sweep.schema.json", schema_for!(crate::sweep::SweepFile)),
        (
            "sensitivity.schema.json",
            schema_for!(crate::sensitivity::SensitivityRecord),
        ),
        (
            "fit-calcium.schema.json",
            schema_for!(crate::fit::CalciumFitAnswer),
        ),
        (
            "fit-afterload.schema.json",
            schema_for!(crate::afterload::AfterloadFitAnswer),
        ),
        (
            "afterload-discovery.schema.json",
            schema_for!(crate::afterload::AfterloadDiscovery),
        ),
        ("run.schema.json", schema_for!(crate::record::RunRecord)),
        (
            "discover-case.schema.json",
            schema_for!(crate::discover::DiscoverCase),
        ),
        (
            "discover-cohort.schema.json",
            schema_for!(crate::discover::DiscoverCases),
        ),
        (
            "fit-afterload-cuff.schema.json",
            schema_for!(crate::afterload::CuffFitAnswer),
        ),
        ("raw.schema.json", schema_for!(crate::raw::RawFile)),
        (
            "prepare.schema.json",
            schema_for!(crate::preparation::Preparation),
        ),
        (
            "robustness.schema.json",
            schema_for!(crate::robustness::RobustnessResult),
        ),
    ]
}

/// Text of a schema's file.
///
/// # Panics
/// Never: a schema is JSON.
#[must_use]
pub fn text(schema: &Schema) -> String {
    let mut text = serde_json::to_string_pretty(schema).expect("a schema is JSON");
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn committed_schemas_are_current() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("json");
        for (name, schema) in super::all() {
            let committed = std::fs::read_to_string(folder.join(name)).unwrap_or_default();
            assert!(
                committed == super::text(&schema),
                "{name} is out of date: run `cargo run --release -p cardiotwin-schemas --example write-json-schemas`"
            );
        }
    }
}
