//! Formats of files, database columns and answers, each with its own version, and the reader of their JSON.
//!
//! | question | answer |
//! |---|---|
//! | When is a version raised? | When a program that knows only the old version would misread the new content |
//! | What is an addition? | A key that earlier programs may ignore, and do; the version stays |
//! | Where is a version stored? | In the key `schema_version`; JSON without that key has version 1. Binary files have it in their first line, a database in `user_version` |
//! | What does a reader accept? | Its own version and all earlier ones; it refuses later ones |
//!
//! [`Format::golden`] is a present-day file of the format. Tests read all of these files, so that later programs read the
//! files of this one. Files that people write (`cohort.toml`, `patient.toml`, `prepare.toml`) have no version:
//! the reader refuses an unknown key and suggests the nearest known one.

use std::collections::BTreeSet;

use cardiotwin_vocabulary::json_schema::resolve;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A format with its version, its writer and its reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// Name in messages and documents.
    pub name: &'static str,
    /// Version that is written.
    pub version: u32,
    /// File, column of the database, or command whose answer has this format.
    pub place: &'static str,
    /// Program that writes it.
    pub writer: &'static str,
    /// Program that reads it.
    pub reader: &'static str,
    /// Path of the golden file from the repository's root. It is empty for answers that only users' programs read, and for
    /// files that are recomputed if their version differs.
    pub golden: &'static str,
}

