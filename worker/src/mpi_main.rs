//! `cardiotwin-worker-mpi`: executes one task on the ranks of an MPI launcher.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use cardiotwin_schemas::formats::SPEC;
use cardiotwin_schemas::task::AttemptSpec;
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::memory::return_large_blocks;
use cardiotwin_worker::mpi::{Fault, RankProgram, Ranks, check_ranks, run_on_ranks};
use cardiotwin_worker::program::{log, make_folder, read, read_task, restarting};
use cardiotwin_worker::provenance::VERSION_TEXT;
use cardiotwin_worker::run::{run_attempt, simulate};
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::team::Team;
use clap::{Args, Parser, Subcommand};
use tracing::Level;

/// Does one task of a cardiotwin run on MPI ranks: `mpirun -n 4 cardiotwin-worker-mpi simulate --ranks 4 …`
///
/// Exit codes: 1 nothing was published, 3 another worker had claimed the attempt, 4 the attempt was revoked, 5 the number of
/// ranks was not the required one, 6 a rank failed and ended all ranks.
#[derive(Parser)]
#[command(name = "cardiotwin-worker-mpi", version = VERSION_TEXT)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Claim the attempt in a directory, do its task and publish outcome.json
    Run(RunArgs),
    /// Do one task without a claim; the outcome goes to stdout as JSON
    Simulate(SimulateArgs),
    /// Check the launcher and the network: ranks and hosts, times of a reduction and of a halo
    Check {
        #[command(flatten)]
        ranks: Ranks,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Let a rank fail, to see that the launcher ends all: `RANK:panic`, `RANK:error` or `RANK:stall`
        #[arg(long, value_name = "RANK:HOW")]
        fail: Option<Fault>,
    },
}

#[derive(Args)]
struct RunArgs {
    /// Directory with spec.json
    directory: PathBuf,
    #[command(flatten)]
    ranks: Ranks,
    /// Print no progress on stderr
    #[arg(long)]
    quiet: bool,
}

#[derive(Args)]
struct SimulateArgs {
    /// File with a task's specification in JSON
    spec: PathBuf,
    /// Directory for traces, created if it does not exist
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    ranks: Ranks,
    /// Simulated time between VTU files in OUT/vtu, ms; 0 for no files. Rank 0 gathers and writes them
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    vtu_every: f64,
    /// Simulated time between checkpoints in OUT/checkpoint, ms; 0 for none. Any number of ranks or threads can continue from
    /// a checkpoint
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    checkpoint_every: f64,
    /// Continue from the checkpoint in this directory
    #[arg(long, value_name = "DIR")]
    restart: Option<PathBuf>,
}

/// Parts of the mesh that a specification asks for. A file that cannot be read is reported by the work.
fn subdomains(spec: &Path) -> Option<usize> {
    let parts = read_task(spec).ok()?.subdomains();
    (parts > 0).then_some(parts as usize)
}

impl RankProgram for RunArgs {
    fn directory(&self) -> Option<PathBuf> {
        Some(self.directory.clone())
    }

    fn n_ranks(&self) -> anyhow::Result<Option<(usize, &'static str)>> {
        let file = self.directory.join("spec.json");
        let spec: AttemptSpec = SPEC.read_order(&file.display(), read(&file)?.as_bytes())?;
        Ok(Some((spec.threads.max(1) as usize, "threads in spec.json")))
    }

    fn n_subdomains(&self) -> Option<usize> {
        subdomains(&self.directory.join("spec.json"))
    }

    fn lead(&self, team: &Team, stop: &StopFlag) -> anyhow::Result<Option<String>> {
        log(if self.quiet { Level::WARN } else { Level::INFO });
        let ending = run_attempt(&self.directory, Some(team.clone()), stop, !self.quiet)?;
        Ok(Some(serde_json::to_string(&ending)?))
    }
}

impl RankProgram for SimulateArgs {
    fn directory(&self) -> Option<PathBuf> {
        Some(self.out.clone())
    }

    fn n_subdomains(&self) -> Option<usize> {
        subdomains(&self.spec)
    }

    fn lead(&self, team: &Team, stop: &StopFlag) -> anyhow::Result<Option<String>> {
        log(Level::INFO);
        let task = read_task(&self.spec)?;
        make_folder(&self.out)?;
        let checkpoints = match &self.restart {
            Some(other) => restarting(&self.out, other, None)?,
            None if self.checkpoint_every > 0.0 => Checkpoints::writing(&self.out),
            None => Checkpoints::none(),
        };
        let context = Context {
            team: Some(team.clone()),
            checkpoints,
            checkpoint_ms: self.checkpoint_every,
            checkpoint_apart: Duration::ZERO,
            vtu_every_ms: self.vtu_every,
            stop: stop.clone(),
            ..Context::plain(&self.out, 1)
        };
        let outcome = simulate(&task, context);
        println!("{}", serde_json::to_string_pretty(&outcome)?);
        Ok(Some(serde_json::to_string(&outcome.ending)?))
    }
}

fn main() -> ExitCode {
    return_large_blocks();
    match Cli::parse().command {
        Command::Run(args) => run_on_ranks(&args.ranks, &args),
        Command::Simulate(args) => run_on_ranks(&args.ranks, &args),
        Command::Check { ranks, json, fail } => check_ranks(&ranks, fail, json),
    }
}
