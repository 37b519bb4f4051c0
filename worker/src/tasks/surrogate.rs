//! The ventricle that takes an organ's place where beats must be quick: the one-fibre ventricle, or the one
//! with the organ's law.

use std::sync::Arc;

use cardiotwin_calibrate::organ_law::{LawBeat, LawPrior, OrganFeatures, fit_law, shipped_prior};
use cardiotwin_models::cell0d::CellSolverSettings;
use cardiotwin_models::ventricle::PassiveLaw as _;
use cardiotwin_models::ventricle::passive_state::DEFAULT_EXPONENT;
use cardiotwin_schemas::finite_element::VentricleFigures;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::organ::{
    ActivationSpec, CellStretch, OneFibrePassive, OrganSpec, StretchOrigin,
};
use cardiotwin_schemas::organ_law::{LawFile, LawKnowledge, LawSamples};
use cardiotwin_schemas::settings::{ActivationSettings, SolverSettings};
use cardiotwin_schemas::task::{InputFile, OrganBeatSpec};
use cardiotwin_units::{Ml, Mmhg};

use crate::error::TaskError;
use crate::inputs::read_verified;
use crate::tasks::organ_beat::models::ReducedOrgan;

/// Delay of the mean activation behind the middle of the spread, over the spread. Measured on
/// generated meshes: 2.4 ± 0.3 ms of twelve development patients.
const ACTIVATION_DELAY: f64 = 0.045;

/// Accuracy of the cell from which a beat in the organ's law starts. A search with it ended at the
/// misfit of the default accuracy to eight digits (docs/measurements/step3.md#descents-in-the-law).
const CELL_SOLVER: CellSolverSettings = CellSolverSettings {
    tolerance: 3e-4,
    periodic_tolerance: 1e-4,
    max_beats: 60,
    max_steps_per_beat: 20_000,
};

/// The beat without the budget of a finite-element ventricle, which does not apply to a reduced one.
pub(crate) fn with_reduced_budget(beat: &OrganBeatSpec) -> OrganBeatSpec {
    let SolverSettings {
        newton_iterations,
        shortest_step_ms,
        ..
    } = SolverSettings::default();
    OrganBeatSpec {
        newton_iterations,
        shortest_step_ms,
        finite_element: None,
        ..beat.clone()
    }
}

/// The beat as a search simulates it: the budget for a finite-element ventricle's steps says nothing
/// about those of its law.
pub(crate) fn searched(beat: &OrganBeatSpec) -> OrganBeatSpec {
    match beat.organ {
        OrganSpec::FiniteElement(_) => with_reduced_budget(beat),
        OrganSpec::Reduced { .. } | OrganSpec::External(_) => beat.clone(),
    }
}

/// The one-fibre ventricle of the organ, or the one with a finite-element ventricle's volumes,
/// pressure and activation.
pub(crate) fn one_fibre(organ: &OrganSpec) -> Result<ReducedOrgan, TaskError> {
    let (passive, activation) = match organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => (*passive, *activation),
        OrganSpec::External(organ) => (organ.passive, organ.activation),
        OrganSpec::FiniteElement(organ) => {
            let figures = &organ.figures;
            let passive = one_fibre_of(figures, DEFAULT_EXPONENT)?;
            let groups = ActivationSettings::default().groups;
            let activation = ActivationSpec {
                spread_ms: figures.spread_ms,
                groups,
                onset_ms: figures.onset_ms,
            };
            (passive, activation)
        }
    };
    Ok(ReducedOrgan::one_fibre(passive, activation))
}

/// The one-fibre wall with a finite-element ventricle's volumes and pressure.
fn one_fibre_of(figures: &VentricleFigures, exponent: f64) -> Result<OneFibrePassive, TaskError> {
    OneFibrePassive::through(
        Ml(figures.unloaded_volume_ml),
        Ml(figures.end_diastolic_volume_ml),
        Mmhg(figures.end_diastolic_pressure_mmhg),
        Ml(figures.wall_volume_ml),
        exponent,
    )
    .map_err(TaskError::PassiveState)
}

