//! `cardiotwin config show`: every setting and its origin.

use std::path::Path;

use cardiotwin_input::{self as input, COMMAND_LINE, Finding, Merged, Options, Origin, Report};
use clap::{Args, Subcommand};
use serde::Serialize;
use serde_json::Value;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::store::stored_overrides;
use crate::table::Columns;
use crate::talk::{Talk, Tone};
use crate::{kept, problems, talk::count};

/// Show settings
#[derive(Debug, Args)]
pub struct ConfigArgs {
    #[command(subcommand)]
    command: ConfigCommand,
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    Show(ShowArgs),
}

/// Show the value of every setting after all layers
#[derive(Debug, Args)]
struct ShowArgs {
    #[command(flatten)]
    place: Place,
    /// Show the origin of each value: default, file and line, kept option, rerun, or --set
    #[arg(long)]
    origin: bool,
    /// Show the settings of this patient, including its own layer and those that `rerun` stored
    #[arg(long, value_name = "PATIENT")]
    patient: Option<String>,
    /// Set KEY to VALUE, overriding all files, as in `run`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Leaf {
    key: String,
    value: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    origin: Option<Origin>,
}

/// Prints the settings on stdout. Problems of the files go to stderr and make the exit code 3.
///
/// # Errors
/// [`CliError::Input`] if the settings cannot be read.
pub async fn execute(args: &ConfigArgs, talk: &Talk) -> Result<Exit, CliError> {
    let ConfigCommand::Show(args) = &args.command;
    let folders = args.place.folders();
    let overrides = match &args.patient {
        Some(patient) => stored_overrides(&folders.run, patient).await?,
        None => Default::default(),
    };
    let kept = kept::assignments(&folders.run).await?;
    let cohort_dir = folders.cohort.unwrap_or(folders.run);
    let only: Vec<String> = args.patient.iter().cloned().collect();
    let mut report = Report::default();
    let options = Options {
        only,
        overrides,
        kept,
        set: args.set.clone(),
        ..Options::default()
    };
    let cohort = input::load(&cohort_dir, &options, &mut report);
    problems::say(&report, talk);
    // The settings of a mistyped `--set` are not those that were asked for.
    let of_set = |finding: &Finding| finding.problem.file == Path::new(COMMAND_LINE);
    if report.findings().iter().any(of_set) {
        return Err(CliError::Input {
            errors: count(report.n_errors(), "error"),
        });
    }
    let merged: Option<&Merged> = cohort.as_ref().and_then(|cohort| match &args.patient {
        Some(_) => cohort.patients.first().map(|patient| &*patient.settings),
        None => Some(&cohort.settings),
    });
    let Some(merged) = merged else {
        return Err(CliError::Input {
            errors: count(report.n_errors(), "error"),
        });
    };
    let leaves = merged
        .leaves()
        .into_iter()
        .map(|(key, value, origin)| Leaf {
            key,
            value,
            origin: args.origin.then_some(origin),
        });
    if args.json {
        talk.json(&leaves.collect::<Vec<_>>())?;
    } else {
        let headings: &[&str] = if args.origin {
            &["KEY", "ORIGIN", "VALUE"]
        } else {
            &["KEY", "VALUE"]
        };
        let mut table = Columns::new(talk, headings);
        for Leaf { key, value, origin } in leaves {
            let tone = (origin == Some(Origin::Default)).then_some(Tone::Quiet);
            // Values come last because lists of parameters are long.
            let mut row = vec![(key, None)];
            row.extend(origin.map(|origin| (origin.to_string(), tone)));
            row.push((value.to_string(), None));
            table.toned(row);
        }
        talk.data(&table.text())?;
    }
    Ok(if report.n_errors() > 0 {
        Exit::Input
    } else {
        Exit::Ok
    })
}
