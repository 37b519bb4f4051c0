//! Rejection of beats from the average: damaged beats, premature beats and those affected by them,
//! and beats of an unusual shape.

use cardiotwin_vocabulary::preparation::RejectStep;

use crate::beats::{Beat, FoundBeats, rises_of};
use crate::filter::{centre_and_spread, median};
use crate::recording::{Recording, at};

/// Number of neighbours on either side whose median is a beat's usual length.
const NEIGHBOURS: usize = 6;
/// Number of beats that must tell the usual length. With fewer, the times between pressure rises tell it.
const FEWEST_THAT_TELL: usize = 3;
/// Smallest relative difference from the usual length for which a beat counts as short.
const SHORT: f64 = 0.15;
/// Smallest relative difference from the usual length for which a beat counts as long.
const LONG: f64 = 0.2;
/// The same limits in standard deviations of the relative lengths; they apply if lengths vary more.
const LENGTH_SD: (f64, f64) = (4.5, 5.0);
/// Lower bound of the standard deviation of relative lengths.
const LEAST_LENGTH_SD: f64 = 0.015;
/// Duration of equal samples above which the line was stuck, in ms and as a multiple of the usual
/// beat's; both must be exceeded.
const FLAT: (f64, f64) = (40.0, 2.5);
/// Change between two samples above which it is an artefact, as a multiple of the usual beat's and
/// in mmHg/ms; both must be exceeded.
const JUMP: (f64, f64) = (2.5, 6.0);
/// Range of pressures that a circulation can have \[mmHg\].
const POSSIBLE_MMHG: std::ops::RangeInclusive<f64> = -60.0..=400.0;
/// Distance from the usual beat above which a shape is unusual, in standard deviations of the
/// distances and as a share of the pulse pressure; both must be exceeded.
const SHAPE: (f64, f64) = (6.0, 0.04);
/// Share of the usual cycle, from its beginning, over which shapes are compared: systole and
/// relaxation.
const SHAPE_SHARE: f64 = 0.62;
/// Distance between the samples of a shape \[ms\].
const SHAPE_STEP_MS: f64 = 4.0;
/// Largest number of beats from which the usual shape is computed.
const SHAPE_BEATS: usize = 301;

/// Reasons why a beat is rejected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// Samples are missing, for this time \[ms\].
    Missing(f64),
    /// The value stays the same for this time \[ms\].
    Flat(f64),
    /// Pressure changes between two samples faster than any heart's \[mmHg/ms\].
    Jump(f64),
    /// The pressure is outside the range of any circulation \[mmHg\].
    Impossible(f64),
    /// The beat came early: its predecessor had this share of the usual length.
    Premature(f64),
    /// The next beat came early, so that this one has this share of the usual length.
    CutShort(f64),
    /// The beat before it was premature, so that filling and force differ from the usual ones.
    AfterPremature,
    /// The beat lasted longer than usual; the value is its length relative to the usual one.
    Pause(f64),
    /// The pressure rose this number of times instead of once.
    Rises(usize),
    /// The shape is unusual: root-mean-square difference from the usual beat, and its limit
    /// \[mmHg\].
    Shape(f64, f64),
    /// The settings reject the beat.
    ByHand,
}

impl Reason {
    /// Kind of the reason in one word, for tables.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Missing(_) | Self::Flat(_) | Self::Jump(_) | Self::Impossible(_) => "damaged",
            Self::Premature(_) => "ectopic",
            Self::CutShort(_) => "cut-short",
            Self::AfterPremature => "after-ectopic",
            Self::Pause(_) => "pause",
            Self::Rises(_) => "no-single-rise",
            Self::Shape(..) => "unusual-shape",
            Self::ByHand => "by-hand",
        }
    }
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Missing(ms) => write!(f, "{ms:.0} ms of samples are missing"),
            Self::Flat(ms) => write!(f, "the same value for {ms:.0} ms"),
            Self::Jump(rate) => write!(f, "a jump of {rate:.1} mmHg/ms"),
            Self::Impossible(mmhg) => write!(f, "a pressure of {mmhg:.0} mmHg"),
            Self::Premature(share) => write!(
                f,
                "came early, after {:.0} % of the usual cycle",
                100.0 * share
            ),
            Self::CutShort(share) => {
                write!(
                    f,
                    "the next beat came early, after {:.0} % of the usual cycle",
                    100.0 * share
                )
            }
            Self::AfterPremature => f.write_str("follows a beat that came early"),
            Self::Pause(share) => write!(f, "lasted {:.0} % of the usual cycle", 100.0 * share),
            Self::Rises(0) => f.write_str("pressure does not rise"),
            Self::Rises(n) => write!(f, "pressure rises {n} times"),
            Self::Shape(rms, limit) => write!(
                f,
                "differs from the usual beat by {rms:.1} mmHg (limit {limit:.1})"
            ),
            Self::ByHand => f.write_str("left out in prepare.toml"),
        }
    }
}

