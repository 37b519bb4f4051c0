//! How the numbers of a column are written, in every medium alike.

use serde_json::Value;

/// Format of a column's numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Digits {
    /// As in [`number`].
    Auto,
    /// This many decimals.
    Fixed(usize),
    /// This many decimals after a sign.
    Signed(usize),
    /// A share in percent with one decimal.
    Share,
    /// A relative difference in percent with a sign, as in [`percent`].
    Difference,
    /// Seconds, as in [`duration`].
    Duration,
}

impl Digits {
    /// The number in a column of this format. A dash stands for a missing one.
    #[must_use]
    pub fn write(self, value: &Value) -> String {
        let Some(number_of) = value.as_f64() else {
            return value.as_str().unwrap_or("-").to_owned();
        };
        match self {
            Self::Auto if !value.is_f64() => value.to_string(),
            Self::Auto => number(number_of),
            Self::Fixed(decimals) => format!("{number_of:.decimals$}"),
            Self::Signed(decimals) => format!("{number_of:+.decimals$}"),
            Self::Share => format!("{:.1}", 100.0 * number_of),
            Self::Difference => difference(number_of),
            Self::Duration => duration(number_of),
        }
    }

    /// Factor from a value to its written form.
    #[must_use]
    pub fn factor(self) -> f64 {
        match self {
            Self::Share | Self::Difference => 100.0,
            _ => 1.0,
        }
    }
}

/// A number with as many digits as a table needs; very large and very small ones in scientific
/// notation.
#[must_use]
pub fn number(value: f64) -> String {
    let magnitude = value.abs();
    match value {
        _ if !value.is_finite() => value.to_string(),
        _ if magnitude == 0.0 => "0".to_owned(),
        _ if magnitude >= 1e5 => format!("{value:.3e}"),
        _ if magnitude >= 100.0 => format!("{value:.1}"),
        _ if magnitude >= 1.0 => format!("{value:.2}"),
        _ if magnitude >= 0.001 => format!("{value:.4}"),
        _ => format!("{value:.2e}"),
    }
}

/// The number as in [`number`], or a dash.
#[must_use]
pub fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), number)
}

/// A share as signed percent without its unit. A share that rounds to zero has no sign.
fn difference(share: f64) -> String {
    if (share * 1000.0).round() == 0.0 {
        return "0.0".to_owned();
    }
    format!("{:+.1}", 100.0 * share)
}

/// A share as signed percent, or a dash.
#[must_use]
pub fn percent(value: Option<f64>) -> String {
    value.map_or_else(
        || "-".to_owned(),
        |share| format!("{} %", difference(share)),
    )
}

/// Seconds as `00:01:23`, short ones as `3.2 s`.
#[must_use]
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "-".to_owned();
    }
    if seconds < 60.0 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    format!(
        "{:02}:{:02}:{:02}",
        whole / 3600,
        whole / 60 % 60,
        whole % 60
    )
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn quantities_for_people() {
        assert_eq!(
            [number(0.0834), number(12.3456), number(631.0), number(1e-5)],
            ["0.0834", "12.35", "631.0", "1.00e-5"]
        );
        assert_eq!(
            [duration(3.21), duration(83.0), duration(4360.0)],
            ["3.2 s", "00:01:23", "01:12:40"]
        );
        assert_eq!(
            [Some(-0.0531), Some(-0.0004), None].map(percent),
            ["-5.3 %", "0.0 %", "-"]
        );
    }

    #[test]
    fn each_format_writes_numbers_words_and_gaps() {
        let written = |digits: Digits| {
            [json!(0.1234), json!(7), json!("none"), json!(null)].map(|v| digits.write(&v))
        };
        assert_eq!(written(Digits::Auto), ["0.1234", "7", "none", "-"]);
        assert_eq!(written(Digits::Fixed(2)), ["0.12", "7.00", "none", "-"]);
        assert_eq!(written(Digits::Signed(1)), ["+0.1", "+7.0", "none", "-"]);
        assert_eq!(written(Digits::Share), ["12.3", "700.0", "none", "-"]);
        assert_eq!(
            written(Digits::Difference),
            ["+12.3", "+700.0", "none", "-"]
        );
        assert_eq!(written(Digits::Duration), ["0.1 s", "7.0 s", "none", "-"]);
    }
}
