//! Charts of a patient's traces: pressure, volume, loop, flows (the paper's Figure A1), and cell
//! (Figure 5).

use cardiotwin_schemas::biomarkers::{Biomarker, TimePoints};
use cardiotwin_schemas::record::PatientRecord;
use maud::{Markup, html};

use super::format::{fixed, significant};
use super::plot::{Axis, Chart, Mark, Reading, Scale, Series, SvgText};
pub use crate::results::signals::at;
use crate::results::{PatientView, SignalKind, Signals, Source, Step, twin};

/// Order in which lines are drawn; the measured one comes last and lies on top.
const SOURCES: [Source; 4] = [
    Source::Step2,
    Source::Step1,
    Source::Step3,
    Source::Measured,
];

/// Name of a source's line.
#[must_use]
pub fn line_name(source: Source, patient: &PatientRecord) -> String {
    match source {
        Source::Measured => "measured".to_owned(),
        Source::Step1 => match PatientView(patient).best_iteration() {
            Some(i) => format!("step 1, iteration {}", i.number),
            None => "step 1".to_owned(),
        },
        Source::Step2 => "step 2".to_owned(),
        Source::Step3 => match &patient.step3 {
            Some(step3) => format!("step 3, beat {}", step3.best_iteration),
            None => "step 3".to_owned(),
        },
    }
}

/// A figure with a chart and a note on it, or with the sentence `absent` if there is no chart.
#[must_use]
pub fn figure(title: &str, chart: Option<Chart>, absent: &str, note: &Markup) -> Markup {
    html! {
        figure {
            figcaption { b { (title) } @if chart.is_some() { (note) } }
            @match chart {
                Some(chart) => (chart.render()),
                None => p.absent { (absent) },
            }
        }
    }
}

