//! The whole preparation: from recordings to one beat of pressure and volume, with the changes of
//! each step.

use cardiotwin_vocabulary::preparation::{RawImage, RawSteps};

use crate::average::{Average, Drifts, average};
use crate::beats::{Beat, BeatError, FoundBeats, find};
use crate::cine::Cine;
use crate::cycle::{Reconciled, reconcile};
use crate::drift;
use crate::ejection::{self, Ejection};
use crate::events::{ValveEvents, of_ventricle, with_aorta};
use crate::noise::{self, Noise};
use crate::recording::Recording;
use crate::reject::{Reason, judge};
use crate::synchronise::{Lag, lag};
use crate::volume::{Adjusted, adjust};

/// Recordings and images as they were read.
#[derive(Debug, Clone, PartialEq)]
pub struct Raw {
    /// Recording of the catheter.
    pub recording: Recording,
    /// Cine series of volumes; `None` without one.
    pub cine: Option<Cine>,
    /// Volume in a whole-heart image; `None` without one.
    pub whole_heart: Option<RawImage>,
}

/// The prepared beat, with the results of all steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// Beats that were detected, accepted or not.
    pub found: FoundBeats,
    /// Reasons against each beat; empty for a beat in the mean.
    pub reasons: Vec<Vec<Reason>>,
    /// Drifts of the pressures.
    pub drifts: Drifts,
    /// Mean of the accepted beats.
    pub average: Average,
    /// Noise of the mean beat; `None` with fewer than three beats.
    pub noise: Option<Noise>,
    /// Times of valve motion; `None` without the ventricle's pressure.
    pub valves: Option<ValveEvents>,
    /// The volume; `None` without a cine series and a volume on the pressure's clock.
    pub volume: Option<PreparedVolume>,
}

impl Prepared {
    /// Every beat that was detected: its number from 1, and the reasons against it.
    pub fn judged(&self) -> impl Iterator<Item = (usize, &Beat, &[Reason])> {
        let judged = self.found.beats.iter().zip(&self.reasons);
        (1..)
            .zip(judged)
            .map(|(number, (beat, reasons))| (number, beat, &reasons[..]))
    }
}

/// The volume, with the results of each step.
#[derive(Debug, Clone, PartialEq)]
pub struct PreparedVolume {
    /// Whether the volume was recorded with the pressure, on the same clock. Then no step changes it.
    pub on_pressure_clock: bool,
    /// Frames as they were measured, on the cine's clock.
    pub original: Cine,
    /// Frames after the adjustment to the whole-heart image.
    pub adjusted: Adjusted,
    /// Noise of an adjusted frame \[mL\]. Of a volume that was recorded with the pressure, the standard
    /// error of the mean beat.
    pub noise_rms_ml: f64,
    /// Ejection on the cine's clock; `None` if the volume does not fall.
    pub ejection: Option<Ejection>,
    /// Adaptation of the cycle.
    pub reconciled: Reconciled,
    /// Frames on the catheter's cycle with one factor for the whole cycle: neither adapted nor
    /// synchronised.
    pub sheared: Cine,
    /// Lag between pressure and volume.
    pub lag: Lag,
    /// Frames on the catheter's cycle, synchronised.
    pub synchronised: Cine,
    /// Time of the whole-heart image on the catheter's clock, from the beginning of the beat
    /// \[ms\].
    pub image_time_ms: Option<f64>,
}

/// Reasons why no beat can be prepared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PrepareError {
    /// No beat was found.
    #[error(transparent)]
    Beats(#[from] BeatError),
    /// All beats were rejected.
    #[error("none of the {n_found} beats is usable: {why}")]
    NoneKept {
        /// Number of beats that were found.
        n_found: usize,
        /// Reasons in words, with the number of beats for each.
        why: String,
    },
    /// The settings name a beat that does not exist.
    #[error("there is no beat {number}: the recording has beats 1 to {n_found}")]
    NoSuchBeat {
        /// Number in the settings.
        number: usize,
        /// Number of beats in the recording.
        n_found: usize,
    },
}

