//! A run whose last coordinator was another build.

use std::path::Path;

use sqlx::Connection as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

use cardiotwin_store::DATABASE_FILE;

/// Leaves the store as if another build, which was its last coordinator, had derived another task
/// for a patient: one in which the value of the number `key` lacks the 8 that is put in front here.
pub async fn decided_otherwise(run_dir: &Path, patient: &str, key: &str) {
    let file = SqliteConnectOptions::new().filename(run_dir.join(DATABASE_FILE));
    let mut store = SqliteConnection::connect_with(&file).await.unwrap();
    let change = "UPDATE plans SET given = replace(given, ?, ? || '8') \
                  WHERE patient_id = (SELECT id FROM patients WHERE patient = ?)";
    let name = format!("\"{key}\":");
    let change = sqlx::query(change).bind(&name).bind(&name).bind(patient);
    assert_eq!(change.execute(&mut store).await.unwrap().rows_affected(), 1);
    let build = "UPDATE meta SET value = 'another build' WHERE key = 'decided_by'";
    let build = sqlx::query(build).execute(&mut store).await.unwrap();
    assert_eq!(build.rows_affected(), 1);
    store.close().await.unwrap();
}
