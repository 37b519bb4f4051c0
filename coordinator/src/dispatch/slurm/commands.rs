//! Slurm's commands as they are installed.

use std::os::unix::process::ExitStatusExt as _;
use std::process::Stdio;
use std::time::Duration;

use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::commands::{Command, ENVIRONMENT, NOT_IN_ENVIRONMENT};

use super::Scheduler;

/// Slurm's own clients give up after some ten seconds for each message; what takes longer than this hangs.
const PATIENCE: Duration = Duration::from_secs(60);

/// Slurm's commands, found by `PATH`.
#[derive(Debug, Default)]
pub struct Installed;

impl Scheduler for Installed {
    async fn ask(&mut self, command: &Command) -> Output {
        let mut process = tokio::process::Command::new(command.program);
        process.args(&command.arguments).stdin(Stdio::null()).kill_on_drop(true);
        NOT_IN_ENVIRONMENT.iter().for_each(|name| {
            process.env_remove(name);
        });
        process.envs(ENVIRONMENT.iter().copied());
        let exit = match tokio::time::timeout(PATIENCE, process.output()).await {
            Err(_) => Exit::TimedOut,
            Ok(Err(error)) => {
                // As a shell says it: the command is not there, or could not be started.
                let stderr = format!("{}: {error}", command.program);
                return Output { exit: Exit::Code(127), stdout: String::new(), stderr };
            }
            Ok(Ok(output)) => {
                let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
                let exit = match (output.status.code(), output.status.signal()) {
                    (Some(code), _) => Exit::Code(code),
                    (None, signal) => Exit::Signal(signal.unwrap_or_default()),
                };
                return Output { exit, stdout: text(&output.stdout), stderr: text(&output.stderr) };
            }
        };
        Output { exit, stdout: String::new(), stderr: String::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(program: &'static str, arguments: &[&str]) -> Command {
        Command { program, arguments: arguments.iter().map(|&a| a.to_owned()).collect() }
    }

    #[tokio::test]
    async fn codes_signals_and_missing_commands_are_told() {
        let sh = |script: &'static str| command("sh", &["-c", script]);
        let output = Installed.ask(&sh("echo $SLURM_TIME_FORMAT; echo no >&2; exit 3")).await;
        assert_eq!((output.exit, output.stdout.as_str(), output.stderr.as_str()), (Exit::Code(3), "%s\n", "no\n"));
        assert_eq!(Installed.ask(&sh("kill -9 $$")).await.exit, Exit::Signal(9));
        assert_eq!(Installed.ask(&command("no-such-slurm", &[])).await.exit, Exit::Code(127));
    }
}
