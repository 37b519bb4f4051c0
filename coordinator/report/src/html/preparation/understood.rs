//! Picture of a patient's beat as it was understood from a table of traces.

use super::super::plot::{Axis, Chart, Mark, Scale, Series, stacked};
use super::{Line, event_marks, wrapped};

/// The beat that was taken from traces.
#[derive(Debug, Clone, Default)]
pub struct UnderstoodBeat {
    /// Headline of the picture.
    pub title: String,
    /// Lines of text below the headline.
    pub text: Vec<String>,
    /// Pressure: time in ms from end-diastole, mmHg.
    pub pressure: Line,
    /// Volume: time in ms from end-diastole, mL.
    pub volume: Line,
    /// Loop: volume in mL, pressure in mmHg.
    pub pv_loop: Line,
    /// Marked times in ms, with their names.
    pub events: Vec<(&'static str, f64)>,
}

/// Text of an SVG file: pressure, volume and loop below each other, with end-diastole and the valves'
/// times. `None` without a finite sample.
#[must_use]
pub fn understood_svg(beat: &UnderstoodBeat) -> Option<String> {
    let end = beat.pressure.last()?.0;
    let time = || Axis::new("time from end-diastole (ms)", "ms", Scale::exact(0.0, end));
    let mut pressure = chart(
        "pressure over time",
        time(),
        ("pressure (mmHg)", "mmHg"),
        "step1",
        &beat.pressure,
    )?;
    pressure.marks = event_marks(&beat.events, &beat.pressure, &pressure);
    let mut volume = chart(
        "volume over time",
        time(),
        ("volume (mL)", "mL"),
        "step2",
        &beat.volume,
    )?;
    for chart in [&mut pressure, &mut volume] {
        let events = beat.events.iter();
        chart.marks.extend(events.map(|(_, x)| Mark::Up {
            x: *x,
            class: "phase",
        }));
    }
    let volumes = Scale::linear(beat.pv_loop.iter().map(|p| p.0), false)?;
    let mut loops = chart(
        "pressure over volume",
        Axis::new("volume (mL)", "mL", volumes),
        ("pressure (mmHg)", "mmHg"),
        "step1",
        &beat.pv_loop,
    )?;
    loops.size.1 = 300.0;
    let (x, y) = *beat.pv_loop.first()?;
    loops.marks.push(Mark::Point {
        x,
        y,
        class: "event",
        title: format!("end-diastole: {x:.1} mL, {y:.1} mmHg"),
        label: Some(("end-diastole".into(), -54.0, -12.0)),
    });
    let text = wrapped(&beat.text);
    Some(stacked(&beat.title, &text, &[pressure, volume, loops]))
}

fn chart(
    alt: &str,
    x: Axis,
    (title, unit): (&'static str, &'static str),
    class: &'static str,
    line: &Line,
) -> Option<Chart> {
    let y = Axis::new(title, unit, Scale::linear(line.iter().map(|p| p.1), false)?);
    let mut chart = Chart::new(alt, x, y);
    chart.size = (720.0, 230.0);
    // The axes name the lines, so that no legend is needed.
    chart.series.push(Series {
        class,
        name: String::new(),
        points: line.clone(),
        dots: false,
    });
    Some(chart)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressure_volume_and_loop_are_drawn_with_their_events() {
        let beat = UnderstoodBeat {
            title: "P <1>".into(),
            text: vec!["pressure: 5.0 to 118.0 mmHg".into()],
            pressure: vec![(0.0, 7.0), (200.0, 118.0), (800.0, 7.0)],
            volume: vec![(0.0, 120.0), (400.0, 55.0), (800.0, 120.0)],
            pv_loop: vec![(120.0, 7.0), (90.0, 118.0), (55.0, 60.0)],
            events: vec![("aortic valve opens", 60.0)],
        };
        let svg = understood_svg(&beat).unwrap();
        for part in [
            "P &lt;1&gt;",
            "aortic valve opens: 60 ms",
            "end-diastole: 120.0 mL, 7.0 mmHg",
            "pressure: 5.0 to 118.0 mmHg",
        ] {
            assert!(svg.contains(part), "{part} is not in {svg}");
        }
        assert_eq!(svg.matches("time from end-diastole (ms)").count(), 2);
        assert!(!svg.contains("NaN"));
        assert_eq!(understood_svg(&UnderstoodBeat::default()), None);
    }
}
