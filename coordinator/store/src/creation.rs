//! Making of a run's database, and its conversion from format to format.
//!
//! A new database is made under another name and renamed when it is whole. So a file under its own name is never half made,
//! whenever the program is killed.

use std::io;
use std::path::{Path, PathBuf};

use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{ConnectOptions as _, Connection as _};

use super::database::{DATABASE_FILE, FORMAT, VERSION, sql, unwritable};
use super::{StoreError, stored_formats};

/// Name of the database until it is whole.
const DRAFT_FILE: &str = "cardiotwin.db-draft";

/// Conversions of the database from format to format: description and statements. `sqlx::migrate!`
/// would do the same and needs a second SQLite for the compiler.
const MIGRATIONS: [(&str, &str); FORMAT as usize] = [
    ("first", include_str!("../migrations/0001_first.sql")),
    (
        "cluster jobs",
        include_str!("../migrations/0002_cluster_jobs.sql"),
    ),
];

/// Called with the name of each instant at which a test lets the process die.
pub type Pass<'a> = &'a (dyn Fn(&str) -> io::Result<()> + Sync);

pub(super) fn passed(pass: Pass<'_>, place: &str) -> Result<(), StoreError> {
    pass(place).map_err(|source| StoreError::File {
        what: "pass",
        file: place.into(),
        source,
    })
}

fn migrator() -> Migrator {
    let migrations = (1..).zip(MIGRATIONS);
    let migrations = migrations.map(|(version, (description, sql))| {
        let kind = MigrationType::Simple;
        Migration::new(version, description.into(), kind, sql.into_sql_str(), false)
    });
    Migrator::with_migrations(migrations.collect())
}

/// Converts a database of this format to today's. Each conversion is a transaction.
pub(super) async fn migrate(
    connection: &mut SqliteConnection,
    file: &Path,
    format: i64,
    pass: Pass<'_>,
) -> Result<(), StoreError> {
    // The last conversion that was made before is looked at again: its text must be the known one.
    for version in format.max(1)..=FORMAT {
        if version > format {
            passed(pass, "before a conversion of the database")?;
        }
        // `run_to` does the same, but a reader in a task of its own cannot use it: its future is not
        // general enough.
        migrator()
            .run_direct(Some(version), &mut *connection, false)
            .await
            .map_err(|error| {
                let source = match error {
                    sqlx::migrate::MigrateError::Execute(source) => source,
                    other => sqlx::Error::Migrate(Box::new(other)),
                };
                StoreError::from_sqlite(file.to_owned(), "migrating it", source)
            })?;
        if version > format {
            passed(pass, "after a conversion of the database")?;
        }
    }
    Ok(())
}

/// Notes the version of this program, and the versions of what it stores in JSON.
pub(super) async fn sign(connection: &mut SqliteConnection, file: &Path) -> Result<(), StoreError> {
    sqlx::query("INSERT INTO meta (key, value) VALUES ('written_by', ?1) ON CONFLICT (key) DO UPDATE SET value = ?1 WHERE value <> ?1")
        .bind(VERSION)
        .execute(&mut *connection)
        .await
        .map_err(sql(file, "writing"))?;
    stored_formats::note(connection, file).await
}

/// Creates the database of a run, in the place of one that was never finished.
pub(super) async fn create(run_dir: &Path, pass: Pass<'_>) -> Result<(), StoreError> {
    let (file, draft) = (run_dir.join(DATABASE_FILE), run_dir.join(DRAFT_FILE));
    remove(&[draft.clone(), beside(&draft, "-journal")])?;
    passed(pass, "before the draft of the database")?;
    std::fs::File::create_new(&draft).map_err(|source| unwritable("create", &draft, source))?;
    passed(pass, "the draft of the database is empty")?;
    let mut connection = SqliteConnectOptions::new()
        .filename(&draft)
        .journal_mode(SqliteJournalMode::Delete)
        // The draft is synced as a whole.
        .synchronous(SqliteSynchronous::Off)
        .disable_statement_logging()
        .connect()
        .await
        .map_err(sql(&draft, "opening"))?;
    migrate(&mut connection, &draft, 0, pass).await?;
    sign(&mut connection, &draft).await?;
    connection.close().await.map_err(sql(&draft, "closing"))?;
    sync(&draft)?;
    passed(pass, "the draft of the database is whole")?;
    // SQLite would apply a log that an unfinished database left behind to the new one.
    remove(&["-wal", "-shm", "-journal"].map(|end| beside(&file, end)))?;
    passed(pass, "before the database gets its name")?;
    std::fs::rename(&draft, &file).map_err(|source| unwritable("create", &file, source))?;
    sync(run_dir)?;
    passed(pass, "the database has its name")
}

/// Path of a file whose name begins with the database's name.
fn beside(file: &Path, end: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(end);
    name.into()
}

fn remove(files: &[PathBuf]) -> Result<(), StoreError> {
    for file in files {
        match std::fs::remove_file(file) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(unwritable("remove", file, error));
            }
            _ => {}
        }
    }
    Ok(())
}

fn sync(path: &Path) -> Result<(), StoreError> {
    std::fs::File::open(path)
        .and_then(|file| file.sync_all())
        .map_err(|source| unwritable("write", path, source))
}
