//! Table of fitted quantities.

use cardiotwin_report::table::{Column, Table};
use serde::Serialize;

use crate::table::number;

/// Each quantity with its standard error and interval, under the keys of its JSON.
pub(super) fn table<T: Serialize>(estimates: &[T], confidence_level: f64) -> Table {
    let level = number(100.0 * confidence_level);
    let from = format!("{} % from", level.trim_end_matches(".00"));
    let columns = [
        Column::words("name").label("parameter"),
        Column::numbers("value"),
        Column::numbers("standard_error"),
        Column::numbers("lower").label(from),
        Column::numbers("upper").label("to"),
    ];
    Table::of("estimates", columns, estimates)
}
