//! `cardiotwin-worker-mpi`: does one task on the ranks of an MPI launcher. The only program of this workspace that links MPI.

mod check;
mod communicator;
mod failure;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use cardiotwin_protocol::exit_code;
use cardiotwin_schemas::task::AttemptSpec;
use cardiotwin_worker::bench;
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::memory::return_large_blocks;
use cardiotwin_worker::program::{code_of, log, make_folder, read, read_task, restarting};
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
    /// Parts of the mesh, a multiple of the ranks: each computes several, on threads. They own the order of sums, so that a
    /// beat is the same to the bit on any number of ranks and, with as many, on threads; without, a part a rank
    #[arg(long, value_name = "S")]
    subdomains: Option<usize>,
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
    /// Do one task without a claim; the outcome goes to stdout as JSON
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
    /// Measure a beat of a generated 3D ventricle, as `cardiotwin-worker bench beat --nodes N` on threads
    Bench {
        #[command(flatten)]
        ranks: Ranks,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Nodes, about
        #[arg(long, value_name = "N")]
        nodes: usize,
        /// Linear elements with a plain penalty (the paper's), not with nodal volume change
        #[arg(long)]
        pointwise: bool,
        /// Length of the beat; the default is whole
        #[arg(long, value_name = "MS", default_value_t = 659.0)]
        cycle: f64,
        /// Time step
        #[arg(long, value_name = "MS", default_value_t = 1.0)]
        step: f64,
        /// Relative tolerance of Newton's method
        #[arg(long, default_value_t = 1e-4)]
        tolerance: f64,
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
    return_large_blocks();
    let cli = Cli::parse();
    let (ranks, directory) = match &cli.command {
        Command::Run {
            directory, ranks, ..
        } => (ranks, Some(directory.clone())),
        Command::Simulate { out, ranks, .. } => (ranks, Some(out.clone())),
        Command::Bench { ranks, .. } | Command::Check { ranks, .. } => (ranks, None),
    };
    // A launcher that is killed leaves no ranks behind that wait for each other.
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
    let threading = if ranks.subdomains.is_some() {
        Threading::Multiple
    } else {
        Threading::Funneled
    };
    let Some((universe, provided)) = mpi::initialize_with_threading(threading) else {
        eprintln!("error: MPI was initialised before");
        return ExitCode::from(exit_code::FAILED);
    };
    let (rank, n_ranks) = (
        universe.world().rank() as usize,
        universe.world().size() as usize,
    );
    let per_process = match expected(&cli.command, ranks, n_ranks)
        .and_then(|()| shared(ranks, n_ranks, provided))
    {
        Ok(per_process) => per_process,
        Err(error) => {
            // Each rank that believes to be alone finds this out: one message for each.
            if rank == 0 {
                eprintln!("error: {error:#}");
            }
            return ExitCode::from(EXIT_RANKS);
        }
    };
    let failures = Arc::new(Failures {
        rank,
        n_ranks,
        directory,
    });
    failures.on_panic();
    let patience = Duration::try_from_secs_f64(ranks.patience).unwrap_or(Duration::MAX);
    let on_this_node = universe.world().split_shared(0).size() as usize * per_process;
    let has_own_core =
        std::thread::available_parallelism().is_ok_and(|cores| on_this_node <= cores.get());
    let rank_of = |k| {
        MpiRank::new(
            (k, per_process),
            has_own_core,
            patience,
            Arc::clone(&failures),
        )
    };
    let team = |k| Team::new(Arc::new(rank_of(k)));
    let help = |team: &Team| {
        if let Command::Check { json, fail, .. } = &cli.command {
            return check::check(team.comm().as_ref(), *fail, *json, &failures);
        }
        let helped = match measured(&cli.command) {
            Some(bench) => bench::follow(&bench, team).map_err(anyhow::Error::from),
            None => team.follow().map_err(anyhow::Error::from),
        };
        if let Err(error) = helped {
            failures.end_after_rank_0(&format!("{error:#}"));
        }
    };
    let code = std::thread::scope(|scope| {
        // One that panics ends all ranks by the hook above.
        (1..per_process).for_each(|k| drop(scope.spawn(move || help(&team(k)))));
        let team = team(0);
        // Whoever asks rank 0 to stop asks the others, too: rank 0 tells them.
        let stop = StopFlag::on_signals();
        if rank > 0 || matches!(cli.command, Command::Check { .. }) {
            help(&team);
            return ExitCode::SUCCESS;
        }
        let done = stop
            .context("cannot catch signals")
            .and_then(|stop| lead(&cli.command, &team, &stop));
        let code = done.as_ref().map_or_else(code_of, |_| ExitCode::SUCCESS);
        let lost = matches!(cli.command, Command::Bench { .. }) && done.is_err();
        if team.is_amid() || lost {
            let reason = done.map_or_else(|error| format!("{error:#}"), Option::unwrap_or_default);
            failures.end(&reason);
        }
        if let Err(error) = done {
            eprintln!("error: {error:#}");
        }
        if measured(&cli.command).is_none() {
            team.dismiss();
        }
        code
    });
    drop(universe);
    code
}

