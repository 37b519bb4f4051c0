//! The cohort and the run that a command works on.

use std::path::{Path, PathBuf};

use cardiotwin_engine::Reader;
use cardiotwin_sweep::folder;
use clap::Args;

use super::error::CliError;

/// A cohort or run as the first argument, or after `--cohort` as in every other command.
#[derive(Debug, Clone, Args)]
pub struct Place {
    /// Folder of the cohort (with cohort.toml) or of the run (with cardiotwin.db)
    #[arg(value_name = "COHORT", default_value = ".")]
    folder: PathBuf,
    /// The same as COHORT
    #[arg(long, value_name = "DIR", hide = true, conflicts_with = "folder")]
    cohort: Option<PathBuf>,
    /// Folder of the run [default: COHORT/run]
    #[arg(long, value_name = "DIR")]
    pub run_dir: Option<PathBuf>,
}

/// A cohort or run, for a command whose first argument is a patient.
#[derive(Debug, Clone, Args)]
pub struct OfCohort {
    /// Folder of the cohort (with cohort.toml) or of the run (with cardiotwin.db)
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub cohort: PathBuf,
    /// Folder of the run [default: COHORT/run]
    #[arg(long, value_name = "DIR")]
    pub run_dir: Option<PathBuf>,
}

/// Folders of the cohort and the run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Folders {
    /// Folder of the cohort; `None` if only a run was named.
    pub cohort: Option<PathBuf>,
    /// Folder of the run, which need not exist.
    pub run: PathBuf,
}

/// File by which a run's folder is recognised.
pub const DATABASE: &str = "cardiotwin.db";
/// File by which a cohort's folder is recognised.
const COHORT: &str = "cohort.toml";

/// The folder of a cohort that was named by its folder or by its `cohort.toml`.
#[must_use]
pub fn cohort_folder(named: &Path) -> &Path {
    match named.parent() {
        Some(folder) if named.ends_with(COHORT) && named.is_file() => match folder.as_os_str() {
            at if at.is_empty() => Path::new("."),
            _ => folder,
        },
        _ => named,
    }
}

/// Whether a folder is a cohort's.
#[must_use]
pub fn is_cohort(folder: &Path) -> bool {
    folder.join(COHORT).exists()
}

impl Folders {
    /// Folders for the arguments. Without `run_dir`, `folder` is a run if it holds a database but
    /// no `cohort.toml`; otherwise it is a cohort.
    #[must_use]
    pub fn of(folder: &Path, run_dir: Option<&Path>) -> Self {
        let folder = cohort_folder(folder);
        let is_run = folder.join(DATABASE).exists() && !folder.join(COHORT).exists();
        match run_dir {
            Some(run) => Self {
                cohort: Some(folder.to_owned()),
                run: run.to_owned(),
            },
            None if is_run => Self {
                cohort: None,
                run: folder.to_owned(),
            },
            // In messages, `run/…` reads better than `./run/…`.
            None if folder == Path::new(".") => Self {
                cohort: Some(folder.to_owned()),
                run: PathBuf::from("run"),
            },
            None => Self {
                cohort: Some(folder.to_owned()),
                run: folder.join("run"),
            },
        }
    }

    /// Takes the cohort in whose folder the run lies, or else the one that the run remembers, where
    /// only the run was named and that folder is a cohort.
    ///
    /// # Errors
    /// Errors of the store.
    pub async fn find_cohort(&mut self) -> Result<(), CliError> {
        if self.cohort.is_none() {
            let run = std::path::absolute(&self.run).unwrap_or_else(|_| self.run.clone());
            let around = run.parent().filter(|folder| is_cohort(folder));
            let reader = Reader::open(&self.run).await?;
            let remembered = reader.cohort_dir().await?;
            // A relative path was one of another call's directory.
            let cohort = match (reader.moved_cohort().await?, around) {
                (Some(moved), _) => moved.is,
                (None, Some(folder)) if remembered.is_relative() => folder.to_owned(),
                _ => remembered,
            };
            self.cohort = is_cohort(&cohort).then_some(cohort);
        }
        Ok(())
    }

    /// The command that continues this run.
    #[must_use]
    pub fn run_command(&self) -> String {
        match folder::find(&self.run) {
            Ok(Some(file)) => format!(
                "`cardiotwin sweep {} --out {}`",
                file.sweep.kind(),
                self.run.display()
            ),
            _ => format!("`cardiotwin run{}`", self.as_argument("")),
        }
    }

    /// Refuses the folder of a sweep for a command that needs the run of a cohort.
    ///
    /// # Errors
    /// [`CliError::Usage`] with `instead`, the command to use in its place.
    pub fn refuse_sweep(&self, instead: &str) -> Result<(), CliError> {
        if folder::find(&self.run)?.is_none() {
            return Ok(());
        }
        let folder = self.run.display();
        Err(CliError::Usage(format!(
            "{folder} is a sweep, not the run of a cohort: {}",
            instead.replace("DIR", &folder.to_string())
        )))
    }

    /// These folders as an argument of another command, such as ` my-cohort`; empty for the current
    /// directory.
    #[must_use]
    pub fn as_argument(&self, option: &str) -> String {
        let folder = self.cohort.as_ref().unwrap_or(&self.run);
        let mut text = String::new();
        if folder != Path::new(".") {
            text = format!(" {option}{}", folder.display());
        }
        if let Some(cohort) = &self.cohort
            && self.run != Self::of(cohort, None).run
        {
            text.push_str(&format!(" --run-dir {}", self.run.display()));
        }
        text
    }
}

impl Place {
    /// Folders for these arguments.
    #[must_use]
    pub fn folders(&self) -> Folders {
        let folder = self.cohort.as_deref().unwrap_or(&self.folder);
        Folders::of(folder, self.run_dir.as_deref())
    }
}

impl OfCohort {
    /// Folders for these arguments.
    #[must_use]
    pub fn folders(&self) -> Folders {
        Folders::of(&self.cohort, self.run_dir.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_a_cohort_or_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let cohort = folder.path().join("c");
        std::fs::create_dir_all(cohort.join("run")).unwrap();
        std::fs::write(cohort.join("run/cardiotwin.db"), "").unwrap();
        let of_cohort = Folders::of(&cohort, None);
        assert_eq!(
            of_cohort,
            Folders {
                cohort: Some(cohort.clone()),
                run: cohort.join("run")
            }
        );
        std::fs::write(cohort.join("cohort.toml"), "").unwrap();
        let file = cohort.join("cohort.toml");
        assert_eq!(Folders::of(&file, None), of_cohort, "named by its file");
        let of_run = Folders::of(&cohort.join("run"), None);
        assert_eq!(
            of_run,
            Folders {
                cohort: None,
                run: cohort.join("run")
            }
        );
        let elsewhere = Folders::of(&cohort, Some(Path::new("/x")));
        assert_eq!(
            elsewhere.as_argument(""),
            format!(" {} --run-dir /x", cohort.display())
        );
        assert_eq!(
            Folders::of(Path::new("."), None).as_argument("--cohort "),
            ""
        );
    }
}
