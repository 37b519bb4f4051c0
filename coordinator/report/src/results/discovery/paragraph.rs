//! The findings of a search in a paragraph: the missing effects, where they show in the beat, how sure
//! they are, their rivals, the next measurement, and the changes for the patient.

use cardiotwin_schemas::discover::{
    BY_CHANCE, Discovered, EffectClass, IndexChange, RankedEffect, Unexplained, Verdict,
};

use super::words::{digits, place, plain, probability, split_unit, strength, worst};

/// Share of an index by which it changes at least where the paragraph tells it.
const TOLD: f64 = 0.05;
/// Number of changed indices that the paragraph tells.
const N_TOLD: usize = 4;

/// Index of a stenosis: the ventricle's peak pressure above the aorta's. A reflected wave raises the
/// aorta's above the ventricle's.
const PRESSURE_DROP: &str = "pressure_drop_to_aorta_mmHg";

/// The whole finding in a paragraph.
#[must_use]
pub fn summary(found: &Discovered) -> String {
    let sentences = match found.findings.verdict() {
        Verdict::Named => named(found),
        Verdict::OneOf(class) => one_of(found, class),
        Verdict::Unexplained(gap) => vec![nameless(gap)],
        Verdict::Undecided => undecided(found),
        Verdict::Gap(gap) => vec![remains(gap)],
        Verdict::Nothing => vec![nothing(found)],
    };
    sentences.join(" ")
}

/// Where a gap without a name is, and what explains most of it.
fn where_it_is(gap: &Unexplained) -> String {
    let lead = gap.depends_on.first().map_or(String::new(), |d| {
        let share = 100.0 * d.share;
        let variable = plain(&d.variable);
        format!(
            "; of the remaining {}, {variable} explains most ({share:.0} %)",
            d.signal
        )
    });
    format!("{}{lead}", place(&gap.place))
}

fn nameless(gap: &Unexplained) -> String {
    let place = where_it_is(gap);
    format!("Model and data disagree, but no effect of the catalogue explains the gap: {place}.")
}

/// A gap that named effects leave, or that is too small to be called unexplained.
fn remains(gap: &Unexplained) -> String {
    let place = where_it_is(gap);
    format!("A gap remains that no effect of the catalogue explains: {place}.")
}

fn one_of(found: &Discovered, class: &EffectClass) -> Vec<String> {
    let findings = &found.findings;
    let told: Vec<String> = (class.effects.iter())
        .filter_map(|name| findings.effects.iter().find(|e| e.name == *name))
        .map(|effect| {
            let (name, strength) = (plain(&effect.name), strength(effect));
            let probability = probability(effect.probability, 2);
            format!("{name} ({strength}, probability {probability})")
        })
        .collect();
    let mut sentences = vec![format!(
        "One of these effects is missing, but the data do not tell which: {}.",
        told.join(" or ")
    )];
    sentences.extend(decides(found));
    sentences.extend(findings.remaining.as_ref().map(remains));
    sentences
}

fn undecided(found: &Discovered) -> Vec<String> {
    let findings = &found.findings;
    let (gap, p) = (findings.gap_before, p_in_words(findings.p_value));
    let best = (findings.effects.first()).map_or(String::new(), |effect| {
        let (name, probability) = (plain(&effect.name), probability(effect.probability, 2));
        format!(", {name} (probability {probability}),")
    });
    let chance = if findings.p_value < BY_CHANCE {
        format!("is better by more than chance ({p})")
    } else {
        format!("is likelier than all else, though chance alone may give as much ({p})")
    };
    let mut sentences = vec![format!(
        "Undecided: the base model follows the data to {gap:.2} times the noise, and the best candidate{best} {chance}, \
         but none is accepted."
    )];
    sentences.extend(decides(found));
    sentences.extend(findings.remaining.as_ref().map(remains));
    sentences
}

fn nothing(found: &Discovered) -> String {
    let (gap, p) = (found.findings.gap_before, found.findings.p_value);
    format!(
        "Nothing is missing: the base model follows the data to {gap:.2} times the noise, and no candidate is better by more \
         than chance ({}).",
        p_in_words(p)
    )
}

/// Measurements that would decide, the best first.
fn decides(found: &Discovered) -> Option<String> {
    let list = &found.findings.deciding_measurement;
    (!list.is_empty()).then(|| format!("These measurements would decide: {}.", list.join("; ")))
}

