//! File access of a run: the umask for new files and the group of the run's folder.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use cardiotwin_engine::EngineError;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};
use rustix::fs::Mode;

use super::error::CliError;
use super::place::DATABASE;

/// Permission bits that are masked for other users unless `executor.umask` is set: all of them.
const OTHERS: u32 = 0o007;
/// The set-group-ID bit: files made below a folder with this bit get the folder's group.
const SET_GROUP: u32 = 0o2000;

/// Sets the umask of this process so that copies and pages of a run are no more open than the run's
/// database.
pub fn as_of_run(run_dir: &Path) {
    let Ok(found) = fs::metadata(run_dir.join(DATABASE)) else {
        return; // The command itself says that there is no run.
    };
    let closed = !found.permissions().mode() & 0o066;
    // Who may not read a file may not search a folder.
    let mask = closed | ((closed >> 2) & 0o011);
    let inherited = rustix::process::umask(Mode::from_raw_mode(0o077));
    rustix::process::umask(Mode::from_raw_mode(inherited.as_raw_mode() | mask));
}

/// Refuses the folder of a run whose name no batch script can hold.
///
/// # Errors
/// [`EngineError::Site`] for a name with a line break or another control character.
pub fn check_name(settings: &ExecutorSettings, run_dir: &Path) -> Result<(), CliError> {
    let name = std::path::absolute(run_dir).unwrap_or_else(|_| run_dir.to_owned());
    let name = name.to_string_lossy();
    if settings.kind != ExecutorKind::Slurm || !name.contains(char::is_control) {
        return Ok(());
    }
    let message = format!(
        "the run's folder is {name:?}, expected a path without line breaks and control characters, \
         which no batch script can hold: rename the folder, or choose another with --run-dir"
    );
    Err(EngineError::Site { message }.into())
}

/// Sets the umask of this process, which its workers, jobs and drivers inherit, and makes the run's
/// folder with the configured group.
///
/// # Errors
/// As [`check_name`]; the folder cannot be made, or the group does not exist or does not contain this user.
pub fn apply(settings: &ExecutorSettings, run_dir: &Path) -> Result<(), CliError> {
    check_name(settings, run_dir)?;
    let asked = settings
        .umask
        .as_deref()
        .and_then(|text| u32::from_str_radix(text, 8).ok());
    let inherited = rustix::process::umask(Mode::from_raw_mode(0o077));
    let mask = asked.unwrap_or(inherited.as_raw_mode() | OTHERS);
    rustix::process::umask(Mode::from_raw_mode(mask));
    let Some(group) = &settings.group else {
        return Ok(());
    };
    fs::create_dir_all(run_dir).map_err(CliError::file("create", run_dir))?;
    // `chgrp` looks the group up in whatever user directory the site has.
    let said = Command::new("chgrp")
        .arg("--")
        .arg(group)
        .arg(run_dir)
        .stdin(Stdio::null())
        .output();
    let said = said.map_err(CliError::file("run `chgrp` on", run_dir))?;
    if !said.status.success() {
        let why = String::from_utf8_lossy(&said.stderr).trim().to_owned();
        let message = format!(
            "executor.group = \"{group}\": {why}; name one of your own groups (`id -Gn` lists them)"
        );
        return Err(CliError::Usage(message));
    }
    let mode = fs::metadata(run_dir)
        .map_err(CliError::file("read", run_dir))?
        .permissions()
        .mode();
    fs::set_permissions(run_dir, fs::Permissions::from_mode(mode | SET_GROUP))
        .map_err(CliError::file("change", run_dir))
}
