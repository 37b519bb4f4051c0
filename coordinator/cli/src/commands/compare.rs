//! `cardiotwin compare`: comparison of two runs, patient by patient.

use std::collections::BTreeMap;
use std::path::PathBuf;

use cardiotwin_engine::{self as engine, LeafChange};
use cardiotwin_report::results::{PatientView, Step};
use cardiotwin_report::table::{Column, Digits, Table};
use cardiotwin_schemas::biomarkers::Biomarker;

use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::step1::Step1Parameter;
use clap::Args;
use serde::Serialize;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Folders;
use crate::redone;
use crate::store::open;
use crate::table::text;
use crate::talk::{Talk, count};

/// Number of differences that are shown unless all are asked for.
const LARGEST: usize = 20;

/// Compare two runs: settings, then costs, biomarkers and parameters of each patient, the largest
/// differences first
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Folder of a run, or of a cohort with a run
    #[arg(value_name = "RUN")]
    before: PathBuf,
    /// Folder of the other run or cohort
    #[arg(value_name = "RUN")]
    after: PathBuf,
    /// Show all values in the order of patients, equal ones, too, instead of the twenty largest
    /// differences
    #[arg(long)]
    all: bool,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// A setting that differs between the runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct SettingRow {
    #[serde(flatten)]
    change: LeafChange,
    /// Patients in whom it differs by these values.
    patients: Vec<String>,
}

impl SettingRow {
    /// Key with both values, and the patients unless they are all.
    fn words(&self, n_compared: usize) -> String {
        let whose = match self.patients.len() {
            n if n == n_compared => String::new(),
            1..=3 => format!("   ({})", self.patients.join(", ")),
            n => format!("   ({n} of {n_compared} patients)"),
        };
        format!("  {}{whose}\n", self.change.words())
    }
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

impl Row {
    /// Size of the difference for sorting; a value that only one run has comes last.
    fn size(&self) -> f64 {
        match (self.before, self.after) {
            (Some(_), Some(_)) => self.relative_difference.map_or(f64::INFINITY, f64::abs),
            _ => -1.0,
        }
    }
}

/// Comparison of two runs.
#[derive(Serialize)]
pub(super) struct Comparison {
    schema_version: u32,
    before: PathBuf,
    after: PathBuf,
    only_before: Vec<String>,
    only_after: Vec<String>,
    /// Number of patients in both runs.
    n_compared: usize,
    /// Settings that differ, without those of the execution.
    settings: Vec<SettingRow>,
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
    talk.data(&of_settings(&comparison))?;
    let mut shown: Vec<&Row> = comparison.quantities.iter().collect();
    let n_same = shown.iter().filter(|row| row.before == row.after).count();
    let n_differ = shown.len() - n_same;
    if !args.all {
        shown.retain(|row| row.before != row.after);
        shown.sort_by(|a, b| b.size().total_cmp(&a.size()));
        shown.truncate(LARGEST);
    }
    if !shown.is_empty() {
        talk.data(&table(&shown, talk))?;
    }
    if !args.all && n_differ > LARGEST {
        let rest = n_differ - LARGEST;
        talk.data(&format!("… {rest} smaller differences; --all shows them\n"))?;
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
    talk.data(&format!(
        "{} differ, {n_same} are the same\n",
        count(n_differ, "quantity").replace("quantitys", "quantities")
    ))?;
    Ok(Exit::Ok)
}

/// Sentence about the settings, with a line for each that differs.
fn of_settings(comparison: &Comparison) -> String {
    if comparison.settings.is_empty() {
        return "no setting differs\n".to_owned();
    }
    let lines = comparison.settings.iter();
    let lines: String = lines.map(|row| row.words(comparison.n_compared)).collect();
    let n = count(comparison.settings.len(), "setting");
    let verb = if comparison.settings.len() == 1 {
        "differs"
    } else {
        "differ"
    };
    format!("{n} {verb}:\n{lines}\n")
}

fn table(rows: &[&Row], talk: &Talk) -> String {
    let columns = [
        Column::words("patient"),
        Column::words("quantity"),
        Column::numbers("before"),
        Column::numbers("after"),
        Column::numbers("relative_difference")
            .label("difference")
            .digits(Digits::Difference),
    ];
    text(&Table::of("quantities", columns, rows), talk)
}

/// Settings that differ in at least one patient, by key and values.
fn settings(pairs: &[(&PatientRecord, &PatientRecord)]) -> Vec<SettingRow> {
    let mut rows: BTreeMap<String, SettingRow> = BTreeMap::new();
    let differing = pairs
        .iter()
        .filter(|(before, after)| before.plan.settings != after.plan.settings);
    for (before, after) in differing {
        let of = |patient: &PatientRecord| serde_json::to_value(&*patient.plan.settings);
        let (Ok(old), Ok(new)) = (of(before), of(after)) else {
            continue;
        };
        for change in engine::leaf_changes(&old, &new) {
            if change.path.starts_with(redone::EXECUTION) {
                continue;
            }
            let row = rows.entry(change.words()).or_insert_with(|| SettingRow {
                change,
                patients: Vec::new(),
            });
            row.patients.push(before.plan.id.to_string());
        }
    }
    rows.into_values().collect()
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
    let pairs: Vec<_> = pairs.collect();
    Comparison {
        schema_version: cardiotwin_schemas::formats::COMPARISON.version,
        before: before.run_directory.clone(),
        after: after.run_directory.clone(),
        only_before: missing_in(before, after),
        only_after: missing_in(after, before),
        n_compared: pairs.len(),
        settings: settings(&pairs),
        quantities: pairs.iter().flat_map(|(a, b)| rows(a, b)).collect(),
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
    for step in Step::ALL {
        let values = view.simulated(step);
        let named = Biomarker::ALL
            .into_iter()
            .filter_map(|b| Some((b.key().to_owned(), values?.get(b)?)));
        groups.push((step.name().replace(' ', "-"), named.collect()));
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
