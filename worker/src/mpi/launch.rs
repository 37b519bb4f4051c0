//! Start of a program on MPI ranks: checks of the numbers of ranks and threads, the work of rank 0 and of the other
//! ranks, the end of all ranks when one fails.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use cardiotwin_protocol::exit_code;
use clap::Args;
use mpi::Threading;
use mpi::traits::Communicator as _;

use super::check::{self, Fault};
use super::communicator::{MOST_SHARING, MpiRank};
use super::failure::Failures;
use crate::program::code_of;
use crate::stop::StopFlag;
use crate::team::Team;

/// Exit code if the number of ranks differs from the requested one.
const EXIT_RANKS: u8 = 5;

/// Ranks that a program is to have, and the parts of the mesh that they share.
#[derive(Debug, Args)]
pub struct Ranks {
    /// Required number of ranks [default: CARDIOTWIN_RANKS, else with `run` the `threads` of spec.json]
    #[arg(long, value_name = "N")]
    ranks: Option<usize>,
    /// Number of parts of the mesh, a multiple of the number of ranks [default: `subdomains` of the task's specification, else
    /// one part per rank]. Each rank computes its parts on threads. Sums follow the parts, so a beat is the same to the bit on
    /// any number of ranks and on as many threads
    #[arg(long, value_name = "S")]
    subdomains: Option<usize>,
    /// Time that a rank waits for another before it ends all ranks
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0)]
    patience: f64,
}

/// A program that rank 0 leads and the other ranks follow.
pub trait RankProgram: Sync {
    /// Directory in which the failure of a rank is written, if the work has one.
    fn directory(&self) -> Option<PathBuf> {
        None
    }

    /// Number of ranks that the work itself requests, and the source of this number. [`Ranks`] and CARDIOTWIN_RANKS
    /// take precedence.
    ///
    /// # Errors
    /// If the file with the number cannot be read.
    fn n_ranks(&self) -> anyhow::Result<Option<(usize, &'static str)>> {
        Ok(None)
    }

    /// Number of parts of the mesh that the work itself requests. [`Ranks`] takes precedence.
    fn n_subdomains(&self) -> Option<usize> {
        None
    }

    /// Work of rank 0; returns the failure if the outcome reports one.
    ///
    /// # Errors
    /// If nothing was computed.
    fn lead(&self, team: &Team, stop: &StopFlag) -> anyhow::Result<Option<String>>;

    /// Work of every other rank.
    ///
    /// # Errors
    /// If this rank cannot continue, which ends all ranks.
    fn follow(&self, team: &Team) -> anyhow::Result<()> {
        team.follow().map_err(anyhow::Error::from)
    }

    /// Whether the other ranks wait for calls of rank 0 until it dismisses them. If they do not, a failure of rank 0
    /// has to end them.
    fn followers_wait(&self) -> bool {
        true
    }
}

/// Runs `program` on the ranks of the launcher that started this process.
pub fn run_on_ranks(ranks: &Ranks, program: &impl RankProgram) -> ExitCode {
    let said_by_work = || program.n_ranks();
    let parts = ranks.subdomains.or_else(|| program.n_subdomains());
    let directory = program.directory();
    on_ranks((ranks, parts), directory, said_by_work, |k, launched| {
        let team = launched.team(k).that_knows_its_nodes();
        let help = |team: &Team| {
            if let Err(error) = program.follow(team) {
                launched.failures.end_after_rank_0(&format!("{error:#}"));
            }
        };
        if k > 0 {
            help(&team);
            return ExitCode::SUCCESS;
        }
        // A signal reaches all ranks, and rank 0 tells the others when to stop.
        let stop = StopFlag::on_signals();
        if launched.failures.rank > 0 {
            help(&team);
            return ExitCode::SUCCESS;
        }
        let done = stop
            .context("cannot catch signals")
            .and_then(|stop| program.lead(&team, &stop));
        let code = done.as_ref().map_or_else(code_of, |_| ExitCode::SUCCESS);
        let lost = !program.followers_wait() && done.is_err();
        if team.is_amid() || lost {
            let reason = done.map_or_else(|error| format!("{error:#}"), Option::unwrap_or_default);
            launched.failures.end(&reason);
        }
        if let Err(error) = done {
            eprintln!("error: {error:#}");
        }
        if program.followers_wait() {
            team.dismiss();
        }
        code
    })
}