macro_rules! formats {
    ($(#[$doc_of_all:meta])* $all:ident; $($(#[$doc:meta])* $constant:ident {
        $name:literal, $version:literal, $place:literal, $writer:literal, $reader:literal, $golden:literal
    })*) => {
        $(
            $(#[$doc])*
            pub const $constant: Format = Format {
                name: $name,
                version: $version,
                place: $place,
                writer: $writer,
                reader: $reader,
                golden: $golden,
            };
        )*
        $(#[$doc_of_all])*
        pub const $all: &[Format] = &[$($constant),*];
    };
}

formats! {
    /// Formats that a program stores and reads, in the order of `docs/formats.md`.
    ALL;

    /// Task of an attempt. Its reader refuses unknown keys, because a worker must understand an order in full.
    SPEC { "attempt's specification", 1, "`spec.json`", "coordinator, driver", "worker", "schemas/tests/golden/spec.json" }
    /// Worker process that holds an attempt.
    CLAIM { "claim", 1, "`started.json`", "worker", "coordinator, worker", "schemas/tests/golden/claim.json" }
    /// Progress of a worker.
    PROGRESS { "progress", 1, "`progress.jsonl`", "worker", "coordinator", "schemas/tests/golden/progress.jsonl" }
    /// Ending of an attempt.
    OUTCOME { "outcome", 1, "`outcome.json`, column `tasks.outcome`", "worker", "coordinator", "schemas/tests/golden/outcome.json" }
    /// Revocation of an attempt, under the name of its outcome.
    REVOCATION { "revocation", 1, "`outcome.json`", "coordinator", "coordinator, worker", "schemas/tests/golden/revocation.json" }
    /// The job that made an attempt's directory.
    ALLOCATION { "attempt's allocation", 1, "`allocation.json`", "driver", "coordinator, driver", "schemas/tests/golden/allocation.json" }
    /// The wall of a 3D simulation for pictures.
    HEART { "heart surface", 1, "`heart.json`", "worker", "coordinator", "schemas/tests/golden/heart.json" }
    /// Parameters for an external solver.
    EXTERNAL_PARAMETERS { "external parameters", 1, "parameters of an external solver", "worker", "external solver", "schemas/tests/golden/external-parameters.json" }
    /// Named arrays with a header and a checksum.
    ARRAYS { "arrays", 1, "`ventricle.bin`, `checkpoint/beat.bin`", "worker", "worker", "worker/tests/golden/arrays.bin" }
    /// Ventricle of step 0: mesh, wall and end-diastolic state as named arrays.
    VENTRICLE { "ventricle", 2, "arrays of `ventricle.bin`", "worker", "worker", "" }
    /// State of a beat between two steps as named arrays.
    BEAT_CHECKPOINT { "beat checkpoint", 4, "arrays of `checkpoint/beat.bin`", "worker", "worker", "" }
    /// Costs that an optimiser received.
    SEARCH_JOURNAL { "search journal", 2, "`checkpoint/told-costs`", "worker", "worker", "worker/tests/golden/told-costs" }
    /// Samples in the order of their computation.
    SAMPLE_LOG { "sample log", 1, "`checkpoint/samples`", "worker", "worker", "worker/tests/golden/samples" }

    /// Work of one element of a cluster job.
    JOB_ORDER { "job order", 1, "`order-E.json`", "coordinator", "driver", "schemas/tests/golden/job-order.json" }
    /// A driver's claim on an element's node.
    DRIVER_CLAIM { "driver's claim", 1, "`started-E-N.json`", "driver", "coordinator", "schemas/tests/golden/driver-claim.json" }
    /// Final report of a driver.
    DRIVER_END { "driver's end", 1, "`ended-E-N.json`", "driver", "coordinator", "schemas/tests/golden/driver-end.json" }

    /// Database of a run. Migrations raise earlier versions to this one.
    DATABASE { "database", 2, "`cardiotwin.db`", "coordinator", "coordinator", "coordinator/store/src/golden/database.sql" }
    /// State of a patient's state machine.
    PATIENT_STATE { "patient's state", 1, "column `patients.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/patient-states.json" }
    /// State of a task's state machine.
    TASK_STATE { "task's state", 1, "column `tasks.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/task-states.json" }
    /// State of an attempt's state machine.
    ATTEMPT_STATE { "attempt's state", 1, "column `attempts.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/attempt-states.json" }
    /// State of the state machine of a cluster's job.
    JOB_STATE { "cluster job's state", 1, "column `jobs.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/job-states.json" }
    /// Events of the state machines.
    EVENTS { "events", 1, "column `events.event`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/events.json" }
    /// Settled part of a patient's chain.
    CHAIN { "chain", 1, "column `plans.chain`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/chain.json" }
    /// Settings and inputs from which a patient's tasks are derived.
    PLAN { "plan", 1, "columns `plans.given`, `plans.plan`", "coordinator", "coordinator", "schemas/tests/golden/plan.json" }
    /// Actions that were decided and are still to be executed.
    ACTIONS { "actions", 1, "column `outbox.action`", "coordinator", "coordinator", "coordinator/store/src/golden/actions.json" }
    /// Requests to a cluster and its answers.
    JOB_BOOKS { "cluster job's books", 1, "columns `jobs.spec`, `jobs.seen`, `allotments.allotment`", "coordinator", "coordinator", "coordinator/store/src/golden/job-books.json" }
    /// Process that holds a run.
    LOCK { "lock", 1, "`coordinator.lock`", "coordinator", "coordinator", "coordinator/store/src/golden/lock.json" }
    /// Host that holds a run on a shared file system.
    LEASE { "lease", 1, "`lease/*.json`", "coordinator", "coordinator", "coordinator/store/src/golden/lease.json" }
    /// Request of a command to a running coordinator.
    REQUEST { "request", 1, "`requests/*.json`", "coordinator's commands", "coordinator", "coordinator/engine/src/golden/requests.json" }

    /// Specification of a sweep.
    SWEEP { "sweep", 1, "`sweep.json`", "coordinator", "coordinator", "schemas/tests/golden/sweep.json" }
    /// Results of a sensitivity sweep.
    SENSITIVITY { "sensitivity", 1, "`results/sensitivity.json`", "coordinator", "coordinator", "schemas/tests/golden/sensitivity.json" }
    /// Results of a robustness sweep.
    ROBUSTNESS { "robustness", 1, "`results/robustness.json`", "coordinator", "coordinator", "schemas/tests/golden/robustness.json" }
    /// Findings of a search for missing effects.
    DISCOVER_CASE { "discover case", 1, "`discover/discover.json`, `cardiotwin discover --json`", "coordinator", "coordinator", "schemas/tests/golden/discover-case.json" }
    /// Findings about a patient.
    MODEL { "patient's model", 1, "`model.toml`", "coordinator, people", "coordinator", "schemas/tests/golden/model.toml" }
    /// What organs taught about the organ's law.
    LAW { "organ's law", 1, "`cardiotwin export --law FILE`", "coordinator", "coordinator, worker", "schemas/tests/golden/law.json" }
    /// Steps from recordings to a patient's files.
    PREPARATION { "preparation", 1, "`prepared/prepare.json`, `cardiotwin prepare --json`", "coordinator", "people's programs", "schemas/tests/golden/preparation.json" }
    /// A message to people.
    NOTICE { "notice", 1, "standard input of a notice's command", "coordinator", "people's programs", "schemas/tests/golden/notice.json" }
    /// State of each patient of a run.
    STATUS { "status", 1, "`cardiotwin status --json`", "coordinator", "people's programs", "schemas/tests/golden/status.json" }
    /// A run with all results.
    RUN_RECORD { "run record", 1, "`cardiotwin show --json`, `record.json` of an RO-Crate", "coordinator", "people's programs", "schemas/tests/golden/run-record.json" }
    /// A fitted calcium transient.
    CALCIUM_FIT { "calcium fit", 2, "`cardiotwin fit calcium --json`", "coordinator", "people's programs", "schemas/tests/golden/calcium-fit-2.json" }
    /// A Windkessel fitted to flow and pressure.
    AFTERLOAD_FIT { "afterload fit", 1, "`cardiotwin fit afterload --json`", "coordinator", "people's programs", "schemas/tests/golden/afterload-fit.json" }
    /// An afterload fitted to a cuff's pressures.
    CUFF_FIT { "cuff fit", 1, "`cardiotwin fit afterload --cuff --json`", "coordinator", "people's programs", "schemas/tests/golden/cuff-fit.json" }
    /// Missing effects of an afterload.
    AFTERLOAD_DISCOVERY { "afterload discovery", 1, "`cardiotwin discover --afterload --json`", "coordinator", "people's programs", "schemas/tests/golden/afterload-discovery.json" }
}

formats! {
    /// Answers of commands with `--json` that have no other format. Only users' programs read them.
    ANSWERS;

    /// Problems of a cohort.
    CHECK { "check", 1, "`cardiotwin check --json`", "coordinator", "people's programs", "" }
    /// Two runs side by side.
    COMPARISON { "comparison", 1, "`cardiotwin compare --json`", "coordinator", "people's programs", "" }
    /// Obstacles to a run on this machine.
    DOCTOR { "doctor's findings", 1, "`cardiotwin doctor --json`", "coordinator", "people's programs", "" }
    /// Files that an export wrote.
    EXPORT { "export", 1, "`cardiotwin export --json`", "coordinator", "people's programs", "" }
    /// Defects of a mesh.
    MESH_CHECK { "mesh check", 1, "`cardiotwin mesh check --json`", "coordinator", "people's programs", "" }
    /// Repairs of a mesh.
    MESH_REPAIR { "mesh repair", 1, "`cardiotwin mesh repair --json`", "coordinator", "people's programs", "" }
    /// Patients from a user's own traces.
    OWN_TRACES { "own traces", 1, "`cardiotwin init --from --json`", "coordinator", "people's programs", "" }
    /// Twins under changed conditions.
    PREDICTION { "prediction", 1, "`cardiotwin predict --json`", "coordinator", "people's programs", "" }
    /// Elastance of twins.
    ELASTANCE { "elastance", 1, "`cardiotwin elastance --json`", "coordinator", "people's programs", "" }
    /// Costs of a run's jobs.
    JOB_COSTS { "costs of jobs", 1, "`cardiotwin jobs --json`", "coordinator", "people's programs", "" }
    /// Tables and traces of a patient.
    PATIENT_TABLES { "patient's tables", 1, "`cardiotwin show --tables`", "coordinator", "people's programs", "" }
    /// Result of one simulation.
    SIMULATION { "simulation", 1, "`cardiotwin simulate --json`", "coordinator", "people's programs", "" }
    /// Result of one call of a sensitivity sweep.
    SWEEP_OUTCOME { "sweep's outcome", 1, "`cardiotwin sweep gsa --json`", "coordinator", "people's programs", "" }
    /// Progress of a sensitivity sweep.
    SENSITIVITY_STATUS { "sensitivity's status", 1, "`cardiotwin sweep status --json`", "coordinator", "people's programs", "" }
    /// Progress of a robustness sweep.
    ROBUSTNESS_STATUS { "robustness's status", 1, "`cardiotwin sweep status --json`", "coordinator", "people's programs", "" }
}

/// Errors in reading a format.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The version is later than the known one.
    #[error(
        "{place}: {format} of version {found}, expected version {known} or earlier; read it with the program that wrote it, or with \
         a later one"
    )]
    Newer {
        /// File or row of the database.
        place: String,
        /// Name of the format.
        format: &'static str,
        /// Version that the content states.
        found: u32,
        /// Latest version that this program reads.
        known: u32,
    },
    /// The content is damaged, or of another format.
    #[error("{place}: cannot be read as {format} of version {version}")]
    Content {
        /// File or row of the database.
        place: String,
        /// Name of the expected format.
        format: &'static str,
        /// Version that the content states.
        version: u32,
        /// Position and reason of the parser's error.
        source: serde_json::Error,
    },
    /// An order has keys that this program does not know.
    #[error(
        "{place}: {format} with keys that this program does not know: {keys}; carry it out with the program of the version that \
         wrote it"
    )]
    UnknownKeys {
        /// File or row of the database.
        place: String,
        /// Name of the format.
        format: &'static str,
        /// Unknown keys with their dotted paths.
        keys: String,
    },
}

