//! Puts the suggested measurements to the proof: the first that the program suggests is simulated with
//! the true heart, and the search is repeated with it.
//!
//! ```text
//! deciding [--model other|sarcomeres|same] [--singles N] [--nulls N] [--seed N] [--jobs N] [--steps N]
//!     [--skip N] [--make NAME,NAME]
//! ```
//!
//! A case is ambiguous where the answer names rivals that cannot be told apart, where it is wrong, or
//! where no name is given although an effect is there. For these the first suggestion of
//! `deciding_measurement` is made; where nothing is suspected, the first measurement that the catalogue
//! names for the true effect, which a clinic would make for another reason. Up to `--steps` measurements
//! are made one after the other (one without it). `--make` makes these, whatever is suggested. A case is decided if the right name stands alone:
//! accepted as the only effect, without rivals.

#[path = "../command/arguments.rs"]
mod arguments;
#[path = "../validation/self_consistent.rs"]
mod self_consistent;
#[path = "../validation/source.rs"]
#[allow(dead_code)]
mod source;
#[path = "../../../../solver/discover/tests/support/visibility.rs"]
#[allow(dead_code)]
mod visibility;

use cardiotwin_discover::forward::Forward;
use cardiotwin_discover::{Discovery, Measured, Reduced, Settings, discover};
use cardiotwin_validation::{Case, Hearts, Measurement, Plan, PlannedCase};
use cardiotwin_vocabulary::measurements::Measurement as Suggested;
use rayon::prelude::*;
use source::Source;

/// The simulated measurement of a suggestion; `None` for one that every case has.
fn simulated(suggested: Suggested) -> Option<Measurement> {
    Some(match suggested {
        Suggested::AorticPressure => Measurement::AorticPressure,
        Suggested::AorticFlow => Measurement::AorticFlow,
        Suggested::MitralFlow => Measurement::MitralFlow,
        Suggested::AtrialPressure => Measurement::AtrialPressure,
        Suggested::Strain => Measurement::Strain,
        Suggested::ValveTimes => Measurement::ValveTimes,
        Suggested::Qrs => Measurement::Qrs,
        Suggested::Loaded => Measurement::Loaded,
        Suggested::Cuff | Suggested::ForwardStrokeVolume | Suggested::WholeHeartVolume => {
            return None;
        }
    })
}

/// First suggestion that was not made yet.
fn next(words: &[String], made: &[Measurement]) -> Option<Measurement> {
    let mut kinds = words
        .iter()
        .filter_map(|words| simulated(Suggested::of_words(words)?));
    kinds.find(|kind| !made.contains(kind))
}

/// What became of a case.
enum Fate {
    /// No question was left at first, and the answer is right.
    Clear,
    /// Ambiguous, with a suspect and its suggestion; whether it was decided.
    Suspected(bool),
    /// No suspicion of the effect that is there; whether the catalogue's measurement showed it.
    Unseen(bool),
    /// Ambiguous, but nothing that could be made was suggested.
    NoSuggestion,
}

/// Whether the answer is the truth, without rivals.
fn is_decided(found: &Discovery, truth: Option<&str>) -> bool {
    let findings = &found.findings;
    match truth {
        Some(name) => findings.accepted == [name] && findings.confusable.is_empty(),
        None => findings.none && findings.deciding_measurement.is_empty(),
    }
}

fn describe(found: &Discovery) -> String {
    let findings = &found.findings;
    format!(
        "[{}] rivals [{}]",
        findings.accepted.join("+"),
        findings.confusable.join("+")
    )
}

fn search(measured: &Measured, settings: &Settings) -> Option<Discovery> {
    discover(measured, &Reduced::new(measured), settings).ok()
}

fn data(
    source: &Source,
    planned: &PlannedCase,
    case: &Case,
    made: &[Measurement],
) -> Option<Measured> {
    let further = source.further(planned, case, made)?;
    Some(visibility::with_noise(case, &further))
}

