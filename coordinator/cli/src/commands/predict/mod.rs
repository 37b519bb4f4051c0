//! `cardiotwin predict`: effect of a treatment on a personalised twin.

mod bands;
pub mod beat;
mod change;
pub mod circuit;
mod curve;
pub mod indices;
mod known;
pub mod law_file;
mod predicted;
mod scenarios;

use std::path::{Path, PathBuf};

use cardiotwin_engine::{Reader, find_worker};
use cardiotwin_report::html::prediction::{BeatLines, figure};
use cardiotwin_report::results::atomic;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::organ::{BeatCount, OrganSpec};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::task::OrganBeatSpec;
use clap::Args;
use serde::Serialize;

use self::bands::Bands;
use self::change::{Change, Changed};
use self::circuit::{Both, TwinsLoop, Ventricles, both};
use self::indices::{Traces, changes, indices, value_of};
use self::known::{Formulations, LEARNT};
use self::law_file::LawKnowledgeFile;
use self::predicted::{Known, Predicted};
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::place::{Folders, OfCohort};
use crate::table::{Columns, optional, percent};
use crate::talk::Talk;
use crate::ventricle::{AskedFor, CirculationKind, PERIODIC, PERIODIC_IN_3D, Ventricle};

/// Predict the effect of changed loads, pacing, cell or valves on a personalised twin
#[derive(Debug, Args)]
#[command(
    after_help = "Quantities: left_atrial_pressure_mmHg, peripheral_resistance_mmHg_s_per_mL, \
                  characteristic_resistance_mmHg_s_per_mL,\n\
                  compliance_mL_per_mmHg, cycle_length_ms, R_AV_f_mmHg_s_per_mL, \
                  R_MV_f_mmHg_s_per_mL, and the cell's parameters.\n\
                  Beats are simulated until the periodic state; the relative change between both \
                  periodic states is applied to the twin's own beat."
)]
pub struct PredictArgs {
    /// Patient of the twin; optional with --scenarios [default: every patient with a twin]
    #[arg(required_unless_present = "scenarios")]
    patient: Option<String>,
    /// Change a quantity to a value, or by a percentage such as -20% (may be given several times)
    #[arg(
        long = "set",
        value_name = "KEY=VALUE",
        required_unless_present = "scenarios",
        allow_hyphen_values = true
    )]
    set: Vec<String>,
    /// File of scenarios, each a table with `set` and, to restrict it to some twins, `patients`
    #[arg(long, value_name = "FILE", conflicts_with = "set")]
    scenarios: Option<PathBuf>,
    /// Simulate the run's finite-element ventricle instead of the law that was learned from its
    /// beats
    #[arg(long)]
    in_3d: bool,
    /// Circuit: `open`, an atrium at constant pressure and a Windkessel, or `closed`, a loop with the
    /// twin's blood volume, in which filling follows the change (not for external solvers)
    #[arg(long, value_enum, hide_possible_values = true, value_name = "open|closed",
          default_value_t = CirculationKind::Open)]
    circulation: CirculationKind,
    /// Skip the uncertainty of the prediction, which simulates the change on draws of the twin's
    /// posterior
    #[arg(long)]
    no_band: bool,
    /// Number of beats [default: as many as the periodic state takes]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    beats: Option<u32>,
    /// Write traces (CSV), plot (SVG) and prediction (JSON) into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Open the plot in the desktop's viewer
    #[arg(long, requires = "out")]
    open: bool,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Path of the worker's executable [default: cardiotwin-worker beside this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    #[command(flatten)]
    of: OfCohort,
}

/// Effect of the changes on one twin.
#[derive(Debug, Serialize)]
struct Prediction {
    scenario: Option<String>,
    patient: String,
    changes: Vec<Changed>,
    /// `organ's law`, `one-fibre`, `finite-element` or `external`.
    ventricle: &'static str,
    circulation: CirculationKind,
    /// Number of beats simulated before and after the change. `periodic` says whether both
    /// simulations reached their periodic state, or is true because `--beats` fixed the number.
    beats: [u32; 2],
    periodic: bool,
    /// Whether the twin's verdict says that it is personalised.
    personalised: bool,
    indices: Vec<Predicted>,
    /// What the bands cover, in one sentence, and whether the discrepancy between formulations is part of it; `None`
    /// without bands.
    band_covers: Option<String>,
    band_covers_formulations: Option<bool>,
    remarks: Vec<String>,
    files: Vec<PathBuf>,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    predictions: &'a [Prediction],
}

