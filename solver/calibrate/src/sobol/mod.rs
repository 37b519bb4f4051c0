//! Variance-based sensitivity: Sobol points, the Saltelli design, indices with intervals, ranking.
//!
//! Points, design, indices and intervals equal `SALib`'s for the same settings and seeds. A sweep
//! generates rows of blocks from [`SaltelliDesign`], computes its outputs anywhere, passes them
//! through [`replace_excluded`] and applies [`analyse`] to any number of first blocks. [`Ranking`]
//! selects the parameters to fit.

mod direction_numbers;
mod error;
mod exclusion;
mod indices;
mod numpy_random;
mod points;
mod ranking;
mod saltelli;
mod terms;
#[cfg(test)]
mod tests;

pub use cardiotwin_vocabulary::statistics::SobolIndex;
pub use error::SobolError;
pub use exclusion::{Exclusion, Sample, replace_excluded};
pub use indices::{Analysis, AnalysisSettings, OutputIndices, PairIndex, analyse};
pub use points::SobolPoints;
pub use ranking::{Ranked, Ranking};
pub use saltelli::{DesignSettings, SaltelliDesign};
