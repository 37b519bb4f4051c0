//! Formats of numbers and names for readers.

use cardiotwin_schemas::label::Label;
use maud::{Markup, html};

/// `value` with `digits` significant digits and a true minus sign; with an exponent only if it is
/// very large or small.
#[must_use]
pub fn significant(value: f64, digits: i32) -> String {
    if !value.is_finite() {
        return "not finite".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor() as i32;
    let text = if (-4..7).contains(&magnitude) {
        let decimals = (digits - 1 - magnitude).max(0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.*e}", (digits - 1).max(0) as usize)
    };
    text.replace('-', "\u{2212}")
}

/// `value` with fixed decimals and a true minus sign, which is left out if the value rounds to
/// zero; a dash for `None`.
#[must_use]
pub fn fixed(value: Option<f64>, decimals: usize) -> String {
    match value {
        Some(0.0) => "0".to_owned(),
        Some(value) if value.is_finite() => {
            let text = format!("{value:.decimals$}");
            let nothing = text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.'));
            if nothing {
                text.replace('-', "")
            } else {
                text.replace('-', "\u{2212}")
            }
        }
        _ => "\u{2013}".to_owned(),
    }
}

/// A share as signed percent: 0.051 is `+5.1`, and a value that rounds to zero has no sign.
#[must_use]
pub fn percent(share: Option<f64>) -> String {
    match share {
        Some(0.0) => "0".to_owned(),
        Some(share) if share.is_finite() && (share * 1000.0).round() == 0.0 => "0.0".to_owned(),
        Some(share) if share.is_finite() => {
            format!("{:+.1}", share * 100.0).replace('-', "\u{2212}")
        }
        _ => "\u{2013}".to_owned(),
    }
}

/// A value as it was computed, for the script that sorts and saves tables; empty for none.
#[must_use]
pub fn raw(value: Option<f64>) -> String {
    value
        .filter(|value| value.is_finite())
        // Adding zero turns a negative zero into a positive one.
        .map_or_else(String::new, |value| (value + 0.0).to_string())
}

/// A duration in milliseconds, seconds, minutes or hours, depending on its size.
#[must_use]
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 0.9995 => format!("{:.0} ms", s * 1e3),
        s if s < 99.95 => format!("{s:.1} s"),
        s if s < 5940.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A number with its noun, such as `1 patient` or `2 patients`.
#[must_use]
pub fn count(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// An RFC 3339 time as `2026-01-02 03:04:05 UTC`.
#[must_use]
pub fn moment(rfc3339: &str) -> String {
    match rfc3339.split_once('T') {
        Some((day, time)) if time.len() >= 8 => format!("{day} {} UTC", &time[..8]),
        _ => rfc3339.to_owned(),
    }
}

/// Symbol with subscript for tables.
#[must_use]
pub fn label_html(label: Label) -> Markup {
    html! { i { (label.symbol) } @if !label.subscript.is_empty() { sub { (label.subscript) } } }
}

/// Symbol of a key, with its meaning on hover; the key itself if it has no symbol.
#[must_use]
pub fn symbol(key: &str) -> Markup {
    match Label::of(key) {
        Some(label) => {
            html! { span title={ (label.meaning) " (" (key) ")" } { (label_html(label)) } }
        }
        None => html! { code { (key) } },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_significant_ones() {
        let found =
            [1.0, 0.05234, 108.44, -2.849, 1e-7, 0.0, 12345.6, f64::NAN].map(|v| significant(v, 3));
        assert_eq!(
            found,
            [
                "1.00",
                "0.0523",
                "108",
                "\u{2212}2.85",
                "1.00e\u{2212}7",
                "0",
                "12346",
                "not finite"
            ]
        );
    }

    #[test]
    fn every_parameter_that_can_be_fitted_has_a_label() {
        assert!(
            cardiotwin_schemas::organ::CELL_PARAMETERS
                .iter()
                .all(|k| Label::of(k).is_some())
        );
        assert!(
            cardiotwin_schemas::step1::Step1Parameter::KEYS
                .iter()
                .all(|k| Label::of(k).is_some())
        );
        assert!(
            cardiotwin_schemas::biomarkers::Biomarker::ALL
                .iter()
                .all(|b| Label::of(b.key()).is_some_and(|l| l.unit == b.unit()))
        );
    }

    #[test]
    fn durations_and_moments_read_well() {
        assert_eq!(
            [0.0123, 4.26, 125.0, 7200.0].map(duration),
            ["12 ms", "4.3 s", "2.1 min", "2.0 h"]
        );
        assert_eq!(
            [-0.04, -0.06, 0.0].map(|v| fixed(Some(v), 1)),
            ["0.0", "\u{2212}0.1", "0"]
        );
        assert_eq!(
            moment("2026-01-02T03:04:05.678Z"),
            "2026-01-02 03:04:05 UTC"
        );
        assert_eq!(
            [-0.0514, -0.0004, 0.2].map(|s| percent(Some(s))),
            ["\u{2212}5.1", "0.0", "+20.0"]
        );
    }
}