/// Runs the predictions and prints them.
///
/// # Errors
/// [`CliError::Usage`] for a change that the model does not describe, [`CliError::Simulation`] for
/// a beat that diverges, [`CliError::Worker`] if the worker cannot be run.
pub async fn execute(args: &PredictArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let worker = find_worker(args.worker.as_deref())?;
    let mut predictions = Vec::new();
    for (scenario, patient, set) in asked(args, &folders).await? {
        let changes = scenarios::changes(&set).map_err(CliError::Usage)?;
        let ventricle = Ventricle::of_run(&folders, &patient, "predict").await?;
        predictions.push(predict(args, scenario, &ventricle, &changes, &worker)?);
    }
    if args.json {
        talk.json(&Answer {
            schema_version: formats::PREDICTION.version,
            predictions: &predictions,
        })?;
    } else if args.scenarios.is_some() {
        talk.data(&overview(&predictions, talk))?;
    } else {
        predictions
            .iter()
            .try_for_each(|prediction| talk.data(&screen(prediction, talk)))?;
    }
    if args.open {
        let files = predictions.iter().flat_map(|one| &one.files);
        let plots = files.filter(|file| file.extension().is_some_and(|kind| kind == "svg"));
        plots.for_each(|plot| open_in_viewer(plot, talk));
    }
    let whole = predictions
        .iter()
        .all(|prediction| prediction.personalised && prediction.periodic);
    Ok(if whole { Exit::Ok } else { Exit::Problems })
}

/// Scenario, patient and changes of each requested prediction.
async fn asked(
    args: &PredictArgs,
    folders: &Folders,
) -> Result<Vec<(Option<String>, String, Vec<String>)>, CliError> {
    let Some(file) = &args.scenarios else {
        return Ok(args
            .patient
            .iter()
            .map(|patient| (None, patient.clone(), args.set.clone()))
            .collect());
    };
    let scenarios = scenarios::read(file)?;
    let twins = with_twin(folders).await?;
    let mut all = Vec::new();
    for (name, scenario) in scenarios {
        let patients = args
            .patient
            .clone()
            .map(|patient| vec![patient])
            .or(scenario.patients);
        for patient in patients.unwrap_or_else(|| twins.clone()) {
            all.push((Some(name.clone()), patient, scenario.set.clone()));
        }
    }
    if all.is_empty() {
        return Err(no_twin());
    }
    Ok(all)
}

/// Patients of the run that have a twin.
///
/// # Errors
/// Those of the store.
pub async fn with_twin(folders: &Folders) -> Result<Vec<String>, CliError> {
    let record = Reader::open(&folders.run).await?.record().await?;
    let twins = record.patients.iter().filter(|p| p.twin().is_some());
    Ok(twins.map(|p| p.plan.id.to_string()).collect())
}

/// The error of a run without any twin.
pub fn no_twin() -> CliError {
    CliError::Usage("no patient of the run has a twin yet: run `cardiotwin run` first".to_owned())
}