/// Legend with a sample of each line: its class in the style sheet and its name.
#[must_use]
pub fn legend(entries: &[(&'static str, String)]) -> Markup {
    html! {
        p.legend {
            @for (class, name) in entries {
                span.key {
                    svg viewBox="0 0 34 10" aria-hidden="true" { path class={ "line " (class) } d="M1 5H33" {} }
                    (name)
                }
            }
        }
    }
}

fn time_axis(patient: &PatientRecord) -> Axis {
    Axis::new(
        "time (ms)",
        "ms",
        Scale::exact(0.0, patient.plan.step0.cycle_length_ms),
    )
}

/// A chart of one kind of signal over time, with a line per source. `None` without values.
fn over_time(
    patient: &PatientRecord,
    signals: &Signals,
    kind: SignalKind,
    title: SvgText,
    from_zero: bool,
) -> Option<Chart> {
    let unit = if kind.unit() == "1" { "" } else { kind.unit() };
    let values = signals
        .all
        .iter()
        .filter(|s| s.kind == kind)
        .flat_map(|s| s.points.iter().map(|p| p.1));
    let y = Axis::new(title, unit, Scale::linear(values, from_zero)?);
    let mut chart = Chart::new(
        format!("{} of {} over time", kind.name(), patient.plan.id),
        time_axis(patient),
        y,
    );
    for source in SOURCES {
        if let Some(points) = signals.get(source, kind) {
            let mut points = points.to_vec();
            // A measured beat is periodic: its last sample is followed by its first.
            if source == Source::Measured {
                points.push((patient.plan.step0.cycle_length_ms, points[0].1));
            }
            points.retain(|p| p.0 <= patient.plan.step0.cycle_length_ms);
            chart.series.push(Series {
                class: source.name(),
                name: line_name(source, patient),
                points,
                dots: false,
            });
        }
    }
    Some(chart)
}

/// Time points of a source.
fn time_points(patient: &PatientRecord, source: Source) -> Option<TimePoints> {
    let view = PatientView(patient);
    match source {
        Source::Measured => patient.step0.as_ref().map(|r| r.result.time_points),
        Source::Step1 => view.beat(Step::Step1).map(|r| r.result.time_points),
        Source::Step2 => view.beat(Step::Step2).map(|r| r.result.time_points),
        Source::Step3 => view.step3_beat().map(|r| r.result.time_points),
    }
}

/// Marks the time points on the lines, with names on the measured line only.
fn mark_times(chart: &mut Chart, patient: &PatientRecord, signals: &Signals, kind: SignalKind) {
    for source in SOURCES {
        let (Some(times), Some(points)) = (time_points(patient, source), signals.get(source, kind))
        else {
            continue;
        };
        let named: &[(&str, &str, Option<f64>, f64, f64)] = match kind {
            SignalKind::Pressure => &[
                (
                    "1",
                    "upstroke through 10 % of the amplitude",
                    times.t1_ms,
                    -12.0,
                    -6.0,
                ),
                ("2", "peak pressure", times.t2_ms, 0.0, -8.0),
                (
                    "3",
                    "downstroke through 10 % of the amplitude",
                    times.t3_ms,
                    14.0,
                    -6.0,
                ),
            ],
            _ => &[
                ("4", "ejection begins", times.t4_ms, 12.0, 0.0),
                ("5", "ejection ends", times.t5_ms, -10.0, 14.0),
                ("6", "filling begins", times.t6_ms, 10.0, 14.0),
                (
                    "7",
                    "80 % of the volume is recovered",
                    times.t7_ms,
                    -12.0,
                    -6.0,
                ),
            ],
        };
        for (number, meaning, time, dx, dy) in named {
            let Some((time, y)) = time.and_then(|t| Some((t, at(points, t)?))) else {
                continue;
            };
            chart.marks.push(Mark::Point {
                x: time,
                y,
                class: source.name(),
                title: format!(
                    "t{number}, {}: {meaning}; {} ms, {} {}",
                    line_name(source, patient),
                    significant(time, 4),
                    significant(y, 4),
                    kind.unit()
                ),
                label: (source == Source::Measured).then(|| {
                    (
                        SvgText {
                            text: "t".into(),
                            sub: (*number).into(),
                            after: String::new(),
                        },
                        *dx,
                        *dy,
                    )
                }),
            });
        }
    }
}

/// Pressure with t1 to t3, the 10 % level between t1 and t3, and the aortic pressure.
#[must_use]
pub fn pressure(patient: &PatientRecord, signals: &Signals) -> Option<Chart> {
    let mut chart = over_time(
        patient,
        signals,
        SignalKind::Pressure,
        "pressure (mmHg)".into(),
        true,
    )?;
    // The label of t2 needs room above the peak.
    let (lo, hi, _) = chart.y.scale.ends();
    chart.y.scale = Scale::exact(lo, hi + 0.05 * (hi - lo));
    if let Some(points) = signals.get(Source::Step1, SignalKind::AorticPressure) {
        let series = Series {
            class: "aortic",
            name: "aortic pressure, step 1".into(),
            points: points.to_vec(),
            dots: false,
        };
        chart.series.insert(0, series);
    }
    if let (Some(times), Some(points)) = (
        time_points(patient, Source::Measured),
        signals.get(Source::Measured, SignalKind::Pressure),
    ) && let (Some(t1), Some(t3)) = (times.t1_ms, times.t3_ms)
        && let Some(level) = at(points, t3)
    {
        let label = SvgText {
            text: "PTD".into(),
            sub: "90".into(),
            after: format!(" {} ms", fixed(Some(t3 - t1), 0)),
        };
        chart.marks.push(Mark::Segment {
            from: (t1, level),
            to: (t3, level),
            class: "level",
            label: Some(label),
        });
    }
    mark_times(&mut chart, patient, signals, SignalKind::Pressure);
    chart.role = Some("pressure");
    Some(chart)
}

/// Volume with t4 to t7, and the gap at the beat's end.
#[must_use]
pub fn volume(patient: &PatientRecord, signals: &Signals) -> Option<Chart> {
    let mut chart = over_time(
        patient,
        signals,
        SignalKind::Volume,
        "volume (mL)".into(),
        false,
    )?;
    // The labels of t5 and t6, at the smallest volume, need room below.
    let (lo, hi, _) = chart.y.scale.ends();
    chart.y.scale = Scale::exact(lo - 0.06 * (hi - lo), hi);
    if let Some(measured) = signals.get(Source::Measured, SignalKind::Volume)
        && let Some(simulated) = signals
            .get(Source::Step1, SignalKind::Volume)
            .and_then(<[_]>::last)
    {
        let x = simulated.0.min(patient.plan.step0.cycle_length_ms);
        chart.marks.push(Mark::Segment {
            from: (x, measured[0].1),
            to: (x, simulated.1),
            class: "gap",
            label: None,
        });
    }
    mark_times(&mut chart, patient, signals, SignalKind::Volume);
    chart.role = Some("volume");
    Some(chart)
}

/// Volume that is left open at the end of each step's beat, in words.
#[must_use]
pub fn gap_words(patient: &PatientRecord) -> Option<String> {
    let gap = |step| {
        PatientView(patient)
            .simulated(step)
            .and_then(|b| b.end_of_beat_gap_ml)
    };
    let words: Vec<String> = [
        ("step 1", gap(Step::Step1)),
        ("step 2", gap(Step::Step2)),
        ("step 3", gap(Step::Step3)),
    ]
    .into_iter()
    .filter_map(|(name, gap)| gap.map(|gap| format!("{name} {} mL", fixed(Some(gap), 1))))
    .collect();
    (!words.is_empty()).then(|| format!(": gap at the end, {}", words.join(", ")))
}

/// Pressure-volume loops of all sources, with marks where beats begin and end.
#[must_use]
pub fn pv_loop(patient: &PatientRecord, signals: &Signals) -> Option<Chart> {
    let cycle = patient.plan.step0.cycle_length_ms;
    let mut series = Vec::new();
    for source in SOURCES {
        let (Some(p), Some(v)) = (
            signals.get(source, SignalKind::Pressure),
            signals.get(source, SignalKind::Volume),
        ) else {
            continue;
        };
        let mut points: Vec<_> = if source == Source::Measured {
            let smooth = Periodic::through(v, cycle);
            p.iter()
                .map(|(t, pressure)| (smooth.at(*t), *pressure))
                .collect()
        } else {
            p.iter()
                .filter_map(|(t, pressure)| Some((at(v, *t)?, *pressure)))
                .collect()
        };
        if source == Source::Measured {
            points.push(points[0]);
        }
        series.push(Series {
            class: source.name(),
            name: line_name(source, patient),
            points,
            dots: false,
        });
    }
    let all = || series.iter().flat_map(|s| s.points.iter());
    let x = Axis::new(
        "volume (mL)",
        "mL",
        Scale::linear(all().map(|p| p.0), false)?,
    );
    let y = Axis::new(
        "pressure (mmHg)",
        "mmHg",
        Scale::linear(all().map(|p| p.1), true)?,
    );
    let mut chart = Chart::new(format!("pressure-volume loop of {}", patient.plan.id), x, y);
    for line in &series {
        if let (Some(first), Some(last)) = (line.points.first(), line.points.last()) {
            let title = format!("{}: the beat begins", line.name);
            chart.marks.push(Mark::Point {
                x: first.0,
                y: first.1,
                class: line.class,
                title,
                label: None,
            });
            if first != last {
                let title = format!("{}: the beat ends", line.name);
                chart.marks.push(Mark::Cross {
                    x: last.0,
                    y: last.1,
                    class: line.class,
                    title,
                });
            }
        }
    }
    chart.series = series;
    chart.reading = Reading::Nearest;
    chart.role = Some("loop");
    Some(chart)
}

/// Simulated flow through both valves.
#[must_use]
pub fn flows(patient: &PatientRecord, signals: &Signals) -> Option<Chart> {
    let kinds = [SignalKind::AorticFlow, SignalKind::MitralFlow];
    let values = signals
        .all
        .iter()
        .filter(|s| kinds.contains(&s.kind))
        .flat_map(|s| s.points.iter().map(|p| p.1));
    let y = Axis::new("flow (mL/s)", "mL/s", Scale::linear(values, true)?);
    let mut chart = Chart::new(
        format!("valve flows of {} over time", patient.plan.id),
        time_axis(patient),
        y,
    );
    for source in [Source::Step2, Source::Step1, Source::Step3] {
        for kind in kinds {
            if let Some(points) = signals.get(source, kind) {
                let valve = if kind == SignalKind::AorticFlow {
                    "aortic valve"
                } else {
                    "mitral valve"
                };
                let name = format!("{valve}, {}", line_name(source, patient));
                chart.series.push(Series {
                    class: source.name(),
                    name,
                    points: points.to_vec(),
                    dots: false,
                });
                if source == Source::Step1
                    && let Some(peak) = points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))
                {
                    let label = Some((
                        SvgText::from(valve.split(' ').next().unwrap_or_default()),
                        0.0,
                        -8.0,
                    ));
                    let title = format!("{valve}: peak {} mL/s", fixed(Some(peak.1), 0));
                    chart.marks.push(Mark::Point {
                        x: peak.0,
                        y: peak.1,
                        class: "hidden",
                        title,
                        label,
                    });
                }
            }
        }
    }
    chart.role = Some("flow");
    Some(chart)
}