/// A probability with two digits; it is never zero, because the number of draws bounds it.
#[must_use]
pub fn p_in_words(p: f64) -> String {
    if p < 0.001 {
        "p < 0.001".to_owned()
    } else {
        format!("p = {p:.3}")
    }
}

fn named(found: &Discovered) -> Vec<String> {
    let effects: Vec<&RankedEffect> = (found.findings.accepted.iter())
        .filter_map(|name| found.findings.effects.iter().find(|e| e.name == *name))
        .collect();
    let told: Vec<String> = (effects.iter())
        .map(|effect| {
            let (name, strength) = (plain(&effect.name), strength(effect));
            let instead = instead(found, &effect.name);
            let probability = probability(effect.probability, 2);
            format!("{name}: {strength}, probability {probability}{instead}")
        })
        .collect();
    let places: Vec<String> = worst(found, 2).into_iter().map(place).collect();
    let mut sentences = vec![
        format!("The base model misses: {}.", told.join("; ")),
        format!(
            "Without it, model and data differ most in {}.",
            places.join(" and in ")
        ),
        gap(found),
    ];
    sentences.extend(rivals(found));
    sentences.extend(found.findings.remaining.as_ref().map(remains));
    sentences.extend(changes(found));
    let artefacts: Vec<String> = (effects.iter())
        .filter(|effect| effect.artefact)
        .map(|effect| plain(&effect.name))
        .collect();
    if !artefacts.is_empty() {
        let list = artefacts.join(", ");
        sentences.push(format!(
            "Correct this in the data, not in the heart: {list}."
        ));
    }
    sentences
}

/// The other effects of a named effect's class, which may be missing in its place.
fn instead(found: &Discovered, effect: &str) -> String {
    let others = |class: &EffectClass| -> String {
        let names = class.effects.iter().filter(|name| *name != effect);
        names
            .map(|name| plain(name))
            .collect::<Vec<_>>()
            .join(" or ")
    };
    (found.findings.class_of(effect)).map_or(String::new(), |class| {
        format!(" (or, as these data do not tell, {})", others(class))
    })
}

/// How far model and data are apart without and with the effects.
fn gap(found: &Discovered) -> String {
    let findings = &found.findings;
    let gaps = (findings.gap_heldout_before, findings.gap_heldout_after);
    // What does not reduce the gap on data that it was not fitted to may only follow their noise.
    let held = match (findings.unconfirmed(), gaps) {
        (Some(why), _) => format!("; {why}"),
        (None, (Some(before), Some(after))) => {
            format!(", and on held-out data from {before:.2} to {after:.2}")
        }
        (None, _) => String::new(),
    };
    format!(
        "Adding it reduces the gap from {:.2} to {:.2} times the noise{held}.",
        findings.gap_before, findings.gap_after
    )
}

/// Rivals that leave nearly the same traces, though these data prefer the named effect by the odds of a
/// name, and the measurements that would decide. Rivals that the data do not exclude are in classes.
fn rivals(found: &Discovered) -> Option<String> {
    let findings = &found.findings;
    if findings.confusable.is_empty() {
        return decides(found);
    }
    let rivals: Vec<String> = findings.confusable.iter().map(|name| plain(name)).collect();
    let next = if findings.deciding_measurement.is_empty() {
        String::new()
    } else {
        let list = findings.deciding_measurement.join("; ");
        format!("; these measurements would decide: {list}")
    };
    Some(format!(
        "Hard to tell from it in such data, though these prefer it: {}{next}.",
        rivals.join(", ")
    ))
}

