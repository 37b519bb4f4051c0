//! Small SVG charts whose colours and line styles come from the page's style sheet.
//!
//! Why not `plotters` (0.3.7, tried first): its SVG backend rounds every point and line width to whole pixels
//! (`BackendCoord = (i32, i32)`), knows neither dash patterns nor classes nor `<title>`, so that themes, print and
//! hover would mean patching its output text; its logarithmic axes tick decades only, while parameters here stay
//! within one. What is left of a chart library after that is these few hundred lines.

mod chart;
mod file;
mod scale;
mod simplify;

pub use chart::{Axis, Chart, Mark, Reading, Series, SvgText};
pub use file::stacked;
pub use scale::Scale;
