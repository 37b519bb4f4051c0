//! `cardiotwin compare`: comparison of two runs, patient by patient.

use cardiotwin_schemas::biomarkers::Biomarker;
use std::path::PathBuf;

use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::step1::Step1Parameter;
use clap::Args;
use serde::Serialize;

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::Folders;
use crate::cli::store::open;
use crate::cli::table::{Columns, optional, percent};
use crate::cli::talk::{Talk, count};
use crate::results::{PatientView, Step};

/// Compare two runs: costs, biomarkers and parameters of each patient
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Folder of a run, or of a cohort with a run
    #[arg(value_name = "RUN")]
    before: PathBuf,
    /// Folder of the other run or cohort
    #[arg(value_name = "RUN")]
    after: PathBuf,
    /// Show equal values, too
    #[arg(long)]
    all: bool,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// One quantity of one patient in both runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    patient: String,
    quantity: String,
    before: Option<f64>,
    after: Option<f64>,
    /// (after − before) / |before|; `None` if either value is missing or the quotient is not
    /// finite.
    relative_difference: Option<f64>,
}

/// Comparison of two runs.
#[derive(Serialize)]
pub(super) struct Comparison {
    schema_version: u32,
    before: PathBuf,
    after: PathBuf,
    only_before: Vec<String>,
    only_after: Vec<String>,
    quantities: Vec<Row>,
}

/// Compares the runs. Differences do not change the exit code.
///
/// # Errors
/// Errors of the two stores.
pub async fn execute(args: &CompareArgs, talk: &Talk) -> Result<Exit, CliError> {
    let before = open(&Folders::of(&args.before, None))
        .await?
        .record()
        .await?;
    let after = open(&Folders::of(&args.after, None))
        .await?
        .record()
        .await?;
    let comparison = compare(&before, &after);
    if args.json {
        talk.json(&comparison)?;
        return Ok(Exit::Ok);
    }
    let n_same = comparison
        .quantities
        .iter()
        .filter(|row| row.before == row.after)
        .count();
    let mut table = Columns::new(
        talk,
        &["PATIENT", "QUANTITY", ">BEFORE", ">AFTER", ">DIFFERENCE"],
    );
    for row in comparison
        .quantities
        .iter()
        .filter(|row| args.all || row.before != row.after)
    {
        let difference = percent(row.relative_difference);
        table.row([
            row.patient.clone(),
            row.quantity.clone(),
            optional(row.before),
            optional(row.after),
            difference,
        ]);
    }
    if n_same < comparison.quantities.len() || args.all {
        talk.data(&table.text())?;
    }
    for (run, patients) in [
        (&args.before, &comparison.only_before),
        (&args.after, &comparison.only_after),
    ] {
        if !patients.is_empty() {
            talk.data(&format!(
                "only in {}: {}\n",
                run.display(),
                patients.join(", ")
            ))?;
        }
    }
    let n_differ = comparison.quantities.len() - n_same;
    talk.data(&format!(
        "{} differ, {n_same} are the same\n",
        count(n_differ, "quantity").replace("quantitys", "quantities")
    ))?;
    Ok(Exit::Ok)
}

/// Compares two runs, patient by patient.
pub(super) fn compare(before: &RunRecord, after: &RunRecord) -> Comparison {
    let missing_in = |from: &RunRecord, other: &RunRecord| -> Vec<String> {
        let there =
            |patient: &PatientRecord| other.patients.iter().any(|o| o.plan.id == patient.plan.id);
        from.patients
            .iter()
            .filter(|patient| !there(patient))
            .map(|patient| patient.plan.id.to_string())
            .collect()
    };
    let pairs = before.patients.iter().filter_map(|a| {
        let b = after.patients.iter().find(|b| b.plan.id == a.plan.id)?;
        Some((a, b))
    });
    Comparison {
        schema_version: cardiotwin_schemas::formats::COMPARISON.version,
        before: before.run_directory.clone(),
        after: after.run_directory.clone(),
        only_before: missing_in(before, after),
        only_after: missing_in(after, before),
        quantities: pairs.flat_map(|(a, b)| rows(a, b)).collect(),
    }
}

