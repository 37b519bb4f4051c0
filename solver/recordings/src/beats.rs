//! Detection of beats. A beat begins at the R wave or, without an electrocardiogram, when the
//! pressure begins to rise.

use cardiotwin_vocabulary::preparation::{BeatSource, BeatsStep};

use crate::filter::{median, smooth};
use crate::hum::without_hum;
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

/// Share of beats in which the pressure must rise once for R waves to be believed. Where each T wave
/// counts as well, it is half; a heart with many beats that do not eject is above.
const AGREES: f64 = 0.6;
/// Spread of the time from R wave to steepest rise, as a share of the usual beat, above which the two
/// belong to different hearts or clocks. Of one heart it is some hundredths.
const SCATTER: f64 = 0.08;
/// Time from R wave to steepest rise, as a share of the usual beat and in ms, above which the clocks of the two
/// differ; both must be exceeded. Of one heart it is some 0.1, and through a long line up to 0.2.
const LATE: (f64, f64) = (0.3, 150.0);
/// Share of the delays that lie within the spread, and that share of a normal distribution in standard
/// deviations: up to a fifth of the R waves may be false without a word.
const MOST: (f64, f64) = (0.8, 1.2816);
/// Usual change of a signal by the removal of spikes, over the largest one, above which hum was removed.
const EVERYWHERE: f64 = 0.05;
/// Difference of delays from which a cleaned signal is preferred \[ms\].
const CLEARLY_MS: f64 = 20.0;
/// Share of the maximal slope below which the pressure has not begun to rise.
const FOOT: f64 = 0.1;
/// Half width of the smoothing of the usual rise before its foot is looked for \[ms\].
const FOOT_SMOOTH_MS: f64 = 4.0;

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
    /// What is to be told about the electrocardiogram; nothing without one.
    pub ecg: EcgSeen,
}

/// What was seen of the electrocardiogram.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EcgSeen {
    /// Time in which the pressure has samples and the electrocardiogram has none, or stands still
    /// \[ms\].
    pub without_ms: f64,
    /// Reason why beats were found from the pressure instead.
    pub refused: Option<EcgRefused>,
    /// What was taken out of the signal before R waves were found.
    pub cleaned: Option<Cleaned>,
}

/// Reasons for which an electrocardiogram is not used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EcgRefused {
    /// It has no samples, or only equal ones.
    Empty,
    /// The pressure does not rise once between its R waves: in this many of so many beats.
    Disagrees {
        /// Beats in which the pressure rises once.
        once: usize,
        /// All beats between R waves.
        of: usize,
    },
    /// The pressure rises later after its R waves than in any heart, as if the clocks differed.
    Late {
        /// Usual time from the R wave to the steepest rise \[ms\].
        delay_ms: f64,
    },
    /// The pressure rises at any time after its R waves, as if they were another heart's.
    Scattered {
        /// Spread of the time from the R wave to the steepest rise \[ms\].
        spread_ms: f64,
    },
}

/// What is taken out of an electrocardiogram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cleaned {
    /// Pacing spikes.
    Spikes,
    /// Pacing spikes and the hum of mains.
    SpikesAndHum,
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
    let ecg = recording.channels.ecg_mv.as_deref();
    let mut seen = EcgSeen {
        without_ms: ecg.map_or(0.0, |ecg| without_ms(recording, ecg)),
        ..EcgSeen::default()
    };
    let by_rise = || {
        let rises = refine(recording, recording.leading_pressure(), &rises_ms, RISE_MS);
        let lead = lead_of_the_foot(recording, &rises);
        rises.iter().map(|t| t - lead).collect::<Vec<f64>>()
    };
    let (source, onsets) = match settings.source {
        Some(BeatSource::RWave) => {
            let ecg = ecg.ok_or(BeatError::NoEcg)?;
            let r_waves = RWaves::of(recording, ecg, &rises_ms);
            seen.cleaned = r_waves.cleaned;
            (BeatSource::RWave, r_waves.onsets_ms)
        }
        Some(BeatSource::PressureRise) => {
            seen = EcgSeen::default();
            (BeatSource::PressureRise, by_rise())
        }
        None => match ecg.map(|ecg| RWaves::of(recording, ecg, &rises_ms)) {
            Some(found) if found.agrees() => {
                seen.cleaned = found.cleaned;
                (BeatSource::RWave, found.onsets_ms)
            }
            refused => {
                seen.refused = refused.map(|found| found.refusal());
                (BeatSource::PressureRise, by_rise())
            }
        },
        Some(BeatSource::Given) => {
            seen = EcgSeen::default();
            let given = settings
                .onsets_ms
                .iter()
                .map(|t| recording.since_begin_ms(*t));
            (BeatSource::Given, given.collect())
        }
    };
    let beats = between(&onsets);
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
        ecg: seen,
    })
}

