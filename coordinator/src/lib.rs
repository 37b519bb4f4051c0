//! The coordinator: cohorts in, personalised twins out.
pub mod cli;
pub mod clock;
pub mod discovery;
pub mod dispatch;
pub mod engine;
pub mod export;
pub mod input;
pub mod preparation;
pub mod report;
pub mod results;
pub mod store;
pub mod sweep;
