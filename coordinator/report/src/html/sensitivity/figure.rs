//! First-order and total indices as bars with their intervals, in a panel per biomarker (Figure 3
//! of Jung et al. 2022).

use cardiotwin_schemas::label::Label;
use cardiotwin_schemas::sensitivity::{OutputSensitivity, SensitivityRecord, SobolIndex};
use maud::{PreEscaped, html};

use crate::html::plot::{Axis, Chart, Mark, Reading, Scale, SvgText};

/// Width and height of a panel's view box.
const SIZE: (f64, f64) = (1080.0, 230.0);
/// Height of the figure's title and key.
const HEAD: f64 = 46.0;
/// Half the distance between the two bars of a parameter.
const ASIDE: f64 = 0.19;
/// Width of a bar.
const WIDTH: f64 = 0.34;
/// The page's light colours, for viewers that open the file without the page.
const STYLE: &str = "text { font: 13px sans-serif; fill: #1c2127; } .ticks text { font-size: 12px; fill: #5d6873; } \
                     .heading { font-weight: 600; } path { fill: none; } .axis { stroke: #5d6873; } \
                     .grid path { stroke: #eceff2; } .bar.first { fill: #0072b2; } .bar.total { fill: #d55e00; } \
                     .rule.whisker { stroke: #1c2127; }";

/// The panel of one biomarker, with the parameters by rank from left to right.
pub(super) fn panel(record: &SensitivityRecord, output: &OutputSensitivity) -> Chart {
    let indices: Vec<(usize, &str, Option<SobolIndex>, Option<SobolIndex>)> = record
        .ranking
        .iter()
        .enumerate()
        .filter_map(|(at, ranked)| {
            let found = output.parameters.iter().find(|p| p.name == ranked.name)?;
            Some((at + 1, ranked.name.as_str(), found.first, found.total))
        })
        .collect();
    let ends = indices
        .iter()
        .flat_map(|(_, _, first, total)| [first, total])
        .flatten()
        .flat_map(interval);
    let up = Scale::linear(ends.chain([0.0, 0.5]), true).unwrap_or(Scale::exact(0.0, 1.0));
    let mut across = Axis::new("", "", Scale::exact(0.4, record.ranking.len() as f64 + 0.6));
    across.fixed = Some(
        indices
            .iter()
            .map(|(at, name, ..)| (*at as f64, symbol(name)))
            .collect(),
    );
    let label = Label::of(&output.name);
    let title = SvgText {
        text: label.map_or_else(|| output.name.clone(), |label| label.symbol.to_owned()),
        sub: label.map_or_else(String::new, |label| label.subscript.to_owned()),
        after: ": S1, ST".to_owned(),
    };
    let alt = format!("Sobol indices of {}", output.name);
    let mut chart = Chart::new(alt, across, Axis::new(title, "", up));
    chart.size = SIZE;
    chart.margins = [58.0, 10.0, 10.0, 26.0];
    chart.reading = Reading::Off;
    for (at, name, first, total) in indices {
        for (word, index, class, aside) in [
            ("S1", first, "first", -ASIDE),
            ("ST", total, "total", ASIDE),
        ] {
            let Some(index) = index else { continue };
            let x = at as f64 + aside;
            let half = index
                .half_width
                .map_or_else(String::new, |half| format!(" ± {half:.3}"));
            let title = format!("{name}: {word} {:.3}{half}", index.value);
            chart.marks.push(Mark::Bar {
                x,
                width: WIDTH,
                y: index.value,
                class,
                title,
            });
            if index.half_width.is_some() {
                let [low, high] = interval(&index);
                chart.marks.push(Mark::Segment {
                    from: (x, low),
                    to: (x, high),
                    class: "whisker",
                    label: None,
                });
            }
        }
    }
    chart
}

fn interval(index: &SobolIndex) -> [f64; 2] {
    let half = index.half_width.unwrap_or(0.0);
    [index.value - half, index.value + half]
}

/// Symbol and subscript on one line, without the mark of the reference state.
fn symbol(key: &str) -> String {
    Label::of(key).map_or_else(
        || key.to_owned(),
        |label| {
            format!(
                "{}{}",
                label.symbol,
                label.subscript.trim_end_matches(",ref")
            )
        },
    )
}

