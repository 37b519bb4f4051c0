//! Numbers and names for a person.

use maud::{Markup, html};

/// `digits` significant digits, without exponent where it can be read without; a true minus sign.
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

/// Fixed decimals with a true minus sign, none where it rounds to nothing; a dash where there is no value.
#[must_use]
pub fn fixed(value: Option<f64>, decimals: usize) -> String {
    match value {
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

/// A share as signed percent: 0.051 is `+5.1`, and what rounds to nothing has no sign.
#[must_use]
pub fn percent(share: Option<f64>) -> String {
    match share {
        Some(share) if share.is_finite() && (share * 1000.0).round() == 0.0 => "0.0".to_owned(),
        Some(share) if share.is_finite() => {
            format!("{:+.1}", share * 100.0).replace('-', "\u{2212}")
        }
        _ => "\u{2013}".to_owned(),
    }
}

/// Seconds, minutes or hours, as fits.
#[must_use]
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 0.9995 => format!("{:.0} ms", s * 1e3),
        s if s < 99.95 => format!("{s:.1} s"),
        s if s < 5940.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// `1 patient`, `2 patients`.
#[must_use]
pub fn count(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// An RFC 3339 time as a person reads it.
#[must_use]
pub fn moment(rfc3339: &str) -> String {
    match rfc3339.split_once('T') {
        Some((day, time)) if time.len() >= 8 => format!("{day} {} UTC", &time[..8]),
        _ => rfc3339.to_owned(),
    }
}

/// Symbol, subscript, unit and meaning of a parameter or biomarker by its key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label {
    /// τ
    pub symbol: &'static str,
    /// SR,ref
    pub sub: &'static str,
    /// ms
    pub unit: &'static str,
    /// In words.
    pub meaning: &'static str,
}

const fn label(
    symbol: &'static str,
    sub: &'static str,
    unit: &'static str,
    meaning: &'static str,
) -> Label {
    Label {
        symbol,
        sub,
        unit,
        meaning,
    }
}

const LABELS: &[(&str, Label)] = &[
    (
        "Smax_ref_kPa",
        label("S", "max,ref", "kPa", "peak isometric stress"),
    ),
    (
        "tau_SR_ref_ms",
        label("τ", "SR,ref", "ms", "time constant of the stress rise"),
    ),
    (
        "tau_SD_ms",
        label("τ", "SD", "ms", "time constant of the stress decay"),
    ),
    (
        "t_CR_ms",
        label("t", "CR", "ms", "duration of the stress transient"),
    ),
    (
        "R_AV_f_mmHg_s_per_mL",
        label(
            "R",
            "AV,f",
            "mmHg·s/mL",
            "forward resistance of the aortic valve",
        ),
    ),
    (
        "R_MV_f_mmHg_s_per_mL",
        label(
            "R",
            "MV,f",
            "mmHg·s/mL",
            "forward resistance of the mitral valve",
        ),
    ),
    (
        "k_TRPN_per_ms",
        label("k", "TRPN", "1/ms", "unbinding of calcium from troponin"),
    ),
    (
        "n_TRPN",
        label("n", "TRPN", "", "cooperativity of calcium and troponin"),
    ),
    (
        "Ca50_ref_uM",
        label("Ca", "50,ref", "µM", "calcium sensitivity"),
    ),
    (
        "k_U_per_ms",
        label("k", "U", "1/ms", "blocked to unblocked"),
    ),
    ("n_Tm", label("n", "Tm", "", "cooperativity of tropomyosin")),
    (
        "TRPN50",
        label("TRPN", "50", "", "troponin at half blocking"),
    ),
    (
        "k_UW_per_ms",
        label("k", "UW", "1/ms", "unbound to weakly bound cross-bridges"),
    ),
    (
        "k_WS_per_ms",
        label("k", "WS", "1/ms", "weakly to strongly bound cross-bridges"),
    ),
    (
        "r_W",
        label("r", "W", "", "share of weakly bound cross-bridges"),
    ),
    (
        "r_S",
        label("r", "S", "", "share of strongly bound cross-bridges"),
    ),
    (
        "gamma_S_per_ms",
        label("γ", "S", "1/ms", "distortion-dependent unbinding, strong"),
    ),
    (
        "gamma_W_per_ms",
        label("γ", "W", "1/ms", "distortion-dependent unbinding, weak"),
    ),
    ("phi", label("φ", "", "", "distortion decay")),
    ("A_eff", label("A", "eff", "", "distortion by velocity")),
    (
        "beta_0",
        label("β", "0", "", "stretch dependence of the stress"),
    ),
    (
        "beta_1_uM",
        label(
            "β",
            "1",
            "µM",
            "stretch dependence of the calcium sensitivity",
        ),
    ),
    ("Ca_res_uM", label("Ca", "res", "µM", "resting calcium")),
    ("Ca_max_uM", label("Ca", "max", "µM", "peak calcium")),
    (
        "tau_CR_ms",
        label("τ", "CR", "ms", "time constant of the calcium rise"),
    ),
    (
        "tau_CD_ms",
        label("τ", "CD", "ms", "time constant of the calcium decay"),
    ),
    (
        "a_p_kPa",
        label("a", "p", "kPa", "passive stiffness of the cell model"),
    ),
    ("P_max_mmHg", label("P", "max", "mmHg", "peak pressure")),
    (
        "dPdt_max_mmHg_per_ms",
        label(
            "dP/dt",
            "max",
            "mmHg/ms",
            "largest pressure rate before the peak",
        ),
    ),
    (
        "dPdt_min_mmHg_per_ms",
        label(
            "dP/dt",
            "min",
            "mmHg/ms",
            "smallest pressure rate after the peak",
        ),
    ),
    (
        "PTD90_ms",
        label("PTD", "90", "ms", "pressure transient duration, t3 − t1"),
    ),
    ("SV_mL", label("SV", "", "mL", "stroke volume")),
    (
        "tau_VD_ms",
        label("τ", "VD", "ms", "time constant of ejection"),
    ),
    (
        "tau_VR_ms",
        label("τ", "VR", "ms", "time constant of rapid filling"),
    ),
    (
        "EDV_mL",
        label("EDV", "", "mL", "volume at the beat's start"),
    ),
    ("ESV_mL", label("ESV", "", "mL", "smallest volume")),
    (
        "EDP_mmHg",
        label("EDP", "", "mmHg", "pressure at the beat's start"),
    ),
    (
        "end_of_beat_gap_mL",
        label(
            "gap",
            "",
            "mL",
            "measured EDV minus simulated volume at the beat's end",
        ),
    ),
    (
        "Sa_max_kPa",
        label("S", "a,max", "kPa", "peak active stress"),
    ),
    (
        "dSadt_max_kPa_per_ms",
        label("dSₐ/dt", "max", "kPa/ms", "largest rate before the peak"),
    ),
    (
        "STD30_ms",
        label("STD", "30", "ms", "stress transient duration at 30 % decay"),
    ),
    (
        "STD50_ms",
        label("STD", "50", "ms", "stress transient duration at 50 % decay"),
    ),
    (
        "STD90_ms",
        label("STD", "90", "ms", "stress transient duration at 90 % decay"),
    ),
    (
        "lambda_min",
        label("λ", "min", "", "smallest fibre stretch"),
    ),
];

impl Label {
    /// Of a key; `None` for a key that has no label.
    #[must_use]
    pub fn of(key: &str) -> Option<Self> {
        LABELS
            .iter()
            .find(|(k, _)| *k == key)
            .map(|(_, label)| *label)
    }

    /// Symbol with subscript for tables.
    #[must_use]
    pub fn html(self) -> Markup {
        html! { i { (self.symbol) } @if !self.sub.is_empty() { sub { (self.sub) } } }
    }
}

/// Symbol of a key for tables, with its meaning on hover; the key itself where it has none.
#[must_use]
pub fn symbol(key: &str) -> Markup {
    match Label::of(key) {
        Some(label) => html! { span title={ (label.meaning) " (" (key) ")" } { (label.html()) } },
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
            cardiotwin_schemas::settings::STEP1_PARAMETERS
                .iter()
                .all(|k| Label::of(k).is_some())
        );
        assert!(
            crate::results::Biomarker::ALL
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
            ["0.0", "\u{2212}0.1", "0.0"]
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
