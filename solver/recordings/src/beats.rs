//! Detection of beats. A beat begins at the R wave or, without an electrocardiogram, when the
//! pressure begins to rise.

use cardiotwin_vocabulary::preparation::{BeatSource, BeatsStep};

use crate::landmarks::{refine, usual_course};
use crate::recording::Recording;
use crate::{r_waves, upstrokes};

/// Accepted distances between the beginnings of a beat and of the next one \[ms\]. Others are due
/// to the next recording or to a stretch without a signal.
const LENGTHS_MS: std::ops::RangeInclusive<f64> = 120.0..=5000.0;
/// Largest time by which a pressure rise may precede the beginning of its beat \[ms\]. A rise
/// follows the R wave by at least 30 ms, and a fluid-filled line delays it further.
const EARLY_MS: f64 = 20.0;

/// Half of the interval around the steepest rise over which beats are compared \[ms\]: from before
/// the foot to ejection.
const RISE_MS: f64 = 70.0;

/// A beat, from its beginning to that of the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Beginning after the recording's first sample \[ms\].
    pub onset_ms: f64,
    /// Time to the beginning of the next beat \[ms\].
    pub length_ms: f64,
}

/// Beats of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundBeats {
    /// Signal that was used.
    pub source: BeatSource,
    /// Beats in temporal order, from the first complete one to the last complete one.
    pub beats: Vec<Beat>,
    /// Times of the steepest rises of the leading pressure after the first sample \[ms\].
    pub rises_ms: Vec<f64>,
    /// Time before the first beat, after the last one, and in stretches without a beat \[ms\].
    pub left_over_ms: f64,
}

/// Reasons why no beats are found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BeatError {
    /// R waves were requested, but there is no electrocardiogram.
    #[error("R waves cannot be found: the recording has no electrocardiogram")]
    NoEcg,
    /// There are fewer than two beginnings.
    #[error("found {n_found} beginnings of beats in {length_ms:.0} ms, expected at least 2")]
    NoBeats {
        /// Number of beginnings that were found.
        n_found: usize,
        /// Length of the recording \[ms\].
        length_ms: f64,
    },
}

/// Finds the beats.
///
/// # Errors
/// [`BeatError`] if no beat is found. Verified by `beats_begin_where_they_were_made`.
pub fn find(recording: &Recording, settings: &BeatsStep) -> Result<FoundBeats, BeatError> {
    let slopes = upstrokes::slopes(recording, recording.leading_pressure());
    let rises_ms = upstrokes::find(recording, recording.leading_pressure(), &slopes);
    let source = settings
        .source
        .unwrap_or(if recording.channels.ecg_mv.is_some() {
            BeatSource::RWave
        } else {
            BeatSource::PressureRise
        });
    let onsets = match source {
        BeatSource::RWave => r_waves::find(
            recording,
            recording
                .channels
                .ecg_mv
                .as_deref()
                .ok_or(BeatError::NoEcg)?,
        ),
        BeatSource::PressureRise => {
            let rises = refine(recording, recording.leading_pressure(), &rises_ms, RISE_MS);
            let lead = lead_of_the_foot(recording, &rises);
            rises.iter().map(|t| t - lead).collect()
        }
        BeatSource::Given => settings
            .onsets_ms
            .iter()
            .map(|t| t - recording.begin_ms)
            .collect(),
    };
    let beats: Vec<Beat> = onsets
        .windows(2)
        .map(|w| Beat {
            onset_ms: w[0],
            length_ms: w[1] - w[0],
        })
        .filter(|beat| beat.onset_ms >= 0.0 && LENGTHS_MS.contains(&beat.length_ms))
        .collect();
    if beats.is_empty() {
        return Err(BeatError::NoBeats {
            n_found: onsets.len(),
            length_ms: recording.length_ms(),
        });
    }
    let left_over_ms = recording.length_ms() - beats.iter().map(|beat| beat.length_ms).sum::<f64>();
    Ok(FoundBeats {
        source,
        beats,
        rises_ms,
        left_over_ms: left_over_ms.max(0.0),
    })
}

/// Time from the foot of the rise to its steepest point \[ms\]. The foot is the intersection of the
/// typical rise's tangent with the typical pressure before it. All beats share one value, so that
/// noise in the individual feet does not matter.
fn lead_of_the_foot(recording: &Recording, rises_ms: &[f64]) -> f64 {
    let step = recording.step_ms;
    let (usual, middle_ms) = usual_course(recording, recording.leading_pressure(), rises_ms, 160.0);
    let middle = (middle_ms / step).round() as usize;
    let slope = |k: usize| (usual[k + 1] - usual[k - 1]) / (2.0 * step);
    let near = (middle - middle / 4).max(1)..=(middle + middle / 4).min(usual.len() - 2);
    let Some(steepest) = near.max_by(|a, b| slope(*a).total_cmp(&slope(*b))) else {
        return 0.0;
    };
    // The lowest pressure lies early in diastole. The foot is therefore where the rise leaves the
    // level immediately before it.
    let level = (1..steepest)
        .rev()
        .find(|k| slope(*k) < 0.1 * slope(steepest))
        .map_or(usual[0], |k| usual[k]);
    let lead = (usual[steepest] - level) / slope(steepest) + middle_ms - steepest as f64 * step;
    if lead.is_finite() {
        lead.clamp(0.0, 150.0)
    } else {
        0.0
    }
}

/// Number of pressure rises in a beat.
#[must_use]
pub fn rises_of(beat: &Beat, rises_ms: &[f64]) -> usize {
    let (first, last) = (
        beat.onset_ms - EARLY_MS,
        beat.onset_ms + beat.length_ms - EARLY_MS,
    );
    rises_ms.partition_point(|t| *t < last) - rises_ms.partition_point(|t| *t < first)
}