impl FormatError {
    /// Message with its cause, for callers that store text only.
    #[must_use]
    pub fn in_full(&self) -> String {
        match self {
            Self::Content { source, .. } => format!("{self}: {source}"),
            Self::Newer { .. } | Self::UnknownKeys { .. } => self.to_string(),
        }
    }
}

/// Part that all formats share in all versions.
#[derive(Deserialize)]
struct Head {
    #[serde(default = "first")]
    schema_version: u32,
}

const fn first() -> u32 {
    1
}

impl Format {
    /// Reads JSON of this version or an earlier one. Unknown keys are additions of later programs and are ignored.
    ///
    /// - `place`: file or row of the database, for the message
    ///
    /// # Errors
    /// [`FormatError::Newer`], [`FormatError::Content`].
    pub fn read<T: DeserializeOwned>(
        &self,
        place: &dyn std::fmt::Display,
        json: &[u8],
    ) -> Result<T, FormatError> {
        let version = self.version_of(place, json)?;
        serde_json::from_slice(json).map_err(|source| self.content(place, version, source))
    }

    /// Reads an order as [`Format::read`] does, but refuses unknown keys, because an order must be understood in full.
    ///
    /// # Errors
    /// As [`Format::read`]; [`FormatError::UnknownKeys`].
    pub fn read_order<T: DeserializeOwned + Serialize + JsonSchema>(
        &self,
        place: &dyn std::fmt::Display,
        json: &[u8],
    ) -> Result<T, FormatError> {
        let order: T = self.read(place, json)?;
        let both = || {
            Ok::<_, serde_json::Error>((
                serde_json::from_slice(json)?,
                serde_json::to_value(&order)?,
            ))
        };
        let (given, taken): (Value, Value) =
            both().map_err(|source| self.content(place, self.version, source))?;
        let mut lost = Vec::new();
        collect_lost(&given, &taken, "", &mut lost);
        if lost.is_empty() {
            return Ok(order);
        }
        // Serialisation omits some known keys with default values.
        let schema: Value = schemars::schema_for!(T).into();
        let mut known = BTreeSet::new();
        collect_keys(&schema, &mut known);
        lost.retain(|key| !known.contains(key.rsplit('.').next().unwrap_or(key)));
        if lost.is_empty() {
            return Ok(order);
        }
        Err(FormatError::UnknownKeys {
            place: place.to_string(),
            format: self.name,
            keys: lost.join(", "),
        })
    }

