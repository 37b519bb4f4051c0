//! Columns of dates and times of day in text tables: each cell becomes a number of ms since the first
//! one, so that the table is one of numbers.

use std::borrow::Cow;

use crate::clock::{Clock, DateOrder, is_date, stamp_in_order_ms, stamp_ms};
use crate::dialect::cells;
use crate::headers::{KNOWN, Label, is_unit};
use crate::number::Decimal;
use crate::text::Decoded;

/// Number of lines among which the first stamp is looked for.
const PROBE: usize = 100;
/// Number of rows that must have stamps in the same column.
const ROWS: usize = 3;

/// The text with numbers instead of stamps, and what was done in words; `None` if it has no column of
/// stamps below a header.
pub(crate) fn without_stamps<'a>(decoded: &Decoded<'a>) -> Option<(Decoded<'a>, String)> {
    let text = decoded.text.as_ref();
    let lines: Vec<&str> = text.lines().take(PROBE + ROWS).collect();
    let (separator, place, first) = [b'\t', b';', b',']
        .into_iter()
        .find_map(|separator| column(&lines, separator).map(|(k, i)| (separator, k, i)))?;
    let is_text = |i: &usize| !lines[*i].trim().is_empty() && !lines[*i].trim().starts_with('#');
    let mut header = (0..first).rev().find(is_text)?;
    let units = cells(lines[header], separator);
    let units_below =
        units.iter().all(|cell| is_unit(cell)) && units.iter().any(|cell| !cell.trim().is_empty());
    let unit_line = header;
    if units_below {
        header = (0..header).rev().find(is_text)?;
    }
    let name = (*cells(lines[header], separator).get(place)?)
        .trim()
        .to_owned();
    let factor = Label::new(&name)
        .unit
        .and_then(|unit| KNOWN[0].dimension.factor(&unit));
    let with_comma = separator != b',' && decimal_comma(&lines[first..], separator);
    let dates = dates_beside(&lines[first..], separator, place);
    let stamp = |row: &[&str]| -> Option<String> {
        let time = *row.get(place)?;
        let date = dates.and_then(|dates| row.get(dates).copied());
        Some(date.map_or_else(|| time.to_owned(), |date| dated(date, time)))
    };
    let of_column: Vec<String> = text
        .lines()
        .skip(first)
        .filter_map(|line| stamp(&cells(line, separator)))
        .collect();
    let order = DateOrder::of(of_column.iter().map(String::as_str));
    let (mut clock, mut begin) = (Clock::default(), None);
    let mut out = String::with_capacity(text.len());
    for (i, line) in text.lines().enumerate() {
        let bare = cells(line, separator);
        let whole = stamp(&bare);
        let mut row: Vec<Cow<'_, str>> = bare.into_iter().map(Cow::Borrowed).collect();
        if i >= first
            && let Some(date) = dates.and_then(|dates| row.get_mut(dates))
        {
            *date = Cow::Borrowed("");
        }
        if let Some(cell) = row.get_mut(place) {
            if i == unit_line && units_below {
                *cell = Cow::Borrowed("ms");
            } else if i == header && factor.is_none() && !units_below {
                *cell = Cow::Owned(format!("{} (ms)", name.trim_matches('"')));
            } else if i >= first
                && let Some(ms) = whole
                    .and_then(|whole| stamp_in_order_ms(&whole, Decimal::Point, order))
                    .and_then(|ms| clock.count_on(ms))
            {
                let since = ms - *begin.get_or_insert(ms);
                let value = since / factor.unwrap_or(1.0);
                let mut number = format!("{value:.6}");
                if with_comma {
                    number = number.replace('.', ",");
                }
                *cell = Cow::Owned(number);
            }
        }
        for (k, cell) in row.iter().enumerate() {
            if k > 0 {
                out.push(char::from(separator));
            }
            out.push_str(cell);
        }
        out.push('\n');
    }
    let with_dates = if dates.is_some() {
        ", with the dates beside it"
    } else {
        ""
    };
    let said = format!("column `{name}` has times of day, read as ms since the first{with_dates}");
    let decoded = Decoded {
        text: Cow::Owned(out),
        encoding: decoded.encoding,
    };
    Some((decoded, said))
}