/// Checks launcher and network on all ranks; `fault` lets one of them fail.
pub fn check_ranks(ranks: &Ranks, fault: Option<Fault>, json: bool) -> ExitCode {
    on_ranks(
        (ranks, ranks.subdomains),
        None,
        || Ok(None),
        |k, launched| {
            // A signal must not end one rank while others wait for it.
            let _stop = (k == 0).then(StopFlag::on_signals);
            check::check(
                launched.team(k).comm().as_ref(),
                fault,
                json,
                &launched.failures,
            );
            ExitCode::SUCCESS
        },
    )
}

/// This process among the ranks of its launcher.
struct Launched {
    failures: Arc<Failures>,
    /// Parts of the mesh that this process computes, each on a thread.
    per_process: usize,
    has_own_core: bool,
    patience: Duration,
}

impl Launched {
    /// The ranks as thread `k` of this process sees them.
    fn team(&self, k: usize) -> Team {
        Team::new(Arc::new(MpiRank::new(
            (k, self.per_process),
            self.has_own_core,
            self.patience,
            Arc::clone(&self.failures),
        )))
    }
}

/// Initialises MPI and calls `work` on each thread of this process that computes a part of the mesh.
fn on_ranks(
    (ranks, parts): (&Ranks, Option<usize>),
    directory: Option<PathBuf>,
    said_by_work: impl FnOnce() -> anyhow::Result<Option<(usize, &'static str)>>,
    work: impl Fn(usize, &Launched) -> ExitCode + Sync,
) -> ExitCode {
    // If the launcher is killed, its ranks must not stay behind and wait for each other.
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
    let threading = if parts.is_some() {
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
    let per_process = match expected(ranks, said_by_work, n_ranks)
        .and_then(|()| shared(parts, n_ranks, provided))
    {
        Ok(per_process) => per_process,
        Err(error) => {
            // Under a launcher of another MPI, every rank is rank 0 of its own world and prints
            // this message.
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
    let on_this_node = universe.world().split_shared(0).size() as usize * per_process;
    let launched = Launched {
        failures,
        per_process,
        has_own_core: std::thread::available_parallelism()
            .is_ok_and(|cores| on_this_node <= cores.get()),
        patience: Duration::try_from_secs_f64(ranks.patience).unwrap_or(Duration::MAX),
    };
    let code = std::thread::scope(|scope| {
        // If one of these threads panics, the panic hook ends all ranks.
        for k in 1..per_process {
            let (work, launched) = (&work, &launched);
            scope.spawn(move || work(k, launched));
        }
        work(0, &launched)
    });
    drop(universe);
    code
}

/// Parts of the mesh in each process.
fn shared(parts: Option<usize>, n_ranks: usize, provided: Threading) -> anyhow::Result<usize> {
    let Some(parts) = parts else {
        return Ok(1);
    };
    anyhow::ensure!(
        parts > 0 && parts.is_multiple_of(n_ranks) && parts <= MOST_SHARING,
        "{parts} subdomains: expected a multiple of the {n_ranks} ranks, {} at most; set executor.threads, --subdomains or \
         solver.finite_element.subdomains to match",
        MOST_SHARING
    );
    anyhow::ensure!(
        parts == n_ranks || provided == Threading::Multiple,
        "{parts} subdomains: this MPI serves one thread of a process only (it provides {provided:?}); use as many ranks"
    );
    Ok(parts / n_ranks)
}

/// Checks that the number of ranks is the requested one. Under a launcher of another MPI, every
/// rank runs alone.
fn expected(
    ranks: &Ranks,
    said_by_work: impl FnOnce() -> anyhow::Result<Option<(usize, &'static str)>>,
    found: usize,
) -> anyhow::Result<()> {
    let said = std::env::var("CARDIOTWIN_RANKS").ok();
    let (expected, by) = match (ranks.ranks, said) {
        (Some(n), _) => (n, "--ranks"),
        (None, Some(said)) => {
            let n = said.parse().with_context(|| {
                format!("CARDIOTWIN_RANKS is `{said}`: expected a number of ranks")
            })?;
            (n, "CARDIOTWIN_RANKS")
        }
        (None, None) => said_by_work()?.with_context(|| {
            format!(
                "give the required number of ranks with --ranks N or CARDIOTWIN_RANKS; found {found}"
            )
        })?,
    };
    anyhow::ensure!(
        expected == found,
        "found {found} ranks, expected {expected} ({by}): start as many with the launcher of the MPI that this program was \
         built with (mpirun -n {expected}, srun --mpi=pmix -n {expected} for Open MPI, srun --mpi=pmi2 for MPICH); under \
         another MPI's launcher every rank believes to be alone"
    );
    Ok(())
}
