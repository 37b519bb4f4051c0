//! Errors of the store. Each message says what to do.

use std::path::PathBuf;

use cardiotwin_schemas::ids::PatientId;

/// A failure of the store. Everything committed before it remains.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The run directory has no database.
    #[error("{file} does not exist: nothing was run here yet; `cardiotwin run` makes it")]
    Missing {
        /// Path of the database.
        file: PathBuf,
    },
    /// The file is not a database of cardiotwin.
    #[error(
        "{file} is no database of cardiotwin ({found}); give another run directory with --run-dir"
    )]
    NotOurs {
        /// Path of the file.
        file: PathBuf,
        /// Description of the found content.
        found: String,
    },
    /// A newer program wrote the database.
    #[error(
        "{file} has format {found}, written by cardiotwin {written_by}; this is cardiotwin {version}, which knows \
         formats up to {known}: use the newer program, nothing was changed"
    )]
    Newer {
        /// Path of the database.
        file: PathBuf,
        /// Format of the database.
        found: i64,
        /// Newest format that this program reads.
        known: i64,
        /// Version of the program that wrote the database.
        written_by: String,
        /// Version of this program.
        version: &'static str,
    },
    /// An older program wrote the database, and this process may only read it.
    #[error("{file} has format {found}, older than {known}: `cardiotwin run` brings it up to date")]
    Older {
        /// Path of the database.
        file: PathBuf,
        /// Format of the database.
        found: i64,
        /// Format that this program reads.
        known: i64,
    },
    /// The database is damaged.
    #[error(
        "{file} is damaged ({found}); restore it from a backup, or move it away and run again: finished attempts \
         beside it stay as they are"
    )]
    Corrupted {
        /// Path of the database.
        file: PathBuf,
        /// Result of SQLite's check.
        found: String,
    },
    /// The disk is full.
    #[error(
        "no space left for {file}: free some and run again, nothing that was committed is lost"
    )]
    DiskFull {
        /// Path of the database.
        file: PathBuf,
        /// Error of SQLite.
        source: sqlx::Error,
    },
    /// The database may not be written.
    #[error("cannot write {file}: its directory or file system is read-only for this user")]
    ReadOnly {
        /// Path of the database.
        file: PathBuf,
        /// Error of SQLite.
        source: sqlx::Error,
    },
    /// Another process wrote to the database in between.
    #[error(
        "{table} changed behind this coordinator's back ({changed} of {expected} guarded updates held); \
         is another program writing to this database?"
    )]
    Guard {
        /// Name of the table.
        table: &'static str,
        /// Number of rows that had to change.
        expected: usize,
        /// Number of rows that changed.
        changed: u64,
    },
    /// Another coordinator took the lease, because this one slept or its host was cut off.
    #[error(
        "this coordinator's lease (generation {generation}) is over, generation {now} is the present one: nothing was committed; \
         what it began is taken up by the other"
    )]
    LeaseLost {
        /// Generation of this coordinator's lease.
        generation: u64,
        /// Generation of the present lease.
        now: u64,
    },
    /// A copy of the database is damaged.
    #[error("the copy {file} is damaged ({found}): nothing was kept; is the disk full or failing?")]
    BadCopy {
        /// Path of the copy.
        file: PathBuf,
        /// Result of SQLite's check.
        found: String,
    },
    /// The run has no patient of this name.
    #[error("no patient {patient} in this run; known are {known}")]
    NoPatient {
        /// Requested patient.
        patient: PatientId,
        /// Names of the first patients of the run.
        known: String,
    },
    /// A column holds a text that this version cannot read.
    #[error("{table}.{column} of {row} cannot be read")]
    Content {
        /// Name of the table.
        table: &'static str,
        /// Name of the column.
        column: &'static str,
        /// Key of the row.
        row: String,
        /// Error of the JSON parser.
        source: serde_json::Error,
    },
    /// A file beside the database cannot be accessed.
    #[error("cannot {what} {file}")]
    File {
        /// Verb of the failed operation.
        what: &'static str,
        /// Path of the file.
        file: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Any other error of SQLite.
    #[error("{file}: {what} failed")]
    Sql {
        /// Path of the database.
        file: PathBuf,
        /// Operation that failed.
        what: &'static str,
        /// Error of SQLite.
        source: sqlx::Error,
    },
}

impl StoreError {
    /// Classifies an error of SQLite.
    pub(super) fn from_sqlite(file: PathBuf, what: &'static str, source: sqlx::Error) -> Self {
        // Extended result codes have the primary code in their low byte.
        let code = match &source {
            sqlx::Error::Database(error) => error
                .code()
                .and_then(|c| c.parse::<i64>().ok())
                .map(|c| (c & 0xff, c)),
            _ => None,
        };
        match code {
            Some((13, _)) => Self::DiskFull { file, source }, // SQLITE_FULL
            // SQLITE_READONLY and SQLITE_PERM.
            Some((8 | 3, _)) => Self::ReadOnly { file, source },
            Some((11, _)) => Self::Corrupted {
                found: source.to_string(),
                file,
            }, // SQLITE_CORRUPT
            Some((26, _)) => Self::NotOurs {
                found: source.to_string(),
                file,
            }, // SQLITE_NOTADB
            _ => Self::Sql { file, what, source },
        }
    }
}
