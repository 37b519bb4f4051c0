//! A chart with axes, lines and marks.

use std::fmt::Write as _;

use maud::{Markup, PreEscaped, html};

use super::scale::Scale;
use super::simplify::simplify;

/// Largest distance by which a line may move when points are left out, in units of the view box
/// (about a pixel).
const SIMPLIFY: f64 = 0.12;

/// Text with an optional subscript, such as τ or S with the subscript `R,ref`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SvgText {
    /// Text on the line.
    pub text: String,
    /// Subscript that follows `text`; empty for none.
    pub sub: String,
    /// Text on the line after the subscript.
    pub after: String,
}

impl From<&str> for SvgText {
    fn from(text: &str) -> Self {
        Self {
            text: text.to_owned(),
            ..Self::default()
        }
    }
}

impl SvgText {
    fn spans(&self) -> Markup {
        html! {
            (self.text)
            @if !self.sub.is_empty() { tspan dy="3" font-size="78%" { (self.sub) } }
            @if !self.after.is_empty() { tspan dy=[(!self.sub.is_empty()).then_some("-3")] { (self.after) } }
        }
    }

    fn plain(&self) -> String {
        let joint = if self.sub.is_empty() { "" } else { "_" };
        format!("{}{joint}{}{}", self.text, self.sub, self.after)
    }
}

/// An axis with title, range and ticks.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit, printed along the axis.
    pub title: SvgText,
    /// Range of values, linear or logarithmic.
    pub scale: Scale,
    /// Approximate number of ticks.
    pub ticks: usize,
    /// Ticks with labels that replace the automatic ones.
    pub fixed: Option<Vec<(f64, String)>>,
    /// Unit printed after a value on hover.
    pub unit: &'static str,
}

impl Axis {
    /// An axis with about five ticks.
    #[must_use]
    pub fn new(title: impl Into<SvgText>, unit: &'static str, scale: Scale) -> Self {
        Self {
            title: title.into(),
            scale,
            ticks: 5,
            fixed: None,
            unit,
        }
    }

    fn tick_places(&self) -> Vec<(f64, String)> {
        self.fixed
            .clone()
            .unwrap_or_else(|| self.scale.ticks(self.ticks))
    }
}

/// A line through data points.
#[derive(Debug, Clone)]
pub struct Series {
    /// Class in the style sheet, which gives colour and dash pattern.
    pub class: &'static str,
    /// Name shown on hover.
    pub name: String,
    /// Data points, x and y.
    pub points: Vec<(f64, f64)>,
    /// Whether a dot is drawn at each point.
    pub dots: bool,
}

/// Elements of a chart next to its lines.
#[derive(Debug, Clone)]
pub enum Mark {
    /// A dot with a title and an optional label at an offset.
    Point {
        x: f64,
        y: f64,
        class: &'static str,
        title: String,
        label: Option<(SvgText, f64, f64)>,
    },
    /// A cross with a title, for values that differ in kind from those shown as dots.
    Cross {
        x: f64,
        y: f64,
        class: &'static str,
        title: String,
    },
    /// A horizontal line at `y`, with an optional label at its right end by the given distance
    /// below it (above if negative).
    Across {
        y: f64,
        class: &'static str,
        label: Option<(SvgText, f64)>,
    },
    /// A vertical line at `x`.
    Up { x: f64, class: &'static str },
    /// A horizontal band between two values.
    Band {
        from: f64,
        to: f64,
        class: &'static str,
    },
    /// The area between two lines with the same x.
    Between {
        lower: Vec<(f64, f64)>,
        upper: Vec<(f64, f64)>,
        class: &'static str,
    },
    /// Words above the plot's lower edge, centred in a part of the x axis.
    Words { from: f64, to: f64, text: String },
    /// A bar from zero to `y` around `x`.
    Bar {
        x: f64,
        width: f64,
        y: f64,
        class: &'static str,
        title: String,
    },
    /// A line between two points.
    Segment {
        from: (f64, f64),
        to: (f64, f64),
        class: &'static str,
        label: Option<SvgText>,
    },
}

impl Mark {
    /// Whether the mark lies behind the lines, as rules, bands and words do.
    fn is_behind(&self) -> bool {
        matches!(
            self,
            Self::Across { .. }
                | Self::Up { .. }
                | Self::Band { .. }
                | Self::Between { .. }
                | Self::Words { .. }
        )
    }
}

/// The way in which values are read off on hover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// The value of each line at the pointer's x.
    AtX,
    /// The nearest point of any line.
    Nearest,
    /// No values; marks have titles.
    Off,
}

