//! Names, values and places of a search's findings in words.

use cardiotwin_schemas::discover::{Discovered, Place, RankedEffect, Side, Verdict};

/// A name such as `isovolumic_relaxation` with spaces in place of underscores.
#[must_use]
pub fn plain(name: &str) -> String {
    name.replace('_', " ")
}

/// A probability with a number of digits. It is never shown as 0 or 1, because no record is certain.
#[must_use]
pub fn probability(p: f64, digits: usize) -> String {
    let least = 0.1_f64.powi(i32::try_from(digits).unwrap_or(i32::MAX));
    if p < 0.5 * least {
        format!("< {least:.digits$}")
    } else if p >= 1.0 - 0.5 * least {
        format!("> {:.digits$}", 1.0 - least)
    } else {
        format!("{p:.digits$}")
    }
}

/// Strength of an effect with its interval, such as `amplitude 7.9 mmHg (6.2 to 9.6)`.
#[must_use]
pub fn strength(effect: &RankedEffect) -> String {
    let parts: Vec<String> = effect
        .strength
        .iter()
        .map(|(name, value)| {
            let (label, unit) = split_unit(name);
            let range = effect.interval.get(name);
            let range = range.map_or(String::new(), |[low, high]| {
                format!(" ({} to {})", digits(*low), digits(*high))
            });
            let space = if unit.is_empty() { "" } else { " " };
            format!("{} {}{space}{unit}{range}", plain(label), digits(*value))
        })
        .collect();
    parts.join(", ")
}

/// The mark of accepted effects that held-out data do not confirm.
pub const UNCONFIRMED: &str = " (not confirmed on held-out data)";

/// [`UNCONFIRMED`] where it applies; empty for any other effects.
#[must_use]
pub fn unconfirmed(found: &Discovered) -> &'static str {
    match found.findings.confirmed() {
        Some(false) => UNCONFIRMED,
        _ => "",
    }
}

/// What is missing, in a few words: the effects, each with its class, or why none is named.
///
/// - `name`: form of an effect's name
#[must_use]
pub fn missing(found: &Discovered, name: impl Fn(&str) -> String) -> String {
    let findings = &found.findings;
    let any_of = |effects: &[String]| {
        let names: Vec<String> = effects.iter().map(|effect| name(effect)).collect();
        names.join(" or ")
    };
    match findings.verdict() {
        Verdict::Named => {
            let of = |effect: &String| {
                let class = findings.class_of(effect);
                class.map_or_else(|| name(effect), |class| any_of(&class.effects))
            };
            let names: Vec<String> = findings.accepted.iter().map(of).collect();
            format!("{}{}", names.join(" + "), unconfirmed(found))
        }
        Verdict::OneOf(class) => any_of(&class.effects),
        Verdict::Unexplained(_) => "unexplained".to_owned(),
        Verdict::Undecided => "undecided".to_owned(),
        Verdict::Gap(_) => "a gap that no effect explains".to_owned(),
        Verdict::Nothing => "none".to_owned(),
    }
}

/// A parameter's name without its unit, and the unit in printed form.
#[must_use]
pub fn split_unit(name: &str) -> (&str, &'static str) {
    const UNITS: [(&str, &str); 13] = [
        ("_mmHg_s2_per_mL2", "mmHg s²/mL²"),
        ("_mmHg_s2_per_mL", "mmHg s²/mL"),
        ("_mmHg_s_per_mL", "mmHg s/mL"),
        ("_mL_per_mmHg", "mL/mmHg"),
        ("_mmHg", "mmHg"),
        ("_mL", "mL"),
        ("_kPa", "kPa"),
        ("_ms", "ms"),
        ("_cm2", "cm²"),
        ("_mJ", "mJ"),
        ("_Hz", "Hz"),
        ("_share", ""),
        ("_factor", ""),
    ];
    let found = UNITS
        .iter()
        .find(|(ending, unit)| !unit.is_empty() && name.ends_with(ending));
    found.map_or((name, ""), |(ending, unit)| {
        (&name[..name.len() - ending.len()], *unit)
    })
}

/// A value with about three significant digits.
#[must_use]
pub fn digits(value: f64) -> String {
    let magnitude = value.abs();
    match magnitude {
        _ if magnitude >= 100.0 => format!("{value:.0}"),
        _ if magnitude >= 10.0 => format!("{value:.1}"),
        _ if magnitude >= 1.0 => format!("{value:.2}"),
        _ if magnitude >= 0.01 || magnitude == 0.0 => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}

/// Description of a place, such as `volume in atrial systole, data 6.1 mL above the model (z 5.0)`.
#[must_use]
pub fn place(place: &Place) -> String {
    let when = if place.phase == "beat" {
        String::new()
    } else {
        format!(" in {}", plain(&place.phase))
    };
    // A mean within its own noise is no difference: the misfit there changes its sign.
    if place.z.abs() < 1.0 && place.phase != "beat" {
        let signal = plain(&place.signal);
        return format!("{signal}{when}, data in part above and in part below the model");
    }
    let side = match place.sign {
        Side::Above => "above",
        Side::Below => "below",
    };
    format!(
        "{}{when}, data {} {} {side} the model (z {:.1})",
        plain(&place.signal),
        digits(place.size.abs()),
        place.unit,
        place.z
    )
}

/// The `n` places with the largest deviations in standard deviations.
#[must_use]
pub fn worst(found: &Discovered, n: usize) -> Vec<&Place> {
    let mut places: Vec<&Place> = found
        .findings
        .places
        .iter()
        .filter(|p| p.share > 0.0)
        .collect();
    places.sort_by(|a, b| b.z.abs().total_cmp(&a.z.abs()));
    places.truncate(n);
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_probability_is_shown_as_certain() {
        let shown = [0.0, 0.0006, 0.4, 0.9994, 1.0].map(|p| probability(p, 3));
        assert_eq!(shown, ["< 0.001", "0.001", "0.400", "0.999", "> 0.999"]);
        let shown = [0.004, 0.01, 0.996].map(|p| probability(p, 2));
        assert_eq!(shown, ["< 0.01", "0.01", "> 0.99"]);
    }

    #[test]
    fn units_are_split_from_names() {
        assert_eq!(split_unit("loss_mmHg_s2_per_mL2"), ("loss", "mmHg s²/mL²"));
        assert_eq!(split_unit("volume_delay_ms"), ("volume_delay", "ms"));
        assert_eq!(split_unit("damping"), ("damping", ""));
        assert_eq!(
            [
                digits(123.4),
                digits(12.34),
                digits(1.234),
                digits(0.0),
                digits(0.0012)
            ]
            .join(" "),
            "123 12.3 1.23 0.000 1.20e-3"
        );
    }
}
