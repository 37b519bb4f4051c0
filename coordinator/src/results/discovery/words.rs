//! Findings of a search in plain sentences.

use cardiotwin_schemas::discover::{Discovered, Place, RankedEffect, Side};

/// A name such as `isovolumic_relaxation` with spaces in place of underscores.
#[must_use]
pub fn plain(name: &str) -> String {
    name.replace('_', " ")
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

/// A parameter's name without its unit, and the unit in printed form.
#[must_use]
pub fn split_unit(name: &str) -> (&str, &'static str) {
    const UNITS: [(&str, &str); 12] = [
        ("_mmHg_s2_per_mL2", "mmHg s²/mL²"),
        ("_mmHg_s2_per_mL", "mmHg s²/mL"),
        ("_mmHg_s_per_mL", "mmHg s/mL"),
        ("_mL_per_mmHg", "mL/mmHg"),
        ("_mmHg", "mmHg"),
        ("_mL", "mL"),
        ("_kPa", "kPa"),
        ("_ms", "ms"),
        ("_cm2", "cm²"),
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

/// The whole finding in a paragraph.
#[must_use]
pub fn summary(found: &Discovered) -> String {
    let mut text = match (
        &found.findings.unexplained,
        found.findings.accepted.as_slice(),
    ) {
        (Some(gap), []) => {
            let lead = gap.depends_on.first().map_or(String::new(), |d| {
                format!(
                    "; of the remaining {}, {} explains most ({:.0} %)",
                    d.signal,
                    plain(&d.variable),
                    100.0 * d.share
                )
            });
            format!(
                "Model and data disagree, but no effect of the catalogue explains the gap: \
                 {}{lead}.",
                place(&gap.place)
            )
        }
        (_, []) => format!(
            "Nothing is missing: the base model follows the data to {:.2} times the noise, and no candidate is better by more \
             than chance (p = {:.3}).",
            found.findings.gap_before, found.findings.p_value
        ),
        (_, names) => named(found, names),
    };
    if !found.findings.confusable.is_empty() {
        let rivals: Vec<String> = found
            .findings
            .confusable
            .iter()
            .map(|name| plain(name))
            .collect();
        text.push_str(&format!(
            " These data cannot distinguish it from {}",
            rivals.join(", ")
        ));
        if found.findings.deciding_measurement.is_empty() {
            text.push('.');
        } else {
            text.push_str(&format!(
                "; these measurements would decide: {}.",
                found.findings.deciding_measurement.join("; ")
            ));
        }
    }
    text
}

fn named(found: &Discovered, names: &[String]) -> String {
    let effects = names.iter().filter_map(|name| {
        found
            .findings
            .effects
            .iter()
            .find(|effect| effect.name == *name)
    });
    let told: Vec<String> = effects
        .map(|effect| {
            let sure = format!("probability {:.2}", effect.probability);
            format!("{}: {}, {sure}", plain(&effect.name), strength(effect))
        })
        .collect();
    let places: Vec<String> = worst(found, 2).into_iter().map(place).collect();
    let held = match (
        found.findings.gap_heldout_before,
        found.findings.gap_heldout_after,
    ) {
        (Some(before), Some(after)) => {
            format!(", and on held-out data from {before:.2} to {after:.2}")
        }
        _ => String::new(),
    };
    let correct = |name: &&String| {
        found
            .findings
            .effects
            .iter()
            .any(|effect| effect.name == **name && effect.artefact)
    };
    let artefacts: Vec<String> = names
        .iter()
        .filter(correct)
        .map(|name| plain(name))
        .collect();
    let remedy = if artefacts.is_empty() {
        String::new()
    } else {
        format!(
            " Correct this in the data, not in the heart: {}.",
            artefacts.join(", ")
        )
    };
    format!(
        "The base model misses: {}. Without it, model and data differ most in {}. Adding it reduces \
         the gap from {:.2} to {:.2} times the noise{held}.{remedy}",
        told.join("; "),
        places.join(" and in "),
        found.findings.gap_before,
        found.findings.gap_after,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::discovery::fixture::{effect, finding, kick, nothing, unexplained};

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

    #[test]
    fn each_kind_of_answer_is_said() {
        let text = summary(&kick());
        for part in [
            "misses: atrial kick: amplitude 7.90 mmHg (6.25 to 9.50), probability 0.98",
            "volume in atrial systole, data 6.00 mL above the model (z 3.1)",
            "from 1.61 to 0.94 times the noise, and on held-out data from 1.72 to 1.10",
            "cannot distinguish it from passive stiffening; these measurements would decide: atrial or wedge pressure.",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        let artefact = finding(vec![effect("pressure_offset", 30.0, true)], 1);
        assert!(
            summary(&artefact)
                .contains("Correct this in the data, not in the heart: pressure offset.")
        );
        assert!(summary(&nothing()).starts_with("Nothing is missing"));
        let text = summary(&unexplained());
        assert!(
            text.contains("no effect of the catalogue explains the gap")
                && text.contains("aortic flow explains most (40 %)"),
            "{text}"
        );
    }
}
