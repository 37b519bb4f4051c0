//! Descriptions of the steps: the changes that each made, in words and numbers.

use std::collections::BTreeMap;

use cardiotwin_recordings::beats::{Cleaned, EcgRefused};
use cardiotwin_recordings::drift::Drift;
use cardiotwin_recordings::hum::amplitude;
use cardiotwin_recordings::prepare::{Prepared, PreparedVolume, counts};
use cardiotwin_schemas::preparation::{StepDone, StepState};
use cardiotwin_schemas::raw::{BeatSource, NoiseOf, RawSteps, VolumeAdjustment};

use super::afterload::Load;
use super::facts::Facts;
use crate::RawFolder;

/// Share of left-out beats above which a warning is given.
const MANY_LEFT_OUT: f64 = 0.3;
/// Number of beats in the mean below which a warning is given.
const FEW_BEATS: usize = 5;
/// Factors on volumes without a warning.
const LARGE_FACTOR: std::ops::RangeInclusive<f64> = 0.85..=1.18;
/// Standard error of the lag above which a warning is given, ms.
const UNCERTAIN_MS: f64 = 10.0;
/// Difference between the lags by opening and by closure above which a warning is given, ms.
const EVENTS_APART_MS: f64 = 25.0;

/// Description of the event with which beats begin.
pub fn source_in_words(folder: &RawFolder, prepared: &Prepared) -> &'static str {
    match (
        prepared.found.source,
        folder.recording.channels.lv_pressure_mmhg.is_some(),
    ) {
        (BeatSource::RWave, _) => "R wave",
        (BeatSource::PressureRise, true) => "rise of the ventricle's pressure",
        (BeatSource::PressureRise, false) => "rise of the aorta's pressure",
        (BeatSource::Given, _) => "times in prepare.toml",
    }
}

/// Time without an electrocardiogram from which a warning is given, ms.
const WITHOUT_ECG_MS: f64 = 1000.0;
/// Lag of the volume behind an R wave from which a warning is given, ms. A scanner that is triggered by
/// the R wave lags by its delay of trigger and segmentation, some tens of ms.
const LATE_BY_R_WAVE_MS: f64 = 100.0;

/// Warnings about the electrocardiogram.
fn of_ecg(prepared: &Prepared) -> Vec<String> {
    let seen = prepared.found.ecg;
    let mut said = Vec::new();
    match seen.refused {
        Some(EcgRefused::Empty) => said.push(
            "the electrocardiogram has no samples, or stands still: beats begin with the pressure's \
             rise"
                .to_owned(),
        ),
        Some(EcgRefused::Disagrees { once, of }) => said.push(format!(
            "the electrocardiogram does not agree with the pressure, which rises once in {once} of \
             {of} beats between its R waves: beats begin with the pressure's rise. Check the lead, \
             or set source in [steps.beats]"
        )),
        Some(EcgRefused::Late { delay_ms }) => said.push(format!(
            "the electrocardiogram does not agree with the pressure, which rises {delay_ms:.0} ms after its R \
             waves: beats begin with the pressure's rise. Check that both have one clock, or set source in \
             [steps.beats]"
        )),
        Some(EcgRefused::Scattered { spread_ms }) => said.push(format!(
            "the electrocardiogram does not agree with the pressure, whose rises come at any time \
             after its R waves (they vary by {spread_ms:.0} ms): beats begin with the pressure's rise. \
             Check that both are of the same patient and clock, or set source in [steps.beats]"
        )),
        None => {}
    }
    if seen.refused.is_none() && seen.without_ms > WITHOUT_ECG_MS {
        said.push(format!(
            "{:.0} s of the recording are without an electrocardiogram and give no beats",
            1e-3 * seen.without_ms
        ));
    }
    match seen.cleaned {
        Some(Cleaned::Spikes) => said.push(
            "pacing spikes were removed from the electrocardiogram before R waves were found"
                .to_owned(),
        ),
        Some(Cleaned::SpikesAndHum) => said.push(
            "the hum of mains was removed from the electrocardiogram before R waves were found"
                .to_owned(),
        ),
        None => {}
    }
    said
}

