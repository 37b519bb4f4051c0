//! `cardiotwin completions`: completions for bash, zsh, fish and other shells.

use clap::Args;
use clap_complete::Shell;

use crate::completion;
use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Print a completion script for a shell
#[derive(Debug, Args)]
#[command(
    after_help = "Completes commands, options, patients of the cohort and steps. For bash, in ~/.bashrc:\n  \
                  source <(cardiotwin completions bash)"
)]
pub struct CompletionsArgs {
    /// Shell to complete for
    shell: Shell,
}

/// Prints the completions.
///
/// # Errors
/// Stdout cannot be written.
pub fn execute(args: &CompletionsArgs, talk: &Talk) -> Result<Exit, CliError> {
    let shell = args.shell.to_string();
    let unknown = || CliError::Usage(format!("no completions for {shell}"));
    let text = completion::script(&shell).ok_or_else(unknown)?;
    talk.data(&text.map_err(|source| CliError::Io {
        what: "cannot write the script",
        source,
    })?)?;
    Ok(Exit::Ok)
}
