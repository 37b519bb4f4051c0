//! Runs the search on a folder of cases and scores it if the folder has labels.
//!
//! ```text
//! evaluate CASES_DIR [--jobs N] [--only ID,ID] [--part development|aside] [--no-side] [--seed N]
//!     [--learnt FILE] [--out FILE] [--measurements NAME,NAME]
//! ```
//!
//! `--learnt` takes discrepancies of the example `discrepancies` in the place of the built-in ones.
//!
//! `--measurements` keeps these of the further measurements (`none` for none of them); without it all are used.
//!
//! It writes one JSON line per case to standard output and the table to standard error. With
//! `--out` the lines go to a file, and cases that the file already contains are skipped, so that a
//! stopped command can be continued. Cases without an answer are counted and tried again.
//! `--part development` selects the 24 cases with which the search was developed, `--part aside`
//! all others.

#[path = "../command/arguments.rs"]
#[allow(dead_code)]
mod arguments;
#[allow(dead_code)]
mod classes;
#[path = "../../../../solver/discover/tests/support/load.rs"]
mod load;
mod score;

use cardiotwin_discover::learnt::Learnt;
use cardiotwin_discover::{Discovery, Reduced, Settings, discover};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

struct Arguments {
    folder: PathBuf,
    jobs: usize,
    only: Vec<String>,
    part: Option<String>,
    side: bool,
    seed: u64,
    out: Option<PathBuf>,
    learnt: Learnt,
    measurements: Option<Vec<String>>,
}

fn arguments() -> Result<Arguments, String> {
    let mut all = std::env::args().skip(1);
    let folder = all
        .next()
        .ok_or("usage: evaluate CASES_DIR [--jobs N] [--only ID,ID] [--part P] [--no-side]")?;
    let mut parsed = Arguments {
        folder: folder.into(),
        jobs: 2,
        only: Vec::new(),
        part: None,
        side: true,
        seed: 1,
        out: None,
        learnt: Learnt::healthy_hearts(),
        measurements: None,
    };
    while let Some(flag) = all.next() {
        let mut value = || all.next().ok_or(format!("{flag} needs a value"));
        match flag.as_str() {
            "--jobs" => parsed.jobs = value()?.parse().map_err(|e| format!("--jobs: {e}"))?,
            "--seed" => parsed.seed = value()?.parse().map_err(|e| format!("--seed: {e}"))?,
            "--only" => parsed.only = value()?.split(',').map(str::to_owned).collect(),
            "--out" => parsed.out = Some(value()?.into()),
            "--learnt" => {
                let path = value()?;
                let text = std::fs::read_to_string(&path).map_err(|e| format!("{path}: {e}"))?;
                parsed.learnt = serde_json::from_str(&text).map_err(|e| format!("{path}: {e}"))?;
            }
            "--measurements" => {
                parsed.measurements = Some(value()?.split(',').map(str::to_owned).collect());
            }
            "--part" => parsed.part = Some(value()?),
            "--no-side" => parsed.side = false,
            other => return Err(format!("unknown argument {other}")),
        }
    }
    Ok(parsed)
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

/// Results from a file of lines; an incomplete last line is removed from the file.
fn known(path: &Path) -> Result<Vec<(String, Discovery)>, String> {
    let Ok(text) = std::fs::read_to_string(path) else {
        return Ok(Vec::new());
    };
    let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
    if whole.len() < text.len() {
        std::fs::write(path, whole).map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    }
    let line = |(idx, line): (usize, &str)| {
        let bad = |e: &dyn std::fmt::Display| format!("{}:{}: {e}", path.display(), idx + 1);
        let value: serde_json::Value = serde_json::from_str(line).map_err(|e| bad(&e))?;
        let id = value["case"]
            .as_str()
            .ok_or_else(|| bad(&"the line names no case"))?
            .to_owned();
        Ok((id, serde_json::from_value(value).map_err(|e| bad(&e))?))
    };
    whole.lines().enumerate().map(line).collect()
}

fn append(path: &Path, line: &serde_json::Value) -> Result<(), String> {
    let file = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(path);
    file.and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()))
        .map_err(|e| format!("cannot write {}: {e}", path.display()))
}

fn run() -> Result<(), String> {
    let arguments = arguments()?;
    arguments::limit_threads(arguments.jobs)?;
    let mut ids = load::cases(&arguments.folder)?;
    if let Some(part) = &arguments.part {
        ids = load::part(&ids, part)?;
    }
    if !arguments.only.is_empty() {
        ids.retain(|id| arguments.only.contains(id));
    }
    let labels = load::labels(&arguments.folder)?;
    let settings = Settings {
        seed: arguments.seed,
        learnt: arguments.learnt,
        ..Settings::default()
    };
    let mut results = arguments.out.as_deref().map_or(Ok(Vec::new()), known)?;
    results.retain(|(id, _)| ids.contains(id));
    ids.retain(|id| results.iter().all(|(known, _)| known != id));
    let start = Instant::now();
    let mut slowest = 0.0f64;
    let mut unanswered = Vec::new();
    for id in &ids {
        let mut measured = load::measured(&arguments.folder.join("patients").join(id))?;
        if !arguments.side {
            measured.side = Default::default();
        }
        if let Some(kept) = &arguments.measurements {
            load::keep(&mut measured, kept);
        }
        let begin = Instant::now();
        let answer = std::panic::catch_unwind(|| {
            discover(&measured, &Reduced::new(&measured), &settings).map_err(|e| e.to_string())
        });
        let found = match answer.unwrap_or_else(|_| Err("the search panicked".to_owned())) {
            Ok(found) => found,
            Err(why) => {
                eprintln!("{id}: no answer: {why}");
                unanswered.push(id.clone());
                continue;
            }
        };
        let seconds = begin.elapsed().as_secs_f64();
        slowest = slowest.max(seconds);
        let mut line = serde_json::to_value(&found).map_err(|e| e.to_string())?;
        line["case"] = id.clone().into();
        line["seconds"] = seconds.into();
        match &arguments.out {
            Some(path) => append(path, &line)?,
            None => println!("{line}"),
        }
        eprintln!("{}", score::line(id, &found, labels.get(id), seconds));
        results.push((id.clone(), found));
    }
    eprintln!(
        "{} cases in {:.0} s, the slowest {slowest:.1} s, {} without an answer {unanswered:?}",
        ids.len(),
        start.elapsed().as_secs_f64(),
        unanswered.len()
    );
    if !labels.is_empty() {
        eprint!("{}", score::table(&results, &labels));
    }
    Ok(())
}
