//! Halves and doubles each chosen constant of the search, and tells what changes.
//!
//! ```text
//! constants [--singles N] [--nulls N] [--seed N] [--jobs N] [--only TEXT,TEXT]
//! ```
//!
//! Patients of two formulations of the heart are drawn from a development seed; `--singles` and
//! `--nulls` count those of each. Each constant is halved and doubled in a search of its own for every
//! patient. The table is Markdown: healthy hearts with a name, right names, and the mean change of the
//! evidence for the effect that is there. `--only` takes the constants whose name contains one of the texts.

#[path = "../command/arguments.rs"]
mod arguments;
mod knobs;
#[path = "../../../../solver/discover/tests/support/visibility.rs"]
#[allow(dead_code)]
mod visibility;

use cardiotwin_discover::{Measured, Reduced, Settings, discover};
use cardiotwin_validation::{Hearts, Plan};
use cardiotwin_vocabulary::findings::Findings;
use knobs::Constant;
use rayon::prelude::*;

/// A patient with the effect that is hidden, if any.
struct Patient {
    measured: Measured,
    effect: Option<&'static str>,
}

fn patients(n_singles: usize, n_nulls: usize, seed: u64) -> Vec<Patient> {
    let of = |(hearts, plan, n): (Hearts, Plan, usize)| {
        plan.cases(n, seed, hearts)
            .into_iter()
            .filter_map(|planned| {
                let case = planned.make()?;
                Some(Patient {
                    measured: visibility::with_noise(&case, &Default::default()),
                    effect: planned.effects.first().map(|(name, _)| *name),
                })
            })
    };
    [Hearts::Elastance, Hearts::Sarcomeres]
        .into_iter()
        .flat_map(|hearts| {
            [
                (hearts, Plan::Nulls, n_nulls),
                (hearts, Plan::Singles, n_singles),
            ]
        })
        .flat_map(of)
        .collect()
}

/// The search with a constant multiplied by a factor; `None` without an answer.
fn search(patient: &Patient, constant: Option<(&Constant, f64)>) -> Option<Findings> {
    let (mut settings, mut model) = (Settings::default(), Reduced::new(&patient.measured));
    if let Some((constant, factor)) = constant {
        constant.apply(&mut settings, &mut model, factor);
    }
    Some(
        discover(&patient.measured, &model, &settings)
            .ok()?
            .findings,
    )
}

/// What a set of answers says.
#[derive(Default)]
struct Score {
    n_nulls: usize,
    named_nulls: usize,
    n_singles: usize,
    right: usize,
    without_answer: usize,
    /// Sum of the changes of the evidence for the right effect, and their number.
    change: (f64, usize),
}

fn evidence(found: &Findings, effect: &str) -> Option<f64> {
    let entry = found.effects.iter().find(|entry| entry.name == effect)?;
    Some(entry.robust_evidence)
}

fn score(patients: &[Patient], base: &[Option<Findings>], found: &[Option<Findings>]) -> Score {
    let mut score = Score::default();
    for ((patient, base), found) in patients.iter().zip(base).zip(found) {
        let Some(found) = found else {
            score.without_answer += 1;
            continue;
        };
        match patient.effect {
            None => {
                score.n_nulls += 1;
                score.named_nulls += usize::from(!found.none);
            }
            Some(effect) => {
                score.n_singles += 1;
                score.right += usize::from(found.accepted.first().is_some_and(|a| a == effect));
                let before = base.as_ref().and_then(|base| evidence(base, effect));
                if let Some((before, after)) = before.zip(evidence(found, effect)) {
                    score.change.0 += after - before;
                    score.change.1 += 1;
                }
            }
        }
    }
    score
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} of {}, {} of {}",
            self.named_nulls, self.n_nulls, self.right, self.n_singles
        )?;
        if self.change.1 > 0 {
            write!(f, ", {:+.1}", self.change.0 / self.change.1 as f64)?;
        }
        if self.without_answer > 0 {
            write!(f, ", {} without an answer", self.without_answer)?;
        }
        Ok(())
    }
}

fn main() -> Result<(), String> {
    let usage =
        "usage: constants [--singles N] [--nulls N] [--seed N] [--jobs N] [--only TEXT,TEXT]";
    let (mut n_singles, mut n_nulls, mut seed, mut jobs) = (4, 2, 901u64, 2);
    let mut only = String::new();
    for pair in arguments::pairs(std::env::args().skip(1)) {
        let (flag, value) = pair?;
        if flag == "--only" {
            only = value;
            continue;
        }
        let number = arguments::number(&flag, &value)?;
        match flag.as_str() {
            "--singles" => n_singles = number,
            "--nulls" => n_nulls = number,
            "--seed" => seed = number as u64,
            "--jobs" => jobs = number,
            _ => return Err(usage.to_owned()),
        }
    }
    arguments::limit_threads(jobs)?;
    let patients = patients(n_singles, n_nulls, seed);
    let first = patients.first().ok_or("no patients")?;
    let constants = knobs::all(&first.measured);
    let base: Vec<Option<Findings>> = patients.par_iter().map(|p| search(p, None)).collect();
    println!("| constant | value | halved | doubled |\n| --- | --- | --- | --- |");
    println!("| (none) | | {} | |", score(&patients, &base, &base));
    let wanted = |constant: &&Constant| only.split(',').any(|text| constant.name.contains(text));
    for constant in constants.iter().filter(wanted) {
        let [halved, doubled] = [0.5, 2.0].map(|factor| {
            let found: Vec<Option<Findings>> = (patients.par_iter())
                .map(|patient| search(patient, Some((constant, factor))))
                .collect();
            score(&patients, &base, &found)
        });
        println!(
            "| {} | {} | {halved} | {doubled} |",
            constant.name, constant.value
        );
    }
    Ok(())
}