/// Beats between beginnings, without those of an impossible length.
fn between(onsets_ms: &[f64]) -> Vec<Beat> {
    onsets_ms
        .windows(2)
        .map(|w| Beat {
            onset_ms: w[0],
            length_ms: w[1] - w[0],
        })
        .filter(|beat| beat.onset_ms >= 0.0 && LENGTHS_MS.contains(&beat.length_ms))
        .collect()
}

/// Time for which the leading pressure has samples and the electrocardiogram has none, or the same
/// one for a second or longer \[ms\].
fn without_ms(recording: &Recording, ecg_mv: &[f64]) -> f64 {
    let second = recording.samples(1000.0);
    let pressure = recording.leading_pressure();
    let mut absent = vec![false; ecg_mv.len()];
    let mut begin = 0;
    for i in 0..=ecg_mv.len() {
        let same = i < ecg_mv.len()
            && (ecg_mv[i] == ecg_mv[begin] || ecg_mv[i].is_nan() && ecg_mv[begin].is_nan());
        if !same {
            if i - begin > second {
                absent[begin..i].fill(true);
            }
            begin = i.min(ecg_mv.len().saturating_sub(1));
        }
    }
    let n = (0..ecg_mv.len())
        .filter(|i| (absent[*i] || ecg_mv[*i].is_nan()) && pressure[*i].is_finite())
        .count();
    n as f64 * recording.step_ms
}

/// R waves, and how well they agree with the pressure's rises.
struct RWaves {
    onsets_ms: Vec<f64>,
    cleaned: Option<Cleaned>,
    /// Beats in which the pressure rises once, and all beats without lost samples.
    once: usize,
    of: usize,
    /// Usual time from the R wave to the steepest rise, and its spread \[ms\].
    delay_ms: (f64, f64),
    /// Usual length of the beats \[ms\].
    length_ms: f64,
    empty: bool,
}

impl RWaves {
    /// R waves of the signal as it is and of the cleaned one, whichever agrees better with the
    /// pressure: a spike of an atrial pacemaker precedes the rise by longer than the R wave does, and
    /// hum scatters the times.
    fn of(recording: &Recording, ecg_mv: &[f64], rises_ms: &[f64]) -> Self {
        let as_it_is = Self::judged(recording, ecg_mv, rises_ms, None);
        if as_it_is.empty {
            return as_it_is;
        }
        let still = r_waves::without_spikes(recording, ecg_mv);
        let silent = without_hum(recording, &still);
        let of_still = match changes_everywhere(ecg_mv, &still) {
            true => Cleaned::SpikesAndHum,
            false => Cleaned::Spikes,
        };
        let cleaned = [(of_still, still), (Cleaned::SpikesAndHum, silent)]
            .map(|(how, ecg)| Self::judged(recording, &ecg, rises_ms, Some(how)));
        cleaned.into_iter().fold(as_it_is, |best, other| {
            if other.is_better_than(&best) {
                other
            } else {
                best
            }
        })
    }

    fn judged(
        recording: &Recording,
        ecg_mv: &[f64],
        rises_ms: &[f64],
        cleaned: Option<Cleaned>,
    ) -> Self {
        let mut finite = ecg_mv.iter().filter(|v| v.is_finite());
        let first = finite.next().copied().unwrap_or(0.0);
        let empty = finite.all(|v| *v == first);
        let onsets_ms = if empty {
            Vec::new()
        } else {
            r_waves::find(recording, ecg_mv)
        };
        let pressure = recording.leading_pressure();
        let whole = |beat: &Beat| {
            let at = |ms: f64| (recording.position(ms) as usize).min(pressure.len());
            let span = &pressure[at(beat.onset_ms)..at(beat.onset_ms + beat.length_ms)];
            span.iter().all(|p| p.is_finite())
        };
        let beats: Vec<Beat> = between(&onsets_ms).into_iter().filter(whole).collect();
        let delays: Vec<f64> = beats
            .iter()
            .filter(|beat| rises_of(beat, rises_ms) == 1)
            .filter_map(|beat| {
                let next = rises_ms.partition_point(|t| *t < beat.onset_ms - EARLY_MS);
                Some(rises_ms.get(next)? - beat.onset_ms)
            })
            .collect();
        Self {
            onsets_ms,
            cleaned,
            once: delays.len(),
            of: beats.len(),
            delay_ms: usual_and_spread(&delays),
            length_ms: median(beats.iter().map(|beat| beat.length_ms)),
            empty,
        }
    }