/// Reasons against each beat, the most serious first; empty for an accepted beat.
#[must_use]
pub fn judge(recording: &Recording, found: &FoundBeats, settings: &RejectStep) -> Vec<Vec<Reason>> {
    let beats = &found.beats;
    let mut reasons: Vec<Vec<Reason>> = vec![Vec::new(); beats.len()];
    missing(recording, beats, &mut reasons);
    if settings.enabled {
        damage(recording, beats, &mut reasons);
        timing(found, &mut reasons);
        shape(recording, beats, &mut reasons);
    }
    for (number, (beat, reasons)) in (1..).zip(beats.iter().zip(&mut reasons)) {
        let (from, to) = (
            recording.begin_ms + recording.elapsed_ms(beat.onset_ms),
            recording.begin_ms + recording.elapsed_ms(beat.onset_ms) + beat.length_ms,
        );
        let inside = settings
            .leave_out_ms
            .iter()
            .any(|[begin, end]| from < *end && to > *begin);
        if inside || settings.leave_out.contains(&number) {
            reasons.insert(0, Reason::ByHand);
        } else if settings.keep.contains(&number) {
            // A beat with missing samples cannot be averaged, even if the settings keep it.
            reasons.retain(|reason| matches!(reason, Reason::Missing(_)));
        }
    }
    reasons
}

fn span(recording: &Recording, beat: &Beat) -> std::ops::Range<usize> {
    let n = recording.n_samples();
    let first = recording.position(beat.onset_ms).floor().max(0.0) as usize;
    let last = recording.position(beat.onset_ms + beat.length_ms).ceil() as usize + 1;
    first.min(n)..last.min(n)
}

fn missing(recording: &Recording, beats: &[Beat], reasons: &mut [Vec<Reason>]) {
    let channels = [
        &recording.channels.lv_pressure_mmhg,
        &recording.channels.aortic_pressure_mmhg,
        &recording.channels.flow_ml_per_s,
    ];
    for (beat, reasons) in beats.iter().zip(reasons) {
        let span = span(recording, beat);
        let lost = channels
            .iter()
            .filter_map(|c| c.as_ref())
            .map(|c| c[span.clone()].iter().filter(|v| v.is_nan()).count());
        let lost = lost.max().unwrap_or(0);
        if lost > 0 {
            reasons.push(Reason::Missing(lost as f64 * recording.step_ms));
        }
    }
}

fn damage(recording: &Recording, beats: &[Beat], reasons: &mut [Vec<Reason>]) {
    let step = recording.step_ms;
    for pressure in [
        &recording.channels.lv_pressure_mmhg,
        &recording.channels.aortic_pressure_mmhg,
    ]
    .into_iter()
    .flatten()
    {
        let seen: Vec<(f64, f64, f64)> = beats
            .iter()
            .map(|beat| {
                let values = &pressure[span(recording, beat)];
                let (mut run, mut longest, mut steepest, mut farthest) = (0, 0, 0.0_f64, 0.0_f64);
                for w in values.windows(2) {
                    run = if w[0] == w[1] { run + 1 } else { 0 };
                    longest = longest.max(run);
                    steepest = steepest.max((w[1] - w[0]).abs() / step);
                    if !POSSIBLE_MMHG.contains(&w[0]) && w[0].is_finite() {
                        farthest = w[0];
                    }
                }
                (longest as f64 * step, steepest, farthest)
            })
            .collect();
        let usual_run = median(seen.iter().map(|s| s.0));
        let usual_rate = median(seen.iter().map(|s| s.1));
        for ((run, rate, farthest), reasons) in seen.into_iter().zip(reasons.iter_mut()) {
            if farthest != 0.0 {
                reasons.push(Reason::Impossible(farthest));
            }
            if rate > (JUMP.0 * usual_rate).max(JUMP.1) {
                reasons.push(Reason::Jump(rate));
            }
            if run > FLAT.0.max(FLAT.1 * usual_run) {
                reasons.push(Reason::Flat(run));
            }
        }
    }
}