/// Rows for the quantities that at least one of the two runs has.
fn rows(before: &PatientRecord, after: &PatientRecord) -> Vec<Row> {
    let (before, after) = (quantities(before), quantities(after));
    let patient = &before.0;
    std::iter::zip(before.1, after.1)
        .flat_map(|((name, a), (_, b))| pair_up(patient, &name, a, b))
        .collect()
}

fn pair_up(
    patient: &str,
    name: &str,
    before: Vec<(String, f64)>,
    after: Vec<(String, f64)>,
) -> Vec<Row> {
    let keys: std::collections::BTreeSet<&String> =
        before.iter().chain(&after).map(|(key, _)| key).collect();
    let value = |list: &[(String, f64)], key: &str| {
        list.iter().find(|(k, _)| k == key).map(|(_, value)| *value)
    };
    // Keys of the first list come first, followed by keys that only the second list has.
    let mut ordered: Vec<&String> = before.iter().map(|(key, _)| key).collect();
    ordered.extend(keys.into_iter().filter(|key| value(&before, key).is_none()));
    let row = |key: &String| {
        let (before, after) = (value(&before, key), value(&after, key));
        let relative_difference = before
            .zip(after)
            .map(|(b, a)| (a - b) / b.abs())
            .filter(|d| d.is_finite());
        let quantity = format!("{name} {key}").trim_end().to_owned();
        Row {
            patient: patient.to_owned(),
            quantity,
            before,
            after,
            relative_difference,
        }
    };
    ordered.into_iter().map(row).collect()
}

type Group = (String, Vec<(String, f64)>);

/// The patient's id and groups of named values. Every patient has the same groups, some of which
/// may be empty.
fn quantities(patient: &PatientRecord) -> (String, Vec<Group>) {
    let view = PatientView(patient);
    let one = |name: &str, value: Option<f64>| {
        (
            name.to_owned(),
            value.map(|v| (String::new(), v)).into_iter().collect(),
        )
    };
    let mut groups: Vec<Group> = vec![
        one(
            "step-1 cost",
            patient.step1.as_ref().map(|step1| step1.cost),
        ),
        one("step-1 iterations", Some(patient.iterations.len() as f64)),
        one(
            "step-1 best iteration",
            patient
                .step1
                .as_ref()
                .map(|step1| f64::from(step1.best_iteration)),
        ),
        one(
            "step-2 cost",
            patient.cell_fit.as_ref().map(|fit| fit.result.cost),
        ),
        one("verification cost", patient.verification_cost),
    ];
    for (step, name) in [
        (Step::Step1, "step-1"),
        (Step::Step2, "step-2"),
        (Step::Step3, "step-3"),
    ] {
        let values = view.simulated(step);
        let named = Biomarker::ALL
            .into_iter()
            .filter_map(|b| Some((b.key().to_owned(), values?.get(b)?)));
        groups.push((name.to_owned(), named.collect()));
    }
    let organ = patient
        .step1
        .as_ref()
        .map(|step1| step1.parameters.updated());
    let organ = organ
        .into_iter()
        .flat_map(|values| std::iter::zip(Step1Parameter::KEYS, values));
    groups.push((
        "organ".to_owned(),
        organ
            .map(|(name, value)| (name.to_owned(), value))
            .collect(),
    ));
    let cell = patient
        .cell_fit
        .iter()
        .flat_map(|fit| &fit.result.parameters);
    groups.push((
        "cell".to_owned(),
        cell.map(|parameter| (parameter.name.clone(), parameter.value))
            .collect(),
    ));
    (patient.plan.id.to_string(), groups)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_paired_by_name_and_differences_are_relative() {
        let list = |values: &[(&str, f64)]| {
            values
                .iter()
                .map(|(k, v)| ((*k).to_owned(), *v))
                .collect::<Vec<_>>()
        };
        let rows = pair_up(
            "P1",
            "cell",
            list(&[("b", 2.0), ("a", -4.0)]),
            list(&[("a", -5.0), ("c", 1.0)]),
        );
        let told: Vec<_> = rows
            .iter()
            .map(|r| {
                (
                    r.quantity.as_str(),
                    r.before,
                    r.after,
                    r.relative_difference,
                )
            })
            .collect();
        assert_eq!(
            told,
            [
                ("cell b", Some(2.0), None, None),
                ("cell a", Some(-4.0), Some(-5.0), Some(-0.25)),
                ("cell c", None, Some(1.0), None),
            ]
        );
    }
}
