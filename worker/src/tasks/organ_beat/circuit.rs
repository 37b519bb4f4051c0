//! Beats of a reduced ventricle in its circuit, open or closed. The blood volume of a closed loop is
//! found with the periodic beat.

use cardiotwin_models::beat::{
    BeatOutcome, BeatSettings, BeatTraces, BeatWork, Beats, RunState, run_beats,
};
use cardiotwin_models::effects::Assembled;
use cardiotwin_models::periodic::{Filling, PeriodicSettings, blood_volume, find_filled};
use cardiotwin_models::ventricle::Ventricle as _;
use cardiotwin_schemas::organ::{BeatCount, LoopFilling};
use cardiotwin_schemas::outcome::LoopState;
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::models::{ReducedOrgan, reduced, settings};
use super::result::Seen;
use crate::error::TaskError;

/// Largest change over a beat (mL, mmHg, mL/s, kPa), and largest distance from the filling's target (mL
/// or mmHg), at which a search ends: well below the change that counts as periodic, since volumes of a
/// loop go on drifting for many beats.
const TOLERANCE: f64 = 1e-4;
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
    let filling = spec.circulation.closed.and_then(|closed| closed.filling);
    let outcome = match filling {
        None => run_beats(&mut model.ventricle, &mut model.circulation, &settings),
        Some(filling) => filled(spec, organ, &mut model, (filling, &settings))?,
    };
    let state = |traces: &BeatTraces| {
        // The last sample of a beat is the first of the next.
        let n = traces.time_ms.len().saturating_sub(1).max(1);
        let pressures = traces.left_atrial_pressure_mmhg.iter().take(n);
        Some(LoopState {
            blood_volume_ml: blood_volume(&model)?.0,
            mean_left_atrial_pressure_mmhg: pressures.sum::<f64>() / n as f64,
        })
    };
    let closed = match &outcome {
        BeatOutcome::Finished(result) => state(&result.traces),
        BeatOutcome::Diverged { .. } => None,
    };
    let seen = Seen {
        closed,
        ..Seen::default()
    };
    Ok((outcome, seen))
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
    let filling = match filling {
        LoopFilling::BloodVolume { volume_ml } => Filling::BloodVolume(Ml(volume_ml)),
        LoopFilling::EndDiastolicVolume { volume_ml } => Filling::EndDiastolicVolume(Ml(volume_ml)),
        LoopFilling::LeftAtrialPressure { mean_mmhg } => {
            Filling::LeftAtrialPressure(Mmhg(mean_mmhg))
        }
    };
    // A model of its own, since a search solves steps in another way.
    let mut searched = reduced(spec, organ)?;
    let found = match find_filled(&mut searched, settings.cycle_length, &search, filling) {
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
