//! What can go wrong with the store, each with what to do about it.

use std::path::PathBuf;

use cardiotwin_schemas::formats::FormatError;
use cardiotwin_schemas::ids::PatientId;

/// A failure of the store. Nothing that was committed before it is lost.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// There is no run here.
    #[error("{file} does not exist: nothing was run here yet; `cardiotwin run` makes it")]
    Missing {
        /// The database.
        file: PathBuf,
    },
    /// The file is something else.
    #[error(
        "{file} is no database of cardiotwin ({found}); give another run directory with --run-dir"
    )]
    NotOurs {
        /// The file.
        file: PathBuf,
        /// What was found.
        found: String,
    },
    /// A newer program made it.
    #[error(
        "{file} has format {found}, written by cardiotwin {written_by}; this is cardiotwin {version}, which knows \
         formats up to {known}: use the newer program, nothing was changed"
    )]
    Newer {
        /// The database.
        file: PathBuf,
        /// Its format.
        found: i64,
        /// Ours.
        known: i64,
        /// Who wrote it.
        written_by: String,
        /// Who we are.
        version: &'static str,
    },
    /// An older program made it and we may only read.
    #[error("{file} has format {found}, older than {known}: `cardiotwin run` brings it up to date")]
    Older {
        /// The database.
        file: PathBuf,
        /// Its format.
        found: i64,
        /// Ours.
        known: i64,
    },
    /// The content does not hold together.
    #[error(
        "{file} is damaged ({found}); restore it from a backup, or move it away and run again: finished attempts \
         beside it stay as they are"
    )]
    Corrupted {
        /// The database.
        file: PathBuf,
        /// What SQLite's check found.
        found: String,
    },
    /// No space left.
    #[error(
        "no space left for {file}: free some and run again, nothing that was committed is lost"
    )]
    DiskFull {
        /// The database.
        file: PathBuf,
        /// SQLite's words.
        source: sqlx::Error,
    },
    /// We may not write there.
    #[error("cannot write {file}: its directory or file system is read-only for this user")]
    ReadOnly {
        /// The database.
        file: PathBuf,
        /// SQLite's words.
        source: sqlx::Error,
    },
    /// Somebody else wrote in between.
    #[error(
        "{table} changed behind this coordinator's back ({changed} of {expected} guarded updates held); \
         is another program writing to this database?"
    )]
    Guard {
        /// Which table.
        table: &'static str,
        /// Rows that were to change.
        expected: usize,
        /// Rows that changed.
        changed: u64,
    },
    /// Another coordinator took the lease: this one slept, or its host was cut off.
    #[error(
        "this coordinator's lease (generation {generation}) is over, generation {now} is the present one: nothing was committed; \
         what it began is taken up by the other"
    )]
    LeaseLost {
        /// Ours.
        generation: u64,
        /// The present one.
        now: u64,
    },
    /// A copy that does not hold together.
    #[error("the copy {file} is damaged ({found}): nothing was kept; is the disk full or failing?")]
    BadCopy {
        /// The copy.
        file: PathBuf,
        /// What SQLite's check found.
        found: String,
    },
    /// No such patient in the run.
    #[error("no patient {patient} in this run; known are {known}")]
    NoPatient {
        /// What was asked for.
        patient: PatientId,
        /// What there is.
        known: String,
    },
    /// A stored outcome or claim, or what the database holds in JSON, is of a later version.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A column holds something that this version cannot read.
    #[error("{table}.{column} of {row} cannot be read")]
    Content {
        /// Which table.
        table: &'static str,
        /// Which column.
        column: &'static str,
        /// Which row.
        row: String,
        /// Why.
        source: serde_json::Error,
    },
    /// A file beside the database.
    #[error("cannot {what} {file}")]
    File {
        /// Verb.
        what: &'static str,
        /// Which.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Everything else that SQLite says.
    #[error("{file}: {what} failed")]
    Sql {
        /// The database.
        file: PathBuf,
        /// What was tried.
        what: &'static str,
        /// SQLite's words.
        source: sqlx::Error,
    },
}

impl StoreError {
    /// Gives SQLite's answer its class.
    pub(super) fn from_sqlite(file: PathBuf, what: &'static str, source: sqlx::Error) -> Self {
        // Extended result codes keep the primary one in the low byte.
        let code = match &source {
            sqlx::Error::Database(error) => error
                .code()
                .and_then(|c| c.parse::<i64>().ok())
                .map(|c| (c & 0xff, c)),
            _ => None,
        };
        match code {
            Some((13, _)) => Self::DiskFull { file, source }, // SQLITE_FULL
            // SQLITE_READONLY and SQLITE_PERM; SQLITE_CANTOPEN of an existing file is a matter of permission, too.
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
