//! One file per command: arguments, and what they do.

pub mod advance;
pub mod backup;
pub mod bench;
pub mod cancel;
pub mod check;
pub mod compare;
pub mod completions;
pub mod config;
pub mod discover;
pub mod drive;
pub mod explain;
pub mod export;
pub mod fit;
pub mod init;
pub mod logs;
pub mod man;
pub mod plan;
pub mod report;
pub mod rerun;
pub mod retry;
pub mod run;
pub mod schemas;
pub mod show;
pub mod simulate;
pub mod status;
pub mod sweep;
