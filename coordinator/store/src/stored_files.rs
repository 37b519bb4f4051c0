//! Files whose hashes the database holds: what finished attempts left, and what patients brought.

use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;

use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_workflow::patient::Step;
use serde::Deserialize;
use serde_json::Value;
use sqlx::Row as _;

use super::writer::parse;
use super::{MovedCohort, Reader, StoreError};

/// A file with the hash that it had when it was written or read.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct StoredFile {
    /// Pseudonym of the patient; of the first one for files that several share.
    pub patient: String,
    /// Step that made the file, such as `step-1 iteration 3`; `input` for a file of the cohort.
    pub step: String,
    /// Absolute path.
    pub path: PathBuf,
    /// SHA-256 of the content.
    pub sha256: String,
}

/// Name of the outcome in an attempt's directory.
const OUTCOME_FILE: &str = "outcome.json";
/// In the place of a step for files that no step made.
const INPUT: &str = "input";

const PUBLISHED: &str = "
SELECT tasks.key, tasks.outcome, attempts.directory
FROM tasks JOIN attempts ON attempts.task = tasks.key AND attempts.generation = (tasks.state->>'generation')
WHERE tasks.word = 'published' AND tasks.outcome IS NOT NULL";

/// Patient and step of each task; a task that was shared has several rows.
const OF_TASKS: &str = "
SELECT steps.task, patients.patient, json_object('stage', steps.stage, 'number', steps.number)
FROM steps JOIN patients ON patients.id = steps.patient_id ORDER BY patients.position DESC, steps.id";

const PLANS: &str = "
SELECT patients.patient, coalesce(plans.plan, plans.given)
FROM plans JOIN patients ON patients.id = plans.patient_id WHERE patients.active ORDER BY patients.position";

impl Reader {
    /// All files whose hashes are stored: outcomes and artefacts of finished tasks, of former
    /// settings, too, and the files that present plans of patients name. Sorted, each once.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn stored_files(&self) -> Result<Vec<StoredFile>, StoreError> {
        let mut steps: HashMap<String, (String, String)> = HashMap::new();
        for row in self.rows(OF_TASKS, None).await? {
            let (task, patient, step): (String, String, String) =
                (row.get(0), row.get(1), row.get(2));
            let step: StepRow = parse(&step, "steps", "stage", &task)?;
            steps.insert(task, (patient, Step::from(step).to_string()));
        }
        let mut files = BTreeSet::new();
        for row in self.rows(PUBLISHED, None).await? {
            let (task, outcome, directory): (String, String, String) =
                (row.get(0), row.get(1), row.get(2));
            let (patient, step) = steps.get(&task).cloned().unwrap_or_default();
            let directory = self.run_dir().join(directory);
            let mut add = |name: &str, sha256: String| {
                files.insert(StoredFile {
                    patient: patient.clone(),
                    step: step.clone(),
                    path: directory.join(name),
                    sha256,
                });
            };
            add(OUTCOME_FILE, sha256_hex(outcome.as_bytes()));
            let place = format!("the outcome of task {task} in the database");
            for artefact in OUTCOME
                .read::<cardiotwin_schemas::outcome::TaskOutcome>(&place, outcome.as_bytes())?
                .artefacts
            {
                add(&artefact.file, artefact.sha256);
            }
        }
        let moved = self.moved_cohort().await?;
        for row in self.rows(PLANS, None).await? {
            let (patient, plan): (String, String) = (row.get(0), row.get(1));
            let plan = MovedCohort::plan(moved.as_ref(), plan);
            let plan: Value = parse(&plan, "plans", "plan", &patient)?;
            named(&plan, &mut |path, sha256| {
                files.insert(StoredFile {
                    patient: patient.clone(),
                    step: INPUT.to_owned(),
                    path: PathBuf::from(path),
                    sha256: sha256.to_owned(),
                });
            });
        }
        Ok(files.into_iter().collect())
    }
}

#[derive(Deserialize)]
struct StepRow {
    stage: cardiotwin_workflow::patient::Stage,
    number: u32,
}

impl From<StepRow> for Step {
    fn from(StepRow { stage, number }: StepRow) -> Self {
        Self { stage, number }
    }
}

/// Calls `found` with each `path` next to a `sha256`, at any depth.
fn named(value: &Value, found: &mut impl FnMut(&str, &str)) {
    match value {
        Value::Object(fields) => {
            if let (Some(Value::String(path)), Some(Value::String(sha256))) =
                (fields.get("path"), fields.get("sha256"))
            {
                found(path, sha256);
            }
            fields.values().for_each(|value| named(value, found));
        }
        Value::Array(values) => values.iter().for_each(|value| named(value, found)),
        _ => {}
    }
}
