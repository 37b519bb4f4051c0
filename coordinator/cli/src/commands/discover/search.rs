//! Execution of the searches through the engine, unless an earlier run holds their results.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_engine::{Reader, RunOptions};
use cardiotwin_schemas::discover::{DiscoverCases, Discovered};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_sweep::discovery;

use super::args::DiscoverArgs;
use super::choice::Choice;
use super::source::{Searched, Source};
use crate::commands::sweep::drive;
use crate::error::CliError;
use crate::talk::Talk;

/// Outcome of the searches.
pub struct Ended {
    /// Folder that holds the searches.
    pub run_dir: PathBuf,
    /// Findings of the searches, by pseudonym of the patient.
    pub cases: DiscoverCases,
    /// Patients whose search failed, each with the message.
    pub failures: Vec<(String, String)>,
    /// Whether the run was stopped before its end.
    pub stopped: bool,
}

/// Runs the searches that earlier runs do not hold.
///
/// # Errors
/// Errors of the engine and the store.
pub async fn run(
    args: &DiscoverArgs,
    source: &Source,
    choice: &Choice,
    talk: &Talk,
) -> Result<Ended, CliError> {
    let run_dir = source.run_dir(args.run_dir.as_deref(), talk);
    if let Some(cases) = known(source, &run_dir).await? {
        return Ok(Ended {
            run_dir,
            cases,
            failures: Vec::new(),
            stopped: false,
        });
    }
    let members: Vec<ResolvedPatient> = source.patients.iter().map(member).collect();
    choice.ask(&run_dir, &members, (args.yes, talk)).await?;
    let options = RunOptions {
        run_dir: run_dir.clone(),
        chosen: Some(choice.chosen()),
        cohort_name: source.name.clone(),
        description: "search for missing effects".to_owned(),
        cohort_dir: source.folder.clone(),
        patients: Some(members),
        refused: source.refused.clone(),
        recognised: Default::default(),
        only: Vec::new(),
        executor: executor(args.jobs, source.patients.len()),
        worker: args.worker.clone(),
        adopt_version: true,
        watch: false,
    };
    let summary = drive(options, "patients", talk).await?;
    let mut ended = Ended {
        run_dir,
        cases: BTreeMap::new(),
        failures: Vec::new(),
        stopped: summary.stopped,
    };
    for member in Reader::open(&ended.run_dir).await?.members().await? {
        let patient = member.plan.id.to_string();
        match (member.task, member.failure) {
            (Some(task), _) => {
                if let TaskResult::Discover(found) = &task.result {
                    ended.cases.insert(
                        patient.clone(),
                        discovery::case(&patient, task.key.as_str(), found),
                    );
                }
            }
            (None, Some(failure)) => {
                let remedy = failure
                    .remedy
                    .map_or(String::new(), |remedy| format!(" ({remedy})"));
                ended
                    .failures
                    .push((patient, format!("{}{remedy}", failure.message)));
            }
            (None, None) => {}
        }
    }
    Ok(ended)
}

fn member(searched: &Searched) -> ResolvedPatient {
    let workflow = Workflow::Task {
        task: Box::new(searched.task.clone()),
    };
    ResolvedPatient::without_data(PatientId(searched.patient.id.clone()), workflow)
}

/// Searches as many patients at once as there are cores; cores left over become threads of each
/// search.
pub(super) fn executor(jobs: u32, n_patients: usize) -> ExecutorSettings {
    let cores = match jobs {
        0 => std::thread::available_parallelism().map_or(1, std::num::NonZero::get) as u32,
        n => n,
    };
    let workers = cores
        .min(u32::try_from(n_patients).unwrap_or(u32::MAX))
        .max(1);
    ExecutorSettings {
        workers,
        threads: cores.div_ceil(workers),
        ..ExecutorSettings::default()
    }
}

/// The findings, if one earlier run holds all of them: the run in `run_dir`, or the run of the
/// patient's cohort.
async fn known(source: &Source, run_dir: &Path) -> Result<Option<DiscoverCases>, CliError> {
    let cohort = source
        .cohort
        .as_ref()
        .map(|cohort| cohort.join(discovery::FOLDER));
    for folder in std::iter::once(run_dir.to_owned()).chain(cohort) {
        if !folder.join("cardiotwin.db").exists() {
            continue;
        }
        let members = Reader::open(&folder).await?.members().await?;
        let find = |searched: &Searched| -> Option<(String, Box<Discovered>)> {
            let task = members
                .iter()
                .filter_map(|m| m.task.as_ref())
                .find(|task| task.key == searched.key)?;
            let TaskResult::Discover(found) = &task.result else {
                return None;
            };
            Some((searched.patient.id.clone(), found.clone()))
        };
        if let Some(all) = source.patients.iter().map(find).collect::<Option<Vec<_>>>() {
            let case = |searched: &Searched, found: &Discovered| {
                (
                    searched.patient.id.clone(),
                    discovery::case(&searched.patient.id, searched.key.as_str(), found),
                )
            };
            return Ok(Some(
                std::iter::zip(&source.patients, &all)
                    .map(|(s, (_, found))| case(s, found))
                    .collect(),
            ));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_go_to_patients_first_and_then_to_threads() {
        let of = |jobs, n| {
            let settings = executor(jobs, n);
            (settings.workers, settings.threads)
        };
        assert_eq!(
            [of(2, 1), of(2, 7), of(8, 3), of(1, 5)],
            [(1, 2), (2, 1), (3, 3), (1, 1)]
        );
    }
}
