//! Commands of the operator, which get their input and a time limit.

use std::os::unix::process::ExitStatusExt as _;
use std::process::Stdio;
use std::time::Duration;

use tokio::io::AsyncWriteExt as _;
use tokio::process::Command;

/// The way in which a command ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CommandEnd {
    /// The command exited with this code.
    Code(i32),
    /// A signal ended the command.
    Signal,
    /// The command took too long and was killed together with its child processes.
    TimedOut,
    /// The command could not be started, with the reason.
    NotStarted(String),
}

/// Starts a program with arguments in a process group of its own, writes `input` to its stdin, and
/// waits for its end, at most for `limit`.
pub async fn run_limited(command: &[String], input: &str, limit: Duration) -> CommandEnd {
    let Some((program, arguments)) = command.split_first() else {
        return CommandEnd::NotStarted("no program is named".into());
    };
    let mut process = Command::new(program);
    process
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .process_group(0);
    let mut child = match process.spawn() {
        Ok(child) => child,
        Err(error) => return CommandEnd::NotStarted(error.to_string()),
    };
    let group = child.id().and_then(|pid| i32::try_from(pid).ok());
    let stdin = child.stdin.take();
    let whole = async {
        if let Some(mut stdin) = stdin {
            // A command that does not read its input may still succeed.
            let _ = stdin.write_all(input.as_bytes()).await;
        }
        child.wait().await
    };
    match tokio::time::timeout(limit, whole).await {
        Err(_) => {
            if let Some(group) = group.and_then(rustix::process::Pid::from_raw) {
                let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
            }
            CommandEnd::TimedOut
        }
        Ok(Err(error)) => CommandEnd::NotStarted(error.to_string()),
        Ok(Ok(status)) => match (status.code(), status.signal()) {
            (Some(code), _) => CommandEnd::Code(code),
            (None, _) => CommandEnd::Signal,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Vec<String> {
        ["sh", "-c", script]
            .iter()
            .map(|word| (*word).to_owned())
            .collect()
    }

    #[tokio::test]
    async fn input_arrives_and_every_end_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let got = folder.path().join("got");
        let limit = Duration::from_secs(60);
        let end = run_limited(
            &shell(&format!("cat > {}; exit 3", got.display())),
            "what happened",
            limit,
        )
        .await;
        assert_eq!(
            (end, std::fs::read_to_string(got).unwrap().as_str()),
            (CommandEnd::Code(3), "what happened")
        );
        // The input is larger than a pipe, and the command reads none of it.
        let much = "x".repeat(1 << 20);
        assert_eq!(
            run_limited(&shell("exit 0"), &much, limit).await,
            CommandEnd::Code(0)
        );
        assert_eq!(
            run_limited(&shell("kill -9 $$"), "", limit).await,
            CommandEnd::Signal
        );
        assert!(matches!(
            run_limited(&["/no/such".to_owned()], "", limit).await,
            CommandEnd::NotStarted(_)
        ));
    }

    #[tokio::test]
    async fn a_command_that_hangs_is_killed_with_its_children() {
        let folder = tempfile::tempdir().unwrap();
        let pid = folder.path().join("pid");
        let script = format!("sleep 1000 & echo $! > {}; wait", pid.display());
        assert_eq!(
            run_limited(&shell(&script), "", Duration::from_millis(500)).await,
            CommandEnd::TimedOut
        );
        let pid = std::fs::read_to_string(pid).unwrap();
        let state =
            || std::fs::read_to_string(format!("/proc/{}/stat", pid.trim())).unwrap_or_default();
        for _ in 0..500 {
            // A killed child may not be reaped yet by the process that inherited it.
            if state().is_empty() || state().contains(") Z ") {
                return;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("the child lives: {}", state());
    }
}
