//! Opening of the database, with checks of its owner, format and integrity, for the one writer or
//! for readers.

use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{ConnectOptions as _, Connection as _};

use super::{StoreError, file_system, stored_formats};

/// Name of the database in the run directory.
pub const DATABASE_FILE: &str = "cardiotwin.db";
/// Copy of the database for readers where file locks are not reliable.
pub const SNAPSHOT_FILE: &str = "cardiotwin.snapshot.db";
/// `CTWN` in ASCII: marks the file as a database of cardiotwin.
const APPLICATION_ID: i64 = 1_129_600_846;
/// Format that this version reads and writes; `migrations/` converts older ones.
pub const FORMAT: i64 = cardiotwin_schemas::formats::DATABASE.version as i64;

/// Rows that SQLite's thread may be ahead of whoever reads them.
const ROWS_IN_FLIGHT: usize = 4096;

/// Version of this program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Conversions of the database from format to format: description and statements. `sqlx::migrate!`
/// would do the same and needs a second SQLite for the compiler.
const MIGRATIONS: [(&str, &str); 2] = [
    ("first", include_str!("../../migrations/0001_first.sql")),
    (
        "cluster jobs",
        include_str!("../../migrations/0002_cluster_jobs.sql"),
    ),
];

fn migrator() -> Migrator {
    let migrations = (1..).zip(MIGRATIONS).map(|(version, (description, sql))| {
        let kind = MigrationType::Simple;
        Migration::new(version, description.into(), kind, sql.into_sql_str(), false)
    });
    Migrator::with_migrations(migrations.collect())
}

fn sql<'a>(file: &'a Path, what: &'static str) -> impl Fn(sqlx::Error) -> StoreError + 'a {
    move |source| StoreError::from_sqlite(file.to_owned(), what, source)
}

/// Opens the database for its one writer, and creates it if it does not exist.
///
/// `shared`: whether other hosts may have the same files open. A write-ahead log needs memory that
/// hosts do not share, so a rollback journal is used on such a file system.
pub async fn writable(run_dir: &Path, shared: bool) -> Result<SqliteConnection, StoreError> {
    let file = run_dir.join(DATABASE_FILE);
    let options = SqliteConnectOptions::new()
        .filename(&file)
        .create_if_missing(true)
        // Every commit is on disk before an action runs, because intents must be durable before
        // their execution.
        .journal_mode(if shared {
            SqliteJournalMode::Delete
        } else {
            SqliteJournalMode::Wal
        })
        .synchronous(SqliteSynchronous::Full)
        .busy_timeout(Duration::from_secs(10))
        .foreign_keys(true)
        .pragma("cache_size", "-65536")
        .pragma("wal_autocheckpoint", "4000")
        .row_buffer_size(ROWS_IN_FLIGHT)
        .disable_statement_logging();
    // SQLite would open an unwritable file for reading and fail later, at the first commit.
    if let Err(source) = std::fs::OpenOptions::new()
        .append(true)
        .create(true)
        .open(&file)
    {
        let read_only = matches!(
            source.kind(),
            std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem
        );
        return Err(match read_only {
            true => StoreError::ReadOnly {
                file,
                source: sqlx::Error::Io(source),
            },
            false => StoreError::File {
                what: "open",
                file,
                source,
            },
        });
    }
    let mut connection = options.connect().await.map_err(sql(&file, "opening"))?;
    let format = recognise(&mut connection, &file).await?;
    if format > 0 {
        check(&mut connection, &file).await?;
    }
    if format > 0 && format < FORMAT {
        // A copy is made first, from which a failed migration can be undone.
        copy_to(
            &mut connection,
            &run_dir.join(format!("cardiotwin.format-{format}.db")),
        )
        .await?;
    }
    migrator().run(&mut connection).await.map_err(|error| {
        let source = match error {
            sqlx::migrate::MigrateError::Execute(source) => source,
            other => sqlx::Error::Migrate(Box::new(other)),
        };
        StoreError::from_sqlite(file.clone(), "migrating it", source)
    })?;
    sqlx::query("INSERT INTO meta (key, value) VALUES ('written_by', ?1) ON CONFLICT (key) DO UPDATE SET value = ?1 WHERE value <> ?1")
        .bind(VERSION)
        .execute(&mut connection)
        .await
        .map_err(sql(&file, "writing"))?;
    stored_formats::note(&mut connection, &file).await?;
    Ok(connection)
}

