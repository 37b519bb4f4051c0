//! Names and numbers of the database, and errors at its files.

use std::path::Path;

use super::StoreError;

/// Name of the database in the run directory.
pub const DATABASE_FILE: &str = "cardiotwin.db";
/// Copy of the database for readers where file locks are not reliable.
pub const SNAPSHOT_FILE: &str = "cardiotwin.snapshot.db";
/// `CTWN` in ASCII: marks the file as a database of cardiotwin.
pub(super) const APPLICATION_ID: i64 = 1_129_600_846;
/// Format that this version reads and writes; `creation` converts older ones.
pub const FORMAT: i64 = cardiotwin_schemas::formats::DATABASE.version as i64;

/// Version of this program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Classifies errors of SQLite at this file.
pub(super) fn sql<'a>(
    file: &'a Path,
    what: &'static str,
) -> impl Fn(sqlx::Error) -> StoreError + 'a {
    move |source| StoreError::from_sqlite(file.to_owned(), what, source)
}

/// Error of the operating system at a file that was to be written.
pub(super) fn unwritable(what: &'static str, file: &Path, source: std::io::Error) -> StoreError {
    let file = file.to_owned();
    match source.kind() {
        std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem => {
            let source = sqlx::Error::Io(source);
            StoreError::ReadOnly { file, source }
        }
        _ => StoreError::File { what, file, source },
    }
}
