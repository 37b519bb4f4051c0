//! The command line: arguments, tables, progress, exit codes. Data go to stdout, messages to
//! stderr; the module contains no SQL.

mod access;
mod answer;
mod commands;
mod completion;
mod denied;
mod error;
mod estimate;
mod event_log;
mod exit;
mod groups;
mod kept;
mod logging;
mod mesh_error;
mod misplaced;
mod notices;
mod open;
mod place;
mod problems;
mod progress;
mod redone;
mod scratch;
mod seen;
mod slurm_variables;
mod store;
mod summary;
mod table;
mod talk;
#[cfg(test)]
mod tests;
mod tick;
mod time_left;
mod ventricle;
mod vtu;

use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

pub use error::CliError;
pub use exit::Exit;

use commands::{
    advance, backup, cancel, check, compare, completions, config, dashboard, discover, doctor,
    drive, elastance, explain, export, fit, housekeeping, init, jobs, logs, man, mesh, plan,
    predict, prepare, report, rerun, retry, run, schemas, show, simulate, status, sweep, verify,
    version,
};
use logging::LogFormat;
use talk::{ColourChoice, Talk};

/// Build personalised cardiac digital twins of a cohort
#[derive(Debug, Parser)]
#[command(name = "cardiotwin", version, max_term_width = 110, after_help = Exit::help())]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Global options")]
struct Global {
    /// Log more: -v info, -vv debug, -vvv trace
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    verbose: u8,
    /// Print only errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Format of log lines on stderr: human or json
    #[arg(long, value_name = "FORMAT", value_enum, hide_possible_values = true, default_value_t = LogFormat::Human, global = true)]
    log_format: LogFormat,
    /// When to use colour: auto, always or never; NO_COLOR is respected
    #[arg(long, alias = "colour", value_name = "WHEN", value_enum, hide_possible_values = true, default_value_t = ColourChoice::Auto, global = true)]
    color: ColourChoice,
}

#[derive(Debug, Subcommand)]
enum Command {
    Init(init::InitArgs),
    Prepare(prepare::PrepareArgs),
    Check(check::CheckArgs),
    Mesh(mesh::MeshArgs),
    Config(config::ConfigArgs),
    Run(run::RunArgs),
    Plan(plan::PlanArgs),
    Advance(advance::AdvanceArgs),
    Simulate(simulate::SimulateArgs),
    Predict(predict::PredictArgs),
    Elastance(elastance::ElastanceArgs),
    Status(status::StatusArgs),
    Dashboard(dashboard::DashboardArgs),
    Show(show::ShowArgs),
    Explain(explain::ExplainArgs),
    Jobs(jobs::JobsArgs),
    Logs(logs::LogsArgs),
    Rerun(rerun::RerunArgs),
    Retry(retry::RetryArgs),
    Cancel(cancel::CancelArgs),
    Compare(compare::CompareArgs),
    Report(report::ReportArgs),
    Export(export::ExportArgs),
    Verify(verify::VerifyArgs),
    Backup(backup::BackupArgs),
    Du(housekeeping::DuArgs),
    Clean(housekeeping::CleanArgs),
    Archive(housekeeping::ArchiveArgs),
    Doctor(doctor::DoctorArgs),
    Discover(discover::DiscoverArgs),
    Fit(fit::FitArgs),
    Sweep(Box<sweep::SweepArgs>),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
    Schemas(schemas::SchemasArgs),
    Version(version::VersionArgs),
    #[command(hide = true)]
    Drive(drive::DriveArgs),
}

/// The command as clap knows it, for completions, manual pages and tests.
#[must_use]
pub fn command() -> clap::Command {
    groups::grouped(Cli::command(), groups::width())
}

