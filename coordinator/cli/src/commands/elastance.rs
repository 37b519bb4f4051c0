//! `cardiotwin elastance`: how stiff twins are against another load, next to their own recordings and
//! to human hearts.

use std::path::{Path, PathBuf};

use cardiotwin_engine::find_worker;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_signals::elastance::normal::{
    ELASTANCE_MMHG_PER_ML, NormalValue, PRELOAD_RECRUITABLE_STROKE_WORK_MMHG,
};
use cardiotwin_signals::elastance::single_beat::Recording;
use cardiotwin_signals::elastance::summary::{
    LineValues, Outcome, SingleBeatElastance, TwinElastance,
};
use cardiotwin_signals::elastance::{Beat, BeatError};
use cardiotwin_signals::resample::{STEP, resample};
use cardiotwin_signals::{Continuation, Quantity, Trace, noise_windows, read_trace};
use cardiotwin_units::Ms;
use clap::Args;
use serde::Serialize;

use crate::commands::predict::beat::simulate;
use crate::commands::predict::indices::Traces;
use crate::commands::predict::law_file::LawKnowledgeFile;
use crate::commands::predict::{no_twin, with_twin};
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::OfCohort;
use crate::table::{Columns, number, optional};
use crate::talk::Talk;
use crate::ventricle::{PERIODIC, Ventricle};

/// Factors on the filling pressure of the virtual loads for the lines, as an occlusion of the vena cava
/// makes them; the first is rest.
const FILLINGS: [f64; 3] = [1.0, 0.85, 0.7];
/// Factors on the peripheral resistance of further loads, for the internal resistance.
const RESISTANCES: [f64; 2] = [0.75, 1.25];

/// Show how stiff twins are against load: end-systolic elastance, stroke work, internal resistance
#[derive(Debug, Args)]
#[command(
    after_help = "Each twin beats until the periodic state, in the organ's law or the one-fibre ventricle: at rest and \
                  at 85 and 70 % of its filling pressure for Ees and PRSW, and at 75 and 125 % of its peripheral \
                  resistance for the internal resistance.\n\
                  The last columns estimate Ees from the patient's own beat at rest, without the twin."
)]
pub struct ElastanceArgs {
    /// Patient of the twin [default: every patient with a twin]
    patient: Option<String>,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    #[command(flatten)]
    of: OfCohort,
}

/// Elastance of one patient.
#[derive(Debug, Serialize)]
struct PatientElastance {
    patient: String,
    twin: TwinElastance,
    /// Estimates from the recording, or why there are none.
    recording: Outcome<SingleBeatElastance>,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    /// Values of human hearts: elastance (mmHg/mL), slope of preload-recruitable stroke work (mmHg).
    elastance_of_people: NormalValue,
    stroke_work_of_people: NormalValue,
    patients: &'a [PatientElastance],
}

/// Simulates the virtual loads and prints the table.
///
/// # Errors
/// [`CliError::Usage`] without a twin, [`CliError::Simulation`] for a beat that diverges,
/// [`CliError::Worker`] if the worker cannot be run.
pub async fn execute(args: &ElastanceArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let worker = find_worker(args.worker.as_deref())?;
    let patients = match &args.patient {
        Some(patient) => vec![patient.clone()],
        None => with_twin(&folders).await?,
    };
    if patients.is_empty() {
        return Err(no_twin());
    }
    let mut found = Vec::new();
    for patient in patients {
        let ventricle = Ventricle::of_run(&folders, &patient, "elastance").await?;
        found.push(PatientElastance {
            twin: of_twin(&ventricle, &worker)?,
            recording: of_recording(&ventricle),
            patient,
        });
    }
    if args.json {
        talk.json(&Answer {
            schema_version: formats::ELASTANCE.version,
            elastance_of_people: ELASTANCE_MMHG_PER_ML,
            stroke_work_of_people: PRELOAD_RECRUITABLE_STROKE_WORK_MMHG,
            patients: &found,
        })?;
    } else {
        talk.data(&screen(&found, talk))?;
    }
    let whole = found.iter().all(|one| {
        matches!(one.twin.end_systolic_line, Outcome::Found(_))
            && matches!(one.twin.preload_recruitable_stroke_work, Outcome::Found(_))
    });
    Ok(if whole { Exit::Ok } else { Exit::Problems })
}

