//! Predictions of a finished run against the true answers.

use crate::answers::{Asked, Judged, answers};
use crate::changes::CHANGES;
use std::path::Path;

/// A share in words: how many of how many.
fn of_all<'a>(all: impl Iterator<Item = &'a bool> + Clone) -> String {
    let held = all.clone().filter(|held| **held).count();
    format!("{held:3}/{:<3}", all.count())
}

/// Prints mean absolute and mean error, right directions and true changes in bands: of each change and index, then of
/// all changes whose size was learnt, and of those of another size.
pub fn score(of: &Path, asked: &Asked) -> Result<(), String> {
    for circuit in &asked.circuits {
        let found = answers(of, circuit, asked)?;
        let names: Vec<&str> = indices(&found.judged);
        println!(
            "{}, {circuit} circuit: {} twins",
            found.ventricle,
            found.twins.len()
        );
        println!(
            "{:18} {:25} true   |e|   mean  direction  in band, percentage points",
            "change", "index"
        );
        for change in &CHANGES {
            for index in &names {
                let all: Vec<&Judged> = (found.judged.iter())
                    .filter(|one| one.change.name == change.name && one.index == *index)
                    .collect();
                if !all.is_empty() {
                    println!("{:18} {index:25} {}", change.name, row(&all));
                }
            }
        }
        for (words, is_learnt) in [("learnt sizes", true), ("other sizes", false)] {
            let of_size = |one: &&Judged| one.change.is_learnt == is_learnt;
            let all = || found.judged.iter().filter(of_size);
            for index in &names {
                let of_index: Vec<&Judged> = all().filter(|one| one.index == *index).collect();
                println!("{words:18} {index:25} {}", row(&of_index));
            }
            println!(
                "{words:18} {:25} {}",
                "all",
                row(&all().collect::<Vec<_>>())
            );
            for scale in [0.0, 0.5, 2.0] {
                let held: Vec<bool> = all().filter_map(|one| one.is_held(scale)).collect();
                println!(
                    "{words:18} in band with {scale} times the discrepancy {}",
                    of_all(held.iter())
                );
            }
            for known in ["size", "direction", "neither"] {
                let said = |one: &&Judged| one.known.as_deref() == Some(known);
                let right: Vec<bool> = all().filter(said).map(Judged::is_right_direction).collect();
                println!(
                    "{words:18} known: {known}, direction right {}",
                    of_all(right.iter())
                );
            }
        }
        let [all, asked, periodic, personalised] = found.counts;
        println!(
            "{all} predictions, {asked} in the asked circuit, {periodic} periodic, {personalised} of personalised twins"
        );
    }
    Ok(())
}

/// Names of the indices, in the order of the answers.
fn indices(of: &[Judged]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for one in of {
        if !names.contains(&one.index.as_str()) {
            names.push(&one.index);
        }
    }
    names
}

fn row(all: &[&Judged]) -> String {
    let n = all.len().max(1) as f64;
    let mean =
        |value: &dyn Fn(&Judged) -> f64| 100.0 * all.iter().map(|one| value(one)).sum::<f64>() / n;
    let right: Vec<bool> = all.iter().map(|one| one.is_right_direction()).collect();
    let held: Vec<bool> = all.iter().filter_map(|one| one.is_held(1.0)).collect();
    format!(
        "{:+6.1} {:5.1} {:+6.1}    {}    {}",
        mean(&|one| one.truth),
        mean(&|one| one.error().abs()),
        mean(&Judged::error),
        of_all(right.iter()),
        of_all(held.iter())
    )
}