fn timing(found: &FoundBeats, reasons: &mut [Vec<Reason>]) {
    let beats = &found.beats;
    // Beats with lost or damaged samples, and beats without a rise of their own, say nothing about
    // the usual length: their beginnings are uncertain.
    let tells: Vec<bool> = beats
        .iter()
        .zip(reasons.iter())
        .map(|(beat, reasons)| reasons.is_empty() && rises_of(beat, &found.rises_ms) == 1)
        .collect();
    let few = tells.iter().filter(|tells| **tells).count() < FEWEST_THAT_TELL;
    let between_rises = median(found.rises_ms.windows(2).map(|pair| pair[1] - pair[0]));
    let shares: Vec<f64> = (0..beats.len())
        .map(|i| {
            if few && between_rises.is_finite() {
                return beats[i].length_ms / between_rises;
            }
            let near = i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(beats.len());
            let mut usual = median(
                near.clone()
                    .filter(|k| tells[*k])
                    .map(|k| beats[k].length_ms),
            );
            if usual.is_nan() {
                usual = median(near.map(|k| beats[k].length_ms));
            }
            beats[i].length_ms / usual
        })
        .collect();
    let of_usual: Vec<f64> = (0..beats.len())
        .filter(|i| tells[*i])
        .map(|i| shares[i])
        .collect();
    let spread = centre_and_spread(if of_usual.is_empty() {
        &shares
    } else {
        &of_usual
    })
    .1;
    let sd = spread.max(LEAST_LENGTH_SD);
    let (short, long) = (
        1.0 - SHORT.max(LENGTH_SD.0 * sd),
        1.0 + LONG.max(LENGTH_SD.1 * sd),
    );
    let follows = |i: usize| {
        i + 1 < beats.len()
            && (beats[i].onset_ms + beats[i].length_ms - beats[i + 1].onset_ms).abs() < 1e-6
    };
    for i in 0..beats.len() {
        let n_rises = rises_of(&beats[i], &found.rises_ms);
        if shares[i] < short {
            // The beginning of a damaged beat is uncertain, so that it does not show whether the
            // next beat is premature.
            let sure = !reasons[i].iter().any(|reason| reason.kind() == "damaged");
            reasons[i].push(Reason::CutShort(shares[i]));
            if sure && follows(i) {
                reasons[i + 1].insert(0, Reason::Premature(shares[i]));
                // A false beginning has no pressure rise of its own and does not affect the
                // following beat.
                if rises_of(&beats[i + 1], &found.rises_ms) > 0
                    && follows(i + 1)
                    && shares[i + 1] >= short
                {
                    reasons[i + 2].push(Reason::AfterPremature);
                }
            }
        } else if shares[i] > long {
            reasons[i].push(Reason::Pause(shares[i]));
        }
        if n_rises != 1 {
            reasons[i].push(Reason::Rises(n_rises));
        }
    }
}

