//! `cardiotwin sweep`: many simulations around a design, as a run of its own.

mod cancel;
mod drive;
mod gsa;
mod on_cluster;
mod outcome;
mod report;
mod robustness;
mod robustness_text;
mod screen;
mod show;
mod status;

pub use drive::drive;

use clap::{Args, Subcommand};

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Run and show parameter sweeps: sensitivity analysis and robustness of personalisations
#[derive(Debug, Args)]
pub struct SweepArgs {
    #[command(subcommand)]
    command: SweepCommand,
}

#[derive(Debug, Subcommand)]
enum SweepCommand {
    Gsa(gsa::GsaArgs),
    Robustness(robustness::RobustnessArgs),
    Status(status::StatusArgs),
    Show(show::ShowArgs),
    Report(report::ReportArgs),
    Cancel(cancel::CancelArgs),
}

/// Runs the sweep command.
///
/// # Errors
/// Errors of the engine, the store and the sweep.
pub async fn execute(args: &SweepArgs, talk: &Talk) -> Result<Exit, CliError> {
    match &args.command {
        SweepCommand::Gsa(args) => gsa::execute(args, talk).await,
        SweepCommand::Robustness(args) => robustness::execute(args, talk).await,
        SweepCommand::Status(args) => status::execute(args, talk).await,
        SweepCommand::Show(args) => show::execute(args, talk).await,
        SweepCommand::Report(args) => report::execute(args, talk).await,
        SweepCommand::Cancel(args) => cancel::execute(args, talk).await,
    }
}