/// Amplitude of hum in a pressure from which a warning is given, mmHg.
const HUM_MMHG: f64 = 2.0;

/// Warnings about hum in the pressures, which the mean of few beats keeps.
fn of_hum(folder: &RawFolder) -> Vec<String> {
    let channels = &folder.recording.channels;
    let pressures = [
        ("ventricle", &channels.lv_pressure_mmhg),
        ("aorta", &channels.aortic_pressure_mmhg),
    ];
    let told = |(name, values): (&str, &Option<Vec<f64>>)| {
        let mmhg = amplitude(&folder.recording, values.as_ref()?);
        (mmhg > HUM_MMHG).then(|| {
            format!(
                "the {name}'s pressure has a hum of mains of {mmhg:.1} mmHg, which moves end-diastolic \
                 pressure and slopes: filter it at 50 or 60 Hz, or record again"
            )
        })
    };
    pressures.into_iter().filter_map(told).collect()
}

/// Pause from which the heart may have changed, so that a warning is given, ms.
const LONG_PAUSE_MS: f64 = 600_000.0;

/// A warning about long pauses: beats of both sides are averaged together.
fn of_pauses(folder: &RawFolder) -> Option<String> {
    let recording = &folder.recording;
    let long: Vec<String> = recording
        .pauses
        .iter()
        .filter(|pause| pause.gap_ms >= LONG_PAUSE_MS)
        .map(|pause| {
            let begin_ms = recording.begin_ms + recording.elapsed_ms(pause.until_ms) - pause.gap_ms;
            format!(
                "{:.1} min after {:.1} s",
                pause.gap_ms / 60_000.0,
                1e-3 * begin_ms
            )
        })
        .collect();
    (!long.is_empty()).then(|| {
        format!(
            "the recording pauses for {}: beats of both sides are averaged; if the heart changed \
             meanwhile, leave one side out with leave_out_ms in [steps.reject]",
            long.join(" and for ")
        )
    })
}

/// Descriptions of all steps in their order.
pub fn done(folder: &RawFolder, prepared: &Prepared, facts: &Facts, load: &Load) -> Vec<StepDone> {
    let settings = &folder.file.steps;
    let mut steps = vec![
        beats(folder, prepared),
        reject(prepared, settings),
        drift(prepared, settings),
        average(prepared, settings),
        noise(prepared, facts, settings),
    ];
    match &prepared.volume {
        Some(volume) if volume.on_pressure_clock => {
            steps.extend(["volume", "cycle", "synchronise"].map(|name| {
                let what = "the volume was recorded with the pressure: unchanged";
                step(name, StepState::Unchanged, what, [])
            }));
        }
        Some(volume) => steps.extend([
            adjusted(volume, settings),
            cycle(volume, settings),
            synchronise(volume, prepared, settings),
        ]),
        None => steps.extend(
            ["volume", "cycle", "synchronise"]
                .map(|name| step(name, StepState::Lacking, "no cine series", [])),
        ),
    }
    steps.push(afterload(load));
    steps
}

fn step<const N: usize>(
    name: &str,
    state: StepState,
    what: impl Into<String>,
    numbers: [(&str, f64); N],
) -> StepDone {
    let numbers: BTreeMap<String, f64> = numbers
        .into_iter()
        .filter(|(_, v)| v.is_finite())
        .map(|(k, v)| (k.to_owned(), v))
        .collect();
    StepDone {
        step: name.to_owned(),
        state,
        what: what.into(),
        numbers,
    }
}