    fn share(&self) -> f64 {
        self.once as f64 / self.of.max(1) as f64
    }

    fn agrees(&self) -> bool {
        self.has_rises() && !self.is_scattered() && !self.is_late()
    }

    /// Whether enough beats between these R waves have one rise.
    fn has_rises(&self) -> bool {
        self.of > 0 && self.share() >= AGREES
    }

    fn is_late(&self) -> bool {
        self.delay_ms.0 > LATE.1.max(LATE.0 * self.length_ms)
    }

    fn is_scattered(&self) -> bool {
        self.delay_ms.1 > SCATTER * self.length_ms
    }

    /// Whether these R waves agree better with the pressure: clearly more beats with one rise, or as
    /// many and a rise that follows clearly sooner and more evenly.
    fn is_better_than(&self, other: &Self) -> bool {
        let sum = |waves: &Self| waves.delay_ms.0 + 3.0 * waves.delay_ms.1;
        if self.once == 0 || self.share() + 0.1 < other.share() {
            return false;
        }
        other.once == 0
            || (self.share() > other.share() + 0.1 && self.once >= other.once)
            || (10 * self.once >= 9 * other.once && sum(self) < sum(other) - CLEARLY_MS)
    }

    fn refusal(&self) -> EcgRefused {
        if self.empty {
            EcgRefused::Empty
        } else if !self.has_rises() {
            EcgRefused::Disagrees {
                once: self.once,
                of: self.of,
            }
        } else if self.is_scattered() {
            EcgRefused::Scattered {
                spread_ms: self.delay_ms.1,
            }
        } else {
            EcgRefused::Late {
                delay_ms: self.delay_ms.0,
            }
        }
    }
}

/// Median of delays, and the standard deviation of a normal distribution of which as many lie as near to
/// it.
fn usual_and_spread(delays_ms: &[f64]) -> (f64, f64) {
    let usual = median(delays_ms.iter().copied());
    let mut apart: Vec<f64> = delays_ms.iter().map(|d| (d - usual).abs()).collect();
    apart.sort_by(f64::total_cmp);
    let place = (MOST.0 * apart.len() as f64) as usize;
    (usual, apart.get(place).map_or(f64::NAN, |d| d / MOST.1))
}

/// Whether a cleaned signal differs from the raw one everywhere, as without hum, and not here and there,
/// as without spikes.
fn changes_everywhere(raw: &[f64], cleaned: &[f64]) -> bool {
    let change = || std::iter::zip(raw, cleaned).map(|(a, b)| (a - b).abs());
    let largest = change().filter(|c| c.is_finite()).fold(0.0, f64::max);
    median(change()) > EVERYWHERE * largest
}

/// Time from the foot of the rise to its steepest point \[ms\]. The foot is the last time before the
/// steepest point at which the usual pressure has not begun to rise: its slope is below a tenth of the
/// steepest. The tangent's intersection with the level before it would lie later, since a rise begins
/// with a bend. All beats share one value, so that noise in the individual feet does not matter.
fn lead_of_the_foot(recording: &Recording, rises_ms: &[f64]) -> f64 {
    let step = recording.step_ms;
    let (usual, middle_ms) = usual_course(recording, recording.leading_pressure(), rises_ms, 160.0);
    let half = if step > FOOT_SMOOTH_MS {
        0
    } else {
        recording.samples(FOOT_SMOOTH_MS)
    };
    let usual = smooth(&usual, half);
    let middle = (middle_ms / step).round() as usize;
    let slope = |k: usize| (usual[k + 1] - usual[k - 1]) / (2.0 * step);
    let near = (middle - middle / 4).max(1)..=(middle + middle / 4).min(usual.len() - 2);
    let Some(steepest) = near.max_by(|a, b| slope(*a).total_cmp(&slope(*b))) else {
        return 0.0;
    };
    let limit = FOOT * slope(steepest);
    let Some(before) = (1..steepest).rev().find(|k| slope(*k) < limit) else {
        return 0.0;
    };
    // The slope crosses the limit between two samples.
    let share = (limit - slope(before)) / (slope(before + 1) - slope(before));
    let lead = middle_ms - (before as f64 + share) * step;
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
