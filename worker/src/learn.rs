//! A law file from finite-element beats: what organs taught about the organ's law.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use cardiotwin_calibrate::cohort_law::{LawOrgan, learn};
use cardiotwin_calibrate::organ_law::{LawPrior, fit_law, shipped_prior};
use cardiotwin_input_files::MaxBytes;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::organ_law::{LawFile, LawLesson, LawTeacher, LessonBeat};
use cardiotwin_schemas::outcome::{Ending, TaskOutcome, TaskResult};
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};

use crate::error::TaskError;
use crate::provenance::VERSION;
use crate::tasks::surrogate::{features, law_wall, learnable_beats};

/// Learns a law from the directories of published finite-element beats. Directories of other beats
/// are left out.
///
/// - `beats`: patient and directory of each beat, oldest first
/// - `prior`: law file from which learning starts; `None` for the law of the program
///
/// # Errors
/// [`TaskError`] if a file cannot be read or its content cannot be used.
pub fn law_file(beats: &[(String, PathBuf)], prior: Option<&Path>) -> Result<LawFile, TaskError> {
    // Beats of one patient in different passive states are different organs.
    let mut organs: BTreeMap<(String, String), LawLesson> = BTreeMap::new();
    for (patient, directory) in beats {
        if let Some((hash, organ)) = read_beat(patient, directory)? {
            match organs.entry((patient.clone(), hash)) {
                Entry::Vacant(place) => {
                    place.insert(organ);
                }
                Entry::Occupied(mut known) => known.get_mut().beats.extend(organ.beats),
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
    let lessons: Vec<LawLesson> = organs.into_values().collect();
    let (organs, prior) = learned(&lessons, &before)?;
    Ok(LawFile {
        schema_version: formats::LAW.version,
        program: VERSION.to_owned(),
        learned_from,
        organs,
        prior,
    })
}

/// The law that organs teach, with the errors of its pressure before and after. The order of the
/// organs counts by rounding alone.
///
/// # Errors
/// [`TaskError`] if samples or figures cannot be used.
pub fn learned(
    lessons: &[LawLesson],
    before: &LawPrior,
) -> Result<(Vec<LawTeacher>, LawPrior), TaskError> {
    let organs: Vec<LawOrgan> = lessons
        .iter()
        .map(|lesson| {
            Ok(LawOrgan {
                passive: law_wall(&lesson.figures)?,
                features: features(&lesson.figures),
                beats: learnable_beats(
                    &lesson.cell_stretch,
                    lesson.beats.iter().map(|beat| &beat.samples),
                ),
            })
        })
        .collect::<Result<_, TaskError>>()?;
    let after = learn(before, &organs)?;
    let teachers = lessons
        .iter()
        .zip(&organs)
        .map(|(lesson, organ)| {
            Ok(LawTeacher {
                patient: lesson.patient.clone(),
                beats: lesson.beats.iter().map(|b| b.task.to_string()).collect(),
                pressure_error_before_mmhg: pressure_error_mmhg(organ, before)?,
                pressure_error_after_mmhg: pressure_error_mmhg(organ, &after)?,
            })
        })
        .collect::<Result<_, TaskError>>()?;
    Ok((teachers, after))
}

fn read(path: &Path) -> Result<Vec<u8>, TaskError> {
    cardiotwin_input_files::read(path, MaxBytes::MESH).map_err(|source| TaskError::LawBeat {
        path: path.to_owned(),
        source,
    })
}

/// Hash of a beat's ventricle, and the organ with this beat; `None` for a beat without samples.
fn read_beat(patient: &str, directory: &Path) -> Result<Option<(String, LawLesson)>, TaskError> {
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
    let organ_of_beat = LawLesson {
        patient: patient.to_owned(),
        figures: organ.figures,
        cell_stretch: beat.cell_stretch,
        beats: vec![LessonBeat {
            task: outcome.attempt.task,
            samples,
        }],
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
