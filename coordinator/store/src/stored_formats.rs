//! Versions of what the tables hold in JSON: states of machines, events, chains, plans, actions.
//!
//! The format of the database says which tables and columns there are. The content of a column changes for other reasons, and has
//! a version of its own: one entry of `meta` names all of them. A run without that entry was written when each was at version 1.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_schemas::formats::{self, Format};
use sqlx::sqlite::SqliteConnection;

use super::StoreError;

/// Key among the single values.
pub(super) const KEY: &str = "stored_formats";

/// What is stored in JSON and belongs to the database alone. Specifications, outcomes and claims are stored as their files are.
pub(super) const STORED: [Format; 9] = [
    formats::PATIENT_STATE,
    formats::TASK_STATE,
    formats::ATTEMPT_STATE,
    formats::JOB_STATE,
    formats::EVENTS,
    formats::CHAIN,
    formats::PLAN,
    formats::ACTIONS,
    formats::JOB_BOOKS,
];

type Versions = BTreeMap<String, u32>;

async fn read(connection: &mut SqliteConnection, file: &Path) -> Result<Versions, StoreError> {
    let text: Option<String> = sqlx::query_scalar("SELECT value FROM meta WHERE key = ?1")
        .bind(KEY)
        .fetch_optional(connection)
        .await
        .map_err(|source| StoreError::from_sqlite(file.to_owned(), "reading", source))?;
    let Some(text) = text else {
        return Ok(Versions::new());
    };
    serde_json::from_str(&text).map_err(|source| StoreError::Content {
        table: "meta",
        column: "value",
        row: KEY.to_owned(),
        source,
    })
}

/// Refuses a database that holds anything of a later version.
pub(super) async fn check(
    connection: &mut SqliteConnection,
    file: &Path,
) -> Result<(), StoreError> {
    let versions = read(connection, file).await?;
    for format in STORED {
        let found = versions.get(format.name).copied().unwrap_or(1);
        format.accept(&file.display(), found)?;
    }
    Ok(())
}

/// Notes this program's versions; further notes of a later program stay.
pub(super) async fn note(connection: &mut SqliteConnection, file: &Path) -> Result<(), StoreError> {
    let mut versions = read(connection, file).await?;
    versions.extend(STORED.map(|format| (format.name.to_owned(), format.version)));
    let text = serde_json::to_string(&versions).expect("names and numbers are JSON");
    sqlx::query("INSERT INTO meta (key, value) VALUES (?1, ?2) ON CONFLICT (key) DO UPDATE SET value = ?2 WHERE value <> ?2")
        .bind(KEY)
        .bind(text)
        .execute(connection)
        .await
        .map_err(|source| StoreError::from_sqlite(file.to_owned(), "writing", source))?;
    Ok(())
}
