//! The metadata of a crate as JSON-LD: a flat list of entities that refer to each other.

use std::collections::BTreeMap;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::time::{utc_ms, utc_text};
use serde_json::{Map, Value, json};

use crate::results::PatientView;

/// Name of the metadata file, which makes a folder a crate.
pub const METADATA: &str = "ro-crate-metadata.json";

/// Term of the profile that RO-Crate's own context lacks.
const SHA256: &str = "https://w3id.org/ro/terms/workflow-run#sha256";
const PROFILE: &str = "https://w3id.org/ro/wfrun/process/0.5";
const CRATE: &str = "https://w3id.org/ro/crate/1.1";
const METHOD: &str = "https://doi.org/10.3390/math10050823";

/// Statements of a crate that the run's record does not contain.
#[derive(Debug, Clone, Default)]
pub struct CrateOptions {
    /// URL of the terms of use.
    pub license: Option<String>,
    /// Name of the person who made the crate.
    pub author: Option<String>,
    /// Whether measured inputs are copied into the crate.
    pub with_inputs: bool,
}

/// A file of a crate that was written before its metadata.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CrateFile {
    /// Path relative to the crate, separated by `/`.
    pub path: String,
    /// Description in one sentence.
    pub name: String,
}

/// An input of a patient.
pub struct Input {
    /// Id of the patient.
    pub patient: PatientId,
    /// Role of the input, such as `pressure`.
    pub name: String,
    /// SHA-256 of the content.
    pub sha256: String,
    /// Path in the crate; `None` if the content is not part of it.
    pub kept: Option<String>,
}

impl Input {
    fn id(&self) -> String {
        self.kept
            .clone()
            .unwrap_or_else(|| format!("#input-{}-{}", self.patient, self.name))
    }
}

fn reference(id: impl Into<String>) -> Value {
    json!({ "@id": id.into() })
}

/// References to all ids. A single one is not wrapped in a list, as RO-Crate's JSON-LD requires.
fn references<I: Into<String>>(ids: impl IntoIterator<Item = I>) -> Value {
    let mut all: Vec<Value> = ids.into_iter().map(reference).collect();
    if all.len() == 1 {
        all.remove(0)
    } else {
        Value::Array(all)
    }
}

/// UTC in the form that the profile's checks require.
fn moment(utc: &str) -> String {
    utc.replace('Z', "+00:00")
}

/// The media type for the extension of a file name.
fn format_of(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("json") => "application/json",
        Some("csv") => "text/csv",
        Some("html") => "text/html",
        _ => "text/plain",
    }
}

