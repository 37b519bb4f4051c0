//! All SQL: SQLite with one writer ([`Writer`]) and any number of readers ([`Reader`]).
//!
//! One transaction ([`Batch`]) appends the events, updates rows guarded by their versions, and puts
//! actions in the outbox. Actions run after the commit. A worker never opens the database.

pub mod attempts;
mod batch;
mod before;
pub mod cluster_jobs;
mod error;
pub mod events;
pub mod file_system;
pub mod lease;
pub mod lock;
pub mod notable;
mod open;
pub mod outbox;
pub mod patients;
mod reader;
mod record;
mod screen;
pub mod steps;
pub mod tasks;
#[cfg(test)]
pub(crate) mod tests;
mod trial;
mod view;
mod writer;

pub use batch::Batch;
pub use cluster_jobs::JobRecord;
pub use error::StoreError;
pub use notable::Notable;
pub use open::{DATABASE_FILE, SNAPSHOT_FILE, back_up};
pub use reader::Reader;
pub use record::MemberRecord;
pub use trial::try_locks;
pub use view::{AttemptRecord, EventRecord, LeafChange, StepExplanation, leaf_changes};
pub use writer::{Loaded, Writer};
