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
use crate::ventricle::{AskedFor, unexpected};

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

impl TwinsLoop {
    /// The loop around a twin; the reason why there is none otherwise.
    ///
    /// - `beat`: the unchanged twin; `own`: its own beat in the run, and its traces
    pub fn around(
        beat: &OrganBeatSpec,
        (own, traces): (&OrganBeatResult, &Traces),
        in_3d: bool,
    ) -> Result<Self, String> {
        if in_3d && !matches!(beat.organ, OrganSpec::Reduced { .. }) {
            return Err("the loop surrounds the law and the one-fibre ventricle only".to_owned());
        }
        if let BeatCount::Fixed { .. } = beat.beats {
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
    asked: AskedFor<'_>,
    worker: &Path,
) -> Result<Both, CliError> {
    let before = closed.map_or_else(|| twin.clone(), |closed| closed.close(twin));
    let mut after = before.clone();
    let made = changes
        .iter()
        .map(|change| change.make(&mut after))
        .collect::<Result<Vec<_>, _>>()
        .map_err(CliError::Usage)?;
    let beat_before = simulate(&before, asked, worker)?;
    if closed.is_some() {
        let state = |(result, _): &Simulated| result.closed_loop.ok_or_else(|| unexpected(worker));
        let LoopState {
            mut blood_volume_ml,
            mean_left_atrial_pressure_mmhg: mean,
        } = state(&beat_before)?;
        let [from, to] = [&before, &after].map(|beat| beat.circulation.left_atrial_pressure_mmhg);
        if from != to {
            let mean_mmhg = mean * (to / from);
            let more = filled(&before, LoopFilling::LeftAtrialPressure { mean_mmhg });
            blood_volume_ml = state(&simulate(&more, asked, worker)?)?.blood_volume_ml;
        }
        let volume_ml = blood_volume_ml;
        after = filled(&after, LoopFilling::BloodVolume { volume_ml });
    }
    Ok(Both {
        before: beat_before,
        after: simulate(&after, asked, worker)?,
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
