//! `cardiotwin doctor`: whether this machine, file system and site can run cohorts.

mod disk;
mod finding;
mod machine;
mod programs;

use std::path::PathBuf;

use cardiotwin_engine as engine;
use cardiotwin_input::{self as input, Options, Report};
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings, SlurmSettings};
use clap::Args;
use serde::Serialize;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::{Folders, Place};
use crate::table::Columns;
use crate::talk::{Talk, Tone, count};
use finding::{Finding, Level};

/// Check whether this machine, file system and site can run cohorts, and show remedies
#[derive(Debug, Args)]
#[command(after_help = "Exits with 1 if something would make runs fail.")]
pub struct DoctorArgs {
    #[command(flatten)]
    place: Place,
    /// Check the cluster of this site profile, too: generic, archer2, laptop, levante, lumi, roihu, or a file
    /// [default: the cohort's, if its tasks run on Slurm]
    #[arg(long, value_name = "NAME")]
    site: Option<String>,
    /// Account that the cluster's jobs are charged to [default: the cohort's]
    #[arg(long, value_name = "NAME")]
    account: Option<String>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    version: &'static str,
    findings: &'a [Finding],
}

/// Runs all checks and prints their findings.
///
/// # Errors
/// Stdout cannot be written.
pub async fn execute(args: &DoctorArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let mut findings = machine::look();
    findings.extend(programs::look(args.worker.as_deref()));
    findings.extend(disk::look(&folders.run).await);
    let executor = executor_of(&folders);
    if let Some(scratch) = scratch_of(&folders, executor.as_ref()) {
        findings.extend(disk::look(&scratch).await);
    }
    findings.extend(cluster(args, executor.as_ref()).await);
    let worst = findings
        .iter()
        .filter(|finding| finding.level == Level::Error)
        .count();
    if args.json {
        let version = env!("CARGO_PKG_VERSION");
        talk.json(&Answer {
            schema_version: cardiotwin_schemas::formats::DOCTOR.version,
            version,
            findings: &findings,
        })?;
    } else {
        talk.data(&table(&findings, talk))?;
        let doubtful = findings
            .iter()
            .filter(|finding| finding.level == Level::Warning)
            .count();
        talk.say(&format!(
            "{}, {}",
            count(worst, "error"),
            count(doubtful, "warning")
        ));
    }
    Ok(if worst > 0 { Exit::Problems } else { Exit::Ok })
}

/// Where the cohort's tasks run, if a cohort was named and can be read.
fn executor_of(folders: &Folders) -> Option<ExecutorSettings> {
    let cohort = folders
        .cohort
        .as_ref()
        .filter(|cohort| cohort.join("cohort.toml").is_file())?;
    let cohort = input::load(cohort, &Options::default(), &mut Report::default())?;
    Some(cohort.settings.settings.executor.clone())
}

/// Folder of the attempts, if it is not in the run's folder.
fn scratch_of(folders: &Folders, executor: Option<&ExecutorSettings>) -> Option<PathBuf> {
    std::fs::read_link(folders.run.join(engine::ATTEMPTS))
        .ok()
        .or_else(|| executor?.scratch.clone())
}

fn table(findings: &[Finding], talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["CHECK", "RESULT", "FOUND"]);
    for finding in findings {
        let tone = match finding.level {
            Level::Ok => Tone::Good,
            Level::Note => Tone::Quiet,
            Level::Warning => Tone::Doubtful,
            Level::Error => Tone::Bad,
        };
        let result = (finding.level.as_str().to_owned(), Some(tone));
        table.toned([
            (finding.check.to_owned(), None),
            result,
            (finding.found.clone(), None),
        ]);
        if !finding.remedy.is_empty() {
            table.row(["", "", &format!("→ {}", finding.remedy)]);
        }
    }
    table.text()
}

/// Checks Slurm: the site's profile, and Slurm's own answers.
async fn cluster(args: &DoctorArgs, executor: Option<&ExecutorSettings>) -> Vec<Finding> {
    let of_cohort = executor.filter(|executor| executor.kind == ExecutorKind::Slurm);
    if args.site.is_none() && of_cohort.is_none() {
        let remedy = "--site NAME checks the cluster of that profile";
        return vec![Finding::bad("cluster", Level::Note, "not checked", remedy)];
    }
    let mut settings =
        of_cohort.map_or_else(SlurmSettings::default, |executor| executor.slurm.clone());
    if let Some(site) = &args.site {
        site.clone_into(&mut settings.site);
    }
    if let Some(account) = &args.account {
        settings.account = Some(account.clone());
    }
    let told = match engine::examine_site(&settings).await {
        Ok(told) => told,
        Err(error) => {
            let level = if settings.site == "laptop" {
                Level::Note
            } else {
                Level::Error
            };
            return vec![Finding::bad(
                "cluster",
                level,
                error.to_string(),
                "correct the profile or the option",
            )];
        }
    };
    let mut found = vec![];
    if let Some(said) = crate::slurm_variables::without_effect() {
        let remedy = "write them into [executor.slurm], where every submission has them";
        found.push(Finding::bad("Slurm's variables", Level::Note, said, remedy));
    }
    if let Some(silent) = told.silent {
        let remedy = "load Slurm's module, or run this command on a login node; the limits below are only \
             those of the profile";
        found.push(Finding::bad("Slurm", Level::Error, silent, remedy));
    } else {
        found.push(Finding::ok("Slurm", told.version));
    }
    found.extend(
        told.remarks
            .into_iter()
            .map(|remark| Finding::ok("Slurm's limits", remark)),
    );
    for queue in told.queues {
        let line = format!("{}: {}", queue.name, queue.limits);
        found.push(match queue.missing {
            None => Finding::ok("queue", line),
            Some(missing) => Finding::bad(
                "queue",
                Level::Warning,
                format!("{line}; {missing}"),
                "correct [[queue]] of the profile",
            ),
        });
    }
    found
}
