//! `cardiotwin init --from`: a cohort from the user's own traces. Everything is read, checked and
//! simulated before the first file is written.

use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};

use cardiotwin_engine::find_worker;
use cardiotwin_input::own_traces::{self, Choices, Fact, NotUnderstood, OwnTraces, Question};
use cardiotwin_input::preparation::{self, Made, PREPARED};
use cardiotwin_input::{
    Finding, Options, PREPARE_TOML, Patient, RawFolder, Report, load, read_raw,
};
use cardiotwin_report::html::preparation::{UnderstoodBeat, understood_svg};
use cardiotwin_report::results::folder::WholeFolder;
use clap::Args;

use super::said::{Answer, NewPatient};
use super::template::{COHORT, toml_text};
use super::twin;
use crate::commands::prepare;
use crate::error::CliError;
use crate::exit::Exit;
use crate::problems;
use crate::talk::{Talk, count, harmless};

/// File of the picture in the patient's folder.
pub const PICTURE: &str = "understood.svg";
/// Endings of files that a folder of traces may hold.
const ENDINGS: [&str; 13] = [
    "csv", "txt", "tsv", "dat", "asc", "xlsx", "xlsm", "xlsb", "xls", "ods", "edf", "bdf", "hea",
];

/// What the user states about traces.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Your own traces")]
pub struct FromArgs {
    /// Make patients from pressure and volume traces: a file, a folder with a file for each patient, or
    /// a folder of recordings as `prepare` reads it
    #[arg(long, value_name = "FILE|FOLDER", conflicts_with = "example")]
    pub from: Option<PathBuf>,
    /// Name of the patient [default: the file's name]
    #[arg(long, requires = "from")]
    patient: Option<String>,
    /// Column with the pressure of the left ventricle: its name or number [default: by its name or course]
    #[arg(long, value_name = "COLUMN", requires = "from")]
    pressure: Option<String>,
    /// Column with the volume of the left ventricle
    #[arg(long, value_name = "COLUMN", requires = "from")]
    volume: Option<String>,
    /// Column with the time
    #[arg(long, value_name = "COLUMN", requires = "from")]
    time: Option<String>,
    /// Unit of the pressure: mmHg, kPa, hPa, mbar, Pa, Torr or cmH2O [default: by header or size]
    #[arg(long, value_name = "UNIT", requires = "from")]
    pressure_unit: Option<String>,
    /// Unit of the volume: mL, L, uL, cm3 or mm3
    #[arg(long, value_name = "UNIT", requires = "from")]
    volume_unit: Option<String>,
    /// Unit of the time: ms, s, us or min
    #[arg(long, value_name = "UNIT", requires = "from")]
    time_unit: Option<String>,
    /// Heart rate, for traces without a time
    #[arg(long, value_name = "PER_MINUTE", requires = "from", conflicts_with = "sample_interval_ms", value_parser = positive)]
    heart_rate: Option<f64>,
    /// Time between two samples in ms, for traces without a time
    #[arg(long, value_name = "MS", requires = "from", value_parser = positive)]
    sample_interval_ms: Option<f64>,
    /// Systolic and diastolic pressure of an arm cuff in mmHg, for the afterload, for example 121/76
    #[arg(long, value_name = "SYSTOLIC/DIASTOLIC", requires = "from", value_parser = cuff)]
    cuff: Option<[f64; 2]>,
    /// Volume of the left ventricle's wall in mL [default: estimated]
    #[arg(long, value_name = "ML", requires = "from", value_parser = positive)]
    wall_volume_ml: Option<f64>,
    /// Mean pressure of the left atrium in mmHg [default: estimated]
    #[arg(long, value_name = "MMHG", requires = "from", value_parser = positive)]
    left_atrial_pressure_mmhg: Option<f64>,
    /// Print one JSON object instead of tables
    #[arg(long, requires = "from")]
    json: bool,
    /// Open the picture of what was understood
    #[arg(long, requires = "from")]
    pub open: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH", requires = "from")]
    worker: Option<PathBuf>,
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    number
        .filter(|n: &f64| *n > 0.0 && n.is_finite())
        .ok_or_else(|| "expected a positive number".to_owned())
}

