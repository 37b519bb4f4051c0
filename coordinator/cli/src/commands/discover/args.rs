//! Arguments of `cardiotwin discover`.

use std::path::PathBuf;

use cardiotwin_input::{nearest, patients_of};
use clap::Args;

use crate::error::CliError;
use crate::place::cohort_folder;

/// Find and name effects that the model lacks in measured traces, and show how they reduce the
/// misfit
///
/// Fits the reduced ventricle to pressure and volume, locates the misfit, tries every effect of the
/// catalogue, and names an effect only if the data prefer it by more than chance.
/// docs/missing-effects.md explains the method and its limits.
#[derive(Debug, Args)]
#[command(
    after_help = "The same command continues an interrupted search. The next search in the same folder goes on with \
                  --effects, --seed and --mesh-nodes. Ctrl-C works as in `run`."
)]
pub struct DiscoverArgs {
    /// Folder of a patient (with patient.toml) or of a cohort (with cohort.toml), or with --cohort the
    /// name of a patient
    #[arg(value_name = "PATIENT|COHORT", default_value = ".")]
    folder: PathBuf,
    /// Folder of the cohort (with cohort.toml) whose patient is named
    #[arg(long, value_name = "DIR", conflicts_with = "afterload")]
    cohort: Option<PathBuf>,
    /// Search all patients of the cohort, which is the default for a cohort
    #[arg(long)]
    pub(super) all: bool,
    /// Search only this patient of the cohort (may be given several times)
    #[arg(long = "patient", value_name = "PATIENT", conflicts_with = "all")]
    pub(super) patients: Vec<String>,
    /// Search no patient of the cohort if any has an error in its files
    #[arg(long)]
    pub(super) strict: bool,
    /// Write the found effects into the patient's model.toml, which the next `cardiotwin run` uses
    #[arg(long, conflicts_with = "revert")]
    pub(super) accept: bool,
    /// With --accept: also write effects that held-out data do not confirm
    #[arg(long, requires = "accept")]
    pub(super) unconfirmed: bool,
    /// Undo the last --accept without a search
    #[arg(long)]
    pub(super) revert: bool,
    /// Simulate the finite-element ventricle without and with the named effects, and show the gap of
    /// both, whether or not they are accepted
    #[arg(long, conflicts_with_all = ["revert", "afterload"])]
    pub(super) in_3d: bool,
    /// Approximate number of nodes of the finite-element mesh [default: the setting
    /// solver.finite_element.mesh_nodes]
    #[arg(long, value_name = "N", requires = "in_3d")]
    pub(super) mesh_nodes: Option<u32>,
    /// Names of the candidate effects to try [default: the whole catalogue]
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',')]
    pub(super) effects: Vec<String>,
    /// Seed of the bootstrap [default: 1]
    #[arg(long, value_name = "SEED")]
    pub(super) seed: Option<u64>,
    /// Drop `effects`, `seed`, `mesh-nodes` or `all` from the saved options of the searches (may be
    /// given several times)
    #[arg(long, value_name = "NAME")]
    pub(super) unset: Vec<String>,
    /// Redo finished searches without a question where options have changed
    #[arg(long)]
    pub(super) yes: bool,
    /// Number of cores to use; 0 is all
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) jobs: u32,
    /// Write the findings as JSON to a file, or to stdout if no file is named
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub(super) json: Option<PathBuf>,
    /// Search a measured aortic flow and pressure for effects that a three-element Windkessel lacks
    #[arg(long, value_names = ["FLOW.csv", "PRESSURE.csv"], num_args = 2, conflicts_with_all = ["all", "patients", "run_dir", "worker", "accept", "revert"])]
    pub(super) afterload: Option<Vec<PathBuf>>,
    /// With --afterload: accept what a rule of consistency reports, by its name: aortic-mean-flow or
    /// aortic-mean-pressure (may be given several times)
    #[arg(long, value_name = "RULE", requires = "afterload")]
    pub(super) accept_rule: Vec<String>,
    /// Draw the traces (measured, before and after) of one patient or afterload into an SVG file
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<PathBuf>,
    /// Open the report of the search in the desktop's viewer
    #[arg(long, conflicts_with_all = ["revert", "afterload"])]
    pub(super) open: bool,
    /// Folder of the searches [default: discover in the searched folder]
    #[arg(long, value_name = "DIR")]
    pub(super) run_dir: Option<PathBuf>,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    pub(super) worker: Option<PathBuf>,
}

impl DiscoverArgs {
    /// Folder of the patient or of the cohort.
    ///
    /// # Errors
    /// [`CliError::Usage`] if the cohort has no patient of this name.
    pub(super) fn folder(&self) -> Result<PathBuf, CliError> {
        let named = self.folder.to_string_lossy();
        let Some(cohort) = self.cohort.as_deref() else {
            return Ok(cohort_folder(&self.folder).to_owned());
        };
        let cohort = cohort_folder(cohort);
        if named == "." {
            return Ok(cohort.to_owned());
        }
        let patients = patients_of(cohort);
        if let Some((_, folder)) = patients.iter().find(|(name, _)| *name == named) {
            return Ok(folder.clone());
        }
        let meant = nearest(&named, patients.iter().map(|(name, _)| name.as_str()))
            .map(|meant| format!("; did you mean `{meant}`?"));
        Err(CliError::Usage(format!(
            "{} has no patient `{named}`{}",
            cohort.display(),
            meant.unwrap_or_default()
        )))
    }
}
