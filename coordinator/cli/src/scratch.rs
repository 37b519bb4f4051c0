//! Place of a run's attempts: in the run's folder, or on a separate file system, to which the run's
//! folder then has a link.

use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, symlink};
use std::path::{Path, PathBuf};

use cardiotwin_engine::ATTEMPTS;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::settings::ExecutorSettings;

use super::error::CliError;

/// Makes the link to `executor.scratch`, or checks the existing one. A target that was purged is
/// made again, empty.
///
/// # Errors
/// The attempts lie elsewhere already, or a folder cannot be made.
pub fn lay_out(settings: &ExecutorSettings, run_dir: &Path) -> Result<(), CliError> {
    let link = run_dir.join(ATTEMPTS);
    let is_shared = settings.group.is_some();
    let Some(scratch) = &settings.scratch else {
        // An existing link stays although the setting is gone. Its target may have been purged.
        return match fs::read_link(&link) {
            Ok(target) => make(&target, is_shared),
            Err(_) => Ok(()),
        };
    };
    if !scratch.is_absolute() {
        let message = format!(
            "executor.scratch is \"{}\", expected an absolute path such as /scratch/me",
            scratch.display()
        );
        return Err(CliError::Usage(message));
    }
    fs::create_dir_all(run_dir).map_err(CliError::file("create", run_dir))?;
    let target = folder_of(scratch, run_dir);
    let elsewhere = |at: &Path| {
        let (at, to) = (at.display(), target.display());
        CliError::Usage(format!(
            "the attempts of this run are in {at}, but executor.scratch is {to}: remove the \
             setting, or move them while nothing runs: `mv {at} {to}`, then remove {}",
            link.display()
        ))
    };
    match fs::symlink_metadata(&link) {
        Ok(found) if found.is_symlink() => {
            let leads_to = fs::read_link(&link).map_err(CliError::file("read", &link))?;
            if leads_to != target {
                return Err(elsewhere(&leads_to));
            }
            return make(&target, is_shared);
        }
        // An empty folder can be replaced by the link.
        Ok(_) => fs::remove_dir(&link).map_err(|_| elsewhere(&link))?,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(CliError::file("read", &link)(error)),
    }
    make(&target, is_shared)?;
    match symlink(&target, &link) {
        // Another command made the link at the same moment.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => lay_out(settings, run_dir),
        made => made.map_err(CliError::file("create the link", &link)),
    }
}

/// Makes the folder of the attempts below the run's own folder on the scratch file system, whose
/// name others can guess. The run's folder is closed to all others unless a group shares the run,
/// and belongs to this user.
fn make(target: &Path, is_shared: bool) -> Result<(), CliError> {
    let own = target.parent().unwrap_or(target);
    let scratch = own.parent().unwrap_or(own);
    fs::create_dir_all(scratch).map_err(CliError::file("create", scratch))?;
    let mode = if is_shared { 0o770 } else { 0o700 };
    for folder in [own, target] {
        match fs::DirBuilder::new().mode(mode).create(folder) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => check(folder)?,
            made => made.map_err(CliError::file("create", folder))?,
        }
    }
    Ok(())
}

/// Refuses a folder that somebody else made, or a link in its place.
fn check(folder: &Path) -> Result<(), CliError> {
    let found = fs::symlink_metadata(folder).map_err(CliError::file("read", folder))?;
    let me = rustix::process::geteuid().as_raw();
    let at = folder.display();
    let found = if !found.is_dir() {
        "is no folder".to_owned()
    } else if found.uid() != me {
        format!("belongs to user {}", found.uid())
    } else {
        return Ok(());
    };
    Err(CliError::Usage(format!(
        "{at} {found}, expected a folder of your own (user {me}) for the attempts of this run: \
         remove it, or set executor.scratch to another place"
    )))
}

/// Folder for this run alone, named after the cohort's folder and a hash of the run's path.
fn folder_of(scratch: &Path, run_dir: &Path) -> PathBuf {
    let run_dir = fs::canonicalize(run_dir).unwrap_or_else(|_| run_dir.to_owned());
    let cohort = run_dir
        .parent()
        .and_then(Path::file_name)
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let hash = sha256_hex(run_dir.to_string_lossy().as_bytes());
    scratch
        .join(format!("{cohort}-{}", &hash[..8]))
        .join(ATTEMPTS)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(scratch: &Path) -> ExecutorSettings {
        ExecutorSettings {
            scratch: Some(scratch.to_owned()),
            ..ExecutorSettings::default()
        }
    }

    #[test]
    fn the_folder_is_ones_own_and_closed_to_others() {
        let folder = tempfile::tempdir().unwrap();
        let (run, scratch) = (folder.path().join("c/run"), folder.path().join("scratch"));
        lay_out(&settings(&scratch), &run).unwrap();
        let target = fs::read_link(run.join(ATTEMPTS)).unwrap();
        let own = target.parent().unwrap();
        for made in [&target, own] {
            assert_eq!(fs::metadata(made).unwrap().mode() & 0o777, 0o700);
        }
        fs::remove_dir_all(own).unwrap();
        let elsewhere = folder.path().join("elsewhere");
        fs::create_dir(&elsewhere).unwrap();
        symlink(&elsewhere, own).unwrap();
        let error = lay_out(&settings(&scratch), &run).unwrap_err().to_string();
        assert!(error.contains("is no folder"), "{error}");
        assert!(fs::read_dir(&elsewhere).unwrap().next().is_none());
        if rustix::process::geteuid().is_root() {
            fs::remove_file(own).unwrap();
            fs::create_dir(own).unwrap();
            std::os::unix::fs::chown(own, Some(65534), None).unwrap();
            let error = lay_out(&settings(&scratch), &run).unwrap_err().to_string();
            assert!(error.contains("belongs to user 65534"), "{error}");
        }
    }

    #[test]
    fn the_link_is_made_once_and_what_lies_elsewhere_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (run, scratch) = (folder.path().join("c/run"), folder.path().join("scratch"));
        fs::create_dir_all(run.join(ATTEMPTS)).unwrap();
        lay_out(&settings(&scratch), &run).unwrap();
        let target = fs::read_link(run.join(ATTEMPTS)).unwrap();
        assert!(target.starts_with(&scratch) && target.is_dir());
        fs::remove_dir_all(&scratch).unwrap();
        lay_out(&settings(&scratch), &run).unwrap();
        assert!(target.is_dir(), "purged, and made anew");
        fs::remove_dir_all(&scratch).unwrap();
        lay_out(&ExecutorSettings::default(), &run).unwrap();
        assert!(target.is_dir(), "the link stays");
        let error = lay_out(&settings(&folder.path().join("other")), &run)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("executor.scratch") && error.contains("mv "),
            "{error}"
        );
        assert!(lay_out(&settings(Path::new("relative")), &run).is_err());

        let old = folder.path().join("d/run");
        fs::create_dir_all(old.join("attempts/aa")).unwrap();
        assert!(
            lay_out(&settings(&scratch), &old).is_err(),
            "a run that has attempts keeps them where they are"
        );
        assert!(old.join("attempts/aa").is_dir());
    }
}
