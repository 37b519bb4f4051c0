//! Output that programs print about themselves.

use std::ffi::OsStr;
use std::process::{Command, Stdio};

/// First line that a program prints; `None` if it does not exist or fails.
#[must_use]
pub fn first_line(program: impl AsRef<OsStr>, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    output
        .status
        .success()
        .then(|| text.lines().next().unwrap_or_default().trim().to_owned())
}
