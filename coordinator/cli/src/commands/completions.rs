//! `cardiotwin completions`: completions for bash, zsh, fish and other shells.

use clap::Args;
use clap_complete::Shell;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Print a completion script for a shell
#[derive(Debug, Args)]
#[command(
    after_help = "For bash: cardiotwin completions bash > ~/.local/share/bash-completion/completions/cardiotwin"
)]
pub struct CompletionsArgs {
    /// Shell to complete for
    shell: Shell,
}

/// Prints the completions.
///
/// - `command`: the program as clap knows it
///
/// # Errors
/// Stdout cannot be written.
pub fn execute(
    args: &CompletionsArgs,
    mut command: clap::Command,
    talk: &Talk,
) -> Result<Exit, CliError> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "cardiotwin", &mut text);
    talk.data(&String::from_utf8_lossy(&text))?;
    Ok(Exit::Ok)
}
