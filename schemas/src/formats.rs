//! Every format that is written to be read again, each with a version of its own, and the one way to read its JSON.
//!
//! | question | answer |
//! |---|---|
//! | When is a version raised? | Where a program that knows the old version alone would misread what is new |
//! | What is an addition? | A key that earlier programs may leave out of account: they do, and the version stays |
//! | Where does a version stand? | In the key `schema_version`; JSON without that key has version 1; binary files say it in their first line, a database in `user_version` |
//! | What does a reader do? | It reads its own version and all before, and refuses later ones |
//!
//! A file of each format as it is today lies under [`Format::golden`]; tests read all of them, so that a later version of the
//! programs reads what this one wrote. Files that people write (`cohort.toml`, `patient.toml`, `prepare.toml`) have no version:
//! an unknown key is refused with the key that was meant.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A format, its version, and who deals with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// As messages and documents name it.
    pub name: &'static str,
    /// What is written now.
    pub version: u32,
    /// Where it stands: a file, a column of the database, the answer of a command.
    pub place: &'static str,
    /// Who writes it.
    pub writer: &'static str,
    /// Who reads it.
    pub reader: &'static str,
    /// A small one of today, relative to the repository's root; empty for answers that no program of ours reads, and for what a
    /// program computes anew where it meets another version.
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
    /// All that a program of ours or somebody else's keeps and reads, in the order of `docs/formats.md`.
    ALL;

    /// The task of an attempt. The only format whose reader refuses unknown keys: an order is understood in full or not done.
    SPEC { "attempt's specification", 1, "`spec.json`", "coordinator, driver", "worker", "schemas/tests/golden/spec.json" }
    /// Who works on an attempt.
    CLAIM { "claim", 1, "`started.json`", "worker", "coordinator, worker", "schemas/tests/golden/claim.json" }
    /// A worker's reports.
    PROGRESS { "progress", 1, "`progress.jsonl`", "worker", "coordinator", "schemas/tests/golden/progress.jsonl" }
    /// How an attempt ended.
    OUTCOME { "outcome", 1, "`outcome.json`, column `tasks.outcome`", "worker", "coordinator", "schemas/tests/golden/outcome.json" }
    /// The coordinator's word in an outcome's place.
    REVOCATION { "revocation", 1, "`outcome.json`", "coordinator", "coordinator, worker", "schemas/tests/golden/revocation.json" }
    /// The job that made an attempt's directory.
    ALLOCATION { "attempt's allocation", 1, "`allocation.json`", "driver", "coordinator, driver", "schemas/tests/golden/allocation.json" }
    /// The wall of a 3D simulation for pictures.
    HEART { "heart surface", 1, "`heart.json`", "worker", "coordinator", "schemas/tests/golden/heart.json" }
    /// What an external solver is given.
    EXTERNAL_PARAMETERS { "external parameters", 1, "parameters of an external solver", "worker", "external solver", "schemas/tests/golden/external-parameters.json" }
    /// Named arrays with a header and a checksum.
    ARRAYS { "arrays", 1, "`ventricle.bin`, `checkpoint/beat.bin`", "worker", "worker", "worker/tests/golden/arrays.bin" }
    /// What `ventricle.bin` holds.
    VENTRICLE { "ventricle", 2, "arrays of `ventricle.bin`", "worker", "worker", "" }
    /// What a beat's checkpoint holds.
    BEAT_CHECKPOINT { "beat checkpoint", 4, "arrays of `checkpoint/beat.bin`", "worker", "worker", "" }
    /// Costs that an optimiser was given.
    SEARCH_JOURNAL { "search journal", 2, "`checkpoint/told-costs`", "worker", "worker", "worker/tests/golden/told-costs" }
    /// Lines of samples as they are computed.
    SAMPLE_LOG { "sample log", 1, "`checkpoint/samples`", "worker", "worker", "worker/tests/golden/samples" }

    /// What an element of a cluster's job is to do.
    JOB_ORDER { "job order", 1, "`order-E.json`", "coordinator", "driver", "schemas/tests/golden/job-order.json" }
    /// A driver's claim on an element's node.
    DRIVER_CLAIM { "driver's claim", 1, "`started-E-N.json`", "driver", "coordinator", "schemas/tests/golden/driver-claim.json" }
    /// A driver's last word.
    DRIVER_END { "driver's end", 1, "`ended-E-N.json`", "driver", "coordinator", "schemas/tests/golden/driver-end.json" }

    /// Tables of a run. Migrations bring earlier versions up to it.
    DATABASE { "database", 2, "`cardiotwin.db`", "coordinator", "coordinator", "coordinator/src/store/golden/database.sql" }
    /// A patient's machine.
    PATIENT_STATE { "patient's state", 1, "column `patients.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/patient-states.json" }
    /// A task's machine.
    TASK_STATE { "task's state", 1, "column `tasks.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/task-states.json" }
    /// An attempt's machine.
    ATTEMPT_STATE { "attempt's state", 1, "column `attempts.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/attempt-states.json" }
    /// The machine of a cluster's job.
    JOB_STATE { "cluster job's state", 1, "column `jobs.state`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/job-states.json" }
    /// What happened to the machines.
    EVENTS { "events", 1, "column `events.event`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/events.json" }
    /// A patient's chain as far as it is settled.
    CHAIN { "chain", 1, "column `plans.chain`", "coordinator", "coordinator", "coordinator/workflow/tests/golden/chain.json" }
    /// All that a patient's tasks follow from.
    PLAN { "plan", 1, "columns `plans.given`, `plans.plan`", "coordinator", "coordinator", "schemas/tests/golden/plan.json" }
    /// What was decided and is to be done.
    ACTIONS { "actions", 1, "column `outbox.action`", "coordinator", "coordinator", "coordinator/src/store/golden/actions.json" }
    /// What was asked of a cluster, and what it said.
    JOB_BOOKS { "cluster job's books", 1, "columns `jobs.spec`, `jobs.seen`, `allotments.allotment`", "coordinator", "coordinator", "coordinator/src/store/golden/job-books.json" }
    /// Who holds a run.
    LOCK { "lock", 1, "`coordinator.lock`", "coordinator", "coordinator", "coordinator/src/store/golden/lock.json" }
    /// Who holds a run among hosts.
    LEASE { "lease", 1, "`lease/*.json`", "coordinator", "coordinator", "coordinator/src/store/golden/lease.json" }
    /// What commands ask of a running coordinator.
    REQUEST { "request", 1, "`requests/*.json`", "coordinator's commands", "coordinator", "coordinator/src/engine/golden/requests.json" }

    /// What a folder of a sweep is about.
    SWEEP { "sweep", 1, "`sweep.json`", "coordinator", "coordinator", "schemas/tests/golden/sweep.json" }
    /// Results of a sensitivity sweep.
    SENSITIVITY { "sensitivity", 1, "`results/sensitivity.json`", "coordinator", "coordinator", "schemas/tests/golden/sensitivity.json" }
    /// Results of a robustness sweep.
    ROBUSTNESS { "robustness", 1, "`results/robustness.json`", "coordinator", "coordinator", "schemas/tests/golden/robustness.json" }
    /// What a search for missing effects found.
    DISCOVER_CASE { "discover case", 1, "`discover/discover.json`, `cardiotwin discover --json`", "coordinator", "coordinator", "schemas/tests/golden/discover-case.json" }
    /// Findings about a patient.
    MODEL { "patient's model", 1, "`model.toml`", "coordinator, people", "coordinator", "schemas/tests/golden/model.toml" }
    /// How recordings became a patient's files.
    PREPARATION { "preparation", 1, "`prepared/prepare.json`, `cardiotwin prepare --json`", "coordinator", "people's programs", "schemas/tests/golden/preparation.json" }
    /// A message to people.
    NOTICE { "notice", 1, "standard input of a notice's command", "coordinator", "people's programs", "schemas/tests/golden/notice.json" }
    /// Where patients of a run stand.
    STATUS { "status", 1, "`cardiotwin status --json`", "coordinator", "people's programs", "schemas/tests/golden/status.json" }
    /// A run with all results.
    RUN_RECORD { "run record", 1, "`cardiotwin show --json`, `record.json` of an RO-Crate", "coordinator", "people's programs", "schemas/tests/golden/run-record.json" }
    /// A fitted calcium transient.
    CALCIUM_FIT { "calcium fit", 1, "`cardiotwin fit calcium --json`", "coordinator", "people's programs", "schemas/tests/golden/calcium-fit.json" }
    /// A fitted afterload.
    AFTERLOAD_FIT { "afterload fit", 1, "`cardiotwin fit afterload --json`", "coordinator", "people's programs", "schemas/tests/golden/afterload-fit.json" }
    /// An afterload fitted to a cuff's pressures.
    CUFF_FIT { "cuff fit", 1, "`cardiotwin fit afterload --cuff --json`", "coordinator", "people's programs", "schemas/tests/golden/cuff-fit.json" }
    /// Effects that an afterload lacks.
    AFTERLOAD_DISCOVERY { "afterload discovery", 1, "`cardiotwin discover --afterload --json`", "coordinator", "people's programs", "schemas/tests/golden/afterload-discovery.json" }
}