/// The beat that all ranks measure.
fn measured(command: &Command) -> Option<bench::VentricleBench> {
    let Command::Bench {
        nodes,
        pointwise,
        cycle,
        step,
        tolerance,
        ..
    } = *command
    else {
        return None;
    };
    let element = if pointwise {
        bench::Element::Pointwise
    } else {
        bench::Element::Linear
    };
    Some(bench::VentricleBench {
        nodes,
        element,
        cycle_ms: cycle,
        step_ms: step,
        diastolic_step_ms: 0.0,
        tolerance,
    })
}

/// Parts of the mesh a process.
fn shared(ranks: &Ranks, n_ranks: usize, provided: Threading) -> anyhow::Result<usize> {
    let Some(parts) = ranks.subdomains else {
        return Ok(1);
    };
    anyhow::ensure!(
        parts > 0 && parts.is_multiple_of(n_ranks) && parts <= communicator::MOST_SHARING,
        "--subdomains {parts}: expected a multiple of the {n_ranks} ranks, {} at most",
        communicator::MOST_SHARING
    );
    anyhow::ensure!(
        parts == n_ranks || provided == Threading::Multiple,
        "--subdomains {parts}: this MPI serves one thread of a process only (it provides {provided:?}); use as many ranks"
    );
    Ok(parts / n_ranks)
}

/// Whether there are as many ranks as were asked for: under a launcher of another MPI every rank believes to be alone.
fn expected(command: &Command, ranks: &Ranks, found: usize) -> anyhow::Result<()> {
    let said = std::env::var("CARDIOTWIN_RANKS").ok();
    let (expected, by) = match (ranks.ranks, said, command) {
        (Some(n), ..) => (n, "--ranks"),
        (None, Some(said), _) => {
            let n = said.parse().with_context(|| {
                format!("CARDIOTWIN_RANKS is `{said}`: expected a number of ranks")
            })?;
            (n, "CARDIOTWIN_RANKS")
        }
        (None, None, Command::Run { directory, .. }) => {
            let file = directory.join("spec.json");
            let spec: AttemptSpec = serde_json::from_str(&read(&file)?).with_context(|| {
                format!("{}: not the specification of an attempt", file.display())
            })?;
            (spec.threads.max(1) as usize, "threads in spec.json")
        }
        (None, None, _) => {
            anyhow::bail!(
                "say with --ranks N (or CARDIOTWIN_RANKS) how many ranks there must be; found {found}"
            )
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

/// What rank 0 does; returns what went wrong where an outcome says so.
fn lead(command: &Command, team: &Team, stop: &StopFlag) -> anyhow::Result<Option<String>> {
    let ending = match command {
        Command::Run {
            directory, quiet, ..
        } => {
            log(if *quiet { Level::WARN } else { Level::INFO });
            run_attempt(directory, Some(team.clone()), stop, !quiet)?
        }
        Command::Simulate {
            spec,
            out,
            vtu_every,
            checkpoint_every,
            restart,
            ..
        } => {
            log(Level::INFO);
            let task = read_task(spec)?;
            make_folder(out)?;
            let checkpoints = match restart {
                Some(other) => restarting(out, other, None)?,
                None if *checkpoint_every > 0.0 => Checkpoints::writing(out),
                None => Checkpoints::none(),
            };
            let context = Context {
                team: Some(team.clone()),
                checkpoints,
                checkpoint_ms: *checkpoint_every,
                checkpoint_apart: Duration::ZERO,
                vtu_every_ms: *vtu_every,
                stop: stop.clone(),
                ..Context::plain(out, 1)
            };
            let outcome = simulate(&task, context);
            println!("{}", serde_json::to_string_pretty(&outcome)?);
            outcome.ending
        }
        Command::Bench { json, .. } => {
            let what = measured(command).context("a beat to measure")?;
            let report = |word: &str| eprintln!("{word}");
            let timings = bench::ventricle(&what, &[bench::Ranks::Team(team)], stop, report)?;
            print!("{}", bench::told(&timings, *json)?);
            anyhow::ensure!(
                timings.iter().all(|t| t.diverged.is_none()),
                "the beat did not reach its end"
            );
            return Ok(None);
        }
        Command::Check { .. } => unreachable!("all ranks check"),
    };
    Ok(Some(serde_json::to_string(&ending)?))
}
