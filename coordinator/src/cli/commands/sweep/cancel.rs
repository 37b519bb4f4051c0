//! `cardiotwin sweep cancel`: ends a sweep; what is published stays.

use std::path::PathBuf;

use clap::Args;

use crate::cli::answer;
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::talk::Talk;
use crate::engine;
use crate::sweep::folder;

/// Stop a sweep; what is finished stays, and the sweep's command goes on with it
#[derive(Debug, Args)]
pub struct CancelArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
}

/// Asks for it.
///
/// # Errors
/// [`SweepError::NoSweep`](crate::sweep::SweepError::NoSweep); the engine's.
pub async fn execute(args: &CancelArgs, talk: &Talk) -> Result<Exit, CliError> {
    folder::read(&args.folder)?;
    let answer = engine::cancel(&args.folder, None).await?;
    answer::tell(&answer, None, talk)?;
    Ok(Exit::Ok)
}
