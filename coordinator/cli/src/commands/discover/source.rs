//! Source of a search: a patient's folder, in a cohort or alone, or a cohort.

use std::path::{Path, PathBuf};

use cardiotwin_input::{self as input, Options, Patient, Report};
use cardiotwin_schemas::discover::DiscoverSpec;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::status::RefusedPatient;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_sweep::discovery::FOLDER;

use super::args::DiscoverArgs;
use super::choice::Choice;
use crate::error::CliError;
use crate::problems;
use crate::talk::{Talk, count};

/// Patients to search, with their tasks.
pub struct Source {
    /// Name of the cohort, or id of the patient.
    pub name: String,
    /// Folder named on the command line.
    pub folder: PathBuf,
    /// Folder of the cohort that holds a single patient; `None` if there is none or a cohort was
    /// named.
    pub cohort: Option<PathBuf>,
    /// Patients to search, in the cohort's order.
    pub patients: Vec<Searched>,
    /// Patients of a cohort that have errors in their files.
    pub refused: Vec<RefusedPatient>,
    one: bool,
}

/// A patient with the task that searches it.
pub struct Searched {
    /// The patient as read from its folder.
    pub patient: Patient,
    /// Task of the search.
    pub task: TaskSpec,
    /// Key of `task`, by which an earlier run's result is found.
    pub key: TaskKey,
}

impl Source {
    /// Reads the folder that the arguments name.
    ///
    /// # Errors
    /// [`CliError::Usage`] if it holds neither a patient nor a cohort; [`CliError::Input`] if the
    /// patient or `cohort.toml` has errors, if no patient of a cohort is free of them, or, with
    /// `--strict`, if any patient has one.
    pub fn read(args: &DiscoverArgs, choice: &Choice, talk: &Talk) -> Result<Self, CliError> {
        let folder = &args.folder()?;
        let mut report = Report::default();
        let is = |name: &str| folder.join(name).is_file();
        let (name, patients, one) = match (is("cohort.toml"), is("patient.toml")) {
            (true, _) => {
                let options = Options {
                    only: args.patients.clone(),
                    unaccepted: true,
                    ..Options::default()
                };
                let cohort = input::load(folder, &options, &mut report);
                cohort.map_or((String::new(), Vec::new(), false), |cohort| {
                    (cohort.name, cohort.patients, false)
                })
            }
            (false, true) => {
                if args.all || !args.patients.is_empty() {
                    let message = format!(
                        "{} is a patient, but --all and --patient need a cohort",
                        folder.display()
                    );
                    return Err(CliError::Usage(message));
                }
                let patient = match cohort_of(folder).filter(|_| args.in_3d) {
                    Some(cohort) => in_cohort(&cohort, folder, &mut report),
                    None => input::load_alone(folder, &mut report),
                };
                (
                    patient.as_ref().map_or(String::new(), |p| p.id.clone()),
                    patient.into_iter().collect(),
                    true,
                )
            }
            (false, false) => {
                let message = format!(
                    "{} holds neither patient.toml nor cohort.toml: name the folder of a patient or of a cohort",
                    folder.display()
                );
                return Err(CliError::Usage(message));
            }
        };
        let mut patients: Vec<Searched> = patients
            .into_iter()
            .filter_map(|patient| searched(patient, choice, &mut report))
            .collect();
        problems::say(&report, talk);
        let refused = problems::refused(&report);
        patients.retain(|searched| !report.has_error_of(&searched.patient.id));
        let must_be_sound = one || args.strict || report.has_error_of_cohort();
        if report.n_errors() > 0 && (must_be_sound || patients.is_empty()) {
            return Err(CliError::Input {
                errors: count(report.n_errors(), "error"),
            });
        }
        let cohort = one.then(|| cohort_of(folder)).flatten();
        Ok(Self {
            name,
            folder: folder.clone(),
            cohort,
            patients,
            refused,
            one,
        })
    }

    /// Whether the folder named on the command line is a cohort.
    #[must_use]
    pub fn is_cohort(&self) -> bool {
        !self.one
    }

    /// Folder of the cohort that was named, or of the cohort that holds the patient.
    #[must_use]
    pub fn cohort_folder(&self) -> Option<&Path> {
        if self.one {
            self.cohort.as_deref()
        } else {
            Some(&self.folder)
        }
    }

    /// Folder in which the searches are kept: the named one; otherwise a folder inside the searched
    /// one; or, if that cannot be written, one in the current directory.
    #[must_use]
    pub fn run_dir(&self, named: Option<&Path>, talk: &Talk) -> PathBuf {
        if let Some(named) = named {
            return named.to_owned();
        }
        let beside = self.folder.join(FOLDER);
        if is_writable(&self.folder) && std::fs::create_dir_all(&beside).is_ok() {
            return beside;
        }
        let here = Path::new(FOLDER).join(&self.name);
        talk.say(&format!(
            "{} is not writable: the search is stored in {}",
            beside.display(),
            here.display()
        ));
        here
    }
}

/// Whether a file can be made in the folder. A folder that is marked read-only counts as not
/// writable even for the superuser, who could write to it.
fn is_writable(folder: &Path) -> bool {
    let marked = std::fs::metadata(folder).is_ok_and(|data| data.permissions().readonly());
    !marked && tempfile::tempfile_in(folder).is_ok()
}

/// The cohort whose patients' folder holds this one, if there is a `cohort.toml`.
fn cohort_of(folder: &Path) -> Option<PathBuf> {
    let absolute = std::path::absolute(folder).ok()?;
    let cohort = absolute.parent()?.parent()?;
    cohort
        .join("cohort.toml")
        .is_file()
        .then(|| cohort.to_owned())
}

/// The patient with the settings of its cohort, by which its ventricle is simulated.
fn in_cohort(cohort: &Path, folder: &Path, report: &mut Report) -> Option<Patient> {
    let absolute = std::path::absolute(folder).ok()?;
    let options = Options {
        only: vec![absolute.file_name()?.to_string_lossy().into_owned()],
        unaccepted: true,
        ..Options::default()
    };
    input::load(cohort, &options, report)?.patients.pop()
}

fn searched(patient: Patient, choice: &Choice, report: &mut Report) -> Option<Searched> {
    let spec: DiscoverSpec = input::specification(&patient, &choice.effects, choice.seed, report)?;
    let task = TaskSpec::Discover(Box::new(spec));
    let key = task.key();
    Some(Searched { patient, task, key })
}
