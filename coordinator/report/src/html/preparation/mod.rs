//! Figures of a preparation, as SVG files and as a page: all beats, their mean, and frames and loops
//! before and after each step.

mod page;
mod understood;

pub use page::{RecordingLines, preparation_page};
pub use understood::{UnderstoodBeat, understood_svg};

use super::plot::{Axis, Chart, Mark, Scale, Series, stacked};

/// Points of a line, x and y.
pub type Line = Vec<(f64, f64)>;

/// Beats of a recording, aligned at their beginning: time in ms, pressure in mmHg.
#[derive(Debug, Clone, Default)]
pub struct BeatLines {
    /// Headline of the figure.
    pub title: String,
    /// Lines of text below the headline.
    pub text: Vec<String>,
    /// Beats that are part of the mean.
    pub kept: Vec<Line>,
    /// Beats that are not part of the mean, with their number and the reason.
    pub left_out: Vec<(String, Line)>,
    /// Mean of the kept beats.
    pub mean: Line,
    /// The mean minus and plus the standard deviation between beats.
    pub band: [Line; 2],
    /// Marked times in ms, with their names.
    pub events: Vec<(&'static str, f64)>,
}

/// Characters that fit on a line.
const WIDTH: usize = 96;

/// Text broken into lines that are not cut off at the picture's edge.
fn wrapped(text: &[String]) -> Vec<String> {
    let mut lines = Vec::new();
    for whole in text {
        let mut line = String::new();
        for word in whole.split(' ') {
            if !line.is_empty() && line.chars().count() + word.chars().count() >= WIDTH {
                lines.push(std::mem::replace(&mut line, "   ".to_owned()));
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
        lines.push(line);
    }
    lines
}

/// Text of an SVG file: kept beats and the mean above, left-out beats in the middle, the mean with
/// its spread below. `None` without a finite sample.
#[must_use]
pub fn beats_svg(beats: &BeatLines) -> Option<String> {
    let charts = beats_charts(beats)?;
    Some(stacked(&beats.title, &wrapped(&beats.text), &charts))
}

fn beats_charts(beats: &BeatLines) -> Option<[Chart; 3]> {
    let last = beats.mean.last()?.0;
    let all = || {
        beats
            .kept
            .iter()
            .chain(beats.left_out.iter().map(|(_, line)| line))
            .flatten()
    };
    let values = all()
        .filter(|p| p.0 <= 1.6 * last)
        .map(|p| p.1)
        .filter(|p| (-40.0..300.0).contains(p));
    let y = Scale::linear(values.chain(beats.mean.iter().map(|p| p.1)), false)?;
    let longest = all().map(|p| p.0).fold(last, f64::max).min(1.6 * last);
    let chart = |alt: &str, end: f64| {
        let mut chart = Chart::new(
            alt,
            Axis::new(
                "time from the beat's beginning (ms)",
                "ms",
                Scale::exact(0.0, end),
            ),
            Axis::new("pressure (mmHg)", "mmHg", y),
        );
        chart.size = (720.0, 250.0);
        chart
    };
    let within = |line: &Line| -> Line {
        let (low, high, _) = y.ends();
        line.iter()
            .filter(|p| p.0 <= longest)
            .map(|p| (p.0, p.1.clamp(low, high)))
            .collect()
    };
    let series = |class, name: String, points| Series {
        class,
        name,
        points,
        dots: false,
    };
    let mut first = chart("beats in the mean and the mean itself", longest);
    first.series.push(series(
        "beat",
        format!("{} beats in the mean", beats.kept.len()),
        Vec::new(),
    ));
    first.series.push(series(
        "out",
        format!("{} excluded", beats.left_out.len()),
        Vec::new(),
    ));
    first.series.extend(
        beats
            .kept
            .iter()
            .map(|line| series("beat", String::new(), within(line))),
    );
    first
        .series
        .push(series("step2", "mean".to_owned(), beats.mean.clone()));
    let mut second = chart("excluded beats and the mean", longest);
    second.series.extend(
        beats
            .left_out
            .iter()
            .map(|(name, line)| series("out", name.clone(), within(line))),
    );
    second
        .series
        .push(series("step2", "mean".to_owned(), beats.mean.clone()));
    let mut third = chart("mean and spread between beats", last);
    let [lower, upper] = beats.band.clone();
    third.marks.push(Mark::Between {
        lower,
        upper,
        class: "most",
    });
    third
        .marks
        .extend(beats.events.iter().map(|(_, x)| Mark::Up {
            x: *x,
            class: "phase",
        }));
    third
        .marks
        .extend(event_marks(&beats.events, &beats.mean, y));
    third
        .series
        .push(series("step2", "mean".to_owned(), beats.mean.clone()));
    Some([first, second, third])
}

/// Marks of named times on a line. Labels are centred where they stand: these are right of their dots,
/// below a high line and above a low one, so that neither the line nor each other's text is covered.
fn event_marks(events: &[(&'static str, f64)], line: &Line, scale: Scale) -> Vec<Mark> {
    let (low, high, _) = scale.ends();
    let mark = |(name, x): &(&'static str, f64)| {
        let place = line.partition_point(|point| point.0 <= *x);
        let y = line.get(place.checked_sub(1)?)?.1;
        let right = 10.0 + 3.6 * name.chars().count() as f64;
        let below = if y > low + 0.3 * (high - low) {
            12.0
        } else {
            -8.0
        };
        Some(Mark::Point {
            x: *x,
            y,
            class: "event",
            title: format!("{name}: {x:.0} ms"),
            label: Some(((*name).into(), right, below)),
        })
    };
    events.iter().filter_map(mark).collect()
}

/// Volume and loop after each step of a preparation.
#[derive(Debug, Clone, Default)]
pub struct VolumeLines {
    /// Headline of the figure.
    pub title: String,
    /// Lines of text below the headline.
    pub text: Vec<String>,
    /// Frames as measured, on their own clock: time in ms, volume in mL.
    pub original: Line,
    /// Frames after their adjustment to the whole-heart image.
    pub adjusted: Line,
    /// Time in ms and volume in mL of the whole-heart image.
    pub image: Option<(f64, f64)>,
    /// Synchronised frames on the catheter's clock.
    pub synchronised: Line,
    /// Loop before the synchronisation: volume in mL, pressure in mmHg.
    pub sheared_loop: Line,
    /// Loop after the synchronisation.
    pub synchronised_loop: Line,
}

/// Text of an SVG file with the frames above and the loops below. `None` without a finite volume.
#[must_use]
pub fn volume_svg(volume: &VolumeLines) -> Option<String> {
    let charts = volume_charts(volume)?;
    Some(stacked(&volume.title, &wrapped(&volume.text), &charts))
}

/// Frames, and the loops if there is a pressure of the ventricle.
fn volume_charts(volume: &VolumeLines) -> Option<Vec<Chart>> {
    let lines = [&volume.original, &volume.adjusted, &volume.synchronised];
    let values = lines
        .into_iter()
        .flatten()
        .map(|p| p.1)
        .chain(volume.image.map(|p| p.1));
    let times = lines.into_iter().flatten().map(|p| p.0);
    let end = times.fold(0.0, f64::max);
    let mut frames = Chart::new(
        "frames after each step",
        Axis::new("time (ms)", "ms", Scale::exact(0.0, end)),
        Axis::new("volume (mL)", "mL", Scale::linear(values, false)?),
    );
    frames.size = (720.0, 270.0);
    let series = |class, name: &str, points: &Line, dots| Series {
        class,
        name: name.to_owned(),
        points: points.clone(),
        dots,
    };
    frames.series.push(series(
        "measured",
        "frames as measured",
        &volume.original,
        true,
    ));
    frames.series.push(series(
        "step1",
        "adjusted; loop before",
        &volume.adjusted,
        false,
    ));
    frames.series.push(series(
        "step2",
        "synchronised; loop after",
        &volume.synchronised,
        false,
    ));
    frames.marks.extend(volume.image.map(|(x, y)| Mark::Cross {
        x,
        y,
        class: "image",
        title: format!("whole-heart image: {y:.1} mL at {x:.0} ms"),
    }));
    if volume.sheared_loop.is_empty() {
        return Some(vec![frames]);
    }
    let both = || volume.sheared_loop.iter().chain(&volume.synchronised_loop);
    let mut loops = Chart::new(
        "loops before and after synchronising",
        Axis::new(
            "volume (mL)",
            "mL",
            Scale::linear(both().map(|p| p.0), false)?,
        ),
        Axis::new(
            "pressure (mmHg)",
            "mmHg",
            Scale::linear(both().map(|p| p.1), false)?,
        ),
    );
    loops.size = (720.0, 380.0);
    loops.series.push(series(
        "step1",
        "before synchronising",
        &volume.sheared_loop,
        false,
    ));
    loops
        .series
        .push(series("step2", "after", &volume.synchronised_loop, false));
    Some(vec![frames, loops])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_beat_is_drawn_and_named_where_it_is_left_out() {
        let beat = |top: f64| {
            (0..80)
                .map(|i| (f64::from(10 * i), top * (f64::from(i) / 25.0).sin().abs()))
                .collect::<Line>()
        };
        let beats = BeatLines {
            title: "P <1>".into(),
            kept: vec![beat(100.0), beat(101.0)],
            left_out: vec![("beat 3: came early".into(), beat(60.0))],
            mean: beat(100.5),
            band: [beat(99.0), beat(102.0)],
            ..BeatLines::default()
        };
        let svg = beats_svg(&beats).unwrap();
        assert_eq!(
            svg.matches("class=\"line beat\" d=\"M").count(),
            3,
            "two beats and the legend's key"
        );
        assert!(
            svg.contains("beat 3: came early")
                && svg.contains("P &lt;1&gt;")
                && !svg.contains("NaN")
        );
        assert_eq!(beats_svg(&BeatLines::default()), None);
        let volume = VolumeLines {
            original: vec![(0.0, 150.0), (400.0, 80.0)],
            adjusted: vec![(0.0, 155.0), (400.0, 83.0)],
            synchronised: vec![(0.0, 150.0), (380.0, 83.0)],
            image: Some((300.0, 140.0)),
            sheared_loop: vec![(150.0, 8.0), (80.0, 100.0)],
            synchronised_loop: vec![(150.0, 8.0), (80.0, 110.0)],
            ..VolumeLines::default()
        };
        let svg = volume_svg(&volume).unwrap();
        assert!(svg.contains("whole-heart image: 140.0 mL") && svg.matches("<circle").count() == 3);
    }
}