/// The text of `ro-crate-metadata.json`.
pub fn metadata(
    run: &RunRecord,
    files: &[CrateFile],
    inputs: &[Input],
    options: &CrateOptions,
) -> String {
    let mut graph = Vec::new();
    let mut workers = BTreeMap::new();
    let mut actions = Vec::new();
    for patient in &run.patients {
        actions.extend(of_patient(patient, inputs, &mut workers));
    }
    let count = |is: &dyn Fn(&PatientRecord) -> bool| run.patients.iter().filter(|p| is(p)).count();
    let n_verified = count(&|p| p.verification.is_some());
    let n_personalised = count(&|p| p.verdict.as_ref().is_some_and(|v| v.personalised));
    let license = options
        .license
        .clone()
        .unwrap_or_else(|| "#license".to_owned());
    graph.push(json!({
        "@id": METADATA, "@type": "CreativeWork", "conformsTo": reference(CRATE), "about": reference("./"),
    }));
    let kept: Vec<&str> = inputs
        .iter()
        .filter_map(|input| input.kept.as_deref())
        .collect();
    let parts = files.iter().map(|file| file.path.as_str()).chain(kept);
    let mut root = json!({
        "@id": "./", "@type": "Dataset",
        "name": format!("Personalised left ventricles of the cohort {}", run.cohort),
        "description": format!(
            "{}{}{n_verified} of {} patients verified in the organ, {n_personalised} of these \
             personalised, with a record for each patient, tables, traces and a report.",
            run.description, if run.description.is_empty() { "" } else { " " }, run.patients.len()
        ),
        "datePublished": moment(&run.as_of),
        "license": reference(license.as_str()),
        "conformsTo": reference(PROFILE),
        "citation": reference(METHOD),
        "hasPart": references(parts),
        "mentions": references(actions.iter().filter_map(|action| Some(action["@id"].as_str()?.to_owned()))),
    });
    graph.push(json!({
        "@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5",
    }));
    graph.push(json!({
        "@id": METHOD, "@type": "ScholarlyArticle",
        "name": "Jung, Gsell, Augustin, Plank: the two-step method. Mathematics 2022, 10(5):823",
    }));
    if license == "#license" {
        graph.push(json!({
            "@id": "#license", "@type": "CreativeWork", "name": "No licence was stated",
            "description": "The author of this crate stated no licence: ask for permission before \
                            using the data.",
        }));
    } else {
        graph.push(json!({ "@id": license, "@type": "CreativeWork", "name": license, "description": "Licence of this crate." }));
    }
    if let Some(author) = &options.author {
        root["author"] = reference("#author");
        graph.push(json!({ "@id": "#author", "@type": "Person", "name": author }));
        actions
            .iter_mut()
            .for_each(|action| action["agent"] = reference("#author"));
    }
    graph.insert(1, root);
    for file in files {
        graph.push(json!({
            "@id": file.path, "@type": "File", "name": file.name, "encodingFormat": format_of(&file.path),
        }));
    }
    for input in inputs {
        let kind = if input.kept.is_some() {
            "File"
        } else {
            "CreativeWork"
        };
        let mut entity = json!({
            "@id": input.id(), "@type": kind, "sha256": input.sha256,
            "name": format!("{} of {}", input.name, input.patient),
        });
        match &input.kept {
            Some(path) => entity["encodingFormat"] = json!(format_of(path)),
            None => {
                entity["description"] = json!(
                    "An input that is identified by its hash and not contained in this crate."
                )
            }
        }
        graph.push(entity);
    }
    graph.extend(workers.into_values());
    graph.extend(actions);
    let document = json!({
        "@context": [format!("{CRATE}/context"), { "sha256": SHA256 }],
        "@graph": graph,
    });
    let mut text = serde_json::to_string_pretty(&document).unwrap_or_default();
    text.push('\n');
    text
}

/// Actions for a patient's tasks. The patient's record contains the dependencies between them.
fn of_patient(
    patient: &PatientRecord,
    inputs: &[Input],
    workers: &mut BTreeMap<String, Value>,
) -> Vec<Value> {
    let id = &patient.plan.id;
    let own: Vec<String> = inputs
        .iter()
        .filter(|input| input.patient == *id)
        .map(Input::id)
        .collect();
    let action = |(name, key, generation, made): (
        String,
        &str,
        u32,
        &cardiotwin_schemas::provenance::Provenance,
    )| {
        let commit = made.commit.as_deref().unwrap_or("unknown");
        let worker = format!("#cardiotwin-worker-{}-{commit}", made.version);
        workers.entry(worker.clone()).or_insert_with(|| {
            json!({
                "@id": worker, "@type": "SoftwareApplication", "name": "cardiotwin-worker",
                "description": format!("Built from commit {commit}."),
                "softwareVersion": made.version, "url": METHOD,
            })
        });
        let end = utc_ms(&made.started)
            .map(|start| moment(&utc_text(start + (1e3 * made.wall_s) as i64)));
        let mut entity = Map::new();
        entity.insert(
            "@id".into(),
            json!(format!(
                "#{id}-{}",
                name.replace([' ', ','], "-").replace("--", "-")
            )),
        );
        entity.insert("@type".into(), json!("CreateAction"));
        entity.insert("name".into(), json!(format!("{id}: {name}")));
        entity.insert(
            "description".into(),
            json!(format!(
                "Task {key}, attempt {generation}{}.",
                made.seed
                    .map_or(String::new(), |seed| format!(", seed {seed}"))
            )),
        );
        entity.insert("instrument".into(), reference(worker));
        entity.insert("startTime".into(), json!(moment(&made.started)));
        entity.insert("endTime".into(), json!(end));
        entity.insert(
            "actionStatus".into(),
            json!("http://schema.org/CompletedActionStatus"),
        );
        entity.insert("object".into(), references(own.iter().cloned()));
        let mut results = vec![format!("patients/{id}/record.json")];
        if name != "step 0" {
            results.push(format!("patients/{id}/parameters.json"));
        }
        entity.insert("result".into(), references(results));
        Value::Object(entity)
    };
    PatientView(patient)
        .tasks()
        .into_iter()
        .map(action)
        .collect()
}
