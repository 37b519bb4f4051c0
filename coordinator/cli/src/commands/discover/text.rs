//! Tables and sentences that present a search's findings.

use cardiotwin_report::results::discovery::faults;
use cardiotwin_report::results::discovery::finite_element::{change, rms_of};
use cardiotwin_report::results::discovery::pool::{accepted_in, pool};
use cardiotwin_report::results::discovery::words;
use cardiotwin_schemas::discover::{DiscoverCase, DiscoverCases, Place};

use crate::table::{Columns, number, optional};
use crate::talk::{Talk, Tone, count};

/// Number of candidates shown in the ranking.
const SHOWN: usize = 6;
/// Places with a smaller deviation than this, in standard deviations, are left out.
const Z: f64 = 1.0;

/// Text for one patient; only its name and summary if `brief`.
#[must_use]
pub fn case(case: &DiscoverCase, brief: bool, talk: &Talk) -> String {
    let found = &case.found;
    let mut text = format!("{}\n{}\n\n", case.case, case.summary);
    if brief {
        return text;
    }
    let mut ranking = Columns::new(
        talk,
        &[
            "EFFECT",
            ">PROBABILITY",
            ">DELTA BIC",
            ">EVIDENCE",
            "STRENGTH (95 %)",
            "NOTE",
        ],
    );
    for effect in found.findings.effects.iter().take(SHOWN) {
        let accepted = found.findings.accepted.contains(&effect.name);
        let unconfirmed = case.confirmed == Some(false);
        let note = match (accepted, effect.plausible) {
            (true, _) if unconfirmed && effect.artefact => {
                "accepted, not confirmed: correct the data"
            }
            (true, _) if unconfirmed => "accepted, not confirmed",
            (true, _) if effect.artefact => "accepted: correct the data",
            (true, _) => "accepted",
            (false, false) => "too weak or at the edge of its range",
            (false, true) => "",
        };
        let tone = accepted.then_some(if unconfirmed {
            Tone::Doubtful
        } else {
            Tone::Good
        });
        ranking.toned([
            (effect.name.clone(), tone),
            (words::probability(effect.probability, 3), None),
            (format!("{:.1}", effect.delta_bic), None),
            (format!("{:.1}", effect.log_evidence), None),
            (words::strength(effect), None),
            (note.to_owned(), tone),
        ]);
    }
    text.push_str(&ranking.text());
    text.push_str(&format!(
        "an effect is named if its evidence, prior odds included, exceeds {:.1}; the best generic \
         alternative has {:.1}\n\n",
        found.findings.threshold, found.findings.nameless_evidence
    ));
    text.push_str(&places(case, talk));
    text.push_str(&gaps(case, talk));
    text.push_str(&finite_element(case, talk));
    let lists = [
        (
            "indistinguishable from",
            found.findings.confusable.join(", "),
        ),
        (
            "not told apart by these data",
            (found.findings.classes.iter())
                .map(|class| class.effects.join(" or "))
                .collect::<Vec<_>>()
                .join("; "),
        ),
        (
            "deciding measurement",
            found.findings.deciding_measurement.join("; "),
        ),
        (
            "not identifiable from these data",
            found.findings.not_identifiable.join(", "),
        ),
    ];
    for (label, list) in lists.iter().filter(|(_, list)| !list.is_empty()) {
        text.push_str(&format!("{label}: {list}\n"));
    }
    for effect in found
        .findings
        .effects
        .iter()
        .filter(|effect| found.findings.accepted.contains(&effect.name))
    {
        let how = effect
            .in_3d
            .how
            .as_ref()
            .map_or(String::new(), |how| format!(": {how}"));
        let way = match effect.in_3d.way.as_str() {
            "as-it-is" => "used unchanged in 3D".to_owned(),
            way => format!("in 3D {}", way.replace('-', " ")),
        };
        text.push_str(&format!("{}: {way}{how}\n", effect.name));
    }
    text.push('\n');
    text
}

