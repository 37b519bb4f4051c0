//! `cardiotwin discover --afterload`: effects that a three-element Windkessel misses in a measured
//! flow and pressure.

use std::path::{Path, PathBuf};

use cardiotwin_calibrate::afterload::{
    Candidate, Discovery, DiscoverySettings, EFFECTS, Kind, discover,
};
use cardiotwin_report::html::afterload_discovery_svg;
use cardiotwin_report::results::atomic;
use cardiotwin_report::results::discovery::words::probability;
use cardiotwin_schemas::afterload::{
    AfterloadCandidate, AfterloadConfusable, AfterloadDiscovery, AfterloadEffect, AfterloadInOrgan,
};
use cardiotwin_schemas::organ::EffectSpec;

use crate::commands::fit::afterload_answer::parameters;
use crate::commands::fit::record::{self, Measured};
use crate::commands::fit::trace::Accepted;
use crate::error::CliError;
use crate::exit::Exit;
use crate::table::{Columns, number};
use crate::talk::{Talk, Tone};

/// Number of candidates shown in the ranking.
const SHOWN: usize = 6;
/// Effect by which the organ model represents waves and inertance.
const LUMPED: &str = "wave_reflection";
/// Effect whose lumped form is [`LUMPED`].
const HAS_LUMPED_FORM: &str = "tube_reflection";

/// Arguments of `discover --afterload`.
pub struct Request<'a> {
    /// CSV file of the flow.
    pub flow: &'a Path,
    /// CSV file of the pressure.
    pub pressure: &'a Path,
    /// Names of the candidates to try; empty means all.
    pub effects: &'a [String],
    /// Names of accepted rules of consistency.
    pub accepted: &'a [String],
    /// File for the JSON answer, or `-` for stdout.
    pub json: Option<&'a PathBuf>,
    /// SVG file for the plot.
    pub plot: Option<&'a PathBuf>,
}

/// Searches the record for missing effects and prints the answer.
///
/// # Errors
/// [`CliError::Trace`] if the record cannot be used, [`CliError::Usage`] if a named candidate is
/// unknown or the record cannot be fitted, and an error if a file cannot be written.
pub fn execute(request: &Request<'_>, talk: &Talk) -> Result<Exit, CliError> {
    if let Some(unknown) = request
        .effects
        .iter()
        .find(|name| EFFECTS.iter().all(|effect| effect.name != **name))
    {
        let known: Vec<&str> = EFFECTS.iter().map(|effect| effect.name).collect();
        let known = known.join(", ");
        return Err(CliError::Usage(format!(
            "`{unknown}` is not a candidate effect of the afterload; expected one of {known}"
        )));
    }
    let accepted = Accepted {
        rules: request.accepted,
        option: "--accept-rule",
    };
    let measured = record::read(request.flow, request.pressure, accepted, talk)?;
    let settings = DiscoverySettings {
        effects: request.effects.to_vec(),
        ..DiscoverySettings::default()
    };
    let found = discover(&measured.record, &settings)
        .map_err(|error| CliError::Usage(format!("the record cannot be fitted: {error}")))?;
    let answer = answer(&measured, &found);
    let [before, after] = [&answer.before, &answer.after];
    let load = if answer.none { before } else { after };
    let against = measured.against(
        load.characteristic_resistance_mmhg_s_per_ml,
        load.peripheral_resistance_mmhg_s_per_ml,
    );
    for doubt in measured.doubts.iter().chain(&against) {
        talk.say(&format!("warning: {doubt}"));
    }
    if let Some(file) = request.plot {
        let line = |pressure: &[f64]| -> Vec<(f64, f64)> {
            std::iter::zip(&measured.pressure, pressure)
                .map(|(sample, p)| (sample.0, *p))
                .collect()
        };
        let (before, after) = (
            line(&found.pressure_before_mmhg),
            line(&found.pressure_after_mmhg),
        );
        let svg = afterload_discovery_svg(&answer, &measured.pressure, &before, &after)
            .unwrap_or_default();
        atomic::write(file, |out| out.write_all(svg.as_bytes()))
            .map_err(CliError::file("write", file))?;
    }
    match request.json {
        Some(file) if file.as_os_str() == "-" => talk.json(&answer)?,
        Some(file) => {
            let json = serde_json::to_string_pretty(&answer).unwrap_or_default() + "\n";
            atomic::write(file, |out| out.write_all(json.as_bytes()))
                .map_err(CliError::file("write", file))?;
            talk.data(&text(&answer, &settings, talk))?;
        }
        None => talk.data(&text(&answer, &settings, talk))?,
    }
    Ok(Exit::Ok)
}

