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
    let marks = event_marks(&beats.events, &beats.mean, &third);
    third.marks.extend(marks);
    third
        .series
        .push(series("step2", "mean".to_owned(), beats.mean.clone()));
    Some([first, second, third])
}

/// Width of a letter and height of a line of a label, in units of the chart. Bold letters are narrower
/// in most fonts.
const LETTER: (f64, f64) = (7.4, 15.0);

/// Left, upper, right and lower end of a box.
type Box4 = [f64; 4];

fn overlap(a: &Box4, b: &Box4) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Box of a label whose middle is `dx` right of a point and whose letters stand `dy` below it.
fn box_of(name: &str, (px, py): (f64, f64), (dx, dy): (f64, f64)) -> Box4 {
    let half = 0.5 * LETTER.0 * name.chars().count() as f64;
    let (x, y) = (px + dx, py + dy);
    [x - half, y - 0.8 * LETTER.1, x + half, y + 0.2 * LETTER.1]
}

/// Marks of named times on a line. Each label is next to its dot, where it covers neither an earlier
/// label nor another dot, inside of the chart: preferably right of the dot, below a high line and above
/// a low one.
fn event_marks(events: &[(&'static str, f64)], line: &Line, chart: &Chart) -> Vec<Mark> {
    let (low, high, _) = chart.y.scale.ends();
    let [left, right, top, bottom] = chart.area();
    let found: Vec<(&'static str, f64, f64, (f64, f64))> = events
        .iter()
        .filter_map(|(name, x)| {
            let place = line.partition_point(|point| point.0 <= *x);
            let y = line.get(place.checked_sub(1)?)?.1;
            Some((*name, *x, y, chart.place(*x, y)?))
        })
        .collect();
    let dot = |(px, py): (f64, f64)| [px - 5.0, py - 5.0, px + 5.0, py + 5.0];
    let mut taken: Vec<Box4> = found.iter().map(|(.., at)| dot(*at)).collect();
    let mut marks = Vec::new();
    for (name, x, y, at) in found {
        let beside = 10.0 + 0.5 * LETTER.0 * name.chars().count() as f64;
        let is_high = y > low + 0.3 * (high - low);
        let first = if is_high { 12.0 } else { -8.0 };
        // Ever farther away, on either side and in either direction.
        let steps = (0..8).map(|k| f64::from(k) * LETTER.1);
        let places = steps.flat_map(|step| {
            let away = if first > 0.0 {
                first + step
            } else {
                first - step
            };
            let other = if first > 0.0 {
                -8.0 - step
            } else {
                12.0 + step
            };
            [
                (beside, away),
                (beside, other),
                (-beside, away),
                (-beside, other),
            ]
        });
        let is_free = |place: &(f64, f64)| {
            let own = box_of(name, at, *place);
            let inside = own[0] >= left && own[1] >= top && own[2] <= right && own[3] <= bottom;
            inside && !taken.iter().any(|other| overlap(&own, other))
        };
        let mut places = places.into_iter();
        let (dx, dy) = places.find(is_free).unwrap_or((beside, first));
        taken.push(box_of(name, at, (dx, dy)));
        marks.push(Mark::Point {
            x,
            y,
            class: "event",
            title: format!("{name}: {x:.0} ms"),
            label: Some((name.into(), dx, dy)),
        });
    }
    marks
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

    /// Valves that move within a few milliseconds of each other, at any place in the beat.
    #[test]
    fn labels_of_events_cover_neither_each_other_nor_a_dot() {
        let mean: Line = (0..=600)
            .map(|t| (f64::from(t), 60.0 + 55.0 * (f64::from(t) / 95.0).sin()))
            .collect();
        let names = [
            "aortic valve opens",
            "aortic valve closes",
            "mitral valve opens",
            "mitral valve closes",
        ];
        for first in (0..600).step_by(7) {
            for apart in [0.0, 3.0, 20.0, 60.0] {
                let time = |k: usize| (f64::from(first) + apart * k as f64).min(600.0);
                let beats = BeatLines {
                    kept: vec![mean.clone()],
                    mean: mean.clone(),
                    band: [mean.clone(), mean.clone()],
                    events: names
                        .iter()
                        .enumerate()
                        .map(|(k, name)| (*name, time(k)))
                        .collect(),
                    ..BeatLines::default()
                };
                let [.., third] = beats_charts(&beats).unwrap();
                let mut boxes: Vec<Box4> = Vec::new();
                for mark in &third.marks {
                    if let Mark::Point {
                        x,
                        y,
                        label: Some((text, dx, dy)),
                        ..
                    } = mark
                    {
                        let at = third.place(*x, *y).unwrap();
                        boxes.push(box_of(&text.text, at, (*dx, *dy)));
                    }
                }
                assert_eq!(boxes.len(), 4);
                for (k, one) in boxes.iter().enumerate() {
                    assert!(
                        boxes[k + 1..].iter().all(|other| !overlap(one, other)),
                        "{first} ms, {apart} ms apart: {boxes:?}"
                    );
                }
            }
        }
    }

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
