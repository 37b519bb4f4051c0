//! Beats of a ventricle in its circuit, open or closed.
//!
//! The blood volume of a closed loop is found with the periodic beat of a reduced ventricle. From there a
//! 3D ventricle starts, for which such a search would take too many beats.

use cardiotwin_models::beat::{
    BeatOutcome, BeatSettings, BeatTraces, BeatWork, Beats, RunState, run_beats,
};
use cardiotwin_models::circulation::Circulation;
use cardiotwin_models::circulation::closed_loop::PULMONARY_VEINS;
use cardiotwin_models::effects::Assembled;
use cardiotwin_models::periodic::{Filling, PeriodicBeat, PeriodicSettings, find_filled};
use cardiotwin_models::ventricle::{Ventricle as _, VentricleError};
use cardiotwin_schemas::organ::{BeatCount, LoopFilling};
use cardiotwin_schemas::outcome::LoopState;
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::models::{ReducedOrgan, reduced, settings};
use super::result::Seen;
use crate::error::TaskError;
use crate::tasks::surrogate::{searched, surrogate};

/// Largest change over a beat (mL, mmHg, mL/s, kPa), and largest distance from the filling's target (mL
/// or mmHg), at which a search ends: well below the change that counts as periodic, since volumes of a
/// loop go on drifting for many beats.
const TOLERANCE: f64 = 1e-4;
/// Beats after which a search for the contents of a 3D ventricle's loop ends.
const SEARCHED_BEATS: usize = 60;
/// Beats after the search, of which the last is reported: the first sample of a beat shows the pressures
/// at the end of the beat before.
const LAST_BEATS: usize = 2;

/// Runs the beats of a specification in a reduced ventricle. The state of a closed loop is seen next to them.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models, or asks for a blood volume
/// without the periodic state.
pub(super) fn beats_of(
    spec: &OrganBeatSpec,
    organ: &ReducedOrgan,
    record_nodes: bool,
) -> Result<(BeatOutcome, Seen<'static>), TaskError> {
    let settings = BeatSettings {
        record_nodes,
        ..settings(spec)
    };
    let mut model = reduced(spec, organ)?;
    let closed = spec.circulation.closed.as_ref();
    let filling = closed.and_then(|closed| closed.filling);
    let outcome = match filling {
        None => run_beats(&mut model.ventricle, &mut model.circulation, &settings),
        Some(filling) => filled(spec, organ, &mut model, (filling, &settings))?,
    };
    let closed = match &outcome {
        BeatOutcome::Finished(result) => {
            loop_state(&result.traces, model.ventricle.volume(), &model.circulation)
        }
        BeatOutcome::Diverged { .. } => None,
    };
    let seen = Seen {
        closed,
        ..Seen::default()
    };
    Ok((outcome, seen))
}

/// State of the loop after a beat; `None` for an open circuit.
///
/// - `cavity`: volume of the ventricle then
pub(super) fn loop_state(
    traces: &BeatTraces,
    cavity: Ml,
    circulation: &Circulation,
) -> Option<LoopState> {
    // The last sample of a beat is the first of the next.
    let n = traces.time_ms.len().saturating_sub(1).max(1);
    let pressures = traces.left_atrial_pressure_mmhg.iter().take(n);
    Some(LoopState {
        blood_volume_ml: cavity.0 + circulation.volume()?.0,
        mean_left_atrial_pressure_mmhg: pressures.sum::<f64>() / n as f64,
        contents: circulation.contents()?,
    })
}