/// A date and a time of day in cells of their own, as one stamp.
fn dated(date: &str, time: &str) -> String {
    let bare = |cell: &str| cell.trim().trim_matches('"').trim().to_owned();
    format!("{} {}", bare(date), bare(time))
}

/// Place of a column of dates in some rows next to the column of times, of which each has no date itself.
fn dates_beside(rows: &[&str], separator: u8, place: usize) -> Option<usize> {
    let rows: Vec<Vec<&str>> = rows
        .iter()
        .take(ROWS)
        .map(|line| cells(line, separator))
        .collect();
    let width = rows.iter().map(Vec::len).min()?;
    let in_all = |k: &usize| {
        let stamped = |row: &Vec<&str>| stamp_ms(&dated(row[*k], row[place]), Decimal::Point);
        rows.iter()
            .all(|row| is_date(row[*k]) && stamped(row).is_some())
    };
    (0..width).filter(|k| *k != place).find(in_all)
}

/// Place of the column of stamps and index of its first line.
fn column(lines: &[&str], separator: u8) -> Option<(usize, usize)> {
    let places = |line: &str| -> Vec<usize> {
        let stamped = |(_, cell): &(usize, &str)| stamp_ms(cell, Decimal::Point).is_some();
        let cells = cells(line, separator);
        if cells.len() < 2 {
            return Vec::new();
        }
        cells
            .into_iter()
            .enumerate()
            .filter(stamped)
            .map(|(k, _)| k)
            .collect()
    };
    (1..lines.len().min(PROBE)).find_map(|i| {
        let place = *places(lines[i]).first()?;
        let below = lines[i..].iter().take(ROWS);
        let all =
            below.clone().count() == ROWS && below.clone().all(|l| places(l).contains(&place));
        all.then_some((place, i))
    })
}

fn decimal_comma(rows: &[&str], separator: u8) -> bool {
    rows.iter()
        .flat_map(|row| cells(row, separator))
        .any(|cell| cell.contains(',') && !cell.contains(':'))
}

#[cfg(test)]
mod tests {
    use crate::delimited::parse;
    use crate::wanted::Wanted;
    use std::path::Path;

    #[test]
    fn stamps_become_times_since_the_first() {
        let wanted = [Wanted::required("time"), Wanted::new("lv_pressure")];
        for text in [
            "Time,LVP (mmHg)\n2026-03-02 23:59:59.998,7\n2026-03-03 00:00:00.000,8\n2026-03-03 00:00:00.002,9\n",
            "Zeit;LVP (mmHg)\n02.03.2026 09:00:00,000;7,5\n02.03.2026 09:00:00,002;8\n02.03.2026 09:00:00,004;9\n",
            "# x\nTime\tLVP\n\tmmHg\n9:00:00.000 AM\t7\n9:00:00.002 AM\t8\n9:00:00.004 AM\t9\n",
            "time_s,LVP (mmHg)\n23:59:59.999,7\n00:00:00.001,8\n00:00:00.003,9\n",
        ] {
            let reading = parse(text.as_bytes(), Path::new("c.csv"), &wanted);
            let table = reading
                .table
                .unwrap_or_else(|| panic!("{text}: {:#?}", reading.problems));
            for (found, expected) in table.columns["time"].iter().zip([0.0, 2.0, 4.0]) {
                assert!(
                    (found - expected).abs() < 1e-3,
                    "{text}: {:?}",
                    table.columns
                );
            }
            assert_eq!(table.columns["lv_pressure"][1..], [8.0, 9.0]);
            assert!(
                table.said.join("\n").contains("times of day"),
                "{:?}",
                table.said
            );
        }
    }

    #[test]
    fn a_cell_that_is_no_stamp_is_told_with_its_line() {
        let wanted = [Wanted::required("time"), Wanted::new("lv_pressure")];
        let text = "Time,LVP (mmHg)\n9:00:00.0,7\n9:00:00.1,8\n9:00:00.2,8\nlater,9\n9:00:00.4,8\n";
        let reading = parse(text.as_bytes(), Path::new("c.csv"), &wanted);
        let told = reading.problems[0].to_string();
        assert!(
            told.contains("c.csv:5") && told.contains("`later`"),
            "{told}"
        );
    }
}