/// The program from its arguments to its exit code.
#[must_use]
pub fn main() -> ExitCode {
    completion::answer(|| completion::with_completers(command()));
    let given = command().try_get_matches().unwrap_or_else(|error| {
        let hint = misplaced::hint(&error, &Cli::command(), std::env::args().skip(1));
        // Nobody reads what cannot be printed.
        let _ = error.print();
        if let Some(hint) = hint {
            Talk::new(ColourChoice::Auto, false).hint(&hint);
        }
        std::process::exit(error.exit_code())
    });
    let cli = Cli::from_arg_matches(&given).unwrap_or_else(|error| error.exit());
    let talk = Talk::new(cli.global.color, cli.global.quiet);
    logging::start(
        cli.global.verbose,
        cli.global.quiet,
        cli.global.log_format,
        talk.colour_err,
    );
    let runtime = match tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
    {
        Ok(runtime) => runtime,
        Err(source) => {
            talk.error(&CliError::Io {
                what: "cannot start threads",
                source,
            });
            return Exit::System.into();
        }
    };
    let exit = match runtime.block_on(execute(&cli.command, &talk)) {
        Ok(exit) => exit,
        Err(error) => {
            talk.error(&error);
            if has_run_dir(&given) && denied::is_denied(&error) {
                talk.hint("--run-dir DIR puts the run into a folder that you may write");
            }
            error.exit()
        }
    };
    exit.into()
}

/// Whether the given command takes `--run-dir`.
fn has_run_dir(given: &clap::ArgMatches) -> bool {
    let Some((name, _)) = given.subcommand() else {
        return false;
    };
    let program = Cli::command();
    let arguments = program
        .find_subcommand(name)
        .map(clap::Command::get_arguments);
    arguments.is_some_and(|mut all| all.any(|one| one.get_long() == Some("run-dir")))
}

async fn execute(command: &Command, talk: &Talk) -> Result<Exit, CliError> {
    match command {
        Command::Init(args) => init::execute(args, talk),
        Command::Prepare(args) => prepare::execute(args, talk),
        Command::Check(args) => check::execute(args, talk),
        Command::Mesh(args) => mesh::execute(args, talk),
        Command::Config(args) => config::execute(args, talk).await,
        Command::Run(args) => run::execute(args, talk).await,
        Command::Plan(args) => plan::execute(args, talk).await,
        Command::Advance(args) => advance::execute(args, talk).await,
        Command::Drive(args) => drive::execute(args, talk).await,
        Command::Simulate(args) => simulate::execute(args, talk).await,
        Command::Predict(args) => predict::execute(args, talk).await,
        Command::Elastance(args) => elastance::execute(args, talk).await,
        Command::Status(args) => status::execute(args, talk).await,
        Command::Dashboard(args) => dashboard::execute(args, talk).await,
        Command::Show(args) => show::execute(args, talk).await,
        Command::Explain(args) => explain::execute(args, talk).await,
        Command::Jobs(args) => jobs::execute(args, talk).await,
        Command::Logs(args) => logs::execute(args, talk).await,
        Command::Rerun(args) => rerun::execute(args, talk).await,
        Command::Retry(args) => retry::execute(args, talk).await,
        Command::Cancel(args) => cancel::execute(args, talk).await,
        Command::Compare(args) => compare::execute(args, talk).await,
        Command::Report(args) => report::execute(args, talk).await,
        Command::Export(args) => export::execute(args, talk).await,
        Command::Verify(args) => verify::execute(args, talk).await,
        Command::Backup(args) => backup::execute(args, talk).await,
        Command::Du(args) => housekeeping::du(args, talk).await,
        Command::Clean(args) => housekeeping::clean(args, talk).await,
        Command::Archive(args) => housekeeping::archive(args, talk).await,
        Command::Doctor(args) => doctor::execute(args, talk).await,
        Command::Discover(args) => discover::execute(args, talk).await,
        Command::Fit(args) => fit::execute(args, talk),
        Command::Sweep(args) => sweep::execute(args, talk).await,
        Command::Completions(args) => completions::execute(args, talk),
        Command::Man(args) => man::execute(args, Cli::command(), talk),
        Command::Schemas(args) => schemas::execute(args, talk),
        Command::Version(args) => version::execute(args, talk),
    }
}
