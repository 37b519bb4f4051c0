//! A law file from finite-element beats: what organs taught about the organ's law.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use cardiotwin_calibrate::cohort_law::{LawOrgan, learn};
use cardiotwin_calibrate::organ_law::{LawPrior, fit_law, shipped_prior};
use cardiotwin_input_files::MaxBytes;
use cardiotwin_schemas::finite_element::VentricleFigures;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::organ::{CellStretch, OrganSpec};
use cardiotwin_schemas::organ_law::{LawFile, LawSamples, LawTeacher};
use cardiotwin_schemas::outcome::{Ending, TaskOutcome, TaskResult};
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};

use crate::error::TaskError;
use crate::provenance::VERSION;
use crate::tasks::proposal::{features, law_wall, learnable_beats};

/// Beats of one organ. Beats of one patient in different passive states are different organs.
struct Organ {
    patient: String,
    figures: VentricleFigures,
    cell_stretch: CellStretch,
    keys: Vec<String>,
    beats: Vec<LawSamples>,
}

/// Learns a law from the directories of published finite-element beats. Directories of other beats
/// are left out.
///
/// - `beats`: patient and directory of each beat, oldest first
/// - `prior`: law file from which learning starts; `None` for the law of the program
///
/// # Errors
/// [`TaskError`] if a file cannot be read or its content cannot be used.
pub fn law_file(beats: &[(String, PathBuf)], prior: Option<&Path>) -> Result<LawFile, TaskError> {
    let mut organs: BTreeMap<(String, String), Organ> = BTreeMap::new();
    for (patient, directory) in beats {
        if let Some((hash, organ)) = read_beat(patient, directory)? {
            match organs.entry((patient.clone(), hash)) {
                Entry::Vacant(place) => {
                    place.insert(organ);
                }
                Entry::Occupied(mut known) => {
                    known.get_mut().keys.extend(organ.keys);
                    known.get_mut().beats.extend(organ.beats);
                }
            }
        }
    }
    let (before, learned_from) = match prior {
        None => (shipped_prior(), None),
        Some(path) => {
            let bytes = read(path)?;
            let file: LawFile = formats::LAW.read(&path.display(), &bytes)?;
            (file.prior, Some(sha256_hex(&bytes)))
        }
    };
    let lessons: Vec<LawOrgan> = organs
        .values()
        .map(|organ| {
            Ok(LawOrgan {
                passive: law_wall(&organ.figures)?,
                features: features(&organ.figures),
                beats: learnable_beats(&organ.cell_stretch, &organ.beats),
            })
        })
        .collect::<Result<_, TaskError>>()?;
    let after = learn(&before, &lessons)?;
    let teachers = organs
        .values()
        .zip(&lessons)
        .map(|(organ, lesson)| {
            Ok(LawTeacher {
                patient: organ.patient.clone(),
                beats: organ.keys.clone(),
                pressure_error_before_mmhg: pressure_error_mmhg(lesson, &before)?,
                pressure_error_after_mmhg: pressure_error_mmhg(lesson, &after)?,
            })
        })
        .collect::<Result<_, TaskError>>()?;
    Ok(LawFile {
        schema_version: formats::LAW.version,
        program: VERSION.to_owned(),
        learned_from,
        organs: teachers,
        prior: after,
    })
}

fn read(path: &Path) -> Result<Vec<u8>, TaskError> {
    cardiotwin_input_files::read(path, MaxBytes::MESH).map_err(|source| TaskError::LawBeat {
        path: path.to_owned(),
        source,
    })
}

/// Hash of a beat's ventricle, and the organ with this beat; `None` for a beat without samples.
fn read_beat(patient: &str, directory: &Path) -> Result<Option<(String, Organ)>, TaskError> {
    let path = directory.join("spec.json");
    let spec: AttemptSpec = formats::SPEC.read(&path.display(), &read(&path)?)?;
    let path = directory.join("outcome.json");
    let outcome: TaskOutcome = formats::OUTCOME.read(&path.display(), &read(&path)?)?;
    let TaskSpec::OrganBeat(beat) = spec.task else {
        return Ok(None);
    };
    let OrganSpec::FiniteElement(organ) = &beat.organ else {
        return Ok(None);
    };
    let Ending::Succeeded { result } = outcome.ending else {
        return Ok(None);
    };
    let TaskResult::OrganBeat(result) = *result else {
        return Ok(None);
    };
    let Some(samples) = result.law else {
        return Ok(None);
    };
    let organ_of_beat = Organ {
        patient: patient.to_owned(),
        figures: organ.figures,
        cell_stretch: beat.cell_stretch,
        keys: vec![outcome.attempt.task.to_string()],
        beats: vec![samples],
    };
    Ok(Some((organ.ventricle.sha256.clone(), organ_of_beat)))
}

/// Root mean square of the pressure's error in the law before an organ's first beat \[mmHg\].
fn pressure_error_mmhg(organ: &LawOrgan<'_>, prior: &LawPrior) -> Result<f64, TaskError> {
    let law = fit_law(&organ.passive, &organ.features, &[], prior)?;
    let errors = organ.beats.iter().flat_map(|beat| {
        let samples = beat.volume_ml.iter().zip(beat.stress_kpa);
        samples
            .zip(beat.pressure_mmhg)
            .map(|((volume, stress), pressure)| {
                law.pressure(&organ.passive, *volume, *stress).value - pressure
            })
    });
    let (sum, n) = errors.fold((0.0, 0.0), |(sum, n), error| (sum + error * error, n + 1.0));
    Ok((sum / f64::max(n, 1.0)).sqrt())
}