    /// Name and version as in the header of a file of arrays.
    #[must_use]
    pub fn kind(&self) -> String {
        format!("{} {}", self.name, self.version)
    }

    /// Refuses a version that this program does not know.
    ///
    /// # Errors
    /// [`FormatError::Newer`].
    pub fn accept(&self, place: &dyn std::fmt::Display, found: u32) -> Result<(), FormatError> {
        if found <= self.version {
            return Ok(());
        }
        Err(FormatError::Newer {
            place: place.to_string(),
            format: self.name,
            found,
            known: self.version,
        })
    }

    fn version_of(&self, place: &dyn std::fmt::Display, json: &[u8]) -> Result<u32, FormatError> {
        let head: Head = serde_json::from_slice(json)
            .map_err(|source| self.content(place, self.version, source))?;
        self.accept(place, head.schema_version)?;
        Ok(head.schema_version)
    }

    fn content(
        &self,
        place: &dyn std::fmt::Display,
        version: u32,
        source: serde_json::Error,
    ) -> FormatError {
        FormatError::Content {
            place: place.to_string(),
            format: self.name,
            version,
            source,
        }
    }
}

/// Collects the names of all keys in a schema.
fn collect_keys<'a>(schema: &'a Value, keys: &mut BTreeSet<&'a str>) {
    match schema {
        Value::Object(table) => {
            let properties = table.get("properties").and_then(Value::as_object);
            keys.extend(
                properties
                    .into_iter()
                    .flat_map(|all| all.keys())
                    .map(String::as_str),
            );
            table.values().for_each(|inner| collect_keys(inner, keys));
        }
        Value::Array(items) => items.iter().for_each(|inner| collect_keys(inner, keys)),
        _ => {}
    }
}