fn fate(
    source: &Source,
    planned: &PlannedCase,
    settings: &Settings,
    (n_steps, wanted): (usize, &[Measurement]),
) -> Option<Fate> {
    let case = source.make(planned)?;
    let truth = planned.effects.first().map(|(name, _)| *name);
    let mut found = search(&data(source, planned, &case, &[])?, settings)?;
    let label = format!(
        "{} {} x{:.1}",
        planned.id,
        truth.unwrap_or("nothing"),
        case.hidden.first().map_or(0.0, |hidden| hidden.strength)
    );
    let mut history = describe(&found);
    if is_decided(&found, truth) || (truth.is_none() && found.findings.none) {
        println!("{label}: clear: {history}");
        return Some(Fate::Clear);
    }
    let suspected = !found.findings.deciding_measurement.is_empty();
    let mut made: Vec<Measurement> = Vec::new();
    for _ in 0..n_steps {
        let by_catalogue = || {
            let model = Reduced::new(&data(source, planned, &case, &[])?);
            let candidate = model
                .candidates()
                .iter()
                .find(|c| Some(c.name.as_str()) == truth)?;
            next(&candidate.separated_by, &made)
        };
        let kind = if let Some(kind) = wanted.iter().find(|kind| !made.contains(kind)) {
            Some(*kind)
        } else if suspected {
            next(&found.findings.deciding_measurement, &made)
        } else {
            by_catalogue()
        };
        let Some(kind) = kind else { break };
        made.push(kind);
        found = search(&data(source, planned, &case, &made)?, settings)?;
        history += &format!(" --{}--> {}", kind.name(), describe(&found));
        if is_decided(&found, truth) {
            break;
        }
    }
    let decided = is_decided(&found, truth);
    let fate = match (made.is_empty(), suspected) {
        (true, _) => Fate::NoSuggestion,
        (false, true) => Fate::Suspected(decided),
        (false, false) => Fate::Unseen(decided),
    };
    let word = match fate {
        Fate::Clear => "clear",
        Fate::NoSuggestion => "no suggestion",
        Fate::Suspected(true) => "decided",
        Fate::Suspected(false) => "NOT decided",
        Fate::Unseen(true) => "unseen, then shown",
        Fate::Unseen(false) => "unseen, NOT shown",
    };
    println!("{label}: {word}: {history}");
    Some(fate)
}

fn main() -> Result<(), String> {
    let usage = "usage: deciding [--model other|sarcomeres|same] [--singles N] [--nulls N] [--seed N] [--jobs N] [--steps N] [--skip N] [--make NAME,NAME]";
    let mut source = Source::Loop(Hearts::Elastance);
    let (mut n_singles, mut n_nulls, mut seed, mut jobs) = (16usize, 0usize, 901u64, 2usize);
    let (mut n_steps, mut skip) = (1usize, 0usize);
    let mut wanted: Vec<Measurement> = Vec::new();
    for pair in arguments::pairs(std::env::args().skip(1)) {
        let (flag, value) = pair?;
        if flag == "--model" {
            source = match value.as_str() {
                "other" => Source::Loop(Hearts::Elastance),
                "sarcomeres" => Source::Loop(Hearts::Sarcomeres),
                "same" => Source::Fitted,
                _ => return Err(usage.to_owned()),
            };
            continue;
        }
        if flag == "--make" {
            let kinds = value.split(',').map(Measurement::named);
            wanted = kinds
                .collect::<Option<_>>()
                .ok_or(format!("--make {value}"))?;
            continue;
        }
        let number = arguments::number(&flag, &value)?;
        match flag.as_str() {
            "--singles" => n_singles = number,
            "--nulls" => n_nulls = number,
            "--seed" => seed = number as u64,
            "--jobs" => jobs = number,
            "--steps" => n_steps = number,
            "--skip" => skip = number,
            _ => return Err(usage.to_owned()),
        }
    }
    arguments::limit_threads(jobs)?;
    let hearts = source.hearts();
    let mut planned = Plan::Singles.cases(n_singles, seed, hearts).split_off(skip);
    planned.extend(Plan::Nulls.cases(n_nulls, seed, hearts));
    let settings = Settings::default();
    let fates: Vec<Fate> = (planned.par_iter())
        .filter_map(|planned| fate(&source, planned, &settings, (n_steps, &wanted)))
        .collect();
    let count = |wanted: fn(&Fate) -> bool| fates.iter().filter(|fate| wanted(fate)).count();
    let decided = count(|f| matches!(f, Fate::Suspected(true)));
    let suspected = count(|f| matches!(f, Fate::Suspected(_)));
    let shown = count(|f| matches!(f, Fate::Unseen(true)));
    let unseen = count(|f| matches!(f, Fate::Unseen(_)));
    println!(
        "{} cases: {} clear; ambiguous with a suggestion: {decided} of {suspected} decided; \
         nothing suspected: {shown} of {unseen} shown; {} without a suggestion",
        fates.len(),
        count(|f| matches!(f, Fate::Clear)),
        count(|f| matches!(f, Fate::NoSuggestion)),
    );
    Ok(())
}
