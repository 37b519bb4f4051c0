//! Times in Slurm's notation: limits and durations as `[days-]hours:minutes:seconds`, instants as
//! seconds since 1970.

use crate::job::number;

/// A limit on time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Limit {
    /// A limit in seconds.
    Seconds(u64),
    /// The word `UNLIMITED`.
    Unlimited,
}

/// Reads a limit that Slurm prints: `D-HH:MM:SS`, `HH:MM:SS`, `MM:SS` or `UNLIMITED`; `None` for
/// any other text.
#[must_use]
pub fn parse(text: &str) -> Option<Limit> {
    if text.eq_ignore_ascii_case("unlimited") {
        return Some(Limit::Unlimited);
    }
    let (days, clock) = match text.split_once('-') {
        Some((days, clock)) => (number::<u64>(days)?, clock),
        None => (0, text),
    };
    let parts = clock
        .split(':')
        .map(number::<u64>)
        .collect::<Option<Vec<_>>>()?;
    let (hours, minutes, seconds) = match parts.as_slice() {
        [h, m, s] => (*h, *m, *s),
        [m, s] if days == 0 => (0, *m, *s),
        _ => return None,
    };
    if minutes > 59 && hours + days > 0 || seconds > 59 {
        return None;
    }
    let seconds = days
        .checked_mul(86_400)?
        .checked_add(hours.checked_mul(3600)?)?
        .checked_add(minutes * 60 + seconds)?;
    Some(Limit::Seconds(seconds))
}

/// `seconds` in sbatch's notation: `D-HH:MM:SS`, or `HH:MM:SS` below a day.
#[must_use]
pub fn text(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    let clock = format!("{:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60);
    if days > 0 {
        format!("{days}-{clock}")
    } else {
        clock
    }
}

/// Reads an instant that a command printed with `SLURM_TIME_FORMAT=%s`; `None` for `N/A`,
/// `Unknown`, `None` and local times, whose zone is unknown.
#[must_use]
pub fn instant(text: &str) -> Option<i64> {
    number(text)
}

#[cfg(test)]
mod tests {
    use super::{Limit, instant, parse, text};
    use proptest::prelude::*;

    #[test]
    fn limits_as_slurm_writes_them() {
        for (written, seconds) in [
            ("1-00:00:00", 86_400),
            ("24:00:00", 86_400),
            ("00:20:00", 1200),
            ("59:58", 3598),
            ("4-01:02:03", 349_323),
        ] {
            assert_eq!(parse(written), Some(Limit::Seconds(seconds)), "{written}");
        }
        assert_eq!(parse("UNLIMITED"), Some(Limit::Unlimited));
        for odd in [
            "",
            "N/A",
            "1-",
            "1-5",
            "12",
            "00:00:61",
            "01:60:00",
            "-1:00:00",
            "99999999999999999999-00:00:00",
        ] {
            assert_eq!(parse(odd), None, "{odd:?}");
        }
        assert_eq!(instant("1795300496"), Some(1_795_300_496));
        assert_eq!(instant("2026-11-21T22:34:56"), None);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(seconds in 0_u64..10_000_000_000) {
            prop_assert_eq!(parse(&text(seconds)), Some(Limit::Seconds(seconds)));
        }

        #[test]
        fn no_text_panics(odd in "\\PC{0,40}|[0-9:-]{0,30}") {
            let _ = parse(&odd);
        }
    }
}
