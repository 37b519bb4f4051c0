//! Data that report, export and comparison read from a
//! [`RunRecord`](cardiotwin_schemas::record::RunRecord): the traces behind it, the iterate that was
//! taken, relative differences, means. The module imports only schemas, and accesses neither store
//! nor network.

pub mod atomic;
pub mod columns;
pub mod comparison;
pub mod discovery;
pub mod folder;
pub mod heart;
pub mod learned_law;
pub mod model;
pub mod signals;
pub mod spread;
pub mod standing;
pub mod tables;
pub mod twin;
mod write_error;

pub use comparison::{
    MeanSd, PAPER_STEP1_PERCENT, PAPER_STEP2_PERCENT, PatientView, Step, mean_error,
};
pub use heart::{HeartError, HeartFile};
pub use learned_law::{Teacher, learned_law, teachers};
pub use signals::{Signal, SignalKind, Signals, Source};
pub use spread::SpreadFile;
pub use write_error::WriteError;
