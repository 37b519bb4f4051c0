//! Times as text: UTC, RFC 3339, in milliseconds. The functions are pure; coordinator and worker
//! each read their clock in one place.

/// `ms` since 1970-01-01T00:00:00Z as text, for example `2026-07-30T12:34:56.789Z`.
#[must_use]
pub fn utc_text(ms: i64) -> String {
    let (days, ms_of_day) = (ms.div_euclid(86_400_000), ms.rem_euclid(86_400_000));
    let (year, month, day) = civil(days);
    let (s, milli) = (ms_of_day / 1000, ms_of_day % 1000);
    format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}.{milli:03}Z",
        s / 3600,
        s / 60 % 60,
        s % 60
    )
}

/// Inverse of [`utc_text`]; `None` for any other form.
#[must_use]
pub fn utc_ms(text: &str) -> Option<i64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let numbers = |text: &str, separators: &[char]| -> Option<Vec<i64>> {
        text.split(separators)
            .map(|part| part.parse().ok())
            .collect()
    };
    let ([year, month, day], [h, min, s, milli]) = (
        <[i64; 3]>::try_from(numbers(date, &['-'])?).ok()?,
        <[i64; 4]>::try_from(numbers(time, &[':', '.'])?).ok()?,
    );
    // Days since 0000-03-01, as in `civil`, minus those until 1970.
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let (era, year_of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let day_of_year = (153 * month + 2) / 5 + day - 1;
    let days = era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100
        + day_of_year
        - 719_468;
    Some(days * 86_400_000 + ((h * 60 + min) * 60 + s) * 1000 + milli)
}

/// Calendar date of a day counted from 1970-01-01. Hinnant's algorithm uses eras of 400 years and
/// years that start in March and end with the leap day.
fn civil(days: i64) -> (i64, i64, i64) {
    let z = days + 719_468;
    let (era, day_of_era) = (z.div_euclid(146_097), z.rem_euclid(146_097));
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 {
        shifted + 3
    } else {
        shifted - 9
    };
    (year_of_era + era * 400 + i64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::{utc_ms, utc_text};

    #[test]
    fn known_instants() {
        for (ms, text) in [
            (-1, "1969-12-31T23:59:59.999Z"),
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_400_000, "2000-02-29T00:00:00.000Z"),
            (951_827_696_789, "2000-02-29T12:34:56.789Z"),
            (951_868_800_000, "2000-03-01T00:00:00.000Z"),
            (1_704_067_199_999, "2023-12-31T23:59:59.999Z"),
            (4_107_542_399_999, "2100-02-28T23:59:59.999Z"),
            (4_107_542_400_000, "2100-03-01T00:00:00.000Z"),
        ] {
            assert_eq!(utc_text(ms), text);
            assert_eq!(utc_ms(text), Some(ms));
        }
        assert_eq!(utc_ms("2024-01-01 00:00:00"), None);
    }
}
