//! All steps in their order: recordings in, one beat of pressure and volume out, with what each step changed.

use crate::average::{Average, AverageSettings, Drifts, average};
use crate::beats::{Beat, BeatError, BeatSettings, FoundBeats, find};
use crate::cine::Cine;
use crate::cycle::{CycleSettings, Reconciled, reconcile};
use crate::drift::{self, DriftSettings};
use crate::ejection::{self, Ejection};
use crate::events::{ValveEvents, of_ventricle};
use crate::noise::{self, Noise};
use crate::recording::Recording;
use crate::reject::{Reason, RejectSettings, judge};
use crate::synchronise::{Lag, SynchroniseSettings, lag};
use crate::volume::{Adjust, Adjusted, WholeHeart, adjust};

/// What was recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Raw {
    /// The catheter's.
    pub recording: Recording,
    /// The cine series.
    pub cine: Option<Cine>,
    /// The whole-heart image.
    pub whole_heart: Option<WholeHeart>,
}

/// How each step is done.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// Finding beats.
    pub beats: BeatSettings,
    /// Leaving some out.
    pub reject: RejectSettings,
    /// The catheter's zero.
    pub drift: DriftSettings,
    /// The mean.
    pub average: AverageSettings,
    /// The volumes' size.
    pub volume: Adjust,
    /// The cycle lengths.
    pub cycle: CycleSettings,
    /// The lag.
    pub synchronise: SynchroniseSettings,
}

/// One beat, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// Beats as they were found.
    pub found: FoundBeats,
    /// Reasons against each; empty where it is in the mean.
    pub reasons: Vec<Vec<Reason>>,
    /// Wandering zeros.
    pub drifts: Drifts,
    /// The mean beat.
    pub average: Average,
    /// Its noise; none with fewer than three beats.
    pub noise: Option<Noise>,
    /// When the valves move; none without the ventricle's pressure.
    pub valves: Option<ValveEvents>,
    /// The volume; none without a cine series.
    pub volume: Option<PreparedVolume>,
}

/// The volume after each step.
#[derive(Debug, Clone, PartialEq)]
pub struct PreparedVolume {
    /// As it was measured.
    pub original: Cine,
    /// After it was brought to the whole-heart image.
    pub adjusted: Adjusted,
    /// Noise of a frame after that, mL.
    pub noise_rms_ml: f64,
    /// Ejection on the cine's clock; none where the volume does not fall.
    pub ejection: Option<Ejection>,
    /// How the cycle was scaled.
    pub reconciled: Reconciled,
    /// Frames laid on the catheter's cycle as they are, all of it scaled alike: neither reconciled nor synchronised.
    pub sheared: Cine,
    /// The lag.
    pub lag: Lag,
    /// Frames with the catheter's cycle, synchronised.
    pub synchronised: Cine,
    /// Time of the whole-heart image on the catheter's clock, ms from the beat's beginning.
    pub image_time_ms: Option<f64>,
}

/// Why there is no beat.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PrepareError {
    /// None was found.
    #[error(transparent)]
    Beats(#[from] BeatError),
    /// All were left out.
    #[error("none of {n_found} beats is kept: {why}")]
    NoneKept {
        /// How many were found.
        n_found: usize,
        /// How many for which reason.
        why: String,
    },
    /// A number that no beat has.
    #[error("there is no beat {number}: the recording has 1 to {n_found}")]
    NoSuchBeat {
        /// The number.
        number: usize,
        /// How many there are.
        n_found: usize,
    },
}

/// Does all steps.
///
/// # Errors
/// [`PrepareError`] where no beat is found or kept, or the settings name one that does not exist. Verified by
/// `tests/known_truth.rs`.
pub fn prepare(raw: &Raw, settings: &Settings) -> Result<Prepared, PrepareError> {
    let recording = &raw.recording;
    let found = find(recording, &settings.beats)?;
    let n_found = found.beats.len();
    let named = settings
        .reject
        .keep
        .iter()
        .chain(&settings.reject.leave_out)
        .chain(&settings.average.beat);
    if let Some(number) = named
        .copied()
        .find(|number| !(1..=n_found).contains(number))
    {
        return Err(PrepareError::NoSuchBeat { number, n_found });
    }
    let reasons = judge(recording, &found, &settings.reject);
    let numbers: Vec<usize> = (1..=n_found)
        .filter(|number| reasons[number - 1].is_empty())
        .collect();
    let kept: Vec<Beat> = numbers
        .iter()
        .map(|number| found.beats[number - 1])
        .collect();
    if kept.is_empty() {
        return Err(PrepareError::NoneKept {
            n_found,
            why: counts(&reasons),
        });
    }
    let of = |pressure: &Option<Vec<f64>>| {
        drift::of(recording, pressure.as_deref()?, &kept, settings.drift)
    };
    let drifts = Drifts {
        lv_pressure: of(&recording.lv_pressure_mmhg),
        aortic_pressure: of(&recording.aortic_pressure_mmhg),
    };
    let average = average(recording, &kept, &numbers, &drifts, &settings.average);
    let noise = noise::of(
        &average.residuals_mmhg,
        average.leading_pressure(),
        average.step_ms,
        average.n_averaged,
    );
    let valves = average
        .lv_pressure
        .as_ref()
        .and_then(|lv| of_ventricle(&lv.mean, average.step_ms));
    let volume = raw
        .cine
        .as_ref()
        .map(|cine| volume(cine, raw.whole_heart.as_ref(), &average, valves, settings));
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

/// How many beats are left out for which kind of reason, in words.
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

fn volume(
    cine: &Cine,
    image: Option<&WholeHeart>,
    average: &Average,
    valves: Option<ValveEvents>,
    settings: &Settings,
) -> PreparedVolume {
    let adjusted = adjust(cine, image, settings.volume);
    let cycle = average.cycle_length_ms;
    let ejection = valves.and_then(|valves| ejection::find(&adjusted.cine, &valves, cycle));
    let of_valves = valves.map(|v| (v.aortic_opening_ms, v.aortic_closure_ms));
    let both = ejection
        .zip(of_valves)
        .map(|(e, v)| [(e.begin_ms, e.end_ms), v]);
    let reconciled = reconcile([cine.cycle_length_ms, cycle], both, settings.cycle);
    let here = ejection.map(|e| (reconciled.map(e.begin_ms), reconciled.map(e.end_ms)));
    let lag = lag(here, of_valves, cycle, settings.synchronise);
    let sheared = adjusted
        .cine
        .moved(cycle, |t| t * cycle / cine.cycle_length_ms);
    let synchronised = adjusted
        .cine
        .moved(cycle, |t| reconciled.map(t) - lag.taken_ms());
    let image_time_ms =
        image.map(|image| (reconciled.map(image.time_ms) - lag.taken_ms()).rem_euclid(cycle));
    PreparedVolume {
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