/// Elastance of the twin from its beats at the virtual loads.
fn of_twin(ventricle: &Ventricle, worker: &Path) -> Result<TwinElastance, CliError> {
    let law = LawKnowledgeFile::of(ventricle)?;
    let asked = LawKnowledgeFile::asked(law.as_ref());
    let rest = ventricle.beat_of_twin("elastance", PERIODIC)?;
    let beat = |filling: f64, resistance: f64| {
        let mut spec = rest.clone();
        spec.circulation.left_atrial_pressure_mmhg *= filling;
        spec.circulation
            .afterload
            .peripheral_resistance_mmhg_s_per_ml *= resistance;
        let (_, traces) = simulate(&spec, asked, worker)?;
        simulated(&Traces::of(&traces), &spec).map_err(|problem| {
            let patient = &ventricle.plan.id;
            let message = format!(
                "{patient}, filling pressure times {filling}, peripheral resistance times {resistance}: {problem}"
            );
            CliError::Simulation { message }
        })
    };
    let beats: Result<Vec<Beat>, CliError> = FILLINGS
        .map(|factor| beat(factor, 1.0))
        .into_iter()
        .collect();
    let others: Result<Vec<Beat>, CliError> = RESISTANCES
        .map(|factor| beat(1.0, factor))
        .into_iter()
        .collect();
    Ok(TwinElastance::of(&beats?, &others?))
}

/// The beat of simulated traces. A sample at the end of the cycle is that of the next beat.
fn simulated(traces: &Traces, spec: &OrganBeatSpec) -> Result<Beat, String> {
    let time = traces.column("time_ms");
    let n = time.partition_point(|t| *t < spec.cycle_length_ms - 1e-6);
    let trace = |quantity, name| {
        let values = traces.column(name).iter().take(n).copied().collect();
        Trace::new(quantity, time[..n].to_vec(), values).map_err(|error| error.to_string())
    };
    let continuation = Continuation::periodic(Ms(spec.cycle_length_ms));
    let pressure = trace(Quantity::Pressure, "pressure_mmHg")?;
    let volume = trace(Quantity::Volume, "volume_mL")?;
    Beat::of(&pressure, &volume, continuation).map_err(|error| error.to_string())
}

/// Estimates of Ees from the patient's own pressure and volume.
fn of_recording(ventricle: &Ventricle) -> Outcome<SingleBeatElastance> {
    let none = |reason: &str| Outcome::None {
        reason: reason.to_owned(),
    };
    let measured = &ventricle.plan.step0;
    let (Some(pressure), Some(volume)) = (&measured.pressure, &measured.volume) else {
        return none("they need a measured pressure and volume trace");
    };
    if !measured.corrections.is_empty() {
        return none("the traces have accepted corrections");
    }
    let read = |path: &Path, quantity| read_trace(path, quantity).trace;
    let (Some(pressure), Some(volume)) = (
        read(&pressure.path, Quantity::Pressure),
        read(&volume.path, Quantity::Volume),
    ) else {
        return none("the traces cannot be read any more");
    };
    match beat_of_recording(&pressure, &volume, Ms(measured.cycle_length_ms)) {
        Ok(beat) => Outcome::Found(SingleBeatElastance::of(&Recording {
            beat: &beat,
            qrs_begins_ms: None,
            arterial_systolic_mmhg: measured.aortic_systolic_mmhg,
            arterial_diastolic_mmhg: measured.aortic_diastolic_mmhg,
        })),
        Err(error) => none(&error.to_string()),
    }
}

