//! `cardiotwin sweep cancel`: ends a sweep; published results stay.

use std::path::PathBuf;

use cardiotwin_engine as engine;
use cardiotwin_sweep::folder;
use clap::Args;

use crate::answer;
use crate::commands::cancel::end_jobs;
use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Stop a sweep; finished tasks are kept, and the sweep's command continues it
#[derive(Debug, Args)]
pub struct CancelArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
}

/// Requests the cancellation.
///
/// # Errors
/// [`SweepError::NoSweep`](cardiotwin_sweep::SweepError::NoSweep) if the folder holds no sweep; errors
/// of the engine.
pub async fn execute(args: &CancelArgs, talk: &Talk) -> Result<Exit, CliError> {
    folder::read(&args.folder)?;
    let answer = engine::cancel(&args.folder, None).await?;
    answer::tell(&answer, None, talk)?;
    end_jobs(&args.folder, &answer, talk).await
}