fn cuff(text: &str) -> Result<[f64; 2], String> {
    let both = text
        .split_once('/')
        .map(|(a, b)| (positive(a), positive(b)));
    match both {
        Some((Ok(systolic), Ok(diastolic))) if systolic > diastolic => Ok([systolic, diastolic]),
        _ => Err("expected SYSTOLIC/DIASTOLIC in mmHg, for example 121/76".to_owned()),
    }
}

impl FromArgs {
    fn choices(&self) -> Choices {
        Choices {
            pressure: self.pressure.clone(),
            volume: self.volume.clone(),
            time: self.time.clone(),
            pressure_unit: self.pressure_unit.clone(),
            volume_unit: self.volume_unit.clone(),
            time_unit: self.time_unit.clone(),
            sample_interval_ms: self.sample_interval_ms,
            cycle_length_ms: self.heart_rate.map(|rate| 60_000.0 / rate),
            cuff: self.cuff.map(|[systolic_mmhg, diastolic_mmhg]| {
                cardiotwin_schemas::raw::CuffPressures {
                    systolic_mmhg,
                    diastolic_mmhg,
                    mean_mmhg: None,
                    sd_mmhg: None,
                }
            }),
            wall_volume_ml: self.wall_volume_ml,
            left_atrial_pressure_mmhg: self.left_atrial_pressure_mmhg,
        }
    }
}

/// Where a patient comes from.
enum Source {
    /// A file of traces.
    Traces(PathBuf),
    /// A folder that `cardiotwin prepare` reads.
    Recordings(PathBuf),
}

/// A patient before anything is written.
struct Draft {
    id: String,
    raw: RawFolder,
    made: Made,
    traces: Option<OwnTraces>,
    /// Files in the patient's folder, pictures among them.
    files: Vec<(String, String)>,
}

/// Makes the cohort and tells what was understood.
///
/// # Errors
/// [`CliError::Usage`] if the cohort exists or the traces lack an answer that nobody can give here,
/// [`CliError::Recordings`] for traces with errors, [`CliError::Simulation`] if they give no twin.
/// Nothing is written then.
pub fn execute(
    (folder, name): (&Path, &str),
    args: &FromArgs,
    from: &Path,
    talk: &Talk,
) -> Result<Exit, CliError> {
    if folder.join("cohort.toml").exists() || is_filled(folder) {
        return Err(CliError::Usage(format!(
            "{} already exists; nothing was written: name another folder",
            folder.display()
        )));
    }
    let worker = find_worker(args.worker.as_deref())?;
    let sources = sources(from, args)?;
    let mut report = Report::default();
    let mut drafts = Vec::new();
    for (id, source) in &sources {
        drafts.extend(draft(id, source, args, &mut report, talk)?);
    }
    refuse_errors(&report, talk)?;
    // The cohort is tried where it harms nothing.
    let trial =
        tempfile::tempdir().map_err(CliError::file("create a folder in", std::env::temp_dir()))?;
    let there = trial.path().join("cohort");
    let cohort_toml = cohort_toml(name);
    write(&there, &cohort_toml, &drafts)?;
    let mut findings = Report::default();
    let cohort = load(&there, &Options::default(), &mut findings);
    let patients = cohort.map(|cohort| cohort.patients).unwrap_or_default();
    if findings.n_errors() > 0 {
        problems::say(&of_the_users_files(&findings, &there, &sources), talk);
        return Err(CliError::Recordings {
            errors: count(findings.n_errors(), "error"),
        });
    }
    let mut answer = Answer::new(folder, name);
    for draft in &mut drafts {
        let patient = patients.iter().find(|patient| patient.id == draft.id);
        let told = tell(folder, draft, patient, &worker)?;
        answer.patients.push(told);
    }
    write(folder, &cohort_toml, &drafts)?;
    problems::say(&report, talk);
    answer.tell(args.json, talk)?;
    let pictures: Vec<&Path> = answer.pictures().collect();
    if args.open
        && let Some(picture) = pictures.first()
    {
        crate::open::open(picture, talk);
    }
    Ok(Exit::Ok)
}