formats! {
    /// Answers of commands with `--json` that have no other format: people's programs read them, and ours do not.
    ANSWERS;

    /// What is wrong with a cohort.
    CHECK { "check", 1, "`cardiotwin check --json`", "coordinator", "people's programs", "" }
    /// Two runs side by side.
    COMPARISON { "comparison", 1, "`cardiotwin compare --json`", "coordinator", "people's programs", "" }
    /// What stands in the way of a run.
    DOCTOR { "doctor's findings", 1, "`cardiotwin doctor --json`", "coordinator", "people's programs", "" }
    /// Files that an export wrote.
    EXPORT { "export", 1, "`cardiotwin export --json`", "coordinator", "people's programs", "" }
    /// What is wrong with a mesh.
    MESH_CHECK { "mesh check", 1, "`cardiotwin mesh check --json`", "coordinator", "people's programs", "" }
    /// What was done to a mesh.
    MESH_REPAIR { "mesh repair", 1, "`cardiotwin mesh repair --json`", "coordinator", "people's programs", "" }
    /// Twins under changed conditions.
    PREDICTION { "prediction", 1, "`cardiotwin predict --json`", "coordinator", "people's programs", "" }
    /// One simulation.
    SIMULATION { "simulation", 1, "`cardiotwin simulate --json`", "coordinator", "people's programs", "" }
    /// A call of a sensitivity sweep.
    SWEEP_OUTCOME { "sweep's outcome", 1, "`cardiotwin sweep gsa --json`", "coordinator", "people's programs", "" }
    /// How far a sensitivity sweep is.
    SENSITIVITY_STATUS { "sensitivity's status", 1, "`cardiotwin sweep status --json`", "coordinator", "people's programs", "" }
    /// How far a robustness sweep is.
    ROBUSTNESS_STATUS { "robustness's status", 1, "`cardiotwin sweep status --json`", "coordinator", "people's programs", "" }
}

