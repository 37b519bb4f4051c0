//! Times of day and dates in cells, in ms.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::number::{Decimal, number};

/// Milliseconds of a day.
pub(crate) const DAY_MS: f64 = 86_400_000.0;

/// A clock that counts on where a time of day passes midnight.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Clock {
    days: f64,
    last_ms: Option<f64>,
}

impl Clock {
    /// The time with the midnights so far; `None` never.
    pub(crate) fn count_on(&mut self, time_ms: f64) -> Option<f64> {
        // A step back by half a day or more is a midnight, a smaller one an error that is reported.
        if self
            .last_ms
            .is_some_and(|last| time_ms < last - 0.5 * DAY_MS)
        {
            self.days += 1.0;
        }
        self.last_ms = Some(time_ms);
        Some(self.days * DAY_MS + time_ms)
    }
}

/// A time as seconds, minutes:seconds or hours:minutes:seconds, with or without AM or PM \[ms\].
pub(crate) fn time_of_day_ms(cell: &str, decimal: Decimal) -> Option<f64> {
    let cell = cell.trim();
    let upper = cell.to_ascii_uppercase();
    let (text, half_day) = ["AM", "PM", "A.M.", "P.M."]
        .iter()
        .find(|mark| upper.ends_with(*mark))
        .map_or((cell, None), |mark| {
            (
                cell[..cell.len() - mark.len()].trim_end(),
                Some(mark.starts_with('P')),
            )
        });
    let parts: Vec<&str> = text.split(':').collect();
    if parts.len() > 3 || (half_day.is_some() && parts.len() < 2) {
        return None;
    }
    let mut values = Vec::with_capacity(parts.len());
    for part in parts {
        values.push(number(part.trim().as_bytes(), decimal)?);
    }
    if let Some(after_noon) = half_day {
        if !(1.0..=12.0).contains(&values[0]) {
            return None;
        }
        values[0] = values[0] % 12.0 + if after_noon { 12.0 } else { 0.0 };
        if values.len() == 2 {
            values.push(0.0);
        }
    }
    let seconds = values.into_iter().fold(0.0, |sum, part| 60.0 * sum + part);
    Some(1e3 * seconds)
}

/// Relative difference between a stated interval and the one of the times that is told.
const OTHER_INTERVAL: f64 = 0.02;

/// A warning where the times of a file are not as far apart as its header states.
pub(crate) fn other_interval(
    file: &Path,
    stated_ms: Option<f64>,
    times_ms: &[f64],
) -> Option<Problem> {
    let stated_ms = stated_ms?;
    let mut steps: Vec<f64> = times_ms.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let step_ms = *steps.get(steps.len() / 2)?;
    ((step_ms / stated_ms - 1.0).abs() > OTHER_INTERVAL).then(|| {
        Problem::warning(
            file,
            format!("times {step_ms:.4} ms apart, but an interval of {stated_ms:.4} ms in the header"),
            "times as far apart as the header states",
            "check the heart rate: the times are read; remove the column of times if the interval is right",
        )
    })
}

/// Which of the two numbers before the year is the day.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum DateOrder {
    /// `31.12.2026`
    #[default]
    DayFirst,
    /// `12/31/2026`
    MonthFirst,
}

impl DateOrder {
    /// The order in which the dates of a column follow each other, within the shorter time.
    pub(crate) fn of<'a>(cells: impl Iterator<Item = &'a str> + Clone) -> Self {
        let span_ms = |order: Self| {
            let mut stamps = cells
                .clone()
                .filter_map(|cell| stamp_in_order_ms(cell, Decimal::Point, order));
            let first = stamps.next()?;
            let last = stamps.try_fold(first, |before, at| (at >= before).then_some(at))?;
            Some(last - first)
        };
        match (span_ms(Self::DayFirst), span_ms(Self::MonthFirst)) {
            (None, Some(_)) => Self::MonthFirst,
            (Some(day_first), Some(month_first)) if month_first < day_first => Self::MonthFirst,
            _ => Self::DayFirst,
        }
    }
}

