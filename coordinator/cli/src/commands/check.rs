//! `cardiotwin check`: all errors of the input that can be found before anything runs.

use std::collections::BTreeMap;

use cardiotwin_engine::{EngineError, load_site, without_queue};
use cardiotwin_input::{self as input, Cohort, Finding, Options, Report};
use cardiotwin_schemas::settings::ExecutorKind;
use clap::Args;
use serde::Serialize;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::problems;
use crate::talk::{Talk, count};

/// Check cohort, patients, settings, measured data and patients' own meshes, and list all problems
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    place: Place,
    /// Check only this patient (may be given several times)
    #[arg(long = "patient", value_name = "PATIENT")]
    patients: Vec<String>,
    /// Set KEY to VALUE, overriding all files, as in `run`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Exit with 1 for warnings, too
    #[arg(long)]
    strict: bool,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    cohort: Option<&'a str>,
    patients: usize,
    errors: usize,
    warnings: usize,
    problems: &'a [Finding],
    /// Keys of patients' files that are estimated, each with the patients whose files lack them.
    estimated: &'a Estimated<'a>,
}

/// Keys with the patients whose files lack them.
type Estimated<'a> = BTreeMap<&'static str, Vec<&'a str>>;

/// Most patients that are named for an estimated key.
const MOST_NAMED: usize = 8;

/// Checks the cohort. Problems count as data and go to stdout.
///
/// # Errors
/// Stdout cannot be written.
pub fn execute(args: &CheckArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let cohort_dir = folders.cohort.unwrap_or(folders.run);
    let mut report = Report::default();
    let options = Options {
        only: args.patients.clone(),
        set: args.set.clone(),
        meshes: true,
        ..Options::default()
    };
    let cohort = input::load(&cohort_dir, &options, &mut report);
    if let Some(cohort) = &cohort {
        queues(cohort, &mut report);
    }
    let (errors, warnings) = (report.n_errors(), report.n_warnings());
    let n_patients = cohort.as_ref().map_or(0, |cohort| cohort.patients.len());
    let estimated = cohort.as_ref().map(estimated).unwrap_or_default();
    if args.json {
        let findings = problems::in_order(&report);
        talk.json(&Answer {
            schema_version: cardiotwin_schemas::formats::CHECK.version,
            cohort: cohort.as_ref().map(|cohort| cohort.name.as_str()),
            patients: n_patients,
            errors,
            warnings,
            problems: &findings,
            estimated: &estimated,
        })?;
    } else {
        talk.data(&problems::text(&report, talk.colour_out, true))?;
        talk.data(&in_words(&estimated, n_patients))?;
        let name = cohort
            .as_ref()
            .map_or("the cohort", |cohort| cohort.name.as_str());
        if errors + warnings == 0 {
            talk.data(&format!(
                "{name}: {}, no problems\n",
                count(n_patients, "patient")
            ))?;
        } else {
            let (errors, warnings) = (count(errors, "error"), count(warnings, "warning"));
            talk.data(&format!(
                "{name}: {}, {errors}, {warnings}\n",
                count(n_patients, "patient")
            ))?;
        }
    }
    Ok(if errors > 0 || (args.strict && warnings > 0) {
        Exit::Problems
    } else {
        Exit::Ok
    })
}

/// What step 0 estimates because the patients' files lack it.
fn estimated(cohort: &Cohort) -> Estimated<'_> {
    let mut keys = Estimated::new();
    for patient in &cohort.patients {
        let Some(plan) = &patient.resolved else {
            continue;
        };
        let spec = plan.step0_spec();
        for (key, is_estimated) in [
            (
                "anatomy.wall_volume_mL",
                spec.wall_volume_ml.is_none() && spec.own_mesh.is_none(),
            ),
            ("afterload", spec.afterload.is_none()),
            (
                "preload.left_atrial_pressure_mmHg",
                spec.left_atrial_pressure_mmhg.is_none(),
            ),
        ] {
            if is_estimated {
                keys.entry(key).or_default().push(&patient.id);
            }
        }
    }
    keys
}

/// A line for each estimated key, with the patients as far as they are few.
fn in_words(estimated: &Estimated<'_>, n_patients: usize) -> String {
    let line = |(key, patients): (&&str, &Vec<&str>)| {
        let whose = if patients.len() > MOST_NAMED {
            format!("{} of {}", patients.len(), count(n_patients, "patient"))
        } else {
            patients.join(", ")
        };
        format!("estimated, as no file states it: {key} ({whose})\n")
    };
    estimated.iter().map(line).collect()
}

/// Reports threads or ranks that no queue of the site gives.
fn queues(cohort: &Cohort, report: &mut Report) {
    let executor = &cohort.settings.settings.executor;
    if executor.kind != ExecutorKind::Slurm {
        return;
    }
    let site = match load_site(&executor.slurm) {
        Ok(site) => site,
        Err(error) => {
            let (key, expected, remedy) = match error {
                EngineError::NoAccount { .. } => (
                    "executor.slurm.account",
                    "the account that is charged",
                    "set it; `sacctmgr show assoc user=$USER` lists yours",
                ),
                _ => (
                    "executor.slurm.site",
                    "a site with a profile",
                    "correct the profile, or name another site",
                ),
            };
            let error = error.to_string();
            report.add(
                None,
                cohort
                    .settings
                    .problem(key, None, [&error, expected, remedy]),
            );
            return;
        }
    };
    let plans = cohort.patients.iter().filter_map(|p| p.resolved.as_ref());
    if let Some(no_queue) = without_queue(plans, &site, executor) {
        let said = [&*no_queue.found, &no_queue.expected, no_queue.remedy];
        report.add(None, cohort.settings.problem(no_queue.key, None, said));
    }
}
