//! `cardiotwin sweep show`: the indices so far, at any time.

use std::path::PathBuf;

use clap::Args;

use super::outcome::{self, Phases};
use super::screen::{self, Order};
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::talk::Talk;

/// Show the indices of what is complete so far
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
    /// Which indices: first-order or total
    #[arg(long, value_name = "ORDER", value_enum, hide_possible_values = true, default_value_t = Order::Total)]
    order: Order,
    /// Show the N largest second-order indices of each biomarker instead
    #[arg(long, value_name = "N")]
    pairs: Option<usize>,
    /// Use the first N blocks only
    #[arg(long, value_name = "N")]
    blocks: Option<u32>,
    /// JSON instead of a table (schema: sensitivity.schema.json)
    #[arg(long)]
    json: bool,
}

/// Analyses and shows; writes nothing.
///
/// # Errors
/// [`SweepError`](crate::sweep::SweepError) when there is no sweep or too little of it.
pub async fn execute(args: &ShowArgs, talk: &Talk) -> Result<Exit, CliError> {
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