/// Whether a cell is a date alone, such as 2/3/2026, 02.03.2026 or 2026-03-02.
pub(crate) fn is_date(cell: &str) -> bool {
    let cell = cell.trim().trim_matches('"').trim();
    let parts: Vec<&str> = cell.split(['/', '-', '.']).collect();
    parts.len() == 3
        && parts
            .iter()
            .all(|part| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit()))
}

/// A time of day without its zone, and the zone's distance from UTC \[ms\]: `09:00:00.5+01:00`.
fn without_zone(time: &str) -> (&str, f64) {
    let time = time.trim();
    if let Some(time) = time.strip_suffix(['Z', 'z']) {
        return (time.trim_end(), 0.0);
    }
    let Some(at) = time
        .rfind(['+', '-'])
        .filter(|at| time[..*at].contains(':'))
    else {
        return (time, 0.0);
    };
    let digits: String = time[at + 1..].chars().filter(|c| *c != ':').collect();
    let is_zone = matches!(digits.len(), 2 | 4) && digits.bytes().all(|b| b.is_ascii_digit());
    let (Some(hours), true) = (digits.get(..2).and_then(|h| h.parse::<f64>().ok()), is_zone) else {
        return (time, 0.0);
    };
    let minutes = digits[2..].parse::<f64>().unwrap_or(0.0);
    let sign = if time[at..].starts_with('-') {
        -1.0
    } else {
        1.0
    };
    (
        time[..at].trim_end(),
        sign * 60_000.0 * (60.0 * hours + minutes),
    )
}

/// A date with a time of day, such as `2026-03-02 09:00:00.004`, `02.03.2026 09:00:00`,
/// `2026-03-02T09:00:00.004Z` or `2026-03-02T10:00:00+01:00`, or a time of day with two colons, or with
/// one and decimals \[ms since the year 0 or since midnight, of UTC where the zone is there\]. Of dates with the year last, the day
/// comes first unless it cannot.
pub(crate) fn stamp_ms(cell: &str, decimal: Decimal) -> Option<f64> {
    stamp_in_order_ms(cell, decimal, DateOrder::DayFirst)
}

/// The same in a stated order of day and month.
pub(crate) fn stamp_in_order_ms(cell: &str, decimal: Decimal, order: DateOrder) -> Option<f64> {
    let cell = cell.trim().trim_matches('"').trim();
    let (date, time) = match cell.split_once(['T', ' ']) {
        Some((date, time)) if date.contains(['-', '/', '.']) && !date.contains(':') => {
            (Some(date), time)
        }
        _ => (None, cell),
    };
    let (time, zone_ms) = without_zone(time);
    let n_colons = time.matches(':').count();
    // Minutes and seconds with decimals, as Excel writes times into text: `01:02.5`.
    let of_minutes = date.is_none() && n_colons == 1 && time.contains(['.', ',']);
    if n_colons != 2 && !of_minutes && !(date.is_some() && n_colons == 1) {
        return None;
    }
    let time = if n_colons == 1 && !of_minutes {
        format!("{time}:00")
    } else {
        time.to_owned()
    };
    let of_day = time_of_day_ms(&time, decimal)
        .or_else(|| time_of_day_ms(&time, Decimal::Point))
        .or_else(|| time_of_day_ms(&time, Decimal::Comma))?;
    let Some(date) = date else {
        return Some(of_day - zone_ms);
    };
    let parts: Vec<i64> = date
        .split(['-', '/', '.'])
        .map(|part| part.parse::<i64>().ok())
        .collect::<Option<Vec<i64>>>()?;
    let [a, b, c] = parts[..] else {
        return None;
    };
    let (year, month, day) = match order {
        _ if a > 31 => (a, b, c),
        DateOrder::DayFirst => (c, b, a),
        DateOrder::MonthFirst => (c, a, b),
    };
    // A number above 12 is no month.
    let (month, day) = if month > 12 {
        (day, month)
    } else {
        (month, day)
    };
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    Some(days(year, month, day) as f64 * DAY_MS + of_day - zone_ms)
}

