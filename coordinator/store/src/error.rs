//! Errors of the store. Each message says what to do.

use std::path::PathBuf;

use cardiotwin_schemas::formats::FormatError;
use cardiotwin_schemas::ids::PatientId;

use super::{clock, foreign};

/// A failure of the store. Everything committed before it remains.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The run directory has no database.
    #[error("{file} {found}: nothing was run here yet; `cardiotwin run` creates it")]
    Missing {
        /// Path of the database.
        file: PathBuf,
        /// What is there instead.
        found: &'static str,
    },
    /// The file is not a database of cardiotwin.
    #[error(
        "{file} is not a database of cardiotwin ({found}); give another run directory with \
         --run-dir"
    )]
    NotOurs {
        /// Path of the file.
        file: PathBuf,
        /// Description of the found content.
        found: String,
    },
    /// A newer program wrote the database.
    #[error(
        "{file} has format {found}, written by cardiotwin {written_by}; this is cardiotwin \
         {version}, which reads formats up to {known}: use the newer program; nothing was changed"
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
    /// The database is damaged.
    #[error(
        "{file} is damaged ({found}); restore it from a backup, or move it away and run again: \
         finished attempts are kept"
    )]
    Corrupted {
        /// Path of the database.
        file: PathBuf,
        /// Result of SQLite's check.
        found: String,
    },
    /// The disk is full.
    #[error(
        "no space left for {file}: free some space and run again; nothing that was committed is \
         lost"
    )]
    DiskFull {
        /// Path of the database.
        file: PathBuf,
        /// Error that SQLite returned.
        source: sqlx::Error,
    },
    /// The database may not be written.
    #[error("cannot write {file}: its directory or file system is read-only for this user")]
    ReadOnly {
        /// Path of the database.
        file: PathBuf,
        /// Error that SQLite returned.
        source: sqlx::Error,
    },
    /// Another program has locked the database.
    #[error(
        "{file} has been locked by {holder} since {since}: let that program finish, or end it; \
         nothing is lost, and the same command goes on"
    )]
    Busy {
        /// Path of the database.
        file: PathBuf,
        /// The program that holds the lock, as far as it is known.
        holder: String,
        /// Since when this program has waited, UTC.
        since: String,
    },
    /// Another process wrote to the database in between.
    #[error(
        "{table} was changed by another program ({changed} of {expected} guarded updates \
         succeeded): stop the other program that writes to this database"
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
        "this coordinator's lease (generation {generation}) has expired, and generation {now} is \
         current: nothing was committed; the other coordinator continues its work"
    )]
    LeaseLost {
        /// Generation of this coordinator's lease.
        generation: u64,
        /// Generation of the present lease.
        now: u64,
    },
    /// A copy of the database is damaged.
    #[error(
        "the copy {file} is damaged ({found}) and was removed; check whether the disk is full \
             or failing"
    )]
    BadCopy {
        /// Path of the copy.
        file: PathBuf,
        /// Result of SQLite's check.
        found: String,
    },
    /// The run has no patient of this name.
    #[error("no patient {patient} in this run; known patients: {known}")]
    NoPatient {
        /// Pseudonym that was asked for.
        patient: PatientId,
        /// Names of the first patients of the run.
        known: String,
    },
    /// A stored outcome or claim, or what the database holds in JSON, is of a later version.
    #[error(transparent)]
    Format(#[from] FormatError),
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
    /// A file next to the database cannot be accessed.
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
        /// Name of the operation that failed.
        what: &'static str,
        /// Error that SQLite returned.
        source: sqlx::Error,
    },
}

impl StoreError {
    /// A file that was made for a database, and never became one.
    pub(super) fn unfinished(file: PathBuf) -> Self {
        let found = "is empty, because its making was interrupted or its log is lost";
        Self::Missing { file, found }
    }

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
            // SQLITE_BUSY
            Some((5, _)) => Self::Busy {
                holder: foreign::holder(&file),
                since: clock::now_utc(),
                file,
            },
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