/// Collects the dotted keys of `given` that `taken` lacks.
fn collect_lost(given: &Value, taken: &Value, key: &str, lost: &mut Vec<String>) {
    match (given, taken) {
        (Value::Object(given), Value::Object(taken)) => {
            for (name, value) in given {
                let inner = match key {
                    "" => name.clone(),
                    key => format!("{key}.{name}"),
                };
                match taken.get(name) {
                    Some(taken) => collect_lost(value, taken, &inner, lost),
                    None => lost.push(inner),
                }
            }
        }
        (Value::Array(given), Value::Array(taken)) => given
            .iter()
            .zip(taken)
            .for_each(|(given, taken)| collect_lost(given, taken, key, lost)),
        _ => {}
    }
}

/// Removes the unknown keys of each table whose keys the schema lists.
pub(crate) fn keep_known(value: &mut Value, schema: &Value) {
    walk(value, schema, schema);
}

fn walk(value: &mut Value, schema: &Value, root: &Value) {
    let schema = resolve(schema, root);
    match value {
        Value::Object(table) => {
            let further = schema
                .get("additionalProperties")
                .filter(|further| further.is_object());
            let Some(known) = schema.get("properties").and_then(Value::as_object) else {
                for inner in table.values_mut() {
                    further
                        .iter()
                        .for_each(|further| walk(inner, further, root));
                }
                return;
            };
            if further.is_none() && schema.get("patternProperties").is_none() {
                table.retain(|key, _| known.contains_key(key));
            }
            for (key, inner) in table.iter_mut() {
                known
                    .get(key)
                    .or(further)
                    .into_iter()
                    .for_each(|schema| walk(inner, schema, root));
            }
        }
        Value::Array(items) => {
            let of_item = schema.get("items");
            for item in items {
                of_item.iter().for_each(|schema| walk(item, schema, root));
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Claim;
    use crate::task::AttemptSpec;

    const CLAIM_TEXT: &str = include_str!("../tests/golden/claim.json");
    const SPEC_TEXT: &str = include_str!("../tests/golden/spec.json");

    fn with(text: &str, key: &str, value: Value) -> Vec<u8> {
        let mut json: Value = serde_json::from_str(text).unwrap();
        json[key] = value;
        serde_json::to_vec(&json).unwrap()
    }

    #[test]
    fn a_later_version_is_refused_and_an_addition_is_not() {
        let later = with(CLAIM_TEXT, "schema_version", 7.into());
        let error = CLAIM
            .read::<Claim>(&"started.json", &later)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("started.json: claim of version 7, expected version 1 or earlier"),
            "{error}"
        );
        let added = with(CLAIM_TEXT, "of_tomorrow", 7.into());
        let claim: Claim = CLAIM.read(&"started.json", &added).unwrap();
        assert_eq!(claim, serde_json::from_str(CLAIM_TEXT).unwrap());
    }

    #[test]
    fn what_is_no_json_of_the_format_is_told_with_its_place() {
        let error = CLAIM
            .read::<Claim>(&"started.json", b"{\"host\":")
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "started.json: cannot be read as claim of version 1"
        );
    }

    #[test]
    fn an_order_is_understood_in_full_or_refused() {
        let added = with(SPEC_TEXT, "of_tomorrow", 7.into());
        let error = SPEC
            .read_order::<AttemptSpec>(&"spec.json", &added)
            .unwrap_err();
        assert!(
            error.to_string().contains("does not know: of_tomorrow;"),
            "{error}"
        );
        let mut deep: Value = serde_json::from_str(SPEC_TEXT).unwrap();
        deep["task"]["contraction"]["twitch"] = 2.into();
        deep["task"]["noise_windows"] = serde_json::json!({}); // a known key with nothing in it
        let error = SPEC
            .read_order::<AttemptSpec>(&"spec.json", &serde_json::to_vec(&deep).unwrap())
            .unwrap_err();
        assert!(
            error.to_string().contains("task.contraction.twitch"),
            "{error}"
        );
        SPEC.read_order::<AttemptSpec>(&"spec.json", SPEC_TEXT.as_bytes())
            .unwrap();
    }

    #[test]
    fn names_and_goldens_are_distinct_and_versions_begin_at_one() {
        let all = [ALL, ANSWERS].concat();
        for (i, format) in all.iter().enumerate() {
            assert!(format.version >= 1, "{format:?}");
            assert!(
                all[..i].iter().all(|other| other.name != format.name
                    && (other.golden.is_empty() || other.golden != format.golden)),
                "{format:?}"
            );
        }
    }
}
