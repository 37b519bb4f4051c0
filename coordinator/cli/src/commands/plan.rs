//! `cardiotwin plan`: jobs that a run on a cluster would submit.

use std::path::PathBuf;

use cardiotwin_engine::{self as engine, PlannedRun};
use clap::Args;

use super::run::load_for_cluster;
use crate::access;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::table::{Columns, duration};
use crate::talk::{Talk, count};

/// Show the jobs that a run on a cluster would submit, their cost and likely end, without
/// submitting
#[derive(Debug, Args)]
pub struct PlanArgs {
    #[command(flatten)]
    place: Place,
    /// Set KEY to VALUE, overriding all files (may be given several times)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print the batch scripts instead, exact except for names, which are made at submission
    #[arg(long)]
    script: bool,
    /// Print one JSON object instead of the table
    #[arg(long, conflicts_with = "script")]
    json: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH", hide = true)]
    worker: Option<PathBuf>,
}

/// Prints the planned jobs or their batch scripts.
///
/// # Errors
/// The same as for `run`.
pub async fn execute(args: &PlanArgs, talk: &Talk) -> Result<Exit, CliError> {
    let mut folders = args.place.folders();
    folders.find_cohort().await?;
    let options = load_for_cluster(
        &folders,
        &args.set,
        false,
        args.worker.as_deref(),
        true,
        talk,
    )
    .await?;
    access::check_name(&options.executor, &options.run_dir)?;
    let program = std::env::current_exe().map_err(CliError::file("find", "this program"))?;
    let plan = engine::preview(&options, &program).await?;
    if args.json {
        talk.json(&plan)?;
    } else if args.script {
        plan.jobs
            .iter()
            .try_for_each(|job| talk.data(&format!("{}\n", job.script)))?;
    } else {
        talk.data(&table(&plan, talk))?;
        if let Some(said) = crate::slurm_variables::without_effect() {
            talk.say(&said);
        }
    }
    Ok(Exit::Ok)
}

fn table(plan: &PlannedRun, talk: &Talk) -> String {
    let mut table = Columns::new(
        talk,
        &[
            "QUEUE",
            ">JOBS",
            ">NODES",
            ">CORES",
            ">WALLTIME",
            ">EXPECTED",
            ">PATIENTS",
            ">NODE-HOURS",
            "WHEN",
        ],
    );
    for job in &plan.jobs {
        let at_once = job
            .at_once
            .map(|n| format!(" ({n} at once)"))
            .unwrap_or_default();
        table.row([
            job.queue.clone(),
            format!("{}{at_once}", job.elements),
            job.nodes.to_string(),
            job.cores.to_string(),
            duration(job.walltime_s as f64),
            duration(job.predicted_s),
            job.patients.to_string(),
            format!("{:.3}", job.node_hours),
            if job.now { "now" } else { "later" }.to_owned(),
        ]);
    }
    let mut text = table.text();
    let jobs: usize = plan.jobs.iter().map(|job| job.elements).sum();
    let charge = if plan.charge > 0.0 {
        format!(" ({:.2} {})", plan.charge, plan.charge_unit)
    } else {
        String::new()
    };
    if jobs == 0 {
        text = format!("{}: nothing to submit\n", plan.site);
    } else {
        text.push_str(&format!(
            "{}: {}, {:.3} node-hours{charge}; finished {} after the first job begins, if the \
             queue runs as many jobs as its limits allow\n",
            plan.site,
            count(jobs, "job"),
            plan.node_hours,
            duration(plan.finish_after_s),
        ));
    }
    text.push_str(&format!("{}\n", plan.disk.words()));
    if plan.others > 0 {
        text.push_str(&format!(
            "{} finished, already in jobs, or waiting for another patient's task\n",
            count(plan.others, "patient")
        ));
    }
    plan.remarks
        .iter()
        .for_each(|remark| text.push_str(&format!("{remark}\n")));
    text
}
