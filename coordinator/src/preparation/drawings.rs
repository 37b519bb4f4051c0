//! What is drawn of a preparation, as plain lines: the report draws them.

use std::collections::BTreeSet;

use cardiotwin_recordings::beats::Beat;
use cardiotwin_recordings::cine::Cine;
use cardiotwin_recordings::prepare::Prepared;
use cardiotwin_recordings::recording::at;

use super::steps::source_in_words;
use crate::input::RawFolder;

/// A line: x and y.
pub type Line = Vec<(f64, f64)>;

/// Points of one beat's line, at most: half an hour has thousands of beats.
const POINTS: f64 = 160.0;
/// Points of the lines of all beats, about.
const ALL_POINTS: f64 = 80_000.0;

/// Lines of the beats.
#[derive(Debug, Clone, Default)]
pub struct Beats {
    /// Headline.
    pub title: String,
    /// What was done, a line a step.
    pub text: Vec<String>,
    /// Those in the mean.
    pub kept: Vec<Line>,
    /// Those that are not, with their number and the reason.
    pub left_out: Vec<(String, Line)>,
    /// The mean.
    pub mean: Line,
    /// The mean less and more the standard deviation.
    pub band: [Line; 2],
    /// Events of the valves.
    pub events: Vec<(&'static str, f64)>,
}

/// Lines of the volume.
#[derive(Debug, Clone, Default)]
pub struct Volume {
    /// Frames as measured, adjusted, synchronised.
    pub frames: [Line; 3],
    /// The whole-heart image.
    pub image: Option<(f64, f64)>,
    /// Loops: sheared, synchronised.
    pub loops: [Line; 2],
}

/// Every beat as it was recorded, and the mean.
pub fn beats(folder: &RawFolder, prepared: &Prepared, id: &str) -> Beats {
    let recording = &folder.recording;
    let pressure = recording.leading_pressure();
    let n_beats = prepared.found.beats.len() as f64;
    let points = POINTS.min(ALL_POINTS / n_beats).max(24.0);
    let line = |beat: &Beat| -> Line {
        let step = (beat.length_ms / points).max(recording.step_ms);
        let n = (beat.length_ms / step) as usize;
        let place = |t: f64| at(pressure, (beat.onset_ms + t) / recording.step_ms);
        (0..=n).map(|k| k as f64 * step).map(|t| (t, place(t))).filter(|p| p.1.is_finite()).collect()
    };
    let average = &prepared.average;
    let mean: Line =
        average.leading_pressure().iter().enumerate().map(|(i, p)| (i as f64 * average.step_ms, *p)).collect();
    let spread = average.lv_pressure.as_ref().or(average.aortic_pressure.as_ref()).map_or(&[][..], |trace| &trace.sd);
    let shifted = |sign: f64| mean.iter().zip(spread).map(|((t, p), sd)| (*t, p + sign * sd)).collect::<Line>();
    let mut found = Beats {
        title: format!("{id}: beats from the {}", source_in_words(folder, prepared)),
        band: [shifted(-1.0), shifted(1.0)],
        ..Beats::default()
    };
    for (idx, (beat, reasons)) in prepared.found.beats.iter().zip(&prepared.reasons).enumerate() {
        match reasons.first() {
            None => found.kept.push(line(beat)),
            Some(reason) => found.left_out.push((format!("beat {}: {reason}", idx + 1), line(beat))),
        }
    }
    let kinds: BTreeSet<&str> = prepared.reasons.iter().filter_map(|r| r.first()).map(|r| r.kind()).collect();
    let named: Vec<&str> = kinds.into_iter().collect();
    let left_out = if named.is_empty() { String::new() } else { format!(" ({})", named.join(", ")) };
    found.text = vec![format!(
        "{} beats, {} in the mean of {:.0} ms, {} left out{left_out}",
        prepared.found.beats.len(),
        found.kept.len(),
        average.cycle_length_ms,
        found.left_out.len()
    )];
    found.mean = mean;
    if let Some(valves) = prepared.valves {
        found.events = vec![
            ("aortic valve opens", valves.aortic_opening_ms),
            ("closes", valves.aortic_closure_ms),
            ("mitral valve opens", valves.mitral_opening_ms),
        ];
    }
    found
}

/// Frames and loops; none without a cine series.
pub fn volume(folder: &RawFolder, prepared: &Prepared) -> Option<Volume> {
    let volume = prepared.volume.as_ref()?;
    let frames = |cine: &Cine| -> Line { cine.time_ms.iter().copied().zip(cine.volume_ml.iter().copied()).collect() };
    let average = &prepared.average;
    let around = |cine: &Cine| -> Line {
        let Some(lv) = &average.lv_pressure else { return Line::new() };
        let time = |i: usize| i as f64 * average.step_ms;
        let mut line: Line = lv.mean.iter().enumerate().map(|(i, p)| (cine.at(time(i)), *p)).collect();
        line.extend(line.first().copied());
        line
    };
    Some(Volume {
        frames: [frames(&volume.original), frames(&volume.adjusted.cine), frames(&volume.synchronised)],
        image: folder.file.whole_heart.as_ref().map(|image| (image.time_ms, image.volume_ml)),
        loops: [around(&volume.sheared), around(&volume.synchronised)],
    })
}
