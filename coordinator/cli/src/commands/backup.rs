//! `cardiotwin backup`: a verified copy of a run's database.

use std::path::PathBuf;

use cardiotwin_engine as engine;
use clap::Args;

use crate::access;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::talk::Talk;

/// Copy a run's database, even while a coordinator is running, and check the copy
#[derive(Debug, Args)]
#[command(
    after_help = "The copy can replace a damaged cardiotwin.db of the run. It does not contain the \
                  attempts' folders."
)]
pub struct BackupArgs {
    #[command(flatten)]
    place: Place,
    /// File of the copy, which must not exist
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
}

/// Copies the database and checks the copy.
///
/// # Errors
/// Errors of the store; [`CliError::Usage`] if the target file already exists.
pub async fn execute(args: &BackupArgs, talk: &Talk) -> Result<Exit, CliError> {
    if args.to.exists() {
        return Err(CliError::Usage(format!(
            "{} already exists: name another file",
            args.to.display()
        )));
    }
    let folders = args.place.folders();
    access::as_of_run(&folders.run);
    let bytes = engine::back_up(&folders.run, &args.to).await?;
    talk.data(&format!(
        "{}: {:.1} MB, checked\n",
        args.to.display(),
        bytes as f64 / 1e6
    ))?;
    Ok(Exit::Ok)
}
