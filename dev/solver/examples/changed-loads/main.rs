//! Predictions of changed loads, rate and contractility against hearts of other formulations:
//!
//! ```text
//! changed-loads make FOLDER [--hearts N] [--seed N]      a cohort, and FOLDER/truth.json
//! cardiotwin run FOLDER --set solver.fidelity=reduced
//! changed-loads score FOLDER [--cardiotwin PATH] [--circuits open,closed] [--bands no] [--all yes] [--sizes learnt] [--twins N] [--kept yes]
//! changed-loads learn FOLDER,FOLDER FILE.json [the same]
//! ```
//!
//! `make` draws hearts of `tests/validation` in turn: elastances, sarcomeres in a spherical wall, and one
//! extreme elastance in five. Each is a closed loop, paced at 70 beats a minute and measured with the
//! usual noise. Its true answers are the steady beats after one change with the same blood. `score` asks
//! `cardiotwin predict` for the same changes of each twin, in each circuit, and prints for each change and
//! index the mean absolute error of the relative change in percentage points, the mean error, how many
//! predictions have the true direction, and how many true changes lie in the 90 % bands. With `--bands no`
//! these are the discrepancy between formulations alone. `--sizes learnt` leaves out changes of other sizes
//! than those from which `learn` learns. Twins that are not personalised count with `--all yes` only. `--twins N` asks for the
//! first N hearts alone; `--kept yes` asks for nothing and reads the answers of the last call.
//!
//! `learn` writes the discrepancies by which `cardiotwin predict` widens its bands (`make learn-bands`).
//! Which seeds it saw stands in its file; others judge it.

mod answers;
#[path = "../command/arguments.rs"]
#[allow(dead_code)]
mod arguments;
mod changes;
#[path = "../validation/folder.rs"]
mod folder;
mod hearts;
mod learn;
mod score;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

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
    let usage = "usage: changed-loads make|score FOLDER, learn FOLDER,FOLDER FILE.json; [--hearts N] [--seed N] [--cardiotwin PATH] [--circuits open,closed] [--bands no] [--all yes] [--sizes learnt] [--twins N] [--kept yes]";
    let mut all = std::env::args().skip(1);
    let (Some(command), Some(folder)) = (all.next(), all.next()) else {
        return Err(usage.to_owned());
    };
    let into = match command.as_str() {
        "learn" => Some(PathBuf::from(all.next().ok_or(usage)?)),
        _ => None,
    };
    let (mut n_hearts, mut seed) = (10, 20_261_201);
    let mut asked = answers::Asked {
        program: PathBuf::from("cardiotwin"),
        circuits: vec!["open".to_owned(), "closed".to_owned()],
        bands: true,
        kept: false,
        counts_all: false,
        other_sizes: true,
        n_twins: usize::MAX,
    };
    for pair in arguments::pairs(all) {
        let (flag, value) = pair?;
        match flag.as_str() {
            "--hearts" => n_hearts = arguments::number(&flag, &value)?,
            "--seed" => seed = arguments::number(&flag, &value)? as u64,
            "--cardiotwin" => asked.program = value.into(),
            "--circuits" => asked.circuits = value.split(',').map(str::to_owned).collect(),
            "--bands" => asked.bands = value != "no",
            "--twins" => asked.n_twins = arguments::number(&flag, &value)?,
            "--all" => asked.counts_all = value == "yes",
            "--sizes" => asked.other_sizes = value != "learnt",
            "--kept" => asked.kept = value == "yes",
            _ => return Err(format!("unknown argument {flag}\n{usage}")),
        }
    }
    match (command.as_str(), into) {
        ("make", _) => hearts::make(Path::new(&folder), n_hearts, seed),
        ("score", _) => score::score(Path::new(&folder), &asked),
        ("learn", Some(into)) => {
            let folders: Vec<PathBuf> = folder.split(',').map(PathBuf::from).collect();
            learn::learn(&folders, &into, &asked)
        }
        _ => Err(usage.to_owned()),
    }
}
