//! Errors of candidates for the organ's law on beats that they have not seen.
//!
//! `organ-law-errors NAME=RUN…`: each RUN is the folder of a finished run with finite-element
//! ventricles (`COHORT/run`), NAME its row in the table. A candidate gets the volumes and active
//! stresses of a beat and says its pressures and mean stretches, at the 80 samples that every beat
//! writes. Each beat of a patient is left out once and predicted from the patient's other beats,
//! from its first beat, or from other patients alone.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use cardiotwin_calibrate::cohort_law::{LawOrgan, learn};
use cardiotwin_calibrate::organ_law::{LawBeat, LawPrior, OrganFeatures, fit_law, shipped_prior};
use cardiotwin_models::ventricle::{OneFibrePassive, OrganLaw};
use cardiotwin_schemas::finite_element::VentricleFigures;
use cardiotwin_schemas::organ::{CellStretch, OrganSpec, StretchOrigin};
use cardiotwin_schemas::organ_law::LawSamples;
use cardiotwin_schemas::outcome::{Ending, TaskOutcome, TaskResult};
use cardiotwin_schemas::task::{AttemptSpec, OrganBeatSpec, TaskSpec};
use cardiotwin_worker::tasks::surrogate::{features, law_wall, learnable_beats};
use nalgebra::{DMatrix, DVector};

/// Share of the largest singular value below which a direction of a regression is left out.
const RANK: f64 = 1e-9;

/// A patient with its beats, in the order in which they were simulated.
struct Patient {
    wall: OneFibrePassive,
    features: OrganFeatures,
    beats: Vec<Beat>,
}

struct Beat {
    samples: LawSamples,
    cell_stretch: CellStretch,
    step_ms: f64,
    started: String,
}

/// Pressures \[mmHg\] and mean stretches of the cells at the volumes and stresses of a beat.
type Said = [Vec<f64>; 2];

/// Errors of one prediction.
struct Errors {
    pressure_rms_mmhg: f64,
    /// Largest pressure, and largest and smallest rate of the pressure, in percent.
    percent: [f64; 3],
    stretch_rms: f64,
}

fn main() -> anyhow::Result<()> {
    println!(
        "| hearts | law | learned from | beats | P, rms mmHg | P_max, % | dPdt_max, % | dPdt_min, % | stretch, rms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for argument in std::env::args().skip(1) {
        let (name, run) = argument
            .split_once('=')
            .with_context(|| format!("expected NAME=RUN, found {argument}"))?;
        print_rows(name, &patients(Path::new(run))?)?;
    }
    Ok(())
}

