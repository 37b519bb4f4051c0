//! All SQL: SQLite with one writer ([`Writer`]) and any number of readers ([`Reader`]).
//!
//! One transaction ([`Batch`]) appends the events, updates rows guarded by their versions, and puts
//! actions in the outbox. Actions run after the commit. A worker never opens the database.
//!
//! # Why rows travel as JSON
//! SQLite runs on a thread of its own. Each statement is handed over to it, and each value of a row is handed back.
//! To hand over costs more than to store. So the rows of each table are one JSON array for one statement, which SQLite's
//! `json_each` takes apart: a commit of a thousand transitions costs the same statements as a commit of one. Tables of many rows are
//! read likewise, some hundreds of rows to a text, and rows that are read one by one are buffered on the way.

pub mod attempts;
mod batch;
mod before;
pub mod chosen;
pub mod clock;
pub mod cluster_jobs;
mod creation;
mod database;
mod error;
pub mod events;
pub mod file_system;
mod foreign;
#[cfg(test)]
mod golden;
mod job_costs;
pub mod lease;
pub mod lock;
mod moved;
pub mod notable;
mod open;
pub mod outbox;
mod pace;
mod patience;
pub mod patients;
pub mod pilots;
mod reader;
mod record;
mod revision;
mod screen;
pub mod seen;
pub mod steps;
mod stored_files;
mod stored_formats;
pub mod tasks;
#[cfg(test)]
mod tests;
mod trial;
mod view;
mod writer;

pub use batch::Batch;
pub use chosen::Chosen;
pub use cluster_jobs::JobRecord;
pub use creation::Pass;
pub use database::{DATABASE_FILE, SNAPSHOT_FILE};
pub use error::StoreError;
pub use job_costs::{ElementCost, JobCosts};
pub use moved::MovedCohort;
pub use notable::Notable;
pub use open::back_up;
pub use pace::Pace;
pub use patience::{Patience, Waiting};
pub use reader::Reader;
pub use record::MemberRecord;
pub use stored_files::StoredFile;
pub use trial::try_locks;
pub use view::{AttemptRecord, EventRecord, LeafChange, StepExplanation, leaf_changes};
pub use writer::{Extent, Loaded, Writer};
