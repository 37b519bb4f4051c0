//! `cardiotwin-dev`: measures kernels and the coordinator, and computes mechanics cases from files.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use cardiotwin_dev::arguments::{BeatArgs, Output};
use cardiotwin_dev::mechanics_cases::run_case;
use cardiotwin_dev::{kernels, orchestration};
use cardiotwin_worker::memory::return_large_blocks;
use cardiotwin_worker::provenance::VERSION_TEXT;
use cardiotwin_worker::stop::StopFlag;
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "cardiotwin-dev", version = VERSION_TEXT, about = "Tools of cardiotwin's developers")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Measure kernels or the coordinator: medians after a warm-up (docs/benchmarks.md)
    #[command(subcommand)]
    Bench(Bench),
    /// Compute a mechanics case from a file: mesh, material, supports and loads in, displacements of probes and cavity
    /// volumes out (docs/benchmark-runner.md)
    MechanicsCase {
        /// The case, in TOML
        file: PathBuf,
        /// Elements, time integration and tolerances of a cohort that asks for no others, whatever the file says
        #[arg(long)]
        as_cohort: bool,
        /// File for the table; standard output without
        #[arg(long, value_name = "CSV")]
        out: Option<PathBuf>,
        /// No progress on stderr
        #[arg(long)]
        quiet: bool,
    },
}

#[derive(Subcommand)]
enum Bench {
    /// One beat of the reduced ventricle at 1 ms steps; of the 3D ventricle with --nodes
    Beat {
        /// A generated 3D ventricle of about this many nodes; minutes for tens of thousands
        #[arg(long, value_name = "N")]
        nodes: Option<usize>,
        /// Threads, each with a part of the mesh; several numbers, such as 1,2, are measured one after the other
        #[arg(long, alias = "ranks", requires = "nodes", default_value = "1", value_name = "R", value_delimiter = ',',
              value_parser = clap::value_parser!(u32).range(1..=1024))]
        threads: Vec<u32>,
        #[command(flatten)]
        beat: BeatArgs,
        #[command(flatten)]
        output: Output,
    },
    /// The periodic beat of the base model at 2 ms steps, as a fit to traces asks for it
    Periodic(Output),
    /// One evaluation of the 0D cell, in batches and one by one
    Cell(Output),
    /// Step 2's strategies on the same targets: minutes
    Strategies {
        /// Seeds of each row
        #[arg(long, default_value_t = 10)]
        seeds: u64,
        #[command(flatten)]
        output: Output,
    },
    /// Each shortcut of the 3D beat's time steps, off and on, next to a tight run
    Shortcuts {
        /// Nodes of the generated 3D ventricle, about
        #[arg(long, value_name = "N")]
        nodes: usize,
        /// Threads, each with a part of the mesh
        #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
        threads: u32,
        #[command(flatten)]
        beat: BeatArgs,
        #[command(flatten)]
        output: Output,
    },
    /// The coordinator alone: patients of three no-op tasks each, through database, outbox and executor
    Orchestration(orchestration::OrchestrationArgs),
    /// The dashboard of a large cohort: first paint, delay of updates, share of a core when idle
    Dashboard(orchestration::dashboard::DashboardArgs),
    /// Ticks over many living jobs of a modelled Slurm; status and restart of many samples
    Slurm(orchestration::SlurmArgs),
    /// Many tasks that sleep, on the Slurm of this machine: makespan and utilisation
    Sleepers(orchestration::sleepers::SleepersArgs),
}

fn main() -> ExitCode {
    // Jobs of `bench sleepers` start this program as the driver of their node.
    if std::env::args().nth(1).as_deref() == Some("drive") {
        return cardiotwin::main();
    }
    return_large_blocks();
    let done = match Cli::parse().command {
        Command::Bench(Bench::Orchestration(args)) => orchestration::measure(&args),
        Command::Bench(Bench::Dashboard(args)) => orchestration::dashboard::measure(&args),
        Command::Bench(Bench::Slurm(args)) => orchestration::measure_slurm(&args),
        Command::Bench(Bench::Sleepers(args)) => orchestration::sleepers::measure(&args),
        Command::Bench(bench) => measure(bench),
        Command::MechanicsCase {
            file,
            as_cohort,
            out,
            quiet,
        } => compute(&file, as_cohort, out.as_deref(), quiet),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn compute(
    file: &std::path::Path,
    as_cohort: bool,
    out: Option<&std::path::Path>,
    quiet: bool,
) -> anyhow::Result<()> {
    let mut progress = |line: &str| {
        if !quiet {
            eprintln!("{line}");
        }
    };
    let done = run_case(file, as_cohort, out, &stop()?, &mut progress)?;
    progress(&done.to_string());
    Ok(())
}

fn stop() -> anyhow::Result<StopFlag> {
    StopFlag::on_signals().context("cannot catch signals")
}

fn measure(bench: Bench) -> anyhow::Result<()> {
    let report = |line: &str| eprintln!("{line}");
    match bench {
        Bench::Beat {
            nodes: Some(nodes),
            threads,
            beat,
            output,
        } => {
            let counts: Vec<kernels::Ranks<'_>> = threads
                .iter()
                .map(|n| kernels::Ranks::Threads(*n as usize))
                .collect();
            let timings = kernels::ventricle(&beat.bench(nodes)?, &counts, &stop()?, report)?;
            print!("{}", kernels::text_of(&timings, output.json)?);
            anyhow::ensure!(
                timings.iter().all(|t| t.diverged.is_none()),
                "the beat did not reach its end"
            );
            Ok(())
        }
        Bench::Beat { output, .. } => output.print(&kernels::beat()?),
        Bench::Periodic(output) => output.print(&kernels::periodic()?),
        Bench::Cell(output) => output.print(&kernels::cell()?),
        Bench::Strategies { seeds, output } => {
            let comparison = kernels::strategies(seeds, |row| {
                eprintln!("{}: {:?} done", row.case, row.strategy)
            })?;
            output.print_as(&comparison, |comparison| comparison.table())
        }
        Bench::Shortcuts {
            nodes,
            threads,
            beat,
            output,
        } => {
            let found =
                kernels::shortcuts(&beat.bench(nodes)?, threads as usize, &stop()?, report)?;
            output.print_as(&found, ToString::to_string)
        }
        Bench::Orchestration(_) | Bench::Dashboard(_) | Bench::Slurm(_) | Bench::Sleepers(_) => {
            unreachable!("measured without kernels")
        }
    }
}