fn beats(folder: &RawFolder, prepared: &Prepared) -> StepDone {
    let found = &prepared.found;
    let state = if found.source == BeatSource::Given {
        StepState::Given
    } else {
        StepState::Done
    };
    let lengths = found.beats.iter().map(|beat| beat.length_ms);
    let (low, high) = lengths.fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
    let what = format!(
        "{} beats of {low:.0} to {high:.0} ms from the {}; {:.1} s outside of whole beats",
        found.beats.len(),
        source_in_words(folder, prepared),
        found.left_over_ms * 1e-3
    );
    step(
        "beats",
        state,
        what,
        [
            ("beats", found.beats.len() as f64),
            ("shortest_ms", low),
            ("longest_ms", high),
            ("left_over_ms", found.left_over_ms),
        ],
    )
}

fn reject(prepared: &Prepared, settings: &RawSteps) -> StepDone {
    let n = prepared
        .reasons
        .iter()
        .filter(|reasons| !reasons.is_empty())
        .count();
    let state = match (settings.reject.enabled, n) {
        (false, _) => StepState::Off,
        (true, 0) => StepState::Unchanged,
        _ => StepState::Done,
    };
    let what = match n {
        0 => "no beat is excluded".to_owned(),
        1 => format!("1 beat is excluded: {}", counts(&prepared.reasons)),
        n => format!("{n} beats are excluded: {}", counts(&prepared.reasons)),
    };
    step(
        "reject",
        state,
        what,
        [
            ("left_out", n as f64),
            ("kept", (prepared.reasons.len() - n) as f64),
        ],
    )
}

fn drift(prepared: &Prepared, settings: &RawSteps) -> StepDone {
    let named = [
        ("ventricle", prepared.drifts.lv_pressure),
        ("aorta", prepared.drifts.aortic_pressure),
    ];
    let seen: Vec<(&str, Drift)> = named
        .iter()
        .filter_map(|(name, drift)| Some((*name, (*drift)?)))
        .collect();
    if seen.is_empty() {
        return step(
            "drift",
            StepState::Lacking,
            "too few beats to detect a drift",
            [],
        );
    }
    let words = |(name, drift): &(&str, Drift)| {
        let done = if drift.removed { "removed" } else { "kept" };
        format!(
            "{name} {:+.2} mmHg/min (standard error {:.2}), {done}",
            drift.mmhg_per_min, drift.standard_error_mmhg_per_min
        )
    };
    let state = match (
        settings.drift.enabled,
        seen.iter().any(|(_, drift)| drift.removed),
    ) {
        (false, _) => StepState::Off,
        (true, true) => StepState::Done,
        (true, false) => StepState::Unchanged,
    };
    let what = seen.iter().map(words).collect::<Vec<_>>().join("; ");
    let of = |name: &str| {
        seen.iter()
            .find(|(n, _)| *n == name)
            .map_or(f64::NAN, |(_, d)| d.mmhg_per_min)
    };
    step(
        "drift",
        state,
        what,
        [
            ("ventricle_mmHg_per_min", of("ventricle")),
            ("aorta_mmHg_per_min", of("aorta")),
        ],
    )
}

fn average(prepared: &Prepared, settings: &RawSteps) -> StepDone {
    let average = &prepared.average;
    let [low, high] = average.lengths_ms;
    let numbers = [
        ("beats", average.n_averaged as f64),
        ("cycle_length_ms", average.cycle_length_ms),
        ("rise_sd_ms", average.landmark_sd_ms[0]),
        ("fall_sd_ms", average.landmark_sd_ms[1]),
    ];
    if !settings.average.enabled {
        let what = format!("one beat, resampled to {:.0} ms", average.cycle_length_ms);
        return step("average", StepState::Off, what, numbers);
    }
    let aligned = if settings.average.align {
        format!(
            "aligned by moving rises by {:.1} ms and falls by {:.1} ms (standard deviations)",
            average.landmark_sd_ms[0], average.landmark_sd_ms[1]
        )
    } else {
        "aligned at their beginnings".to_owned()
    };
    let what = format!(
        "{} beats of {low:.0} to {high:.0} ms, resampled to {:.1} ms; {aligned}",
        average.n_averaged, average.cycle_length_ms
    );
    let state = if settings.average.cycle_length_ms.is_some() {
        StepState::Given
    } else {
        StepState::Done
    };
    step("average", state, what, numbers)
}

