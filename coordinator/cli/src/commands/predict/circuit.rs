//! The circuit in which a twin is simulated, unchanged and changed.

use std::path::Path;

use cardiotwin_schemas::organ::{
    BeatCount, ClosedLoopSpec, LoopFilling, LoopRest, OPEN_CIRCUIT_EFFECTS, OrganSpec,
};
use cardiotwin_schemas::outcome::{LoopState, OrganBeatResult};
use cardiotwin_schemas::task::OrganBeatSpec;

use super::beat::simulate;
use super::change::{Change, Changed};
use super::indices::Traces;
use crate::error::CliError;
use crate::ventricle::{AskedFor, PERIODIC, unexpected};

/// Share of the body's resistance between veins and right atrium: ours, of the order of Guyton's
/// resistance to venous return (1957, Am J Physiol 189:609), 1.4 of some 20 mmHg·min/L, to which arteries
/// contribute. Behind the 28 % of the loop's source the veins would hold a litre more, and give or take
/// most of what a change moves.
const VENOUS_SHARE: f64 = 0.05;

/// A loop whose beat at rest is the twin's own: it holds the blood with which the unchanged twin fills
/// to its own end-diastolic volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwinsLoop {
    stroke_volume_ml: f64,
    end_diastolic_volume_ml: f64,
}

/// A simulated beat: its result and the text of its `traces.csv`.
pub type Simulated = (OrganBeatResult, String);

/// A twin's beat and the changed one, in the same circuit.
pub struct Both {
    pub before: Simulated,
    pub after: Simulated,
    pub made: Vec<Changed>,
    /// Cycle length of the changed beat.
    pub cycle_length_after_ms: f64,
}

/// Ventricles in which beats are simulated.
#[derive(Debug, Clone, Copy)]
pub struct Ventricles<'a> {
    /// The one whose beats are shown.
    pub shown: AskedFor<'a>,
    /// The one in which the periodic beat of a loop is searched, where that is another.
    pub searched: Option<AskedFor<'a>>,
    pub worker: &'a Path,
}

impl<'a> Ventricles<'a> {
    /// One ventricle for everything.
    pub fn only(shown: AskedFor<'a>, worker: &'a Path) -> Self {
        Self {
            shown,
            searched: None,
            worker,
        }
    }

    /// State of a beat's loop in the periodic beat.
    pub fn periodic_state(&self, beat: &OrganBeatSpec) -> Result<LoopState, CliError> {
        let periodic = OrganBeatSpec {
            beats: PERIODIC,
            ..beat.clone()
        };
        let ventricle = self.searched.unwrap_or(self.shown);
        self.state(&simulate(&periodic, ventricle, self.worker)?)
    }

    fn state(&self, (result, _): &Simulated) -> Result<LoopState, CliError> {
        (result.closed_loop.clone()).ok_or_else(|| unexpected(self.worker))
    }

    /// Simulates a beat in a loop, and returns the loop's state next to it.
    ///
    /// The periodic beat is found in the searched ventricle. The shown one starts from there, with the
    /// same blood: a loop forgets its start over dozens of beats, too many for a 3D ventricle.
    fn in_loop(&self, beat: &OrganBeatSpec) -> Result<(Simulated, LoopState), CliError> {
        if self.searched.is_none() {
            let found = simulate(beat, self.shown, self.worker)?;
            let state = self.state(&found)?;
            return Ok((found, state));
        }
        let state = self.periodic_state(beat)?;
        let shown = beginning_at(beat, &state);
        Ok((simulate(&shown, self.shown, self.worker)?, state))
    }
}

/// A beat that begins at a state of its loop.
pub fn beginning_at(beat: &OrganBeatSpec, state: &LoopState) -> OrganBeatSpec {
    let volume_ml = state.blood_volume_ml;
    let mut beat = filled(beat, LoopFilling::BloodVolume { volume_ml });
    if let Some(closed) = &mut beat.circulation.closed {
        closed.contents = Some(state.contents.clone());
    }
    beat
}

