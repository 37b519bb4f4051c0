//! `cardiotwin man`: manual pages, one for the program and one for each command.

use std::path::PathBuf;

use clap::Args;
use clap_mangen::Man;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Print the manual page, or write the pages of all commands
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Write cardiotwin.1 and one page per command into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the program's manual page, or writes the pages of all commands.
///
/// - `command`: the program as clap knows it
///
/// # Errors
/// [`CliError::File`] if the folder cannot be made, [`CliError::Io`] if a page cannot be written.
pub fn execute(args: &ManArgs, command: clap::Command, talk: &Talk) -> Result<Exit, CliError> {
    let io = |source| CliError::Io {
        what: "cannot write the manual page",
        source,
    };
    let Some(folder) = &args.out else {
        let mut text = Vec::new();
        Man::new(command).render(&mut text).map_err(io)?;
        talk.data(&String::from_utf8_lossy(&text))?;
        return Ok(Exit::Ok);
    };
    std::fs::create_dir_all(folder).map_err(CliError::file("create", folder))?;
    clap_mangen::generate_to(command, folder).map_err(io)?;
    talk.say(&format!("manual pages written to {}", folder.display()));
    Ok(Exit::Ok)
}