/// Surrogate of a beat's organ: the one-fibre ventricle, with the organ's law if there is any
/// knowledge of it.
///
/// - `beats`: beats of the organ; empty for the law of the prior
/// - `prior`: file of the law before the first beat; `None` for the law of the program
///
/// # Errors
/// [`TaskError`] when the organ's figures are outside the range of the model, or samples or the
/// prior cannot be used.
pub fn surrogate(
    beat: &OrganBeatSpec,
    beats: Option<&[LawSamples]>,
    prior: Option<&InputFile>,
) -> Result<ReducedOrgan, TaskError> {
    let mut reduced = one_fibre(&beat.organ)?;
    let Some(beats) = beats else {
        return Ok(reduced);
    };
    let prior = prior_of(prior)?;
    let (wall, features) = law_organ(&beat.organ, &prior)?;
    reduced.passive = wall;
    reduced.cell_solver = CELL_SOLVER;
    if let OrganSpec::FiniteElement(organ) = &beat.organ {
        reduced.activation.onset_ms += ACTIVATION_DELAY * organ.figures.spread_ms;
    }
    let beats = learnable_beats(&beat.cell_stretch, beats.iter());
    let law = fit_law(&reduced.passive, &features, &beats, &prior)?;
    reduced.law = Some(Arc::new(law));
    Ok(reduced)
}

/// As [`surrogate`], from what is known about the law; `None` for the one-fibre ventricle.
pub(crate) fn known_surrogate(
    beat: &OrganBeatSpec,
    known: Option<&LawKnowledge>,
) -> Result<ReducedOrgan, TaskError> {
    let beats = known.map(|known| &known.beats[..]);
    surrogate(beat, beats, known.and_then(|known| known.prior.as_ref()))
}

/// Passive wall of an organ's law, and the features on which its prior depends.
///
/// Of an external solver's wall only the one-fibre law is known: the image's volume is then typical
/// of the prior's organs, and all fibres contract for equally long.
pub(crate) fn law_organ(
    organ: &OrganSpec,
    prior: &LawPrior,
) -> Result<(OneFibrePassive, OrganFeatures), TaskError> {
    let passive = match organ {
        OrganSpec::FiniteElement(organ) => {
            return Ok((law_wall(&organ.figures)?, features(&organ.figures)));
        }
        OrganSpec::Reduced { passive, .. } => *passive,
        OrganSpec::External(organ) => organ.passive,
    };
    let exponent_factor = (passive.exponent / DEFAULT_EXPONENT).max(f64::MIN_POSITIVE);
    let features = OrganFeatures {
        log_exponent_factor: exponent_factor.ln(),
        log_image_volume: prior.typical_log_image_volume,
        ..OrganFeatures::default()
    };
    Ok((passive, features))
}

/// Passive wall of the organ's law.
///
/// # Errors
/// [`TaskError`] when the figures are outside the range of the model.
pub fn law_wall(figures: &VentricleFigures) -> Result<OneFibrePassive, TaskError> {
    one_fibre_of(figures, DEFAULT_EXPONENT * figures.exponent_factor)
}

/// Features on which the prior of the organ's law depends.
#[must_use]
pub fn features(figures: &VentricleFigures) -> OrganFeatures {
    OrganFeatures {
        log_exponent_factor: figures.exponent_factor.ln(),
        log_image_volume: (figures.image_volume_ml / figures.end_diastolic_volume_ml).ln(),
        duration_share: figures.epicardial_duration_share,
    }
}

/// Beats for the fit of a law.
pub fn learnable_beats<'a>(
    stretch: &CellStretch,
    beats: impl Iterator<Item = &'a LawSamples>,
) -> Vec<LawBeat<'a>> {
    let slack = match stretch.origin {
        StretchOrigin::Unloaded => Some(stretch.slack_stretch),
        StretchOrigin::EndDiastole => None,
    };
    beats
        .map(|beat| LawBeat {
            volume_ml: &beat.volume_ml,
            pressure_mmhg: &beat.pressure_mmhg,
            stress_kpa: &beat.active_stress_kpa,
            stretch: &beat.stretch,
            stretch_deviation: &beat.stretch_deviation,
            stress_deviation_kpa: &beat.stress_deviation_kpa,
            slack,
        })
        .collect()
}

/// The law before an organ's first beat, from its file or as shipped.
pub(crate) fn prior_of(file: Option<&InputFile>) -> Result<LawPrior, TaskError> {
    let Some(file) = file else {
        return Ok(shipped_prior());
    };
    let read: LawFile = formats::LAW.read(&file.path.display(), &read_verified(file)?)?;
    Ok(read.prior)
}
