//! `cardiotwin sweep status`: how far a sweep is, and what holds it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::SCHEMA_VERSION;
use cardiotwin_schemas::status::PatientStatus;
use clap::Args;
use serde::Serialize;

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::talk::Talk;
use crate::engine::Reader;
use crate::sweep::folder;
use crate::sweep::gsa::{chunks, spec};

/// Show how far a sweep is
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
    /// JSON instead of text
    #[arg(long)]
    json: bool,
}

/// How far a sweep is.
#[derive(Debug, Serialize)]
struct SweepStatus {
    schema_version: u32,
    kind: &'static str,
    /// UTC, RFC 3339: when the store was read.
    as_of: String,
    coordinator_running: bool,
    /// Blocks of the whole sweep.
    blocks: u32,
    /// First blocks without a gap: what indices can rest on now.
    blocks_complete: u32,
    samples_complete: u64,
    /// Chunks by state.
    chunks: BTreeMap<String, u64>,
    failed: Vec<PatientStatus>,
}

/// Shows it.
///
/// # Errors
/// [`SweepError::NoSweep`](crate::sweep::SweepError::NoSweep); the store's.
pub async fn execute(args: &StatusArgs, talk: &Talk) -> Result<Exit, CliError> {
    let status = read(&args.folder).await?;
    if args.json {
        talk.json(&status)?;
    } else {
        talk.data(&text(&status))?;
        if status.blocks_complete >= 2 {
            talk.hint(&format!("`cardiotwin sweep show {}` shows the indices so far", args.folder.display()));
        }
    }
    Ok(Exit::Ok)
}

async fn read(folder: &Path) -> Result<SweepStatus, CliError> {
    let file = folder::read(folder)?;
    let kind = file.sweep.kind();
    let spec = spec::of(file)?;
    let reader = Reader::open(folder).await?;
    let status = reader.status().await?;
    let members = reader.members().await?;
    let complete = members.iter().take_while(|member| member.task.is_some());
    let blocks_complete = complete.filter_map(|member| chunks::blocks(&member.plan)).map(|b| b.end).max().unwrap_or(0);
    Ok(SweepStatus {
        schema_version: SCHEMA_VERSION,
        kind,
        as_of: status.as_of,
        coordinator_running: status.coordinator_running,
        blocks: spec.n_blocks,
        blocks_complete,
        samples_complete: u64::from(blocks_complete) * (2 * spec.design.parameters.len() as u64 + 2),
        chunks: status.counts,
        failed: status.patients.into_iter().filter(|member| member.state == "failed").collect(),
    })
}

fn text(status: &SweepStatus) -> String {
    let mut text = String::new();
    for member in &status.failed {
        let class = member.failure_class.map_or("", |class| class.as_str());
        text.push_str(&format!("{}  failed [{class}] {}\n", member.patient, member.note));
    }
    let chunks: Vec<String> = status.chunks.iter().map(|(state, n)| format!("{n} {state}")).collect();
    let coordinator = if status.coordinator_running { "a coordinator is running" } else { "no coordinator is running" };
    text.push_str(&format!(
        "{}: {} of {} blocks complete ({} samples); chunks: {}; {coordinator}; as of {}\n",
        status.kind,
        status.blocks_complete,
        status.blocks,
        status.samples_complete,
        chunks.join(", "),
        status.as_of
    ));
    text
}
