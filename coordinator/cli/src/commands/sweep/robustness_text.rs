//! Tables 3 to 10 of the paper for a terminal.

use cardiotwin_report::results::tables::robustness;
use cardiotwin_schemas::robustness::{Condition, PatientRobustness, RobustnessResult, Uncertainty};

use crate::table;
use crate::talk::{Talk, count, paint};

/// Text for all patients: tables, spread by seed, errors to targets, failures, conditions.
#[must_use]
pub fn tables(result: &RobustnessResult, talk: &Talk) -> String {
    let patients = result.patients.iter().map(|p| patient(p, result, talk));
    patients.collect::<Vec<_>>().join("\n")
}

fn patient(patient: &PatientRobustness, result: &RobustnessResult, talk: &Talk) -> String {
    let over = result.spec.over;
    let n = count(result.spec.n_samples as usize, "sample");
    let spreads = |quantities| table::text(&robustness::spreads("", quantities, true), talk);
    let range = (1e4 * result.spec.range).round() / 100.0;
    let mut text = format!("{}  {} ±{range} %, {n}\n", patient.patient, over.word());
    if patient.tables.is_empty() {
        text += "no tables until the original and a sample have a result\n";
    }
    for table in &patient.tables {
        text += &format!("\n{} (Table {})\n", table.table.word(), table.paper_table);
        text += &spreads(&table.quantities);
    }
    for table in &patient.seed_tables {
        text += &format!("\n{}, with only step 2's seed varied\n", table.table.word());
        text += &spreads(&table.quantities);
    }
    if over == Uncertainty::Data && !patient.target_errors.is_empty() {
        text += "\nerrors of fitted biomarkers, mean (max) %\n";
        text += &table::text(&robustness::errors(patient), talk);
    }
    for member in patient.members.iter().filter(|m| m.failure.is_some()) {
        text += &format!(
            "\n{} failed: {}\n",
            member.id,
            member.failure.as_deref().unwrap_or_default()
        );
    }
    text += "\n";
    text += &conditions(&patient.conditions, talk);
    text
}

/// One line for each condition instead of a table, because its result and its limit may be long.
fn conditions(conditions: &[Condition], talk: &Talk) -> String {
    let line = |c: &Condition| {
        let (word, tone) = robustness::met(c);
        format!(
            "{}  {}: {}, limit {}\n",
            paint(talk.colour_out, tone, &format!("{word:6}")),
            c.name,
            c.found,
            c.limit
        )
    };
    conditions.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::ids::PatientId;
    use cardiotwin_schemas::robustness::{
        Amplification, Moments, PaperSpread, Printed, QuantitySpread, RobustnessSpec,
        RobustnessTable, TableKind, TargetError,
    };

    use super::*;

    fn moments(mean: f64, standard_deviation: Option<f64>, minimum: f64, maximum: f64) -> Moments {
        Moments {
            mean,
            standard_deviation,
            minimum,
            maximum,
        }
    }

    fn quantity(name: &str, printed: bool) -> QuantitySpread {
        let printed = printed.then_some(PaperSpread {
            original: Printed::Value(103.2),
            mean: Printed::Value(103.4),
            sd: Printed::Value(9.4),
            min: Printed::Value(88.9),
            max: Printed::Value(118.8),
            mean_of_rel_diff_percent: Printed::Value(7.8),
            sd_of_rel_diff_percent: Printed::Below { below: 0.1 },
            min_of_rel_diff_percent: Printed::Value(0.9),
            max_of_rel_diff_percent: Printed::Value(15.1),
        });
        QuantitySpread {
            name: name.into(),
            original: 104.05,
            n: 10,
            n_missing: 0,
            values: moments(103.0, Some(6.4), 95.1, 113.2),
            relative_differences: Some(moments(0.0512, Some(0.031), 0.001, 0.0881)),
            spread: Some(0.0615),
            amplification: printed.is_some().then(|| Amplification {
                input: "P_max_mmHg".into(),
                input_spread: 0.06,
                ratio: 1.025,
            }),
            paper: printed,
        }
    }

    #[test]
    fn tables_say_what_was_found_beside_what_is_printed() {
        let table = |table, quantities| RobustnessTable {
            table,
            paper_table: 3,
            quantities,
        };
        let error = TargetError {
            table: TableKind::Step1Biomarkers,
            biomarker: "P_max_mmHg".into(),
            original: 0.012,
            to_perturbed: moments(0.015, Some(0.01), 0.001, 0.03),
            to_measured: moments(0.05, Some(0.02), 0.01, 0.1),
            beyond: vec![PatientId::from("02-CoA.d03")],
        };
        let condition = |name: &str, passed| Condition {
            name: name.into(),
            passed,
            found: "1.5 % against 1.2 %".into(),
            limit: "2 points".into(),
        };
        let patient = PatientRobustness {
            patient: PatientId::from("02-CoA"),
            members: Vec::new(),
            inputs: Vec::new(),
            tables: vec![table(
                TableKind::Step1Parameters,
                vec![quantity("Smax_ref_kPa", true), quantity("a_p_kPa", false)],
            )],
            seed_tables: vec![table(
                TableKind::Step2Parameters,
                vec![quantity("n_Tm", false)],
            )],
            target_errors: vec![error],
            conditions: vec![
                condition("a", Some(true)),
                condition("b", Some(false)),
                condition("c", None),
            ],
        };
        let result = RobustnessResult {
            schema_version: cardiotwin_schemas::formats::ROBUSTNESS.version,
            version: "test".into(),
            cohort: "coa".into(),
            spec: RobustnessSpec {
                over: Uncertainty::Data,
                patients: vec![PatientId::from("02-CoA")],
                n_samples: 10,
                n_seeds: 1,
                range: 0.1,
                seed: 1,
            },
            patients: vec![patient],
        };
        let talk = Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        insta::assert_snapshot!(tables(&result, &talk));
    }
}