/// Table of the places where the base model and the data disagree.
fn places(case: &DiscoverCase, talk: &Talk) -> String {
    let mut table = Columns::new(
        talk,
        &[
            "WHERE",
            ">DATA - MODEL",
            "",
            ">Z",
            ">SHARE",
            ">Z AFTER",
            "MOVES",
        ],
    );
    let mut n_left_out = 0;
    for place in &case.found.findings.places {
        if place.z.abs() < Z {
            n_left_out += 1;
            continue;
        }
        let same = |p: &&Place| p.signal == place.signal && p.phase == place.phase;
        let after = case
            .found
            .findings
            .where_after
            .iter()
            .find(same)
            .map(|p| format!("{:+.1}", p.z));
        let phase = if place.phase == "beat" {
            String::new()
        } else {
            format!(", {}", words::plain(&place.phase))
        };
        table.row([
            format!("{}{phase}", words::plain(&place.signal)),
            format!("{:+.2}", place.size),
            place.unit.clone(),
            format!("{:+.1}", place.z),
            if place.share > 0.0 {
                format!("{:.0} %", 100.0 * place.share)
            } else {
                String::new()
            },
            after.unwrap_or_default(),
            place.biomarkers.join(", "),
        ]);
    }
    format!(
        "{}{} below one standard deviation omitted\n\n",
        table.text(),
        count(n_left_out, "place")
    )
}

/// Table of the gap before and after the accepted effects.
fn gaps(case: &DiscoverCase, talk: &Talk) -> String {
    let found = &case.found;
    let mut table = Columns::new(
        talk,
        &[
            "GAP",
            ">BEFORE",
            ">AFTER",
            ">HELD OUT BEFORE",
            ">HELD OUT AFTER",
        ],
    );
    let row = |name: &str, values: [Option<f64>; 4]| {
        let mut cells = vec![name.to_owned()];
        cells.extend(
            values.map(|value| value.map_or("-".to_owned(), |value| format!("{value:.2}"))),
        );
        cells
    };
    for gap in found.findings.gaps.iter().filter(|gap| gap.phase == "beat") {
        table.row(row(
            &gap.signal,
            [
                Some(gap.before),
                Some(gap.after),
                gap.heldout_before,
                gap.heldout_after,
            ],
        ));
    }
    let all = [
        Some(found.findings.gap_before),
        Some(found.findings.gap_after),
        found.findings.gap_heldout_before,
        found.findings.gap_heldout_after,
    ];
    table.row(row("all", all));
    format!(
        "{}rms residual divided by the noise's standard deviation\n\n",
        table.text()
    )
}

/// Table of the gap on the finite-element ventricle; empty if it was not simulated.
fn finite_element(case: &DiscoverCase, talk: &Talk) -> String {
    let Some(found) = &case.finite_element else {
        return String::new();
    };
    let mut table = Columns::new(talk, &["GAP IN 3D", ">BEFORE", ">AFTER"]);
    for gap in &found.gaps {
        let name = if gap.phase == "beat" {
            format!("{}, whole beat", gap.signal)
        } else {
            format!("{}, {}", gap.signal, words::plain(&gap.phase))
        };
        table.row([
            name,
            format!("{:.2}", gap.before),
            format!("{:.2}", gap.after),
        ]);
    }
    for (name, before, after) in rms_of(found) {
        table.row([
            format!("{name} rms"),
            format!("{before:.1}"),
            format!("{after:.1}"),
        ]);
    }
    format!(
        "{}the patient's finite-element ventricle of {} nodes, personalised without and with \
         the accepted effects; rms residual divided by the noise's standard deviation\n\n",
        table.text(),
        found.nodes
    )
}

