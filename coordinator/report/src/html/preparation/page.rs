//! The page of a preparation: files and how they were read, the whole recording with its gaps, beats
//! and the reasons against the excluded ones, steps, frames and loops.

use cardiotwin_schemas::preparation::{Preparation, StepState};
use maud::{Markup, PreEscaped, html};

use super::super::page::page;
use super::super::plot::{Axis, Chart, Scale, Series};
use super::{BeatLines, Line, VolumeLines, beats_charts, volume_charts};

/// Longest part of a recording in one row, s, unless there would be too many rows.
const ROW_S: f64 = 20.0;
/// Most rows of the recording.
const ROWS: f64 = 12.0;
/// Classes of the lines that only this page has.
const STYLE: &str = ".line.beat { stroke: var(--quiet); stroke-width: .7; opacity: .6; } \
.line.out { stroke: var(--bad); stroke-width: 1.3; } .line.outside { stroke: var(--line); stroke-width: 1; } \
.mark.event { fill: var(--fg); } .cross.image { stroke: var(--bad); } .strip .line.beat { opacity: 1; stroke-width: 1; } \
.figures.one { grid-template-columns: minmax(0, 1fr); } .wraps td { max-width: 60rem; } .decisions { margin: 0; padding-left: 1.1rem; }";

/// The whole recording: time in s, pressure in mmHg. A missing sample is NaN.
#[derive(Debug, Clone, Default)]
pub struct RecordingLines {
    /// Beats in the mean.
    pub kept: Vec<Line>,
    /// Excluded beats, with number and reason.
    pub left_out: Vec<(String, Line)>,
    /// Parts of the recording outside of whole beats.
    pub outside: Vec<Line>,
    /// Stretches without samples, s.
    pub gaps_s: Vec<(f64, f64)>,
}

/// Text of the page.
#[must_use]
pub fn preparation_page(
    answer: &Preparation,
    recording: &RecordingLines,
    beats: &BeatLines,
    volume: Option<&VolumeLines>,
) -> String {
    let title = format!("{}: preparation", answer.id);
    let beats = beats_charts(beats);
    let volume = volume.and_then(volume_charts);
    let content = html! {
        style { (PreEscaped(STYLE)) }
        h1 { (title) }
        p {
            (answer.beats.found) " beats from the " (answer.beats.source) ", " (answer.beats.kept)
            " in the mean of " (format!("{:.0}", answer.cycle_length_ms)) " ms. The recordings were left as they are."
        }
        @if !answer.warnings.is_empty() {
            ul.notes {
                @for warning in &answer.warnings {
                    li.warn { span.sign aria-hidden="true" { "⚠" } span { (warning) } }
                }
            }
        }
        (steps(answer))
        h2 { "Recording" }
        (strip(recording))
        @if let Some(charts) = &beats {
            h2 { "Beats" }
            div.figures.one {
                @for (chart, caption) in charts.iter().zip([
                    "Beats in the mean, and the mean", "Excluded beats, and the mean",
                    "Mean with the standard deviation between beats, and the motion of the valves",
                ]) {
                    figure { figcaption { (caption) } (chart.render()) }
                }
            }
        }
        (left_out(answer))
        @if let Some(charts) = &volume {
            h2 { "Volume" }
            p.legend { (key("measured", "frames as measured")) (key("step1", "adjusted; loop before synchronising")) (key("step2", "synchronised; loop after")) }
            div.figures.one {
                @for (chart, caption) in charts.iter().zip(["Frames after each step", "Loops before and after synchronising"]) {
                    figure { figcaption { (caption) } (chart.render()) }
                }
            }
        }
        (files(answer))
    };
    let nav = html! { nav aria-label="preparation" { span.home { (answer.id) } } };
    page(&title, &nav, &content).into_string()
}

fn key(class: &str, name: &str) -> Markup {
    html! {
        span.key {
            svg viewBox="0 0 30 10" aria-hidden="true" {
                @if class == "measured" { circle class="dot measured" cx="15" cy="5" r="3.2" {} }
                @else { path class={ "line " (class) } d="M0 5H30" {} }
            }
            (name)
        }
    }
}

fn steps(answer: &Preparation) -> Markup {
    html! {
        h2 { "Steps" }
        div.scroll { table.wraps {
            thead { tr { th { "step" } th.unit { "state" } th.unit { "change" } } }
            tbody {
                @for step in &answer.steps {
                    tr {
                        th { (step.step) }
                        td.state { @if step.state == StepState::Lacking { em { (step.state.word()) } } @else { (step.state.word()) } }
                        td { (step.what) }
                    }
                }
            }
        } }
    }
}