/// The findings with the user's own files in the place of those of the trial.
fn of_the_users_files(findings: &Report, trial: &Path, sources: &[(String, Source)]) -> Report {
    let mut own = Report::default();
    for Finding { patient, problem } in findings.findings() {
        let of_patient = sources.iter().find(|(id, _)| patient.as_ref() == Some(id));
        let file = of_patient.map(|(_, source)| match source {
            Source::Traces(path) | Source::Recordings(path) => path.clone(),
        });
        let mut problem = problem.clone();
        if let Ok(inside) = problem.file.strip_prefix(trial) {
            problem.file = file.unwrap_or_else(|| inside.to_owned());
            // Lines of the user's file are others.
            problem.line = None;
            problem.column = None;
        }
        let folder = format!("{}/", trial.display());
        for text in [
            &mut problem.found,
            &mut problem.expected,
            &mut problem.remedy,
        ] {
            *text = text.replace(&folder, "");
        }
        own.add(patient.as_deref(), problem);
    }
    own
}

/// Whether a folder holds anything.
fn is_filled(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder);
    entries.is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file()
}

/// The patients to make, with their names.
fn sources(from: &Path, args: &FromArgs) -> Result<Vec<(String, Source)>, CliError> {
    let usage = |text: String| Err(CliError::Usage(text));
    if from.is_file() {
        let id = id(from, args.patient.as_ref());
        return Ok(vec![(id, Source::Traces(from.to_owned()))]);
    }
    if !from.is_dir() {
        return usage(format!("{}: no such file or folder", from.display()));
    }
    let entries = std::fs::read_dir(from).map_err(CliError::file("read", from))?;
    let mut files: Vec<PathBuf> = entries
        .map_while(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| path.is_file())
        .collect();
    files.sort();
    let stem = |path: &PathBuf| {
        path.file_stem()
            .map(|stem| stem.to_string_lossy().to_lowercase())
    };
    let is_raw = files.iter().any(|path| {
        path.ends_with(PREPARE_TOML) || stem(path).is_some_and(|stem| stem == "catheter")
    });
    if is_raw {
        let id = id(from, args.patient.as_ref());
        return Ok(vec![(id, Source::Recordings(from.to_owned()))]);
    }
    files.retain(|path| {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    });
    if files.is_empty() {
        return usage(format!(
            "{} holds no file of traces ({})",
            from.display(),
            ENDINGS.join(", ")
        ));
    }
    if args.patient.is_some() && files.len() > 1 {
        return usage(format!(
            "--patient names one patient, but {} holds {}",
            from.display(),
            count(files.len(), "file")
        ));
    }
    let named = files
        .into_iter()
        .map(|path| (id(&path, args.patient.as_ref()), Source::Traces(path)));
    let named: Vec<(String, Source)> = named.collect();
    for (i, (id, _)) in named.iter().enumerate() {
        if named[..i].iter().any(|(other, _)| other == id) {
            return usage(format!(
                "two files of {} give the patient {id}: rename one",
                from.display()
            ));
        }
    }
    Ok(named)
}

/// Pseudonym of a patient: as stated, or the file's name with the characters that a folder may have.
fn id(path: &Path, stated: Option<&String>) -> String {
    if let Some(stated) = stated {
        return stated.clone();
    }
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let stem = if absolute.is_dir() {
        absolute.file_name()
    } else {
        absolute.file_stem()
    };
    let plain: String = stem
        .unwrap_or_default()
        .to_string_lossy()
        .chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() || "-_.".contains(c) {
                c
            } else {
                '-'
            }
        })
        .take(64)
        .collect();
    let plain = plain.trim_matches(['-', '.']).to_owned();
    if plain.is_empty() {
        "P001".to_owned()
    } else {
        plain
    }
}

/// A patient from its source. Problems go to `report`; `None` with an error.
fn draft(
    id: &str,
    source: &Source,
    args: &FromArgs,
    report: &mut Report,
    talk: &Talk,
) -> Result<Option<Draft>, CliError> {
    let (raw, traces) = match source {
        Source::Recordings(folder) => (read_raw(folder, report), None),
        Source::Traces(file) => {
            let traces = understood(file, args, report, talk)?;
            (traces.as_ref().map(|traces| traces.raw.clone()), traces)
        }
    };
    let Some(raw) = raw else {
        return Ok(None);
    };
    let from = match source {
        Source::Recordings(path) | Source::Traces(path) => path.display(),
    };
    let mut made = preparation::make(&raw, id).map_err(|error| {
        CliError::Usage(format!(
            "{from}: {error}; nothing was written: check that it is a left ventricle's pressure"
        ))
    })?;
    for problem in made.problems.drain(..) {
        report.add(Some(id), problem);
    }
    if made.prepared.volume.is_none() {
        return Err(CliError::Usage(format!(
            "{from}: no volume of a whole beat; nothing was written"
        )));
    }
    let files = prepare::all_files(&raw, &mut made)?;
    Ok(Some(Draft {
        id: id.to_owned(),
        raw,
        made,
        traces,
        files,
    }))
}

