//! Tables and sentences that present a search's findings.

use cardiotwin_report::results::tables::discovery::{self, WHOLE_BEAT};
use cardiotwin_report::results::tables::discovery_cohort;
use cardiotwin_report::table::Cell;
use cardiotwin_schemas::discover::{DiscoverCase, DiscoverCases};
use serde_json::Value;

use crate::table;
use crate::talk::{Talk, count};

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
    let ranking = discovery::ranking(case, SHOWN).without(|column| column.key == "in_3d");
    text.push_str(&table::text(&ranking, talk));
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
            "hard to tell from, though preferred",
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
    let mut places = discovery::places(case);
    let all = places.rows.len();
    let z = places.place("z").unwrap_or_default();
    let is_large = |row: &Vec<Cell>| row[z].value.as_f64().is_some_and(|z| z.abs() >= Z);
    places.rows.retain(is_large);
    format!(
        "{}{} below one standard deviation omitted\n\n",
        table::text(&places, talk),
        count(all - places.rows.len(), "place")
    )
}

/// Table of the whole beat's gap before and after the accepted effects.
fn gaps(case: &DiscoverCase, talk: &Talk) -> String {
    let mut gaps = discovery::gaps(case);
    gaps.rows.retain_mut(|row| {
        let name = row[0].value.as_str().unwrap_or_default();
        let signal = name.strip_suffix(WHOLE_BEAT).map(Value::from);
        signal.map(|signal| row[0].value = signal).is_some()
    });
    format!(
        "{}rms residual divided by the noise's standard deviation\n\n",
        table::text(&gaps, talk)
    )
}

/// Table of the gap on the finite-element ventricle; empty if it was not simulated.
fn finite_element(case: &DiscoverCase, talk: &Talk) -> String {
    let Some(found) = &case.finite_element else {
        return String::new();
    };
    format!(
        "{}the patient's finite-element ventricle of {} nodes, personalised without and with \
         the accepted effects; rms residual divided by the noise's standard deviation\n\n",
        table::text(&discovery::finite_element(found), talk),
        found.nodes
    )
}

/// Text for the cohort: missing effects of each patient, and the evidence pooled over all patients.
#[must_use]
pub fn cohort(cases: &DiscoverCases, talk: &Talk) -> String {
    let all = [
        (discovery_cohort::patients(cases), ""),
        (
            discovery_cohort::pooled(cases),
            "each patient counts by 10 at most, for or against an effect\n",
        ),
        (
            discovery_cohort::run_misses(cases),
            "rms over the beat of the cohort's run; the organ's model: smallest misfit with any \
             active stress or cell; the cell: additional misfit of step 2's cell\n",
        ),
        (
            discovery_cohort::finite_elements(cases),
            "rms over the whole beat of the finite-element ventricle, personalised without and \
             with the effects\n",
        ),
        (
            discovery_cohort::filling(cases),
            "mL, in a periodic beat with the filling pressure of the patient's file and all other \
             parameters as fitted\n",
        ),
    ];
    let shown = (all.iter()).filter(|(table, note)| note.is_empty() || !table.rows.is_empty());
    shown
        .map(|(table, note)| format!("{}{note}\n", table::text(table, talk)))
        .collect()
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
        assert!(one.contains("named, not confirmed\n"), "{one}");
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