/// Format of the file; 0 for a new one. Refuses foreign files and newer formats.
async fn recognise(connection: &mut SqliteConnection, file: &Path) -> Result<i64, StoreError> {
    let application: i64 = sqlx::query_scalar("PRAGMA application_id")
        .fetch_one(&mut *connection)
        .await
        .map_err(sql(file, "reading"))?;
    let format: i64 = sqlx::query_scalar("PRAGMA user_version")
        .fetch_one(&mut *connection)
        .await
        .map_err(sql(file, "reading"))?;
    let tables: i64 = sqlx::query_scalar("SELECT count(*) FROM sqlite_master WHERE name NOT LIKE '\\_sqlx%' ESCAPE '\\' AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\'")
        .fetch_one(&mut *connection)
        .await
        .map_err(sql(file, "reading"))?;
    if application != APPLICATION_ID && (application != 0 || tables != 0) {
        let found = format!("SQLite application id {application}, {tables} tables");
        return Err(StoreError::NotOurs {
            file: file.to_owned(),
            found,
        });
    }
    if format > FORMAT {
        let written_by: Option<String> =
            sqlx::query_scalar("SELECT value FROM meta WHERE key = 'written_by'")
                .fetch_optional(connection)
                .await
                .unwrap_or_default();
        let written_by = written_by.unwrap_or_else(|| "of an unknown version".into());
        return Err(StoreError::Newer {
            file: file.to_owned(),
            found: format,
            known: FORMAT,
            written_by,
            version: VERSION,
        });
    }
    if format > 0 {
        stored_formats::check(connection, file).await?;
    }
    Ok(format)
}

/// SQLite's check of pages and records without the comparison of indices, which takes milliseconds.
async fn check(connection: &mut SqliteConnection, file: &Path) -> Result<(), StoreError> {
    let found: String = sqlx::query_scalar("PRAGMA quick_check(1)")
        .fetch_one(connection)
        .await
        .map_err(sql(file, "checking"))?;
    if found == "ok" {
        Ok(())
    } else {
        Err(StoreError::Corrupted {
            file: file.to_owned(),
            found,
        })
    }
}

/// A read-only connection, with the folder of its private copy if one was needed.
pub struct ReadOnly {
    /// Connection to the database, its snapshot or its private copy.
    pub connection: SqliteConnection,
    /// Whether later commits are seen through this connection. A snapshot or a copy stands still.
    pub live: bool,
    /// Folder of the private copy, kept as long as the connection.
    pub _copy: Option<tempfile::TempDir>,
}

/// Opens the database for reading, beside a running writer or without permission to write.
///
/// A database in WAL mode needs its `-shm` file even for reading. If that can be neither found nor
/// created, no writer can be active either: a file without a log is read as immutable, and one with
/// a log from a private copy.
pub async fn readable(run_dir: &Path) -> Result<ReadOnly, StoreError> {
    let file = run_dir.join(DATABASE_FILE);
    if !file.exists() {
        return Err(StoreError::Missing { file });
    }
    let snapshot = run_dir.join(SNAPSHOT_FILE);
    if snapshot.exists() && file_system::shared(run_dir).is_some() {
        let mut connection = connect_to_read(&snapshot, true).await?;
        return match recognise(&mut connection, &snapshot).await? {
            FORMAT => Ok(ReadOnly {
                connection,
                live: false,
                _copy: None,
            }),
            found => Err(StoreError::Older {
                file: snapshot,
                found,
                known: FORMAT,
            }),
        };
    }
    let (mut connection, live, copy) = match connect_to_read(&file, false).await {
        Ok(connection) => (connection, true, None),
        Err(error @ (StoreError::NotOurs { .. } | StoreError::Corrupted { .. })) => {
            return Err(error);
        }
        Err(_) => {
            let log = run_dir.join(format!("{DATABASE_FILE}-wal"));
            if log.metadata().is_ok_and(|m| m.len() > 0) {
                let copy = private_copy(&file, &log)?;
                (
                    connect_to_read(&copy.path().join(DATABASE_FILE), false).await?,
                    false,
                    Some(copy),
                )
            } else {
                (connect_to_read(&file, true).await?, false, None)
            }
        }
    };
    match recognise(&mut connection, &file).await? {
        FORMAT => Ok(ReadOnly {
            connection,
            live,
            _copy: copy,
        }),
        found => Err(StoreError::Older {
            file,
            found,
            known: FORMAT,
        }),
    }
}

