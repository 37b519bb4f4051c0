//! A mark of the store's contents, by which readers see whether anything changed.

use sqlx::Row as _;
use sqlx::sqlite::SqliteRow;

use cardiotwin_schemas::hash::sha256_hex;

/// Rows that change with every change of the store that a reader shows.
pub(super) const ROWS: &str = "
SELECT json_array((SELECT max(sequence) FROM events), (SELECT count(*) FROM patients), (SELECT sum(version) FROM patients))
UNION ALL
SELECT json_array(key, value) FROM meta WHERE key IN ('cohort', 'description', 'refused')";

/// Mark of the store's contents from the rows of [`ROWS`].
pub(super) fn of_rows(rows: &[SqliteRow]) -> String {
    let text: String = rows.iter().map(|row| row.get::<String, _>(0)).collect();
    sha256_hex(text.as_bytes())
}