/// Parameters of an effect by name: values, and intervals for those that have one.
type Strength = (
    std::collections::BTreeMap<String, f64>,
    std::collections::BTreeMap<String, [f64; 2]>,
);

fn strength(of: &[(&'static str, f64, Option<[f64; 2]>)]) -> Strength {
    let values = of
        .iter()
        .map(|(name, value, _)| ((*name).to_owned(), *value))
        .collect();
    let intervals = of
        .iter()
        .filter_map(|(name, _, interval)| Some(((*name).to_owned(), (*interval)?)))
        .collect();
    (values, intervals)
}

fn answer(measured: &Measured, found: &Discovery) -> AfterloadDiscovery {
    let pulse = measured.described.pulse_pressure_mmhg;
    let first = &found.stages[0];
    let mut deciding: Vec<String> = found
        .confusable
        .iter()
        .map(|c| c.separated_by.to_owned())
        .collect();
    deciding.sort();
    deciding.dedup();
    AfterloadDiscovery {
        schema_version: cardiotwin_schemas::formats::AFTERLOAD_DISCOVERY.version,
        case: measured.described.flow.clone(),
        record: measured.described.clone(),
        none: found.accepted.is_empty(),
        effects: first
            .candidates
            .iter()
            .map(|c| candidate(c, pulse))
            .collect(),
        accepted: found
            .accepted
            .iter()
            .map(|f| f.effect.name.to_owned())
            .collect(),
        added: found
            .accepted
            .iter()
            .map(|f| {
                let (strength, interval) = strength(&f.strength);
                AfterloadEffect {
                    name: f.effect.name.to_owned(),
                    delta_bic: f.delta_bic,
                    strength,
                    interval,
                }
            })
            .collect(),
        none_probability: first.none_probability,
        nameless_probability: first.nameless_probability,
        confusable: found
            .confusable
            .iter()
            .map(|c| AfterloadConfusable {
                effect: c.accepted.to_owned(),
                rival: c.other.to_owned(),
                expected_delta_bic: c.delta_bic,
            })
            .collect(),
        deciding_measurement: deciding,
        not_identifiable: found
            .not_identifiable
            .iter()
            .map(|(n, why)| ((*n).to_owned(), why.clone()))
            .collect(),
        unexplained: found.unexplained.clone(),
        gap_before: found.gap.before_mmhg / pulse,
        gap_after: found.gap.after_mmhg / pulse,
        gap_heldout_before: found.gap.held_out_before_mmhg / pulse,
        gap_heldout_after: found.gap.held_out_after_mmhg / pulse,
        held_out: if found.gap.by_beat { "beats" } else { "blocks" }.to_owned(),
        before: parameters(found.before),
        after: parameters(found.after),
        noise: found.sample_size,
        organ: in_organ(found),
    }
}

fn candidate(c: &Candidate, pulse: f64) -> AfterloadCandidate {
    let (strength, interval) = strength(&c.strength);
    AfterloadCandidate {
        name: c.effect.name.to_owned(),
        meaning: c.effect.meaning.to_owned(),
        artefact: match c.effect.kind {
            Kind::Physiology => Some(false),
            Kind::Artefact => Some(true),
            Kind::Either => None,
        },
        probability: c.probability,
        delta_bic: c.delta_bic,
        gap: c.root_mean_square_mmhg / pulse,
        strength,
        interval,
        afterload: parameters(c.three),
        refused: c.refused.clone(),
    }
}

/// Load and effects as the organ model takes them. Its catalogue has only the lumped reflection.
fn in_organ(found: &Discovery) -> AfterloadInOrgan {
    let names: Vec<&str> = found.accepted.iter().map(|f| f.effect.name).collect();
    let artefact = found
        .accepted
        .iter()
        .any(|f| f.effect.kind == Kind::Artefact);
    let spec = |values: &[(&'static str, f64, Option<[f64; 2]>)]| EffectSpec {
        name: LUMPED.to_owned(),
        parameters: strength(values).0,
    };
    if let Some(own) = found.accepted.iter().find(|f| f.effect.name == LUMPED) {
        let how = "wave_reflection unchanged, with the final three elements".to_owned();
        return AfterloadInOrgan {
            afterload: parameters(found.after),
            effects: vec![spec(&own.strength)],
            how,
        };
    }
    let lumped = found.stages[0]
        .candidates
        .iter()
        .find(|c| c.effect.name == LUMPED);
    if let (true, Some(lumped)) = (names.contains(&HAS_LUMPED_FORM), lumped) {
        let how = format!(
            "the organ has no tube, so its lumped form is used: wave_reflection as fitted to this \
             record (misfit {} mmHg)",
            number(lumped.root_mean_square_mmhg)
        );
        return AfterloadInOrgan {
            afterload: parameters(lumped.three),
            effects: vec![spec(&lumped.strength)],
            how,
        };
    }
    let how = match (names.is_empty(), artefact) {
        (true, _) => "three elements".to_owned(),
        (false, true) => "the final three elements; correct the data".to_owned(),
        (false, false) => format!(
            "the final three elements; the organ has no {}",
            names.join(" or ")
        ),
    };
    AfterloadInOrgan {
        afterload: parameters(found.after),
        effects: Vec::new(),
        how,
    }
}

fn summary(answer: &AfterloadDiscovery) -> String {
    let shrink = |before: f64, after: f64| {
        format!(
            "from {:.1} to {:.1} % of the pulse pressure",
            100.0 * before,
            100.0 * after
        )
    };
    let named = if answer.none {
        match &answer.unexplained {
            Some(gap) => {
                let mut leads: Vec<_> = gap.depends_on.iter().collect();
                leads.sort_by(|a, b| b.1.total_cmp(a.1));
                let lead = leads.first().map_or(String::new(), |(on, share)| {
                    format!("; {on} explains most of it ({:.0} %)", 100.0 * **share)
                });
                format!(
                    "unexplained: every beat has a gap of {} mmHg that no candidate explains, \
                     largest {} ms after the flow's upstroke{lead}",
                    number(gap.size_mmhg),
                    number(gap.largest_at_ms)
                )
            }
            // What is probable but was refused must not be called needless.
            None => match refused(answer) {
                Some(effect) => format!(
                    "undecided: {} has probability {}, that nothing is missing {}; it was not \
                     accepted{}",
                    effect.name,
                    probability(effect.probability, 3),
                    probability(answer.none_probability, 3),
                    effect
                        .refused
                        .as_deref()
                        .map_or(String::new(), |why| format!(" ({why})"))
                ),
                None if answer.nameless_probability > answer.none_probability => format!(
                    "undecided: a gap without a name has probability {}, that nothing is missing {}",
                    probability(answer.nameless_probability, 3),
                    probability(answer.none_probability, 3)
                ),
                None => "none: no effect is needed besides the three elements".to_owned(),
            },
        }
    } else {
        format!("found: {}", answer.accepted.join(" and "))
    };
    let held = if answer.held_out == "beats" {
        "held-out beats"
    } else {
        "held-out parts of the record"
    };
    if answer.none {
        let (all, out) = (100.0 * answer.gap_before, 100.0 * answer.gap_heldout_before);
        return format!(
            "{named}\nthe gap is {all:.1} % of the pulse pressure, {out:.1} % on {held}\n"
        );
    }
    format!(
        "{named}\nthe gap falls {}; {} on {held}\n",
        shrink(answer.gap_before, answer.gap_after),
        shrink(answer.gap_heldout_before, answer.gap_heldout_after)
    )
}

/// The most probable effect if it is likelier than that nothing is missing.
fn refused(answer: &AfterloadDiscovery) -> Option<&AfterloadCandidate> {
    answer
        .effects
        .iter()
        .max_by(|a, b| a.probability.total_cmp(&b.probability))
        .filter(|effect| effect.probability > answer.none_probability)
}

fn strengths(
    values: &std::collections::BTreeMap<String, f64>,
    intervals: &std::collections::BTreeMap<String, [f64; 2]>,
) -> String {
    let shown: Vec<String> = values
        .iter()
        .map(|(name, value)| match intervals.get(name) {
            Some([low, high]) => format!(
                "{name} {} ({} to {})",
                number(*value),
                number(*low),
                number(*high)
            ),
            None => format!("{name} {}", number(*value)),
        })
        .collect();
    shown.join(", ")
}

fn text(answer: &AfterloadDiscovery, settings: &DiscoverySettings, talk: &Talk) -> String {
    let mut text = summary(answer);
    text.push('\n');
    let mut ranking = Columns::new(
        talk,
        &[
            "EFFECT",
            ">PROBABILITY",
            ">DELTA BIC",
            ">GAP",
            "STRENGTH (95 %)",
            "NOTE",
        ],
    );
    for effect in answer.effects.iter().take(SHOWN) {
        let accepted = answer.accepted.contains(&effect.name);
        let note = match (accepted, effect.artefact) {
            (true, Some(true)) => "named: correct the data",
            (true, _) => "named",
            (false, _) => effect.refused.as_deref().unwrap_or(""),
        };
        let tone = accepted.then_some(Tone::Good);
        ranking.toned([
            (effect.name.clone(), tone),
            (probability(effect.probability, 3), None),
            (format!("{:.1}", effect.delta_bic), None),
            (format!("{:.1} %", 100.0 * effect.gap), None),
            (strengths(&effect.strength, &effect.interval), None),
            (note.to_owned(), tone),
        ]);
    }
    text.push_str(&ranking.text());
    text.push_str(&format!(
        "an effect is named if BIC falls by more than {:.0}; probability that nothing is missing \
         {}, of an unnamed shape {}; {} samples worth {}\n\n",
        settings.threshold,
        probability(answer.none_probability, 3),
        probability(answer.nameless_probability, 3),
        answer.record.n_samples,
        number(answer.noise.n_effective)
    ));
    let mut loads = Columns::new(
        talk,
        &[
            "LOAD",
            ">R1 (mmHg s/mL)",
            ">R2 (mmHg s/mL)",
            ">C (mL/mmHg)",
            ">GAP",
            ">HELD OUT",
        ],
    );
    let rows = [
        (
            "three elements",
            &answer.before,
            answer.gap_before,
            answer.gap_heldout_before,
        ),
        (
            "with found effects",
            &answer.after,
            answer.gap_after,
            answer.gap_heldout_after,
        ),
    ];
    for (name, load, gap, held_out) in rows.into_iter().take(if answer.none { 1 } else { 2 }) {
        loads.row([
            name.to_owned(),
            number(load.characteristic_resistance_mmhg_s_per_ml),
            number(load.peripheral_resistance_mmhg_s_per_ml),
            number(load.compliance_ml_per_mmhg),
            format!("{:.1} %", 100.0 * gap),
            format!("{:.1} %", 100.0 * held_out),
        ]);
    }
    text.push_str(&loads.text());
    for effect in &answer.added {
        let strength = strengths(&effect.strength, &effect.interval);
        text.push_str(&format!(
            "{}: {strength}; delta BIC {:.1}\n",
            effect.name, effect.delta_bic
        ));
    }
    text.push_str(&format!("in the organ: {}\n", answer.organ.how));
    let rivals: Vec<&str> = answer.confusable.iter().map(|c| c.rival.as_str()).collect();
    let hidden: Vec<&str> = answer.not_identifiable.keys().map(String::as_str).collect();
    for (label, list) in [
        ("hard to tell from, though preferred", rivals.join(", ")),
        (
            "deciding measurement",
            answer.deciding_measurement.join("; "),
        ),
        ("not identifiable from this record", hidden.join(", ")),
    ] {
        if !list.is_empty() {
            text.push_str(&format!("{label}: {list}\n"));
        }
    }
    if let (false, Some(gap)) = (answer.none, &answer.unexplained) {
        text.push_str(&format!(
            "still unexplained: {} mmHg in every beat\n",
            number(gap.size_mmhg)
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uses the one-beat record. Records of several beats take longer; docs/afterload.md shows
    /// them.
    #[test]
    fn the_human_record_as_people_see_it() {
        let talk = Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        let folder = Path::new(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/afterload/human-1999"
        ));
        let measured = record::read(
            &folder.join("flow.csv"),
            &folder.join("pressure.csv"),
            Accepted {
                rules: &[],
                option: "--accept-rule",
            },
            &talk,
        )
        .unwrap();
        let settings = DiscoverySettings::default();
        let answer = answer(&measured, &discover(&measured.record, &settings).unwrap());
        assert_eq!(answer.accepted, ["tube_reflection"]);
        // Nothing accepted, and something probable: never "no effect is needed".
        let mut open = answer.clone();
        (open.none, open.unexplained) = (true, None);
        open.accepted.clear();
        assert!(summary(&open).starts_with("undecided: tube_reflection has probability"));
        // Also where the likeliest effect has less than one half.
        for effect in &mut open.effects {
            effect.probability = if effect.name == "tube_reflection" {
                0.3
            } else {
                0.0
            };
        }
        (open.none_probability, open.nameless_probability) = (0.2, 0.1);
        assert!(summary(&open).starts_with(
            "undecided: tube_reflection has probability 0.300, that nothing is missing 0.200"
        ));
        open.effects
            .iter_mut()
            .for_each(|effect| effect.probability = 0.01);
        assert!(summary(&open).starts_with("none: no effect is needed"));
        open.nameless_probability = 0.4;
        assert!(
            summary(&open).starts_with("undecided: a gap without a name has probability 0.400")
        );
        assert!(answer.gap_heldout_after < 0.6 * answer.gap_heldout_before);
        insta::assert_snapshot!(text(&answer, &settings, &talk));
    }
}
