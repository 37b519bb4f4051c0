//! Small SVG charts whose colours and line styles come from the page's style sheet.
//!
//! `plotters` (0.3.7) was tried first. Its SVG backend rounds every point and line width to whole
//! pixels (`BackendCoord = (i32, i32)`) and supports neither dash patterns nor classes nor
//! `<title>`, so that themes, print and hover would mean patching its output. Its logarithmic axes
//! have ticks at decades only, whereas parameters here vary within one decade. The remaining part
//! of a chart library is these few hundred lines.

mod chart;
mod file;
mod scale;
mod simplify;

pub use chart::{Axis, Chart, Mark, Reading, Series, SvgText};
pub use file::stacked;
pub use scale::Scale;