/// One plot area with its axes, which is drawn as SVG.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Description for screen readers.
    pub alt: String,
    /// Width and height of the view box.
    pub size: (f64, f64),
    /// Room left, right, above and below the plot area.
    pub margins: [f64; 4],
    /// Axis along the lower edge.
    pub x: Axis,
    /// Axis along the left edge.
    pub y: Axis,
    /// Lines in drawing order; the last lies on top.
    pub series: Vec<Series>,
    /// Marks. Points, crosses, bars and segments lie on top of the lines, the others behind them.
    pub marks: Vec<Mark>,
    /// The way in which values are read off on hover.
    pub reading: Reading,
    /// Quantity of a beat, by which the time slider finds the chart.
    pub role: Option<&'static str>,
}

impl Chart {
    /// A chart of the default size, without lines.
    #[must_use]
    pub fn new(alt: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self {
            alt: alt.into(),
            size: (440.0, 290.0),
            margins: [54.0, 14.0, 12.0, 44.0],
            x,
            y,
            series: Vec::new(),
            marks: Vec::new(),
            reading: Reading::AtX,
            role: None,
        }
    }

    /// Left and right, upper and lower end of the plot area.
    #[must_use]
    pub fn area(&self) -> [f64; 4] {
        let [left, right, top, bottom] = self.margins;
        [left, self.size.0 - right, top, self.size.1 - bottom]
    }

    /// Place of a value in units of the view box; `None` where a scale has no place for it.
    #[must_use]
    pub fn place(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let [x0, x1, y0, y1] = self.area();
        Some((
            x0 + self.x.scale.fraction(x)? * (x1 - x0),
            y1 - self.y.scale.fraction(y)? * (y1 - y0),
        ))
    }

    /// The chart as an SVG element for a page.
    #[must_use]
    pub fn render(&self) -> Markup {
        self.svg(None)
    }

    /// The chart as an SVG element inside a larger one, `top` units below its upper edge.
    #[must_use]
    pub fn render_at(&self, top: f64) -> Markup {
        self.svg(Some(top))
    }

    fn svg(&self, top: Option<f64>) -> Markup {
        let [x0, x1, y0, y1] = self.area();
        let reading = match self.reading {
            Reading::AtX => Some("x"),
            Reading::Nearest => Some("near"),
            Reading::Off => None,
        };
        html! {
            svg.plot viewBox={ "0 0 " (self.size.0) " " (self.size.1) } role="img" aria-label=(self.alt)
                y=[top] width=[top.map(|_| self.size.0)] height=[top.map(|_| self.size.1)]
                data-role=[self.role]
                data-area={ (x0) "," (x1) "," (y0) "," (y1) }
                data-read=[reading]
                data-x=[reading.map(|_| ends(&self.x))] data-y=[reading.map(|_| ends(&self.y))] {
                (self.content())
            }
        }
    }

    /// The content of the SVG element.
    pub(super) fn content(&self) -> Markup {
        html! {
            (self.axes())
            @for mark in self.marks.iter().filter(|m| m.is_behind()) { (self.mark(mark)) }
            @for series in &self.series { (self.line(series)) }
            @for mark in self.marks.iter().filter(|m| !m.is_behind()) { (self.mark(mark)) }
        }
    }

    fn axes(&self) -> Markup {
        let [x0, x1, y0, y1] = self.area();
        let middle = (y0 + y1) / 2.0;
        html! {
            g.grid {
                @for (value, _) in self.y.tick_places() {
                    @if let Some((_, y)) = self.place(self.x.scale.ends().0, value) {
                        path d={ "M" (n(x0)) " " (n(y)) "H" (n(x1)) } {}
                    }
                }
            }
            path.axis d={ "M" (n(x0)) " " (n(y0)) "V" (n(y1)) "H" (n(x1)) } {}
            g.ticks {
                @for (value, label) in self.x.tick_places() {
                    @if let Some((x, _)) = self.place(value, self.y.scale.ends().0) {
                        path.axis d={ "M" (n(x)) " " (n(y1)) "v4" } {}
                        text x=(n(x)) y=(n(y1 + 17.0)) text-anchor="middle" { (label) }
                    }
                }
                @for (value, label) in self.y.tick_places() {
                    @if let Some((_, y)) = self.place(self.x.scale.ends().0, value) {
                        text x=(n(x0 - 7.0)) y=(n(y + 4.0)) text-anchor="end" { (label) }
                    }
                }
            }
            @if !self.x.title.text.is_empty() {
                text.title x=(n((x0 + x1) / 2.0)) y=(n(self.size.1 - 7.0)) text-anchor="middle" { (self.x.title.spans()) }
            }
            @if !self.y.title.text.is_empty() {
                text.title transform={ "translate(13 " (n(middle)) ") rotate(-90)" } text-anchor="middle" { (self.y.title.spans()) }
            }
        }
    }