/// The traces of a file, after the questions that a person at the terminal answers.
fn understood(
    file: &Path,
    args: &FromArgs,
    report: &mut Report,
    talk: &Talk,
) -> Result<Option<OwnTraces>, CliError> {
    let mut choices = args.choices();
    let stdin = std::io::stdin();
    let may_ask =
        !args.json && !talk.quiet && stdin.is_terminal() && std::io::stderr().is_terminal();
    loop {
        match own_traces::read(file, &choices) {
            Ok(traces) => return Ok(Some(traces)),
            Err(NotUnderstood::Problems(problems)) => {
                problems
                    .into_iter()
                    .for_each(|problem| report.add(None, problem));
                return Ok(None);
            }
            Err(NotUnderstood::Question(question)) if may_ask => {
                choices = ask(&question, choices, &mut stdin.lock())?;
            }
            Err(NotUnderstood::Question(question)) => {
                report.add(None, question.problem);
                return Ok(None);
            }
        }
    }
}

/// Asks a question on the terminal. The end of the input ends the command.
fn ask(
    question: &Question,
    choices: Choices,
    answers: &mut dyn std::io::BufRead,
) -> Result<Choices, CliError> {
    loop {
        let mut err = std::io::stderr().lock();
        let _ = write!(err, "{} ", harmless(&question.words)).and_then(|()| err.flush());
        let mut answer = String::new();
        let n = answers.read_line(&mut answer).unwrap_or(0);
        if n == 0 {
            return Err(CliError::Usage(format!(
                "nothing was written: {}",
                question.problem.remedy
            )));
        }
        if answer.trim().is_empty() {
            continue;
        }
        match question.asks_for.answered(&answer, choices.clone()) {
            Ok(choices) => return Ok(choices),
            Err(why) => {
                let _ = writeln!(err, "{}", harmless(&why));
            }
        }
    }
}

fn refuse_errors(report: &Report, talk: &Talk) -> Result<(), CliError> {
    if report.n_errors() == 0 {
        return Ok(());
    }
    problems::say(report, talk);
    Err(CliError::Recordings {
        errors: count(report.n_errors(), "error"),
    })
}

/// The settings file of the new cohort: the template with the reduced ventricle.
fn cohort_toml(name: &str) -> String {
    const DEFAULT: &str = "# fidelity = \"finite-element\"         # or \"reduced\", a one-fibre ventricle: a beat in milliseconds";
    const REDUCED: &str = "fidelity = \"reduced\"                  # a one-fibre ventricle: a beat in milliseconds; \"finite-element\" is 3D";
    COHORT
        .replace("{name}", &toml_text(name))
        .replace(DEFAULT, REDUCED)
}

/// Writes the cohort whole or not at all.
fn write(folder: &Path, cohort_toml: &str, drafts: &[Draft]) -> Result<(), CliError> {
    let whole = WholeFolder::begin(folder).map_err(CliError::Export)?;
    let write =
        |name: &str, text: &str| whole.write(name, text.as_bytes()).map_err(CliError::Export);
    write("cohort.toml", cohort_toml)?;
    for draft in drafts {
        for (name, text) in &draft.files {
            write(&format!("patients/{}/{name}", draft.id), text)?;
        }
    }
    whole.publish().map_err(CliError::Export)
}