/// Indices of the heart that are judged differently with the effects, the most changed first.
fn changes(found: &Discovered) -> Option<String> {
    let measured = |name: &str| {
        // The same quantity among the measured biomarkers, whose names are short.
        let short = match name {
            "end_diastolic_pressure_mmHg" => "EDP_mmHg",
            "end_diastolic_volume_mL" => "EDV_mL",
            _ => return String::new(),
        };
        let how = match short {
            // Not the value of the patient's file, which may be a mean over some samples.
            "EDP_mmHg" => "first sample of the trace",
            _ => "measured",
        };
        let gap = found.biomarkers.iter().find(|gap| gap.name == short);
        gap.map_or(String::new(), |gap| {
            format!(" ({how}: {})", digits(gap.measured))
        })
    };
    let mut list: Vec<&IndexChange> = (found.indices.iter())
        .filter(|index| index.relative() >= TOLD)
        .collect();
    list.sort_by(|a, b| b.relative().total_cmp(&a.relative()));
    list.truncate(N_TOLD);
    let told: Vec<String> = (list.into_iter())
        .map(|index| {
            let (label, unit) = split_unit(&index.name);
            let space = if unit.is_empty() { "" } else { " " };
            let (after, before) = (digits(index.after), digits(index.before));
            let measured = measured(&index.name);
            if index.name == PRESSURE_DROP && index.after < 0.0 {
                let above = digits(-index.after);
                return format!(
                    "no pressure drop to the aorta, whose peak is {above} mmHg above the ventricle's, instead of a drop of {before}"
                );
            }
            format!(
                "{} {after}{space}{unit} instead of {before}{measured}",
                plain(label)
            )
        })
        .collect();
    (!told.is_empty()).then(|| format!("For this patient that changes: {}.", told.join(", ")))
}

#[cfg(test)]
mod tests {
    use cardiotwin_findings::{
        effect, finding, gap, kick, likely, nothing, one_of_two, unexplained,
    };

    use super::*;

    #[test]
    fn each_kind_of_answer_is_said() {
        let text = summary(&kick());
        for part in [
            "misses: atrial kick: amplitude 7.90 mmHg (6.25 to 9.50), probability 0.98",
            "volume in atrial systole, data 6.00 mL above the model (z 3.1)",
            "from 1.61 to 0.94 times the noise, and on held-out data from 1.72 to 1.10",
            "Hard to tell from it in such data, though these prefer it: passive stiffening; these measurements would decide: atrial or wedge pressure.",
            "changes: filling pressure 8.50 mmHg instead of 12.5.",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        assert!(
            !text.contains("ejection fraction"),
            "it hardly changes: {text}"
        );
        let artefact = finding(vec![effect("pressure_offset", 30.0, true)], 1);
        assert!(
            summary(&artefact)
                .contains("Correct this in the data, not in the heart: pressure offset.")
        );
        assert!(summary(&nothing()).starts_with("Nothing is missing"));
        let mut small = nothing();
        small.findings.p_value = 2e-4;
        let text = summary(&small);
        assert!(
            text.starts_with("Undecided") && text.contains("p < 0.001"),
            "{text}"
        );
        assert!(summary(&gap()).starts_with("A gap remains that no effect"));
        let text = summary(&likely());
        assert!(
            text.starts_with("Undecided") && text.contains("atrial kick (probability 0.91)"),
            "{text}"
        );
        let text = summary(&one_of_two());
        assert!(
            text.starts_with("One of these effects is missing")
                && text.contains("would decide: QRS."),
            "{text}"
        );
        let mut open = kick();
        open.findings.remaining = unexplained().findings.unexplained;
        open.findings.classes = vec![EffectClass {
            effects: vec!["atrial_kick".to_owned(), "viscoelasticity".to_owned()],
            probability: 0.99,
        }];
        let text = summary(&open);
        assert!(
            text.contains("probability 0.98 (or, as these data do not tell, viscoelasticity)")
                && text.contains("A gap remains that no effect"),
            "{text}"
        );
        let mut idle = kick();
        (
            idle.findings.gap_heldout_before,
            idle.findings.gap_heldout_after,
        ) = (Some(1.95), Some(1.95));
        let text = summary(&idle);
        assert!(
            text.contains(
                "held-out pressure and volume do not confirm it (1.95 without and 1.95 with it)"
            ),
            "{text}"
        );
        let mut filled = kick();
        filled.indices[0].name = "end_diastolic_volume_mL".to_owned();
        let text = summary(&filled);
        assert!(text.contains("instead of 12.5 (measured: 151)"), "{text}");
        filled.indices[0].name = "pressure_drop_to_aorta_mmHg".to_owned();
        filled.indices[0].after = -3.0;
        let text = summary(&filled);
        assert!(
            text.contains(
                "whose peak is 3.00 mmHg above the ventricle's, instead of a drop of 12.5"
            ),
            "{text}"
        );
        let text = summary(&unexplained());
        assert!(
            text.contains("no effect of the catalogue explains the gap")
                && text.contains("aortic flow explains most (40 %)"),
            "{text}"
        );
    }
}