fn print_rows(name: &str, patients: &[Patient]) -> anyhow::Result<()> {
    ensure!(
        !patients.is_empty(),
        "{name}: no beat of a finite-element ventricle"
    );
    let prior = shipped_prior();
    let ours = |patient: &Patient, taught: &[&Beat], prior: &LawPrior, beat: &Beat| {
        let beats = told(taught.iter().copied());
        let law = fit_law(&patient.wall, &patient.features, &beats, prior)?;
        Ok(in_law(&law, &patient.wall, beat))
    };
    type Predict<'a> = dyn Fn(usize, &Patient, &[&Beat], &Beat) -> anyhow::Result<Said> + 'a;
    let one_factor = |_: usize, patient: &Patient, taught: &[&Beat], beat: &Beat| {
        Ok(one_fibre(&[(patient.wall, taught)], &patient.wall, beat))
    };
    let one_factor_of_others = |i: usize, patient: &Patient, _: &[&Beat], beat: &Beat| {
        let others: Vec<(OneFibrePassive, Vec<&Beat>)> = others(patients, i)
            .map(|other| (other.wall, other.beats.iter().collect()))
            .collect();
        let others: Vec<(OneFibrePassive, &[&Beat])> = others
            .iter()
            .map(|(wall, beats)| (*wall, &beats[..]))
            .collect();
        Ok(one_fibre(&others, &patient.wall, beat))
    };
    let of_polynomial =
        |_: usize, _: &Patient, taught: &[&Beat], beat: &Beat| Ok(polynomial(taught, beat));
    let of_law = |_: usize, patient: &Patient, taught: &[&Beat], beat: &Beat| {
        ours(patient, taught, &prior, beat)
    };
    let of_prior =
        |_: usize, patient: &Patient, _: &[&Beat], beat: &Beat| ours(patient, &[], &prior, beat);
    let of_cohort = |i: usize, patient: &Patient, _: &[&Beat], beat: &Beat| {
        let organs: Vec<LawOrgan<'_>> = others(patients, i).map(Patient::as_teacher).collect();
        ours(patient, &[], &learn(&prior, &organs)?, beat)
    };
    let rows: [(&str, &str, &Predict<'_>); 8] = [
        (
            "one fibre, one factor",
            "other patients",
            &one_factor_of_others,
        ),
        ("organ's law", "development patients", &of_prior),
        ("organ's law", "these and other patients", &of_cohort),
        ("one fibre, one factor", "first beat", &one_factor),
        ("polynomial", "first beat", &of_polynomial),
        ("organ's law", "first beat", &of_law),
        ("polynomial", "other beats", &of_polynomial),
        ("organ's law", "other beats", &of_law),
    ];
    for (law, from, predict) in rows {
        let mut found = Vec::new();
        for (i, patient) in patients.iter().enumerate() {
            for (k, beat) in patient.beats.iter().enumerate() {
                let beats = patient.beats.iter().enumerate();
                let rest: Vec<&Beat> = beats.filter(|(j, _)| *j != k).map(|(_, b)| b).collect();
                let is_alone = rest.is_empty();
                let taught = match from {
                    "first beat" => vec![&patient.beats[0]],
                    _ => rest,
                };
                let needs_own = from == "first beat" || from == "other beats";
                let is_own = from == "first beat" && k == 0;
                let lacks_others = from.contains("other patients") && patients.len() < 2;
                if is_own || lacks_others || needs_own && is_alone {
                    continue;
                }
                found.push(errors(&predict(i, patient, &taught, beat)?, beat));
            }
        }
        if found.is_empty() {
            continue;
        }
        let cell = |value: &dyn Fn(&Errors) -> f64, digits: usize| {
            let all: Vec<f64> = found.iter().map(|errors| value(errors).abs()).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            let worst = all.iter().copied().fold(0.0, f64::max);
            format!("{mean:.digits$} ({worst:.digits$})")
        };
        println!(
            "| {name} | {law} | {from} | {} | {} | {} | {} | {} | {} |",
            found.len(),
            cell(&|e| e.pressure_rms_mmhg, 2),
            cell(&|e| e.percent[0], 1),
            cell(&|e| e.percent[1], 1),
            cell(&|e| e.percent[2], 1),
            cell(&|e| e.stretch_rms, 4),
        );
    }
    Ok(())
}

fn others(patients: &[Patient], i: usize) -> impl Iterator<Item = &Patient> {
    let others = patients.iter().enumerate().filter(move |(j, _)| *j != i);
    others.map(|(_, patient)| patient)
}

impl Beat {
    /// Slack stretch of the cells over that of the unloaded wall; `None` if their stretch is counted
    /// from end-diastole.
    fn slack(&self) -> Option<f64> {
        (self.cell_stretch.origin == StretchOrigin::Unloaded)
            .then_some(self.cell_stretch.slack_stretch)
    }

    /// Volumes with their stresses.
    fn states(&self) -> impl Iterator<Item = (f64, f64)> {
        let stresses = self.samples.active_stress_kpa.iter().copied();
        self.samples.volume_ml.iter().copied().zip(stresses)
    }
}

/// Beats as the fit of a law takes them.
fn told<'a>(beats: impl Iterator<Item = &'a Beat>) -> Vec<LawBeat<'a>> {
    beats
        .flat_map(|beat| learnable_beats(&beat.cell_stretch, std::iter::once(&beat.samples)))
        .collect()
}

