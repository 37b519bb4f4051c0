//! Marks by which a run recognises patients whose files it has read.

use std::collections::BTreeMap;

use cardiotwin_schemas::hash::sha256_hex;
use serde::{Deserialize, Serialize};
use sqlx::Row as _;

use super::{Reader, StoreError};

/// Key of the marks, as JSON, in the table `meta`.
pub const SEEN: &str = "seen_inputs";

/// Marks of the patients' files, by patient, as the last run read them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SeenInputs(pub BTreeMap<String, SeenPatient>);

/// Mark of a patient's files, and the plan that they gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeenPatient {
    /// Mark of the files.
    pub mark: String,
    /// SHA-256 of the plan that the files gave, as JSON.
    pub given: String,
}

const GIVEN: &str = "
SELECT patients.patient, plans.given FROM patients JOIN plans ON plans.patient_id = patients.id
WHERE patients.active AND patients.id BETWEEN ?1 AND ?2";

const LAST_ID: &str = "SELECT coalesce(max(id), 0) FROM patients";

/// Plans read at a time: those of a large cohort are never in memory all at once.
const GROUP: i64 = 512;

impl Reader {
    /// Marks of the patients whose stored plan is still the one that the marked files gave. A
    /// program that knows no marks may have stored another.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn seen_inputs(&self) -> Result<SeenInputs, StoreError> {
        // A run without marks, or with those of a later program, has none.
        let SeenInputs(mut seen) =
            serde_json::from_str(&self.meta(SEEN).await?).unwrap_or_default();
        if seen.is_empty() {
            return Ok(SeenInputs(seen));
        }
        let mut found = BTreeMap::new();
        let mut take = |patient: &str, given: &str| {
            if let Some((patient, of)) = seen.remove_entry(patient)
                && of.given == sha256_hex(given.as_bytes())
            {
                found.insert(patient, of);
            }
        };
        let last: i64 = self
            .rows(LAST_ID, None)
            .await?
            .first()
            .map_or(0, |row| row.get(0));
        for from in (0..=last).step_by(GROUP as usize) {
            let group = sqlx::query(GIVEN).bind(from).bind(from + GROUP - 1);
            for row in self.fetch(group).await? {
                take(row.get(0), row.get(1));
            }
        }
        Ok(SeenInputs(found))
    }
}