/// What is said of a new patient. Adds the picture to its files.
fn tell(
    folder: &Path,
    draft: &mut Draft,
    patient: Option<&Patient>,
    worker: &Path,
) -> Result<NewPatient, CliError> {
    let facts: Vec<Fact> = match (&draft.traces, patient) {
        (Some(traces), Some(patient)) => own_traces::facts(traces, &draft.made, &patient.file),
        _ => Vec::new(),
    };
    let plan = patient.and_then(|patient| patient.resolved.as_ref());
    let twin = plan.map(|plan| twin::of(plan, worker)).transpose()?;
    let place = folder.join("patients").join(&draft.id);
    let mut picture = None;
    if let Some(svg) = understood_svg(&beat(draft, &facts)) {
        let name = format!("{PREPARED}/{PICTURE}");
        picture = Some(place.join(&name));
        draft.files.push((name, svg));
    }
    Ok(NewPatient {
        id: draft.id.clone(),
        files: draft
            .raw
            .inputs
            .iter()
            .map(|input| input.file.clone())
            .collect(),
        facts,
        steps: draft.made.answer.steps.clone(),
        others: draft
            .traces
            .as_ref()
            .map_or_else(Vec::new, |t| t.others.clone()),
        warnings: draft.made.answer.warnings.clone(),
        twin,
        picture,
        page: place.join(PREPARED).join(prepare::PAGE),
        folder: place,
    })
}

/// Lines of the picture.
fn beat(draft: &Draft, facts: &[Fact]) -> UnderstoodBeat {
    let average = &draft.made.prepared.average;
    let time = |i: usize| i as f64 * average.step_ms;
    let mean: Vec<f64> = average
        .lv_pressure
        .as_ref()
        .map_or_else(Vec::new, |lv| lv.mean.clone());
    let volume = draft
        .made
        .prepared
        .volume
        .as_ref()
        .map(|volume| &volume.synchronised);
    let mut found = UnderstoodBeat {
        title: format!("{}: what was understood", draft.id),
        text: facts
            .iter()
            .map(|fact| format!("{}: {} ({})", fact.quantity, fact.value, fact.origin.word()))
            .collect(),
        pressure: mean
            .iter()
            .enumerate()
            .map(|(i, p)| (time(i), *p))
            .collect(),
        ..UnderstoodBeat::default()
    };
    if let Some(cine) = volume {
        let at = |i: usize| cine.at(time(i));
        found.volume = (0..mean.len()).map(|i| (time(i), at(i))).collect();
        found.pv_loop = mean.iter().enumerate().map(|(i, p)| (at(i), *p)).collect();
        found.pv_loop.extend(found.pv_loop.first().copied());
    }
    if let Some(valves) = draft.made.prepared.valves {
        found.events.extend([
            ("aortic valve opens", valves.aortic_opening_ms),
            ("aortic valve closes", valves.aortic_closure_ms),
            ("mitral valve opens", valves.mitral_opening_ms),
        ]);
    }
    found
}

#[cfg(test)]
mod tests {
    use cardiotwin_input::own_traces::AsksFor;
    use cardiotwin_signals::Problem;

    use super::*;

    #[test]
    fn the_template_becomes_one_of_the_reduced_ventricle() {
        let text = cohort_toml("mine");
        let table: toml::Table = toml::from_str(&text).unwrap();
        assert_eq!(table["solver"]["fidelity"].as_str(), Some("reduced"));
        assert_eq!(table["name"].as_str(), Some("mine"));
    }

    #[test]
    fn a_name_becomes_a_pseudonym() {
        let of = |name: &str| id(Path::new(name), None);
        assert_eq!(of("x/pig 7 (rest).csv"), "pig-7--rest");
        assert_eq!(of("ü.csv"), "P001");
        assert_eq!(id(Path::new("a.csv"), Some(&"P7".to_owned())), "P7");
    }

    #[test]
    fn answers_are_asked_for_until_there_is_one_or_the_input_ends() {
        let question = Question {
            asks_for: AsksFor::HeartRate,
            words: "what is the heart rate per minute?".into(),
            problem: Problem::error(
                Path::new("x"),
                "no times",
                "times",
                "say it: --heart-rate N",
            ),
        };
        let asked = |answers: &str| ask(&question, Choices::default(), &mut answers.as_bytes());
        let cycle_ms = asked("\nfast\n75\n").unwrap().cycle_length_ms;
        assert_eq!(cycle_ms, Some(800.0));
        let error = asked("fast\n").unwrap_err().to_string();
        assert!(error.contains("--heart-rate"), "{error}");
    }

    #[test]
    fn a_cuff_is_two_pressures() {
        assert_eq!(cuff("121/76"), Ok([121.0, 76.0]));
        assert!(cuff("76/121").is_err() && cuff("121").is_err() && cuff("a/b").is_err());
    }
}