/// Carries out all steps.
///
/// # Errors
/// [`PrepareError`] if no beat is found or accepted, or if the settings name one that does not
/// exist. Verified by `tests/known_truth.rs`.
pub fn prepare(raw: &Raw, steps: &RawSteps) -> Result<Prepared, PrepareError> {
    let recording = &raw.recording;
    let found = find(recording, &steps.beats)?;
    let n_found = found.beats.len();
    let named = steps
        .reject
        .keep
        .iter()
        .chain(&steps.reject.leave_out)
        .chain(&steps.average.beat);
    if let Some(number) = named
        .map(|number| *number as usize)
        .find(|number| !(1..=n_found).contains(number))
    {
        return Err(PrepareError::NoSuchBeat { number, n_found });
    }
    let reasons = judge(recording, &found, &steps.reject);
    let numbers: Vec<usize> = (1..=n_found)
        .filter(|number| reasons[number - 1].is_empty())
        .collect();
    let kept: Vec<Beat> = numbers
        .iter()
        .map(|number| found.beats[number - 1])
        .collect();
    if kept.is_empty() {
        let first = reasons.iter().find_map(|reasons| reasons.first());
        let first = first.map_or_else(String::new, |reason| format!(" (the first: {reason})"));
        return Err(PrepareError::NoneKept {
            n_found,
            why: counts(&reasons) + &first,
        });
    }
    let of = |pressure: &Option<Vec<f64>>| {
        drift::of(recording, pressure.as_deref()?, &kept, steps.drift)
    };
    let drifts = Drifts {
        lv_pressure: of(&recording.channels.lv_pressure_mmhg),
        aortic_pressure: of(&recording.channels.aortic_pressure_mmhg),
    };
    let average = average(recording, &kept, &numbers, &drifts, &steps.average);
    let noise = noise::of(
        &average.residuals_mmhg,
        average.leading_pressure(),
        average.step_ms,
        average.n_averaged,
    );
    let step_ms = average.step_ms;
    let valves = average.lv_pressure.as_ref().and_then(|lv| {
        let events = of_ventricle(&lv.mean, step_ms)?;
        Some(match &average.aortic_pressure {
            Some(aorta) => with_aorta(events, &lv.mean, &aorta.mean, step_ms),
            None => events,
        })
    });
    let volume = match &raw.cine {
        Some(cine) => Some(volume(
            cine,
            raw.whole_heart.as_ref(),
            &average,
            valves,
            steps,
        )),
        None => recorded_with_pressure(&average, valves, steps),
    };
    Ok(Prepared {
        found,
        reasons,
        drifts,
        average,
        noise,
        valves,
        volume,
    })
}

/// Describes how many beats were rejected for which kind of reason.
#[must_use]
pub fn counts(reasons: &[Vec<Reason>]) -> String {
    let mut kinds: std::collections::BTreeMap<&str, usize> = std::collections::BTreeMap::new();
    for reason in reasons.iter().filter_map(|reasons| reasons.first()) {
        *kinds.entry(reason.kind()).or_default() += 1;
    }
    let words: Vec<String> = kinds
        .iter()
        .map(|(kind, n)| format!("{n} {kind}"))
        .collect();
    words.join(", ")
}

/// The mean of a volume that was recorded with the pressure. Neither its level nor its time is
/// changed. `None` without such a volume, or if it has a sample that is no volume.
fn recorded_with_pressure(
    average: &Average,
    valves: Option<ValveEvents>,
    steps: &RawSteps,
) -> Option<PreparedVolume> {
    let trace = average.lv_volume.as_ref()?;
    let time_ms: Vec<f64> = (0..trace.mean.len())
        .map(|i| i as f64 * average.step_ms)
        .collect();
    let cine = Cine::new(time_ms, trace.mean.clone(), Some(average.cycle_length_ms)).ok()?;
    let mut unchanged = steps.clone();
    unchanged.volume.enabled = false;
    unchanged.cycle.enabled = false;
    unchanged.synchronise.enabled = false;
    let mut prepared = volume(&cine, None, average, valves, &unchanged);
    prepared.on_pressure_clock = true;
    if average.n_averaged > 1 {
        let mean_square = trace.sd.iter().map(|sd| sd * sd).sum::<f64>() / trace.sd.len() as f64;
        prepared.noise_rms_ml = (mean_square / average.n_averaged as f64).sqrt();
    }
    Some(prepared)
}

fn volume(
    cine: &Cine,
    image: Option<&RawImage>,
    average: &Average,
    valves: Option<ValveEvents>,
    steps: &RawSteps,
) -> PreparedVolume {
    let adjusted = adjust(cine, image, steps.volume);
    let cycle = average.cycle_length_ms;
    let ejection = valves
        .zip(average.lv_pressure.as_ref())
        .and_then(|(valves, lv)| {
            let fall = ejection::usual_fall(&lv.mean, average.step_ms, &valves);
            ejection::find(&adjusted.cine, &valves, cycle, fall)
        });
    let of_valves = valves.map(|v| (v.aortic_opening_ms, v.aortic_closure_ms));
    let both = ejection
        .zip(of_valves)
        .map(|(e, v)| [(e.begin_ms, e.end_ms), v]);
    let reconciled = reconcile([cine.cycle_length_ms, cycle], both, steps.cycle);
    let here = ejection.map(|e| (reconciled.map(e.begin_ms), reconciled.map(e.end_ms)));
    let lag = lag(here, of_valves, cycle, steps.synchronise);
    let sheared = adjusted
        .cine
        .moved(cycle, |t| t * cycle / cine.cycle_length_ms);
    let synchronised = adjusted
        .cine
        .moved(cycle, |t| reconciled.map(t) - lag.taken_ms());
    let image_time_ms =
        image.map(|image| (reconciled.map(image.time_ms) - lag.taken_ms()).rem_euclid(cycle));
    PreparedVolume {
        on_pressure_clock: false,
        original: cine.clone(),
        noise_rms_ml: adjusted.cine.noise_rms_ml(),
        adjusted,
        ejection,
        reconciled,
        sheared,
        lag,
        synchronised,
        image_time_ms,
    }
}