/// Table of the whole beat's misfit on the finite-element ventricles; empty if none was simulated.
fn finite_elements(cases: &DiscoverCases, talk: &Talk) -> String {
    let mut table = Columns::new(
        talk,
        &[
            "PATIENT",
            "EFFECTS",
            "TRACE IN 3D",
            ">BEFORE",
            ">AFTER",
            ">CHANGE",
        ],
    );
    let mut any = false;
    for case in cases.values() {
        for (name, before, after) in case.finite_element.iter().flat_map(rms_of) {
            any = true;
            table.row([
                case.case.clone(),
                words::missing(&case.found, str::to_owned),
                name.to_owned(),
                format!("{before:.1}"),
                format!("{after:.1}"),
                change(before, after),
            ]);
        }
    }
    if !any {
        return String::new();
    }
    format!(
        "{}rms over the whole beat of the finite-element ventricle, personalised without and \
         with the effects\n\n",
        table.text()
    )
}

/// Text for the cohort: missing effects of each patient, and the evidence pooled over all patients.
#[must_use]
pub fn cohort(cases: &DiscoverCases, talk: &Talk) -> String {
    let mut table = Columns::new(
        talk,
        &[
            "PATIENT",
            "MISSING",
            ">PROBABILITY",
            ">GAP",
            ">AFTER",
            ">HELD OUT",
            ">AFTER",
            "INDISTINGUISHABLE FROM",
        ],
    );
    for case in cases.values() {
        let found = &case.found;
        let missing = words::missing(found, str::to_owned);
        let first = found
            .findings
            .effects
            .first()
            .filter(|_| !found.findings.none)
            .map(|effect| words::probability(effect.probability, 2));
        table.row([
            case.case.clone(),
            missing,
            first.unwrap_or_default(),
            format!("{:.2}", found.findings.gap_before),
            format!("{:.2}", found.findings.gap_after),
            optional(found.findings.gap_heldout_before),
            optional(found.findings.gap_heldout_after),
            found.findings.confusable.join(", "),
        ]);
    }
    let mut text = table.text();
    let mut table = Columns::new(
        talk,
        &[
            "EFFECT",
            ">ACCEPTED IN",
            ">POOLED EVIDENCE",
            "ATTRIBUTED TO",
            "DOMINATED BY",
        ],
    );
    for pooled in pool(cases.values().map(|c| (c.case.as_str(), &c.found))) {
        let fault = match (pooled.of_the_model, pooled.accepted_in) {
            (true, _) => "the organ's model",
            (false, 0) => "",
            (false, _) => "single patients",
        };
        let accepted = accepted_in(&pooled, cases.len());
        table.row([
            pooled.name.clone(),
            accepted,
            number(pooled.log_evidence),
            fault.to_owned(),
            pooled.dominated_by.unwrap_or_default(),
        ]);
    }
    text.push('\n');
    text.push_str(&table.text());
    text.push('\n');
    text.push_str(&run_misses(cases, talk));
    text.push_str(&finite_elements(cases, talk));
    text.push_str(&filling(cases, talk));
    text
}

/// Table of the misses of the cohort's run, and whether the organ's model or the cell causes them;
/// empty if the run personalised no patient.
fn run_misses(cases: &DiscoverCases, talk: &Talk) -> String {
    let headings = [
        "PATIENT",
        "TRACE",
        ">STEP 1",
        ">VERIFICATION",
        ">TWIN",
        ">ORGAN'S MODEL",
        ">CELL",
        "MOSTLY ATTRIBUTED TO",
    ];
    let mut table = Columns::new(talk, &headings);
    let personalised = cases
        .values()
        .filter_map(|case| Some((case, case.run.as_ref()?)));
    let mut any = false;
    for (case, run) in personalised {
        for (name, unit, misses) in faults::traces(run) {
            any = true;
            let values = [
                misses.step1,
                misses.verification,
                misses.twin,
                misses.of_organ(),
                misses.of_cell(),
            ]
            .map(|rms| format!("{rms:.1}"));
            let mut row = vec![case.case.clone(), format!("{name}, {unit}")];
            row.extend(values);
            row.push(faults::whose(&misses).to_owned());
            table.row(row);
        }
    }
    if !any {
        return String::new();
    }
    format!(
        "{}rms over the beat of the cohort's run; the organ's model: smallest misfit with any \
         active stress or cell; the cell: additional misfit of step 2's cell\n\n",
        table.text()
    )
}