/// A measured beat over the windows that its noise asks for.
fn beat_of_recording(pressure: &Trace, volume: &Trace, cycle: Ms) -> Result<Beat, BeatError> {
    let continuation = Continuation::periodic(cycle);
    let every_ms = resample(pressure, continuation, STEP)?;
    let windows = noise_windows::of(Some(&every_ms), Some(volume), continuation);
    Beat::over(pressure, volume, continuation, windows)
}

fn value<T>(outcome: &Outcome<T>) -> Option<&T> {
    match outcome {
        Outcome::Found(value) => Some(value),
        Outcome::None { .. } => None,
    }
}

fn screen(found: &[PatientElastance], talk: &Talk) -> String {
    let mut table = Columns::new(
        talk,
        &[
            "PATIENT",
            ">EES mmHg/mL",
            ">Z",
            ">V0 mL",
            ">PRSW mmHg",
            ">Z",
            ">INTERNAL RESISTANCE mmHg s/mL",
            ">EA mmHg/mL",
            ">RECORDING: ISOVOLUMIC",
            ">BILINEAR",
        ],
    );
    for one in found {
        let line = value(&one.twin.end_systolic_line);
        let work = value(&one.twin.preload_recruitable_stroke_work);
        let of = |line: Option<&LineValues>, get: fn(&LineValues) -> f64| optional(line.map(get));
        let z = |line: Option<&LineValues>| {
            line.map_or_else(
                || "-".to_owned(),
                |line| format!("{:+.1}", line.slope_z_score),
            )
        };
        let recording = value(&one.recording);
        let estimate = |get: fn(&SingleBeatElastance) -> &Outcome<f64>| {
            optional(recording.and_then(|own| value(get(own))).copied())
        };
        table.row([
            one.patient.clone(),
            of(line, |line| line.slope),
            z(line),
            of(line, |line| line.intercept_ml),
            of(work, |work| work.slope),
            z(work),
            optional(value(&one.twin.internal_resistance_mmhg_s_per_ml).copied()),
            optional(value(&one.twin.arterial_elastance_mmhg_per_ml).copied()),
            estimate(|own| &own.isovolumic_maximum),
            estimate(|own| &own.bilinear),
        ]);
    }
    let mut text = table.text();
    for (name, people) in [
        ("Ees", ELASTANCE_MMHG_PER_ML),
        ("PRSW", PRELOAD_RECRUITABLE_STROKE_WORK_MMHG),
    ] {
        text += &format!(
            "{name} of {} people: {} ± {} ({})\n",
            people.n_people,
            number(people.mean),
            number(people.standard_deviation),
            people.source
        );
    }
    for one in found {
        for reason in reasons(one) {
            text += &format!("{}: {reason}\n", one.patient);
        }
    }
    text
}

/// Why values of the table are missing, each reason once.
fn reasons(one: &PatientElastance) -> Vec<String> {
    let mut said: Vec<String> = Vec::new();
    let mut say = |what: &str, reason: &String| said.push(format!("no {what}: {reason}"));
    let lines = [
        ("Ees", &one.twin.end_systolic_line),
        ("PRSW", &one.twin.preload_recruitable_stroke_work),
    ];
    for (what, line) in lines {
        if let Outcome::None { reason } = line {
            say(what, reason);
        }
    }
    if let Outcome::Found(resistance) = &one.twin.internal_resistance_mmhg_s_per_ml
        && *resistance < 0.0
    {
        say(
            "internal resistance",
            &"below 0 it is no loss of pressure: the line's V0 is off, or the wall's stress differs \
              between the loads"
                .to_owned(),
        );
    }
    if let Outcome::None { reason } = &one.recording {
        say("estimates from the recording", reason);
    }
    if let Outcome::Found(own) = &one.recording {
        for (what, estimate) in [
            ("isovolumic estimate", &own.isovolumic_maximum),
            ("bilinear estimate", &own.bilinear),
        ] {
            if let Outcome::None { reason } = estimate {
                say(what, reason);
            }
        }
    }
    said
}
