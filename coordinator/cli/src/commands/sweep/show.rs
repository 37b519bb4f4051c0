//! `cardiotwin sweep show`: indices or tables from the results so far.

use std::path::PathBuf;

use cardiotwin_schemas::sweep::SweepSpec;
use cardiotwin_sweep::folder;
use clap::Args;

use super::outcome::{self, Phases};
use super::screen::{self, Order};
use super::{robustness, robustness_text};
use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Show results of the finished part of a sweep: indices, or the tables of robustness
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
    /// Order of the indices: first-order or total
    #[arg(long, value_name = "ORDER", value_enum, hide_possible_values = true, default_value_t = Order::Total)]
    order: Order,
    /// Show the N largest second-order indices of each biomarker instead
    #[arg(long, value_name = "N")]
    pairs: Option<usize>,
    /// Use only the first N blocks
    #[arg(long, value_name = "N")]
    blocks: Option<u32>,
    /// Print JSON instead of a table (schema: sensitivity.schema.json, robustness.schema.json)
    #[arg(long)]
    json: bool,
}

/// Analyses the sweep and prints the result. Writes no files.
///
/// # Errors
/// [`SweepError`](cardiotwin_sweep::SweepError) if the folder holds no sweep, or too few of its members
/// are complete.
pub async fn execute(args: &ShowArgs, talk: &Talk) -> Result<Exit, CliError> {
    if let SweepSpec::Robustness(spec) = folder::read(&args.folder)?.sweep {
        let (result, _) = robustness::stored(&args.folder, &spec).await?;
        if args.json {
            talk.json(&result)?;
        } else {
            talk.data(&robustness_text::tables(&result, talk))?;
        }
        return Ok(Exit::Ok);
    }
    let record = outcome::analysed(&args.folder, args.blocks, &mut Phases::default()).await?;
    if args.json {
        talk.json(&record)?;
        return Ok(Exit::Ok);
    }
    match args.pairs {
        Some(n) => talk.data(&screen::pairs(&record, n, talk))?,
        None => talk.data(&screen::ranking(&record, args.order, talk))?,
    }
    talk.data(&screen::remarks(&record))?;
    Ok(Exit::Ok)
}