fn noise(prepared: &Prepared, facts: &Facts, settings: &RawSteps) -> StepDone {
    let (rms, correlation) = facts.pressure_noise;
    let given = [
        settings.noise.pressure_rms_mmhg,
        settings.noise.pressure_correlation_ms,
        settings.noise.volume_rms_ml,
    ];
    let mut words = Vec::new();
    if let Some(seen) = prepared.noise {
        let whose = match settings.noise.of {
            NoiseOf::Mean => "of the mean",
            NoiseOf::Beat => "of one beat",
        };
        words.push(format!(
            "beats differ by {:.2} mmHg with a correlation time of {:.1} ms, their levels by {:.2} \
             mmHg and their amplitudes by {:.1} % (worth {:.1} beats)",
            seen.beat_rms_mmhg,
            seen.correlation_ms,
            seen.level_sd_mmhg,
            100.0 * seen.strength_sd,
            seen.n_effective
        ));
        rms.into_iter()
            .for_each(|rms| words.push(format!("stated {whose}: {rms:.2} mmHg")));
    }
    facts
        .volume_noise_ml
        .into_iter()
        .for_each(|ml| words.push(format!("frames: {ml:.1} mL")));
    let state = match (settings.noise.enabled, given.iter().any(Option::is_some)) {
        (_, true) => StepState::Given,
        (false, false) => StepState::Off,
        (true, false) if words.is_empty() => StepState::Lacking,
        (true, false) => StepState::Done,
    };
    let what = if words.is_empty() {
        "too few beats to compare".to_owned()
    } else {
        words.join("; ")
    };
    let seen = |value: fn(&cardiotwin_recordings::noise::Noise) -> f64| {
        prepared.noise.as_ref().map_or(f64::NAN, value)
    };
    step(
        "noise",
        state,
        what,
        [
            ("pressure_rms_mmHg", rms.unwrap_or(f64::NAN)),
            ("pressure_correlation_ms", correlation.unwrap_or(f64::NAN)),
            ("beat_rms_mmHg", seen(|n| n.beat_rms_mmhg)),
            ("level_sd_mmHg", seen(|n| n.level_sd_mmhg)),
            ("strength_sd", seen(|n| n.strength_sd)),
            ("volume_rms_mL", facts.volume_noise_ml.unwrap_or(f64::NAN)),
        ],
    )
}

fn adjusted(volume: &PreparedVolume, settings: &RawSteps) -> StepDone {
    let a = &volume.adjusted;
    let numbers = [
        ("factor", a.factor),
        ("shift_mL", a.shift_ml),
        ("cine_volume_at_image_mL", a.before_ml.unwrap_or(f64::NAN)),
        (
            "stroke_volume_before_mL",
            volume.original.stroke_volume_ml(),
        ),
        ("stroke_volume_mL", a.cine.stroke_volume_ml()),
    ];
    let stroke = format!(
        "stroke volume {:.1} mL, was {:.1} mL",
        a.cine.stroke_volume_ml(),
        volume.original.stroke_volume_ml()
    );
    let (state, what) = match (
        settings.volume.enabled,
        settings.volume.factor,
        a.before_ml,
        settings.volume.adjust,
    ) {
        (false, ..) => (StepState::Off, "volumes are unchanged".to_owned()),
        (true, Some(factor), ..) => (
            StepState::Given,
            format!("volumes times {factor}; {stroke}"),
        ),
        (true, None, None, _) => (
            StepState::Lacking,
            "no whole-heart image: volumes are unchanged".to_owned(),
        ),
        (true, None, Some(before), VolumeAdjustment::Scale) => (
            StepState::Done,
            format!(
                "volumes times {:.4}, so that {before:.1} mL at the image's time become the image's \
                 volume; {stroke}",
                a.factor
            ),
        ),
        (true, None, Some(before), VolumeAdjustment::Shift) => (
            StepState::Done,
            format!(
                "volumes {:+.2} mL, so that {before:.1} mL at the image's time become the image's \
                 volume; {stroke}",
                a.shift_ml
            ),
        ),
    };
    step("volume", state, what, numbers)
}

