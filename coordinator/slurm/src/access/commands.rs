//! Slurm's installed commands.

use std::os::unix::process::ExitStatusExt as _;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::answers::{Exit, Output};
use crate::commands::{Command, ENVIRONMENT, is_removed};

use super::Scheduler;

/// Time limit of a command. Slurm's own clients give up after some ten seconds per message, so that
/// a command that takes longer than this hangs.
const PATIENCE: Duration = Duration::from_secs(60);

/// Commands that may be run at once, equal to Slurm's default limit on a user's messages
/// (`rl_bucket_size`)…
const AT_ONCE: f64 = 30.0;
/// …and the number that may follow in each second (`rl_refill_rate`).
const EACH_SECOND: f64 = 2.0;

/// Slurm's commands as found in `PATH`, at a rate limited by `AT_ONCE` and `EACH_SECOND`.
#[derive(Debug)]
pub struct Installed {
    bucket: Bucket,
}

impl Default for Installed {
    fn default() -> Self {
        Self {
            bucket: Bucket {
                tokens: AT_ONCE,
                at: Instant::now(),
            },
        }
    }
}

/// Token bucket from which each command takes a token.
#[derive(Debug)]
struct Bucket {
    tokens: f64,
    at: Instant,
}

impl Bucket {
    /// Takes a token and returns the time until it is available.
    fn take(&mut self, now: Instant) -> Duration {
        let refilled = now.saturating_duration_since(self.at).as_secs_f64() * EACH_SECOND;
        (self.tokens, self.at) = ((self.tokens + refilled).min(AT_ONCE) - 1.0, now);
        Duration::from_secs_f64((-self.tokens).max(0.0) / EACH_SECOND)
    }
}

impl Scheduler for Installed {
    async fn ask(&mut self, command: &Command) -> Output {
        tokio::time::sleep(self.bucket.take(Instant::now())).await;
        let mut process = tokio::process::Command::new(command.program);
        process
            .args(&command.arguments)
            .stdin(Stdio::null())
            .kill_on_drop(true);
        for (name, _) in std::env::vars_os() {
            if name.to_str().is_some_and(is_removed) {
                process.env_remove(name);
            }
        }
        process.envs(ENVIRONMENT.iter().copied());
        let exit = match tokio::time::timeout(PATIENCE, process.output()).await {
            Err(_) => Exit::TimedOut,
            Ok(Err(error)) => {
                // A shell has the same exit code for a command that does not exist or cannot be
                // started.
                let stderr = format!("{}: {error}", command.program);
                return Output {
                    exit: Exit::Code(127),
                    stdout: String::new(),
                    stderr,
                };
            }
            Ok(Ok(output)) => {
                let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
                let exit = match (output.status.code(), output.status.signal()) {
                    (Some(code), _) => Exit::Code(code),
                    (None, signal) => Exit::Signal(signal.unwrap_or_default()),
                };
                return Output {
                    exit,
                    stdout: text(&output.stdout),
                    stderr: text(&output.stderr),
                };
            }
        };
        Output {
            exit,
            stdout: String::new(),
            stderr: String::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(program: &'static str, arguments: &[&str]) -> Command {
        Command {
            program,
            arguments: arguments.iter().map(|&a| a.to_owned()).collect(),
        }
    }

    #[test]
    fn a_burst_is_free_and_what_follows_is_spread() {
        let began = Instant::now();
        let mut bucket = Bucket {
            tokens: AT_ONCE,
            at: began,
        };
        let waits: Vec<f64> = (0..34).map(|_| bucket.take(began).as_secs_f64()).collect();
        assert!(waits[..30].iter().all(|wait| *wait == 0.0), "{waits:?}");
        assert_eq!(waits[30..], [0.5, 1.0, 1.5, 2.0]);
        // An hour later the bucket is full again, but not fuller.
        let later = began + Duration::from_secs(3600);
        let waits: Vec<f64> = (0..32).map(|_| bucket.take(later).as_secs_f64()).collect();
        assert_eq!(waits[30..], [0.5, 1.0]);
    }

    #[tokio::test]
    async fn codes_signals_and_missing_commands_are_told() {
        let sh = |script: &'static str| command("sh", &["-c", script]);
        let mut installed = Installed::default();
        let output = installed
            .ask(&sh("echo $SLURM_TIME_FORMAT; echo no >&2; exit 3"))
            .await;
        assert_eq!(
            (output.exit, output.stdout.as_str(), output.stderr.as_str()),
            (Exit::Code(3), "%s\n", "no\n")
        );
        assert_eq!(installed.ask(&sh("kill -9 $$")).await.exit, Exit::Signal(9));
        assert_eq!(
            installed.ask(&command("no-such-slurm", &[])).await.exit,
            Exit::Code(127)
        );
    }
}
