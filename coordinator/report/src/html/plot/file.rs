//! A chart as an SVG file of its own, including its colours and a legend.

use maud::{PreEscaped, html};

use super::Chart;

/// The light colours of the report's style sheet without CSS variables, which many viewers of SVG
/// files do not support.
const STYLE: &str = "
svg { font: 13px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif; }
text { fill: #1c2127; } .ticks text { font-size: 12px; fill: #5d6873; } .label.quiet { fill: #5d6873; }
path { fill: none; } .axis { stroke: #5d6873; } .grid path { stroke: #eceff2; } .rule { stroke: #5d6873; stroke-dasharray: 2 3; }
.line { stroke-width: 2; stroke-linejoin: round; } .line.measured { stroke: none; } .dot.measured { fill: #1c2127; fill-opacity: .55; }
.between { stroke: none; fill: #0072b2; } .between.most { opacity: .16; } .between.half { opacity: .3; }
.line.step1 { stroke: #0072b2; } .line.step2 { stroke: #d55e00; }
.line.before { stroke: #0072b2; } .line.after { stroke: #d55e00; } .rule.phase { stroke: #d9dee4; } .band.noise { fill: #eceff2; }
.line.beat { stroke: #5d6873; stroke-width: .6; stroke-opacity: .45; } .line.out { stroke: #cc79a7; stroke-width: 1; }
.mark.event { fill: #1c2127; } .cross { stroke: #1c2127; stroke-width: 2; }
.headline { font-size: 17px; font-weight: 600; }
";
/// Height of a line of the legend.
const LINE: f64 = 18.0;

impl Chart {
    /// Text of an SVG file with the chart below a legend of its lines. Lines of class `measured`
    /// are drawn as dots only.
    #[must_use]
    pub fn file(&self) -> String {
        let (width, height) = self.size;
        let top = LINE * self.series.len() as f64 + 6.0;
        let svg = html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height + top) } width=(1.5 * width)
                height=(1.5 * (height + top)) role="img" aria-label=(self.alt) {
                title { (self.alt) }
                style { (PreEscaped(STYLE)) }
                rect width="100%" height="100%" fill="#ffffff" {}
                @for (i, series) in self.series.iter().enumerate() {
                    @let y = LINE * (i as f64 + 0.5) + 4.0;
                    @let left = self.margins[0];
                    path class={ "line " (series.class) } d={ "M" (left) " " (y) "h28" } {}
                    @if series.dots { circle class={ "dot " (series.class) } cx=(left + 14.0) cy=(y) r="3.2" {} }
                    text x=(left + 36.0) y=(y + 4.0) { (series.name) }
                }
                g transform={ "translate(0 " (top) ")" } { (self.content()) }
            }
        };
        format!("{}\n", svg.into_string())
    }
}

/// Text of an SVG file with a headline, lines of text, one legend, and the charts below each other.
#[must_use]
pub fn stacked(headline: &str, lines: &[String], charts: &[Chart]) -> String {
    let width = charts.iter().map(|chart| chart.size.0).fold(0.0, f64::max);
    let Some(first) = charts.first() else {
        return String::new();
    };
    let keys: Vec<_> = first
        .series
        .iter()
        .filter(|series| !series.name.is_empty())
        .collect();
    let text = 30.0 + LINE * lines.len() as f64;
    let legend = text + LINE;
    let mut tops = vec![legend + 8.0];
    for chart in charts {
        tops.push(tops[tops.len() - 1] + chart.size.1);
    }
    let height = tops[tops.len() - 1];
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height) } width=(1.4 * width) height=(1.4 * height)
            role="img" aria-label=(headline) {
            title { (headline) }
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="#ffffff" {}
            text.headline x="12" y="22" { (headline) }
            @for (i, line) in lines.iter().enumerate() { text x="12" y=(40.0 + LINE * i as f64) { (line) } }
            @for (i, series) in keys.iter().enumerate() {
                @let left = 12.0 + width / keys.len() as f64 * i as f64;
                @let y = legend - LINE / 2.0;
                path class={ "line " (series.class) } d={ "M" (left) " " (y) "h28" } {}
                @if series.dots { circle class={ "dot " (series.class) } cx=(left + 14.0) cy=(y) r="3.2" {} }
                text x=(left + 36.0) y=(y + 4.0) { (series.name) }
            }
            @for (chart, top) in std::iter::zip(charts, &tops) {
                g transform={ "translate(0 " (top) ")" } { (chart.content()) }
            }
        }
    };
    format!("{}\n", svg.into_string())
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Scale, Series};
    use super::*;

    #[test]
    fn the_file_is_whole_and_names_its_lines() {
        let axis = |title: &str| Axis::new(title, "", Scale::exact(0.0, 1.0));
        let mut chart = Chart::new("a & b", axis("x"), axis("y"));
        let points = vec![(0.0, 0.2), (1.0, 0.9)];
        chart.series.push(Series {
            class: "measured",
            name: "seen <here>".into(),
            points,
            dots: true,
        });
        let svg = chart.file();
        assert!(
            svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 440 314\"")
                && svg.ends_with("</svg>\n")
        );
        assert!(
            svg.contains("seen &lt;here&gt;") && svg.contains("a &amp; b") && !svg.contains("var("),
            "{svg}"
        );
        assert_eq!(
            svg.matches("<circle").count(),
            3,
            "two samples and the legend's"
        );
    }
}
