//! `cardiotwin-dev-mpi`: measures a beat of a generated 3D ventricle on the ranks of an MPI launcher.

use std::process::ExitCode;

use cardiotwin_dev::arguments::BeatArgs;
use cardiotwin_dev::kernels::{self, Ranks, VentricleBench};
use cardiotwin_worker::memory::return_large_blocks;
use cardiotwin_worker::mpi::{self, RankProgram, run_on_ranks};
use cardiotwin_worker::provenance::VERSION_TEXT;
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::team::Team;
use clap::Parser;

/// Measures a beat of a generated 3D ventricle on MPI ranks, as `cardiotwin-dev bench beat --nodes N` does on threads:
/// `mpirun -n 4 cardiotwin-dev-mpi --ranks 4 --nodes 8000`
#[derive(Parser)]
#[command(name = "cardiotwin-dev-mpi", version = VERSION_TEXT)]
struct Cli {
    #[command(flatten)]
    ranks: mpi::Ranks,
    /// Nodes, about
    #[arg(long, value_name = "N")]
    nodes: usize,
    #[command(flatten)]
    beat: BeatArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Cli {
    fn bench(&self) -> anyhow::Result<VentricleBench> {
        self.beat.bench(self.nodes)
    }
}

impl RankProgram for Cli {
    fn lead(&self, team: &Team, stop: &StopFlag) -> anyhow::Result<Option<String>> {
        let report = |line: &str| eprintln!("{line}");
        let timings = kernels::ventricle(&self.bench()?, &[Ranks::Team(team)], stop, report)?;
        print!("{}", kernels::text_of(&timings, self.json)?);
        anyhow::ensure!(
            timings.iter().all(|t| t.diverged.is_none()),
            "the beat did not reach its end"
        );
        Ok(None)
    }

    fn follow(&self, team: &Team) -> anyhow::Result<()> {
        Ok(kernels::follow(&self.bench()?, team)?)
    }

    fn followers_wait(&self) -> bool {
        false
    }
}

fn main() -> ExitCode {
    return_large_blocks();
    let cli = Cli::parse();
    run_on_ranks(&cli.ranks, &cli)
}