fn predict(
    args: &PredictArgs,
    scenario: Option<String>,
    ventricle: &Ventricle,
    changes: &[Change],
    worker: &Path,
) -> Result<Prediction, CliError> {
    let law = LawKnowledgeFile::of(ventricle)?;
    let reduced = LawKnowledgeFile::asked(law.as_ref());
    let (beats, asked) = if args.in_3d {
        (PERIODIC_IN_3D, AskedFor::TheOrgan)
    } else {
        (PERIODIC, reduced)
    };
    let beats = args.beats.map_or(beats, |n| BeatCount::Fixed { n });
    let twin = ventricle.beat_of_twin("predict", beats)?;
    let patient = ventricle.plan.id.to_string();
    let (own, own_traces) = ventricle.twin()?;
    let beats = (&twin, own, &Traces::of(&own_traces));
    let ventricles = Ventricles {
        shown: asked,
        searched: (asked != reduced).then_some(reduced),
        worker,
    };
    let simulated = in_circuit(args, &patient, beats, changes, ventricles)?;
    let (circuit, both, mut remarks) = simulated;
    let (result_before, traces_before) = &both.before;
    let (result_after, traces_after) = &both.after;
    let of = |result: &OrganBeatResult, text: &str, cycle_length_ms: f64| {
        indices(&result.biomarkers, &Traces::of(text), cycle_length_ms)
    };
    let posterior = ventricle.posterior().filter(|_| !args.no_band);
    let twins = of(own, &own_traces, twin.cycle_length_ms);
    let bands = match posterior {
        Some(posterior) => {
            let beats = args.beats.map_or(PERIODIC, |n| BeatCount::Fixed { n });
            let twin = ventricle.beat_of_twin("predict", beats)?;
            let closed = circuit.as_ref();
            bands::of(posterior, (&twin, &twins), changes, closed, reduced, worker)?
        }
        None => Bands::new(),
    };
    let mut indices = side_by_side(
        &twins,
        &of(result_before, traces_before, twin.cycle_length_ms),
        &of(result_after, traces_after, both.cycle_length_after_ms),
    );
    let ventricle_name = simulated_ventricle(&twin.organ, args.in_3d, law.is_some());
    let circulation = match circuit {
        Some(_) => CirculationKind::Closed,
        None => CirculationKind::Open,
    };
    let compared = match (&twin.organ, ventricle_name) {
        // Other ventricles of the same name: an external solver's law, a stand-in for a 3D one.
        (OrganSpec::External(_), "organ's law") => "external solver's law",
        (OrganSpec::FiniteElement(_) | OrganSpec::External(_), "one-fibre") => "substitute",
        (_, name) => name,
    };
    let formulations = Formulations::of(
        &LEARNT,
        (compared, circulation.name()),
        &both.made,
        args.beats.is_none(),
    );
    let mut unlike = Vec::new();
    for index in &mut indices {
        let Some(interval) = bands.get(index.name) else {
            continue;
        };
        formulations.enter(index, interval);
        if index
            .relative_change
            .is_some_and(|change| !interval.contains(change))
        {
            unlike.push(index.name);
        }
    }
    let of_changes = changes.iter().filter_map(Change::remark);
    remarks.extend(of_changes.map(str::to_owned));
    remarks.extend(both.made.iter().filter_map(Changed::remark));
    let verdict = ventricle.verdict();
    if let Some(verdict) = verdict.filter(|verdict| !verdict.personalised) {
        remarks.push(format!(
            "the twin is not personalised ({verdict}): its predictions have errors of this size, \
             too"
        ));
    }
    if let Some(doubt) = posterior.and_then(|posterior| posterior.sampling.doubt()) {
        remarks.push(format!("the intervals are only a rough estimate: {doubt}"));
    }
    if !unlike.is_empty() {
        remarks.push(format!(
            "the twin's change of {} is outside of its draws' 90 % interval, which is moved to the twin's change",
            unlike.join(", ")
        ));
    }
    for (word, result) in [("before", result_before), ("after", result_after)] {
        if let Some(check) = result.failed_check() {
            remarks.push(format!("{word}: {check}"));
        }
    }
    let has_bands = indices.iter().any(|index| index.band.is_some());
    let mut prediction = Prediction {
        scenario,
        patient,
        changes: both.made.clone(),
        ventricle: ventricle_name,
        circulation,
        beats: [result_before.beats, result_after.beats],
        periodic: args.beats.is_some() || both.are_periodic(),
        personalised: verdict.is_some_and(|verdict| verdict.personalised),
        band_covers: has_bands.then(|| formulations.sentence(law.is_some())),
        band_covers_formulations: has_bands.then(|| formulations.is_learnt()),
        indices,
        remarks,
        files: Vec::new(),
    };
    if !prediction.periodic {
        let [a, b] = prediction.beats;
        prediction.remarks.push(format!(
            "no periodic state after {a} and {b} beats: the values still drift"
        ));
    }
    if let Some(folder) = &args.out {
        let after = curve::predicted(traces_after, &prediction.indices);
        write(folder, &mut prediction, &own_traces, &after)?;
    }
    Ok(prediction)
}

/// Name of the ventricle in which beats are simulated.
fn simulated_ventricle(organ: &OrganSpec, in_3d: bool, has_law: bool) -> &'static str {
    match (organ, in_3d) {
        (OrganSpec::FiniteElement(_) | OrganSpec::External(_), false) if has_law => "organ's law",
        (OrganSpec::Reduced { .. }, _) | (_, false) => "one-fibre",
        (OrganSpec::FiniteElement(_), true) => "finite-element",
        (OrganSpec::External(_), true) => "external",
    }
}