impl TwinsLoop {
    /// The loop around a twin; the reason why there is none otherwise.
    ///
    /// - `beat`: the unchanged twin; `own`: its own beat in the run, and its traces
    pub fn around(
        beat: &OrganBeatSpec,
        (own, traces): (&OrganBeatResult, &Traces),
        in_3d: bool,
    ) -> Result<Self, String> {
        let is_in_3d = in_3d && !matches!(beat.organ, OrganSpec::Reduced { .. });
        if is_in_3d && matches!(beat.organ, OrganSpec::External(_)) {
            return Err(
                "the loop does not surround the ventricle of an external solver".to_owned(),
            );
        }
        if let (BeatCount::Fixed { .. }, false) = (beat.beats, is_in_3d) {
            return Err(
                "the loop's blood volume is found with the periodic beat, not after --beats"
                    .to_owned(),
            );
        }
        let of_twin = |name: &str| beat.circulation.effects.iter().any(|e| e.name == name);
        if let Some((effect, part)) = OPEN_CIRCUIT_EFFECTS
            .into_iter()
            .find(|(effect, _)| of_twin(effect))
        {
            return Err(format!(
                "the twin's accepted effect {effect} acts on {part}, which a loop does not have"
            ));
        }
        // The largest volume itself: the biomarker is a mean over a window.
        let largest = traces.column("volume_mL").iter().copied().reduce(f64::max);
        let (stroke_volume_ml, end_diastolic_volume_ml) =
            (own.biomarkers.sv_ml.zip(largest)).ok_or("the twin's beat has no stroke volume")?;
        Ok(Self {
            stroke_volume_ml,
            end_diastolic_volume_ml,
        })
    }

    /// The beat in the loop.
    fn close(&self, beat: &OrganBeatSpec) -> OrganBeatSpec {
        let mut closed = beat.clone();
        let load = &beat.circulation.afterload;
        closed.circulation.closed = Some(ClosedLoopSpec {
            stroke_volume_ml: self.stroke_volume_ml,
            venous_share: Some(VENOUS_SHARE),
            rest: Some(LoopRest {
                cycle_length_ms: beat.cycle_length_ms,
                left_atrial_pressure_mmhg: beat.circulation.left_atrial_pressure_mmhg,
                peripheral_resistance_mmhg_s_per_ml: load.peripheral_resistance_mmhg_s_per_ml,
            }),
            filling: Some(LoopFilling::EndDiastolicVolume {
                volume_ml: self.end_diastolic_volume_ml,
            }),
            contents: None,
        });
        closed
    }
}

/// A beat with another filling of its loop.
fn filled(beat: &OrganBeatSpec, filling: LoopFilling) -> OrganBeatSpec {
    let mut beat = beat.clone();
    if let Some(closed) = &mut beat.circulation.closed {
        closed.filling = Some(filling);
    }
    beat
}

/// Simulates a twin unchanged and changed: in the open circuit, or in its loop with the blood of the
/// unchanged beat. A change of the filling pressure by a share is there the blood volume that changes the
/// mean atrial pressure by that share; other changes keep the volume.
///
/// # Errors
/// [`CliError::Usage`] for a change that the twin cannot have, [`CliError::Simulation`] for a beat that
/// diverges, [`CliError::Worker`] if the worker cannot be run.
pub fn both(
    twin: &OrganBeatSpec,
    changes: &[Change],
    closed: Option<&TwinsLoop>,
    ventricles: Ventricles<'_>,
) -> Result<Both, CliError> {
    let before = closed.map_or_else(|| twin.clone(), |closed| closed.close(twin));
    let mut after = before.clone();
    let made = changes
        .iter()
        .map(|change| change.make(&mut after))
        .collect::<Result<Vec<_>, _>>()
        .map_err(CliError::Usage)?;
    let (beat_before, beat_after) = if closed.is_some() {
        let (beat_before, at_rest) = ventricles.in_loop(&before)?;
        let [from, to] = [&before, &after].map(|beat| beat.circulation.left_atrial_pressure_mmhg);
        let mut volume_ml = at_rest.blood_volume_ml;
        if from != to {
            let mean_mmhg = at_rest.mean_left_atrial_pressure_mmhg * (to / from);
            let more = filled(&before, LoopFilling::LeftAtrialPressure { mean_mmhg });
            volume_ml = ventricles.periodic_state(&more)?.blood_volume_ml;
        }
        after = filled(&after, LoopFilling::BloodVolume { volume_ml });
        (beat_before, ventricles.in_loop(&after)?.0)
    } else {
        let simulated = |beat| simulate(beat, ventricles.shown, ventricles.worker);
        (simulated(&before)?, simulated(&after)?)
    };
    Ok(Both {
        before: beat_before,
        after: beat_after,
        made,
        cycle_length_after_ms: after.cycle_length_ms,
    })
}

impl Both {
    /// Whether both beats are periodic.
    pub fn are_periodic(&self) -> bool {
        self.before.0.periodic && self.after.0.periodic
    }
}
