//! Lines of a preparation in the form that the report draws.

use std::collections::BTreeSet;

use cardiotwin_recordings::beats::Beat;
use cardiotwin_recordings::cine::Cine;
use cardiotwin_recordings::prepare::Prepared;
use cardiotwin_recordings::recording::at;
use cardiotwin_schemas::preparation::Preparation;

use cardiotwin_input::RawFolder;
use cardiotwin_input::preparation::Made;
use cardiotwin_report::html::preparation::{BeatLines, Line, RecordingLines, VolumeLines};

/// Most points in the line of one beat. Half an hour of recording has thousands of beats.
const POINTS: f64 = 160.0;
/// Approximate number of points in the lines of all beats together.
const ALL_POINTS: f64 = 80_000.0;
/// Most points in the line of the whole recording.
const STRIP_POINTS: f64 = 30_000.0;

/// Descriptions of the wanted steps, one line each.
fn steps(answer: &Preparation, wanted: &[&str]) -> Vec<String> {
    let chosen = answer
        .steps
        .iter()
        .filter(|step| wanted.contains(&step.step.as_str()));
    chosen
        .map(|step| format!("{}: {}", step.step, step.what))
        .collect()
}

/// Lines of all beats as recorded, and their mean with its standard deviation.
pub fn beats(folder: &RawFolder, made: &Made) -> BeatLines {
    let prepared: &Prepared = &made.prepared;
    let recording = &folder.recording;
    let pressure = recording.leading_pressure();
    let n_beats = prepared.found.beats.len() as f64;
    let points = POINTS.min(ALL_POINTS / n_beats).max(24.0);
    let line = |beat: &Beat| -> Line {
        let step = (beat.length_ms / points).max(recording.step_ms);
        let n = (beat.length_ms / step) as usize;
        let place = |t: f64| at(pressure, (beat.onset_ms + t) / recording.step_ms);
        (0..=n)
            .map(|k| k as f64 * step)
            .map(|t| (t, place(t)))
            .collect()
    };
    let average = &prepared.average;
    let mean: Line = average
        .leading_pressure()
        .iter()
        .enumerate()
        .map(|(i, p)| (i as f64 * average.step_ms, *p))
        .collect();
    let spread = average
        .lv_pressure
        .as_ref()
        .or(average.aortic_pressure.as_ref())
        .map_or(&[][..], |trace| &trace.sd);
    let shifted = |sign: f64| {
        mean.iter()
            .zip(spread)
            .map(|((t, p), sd)| (*t, p + sign * sd))
            .collect::<Line>()
    };
    let mut found = BeatLines {
        title: format!(
            "{}: beats from the {}",
            made.answer.id, made.answer.beats.source
        ),
        band: [shifted(-1.0), shifted(1.0)],
        ..BeatLines::default()
    };
    for (number, beat, reasons) in prepared.judged() {
        match reasons.first() {
            None => found.kept.push(line(beat)),
            Some(reason) => found
                .left_out
                .push((format!("beat {number}: {reason}"), line(beat))),
        }
    }
    let kinds: BTreeSet<&str> = prepared
        .reasons
        .iter()
        .filter_map(|r| r.first())
        .map(|r| r.kind())
        .collect();
    let named: Vec<&str> = kinds.into_iter().collect();
    let left_out = if named.is_empty() {
        String::new()
    } else {
        format!(" ({})", named.join(", "))
    };
    found.text = vec![format!(
        "{} beats, {} in the mean of {:.0} ms, {} excluded{left_out}",
        prepared.found.beats.len(),
        found.kept.len(),
        average.cycle_length_ms,
        found.left_out.len()
    )];
    found
        .text
        .extend(steps(&made.answer, &["drift", "average"]));
    found.mean = mean;
    if let Some(valves) = prepared.valves {
        found.events = vec![
            ("aortic valve opens", valves.aortic_opening_ms),
            ("aortic valve closes", valves.aortic_closure_ms),
            ("mitral valve opens", valves.mitral_opening_ms),
        ];
    }
    found
}

/// The whole recording, cut into beats, with its gaps.
pub fn recording(folder: &RawFolder, made: &Made) -> RecordingLines {
    let prepared: &Prepared = &made.prepared;
    let recording = &folder.recording;
    let pressure = recording.leading_pressure();
    let n = pressure.len();
    let every = (n as f64 / STRIP_POINTS).ceil().max(1.0) as usize;
    let seconds = |i: usize| 1e-3 * (recording.begin_ms + i as f64 * recording.step_ms);
    let line = |from: usize, to: usize| -> Line {
        let to = to.min(n.saturating_sub(1));
        (from..=to)
            .step_by(every)
            .map(|i| {
                // A missing sample between two drawn ones is a gap too.
                let lost = pressure[i..(i + every).min(n)]
                    .iter()
                    .any(|p| !p.is_finite());
                (seconds(i), if lost { f64::NAN } else { pressure[i] })
            })
            .collect()
    };
    let mut lines = RecordingLines::default();
    let mut last = 0;
    for (number, beat, reasons) in prepared.judged() {
        let from = (beat.onset_ms / recording.step_ms).max(0.0) as usize;
        let to = ((beat.onset_ms + beat.length_ms) / recording.step_ms) as usize;
        if from > last + 1 {
            lines.outside.push(line(last, from));
        }
        last = to;
        match reasons.first() {
            None => lines.kept.push(line(from, to)),
            Some(reason) => lines
                .left_out
                .push((format!("beat {number}: {reason}"), line(from, to))),
        }
    }
    if last + 1 < n {
        lines.outside.push(line(last, n - 1));
    }
    let mut i = 0;
    while i < n {
        let lost = pressure[i..].iter().take_while(|p| !p.is_finite()).count();
        if lost > 0 {
            lines.gaps_s.push((seconds(i), seconds(i + lost)));
        }
        i += lost.max(1);
    }
    lines
}

/// Volume frames and pressure-volume loops; `None` without a cine series.
pub fn volume(folder: &RawFolder, made: &Made) -> Option<VolumeLines> {
    let prepared: &Prepared = &made.prepared;
    let volume = prepared.volume.as_ref()?;
    let frames = |cine: &Cine| -> Line {
        cine.time_ms
            .iter()
            .copied()
            .zip(cine.volume_ml.iter().copied())
            .collect()
    };
    let average = &prepared.average;
    let around = |cine: &Cine| -> Line {
        let Some(lv) = &average.lv_pressure else {
            return Line::new();
        };
        let time = |i: usize| i as f64 * average.step_ms;
        let mut line: Line = lv
            .mean
            .iter()
            .enumerate()
            .map(|(i, p)| (cine.at(time(i)), *p))
            .collect();
        line.extend(line.first().copied());
        line
    };
    Some(VolumeLines {
        title: format!("{}: volume after each step", made.answer.id),
        text: steps(&made.answer, &["volume", "cycle", "synchronise"]),
        original: frames(&volume.original),
        adjusted: frames(&volume.adjusted.cine),
        image: folder
            .file
            .whole_heart
            .as_ref()
            .map(|image| (image.time_ms, image.volume_ml)),
        synchronised: frames(&volume.synchronised),
        sheared_loop: around(&volume.sheared),
        synchronised_loop: around(&volume.synchronised),
    })
}