    fn line(&self, series: &Series) -> Markup {
        // A missing value is a gap in the line.
        let parts = series
            .points
            .split(|(x, y)| !(x.is_finite() && y.is_finite()));
        let line: String = parts
            .map(|part| {
                let placed: Vec<(f64, f64)> = part
                    .iter()
                    .filter_map(|(x, y)| self.place(*x, *y))
                    .collect();
                if series.dots {
                    path_data(&placed)
                } else {
                    path_data(&simplify(&placed, SIMPLIFY))
                }
            })
            .collect();
        html! {
            path class={ "line " (series.class) } d=(line) data-name=(series.name) { title { (series.name) } }
            @if series.dots {
                @for ((px, py), (x, y)) in series.points.iter().filter_map(|(x, y)| Some((self.place(*x, *y)?, (x, y)))) {
                    circle class={ "dot " (series.class) } cx=(n(px)) cy=(n(py)) r="3.2" {
                        title { (series.name) ", " (self.x.title.plain()) " " (x) ": " (short(*y)) " " (self.y.unit) }
                    }
                }
            }
        }
    }

    fn mark(&self, mark: &Mark) -> Markup {
        let [x0, x1, y0, y1] = self.area();
        match mark {
            Mark::Point { x, y, class, title, label } => self.place(*x, *y).map_or_else(Markup::default, |(px, py)| {
                html! {
                    circle class={ "mark " (class) } cx=(n(px)) cy=(n(py)) r="3.6" { title { (title) } }
                    @if let Some((text, dx, dy)) = label {
                        text.label x=(n(px + dx)) y=(n(py + dy)) text-anchor="middle" { (text.spans()) }
                    }
                }
            }),
            Mark::Cross { x, y, class, title } => self.place(*x, *y).map_or_else(Markup::default, |(px, py)| {
                html! {
                    path class={ "cross " (class) } d={ "M" (n(px - 4.0)) " " (n(py - 4.0)) "l8 8m0-8l-8 8" } { title { (title) } }
                }
            }),
            Mark::Across { y, class, label } => self.place(self.x.scale.ends().0, *y).map_or_else(Markup::default, |(_, py)| {
                html! {
                    path class={ "rule " (class) } d={ "M" (n(x0)) " " (n(py)) "H" (n(x1)) } {}
                    @if let Some((text, dy)) = label { text.label.quiet x=(n(x1 - 2.0)) y=(n(py + dy)) text-anchor="end" { (text.spans()) } }
                }
            }),
            Mark::Up { x, class } => self.place(*x, self.y.scale.ends().0).map_or_else(Markup::default, |(px, _)| {
                html! { path class={ "rule " (class) } d={ "M" (n(px)) " " (n(y0)) "V" (n(y1)) } {} }
            }),
            Mark::Band { from, to, class } => {
                let at = |y: f64| self.place(self.x.scale.ends().0, y).map(|(_, py)| py);
                let (Some(low), Some(high)) = (at(*from), at(*to)) else { return Markup::default() };
                html! { rect class={ "band " (class) } x=(n(x0)) y=(n(high)) width=(n(x1 - x0)) height=(n(low - high)) {} }
            }
            Mark::Between { lower, upper, class } => {
                let placed = |line: &[(f64, f64)]| -> Vec<(f64, f64)> {
                    simplify(&line.iter().filter_map(|(x, y)| self.place(*x, *y)).collect::<Vec<_>>(), SIMPLIFY)
                };
                let outline: Vec<_> = placed(upper).into_iter().chain(placed(lower).into_iter().rev()).collect();
                html! { path class={ "between " (class) } d={ (path_data(&outline)) "Z" } {} }
            }
            Mark::Words { from, to, text } => {
                let at = |x: f64| self.place(x, self.y.scale.ends().0).map(|(px, _)| px);
                let (Some(left), Some(right)) = (at(*from), at(*to)) else { return Markup::default() };
                html! { text.label.quiet x=(n((left + right) / 2.0)) y=(n(y1 - 5.0)) text-anchor="middle" { (text) } }
            }
            Mark::Bar { x, width, y, class, title } => {
                let corners = (self.place(x - width / 2.0, y.max(0.0)), self.place(x + width / 2.0, y.min(0.0)));
                let (Some(a), Some(b)) = corners else { return Markup::default() };
                html! {
                    rect class={ "bar " (class) } x=(n(a.0)) y=(n(a.1)) width=(n(b.0 - a.0)) height=(n(b.1 - a.1)) { title { (title) } }
                }
            }
            Mark::Segment { from, to, class, label } => {
                let (Some(a), Some(b)) = (self.place(from.0, from.1), self.place(to.0, to.1)) else {
                    return Markup::default();
                };
                html! {
                    path class={ "rule " (class) } d={ "M" (n(a.0)) " " (n(a.1)) "L" (n(b.0)) " " (n(b.1)) } {}
                    @if let Some(text) = label {
                        text.label.quiet x=(n((a.0 + b.0) / 2.0)) y=(n((a.1 + b.1) / 2.0 - 5.0)) text-anchor="middle" { (text.spans()) }
                    }
                }
            }
        }
    }
}