/// Days since 1 March of the year 0 in the Gregorian calendar (Hatcher 1984, Q J R Astron Soc 25:53).
fn days(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    365 * year + year.div_euclid(4) - year.div_euclid(100)
        + year.div_euclid(400)
        + (153 * month + 2) / 5
        + day
        - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_day_are_read_with_and_without_halves() {
        for (text, seconds) in [
            ("3.5", 3.5),
            ("0:01:00.5", 60.5),
            ("2:03", 123.0),
            ("11:59:50.004 PM", 86_390.004),
            ("12:00:01 AM", 1.0),
            ("12:00:01 pm", 43_201.0),
            ("1:00:00 p.m.", 46_800.0),
        ] {
            let found = time_of_day_ms(text, Decimal::Point).unwrap();
            assert!((found - 1e3 * seconds).abs() < 1e-6, "{text}: {found}");
        }
        for text in ["", "b", "13:00:00 PM", "1:2:3:4", "5 PM"] {
            assert_eq!(time_of_day_ms(text, Decimal::Point), None, "{text}");
        }
    }

    #[test]
    fn a_clock_counts_on_at_midnight_only() {
        let mut clock = Clock::default();
        let at = |clock: &mut Clock, text: &str| {
            clock
                .count_on(time_of_day_ms(text, Decimal::Point).unwrap())
                .unwrap()
        };
        assert_eq!(at(&mut clock, "23:59:59"), DAY_MS - 1000.0);
        assert_eq!(at(&mut clock, "0:00:01"), DAY_MS + 1000.0);
        assert_eq!(at(&mut clock, "0:00:00.5"), DAY_MS + 500.0);
    }

    #[test]
    fn zones_are_distances_from_utc() {
        let at = |text: &str| stamp_ms(text, Decimal::Point).unwrap();
        let utc = at("2026-03-29T00:59:59.5Z");
        for text in [
            "2026-03-29T01:59:59.5+01:00",
            "2026-03-29 02:59:59.5+0200",
            "2026-03-28T19:59:59.5-05",
            "2026-03-29 06:29:59.5 +05:30",
        ] {
            assert_eq!(at(text), utc, "{text}");
        }
        // The clock is put forward between these two, but no time passes.
        assert_eq!(at("2026-03-29T03:00:00+02:00") - utc, 500.0);
        assert_eq!(stamp_ms("09:00:00+1", Decimal::Point), None);
    }

    #[test]
    fn the_order_of_day_and_month_is_the_one_in_which_dates_follow() {
        let of = |cells: &[&str]| DateOrder::of(cells.iter().copied());
        // January 31 to February 1.
        assert_eq!(
            of(&["01/31/2026 23:59:59", "02/01/2026 00:00:01"]),
            DateOrder::MonthFirst
        );
        assert_eq!(
            of(&["31/01/2026 23:59:59", "01/02/2026 00:00:01"]),
            DateOrder::DayFirst
        );
        // A day rather than a month.
        assert_eq!(
            of(&["1/2/2026 23:59:59", "1/3/2026 00:00:01"]),
            DateOrder::MonthFirst
        );
        assert_eq!(
            of(&["2.1.2026 23:59:59", "3.1.2026 00:00:01"]),
            DateOrder::DayFirst
        );
        assert_eq!(
            of(&["1/2/2026 09:00:00", "1/2/2026 09:00:01"]),
            DateOrder::DayFirst
        );
        assert_eq!(of(&[]), DateOrder::DayFirst);
    }

    #[test]
    fn stamps_of_consecutive_days_follow_each_other() {
        let at = |text: &str| stamp_ms(text, Decimal::Point).unwrap();
        assert_eq!(
            at("2026-03-01 00:00:00") - at("2026-02-28 23:59:59.5"),
            500.0
        );
        assert_eq!(
            at("2024-03-01T00:00:00Z") - at("2024-02-28T00:00:00Z"),
            2.0 * DAY_MS
        );
        assert_eq!(
            at("2/28/2026 9:00:01 PM") - at("2/28/2026 9:00:00 PM"),
            1000.0
        );
        assert_eq!(
            at("31.12.2026 10:00:00.004") - at("31.12.2026 10:00:00"),
            4.0
        );
        assert_eq!(at("09:00:00.004"), 32_400_004.0);
        assert_eq!(at("01:02.5"), 62_500.0);
        for text in ["", "5", "9:00", "2026-13-41 10:00:00", "x 10:00:00"] {
            assert_eq!(stamp_ms(text, Decimal::Point), None, "{text}");
        }
    }
}