fn cycle(volume: &PreparedVolume, settings: &RawSteps) -> StepDone {
    let r = &volume.reconciled;
    let [from, to] = r.cycle_lengths_ms;
    let apart = settings.cycle.enabled || settings.cycle.systole_factor.is_some();
    let state = match (apart, settings.cycle.systole_factor) {
        (false, _) => StepState::Off,
        (true, Some(_)) => StepState::Given,
        (true, None) if volume.ejection.is_none() => StepState::Lacking,
        (true, None) => StepState::Done,
    };
    let what = if (r.systole_factor - r.diastole_factor).abs() < 1e-9 {
        format!(
            "the cine's cycle of {from:.0} ms scaled to {to:.0} ms: the whole cycle by {:.3}",
            r.systole_factor
        )
    } else {
        format!(
            "the cine's cycle of {from:.0} ms scaled to {to:.0} ms: systole by {:.3}, diastole by \
             {:.3}",
            r.systole_factor, r.diastole_factor
        )
    };
    step(
        "cycle",
        state,
        what,
        [
            ("cine_cycle_length_ms", from),
            ("cycle_length_ms", to),
            ("systole_factor", r.systole_factor),
            ("diastole_factor", r.diastole_factor),
            ("systole_end_ms", r.systole_end_ms),
        ],
    )
}

fn synchronise(volume: &PreparedVolume, prepared: &Prepared, settings: &RawSteps) -> StepDone {
    let lag = &volume.lag;
    let [opening, closure] = lag.by_events_ms.unwrap_or([f64::NAN; 2]);
    let error = volume
        .ejection
        .map_or(f64::NAN, |ejection| ejection.middle_error_ms);
    let valves = prepared.valves;
    let numbers = [
        ("lag_ms", lag.taken_ms()),
        ("lag_by_opening_ms", opening),
        ("lag_by_closure_ms", closure),
        ("standard_error_ms", error),
        (
            "aortic_opening_ms",
            valves.map_or(f64::NAN, |v| v.aortic_opening_ms),
        ),
        (
            "aortic_closure_ms",
            valves.map_or(f64::NAN, |v| v.aortic_closure_ms),
        ),
    ];
    let (state, what) = match (
        settings.synchronise.enabled,
        settings.synchronise.lag_ms,
        lag.by_events_ms,
    ) {
        (false, ..) => (
            StepState::Off,
            "pressure and volume are unchanged".to_owned(),
        ),
        (true, Some(given), _) => (
            StepState::Given,
            format!("the volume was shifted by {:+.1} ms", -given),
        ),
        (true, None, None) => (
            StepState::Lacking,
            "valve events were not found in both: pressure and volume are unchanged".to_owned(),
        ),
        (true, None, Some(_)) => (
            StepState::Done,
            format!(
                "the volume was shifted by {:+.1} ms (standard error {error:.1}): ejection was \
                 {opening:+.1} ms from the aortic valve's opening and {closure:+.1} ms from its \
                 closure",
                -lag.ms
            ),
        ),
    };
    step("synchronise", state, what, numbers)
}

