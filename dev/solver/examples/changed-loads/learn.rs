//! Half widths of bands from errors of predicted changes.

use crate::answers::{Answers, Asked, Judged, answers};
use crate::changes::CHANGES;
use crate::folder;
use cardiotwin_calibrate::formulations::{
    Cohort, Discrepancies, Errors, Kind, Table, beyond, half_width,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Digits after the point of a learnt number: a hundredth of a percentage point.
const DIGITS: f64 = 1e4;

/// Errors of an index after a kind of change. Without bands the whole error counts as discrepancy, so that a band of both
/// is a little too wide.
fn errors(of: &[&Judged]) -> Errors {
    let rounded = |value: f64| (DIGITS * value).round() / DIGITS;
    let beyond = |one: &&Judged| beyond(one.error(), one.within());
    let right = of.iter().filter(|one| one.is_right_direction()).count();
    Errors {
        half_width: rounded(half_width(of.iter().map(beyond).collect())),
        right_direction: rounded(right as f64 / of.len() as f64),
    }
}

/// The table of one ventricle in one circuit.
fn table(of: &[Answers]) -> Table {
    let mut changes: Vec<Kind> = Vec::new();
    for change in CHANGES.iter().filter(|one| one.is_learnt) {
        if changes.iter().any(|kind| kind.quantity == change.quantity) {
            continue;
        }
        let mut by_index: BTreeMap<String, Vec<&Judged>> = BTreeMap::new();
        for one in of.iter().flat_map(|answers| &answers.judged) {
            if one.change.is_learnt && one.change.quantity == change.quantity {
                by_index.entry(one.index.clone()).or_default().push(one);
            }
        }
        let indices = by_index
            .into_iter()
            .map(|(index, all)| (index, errors(&all)))
            .collect();
        changes.push(Kind {
            quantity: change.quantity.to_owned(),
            factor: change.factor,
            indices,
        });
    }
    Table {
        ventricle: of[0].ventricle.clone(),
        circulation: of[0].circuit.clone(),
        n_twins: of.iter().map(|answers| answers.twins.len()).sum(),
        changes,
    }
}

/// Discrepancies of other ventricles that the file has already.
fn of_other_ventricles(file: &Path, learnt: &[Cohort]) -> Result<Discrepancies, String> {
    if !file.exists() {
        return Ok(Discrepancies::default());
    }
    let text = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let mut kept: Discrepancies =
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", file.display()))?;
    let is_other = |ventricle: &str| learnt.iter().all(|cohort| cohort.ventricle != ventricle);
    kept.hearts.retain(|cohort| is_other(&cohort.ventricle));
    kept.tables.retain(|table| is_other(&table.ventricle));
    Ok(kept)
}

/// Learns from the cohorts in some folders, and writes the discrepancies. Those of other ventricles stay.
pub fn learn(folders: &[PathBuf], into: &Path, asked: &Asked) -> Result<(), String> {
    let mut by_table: BTreeMap<(String, String), Vec<Answers>> = BTreeMap::new();
    let mut hearts: Vec<Cohort> = Vec::new();
    for of in folders {
        for circuit in &asked.circuits {
            let answers = answers(of, circuit, asked)?;
            let (seed, made) = answers.cohort;
            let cohort = Cohort {
                ventricle: answers.ventricle.clone(),
                seed,
                made,
            };
            if !hearts.contains(&cohort) {
                hearts.push(cohort);
            }
            let of_table = (answers.ventricle.clone(), answers.circuit.clone());
            by_table.entry(of_table).or_default().push(answers);
        }
    }
    let tables: Vec<Table> = by_table.values().map(|of| table(of)).collect();
    for table in &tables {
        let Table {
            ventricle,
            circulation,
            n_twins,
            ..
        } = table;
        println!("{ventricle}, {circulation}: {n_twins} twins");
    }
    let mut learnt = of_other_ventricles(into, &hearts)?;
    learnt.command = "make learn-bands (changed-loads learn)".to_owned();
    learnt.hearts.extend(hearts);
    learnt.tables.extend(tables);
    let text = serde_json::to_string_pretty(&learnt).map_err(|e| e.to_string())?;
    folder::put(into, &(text + "\n"))
}
