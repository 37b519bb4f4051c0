//! `cardiotwin-worker-mpi`: does one task on the ranks of an MPI launcher. The only program of this workspace that links MPI.

mod check;
mod communicator;
mod failure;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use cardiotwin_worker::attempt::AttemptError;
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::provenance::VERSION_TEXT;
use cardiotwin_worker::run::{run_attempt, simulate};
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::team::Team;
use clap::{Args, Parser, Subcommand};
use mpi::Threading;
use mpi::traits::Communicator as _;
use tracing::Level;

use communicator::MpiRank;
use failure::Failures;

/// Nothing was published, for a reason other than those below.
const EXIT_FAILED: u8 = 1;
/// The attempt was claimed before.
const EXIT_CLAIMED: u8 = 3;
/// The attempt was revoked.
const EXIT_FENCED: u8 = 4;
/// Other ranks than were asked for.
const EXIT_RANKS: u8 = 5;

/// Does one task of a cardiotwin run on MPI ranks: `mpirun -n 4 cardiotwin-worker-mpi simulate --ranks 4 …`
///
/// Exit codes: 1 nothing was published, 3 the attempt was claimed before, 4 it was revoked, 5 other ranks than were asked
/// for, 6 a rank failed and ended all.
#[derive(Parser)]
#[command(name = "cardiotwin-worker-mpi", version = VERSION_TEXT)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Args)]
struct Ranks {
    /// Ranks that there must be; the default is what the environment says (CARDIOTWIN_RANKS), then, with `run`, what
    /// spec.json says (`threads`)
    #[arg(long, value_name = "N")]
    ranks: Option<usize>,
    /// A rank that waits for another for so long ends all
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0)]
    patience: f64,
}

#[derive(Subcommand)]
enum Command {
    /// Claim the attempt in a directory, do its task and publish outcome.json
    Run {
        /// Directory with spec.json
        directory: PathBuf,
        #[command(flatten)]
        ranks: Ranks,
        /// Do not repeat progress on stderr
        #[arg(long)]
        quiet: bool,
    },
    /// Do one task without claim or fence; the outcome goes to stdout as JSON
    Simulate {
        /// File with a task's specification in JSON
        spec: PathBuf,
        /// Directory for traces; made if it does not exist
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        ranks: Ranks,
        /// Simulated ms between frames of a series of VTU files, one file a frame gathered on rank 0, in OUT/vtu; 0 for none
        #[arg(long, value_name = "MS", default_value_t = 0.0)]
        vtu_every: f64,
        /// Simulated ms between two checkpoints in OUT/checkpoint, which any number of ranks or threads can go on from;
        /// 0 for none
        #[arg(long, value_name = "MS", default_value_t = 0.0)]
        checkpoint_every: f64,
        /// Go on from the checkpoint in this directory
        #[arg(long, value_name = "DIR")]
        restart: Option<PathBuf>,
    },
    /// Check the launcher and the network: ranks and hosts, times of a reduction and of a halo
    Check {
        #[command(flatten)]
        ranks: Ranks,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Let a rank fail, to see that the launcher ends all: `RANK:panic`, `RANK:error` or `RANK:stall`
        #[arg(long, value_name = "RANK:HOW")]
        fail: Option<check::Fault>,
    },
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let (ranks, directory) = match &cli.command {
        Command::Run { directory, ranks, .. } => (ranks, Some(directory.clone())),
        Command::Simulate { out, ranks, .. } => (ranks, Some(out.clone())),
        Command::Check { ranks, .. } => (ranks, None),
    };
    let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else {
        eprintln!("error: MPI was initialised before");
        return ExitCode::from(EXIT_FAILED);
    };
    let (rank, n_ranks) = (universe.world().rank() as usize, universe.world().size() as usize);
    if let Err(error) = expected(&cli.command, ranks, n_ranks) {
        // Each rank that believes to be alone finds this out: one message for each.
        if rank == 0 {
            eprintln!("error: {error:#}");
        }
        return ExitCode::from(EXIT_RANKS);
    }
    let failures = Arc::new(Failures { rank, n_ranks, directory });
    failures.on_panic();
    let patience = Duration::try_from_secs_f64(ranks.patience).unwrap_or(Duration::MAX);
    let team = Team::new(Arc::new(MpiRank::new(patience, Arc::clone(&failures))));
    let code = if let Command::Check { json, fail, .. } = &cli.command {
        check::check(team.comm().as_ref(), *fail, *json, &failures);
        ExitCode::SUCCESS
    } else if rank > 0 {
        // Whoever asks rank 0 to stop asks the others, too: rank 0 tells them.
        let caught = StopFlag::on_signals();
        match caught.context("cannot catch signals").and_then(|_| Ok(team.follow()?)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => failures.end_after_rank_0(&format!("{error:#}")),
        }
    } else {
        let done = lead(cli.command, &team);
        let code = done.as_ref().map_or_else(code_of, |_| ExitCode::SUCCESS);
        if team.is_amid() {
            let reason = done.map_or_else(|error| format!("{error:#}"), |reason| reason.unwrap_or_default());
            failures.end(&reason);
        }
        if let Err(error) = done {
            eprintln!("error: {error:#}");
        }
        team.dismiss();
        code
    };
    drop(universe);
    code
}