/// Active stress, calcium or stretch: median over the nodes and the fitted cell.
#[must_use]
pub fn cell(patient: &PatientRecord, signals: &Signals, kind: SignalKind) -> Option<Chart> {
    let title = match kind {
        SignalKind::ActiveStress => SvgText {
            text: "active stress S".into(),
            sub: "a".into(),
            after: " (kPa)".into(),
        },
        SignalKind::Calcium => "calcium (µM)".into(),
        _ => "fibre stretch λ".into(),
    };
    let mut chart = over_time(patient, signals, kind, title, kind != SignalKind::Stretch)?;
    for line in &mut chart.series {
        line.name = cell_line_name(line.class == Source::Step1.name()).to_owned();
    }
    if kind == SignalKind::Calcium
        && let Some(points) = twin::calcium(patient)
    {
        let all = chart.series.iter().flat_map(|line| &line.points);
        let values = all.chain(&points).map(|p| p.1);
        chart.y.scale = Scale::linear(values, true)?;
        chart.series.push(Series {
            class: Source::Step3.name(),
            name: TWIN.to_owned(),
            points,
            dots: false,
        });
    }
    if kind == SignalKind::Stretch
        && let Some(targets) = &patient.targets
    {
        let y = targets.result.targets.lambda_min;
        let label = SvgText {
            text: "target λ".into(),
            sub: "min".into(),
            after: format!(" {}", fixed(Some(y), 3)),
        };
        chart.marks.push(Mark::Across {
            y,
            class: "level",
            label: Some((label, -5.0)),
        });
    }
    Some(chart)
}

