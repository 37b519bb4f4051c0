//! Test whether a file system keeps a second writer out of an SQLite database, before a run relies
//! on it.

use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode};
use sqlx::{ConnectOptions as _, Connection as _};

/// Reasons why a file system cannot keep a run's database.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// SQLite could not do one of the operations.
    #[error("{what}: {source}")]
    Sqlite {
        /// Operation that went wrong.
        what: &'static str,
        /// Reason that SQLite gives.
        source: sqlx::Error,
    },
    /// A second writer was not kept out.
    #[error("two writers got the lock at the same time")]
    SharedLock,
}

/// Tries two writers on a new database in `directory`. The file is left there.
///
/// # Errors
/// `TrialError` if an operation went wrong or both writers got the lock.
pub async fn try_locks(directory: &Path) -> Result<(), TrialError> {
    let options = SqliteConnectOptions::new()
        .filename(directory.join("trial.db"))
        .create_if_missing(true)
        .journal_mode(SqliteJournalMode::Delete)
        .busy_timeout(Duration::ZERO)
        .disable_statement_logging();
    let words = |what: &'static str| move |source: sqlx::Error| TrialError::Sqlite { what, source };
    let mut first = options
        .connect()
        .await
        .map_err(words("cannot create a database"))?;
    sqlx::raw_sql("CREATE TABLE t (x)")
        .execute(&mut first)
        .await
        .map_err(words("cannot create a table"))?;
    let mut second = options
        .connect()
        .await
        .map_err(words("cannot open a second connection"))?;
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
        .map_err(words("cannot commit"))?;
    if !kept_out {
        return Err(TrialError::SharedLock);
    }
    sqlx::raw_sql("BEGIN IMMEDIATE; INSERT INTO t VALUES (2); COMMIT")
        .execute(&mut second)
        .await
        .map_err(words("the lock was not released"))?;
    first.close().await.map_err(words("closing"))?;
    second.close().await.map_err(words("closing"))
}

#[cfg(test)]
mod tests {
    #[tokio::test]
    async fn a_temporary_folder_has_locks() {
        let folder = tempfile::tempdir().unwrap();
        super::try_locks(folder.path()).await.unwrap();
        let none = super::try_locks(std::path::Path::new("/nowhere"))
            .await
            .unwrap_err()
            .to_string();
        assert!(none.starts_with("cannot create a database"), "{none}");
    }
}