/// Something that cannot be read as what it should be.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// A later program wrote it.
    #[error(
        "{place}: {format} of version {found}, expected version {known} or earlier; read it with the program that wrote it, or with \
         a later one"
    )]
    Newer {
        /// File or row.
        place: String,
        /// What it is.
        format: &'static str,
        /// Its version.
        found: u32,
        /// The latest that this program reads.
        known: u32,
    },
    /// It is damaged or something else.
    #[error("{place}: cannot be read as {format} of version {version}")]
    Content {
        /// File or row.
        place: String,
        /// What it should be.
        format: &'static str,
        /// Version by its own word.
        version: u32,
        /// Where and why.
        source: serde_json::Error,
    },
    /// An order with keys that this program does not know.
    #[error(
        "{place}: {format} with keys that this program does not know: {keys}; carry it out with the program of the version that \
         wrote it"
    )]
    UnknownKeys {
        /// File or row.
        place: String,
        /// What it is.
        format: &'static str,
        /// The keys, dotted.
        keys: String,
    },
}

impl FormatError {
    /// The sentence with its cause, for places that keep no causes.
    #[must_use]
    pub fn in_full(&self) -> String {
        match self {
            Self::Content { source, .. } => format!("{self}: {source}"),
            Self::Newer { .. } | Self::UnknownKeys { .. } => self.to_string(),
        }
    }
}

/// The part of every format that never changes.
#[derive(Deserialize)]
struct Head {
    #[serde(default = "first")]
    schema_version: u32,
}

const fn first() -> u32 {
    1
}

impl Format {
    /// Reads JSON of this format: of this version or an earlier one. Keys that this program does not know are additions of a later
    /// one, and are left out of account.
    ///
    /// - `place`: file or row, for the message
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

    /// Reads an order, as [`Format::read`] does, and refuses keys that this program does not know: what an order wants must be
    /// understood in full.
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
        // A key that is known is left out where its value is the default.
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

    /// Name and version, as the header of a file of arrays tells them.
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

/// Names of all keys that a schema lists anywhere.
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

/// Keys of `given`, dotted, that did not come through reading.
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

/// Removes keys that a schema does not know, wherever it lists the keys of a table.
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

/// Follows references, and the one real alternative of an optional value.
fn resolve<'a>(mut schema: &'a Value, root: &'a Value) -> &'a Value {
    loop {
        let alternatives = schema.get("anyOf").and_then(Value::as_array);
        let real = alternatives.and_then(|all| {
            all.iter()
                .find(|one| one.get("type").and_then(Value::as_str) != Some("null"))
        });
        let name = schema
            .get("$ref")
            .and_then(Value::as_str)
            .and_then(|reference| reference.strip_prefix("#/$defs/"));
        let definition = name.and_then(|name| root.get("$defs").and_then(|all| all.get(name)));
        match real.or(definition) {
            Some(next) => schema = next,
            None => return schema,
        }
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
                all[..i]
                    .iter()
                    .all(|other| other.name != format.name && other.golden != format.golden),
                "{format:?}"
            );
        }
    }
}