/// Name of the twin's line in the cell's charts.
pub const TWIN: &str = "twin's cell";

/// Name of a line in the cell's charts: the median over nodes if `target`, otherwise the fitted
/// cell.
#[must_use]
pub fn cell_line_name(target: bool) -> &'static str {
    if target {
        "step 1, median over nodes (target)"
    } else {
        "step 2, fitted cell"
    }
}

/// A small pressure plot for the overview, without axis titles because there is one plot per
/// patient. `top` is the upper end of the axis, mmHg.
#[must_use]
pub fn small_pressure(patient: &PatientRecord, signals: &Signals, top: f64) -> Option<Chart> {
    let mut chart = over_time(
        patient,
        signals,
        SignalKind::Pressure,
        SvgText::default(),
        true,
    )?;
    chart.y.scale = Scale::linear([0.0, top], true)?;
    chart.y.ticks = 3;
    chart.x.ticks = 3;
    chart.x.title = SvgText::default();
    chart.size = (230.0, 150.0);
    chart.margins = [34.0, 10.0, 8.0, 22.0];
    Some(chart)
}

/// Largest pressure of all lines, mmHg, for the axis that the small plots of a cohort share.
#[must_use]
pub fn top_pressure(patient: &PatientRecord) -> f64 {
    let view = PatientView(patient);
    [
        Some(view.measured()),
        view.simulated(Step::Step1),
        view.simulated(Step::Step2),
        view.simulated(Step::Step3),
    ]
    .into_iter()
    .flatten()
    .filter_map(|b| b.get(Biomarker::PMax))
    .fold(0.0, f64::max)
}

/// A smooth periodic curve through samples (cubic Hermite, slopes from neighbours). Cine frames are
/// 25 to 40 ms apart, and straight lines between them would give the loop corners that no heart
/// has.
struct Periodic {
    points: Vec<(f64, f64)>,
    period: f64,
}

impl Periodic {
    fn through(points: &[(f64, f64)], period: f64) -> Self {
        let points = points
            .iter()
            .copied()
            .filter(|p| p.0 < points[0].0 + period - 1e-9)
            .collect();
        Self { points, period }
    }

    fn sample(&self, i: isize) -> (f64, f64) {
        let n = self.points.len() as isize;
        let (t, v) = self.points[i.rem_euclid(n) as usize];
        (t + self.period * i.div_euclid(n) as f64, v)
    }

    fn at(&self, t: f64) -> f64 {
        let first = self.points[0].0;
        let t = first + (t - first).rem_euclid(self.period);
        let i = self.points.partition_point(|p| p.0 <= t) as isize - 1;
        let [before, a, b, after] = [i - 1, i, i + 1, i + 2].map(|i| self.sample(i));
        let h = b.0 - a.0;
        let slope = |from: (f64, f64), to: (f64, f64)| (to.1 - from.1) / (to.0 - from.0);
        let (ma, mb) = (slope(before, b) * h, slope(a, after) * h);
        let s = (t - a.0) / h;
        let (s2, s3) = (s * s, s * s * s);
        a.1 * (2.0 * s3 - 3.0 * s2 + 1.0)
            + ma * (s3 - 2.0 * s2 + s)
            + b.1 * (3.0 * s2 - 2.0 * s3)
            + mb * (s3 - s2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smooth_curve_passes_its_samples_and_follows_a_sine() {
        let period = 800.0;
        let sine = |t: f64| 100.0 + 40.0 * (t * std::f64::consts::TAU / period).cos();
        let frames: Vec<_> = (0..25)
            .map(|i| (f64::from(i) * 32.0, sine(f64::from(i) * 32.0)))
            .collect();
        let curve = Periodic::through(&frames, period);
        assert!((curve.at(64.0) - frames[2].1).abs() < 1e-9);
        for t in 0..1600 {
            assert!(
                (curve.at(f64::from(t)) - sine(f64::from(t))).abs() < 0.1,
                "{t}"
            );
        }
    }

    #[test]
    fn a_trace_is_held_outside_its_samples() {
        let points = [(0.0, 1.0), (10.0, 3.0)];
        assert_eq!(
            [-1.0, 0.0, 5.0, 11.0].map(|t| at(&points, t).unwrap()),
            [1.0, 1.0, 2.0, 3.0]
        );
        assert_eq!(at(&[], 1.0), None);
    }
}