/// First value, last value, `log` or `lin`, and unit, from which the script reads off values.
fn ends(axis: &Axis) -> String {
    let (lo, hi, log) = axis.scale.ends();
    format!(
        "{lo},{hi},{},{}",
        if log { "log" } else { "lin" },
        axis.unit
    )
}

/// A coordinate with one decimal, since a tenth of a pixel is precise enough.
fn n(value: f64) -> PreEscaped<String> {
    PreEscaped(number(value))
}

fn number(value: f64) -> String {
    let rounded = (value * 10.0).round() / 10.0;
    if rounded == 0.0 {
        "0".to_owned()
    } else {
        format!("{rounded}")
    }
}

fn path_data(points: &[(f64, f64)]) -> String {
    let mut data = String::with_capacity(points.len() * 11);
    for (i, (x, y)) in points.iter().enumerate() {
        let _ = write!(
            data,
            "{}{} {}",
            if i == 0 { "M" } else { "L" },
            number(*x),
            number(*y)
        );
    }
    data
}

/// A value with four significant digits for a title.
fn short(value: f64) -> String {
    crate::html::format::significant(value, 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_lies_inside_its_area_and_names_are_escaped() {
        let mut chart = Chart::new(
            "a < b",
            Axis::new("time (ms)", "ms", Scale::exact(0.0, 100.0)),
            Axis::new(
                "pressure (mmHg)",
                "mmHg",
                Scale::linear([0.0, 120.0], true).unwrap(),
            ),
        );
        chart.series.push(Series {
            class: "measured",
            name: "<script>".into(),
            points: (0..=100)
                .map(|i| (f64::from(i), 120.0 * (f64::from(i) / 30.0).sin().abs()))
                .collect(),
            dots: false,
        });
        let svg = chart.render().into_string();
        assert!(svg.contains("&lt;script&gt;") && !svg.contains("<script>"));
        let [x0, x1, y0, y1] = chart.area();
        let d = svg
            .split("class=\"line measured\" d=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap();
        let points: Vec<f64> = d
            .split(['M', 'L', ' '])
            .filter(|t| !t.is_empty())
            .map(|t| t.parse().unwrap())
            .collect();
        assert!(points.len() > 20);
        for xy in points.chunks(2) {
            assert!(
                xy[0] >= x0 && xy[0] <= x1 && xy[1] >= y0 && xy[1] <= y1,
                "{xy:?}"
            );
        }
    }

    #[test]
    fn a_value_without_a_place_on_a_logarithmic_axis_is_left_out() {
        let mut chart = Chart::new(
            "cost",
            Axis::new("iteration", "", Scale::exact(1.0, 3.0)),
            Axis::new("cost", "", Scale::log([0.1, 1.0], 2.0).unwrap()),
        );
        chart.series.push(Series {
            class: "step1",
            name: "cost".into(),
            points: vec![(1.0, 1.0), (2.0, 0.0), (3.0, 0.1)],
            dots: true,
        });
        let svg = chart.render().into_string();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
