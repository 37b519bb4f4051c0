//! Generates folders of test patients with known hidden effects, in the patient format, with
//! `labels.json`.
//!
//! ```text
//! validation FOLDER [--model other|sarcomeres|same | --beats FILE] [--nulls N] [--singles N]
//!     [--doubles N] [--off N] [--extremes N] [--seed N] [--jobs N] [--no-visibility]
//! ```
//!
//! `other` is the independent closed loop of `tests/validation`, `sarcomeres` the same loop with
//! sarcomeres in a spherical wall in the place of the elastance, `same` is the model that is
//! fitted (an inverse crime, and labelled as such). `--beats` takes beats that the worker's example
//! `finite-element-hearts` has simulated for the same numbers and seed. Existing cases of the folder are kept, so that
//! a stopped command can be continued. The visibility of each case, which requires fits, is entered
//! last or left to a later call.

#[path = "../command/arguments.rs"]
#[allow(dead_code)]
mod arguments;
mod folder;
mod labels;
#[path = "../../../../solver/discover/tests/support/load.rs"]
#[allow(dead_code)]
mod load;
mod self_consistent;
mod source;
#[allow(dead_code)]
#[path = "../../../../solver/discover/tests/support/visibility.rs"]
mod visibility;

use cardiotwin_validation::{Hearts, Measurement, Plan, PlannedCase};
use rayon::prelude::*;
use source::Source;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;

struct Arguments {
    folder: PathBuf,
    source: Source,
    sets: Vec<(Plan, usize)>,
    seed: u64,
    jobs: usize,
    visibility: bool,
    measurements: Vec<Measurement>,
}

fn arguments() -> Result<Arguments, String> {
    let mut all = std::env::args().skip(1);
    let usage = "usage: validation FOLDER [--model other|sarcomeres|same | --beats FILE] [--nulls N] [--singles N] [--doubles N] [--off N] [--extremes N] [--seed N] [--measurements NAME,NAME]";
    let folder = all.next().ok_or(usage)?;
    let mut parsed = Arguments {
        folder: folder.into(),
        source: Source::Loop(Hearts::Elastance),
        sets: Vec::new(),
        seed: 1,
        jobs: 2,
        visibility: true,
        measurements: Vec::new(),
    };
    while let Some(flag) = all.next() {
        if flag == "--no-visibility" {
            parsed.visibility = false;
            continue;
        }
        let value = all.next().ok_or(format!("{flag} needs a value"))?;
        let number = || {
            value
                .parse::<usize>()
                .map_err(|e| format!("{flag} {value}: {e}"))
        };
        match flag.as_str() {
            "--model" => {
                parsed.source = match value.as_str() {
                    "other" => Source::Loop(Hearts::Elastance),
                    "sarcomeres" => Source::Loop(Hearts::Sarcomeres),
                    "same" => Source::Fitted,
                    _ => return Err(format!("unknown model {value}\n{usage}")),
                }
            }
            "--beats" => parsed.source = Source::beats(&value)?,
            "--nulls" => parsed.sets.push((Plan::Nulls, number()?)),
            "--singles" => parsed.sets.push((Plan::Singles, number()?)),
            "--doubles" => parsed.sets.push((Plan::Doubles, number()?)),
            "--off" => parsed.sets.push((Plan::OffCatalogue, number()?)),
            "--extremes" => parsed.sets.push((Plan::Extremes, number()?)),
            "--seed" => parsed.seed = number()? as u64,
            "--jobs" => parsed.jobs = number()?,
            "--measurements" => parsed.measurements = kinds(&value)?,
            _ => return Err(format!("unknown argument {flag} {value}\n{usage}")),
        }
    }
    let asks_for = |plan: Plan| parsed.sets.iter().any(|(set, _)| *set == plan);
    if !matches!(parsed.source, Source::Loop(_)) && asks_for(Plan::OffCatalogue) {
        return Err("--off: only the closed loop has gaps outside the catalogue".to_owned());
    }
    if !matches!(parsed.source, Source::Loop(Hearts::Elastance)) && asks_for(Plan::Extremes) {
        return Err("--extremes: extreme hearts are made with --model other".to_owned());
    }
    Ok(parsed)
}

/// Kinds of further measurements by their names; `all` for all of them.
fn kinds(names: &str) -> Result<Vec<Measurement>, String> {
    if names == "all" {
        return Ok(Measurement::ALL.map(|(kind, _)| kind).to_vec());
    }
    let known = Measurement::ALL.map(|(_, name)| name).join(", ");
    let kind = |name| Measurement::named(name).ok_or(format!("--measurements {name}: {known}"));
    names.split(',').map(kind).collect()
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let arguments = arguments()?;
    arguments::limit_threads(arguments.jobs)?;
    let planned: Vec<(PlannedCase, bool)> = (arguments.sets.iter())
        .flat_map(|(plan, n)| {
            let cases = plan.cases(*n, arguments.seed, arguments.source.hearts());
            cases.into_iter().map(|c| (c, plan.is_off_catalogue()))
        })
        .collect();
    let labels = Mutex::new(labels::Labels::open(
        &arguments.folder,
        arguments.source.name(),
        arguments.seed,
    )?);
    let make = |planned: &PlannedCase| arguments.source.make(planned);
    let known = |id: &str| labels.lock().expect("no thread has panicked").has(id);
    let wanted: Vec<&(PlannedCase, bool)> = planned
        .iter()
        .filter(|(case, _)| !known(&case.id))
        .collect();
    wanted.par_iter().try_for_each(|(planned, off)| {
        let Some(case) = make(planned) else {
            eprintln!(
                "{}: no plausible patient has {:?}; left out",
                planned.id, planned.effects
            );
            return Ok(());
        };
        let Some(further) = (arguments.source).further(planned, &case, &arguments.measurements)
        else {
            eprintln!("{}: no further measurements; left out", planned.id);
            return Ok(());
        };
        folder::write(&arguments.folder, &planned.id, &case, &further)?;
        labels
            .lock()
            .expect("no thread has panicked")
            .add(planned, &case, *off)
    })?;
    eprintln!(
        "{} cases made, {} there before",
        wanted.len(),
        planned.len() - wanted.len()
    );
    let unseen = |id: &str| {
        labels
            .lock()
            .expect("no thread has panicked")
            .lacks_visibility(id)
    };
    let wanted: Vec<&(PlannedCase, bool)> = planned
        .iter()
        .filter(|(case, _)| arguments.visibility && unseen(&case.id))
        .collect();
    wanted.par_iter().try_for_each(|(planned, _)| {
        let Some(case) = make(planned) else {
            return Ok(());
        };
        let seen = visibility::of(&case);
        eprintln!("{} {seen:.1?}", planned.id);
        labels
            .lock()
            .expect("no thread has panicked")
            .see(&planned.id, &seen)
    })
}
