//! Opening of the database, with checks of its owner, format and integrity, for the one writer or
//! for readers.

use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{ConnectOptions as _, Connection as _};

use super::creation::{self, Pass, passed};
use super::database::{
    APPLICATION_ID, DATABASE_FILE, FORMAT, SNAPSHOT_FILE, VERSION, sql, unwritable,
};
use super::{StoreError, file_system, stored_formats};

/// Rows that SQLite's thread may be ahead of the reader.
const ROWS_IN_FLIGHT: usize = 4096;

/// Opens the database for its one writer, and creates it if it does not exist or was never
/// finished.
///
/// `shared`: whether other hosts may have the same files open. A write-ahead log needs memory that
/// hosts do not share, so a rollback journal is used on such a file system.
pub async fn writable(
    run_dir: &Path,
    shared: bool,
    pass: Pass<'_>,
) -> Result<SqliteConnection, StoreError> {
    let file = run_dir.join(DATABASE_FILE);
    if is_empty(&file) {
        creation::create(run_dir, pass).await?;
    }
    refuse_unwritable(&file)?;
    let mut connection = connect_to_write(&file, shared).await?;
    let mut format = recognise(&mut connection, &file).await?;
    if format == 0 {
        close(connection, &file).await?;
        creation::create(run_dir, pass).await?;
        connection = connect_to_write(&file, shared).await?;
        format = recognise(&mut connection, &file).await?;
    }
    check(&mut connection, &file).await?;
    if format < FORMAT {
        passed(pass, "before the copy of the database of an older format")?;
        // A copy is made first, from which a failed migration can be undone.
        copy_to(
            &mut connection,
            &run_dir.join(format!("cardiotwin.format-{format}.db")),
        )
        .await?;
    }
    creation::migrate(&mut connection, &file, format, pass).await?;
    creation::sign(&mut connection, &file).await?;
    Ok(connection)
}

/// Whether there is no file, or one without a byte: an unfinished database.
fn is_empty(file: &Path) -> bool {
    match file.metadata() {
        Ok(found) => found.is_file() && found.len() == 0,
        Err(error) => error.kind() == std::io::ErrorKind::NotFound,
    }
}

/// SQLite would open an unwritable file for reading and fail later, at the first commit.
fn refuse_unwritable(file: &Path) -> Result<(), StoreError> {
    let opened = std::fs::OpenOptions::new().append(true).open(file);
    opened
        .map(|_| ())
        .map_err(|source| unwritable("open", file, source))
}

async fn connect_to_write(file: &Path, shared: bool) -> Result<SqliteConnection, StoreError> {
    SqliteConnectOptions::new()
        .filename(file)
        // Every commit is on disk before an action runs, because intents must be durable before
        // their execution.
        .journal_mode(if shared {
            SqliteJournalMode::Delete
        } else {
            SqliteJournalMode::Wal
        })
        .synchronous(SqliteSynchronous::Full)
        // `Patience` waits longer, and says for whom.
        .busy_timeout(Duration::from_millis(500))
        .foreign_keys(true)
        .pragma("cache_size", "-16384")
        .pragma("wal_autocheckpoint", "4000")
        .row_buffer_size(ROWS_IN_FLIGHT)
        .disable_statement_logging()
        .connect()
        .await
        .map_err(sql(file, "opening"))
}

/// Format of the file; 0 for an unfinished one. Refuses foreign files and newer formats.
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
    if application == 0 {
        return Ok(0);
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
    stored_formats::check(connection, file).await?;
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

/// Opens the database for reading, during a writer's work or without permission to write.
///
/// A database in WAL mode needs its `-shm` file even for reading. If that can be neither found nor
/// created, no writer can be active either: a file without a log is read as immutable, and one with
/// a log from a private copy. A database of an older format is read from a private copy, too, which
/// is brought up to date: reading changes nothing in the run.
pub async fn readable(run_dir: &Path) -> Result<ReadOnly, StoreError> {
    let file = run_dir.join(DATABASE_FILE);
    if !file.exists() {
        let around = run_dir.parent().filter(|p| !p.as_os_str().is_empty());
        let found = if around.is_none_or(std::path::Path::is_dir) {
            "does not exist"
        } else {
            "does not exist, nor does the folder around it"
        };
        return Err(StoreError::Missing { file, found });
    }
    if is_empty(&file) {
        return Err(StoreError::unfinished(file));
    }
    let snapshot = run_dir.join(SNAPSHOT_FILE);
    if snapshot.exists() && file_system::shared(run_dir).is_some() {
        let connection = connect_to_read(&snapshot, true).await?;
        return of_this_format(connection, &snapshot, (false, None)).await;
    }
    let (connection, live, copy) = match connect_to_read(&file, false).await {
        Ok(connection) => (connection, true, None),
        Err(
            error @ (StoreError::NotOurs { .. }
            | StoreError::Corrupted { .. }
            | StoreError::Busy { .. }),
        ) => {
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
    of_this_format(connection, &file, (live, copy)).await
}

/// The connection itself, or one to a copy that was brought up to date.
async fn of_this_format(
    mut connection: SqliteConnection,
    file: &Path,
    (live, copy): (bool, Option<tempfile::TempDir>),
) -> Result<ReadOnly, StoreError> {
    match recognise(&mut connection, file).await? {
        0 => Err(StoreError::unfinished(file.to_owned())),
        FORMAT => Ok(ReadOnly {
            connection,
            live,
            _copy: copy,
        }),
        format => brought_up_to_date(connection, file, format).await,
    }
}

/// A private copy of a database of an older format, as the next writer will make it.
async fn brought_up_to_date(
    mut older: SqliteConnection,
    file: &Path,
    format: i64,
) -> Result<ReadOnly, StoreError> {
    let folder = tempfile::tempdir().map_err(|source| StoreError::File {
        what: "make a folder in",
        file: std::env::temp_dir(),
        source,
    })?;
    let copy = folder.path().join(DATABASE_FILE);
    copy_to(&mut older, &copy).await?;
    let mut writing = connect_to_write(&copy, true).await?;
    creation::migrate(&mut writing, file, format, &|_| Ok(())).await?;
    close(writing, &copy).await?;
    Ok(ReadOnly {
        connection: connect_to_read(&copy, true).await?,
        live: false,
        _copy: Some(folder),
    })
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

/// Copies a run's database to `target`, also while a coordinator runs, and checks the copy. Returns
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