/// Table of end-diastolic volumes at the filling pressure of the patient's file; empty if no file
/// states one.
fn filling(cases: &DiscoverCases, talk: &Talk) -> String {
    let headings = [
        "PATIENT",
        ">EDV mL",
        ">ERROR BEFORE",
        ">AFTER",
        ">LATE FILLING RMS BEFORE",
        ">AFTER",
    ];
    let mut table = Columns::new(talk, &headings);
    let stated = cases
        .values()
        .filter_map(|case| Some((case, case.found.stated_filling.as_ref()?)));
    let mut n_stated = 0;
    for (case, filling) in stated {
        n_stated += 1;
        let one = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
        let error = |volume: Option<f64>| one(volume.map(|volume| volume - filling.measured_ml));
        table.row([
            case.case.clone(),
            one(Some(filling.measured_ml)),
            error(filling.before_ml),
            error(filling.after_ml),
            one(filling.late_filling_before_ml),
            one(filling.late_filling_after_ml),
        ]);
    }
    if n_stated == 0 {
        return String::new();
    }
    format!(
        "{}mL, in a periodic beat with the filling pressure of the patient's file and all other \
         parameters as fitted\n\n",
        table.text()
    )
}

#[cfg(test)]
mod tests {
    use cardiotwin_findings::{finite_element, kick, nothing, unexplained};
    use cardiotwin_sweep::discovery;

    use super::*;

    #[test]
    fn a_patient_and_a_cohort_as_people_see_them() {
        let talk = Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        let all = [
            ("P1", kick()),
            ("P2", kick()),
            ("P3", nothing()),
            ("P4", unexplained()),
        ];
        let mut cases: DiscoverCases = all
            .iter()
            .map(|(id, found)| ((*id).to_owned(), discovery::case(id, "task", found)))
            .collect();
        let p1 = cases.get_mut("P1").unwrap();
        p1.finite_element = Some(finite_element(&p1.found));
        insta::assert_snapshot!(format!(
            "{}{}",
            case(&cases["P1"], false, &talk),
            cohort(&cases, &talk)
        ));
        assert_eq!(case(&cases["P3"], true, &talk).lines().count(), 3);
    }

    #[test]
    fn an_effect_that_held_out_data_do_not_confirm_is_never_only_accepted() {
        let talk = Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        let mut idle = kick();
        idle.findings.gap_heldout_after = idle.findings.gap_heldout_before;
        let mut cases: DiscoverCases = [("P1", idle), ("P2", kick())]
            .map(|(id, found)| (id.to_owned(), discovery::case(id, "task", &found)))
            .into();
        let p1 = cases.get_mut("P1").unwrap();
        p1.finite_element = Some(finite_element(&p1.found));
        let one = case(&cases["P1"], false, &talk);
        assert!(one.contains("accepted, not confirmed\n"), "{one}");
        assert!(
            one.contains("do not confirm it (1.72 without and 1.72 with it)"),
            "{one}"
        );
        let all = cohort(&cases, &talk);
        assert_eq!(
            all.matches("atrial_kick (not confirmed on held-out data)")
                .count(),
            3,
            "{all}"
        );
        assert!(all.contains("2 of 2, 1 not confirmed"), "{all}");
        let json: serde_json::Value = serde_json::from_str(&discovery::cases_text(&cases)).unwrap();
        assert_eq!(
            [&json["P1"]["confirmed"], &json["P2"]["confirmed"]],
            [false, true]
        );
    }
}
