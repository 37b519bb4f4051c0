//! `cardiotwin fit`: fits of parameters to measured traces, outside any run.

mod afterload;
pub mod afterload_answer;
mod afterload_args;
mod calcium;
mod cohort_toml;
mod cuff;
mod estimates;
pub mod record;
pub mod trace;

use clap::{Args, Subcommand};

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Fit a part of the model to measured traces
#[derive(Debug, Args)]
pub struct FitArgs {
    #[command(subcommand)]
    command: FitCommand,
}

#[derive(Debug, Subcommand)]
enum FitCommand {
    Afterload(afterload_args::AfterloadArgs),
    Calcium(calcium::CalciumArgs),
}

/// Runs the fit that the arguments name.
///
/// # Errors
/// [`CliError::Trace`] if a trace cannot be used, [`CliError::File`] if a plot cannot be written,
/// [`CliError::Usage`] for arguments or a record that cannot be fitted.
pub fn execute(args: &FitArgs, talk: &Talk) -> Result<Exit, CliError> {
    match &args.command {
        FitCommand::Afterload(args) => afterload::execute(args, talk),
        FitCommand::Calcium(args) => calcium::execute(args, talk),
    }
}