/// All panels as one SVG file.
#[must_use]
pub fn figure(record: &SensitivityRecord) -> String {
    let height = HEAD + SIZE.1 * record.outputs.len() as f64;
    let title = heading(record);
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (SIZE.0) " " (height) } width=(SIZE.0) height=(height) {
            title { (title) }
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="#ffffff" {}
            text.heading x="58" y="20" { (title) }
            rect.bar.first x="58" y="28" width="12" height="12" {}
            text x="75" y="39" { "first-order index S1" }
            rect.bar.total x="220" y="28" width="12" height="12" {}
            text x="237" y="39" { "total-effect index ST" }
            @for (i, output) in record.outputs.iter().enumerate() {
                (panel(record, output).render_at(HEAD + SIZE.1 * i as f64))
            }
        }
    };
    markup.into_string() + "\n"
}

/// Description of the figure in one line.
pub(super) fn heading(record: &SensitivityRecord) -> String {
    let interval = match record.spec.analysis.resamples {
        0 | 1 => String::new(),
        n => format!(
            ", with {} % intervals of {n} resamples",
            100.0 * record.spec.analysis.confidence
        ),
    };
    format!(
        "Sobol indices on {} blocks of samples{interval}; parameters sorted by the sum of ST",
        record.n_blocks
    )
}

#[cfg(test)]
pub(super) mod tests {
    use cardiotwin_schemas::sensitivity::{
        PaperRank, ParameterIndices, RankedParameter, SampleCounts,
    };
    use cardiotwin_schemas::sweep::{CellDesign, GsaAnalysis, GsaSpec};

    use super::*;

    /// Three parameters and two biomarkers, of which the second does not vary.
    pub fn record() -> SensitivityRecord {
        let names = ["n_Tm", "Ca50_ref_uM", "phi"];
        let index = |value| {
            Some(SobolIndex {
                value,
                half_width: Some(0.05),
                n_blocks: 4,
            })
        };
        let parameters = |varies: bool| {
            let of = |(i, name): (usize, &&str)| ParameterIndices {
                name: (*name).to_owned(),
                first: index(0.2 * i as f64 - 0.01).filter(|_| varies),
                total: index(0.3 * i as f64).filter(|_| varies),
            };
            names.iter().enumerate().map(of).collect()
        };
        let output = |name: &str, varies| OutputSensitivity {
            name: name.into(),
            mean: 1.0,
            standard_deviation: 0.1,
            sum_of_first: 0.5,
            parameters: parameters(varies),
            second: vec![],
        };
        let ranked = |(rank, name): (u32, &&str)| RankedParameter {
            rank,
            name: (*name).to_owned(),
            sum_of_totals: 0.1,
            half_width: None,
            rank_interval: Some([1, 2]),
            share_among_first_nine: None,
            reference: None,
            paper: PaperRank {
                among_first_nine: rank == 1,
                rank: None,
            },
        };
        let design = CellDesign {
            parameters: vec![],
            skip_points: 0,
            scramble_seed: None,
            cycle_length_ms: 1000.0,
            lambda_0: 1.1,
            fixed: Default::default(),
            tolerance: 1e-4,
            organ: None,
        };
        SensitivityRecord {
            schema_version: cardiotwin_schemas::formats::SENSITIVITY.version,
            version: "0".into(),
            spec: GsaSpec {
                design,
                n_blocks: 8,
                chunk_blocks: 4,
                analysis: GsaAnalysis::default(),
            },
            n_blocks: 4,
            samples: SampleCounts::default(),
            arithmetic: vec!["portable".into()],
            outputs: vec![output("Sa_max_kPa", true), output("STD30_ms", false)],
            ranking: (1..).zip(&names).map(ranked).collect(),
        }
    }

    #[test]
    fn each_index_is_a_bar_with_its_interval_inside_the_panel() {
        let record = record();
        let svg = figure(&record);
        assert_eq!(
            svg.matches("rect class=\"bar first\"").count(),
            3 + 1,
            "three and the key's"
        );
        assert_eq!(svg.matches("rule whisker").count(), 6);
        assert!(svg.starts_with("<svg xmlns=") && !svg.contains("NaN") && !svg.contains("inf"));
        let panel = panel(&record, &record.outputs[0]);
        for mark in &panel.marks {
            if let Mark::Segment { from, to, .. } = mark {
                for (x, y) in [from, to] {
                    let inside = [panel.x.scale.fraction(*x), panel.y.scale.fraction(*y)];
                    assert!(
                        inside
                            .iter()
                            .all(|f| f.is_some_and(|f| (0.0..=1.0).contains(&f))),
                        "{x} {y}"
                    );
                }
            }
        }
    }
}
