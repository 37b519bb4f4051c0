//! Test whether a file system keeps a second writer out of an SQLite database, before a run relies
//! on it.

use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode};
use sqlx::{ConnectOptions as _, Connection as _};

/// Tries two writers on a new database in `directory`. The file is left there.
///
/// # Errors
/// Description of the operation that went wrong.
pub async fn try_locks(directory: &Path) -> Result<(), String> {
    let options = SqliteConnectOptions::new()
        .filename(directory.join("trial.db"))
        .create_if_missing(true)
        .journal_mode(SqliteJournalMode::Delete)
        .busy_timeout(Duration::ZERO)
        .disable_statement_logging();
    let words = |what: &'static str| move |error: sqlx::Error| format!("{what}: {error}");
    let mut first = options
        .connect()
        .await
        .map_err(words("a database cannot be made"))?;
    sqlx::raw_sql("CREATE TABLE t (x)")
        .execute(&mut first)
        .await
        .map_err(words("a table cannot be made"))?;
    let mut second = options
        .connect()
        .await
        .map_err(words("a second connection cannot be made"))?;
    sqlx::raw_sql("BEGIN IMMEDIATE; INSERT INTO t VALUES (1)")
        .execute(&mut first)
        .await
        .map_err(words("no lock"))?;
    let kept_out = sqlx::raw_sql("BEGIN IMMEDIATE")
        .execute(&mut second)
        .await
        .is_err();
    sqlx::raw_sql("COMMIT")
        .execute(&mut first)
        .await
        .map_err(words("nothing can be committed"))?;
    if !kept_out {
        return Err("a second writer was let in beside the first".to_owned());
    }
    sqlx::raw_sql("BEGIN IMMEDIATE; INSERT INTO t VALUES (2); COMMIT")
        .execute(&mut second)
        .await
        .map_err(words("the lock is not given back"))?;
    first.close().await.map_err(words("closing"))?;
    second.close().await.map_err(words("closing"))
}

#[cfg(test)]
mod tests {
    #[tokio::test]
    async fn a_temporary_folder_has_locks() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(super::try_locks(folder.path()).await, Ok(()));
        let none = super::try_locks(std::path::Path::new("/nowhere"))
            .await
            .unwrap_err();
        assert!(none.starts_with("a database cannot be made"), "{none}");
    }
}