fn afterload(load: &Load) -> StepDone {
    let parameters = load.parameters();
    let numbers = parameters.as_ref().map_or([f64::NAN; 3], |p| {
        [
            p.characteristic_resistance_mmhg_s_per_ml,
            p.peripheral_resistance_mmhg_s_per_ml,
            p.compliance_ml_per_mmhg,
        ]
    });
    let [r1, r2, c] = numbers;
    let (state, what) = match (load, load.how()) {
        (Load::Off, _) => (StepState::Off, "no Windkessel is fitted".to_owned()),
        (Load::Lacking(what), _) => (StepState::Lacking, (*what).to_owned()),
        (Load::Failed(why), _) => (StepState::Lacking, why.clone()),
        (_, how) => {
            let how = how.unwrap_or_default();
            (
                StepState::Done,
                format!("R1 {r1:.4}, R2 {r2:.4} mmHg s/mL, C {c:.3} mL/mmHg, {how}"),
            )
        }
    };
    step(
        "afterload",
        state,
        what,
        [
            ("characteristic_resistance_mmHg_s_per_mL", r1),
            ("peripheral_resistance_mmHg_s_per_mL", r2),
            ("compliance_mL_per_mmHg", c),
        ],
    )
}

/// Warnings about results that the user should check.
pub fn warnings(folder: &RawFolder, prepared: &Prepared) -> Vec<String> {
    let mut said = Vec::new();
    let n = prepared.reasons.len();
    let left_out = prepared
        .reasons
        .iter()
        .filter(|reasons| !reasons.is_empty())
        .count();
    if left_out as f64 > MANY_LEFT_OUT * n as f64 {
        said.push(format!(
            "{left_out} of {n} beats are excluded: check prepare.html, and [steps.reject] of \
             prepare.toml"
        ));
    }
    if folder.file.steps.average.enabled && prepared.average.n_averaged < FEW_BEATS {
        said.push(format!(
            "the mean covers only {}",
            beats_in_words(prepared.average.n_averaged)
        ));
    }
    if prepared.average.lv_pressure.is_none() {
        said.push(
            "there is no ventricular pressure: a patient needs one, or its biomarkers".to_owned(),
        );
    }
    said.extend(of_pauses(folder));
    said.extend(of_ecg(prepared));
    said.extend(of_hum(folder));
    let of_images = prepared.volume.as_ref();
    let Some(volume) = of_images.filter(|volume| !volume.on_pressure_clock) else {
        return said;
    };
    let by_r_wave = prepared.found.source == BeatSource::RWave;
    if by_r_wave && volume.lag.removed && volume.lag.ms.abs() > LATE_BY_R_WAVE_MS {
        said.push(format!(
            "the volume was shifted by {:+.0} ms, but both begin with an R wave: check that the beats \
             begin where the electrocardiogram's R waves are, and the trigger of the images",
            -volume.lag.ms
        ));
    }
    if !LARGE_FACTOR.contains(&volume.adjusted.factor) {
        said.push(format!(
            "volumes are multiplied by {:.3} to meet the whole-heart image: check its time, and both segmentations",
            volume.adjusted.factor
        ));
    }
    if let Some(ratio) = volume.reconciled.implausible {
        said.push(format!(
            "the cine's systole would have to be scaled by {ratio:.2}, which is implausible: the \
             whole cycle is scaled uniformly"
        ));
    }
    if prepared.valves.is_some() && volume.ejection.is_none() {
        said.push(
            "no ejection was found in the cine's frames: pressure and volume are not synchronised"
                .to_owned(),
        );
    }
    let given = folder.file.steps.synchronise.lag_ms.is_some();
    if let Some(ejection) = volume
        .ejection
        .filter(|e| !given && e.middle_error_ms > UNCERTAIN_MS)
    {
        said.push(format!(
            "the lag is only known to {:.0} ms: the frames are few or noisy",
            ejection.middle_error_ms
        ));
    }
    if let Some([opening, closure]) = volume.lag.by_events_ms
        && (opening - closure).abs() > EVENTS_APART_MS
    {
        said.push(format!(
            "ejection is {opening:.0} ms from the valve's opening and {closure:.0} ms from its \
             closure: its duration differs"
        ));
    }
    said
}

fn beats_in_words(n: usize) -> String {
    if n == 1 {
        "1 beat".to_owned()
    } else {
        format!("{n} beats")
    }
}