/// Fills the loop around a 3D ventricle at the beginning of its beats: with the given contents, or with
/// those of the periodic beat in the law of the prior. Where the blood volume is given, the lungs' veins
/// get what the cavity has less than the ventricle of the contents: the next filling takes it from there.
///
/// - `cavity`: volume of the 3D ventricle at the beginning
///
/// # Errors
/// [`TaskError`] for contents of another loop, and when the search has a step without a solution.
pub(super) fn fill(
    spec: &OrganBeatSpec,
    cavity: Ml,
    circulation: &mut Circulation,
) -> Result<(), TaskError> {
    let Some(closed) = &spec.circulation.closed else {
        return Ok(());
    };
    let contents = match (&closed.contents, closed.filling) {
        (Some(contents), _) => Some(contents.clone()),
        (None, Some(filling)) => {
            // The law of the prior, since beats of the organ are not part of the specification.
            let organ = surrogate(spec, Some(&[]), None)?;
            let spec = searched(spec);
            let settings = settings(&spec);
            let search = PeriodicSettings {
                limit: SEARCHED_BEATS,
                tolerance: TOLERANCE,
                ..PeriodicSettings::with_step(settings.cycle_length, settings.step)
            };
            let mut model = reduced(&spec, &organ)?;
            let found =
                search_filled(&mut model, &settings, &search, filling).map_err(|source| {
                    let last_good_ms = model.ventricle.time().0;
                    TaskError::Diverged {
                        last_good_ms,
                        source,
                    }
                })?;
            model.begin_orbit(&found.orbit);
            model.circulation.contents()
        }
        // In balance with filling pressure and output, as it was built.
        (None, None) => None,
    };
    if let Some(contents) = contents {
        (circulation.begin_with(&contents)).map_err(TaskError::Circulation)?;
    }
    if let (Some(LoopFilling::BloodVolume { volume_ml }), Some(of_loop)) =
        (closed.filling, circulation.volume())
    {
        circulation.add_blood(PULMONARY_VEINS, Ml(volume_ml - of_loop.0 - cavity.0));
    }
    Ok(())
}

fn search_filled(
    model: &mut Assembled,
    settings: &BeatSettings,
    search: &PeriodicSettings,
    filling: LoopFilling,
) -> Result<PeriodicBeat, VentricleError> {
    let filling = match filling {
        LoopFilling::BloodVolume { volume_ml } => Filling::BloodVolume(Ml(volume_ml)),
        LoopFilling::EndDiastolicVolume { volume_ml } => Filling::EndDiastolicVolume(Ml(volume_ml)),
        LoopFilling::LeftAtrialPressure { mean_mmhg } => {
            Filling::LeftAtrialPressure(Mmhg(mean_mmhg))
        }
    };
    find_filled(model, settings.cycle_length, search, filling)
}

/// Searches the periodic beat with its blood volume, and runs the last beats from there in `model`.
fn filled(
    spec: &OrganBeatSpec,
    organ: &ReducedOrgan,
    model: &mut Assembled,
    (filling, settings): (LoopFilling, &BeatSettings),
) -> Result<BeatOutcome, TaskError> {
    let BeatCount::Periodic { max, tolerance } = spec.beats else {
        return Err(TaskError::LoopWithoutPeriodicState);
    };
    let search = PeriodicSettings {
        limit: max as usize,
        tolerance: TOLERANCE.min(tolerance),
        ..PeriodicSettings::with_step(settings.cycle_length, settings.step)
    };
    // A model of its own, since a search solves steps in another way.
    let mut searched = reduced(spec, organ)?;
    let found = match search_filled(&mut searched, settings, &search, filling) {
        Ok(found) => found,
        Err(reason) => {
            return Ok(BeatOutcome::Diverged {
                t: Ms(searched.ventricle.time().0),
                last_good: Box::new(RunState {
                    ventricle: searched.ventricle.snapshot(),
                    circulation: searched.circulation.snapshot(),
                }),
                reason,
                traces: Box::default(),
                work: BeatWork::default(),
            });
        }
    };
    model.begin_orbit(&found.orbit);
    let last = BeatSettings {
        beats: Beats::Exactly(LAST_BEATS),
        ..*settings
    };
    let mut outcome = run_beats(&mut model.ventricle, &mut model.circulation, &last);
    if let BeatOutcome::Finished(result) = &mut outcome {
        let change = result
            .volume_change_ml
            .abs()
            .max(result.pressure_change_mmhg);
        result.periodic = Some(found.periodic && change <= tolerance);
        result.n_beats += found.n_beats;
    }
    Ok(outcome)
}