fn shape(recording: &Recording, beats: &[Beat], reasons: &mut [Vec<Reason>]) {
    let pressure = recording.leading_pressure();
    let usual_length = median(beats.iter().map(|b| b.length_ms));
    let n = ((SHAPE_SHARE * usual_length / SHAPE_STEP_MS) as usize).max(8);
    let sampled = |beat: &Beat| -> Vec<f64> {
        let time = |k: usize| beat.onset_ms + k as f64 * SHAPE_STEP_MS;
        (0..n)
            .map(|k| at(pressure, recording.position(time(k))))
            .collect()
    };
    let good: Vec<usize> = (0..beats.len())
        .filter(|i| reasons[*i].is_empty())
        .collect();
    if good.len() < 4 {
        return;
    }
    let every = good.len().div_ceil(SHAPE_BEATS);
    let chosen: Vec<Vec<f64>> = good
        .iter()
        .step_by(every)
        .map(|i| sampled(&beats[*i]))
        .collect();
    let usual: Vec<f64> = (0..n)
        .map(|k| median(chosen.iter().map(|s| s[k])))
        .collect();
    let distance = |beat: &Beat| -> f64 {
        let here = sampled(beat);
        let m = here.iter().zip(&usual).map(|(a, b)| a - b).sum::<f64>() / n as f64;
        (here
            .iter()
            .zip(&usual)
            .map(|(a, b)| (a - b - m).powi(2))
            .sum::<f64>()
            / n as f64)
            .sqrt()
    };
    let distances: Vec<f64> = beats.iter().map(distance).collect();
    let of_good: Vec<f64> = good.iter().map(|i| distances[*i]).collect();
    let (centre, spread) = centre_and_spread(&of_good);
    let (low, high) = usual
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(*v), h.max(*v))
        });
    let limit = centre + (SHAPE.0 * spread).max(SHAPE.1 * (high - low));
    for (distance, reasons) in distances.into_iter().zip(reasons) {
        if distance > limit {
            reasons.push(Reason::Shape(distance, limit));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beats::find;
    use crate::recording::Channels;
    use cardiotwin_vocabulary::preparation::{BeatSource, BeatsStep};

    /// Beats of given lengths, with a bell-shaped pressure 250 ms after each beginning.
    fn recording(lengths: &[f64]) -> (Recording, FoundBeats) {
        let onsets: Vec<f64> = std::iter::once(0.0)
            .chain(lengths.iter().scan(0.0, |t, l| {
                *t += l;
                Some(*t)
            }))
            .collect();
        let n = *onsets.last().unwrap() as usize + 300;
        let bell = |t: f64| {
            100.0 / (1.0 + (-(t - 80.0) / 12.0).exp()) / (1.0 + ((t - 330.0) / 18.0).exp())
        };
        let pressure = (0..n)
            .map(|i| {
                8.0 + onsets
                    .iter()
                    .map(|o| bell(i as f64 - o))
                    .fold(0.0, f64::max)
                    + 1e-3 * (i % 7) as f64
            })
            .collect();
        let recording = Recording {
            step_ms: 1.0,
            channels: Channels {
                lv_pressure_mmhg: Some(pressure),
                ..Channels::default()
            },
            ..Recording::default()
        };
        let settings = BeatsStep {
            source: Some(BeatSource::Given),
            onsets_ms: onsets,
        };
        let found = find(&recording, &settings).unwrap();
        (recording, found)
    }

    fn kinds(
        recording: &Recording,
        found: &FoundBeats,
        settings: &RejectStep,
    ) -> Vec<Vec<&'static str>> {
        judge(recording, found, settings)
            .iter()
            .map(|r| r.iter().map(Reason::kind).collect())
            .collect()
    }

    #[test]
    fn an_early_beat_takes_its_neighbours_along() {
        let mut lengths = vec![800.0; 20];
        (lengths[9], lengths[10]) = (520.0, 1080.0);
        let (recording, found) = recording(&lengths);
        let kinds = kinds(&recording, &found, &RejectStep::default());
        assert_eq!(kinds[9], ["cut-short"]);
        assert_eq!(kinds[10][0], "ectopic");
        assert_eq!(kinds[11], ["after-ectopic"]);
        assert_eq!(kinds.iter().filter(|k| k.is_empty()).count(), 17);
    }

    #[test]
    fn damage_is_named_and_what_is_given_by_hand_wins() {
        let (mut recording, found) = recording(&[800.0; 20]);
        let pressure = recording.channels.lv_pressure_mmhg.as_mut().unwrap();
        pressure[2300..2310].fill(f64::NAN);
        pressure[4000 + 400..4000 + 500].fill(9.0);
        pressure[6400 + 500] = 60.0;
        let of = |settings: &RejectStep| kinds(&recording, &found, settings);
        let seen = of(&RejectStep::default());
        let named: Vec<usize> = (0..20).filter(|i| !seen[*i].is_empty()).collect();
        assert_eq!(named, [2, 5, 8]);
        assert!(
            [2, 5, 8].iter().all(|i| seen[*i][0] == "damaged"),
            "{seen:?}"
        );
        let by_hand = RejectStep {
            keep: vec![3, 6],
            leave_out: vec![1],
            leave_out_ms: vec![[15_000.0, 15_010.0]],
            ..RejectStep::default()
        };
        let seen = of(&by_hand);
        let named: Vec<usize> = (0..20).filter(|i| !seen[*i].is_empty()).collect();
        assert_eq!(named, [0, 2, 8, 18], "a beat without samples stays out");
        let off = RejectStep {
            enabled: false,
            ..RejectStep::default()
        };
        assert_eq!(of(&off).iter().filter(|k| !k.is_empty()).count(), 1);
    }

    #[test]
    fn a_weak_beat_at_its_time_is_unusual() {
        let (mut recording, found) = recording(&[800.0; 20]);
        let pressure = recording.channels.lv_pressure_mmhg.as_mut().unwrap();
        pressure[8000..8790]
            .iter_mut()
            .for_each(|p| *p = 8.0 + 0.75 * (*p - 8.0));
        let seen = kinds(&recording, &found, &RejectStep::default());
        assert_eq!(seen[10], ["unusual-shape"]);
        assert_eq!(seen.iter().filter(|k| !k.is_empty()).count(), 1);
    }
}