/// Simulates both beats in the circuit that is asked for; `None` stands for the open one. A twin that has
/// no loop, or whose beat is not found in it, is refused. Among the twins of a file of scenarios it is
/// predicted in the open circuit, with a remark.
///
/// - `twin`: the unchanged beat; `own` and `traces`: its own one in the run
fn in_circuit(
    args: &PredictArgs,
    patient: &str,
    (twin, own, traces): (&OrganBeatSpec, &OrganBeatResult, &Traces),
    changes: &[Change],
    ventricles: Ventricles<'_>,
) -> Result<(Option<TwinsLoop>, Both, Vec<String>), CliError> {
    let named = |error: CliError| match error {
        CliError::Usage(problem) => CliError::Usage(format!("{patient}: {problem}")),
        other => other,
    };
    let is_one_of_many = args.scenarios.is_some();
    let mut remarks = Vec::new();
    if args.circulation == CirculationKind::Closed {
        let reason = match TwinsLoop::around(twin, (own, traces), args.in_3d) {
            Ok(closed) => match both(twin, changes, Some(&closed), ventricles) {
                Ok(both) if both.are_periodic() || !is_one_of_many => {
                    return Ok((Some(closed), both, remarks));
                }
                Ok(_) => "no periodic beat was found in the loop".to_owned(),
                Err(CliError::Simulation { message }) if is_one_of_many => {
                    format!("in the loop the beat {message}")
                }
                Err(error) => return Err(named(error)),
            },
            Err(reason) if is_one_of_many => reason,
            Err(reason) => {
                let refused = format!("{patient}: --circulation closed: {reason}");
                return Err(CliError::Usage(refused));
            }
        };
        remarks.push(format!(
            "predicted in the open circuit, in which filling does not follow the change: {reason}"
        ));
    }
    let both = both(twin, changes, None, ventricles).map_err(named)?;
    Ok((None, both, remarks))
}

