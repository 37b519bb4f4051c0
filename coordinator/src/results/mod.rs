//! What report, export and comparison read from a [`RunRecord`](cardiotwin_schemas::record::RunRecord): the traces
//! behind it, the iterate that was taken, relative differences, means. Imports schemas alone; no store, no network.

pub mod atomic;
pub mod columns;
pub mod comparison;
pub mod discovery;
pub mod signals;
mod write_error;

pub use comparison::{Biomarker, MeanSd, PatientView, Step};
pub use signals::{Signal, SignalKind, Signals, Source};
pub use write_error::WriteError;
