//! A chart as an SVG file of its own, with its colours and a legend inside.

use maud::{PreEscaped, html};

use super::Chart;

/// The light colours of the report's style sheet, written out: many viewers of SVG files know no CSS variables.
const STYLE: &str = "
svg { font: 13px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif; }
text { fill: #1c2127; } .ticks text { font-size: 12px; fill: #5d6873; } .label.quiet { fill: #5d6873; }
path { fill: none; } .axis { stroke: #5d6873; } .grid path { stroke: #eceff2; } .rule { stroke: #5d6873; stroke-dasharray: 2 3; }
.line { stroke-width: 2; stroke-linejoin: round; } .line.measured { stroke: none; } .dot.measured { fill: #1c2127; fill-opacity: .55; }
.line.step1 { stroke: #0072b2; } .line.step2 { stroke: #d55e00; }
";
/// Height of a line of the legend.
const LINE: f64 = 18.0;

impl Chart {
    /// The file's text: the chart below a legend of its lines. Lines of class `measured` are dots alone.
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

#[cfg(test)]
mod tests {
    use super::super::{Axis, Scale, Series};
    use super::*;

    #[test]
    fn the_file_is_whole_and_names_its_lines() {
        let axis = |title: &str| Axis::new(title, "", Scale::exact(0.0, 1.0));
        let mut chart = Chart::new("a & b", axis("x"), axis("y"));
        let points = vec![(0.0, 0.2), (1.0, 0.9)];
        chart.series.push(Series { class: "measured", name: "seen <here>".into(), points, dots: true });
        let svg = chart.file();
        assert!(
            svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 440 314\"")
                && svg.ends_with("</svg>\n")
        );
        assert!(svg.contains("seen &lt;here&gt;") && svg.contains("a &amp; b") && !svg.contains("var("), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 3, "two samples and the legend's");
    }
}