fn strip(recording: &RecordingLines) -> Markup {
    let all = || {
        recording
            .kept
            .iter()
            .chain(recording.left_out.iter().map(|(_, line)| line))
            .chain(&recording.outside)
            .flatten()
    };
    let end = all().map(|p| p.0).fold(0.0, f64::max);
    let begin = all().map(|p| p.0).fold(end, f64::min);
    let pressures = all().map(|p| p.1).filter(|p| (-40.0..300.0).contains(p));
    let Some(y) = Scale::linear(pressures, false) else {
        return html! { p.absent { "no samples" } };
    };
    let length = end - begin;
    let row = ROW_S.max(length / ROWS);
    let rows = (length / row).ceil().max(1.0) as usize;
    let (low, high, _) = y.ends();
    let chart = |i: usize| {
        let from = begin + row * i as f64;
        // All rows have the same scale, so that a second has the same width everywhere.
        let mut chart = Chart::new(
            format!("pressure from {from:.1} s on"),
            Axis::new("time (s)", "s", Scale::exact(from, from + row)),
            Axis::new("pressure (mmHg)", "mmHg", y),
        );
        chart.size = (1100.0, 170.0);
        let inside = |line: &Line| -> Option<Line> {
            let here = |t: f64| (from..=from + row).contains(&t);
            line.iter().any(|p| here(p.0)).then(|| {
                line.iter()
                    .filter(|p| here(p.0))
                    .map(|p| (p.0, p.1.clamp(low, high)))
                    .collect()
            })
        };
        let series = |class, name: &str, points| Series {
            class,
            name: name.to_owned(),
            points,
            dots: false,
        };
        for line in recording.outside.iter().filter_map(inside) {
            chart
                .series
                .push(series("outside", "outside of whole beats", line));
        }
        for line in recording.kept.iter().filter_map(inside) {
            chart.series.push(series("beat", "beat in the mean", line));
        }
        for (name, line) in &recording.left_out {
            chart
                .series
                .extend(inside(line).map(|line| series("out", name, line)));
        }
        chart
    };
    let gaps = &recording.gaps_s;
    html! {
        p.legend {
            (key("beat", "beats in the mean")) (key("out", "excluded beats")) (key("outside", "outside of whole beats"))
        }
        @if gaps.is_empty() { p { "No sample is missing." } }
        @else {
            p {
                "Samples are missing in " (gaps.len()) @if gaps.len() == 1 { " stretch" } @else { " stretches" } ", "
                (format!("{:.2}", gaps.iter().map(|(a, b)| b - a).sum::<f64>())) " s in all; lines are broken there."
            }
        }
        div.figures.one.strip { @for i in 0..rows { figure { (chart(i).render()) } } }
    }
}

fn left_out(answer: &Preparation) -> Markup {
    let beats = &answer.beats.left_out;
    html! {
        h2 { "Excluded beats" }
        @if beats.is_empty() { p { "None." } }
        @else {
            p { "A beat that should stay is named in " code { "steps.reject.keep" } " of prepare.toml." }
            div.scroll { table {
                thead { tr { th { "beat" } th { "at (s)" } th { "length (ms)" } th.unit { "kind" } th.unit { "reasons" } } }
                tbody {
                    @for beat in beats {
                        tr {
                            th { (beat.number) }
                            td.num { (format!("{:.2}", 1e-3 * beat.onset_ms)) }
                            td.num { (format!("{:.0}", beat.length_ms)) }
                            td.state { (beat.kind) }
                            td { (beat.reasons.join("; ")) }
                        }
                    }
                }
            } }
        }
    }
}

fn files(answer: &Preparation) -> Markup {
    html! {
        h2 { "Files" }
        div.scroll { table.provenance {
            thead { tr { th { "file" } th.unit { "rows" } th.unit { "read as" } th.unit { "SHA-256" } } }
            tbody {
                @for file in &answer.files {
                    tr {
                        th { (file.file) }
                        td.num { @if file.n_rows > 0 { (file.n_rows) } }
                        td {
                            @if file.read_as.is_empty() { "names and units of this program" }
                            @else { ul.decisions { @for said in &file.read_as { li { (said) } } } }
                        }
                        td { code title=(file.sha256) { (file.sha256.get(..12).unwrap_or_default()) } }
                    }
                }
            }
        } }
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::preparation::{BeatLeftOut, BeatsFound, RawInput};

    use super::*;

    #[test]
    fn gaps_are_gaps_and_reasons_are_words() {
        let answer = Preparation {
            schema_version: 1,
            id: "P<1>".into(),
            files: vec![RawInput {
                file: "lab.txt".into(),
                sha256: "ab".repeat(32),
                n_rows: 12,
                read_as: vec!["LabChart text, Windows-1252".into()],
            }],
            cycle_length_ms: 800.0,
            beats: BeatsFound {
                source: "R wave".into(),
                found: 2,
                kept: 1,
                left_out: vec![BeatLeftOut {
                    number: 2,
                    onset_ms: 800.0,
                    length_ms: 790.0,
                    kind: "damaged".into(),
                    reasons: vec!["40 ms of samples are missing".into()],
                }],
            },
            steps: vec![],
            warnings: vec!["few beats".into()],
            written: vec![],
            patient_toml: String::new(),
        };
        let line = |from: f64, gap: bool| -> Line {
            (0..40)
                .map(|i| {
                    (
                        from + 0.02 * f64::from(i),
                        if gap && i == 20 {
                            f64::NAN
                        } else {
                            f64::from(i)
                        },
                    )
                })
                .collect()
        };
        let recording = RecordingLines {
            kept: vec![line(0.0, false)],
            left_out: vec![(
                "beat 2: 40 ms of samples are missing".into(),
                line(0.8, true),
            )],
            outside: vec![],
            gaps_s: vec![(1.2, 1.24)],
        };
        let text = preparation_page(&answer, &recording, &BeatLines::default(), None);
        let out = text.split("class=\"line out\" d=\"").nth(1).unwrap();
        let path = out.split('"').next().unwrap();
        // The key of the legend comes first.
        let path = if path == "M0 5H30" {
            text.split("class=\"line out\" d=\"")
                .nth(2)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
        } else {
            path
        };
        assert_eq!(path.matches('M').count(), 2, "{path}");
        assert!(!text.contains("NaN") && text.contains("P&lt;1&gt;"));
        for part in [
            "1 stretch, 0.04 s",
            "LabChart text, Windows-1252",
            "few beats",
            "steps.reject.keep",
        ] {
            assert!(text.contains(part), "{part}");
        }
    }
}