impl Patient {
    fn as_teacher(&self) -> LawOrgan<'_> {
        LawOrgan {
            passive: self.wall,
            features: self.features,
            beats: told(self.beats.iter()),
        }
    }
}

/// The organ's law in a beat, without the response of the stretch to differences of stress.
fn in_law(law: &OrganLaw, wall: &OneFibrePassive, beat: &Beat) -> Said {
    let slack = beat
        .slack()
        .unwrap_or_else(|| law.end_diastolic_stretch(wall));
    let (mut pressures, mut stretches) = (Vec::new(), Vec::new());
    for ((volume_ml, stress_kpa), difference_kpa) in
        beat.states().zip(&beat.samples.stress_deviation_kpa)
    {
        pressures.push(law.pressure(wall, volume_ml, stress_kpa).value);
        let (own, row) = OrganLaw::stretch_row(wall, volume_ml, stress_kpa, *difference_kpa);
        let corrections = row.iter().zip(&law.stretch).map(|(a, b)| a * b);
        stretches.push((own + corrections.sum::<f64>()) / slack);
    }
    [pressures, stretches]
}

/// The one-fibre ventricle with one factor of the active stress.
fn one_fibre(taught: &[(OneFibrePassive, &[&Beat])], wall: &OneFibrePassive, beat: &Beat) -> Said {
    // Passive pressure, and pressure per active stress; the third coefficient's term is T.
    let terms = |wall: &OneFibrePassive, volume_ml: f64, stress_kpa: f64| {
        let (passive, row) = OrganLaw::pressure_row(wall, volume_ml, stress_kpa);
        (passive, row[2])
    };
    let (mut product, mut square) = (0.0, 0.0);
    for (wall, beats) in taught {
        for beat in *beats {
            for ((volume_ml, stress_kpa), pressure) in
                beat.states().zip(&beat.samples.pressure_mmhg)
            {
                let (passive, active) = terms(wall, volume_ml, stress_kpa);
                product += active * (pressure - passive);
                square += active * active;
            }
        }
    }
    let factor = product / square;
    let slack = beat.slack().unwrap_or(1.0);
    let said = beat.states().map(|(volume_ml, stress_kpa)| {
        let (passive, active) = terms(wall, volume_ml, stress_kpa);
        let (stretch, _) = OrganLaw::stretch_row(wall, volume_ml, stress_kpa, 0.0);
        (passive + factor * active, stretch / slack)
    });
    let (pressures, stretches) = said.unzip();
    [pressures, stretches]
}

/// Cubic polynomials of the volume, without and times the stress, and a linear one times its square.
fn polynomial(taught: &[&Beat], beat: &Beat) -> Said {
    let reference_ml = taught[0].samples.volume_ml[0];
    let row = |(volume_ml, stress_kpa): (f64, f64)| -> [f64; 10] {
        let x = volume_ml / reference_ml - 1.0;
        let cubic = |k: usize| x.powi((k % 4) as i32);
        std::array::from_fn(|k| match k {
            0..4 => cubic(k),
            4..8 => stress_kpa * cubic(k),
            8 => stress_kpa * stress_kpa,
            _ => stress_kpa * stress_kpa * x,
        })
    };
    let rows: Vec<[f64; 10]> = taught
        .iter()
        .flat_map(|beat| beat.states().map(row))
        .collect();
    let matrix = DMatrix::from_fn(rows.len(), 10, |i, j| rows[i][j]);
    let decomposed = matrix.svd(true, true);
    let threshold = RANK * decomposed.singular_values.max();
    let solve = |values: Vec<f64>| {
        let found = decomposed.solve(&DVector::from_vec(values), threshold);
        found.unwrap_or_else(|_| DVector::zeros(10))
    };
    let of = |quantity: fn(&LawSamples) -> &Vec<f64>| -> Vec<f64> {
        let values = taught
            .iter()
            .flat_map(|beat| quantity(&beat.samples).clone());
        let coefficients = solve(values.collect());
        let said = |state| {
            row(state)
                .iter()
                .zip(&coefficients)
                .map(|(a, b)| a * b)
                .sum()
        };
        beat.states().map(said).collect()
    };
    [of(|s| &s.pressure_mmhg), of(|s| &s.stretch)]
}