fn code_of(error: &anyhow::Error) -> ExitCode {
    ExitCode::from(match error.downcast_ref::<AttemptError>() {
        Some(AttemptError::Claimed { .. }) => EXIT_CLAIMED,
        Some(AttemptError::Fenced { .. }) => EXIT_FENCED,
        _ => EXIT_FAILED,
    })
}

/// Whether there are as many ranks as were asked for: under a launcher of another MPI every rank believes to be alone.
fn expected(command: &Command, ranks: &Ranks, found: usize) -> anyhow::Result<()> {
    let said = std::env::var("CARDIOTWIN_RANKS").ok();
    let (expected, by) = match (ranks.ranks, said, command) {
        (Some(n), ..) => (n, "--ranks"),
        (None, Some(said), _) => {
            let n =
                said.parse().with_context(|| format!("CARDIOTWIN_RANKS is `{said}`: expected a number of ranks"))?;
            (n, "CARDIOTWIN_RANKS")
        }
        (None, None, Command::Run { directory, .. }) => {
            let file = directory.join("spec.json");
            let spec: AttemptSpec = serde_json::from_str(&read(&file)?)
                .with_context(|| format!("{}: not the specification of an attempt", file.display()))?;
            (spec.threads.max(1) as usize, "threads in spec.json")
        }
        (None, None, _) => {
            anyhow::bail!("say with --ranks N (or CARDIOTWIN_RANKS) how many ranks there must be; found {found}")
        }
    };
    anyhow::ensure!(
        expected == found,
        "found {found} ranks, expected {expected} ({by}): start as many with the launcher of the MPI that this program was \
         built with (mpirun -n {expected}, srun --mpi=pmix -n {expected} for Open MPI, srun --mpi=pmi2 for MPICH); under \
         another MPI's launcher every rank believes to be alone"
    );
    Ok(())
}

fn read(file: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

/// What rank 0 does; returns what went wrong where an outcome says so.
fn lead(command: Command, team: &Team) -> anyhow::Result<Option<String>> {
    let stop = StopFlag::on_signals().context("cannot catch signals")?;
    let ending = match command {
        Command::Run { directory, quiet, .. } => {
            log(if quiet { Level::WARN } else { Level::INFO });
            run_attempt(&directory, Some(team.clone()), &stop, !quiet)?
        }
        Command::Simulate { spec, out, vtu_every, checkpoint_every, restart, .. } => {
            log(Level::INFO);
            let task: TaskSpec = serde_json::from_str(&read(&spec)?)
                .with_context(|| format!("{}: not the specification of a task", spec.display()))?;
            std::fs::create_dir_all(&out).with_context(|| format!("cannot make {}", out.display()))?;
            let checkpoints = match &restart {
                Some(other) => {
                    anyhow::ensure!(other.is_dir(), "--restart {}: no such directory", other.display());
                    Checkpoints::restarting(&out, other, None)
                }
                None if checkpoint_every > 0.0 => Checkpoints::writing(&out),
                None => Checkpoints::none(),
            };
            let context = Context {
                team: Some(team.clone()),
                checkpoints,
                checkpoint_ms: checkpoint_every,
                checkpoint_apart: Duration::ZERO,
                vtu_every_ms: vtu_every,
                stop,
                ..Context::plain(&out, 1)
            };
            let outcome = simulate(&task, context);
            println!("{}", serde_json::to_string_pretty(&outcome)?);
            outcome.ending
        }
        Command::Check { .. } => unreachable!("all ranks check"),
    };
    Ok(Some(serde_json::to_string(&ending)?))
}

/// Log lines to stderr, which the coordinator keeps beside the outcome.
fn log(level: Level) {
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_target(false).with_max_level(level).init();
}