async fn connect_to_read(file: &Path, immutable: bool) -> Result<SqliteConnection, StoreError> {
    let options = SqliteConnectOptions::new()
        .filename(file)
        .read_only(true)
        .immutable(immutable)
        .busy_timeout(Duration::from_secs(10))
        .row_buffer_size(ROWS_IN_FLIGHT)
        .disable_statement_logging();
    let mut connection = options.connect().await.map_err(sql(file, "opening"))?;
    // Opening does not touch the file; errors appear at the first read.
    sqlx::query_scalar::<_, i64>("PRAGMA schema_version")
        .fetch_one(&mut connection)
        .await
        .map_err(sql(file, "reading"))?;
    Ok(connection)
}

fn private_copy(file: &Path, log: &Path) -> Result<tempfile::TempDir, StoreError> {
    let failed = |file: &Path| {
        let file: PathBuf = file.to_owned();
        move |source| StoreError::File {
            what: "copy",
            file,
            source,
        }
    };
    let copy = tempfile::tempdir().map_err(failed(&std::env::temp_dir()))?;
    std::fs::copy(file, copy.path().join(DATABASE_FILE)).map_err(failed(file))?;
    std::fs::copy(log, copy.path().join(format!("{DATABASE_FILE}-wal"))).map_err(failed(log))?;
    Ok(copy)
}

/// Copies the database to `target`. The copy appears whole, by a rename.
pub async fn copy_to(connection: &mut SqliteConnection, target: &Path) -> Result<(), StoreError> {
    let file = |what, path: &Path| {
        let file = path.to_owned();
        move |source| StoreError::File { what, file, source }
    };
    let draft = target.with_extension("new");
    match std::fs::remove_file(&draft) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(file("remove", &draft)(error));
        }
        _ => {}
    }
    sqlx::query("VACUUM INTO ?1")
        .bind(draft.to_string_lossy().into_owned())
        .execute(&mut *connection)
        .await
        .map_err(sql(&draft, "copying to"))?;
    std::fs::File::open(&draft)
        .and_then(|copy| copy.sync_all())
        .map_err(file("write", &draft))?;
    std::fs::rename(&draft, target).map_err(file("write", target))
}

/// Numbers of events, published tasks and patients, to compare a copy with its original.
async fn contents(
    connection: &mut SqliteConnection,
    file: &Path,
) -> Result<(i64, i64, i64), StoreError> {
    sqlx::query_as(
        "SELECT (SELECT count(*) FROM events), (SELECT count(*) FROM tasks WHERE word = 'published'), (SELECT count(*) FROM patients)",
    )
    .fetch_one(connection)
    .await
    .map_err(sql(file, "reading"))
}

/// Copies a run's database to `target`, beside a running coordinator, and checks the copy. Returns
/// its size in bytes.
///
/// # Errors
/// [`StoreError::BadCopy`] if the copy is damaged; other [`StoreError`]s if a file cannot be read
/// or written.
pub async fn back_up(run_dir: &Path, target: &Path) -> Result<u64, StoreError> {
    let mut from = readable(run_dir).await?;
    let unchecked = target.with_extension("unchecked");
    copy_to(&mut from.connection, &unchecked).await?;
    let before = contents(&mut from.connection, &run_dir.join(DATABASE_FILE)).await?;
    let mut copy = connect_to_read(&unchecked, true).await?;
    let found: String = sqlx::query_scalar("PRAGMA integrity_check(1)")
        .fetch_one(&mut copy)
        .await
        .map_err(sql(&unchecked, "checking"))?;
    let after = contents(&mut copy, &unchecked).await?;
    let failed = |what| {
        let file = target.to_owned();
        move |source| StoreError::File { what, file, source }
    };
    // A running coordinator may have added rows since the copy, but never removes any.
    let whole = after.0 <= before.0 && after.1 <= before.1 && after.2 <= before.2;
    if found != "ok" || !whole {
        let _ = std::fs::remove_file(&unchecked);
        return Err(StoreError::BadCopy {
            file: target.to_owned(),
            found: format!("{found}; {after:?} of {before:?}"),
        });
    }
    std::fs::rename(&unchecked, target).map_err(failed("write"))?;
    Ok(target.metadata().map_err(failed("read"))?.len())
}

/// Closes a writer's connection. SQLite then merges the log into the database and removes it.
pub async fn close(connection: SqliteConnection, file: &Path) -> Result<(), StoreError> {
    connection.close().await.map_err(sql(file, "closing"))
}