fn errors([pressures, stretches]: &Said, beat: &Beat) -> Errors {
    let rms = |said: &[f64], true_values: &[f64]| {
        let squares = said.iter().zip(true_values).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / said.len() as f64).sqrt()
    };
    let percent = |found: f64, expected: f64| 100.0 * (found / expected - 1.0);
    let largest = |values: &[f64]| values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let rates = |values: &[f64]| -> Vec<f64> {
        let differences = values
            .windows(3)
            .map(|w| (w[2] - w[0]) / (2.0 * beat.step_ms));
        differences.collect()
    };
    let smallest = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
    let truth = &beat.samples.pressure_mmhg;
    let (said, expected) = (rates(pressures), rates(truth));
    Errors {
        pressure_rms_mmhg: rms(pressures, truth),
        percent: [
            percent(largest(pressures), largest(truth)),
            percent(largest(&said), largest(&expected)),
            percent(smallest(&said), smallest(&expected)),
        ],
        stretch_rms: rms(stretches, &beat.samples.stretch),
    }
}

/// Patients of a run; a patient is a passive state.
fn patients(run: &Path) -> anyhow::Result<Vec<Patient>> {
    let mut found: BTreeMap<PathBuf, Patient> = BTreeMap::new();
    let attempts = run.join("attempts");
    let listed = |folder: &Path| -> anyhow::Result<Vec<PathBuf>> {
        let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
        entries.map(|entry| Ok(entry?.path())).collect()
    };
    for shard in listed(&attempts)? {
        for attempt in listed(&shard)? {
            if let Some((ventricle, figures, beat)) = beat_in(&attempt)? {
                let patient = match found.entry(ventricle) {
                    std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
                    std::collections::btree_map::Entry::Vacant(entry) => {
                        entry.insert(patient(&figures)?)
                    }
                };
                patient.beats.push(beat);
            }
        }
    }
    let mut patients: Vec<Patient> = found.into_values().collect();
    for patient in &mut patients {
        patient.beats.sort_by(|a, b| a.started.cmp(&b.started));
    }
    Ok(patients)
}

fn patient(figures: &VentricleFigures) -> anyhow::Result<Patient> {
    Ok(Patient {
        wall: law_wall(figures)?,
        features: features(figures),
        beats: Vec::new(),
    })
}

/// The finite-element beat of an attempt, with the file and the figures of its ventricle; `None`
/// for another task, or one that failed.
fn beat_in(attempt: &Path) -> anyhow::Result<Option<(PathBuf, VentricleFigures, Beat)>> {
    let read = |name: &str| std::fs::read_to_string(attempt.join(name)).ok();
    let (Some(spec), Some(outcome)) = (read("spec.json"), read("outcome.json")) else {
        return Ok(None);
    };
    let spec: AttemptSpec = serde_json::from_str(&spec)?;
    let TaskSpec::OrganBeat(spec) = spec.task else {
        return Ok(None);
    };
    let OrganBeatSpec {
        organ: OrganSpec::FiniteElement(organ),
        cell_stretch,
        cycle_length_ms,
        ..
    } = *spec
    else {
        return Ok(None);
    };
    let outcome: TaskOutcome = serde_json::from_str(&outcome)?;
    let Ending::Succeeded { result } = outcome.ending else {
        return Ok(None);
    };
    let TaskResult::OrganBeat(result) = *result else {
        return Ok(None);
    };
    Ok(result.law.map(|samples| {
        let beat = Beat {
            step_ms: cycle_length_ms / samples.volume_ml.len() as f64,
            samples,
            cell_stretch,
            started: outcome.provenance.started,
        };
        (organ.ventricle.path, organ.figures, beat)
    }))
}