fn side_by_side(
    twin: &[(&'static str, f64)],
    before: &[(&'static str, f64)],
    after: &[(&'static str, f64)],
) -> Vec<Predicted> {
    let made = changes(twin, before, after);
    let row = |name: &'static str| {
        let (own, relative_change) = (value_of(twin, name), value_of(&made, name));
        let predicted = own
            .zip(relative_change)
            .map(|(own, change)| own * (1.0 + change));
        Predicted {
            name,
            twin: own,
            relative_change,
            predicted,
            band: None,
            band_within_model: None,
            known: None,
            simulated_before: value_of(before, name),
            simulated_after: value_of(after, name),
        }
    };
    before.iter().map(|(name, _)| row(name)).collect()
}

/// Writes traces, plot and prediction, each file completely or not at all.
fn write(
    folder: &Path,
    prediction: &mut Prediction,
    before: &str,
    after: &str,
) -> Result<(), CliError> {
    std::fs::create_dir_all(folder).map_err(CliError::file("create", folder))?;
    let stem = match &prediction.scenario {
        Some(scenario) => format!("{scenario}-{}", prediction.patient),
        None => prediction.patient.clone(),
    };
    let lines = |text: &str| {
        let traces = Traces::of(text);
        BeatLines {
            pressure: traces.points("time_ms", "pressure_mmHg"),
            volume: traces.points("time_ms", "volume_mL"),
            pv_loop: traces.points("volume_mL", "pressure_mmHg"),
        }
    };
    let mut said: Vec<String> = prediction.changes.iter().map(words).collect();
    said.push(prediction.circulation.words().to_owned());
    let headline = format!("{}: twin's own beat, and predicted", prediction.patient);
    let json = serde_json::to_string_pretty(&*prediction).map_err(|error| CliError::Io {
        what: "cannot write JSON",
        source: error.into(),
    })?;
    let files = [
        (format!("{stem}-before.csv"), before.to_owned()),
        (format!("{stem}-after.csv"), after.to_owned()),
        (
            format!("{stem}.svg"),
            figure(&headline, &said, &lines(before), &lines(after)),
        ),
        (format!("{stem}.json"), json + "\n"),
    ];
    for (name, text) in files {
        let path = folder.join(name);
        atomic::replace(&path, |out| out.write_all(text.as_bytes()))
            .map_err(CliError::file("write", &path))?;
        prediction.files.push(path);
    }
    Ok(())
}

fn words(changed: &Changed) -> String {
    format!(
        "{}: {} → {}",
        changed.key,
        optional(Some(changed.before)),
        optional(Some(changed.after))
    )
}

/// Text of one prediction: changes, indices, remarks, files.
fn screen(prediction: &Prediction, talk: &Talk) -> String {
    let mut text: String = prediction
        .changes
        .iter()
        .map(|changed| words(changed) + "\n")
        .collect();
    let mut table = Columns::new(
        talk,
        &[
            "INDEX",
            ">TWIN",
            ">CHANGE",
            ">PREDICTED",
            ">5 %",
            ">95 %",
            "KNOWN",
        ],
    );
    for index in &prediction.indices {
        let [low, high] = [0, 1].map(|end| optional(index.band.map(|band| band[end])));
        let (change, predicted) = (percent(index.relative_change), optional(index.predicted));
        let cells = [
            index.name.to_owned(),
            optional(index.twin),
            change,
            predicted,
            low,
            high,
            index.known.map_or("-", Known::words).to_owned(),
        ];
        table.row(cells);
    }
    text += "\n";
    text += &table.text();
    let [a, b] = prediction.beats;
    text += &format!(
        "{} ventricle, {}, {a} beats before and {b} after\n",
        prediction.ventricle,
        prediction.circulation.words()
    );
    if let Some(covers) = &prediction.band_covers {
        text += &format!("5 % and 95 %: {covers}\n");
    }
    if prediction.band_covers_formulations == Some(true) {
        text += "KNOWN: size where the band has one direction; direction only where that was right in 90 % of these hearts\n";
    }
    prediction
        .remarks
        .iter()
        .for_each(|remark| text += &format!("remark: {remark}\n"));
    prediction
        .files
        .iter()
        .for_each(|file| text += &format!("{}\n", file.display()));
    text
}

/// Table of several predictions, one row per scenario and patient.
fn overview(predictions: &[Prediction], talk: &Talk) -> String {
    const SHOWN: [(&str, &str); 5] = [
        ("P_max_mmHg", ">P_MAX"),
        ("SV_mL", ">SV"),
        ("ejection_fraction", ">EF"),
        ("stroke_work_mJ", ">STROKE WORK"),
        ("aortic_mean_mmHg", ">AORTIC MEAN"),
    ];
    let mut headings = vec!["SCENARIO", "PATIENT"];
    headings.extend(SHOWN.map(|(_, heading)| heading));
    headings.push("CIRCUIT");
    let mut table = Columns::new(talk, &headings);
    for prediction in predictions {
        let cell = |name: &str| {
            let found = prediction.indices.iter().find(|index| index.name == name);
            found.map_or_else(
                || "-".to_owned(),
                |index| {
                    format!(
                        "{} ({}){}",
                        optional(index.predicted),
                        percent(index.relative_change),
                        index.known.map_or("", Known::mark)
                    )
                },
            )
        };
        let mut row = vec![
            prediction.scenario.clone().unwrap_or_default(),
            prediction.patient.clone(),
        ];
        row.extend(SHOWN.map(|(name, _)| cell(name)));
        row.push(prediction.circulation.words().to_owned());
        table.row(row);
    }
    let mut text = table.text()
        + "predicted values, with the change between both periodic states in \
                        brackets\n";
    if (predictions.iter()).any(|one| one.band_covers_formulations == Some(true)) {
        text += "~ only the direction is known, ? not even that: on hearts of other formulations\n";
    }
    for prediction in predictions {
        prediction
            .remarks
            .iter()
            .for_each(|remark| text += &format!("{}: {remark}\n", prediction.patient));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_change_between_periodic_states_is_carried_over_to_the_twin_s_beat() {
        let found = side_by_side(
            &[("SV_mL", 60.0), ("P_max_mmHg", 110.0)],
            &[("SV_mL", 50.0), ("EDP_mmHg", 8.0)],
            &[("SV_mL", 55.0), ("EDP_mmHg", 9.0)],
        );
        assert_eq!(
            found.len(),
            2,
            "what the simulated ventricle does not have is not predicted"
        );
        assert!(
            (found[0].predicted.unwrap() - 66.0).abs() < 1e-9
                && found[0].relative_change == Some(0.1)
        );
        assert_eq!((found[1].twin, found[1].predicted), (None, None));
    }
}
