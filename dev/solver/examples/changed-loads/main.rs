//! Predictions of changed loads, rate and contractility against hearts of other formulations:
//!
//! ```text
//! changed-loads make FOLDER [--hearts N] [--seed N]      a cohort, and FOLDER/truth.json
//! cardiotwin run FOLDER --set solver.fidelity=reduced
//! changed-loads score FOLDER [--cardiotwin PATH] [--circuits open,closed] [--bands no] [--all yes] [--twins N]
//! ```
//!
//! `make` draws hearts of `tests/validation` in turn: elastances, sarcomeres in a spherical wall, and one
//! extreme elastance in five. Each is a closed loop, paced at 70 beats a minute and measured with the
//! usual noise. Its true answers are the steady beats after one change with the same blood. `score` asks
//! `cardiotwin predict` for the same changes of each twin, in each circuit, and prints for each change and
//! index the mean absolute error of the relative change in percentage points, the mean error, and how many
//! true changes lie in the 90 % bands, which `--bands no` leaves out. Twins that are not personalised
//! count with `--all yes` only. `--twins N` asks for the first N hearts alone.
//!
//! The circuit of `cardiotwin predict` was chosen on the default seed, 20261201; seed 20271104 judges it.

#[path = "../command/arguments.rs"]
#[allow(dead_code)]
mod arguments;
#[path = "../validation/folder.rs"]
mod folder;
mod hearts;
mod score;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Indices of a beat, by the names of `cardiotwin predict`.
pub const INDICES: [&str; 5] = [
    "P_max_mmHg",
    "dPdt_max_mmHg_per_ms",
    "EDV_mL",
    "SV_mL",
    "ejection_fraction",
];

/// Changes by name, each with the twin's quantity in the syntax of `--set`.
///
/// `rate` and `rate-alone` are the same change of a twin: of the hearts, systole shortens in the former
/// by the square root of the cycle, and keeps its length in the latter.
pub const CHANGES: [(&str, &str); 7] = [
    ("periphery", "peripheral_resistance_mmHg_s_per_mL=-25%"),
    ("compliance", "compliance_mL_per_mmHg=-25%"),
    ("filling", "left_atrial_pressure_mmHg=+20%"),
    ("contractility", "Smax_ref_kPa=+20%"),
    ("rate", "cycle_length_ms=600"),
    ("rate-alone", "cycle_length_ms=600"),
    ("aortic-valve", "R_AV_f_mmHg_s_per_mL=+200%"),
];

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
    let usage = "usage: changed-loads make|score FOLDER [--hearts N] [--seed N] [--cardiotwin PATH] [--circuits open,closed] [--bands no] [--all yes] [--twins N]";
    let mut all = std::env::args().skip(1);
    let (Some(command), Some(folder)) = (all.next(), all.next()) else {
        return Err(usage.to_owned());
    };
    let (mut n_hearts, mut seed) = (10, 20_261_201);
    let mut program = PathBuf::from("cardiotwin");
    let mut circuits = "open,closed".to_owned();
    let (mut bands, mut counts_all, mut n_twins) = (true, false, usize::MAX);
    for pair in arguments::pairs(all) {
        let (flag, value) = pair?;
        match flag.as_str() {
            "--hearts" => n_hearts = arguments::number(&flag, &value)?,
            "--seed" => seed = arguments::number(&flag, &value)? as u64,
            "--cardiotwin" => program = value.into(),
            "--circuits" => circuits = value,
            "--bands" => bands = value != "no",
            "--twins" => n_twins = arguments::number(&flag, &value)?,
            "--all" => counts_all = value == "yes",
            _ => return Err(format!("unknown argument {flag}\n{usage}")),
        }
    }
    let folder = Path::new(&folder);
    match command.as_str() {
        "make" => hearts::make(folder, n_hearts, seed),
        "score" => {
            let circuits: Vec<&str> = circuits.split(',').collect();
            let asked = score::Asked {
                program: &program,
                circuits: &circuits,
                bands,
                counts_all,
                n_twins,
            };
            score::score(folder, &asked)
        }
        _ => Err(usage.to_owned()),
    }
}
