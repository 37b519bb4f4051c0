//! `cardiotwin-worker`: executes one task, or runs benchmarks.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_worker::bench;
use cardiotwin_worker::benchmark::run_benchmark;
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::memory::return_large_blocks;
use cardiotwin_worker::opencarp;
use cardiotwin_worker::program::{code_of, log, make_folder, read_task, restarting};
use cardiotwin_worker::provenance::VERSION_TEXT;
use cardiotwin_worker::run::{run_attempt, simulate};
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::tasks::proposal::in_one_fibre;
use clap::{Parser, Subcommand, ValueEnum};
use tracing::Level;

#[derive(Parser)]
#[command(name = "cardiotwin-worker", version = VERSION_TEXT, about = "Execute one task of a cardiotwin run")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Claim an attempt, execute its task and publish outcome.json
    Run {
        /// Directory of the attempt, which contains spec.json
        directory: PathBuf,
        /// Do not write progress to stderr
        #[arg(long)]
        quiet: bool,
    },
    /// Execute a task without a claim and print its outcome as JSON
    Simulate {
        /// Specification of the task, a JSON file
        spec: PathBuf,
        /// Directory for traces, created if it does not exist
        #[arg(long)]
        out: PathBuf,
        /// Number of threads
        #[arg(long, default_value_t = 1)]
        threads: u32,
        /// Instructions of the cell engine: auto, portable, avx2 or avx512
        #[arg(long, default_value = "auto")]
        instruction_set: String,
        /// Simulated time between VTU files of a finite-element beat in OUT/vtu, ms; 0 for no files
        #[arg(long, value_name = "MS", default_value_t = 0.0)]
        vtu_every: f64,
        /// Replace the finite-element ventricle of a beat by a one-fibre ventricle of the same volumes, pressure and
        /// activation
        #[arg(long)]
        one_fibre: bool,
        /// Continue the search of step 2 from the checkpoints in another attempt's directory; only settings that
        /// determine the end of the search may differ
        #[arg(long, value_name = "DIR")]
        restart: Option<PathBuf>,
        /// Generation from which --restart continues [default: the last one]
        #[arg(long, requires = "restart")]
        generation: Option<u64>,
    },
    /// Compute a mechanics benchmark from a file: mesh, material, supports and loads in, displacements of probes and cavity
    /// volumes out (docs/benchmark-runner.md)
    Benchmark {
        /// The benchmark, in TOML
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
    /// Write models, mesh and activation times of simulations in openCARP formats (docs/formats.md)
    Opencarp {
        /// Specifications of organ beats, JSON files
        #[arg(required = true, value_name = "SPEC.json")]
        specs: Vec<PathBuf>,
        /// Folder for the files, created if it does not exist
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Measure a kernel: medians after a warm-up; with --nodes, a beat in 3D and what it is made of
    Bench {
        /// Which kernel
        kernel: Kernel,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// With `beat`: a generated 3D ventricle of about so many nodes; minutes for tens of thousands
        #[arg(long, value_name = "N")]
        nodes: Option<usize>,
        /// With --nodes: threads, each with a part of the mesh; several numbers, such as 1,2, are measured one after the other
        #[arg(long, alias = "ranks", requires = "nodes", default_value = "1", value_name = "R", value_delimiter = ',',
              value_parser = clap::value_parser!(u32).range(1..=1024))]
        threads: Vec<u32>,
        /// With --nodes: linear elements with nodal volume change, or with a plain penalty (the paper's)
        #[arg(long, requires = "nodes", value_enum, default_value_t = Elements::Linear)]
        element: Elements,
        /// With --nodes: length of the beat; the default is whole
        #[arg(long, requires = "nodes", value_name = "MS", default_value_t = 659.0)]
        cycle: f64,
        /// With --nodes: time step
        #[arg(long, requires = "nodes", value_name = "MS", default_value_t = 1.0)]
        step: f64,
        /// With --nodes: relative tolerance of Newton's method
        #[arg(long, requires = "nodes", default_value_t = 1e-4)]
        tolerance: f64,
        /// Seeds of each row of `strategies`
        #[arg(long, default_value_t = 10)]
        seeds: u64,
    },
}

#[derive(Clone, Copy, ValueEnum)]
enum Elements {
    Linear,
    Pointwise,
}

#[derive(Clone, Copy, ValueEnum)]
enum Kernel {
    /// One beat of the reduced ventricle at 1 ms steps; of the 3D ventricle with --nodes
    Beat,
    /// The periodic beat of the base model at 2 ms steps, as a fit to traces asks for it
    Periodic,
    /// One evaluation of the 0D cell, in batches and one by one
    Cell,
    /// Step 2's strategies on the same targets: minutes
    Strategies,
    /// With --nodes: each shortcut of the 3D beat's time steps, off and on, beside a tight run
    Shortcuts,
}

fn main() -> ExitCode {
    return_large_blocks();
    match execute(Cli::parse().command) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            code_of(&error)
        }
    }
}

fn execute(command: Command) -> anyhow::Result<ExitCode> {
    let stop = StopFlag::on_signals().context("cannot catch signals")?;
    match command {
        Command::Run { directory, quiet } => {
            log(if quiet { Level::WARN } else { Level::INFO });
            run_attempt(&directory, None, &stop, !quiet)?;
        }
        Command::Simulate {
            spec,
            out,
            threads,
            instruction_set,
            vtu_every,
            one_fibre,
            restart,
            generation,
        } => {
            log(Level::INFO);
            let task = read_task(&spec)?;
            let task = if one_fibre { in_one_fibre(task)? } else { task };
            make_folder(&out)?;
            let instruction_set = serde_json::from_value(instruction_set.clone().into()).with_context(|| {
                format!("--instruction-set {instruction_set}: expected auto, portable, avx2 or avx512")
            })?;
            let checkpoints = match restart {
                Some(other) => restarting(&out, &other, generation)?,
                None => Checkpoints::none(),
            };
            let stop = stop.clone();
            let plain = Context::plain(&out, threads);
            let context = Context {
                instruction_set,
                checkpoints,
                vtu_every_ms: vtu_every,
                stop,
                ..plain
            };
            let outcome = simulate(&task, context);
            println!("{}", serde_json::to_string_pretty(&outcome)?);
        }
        Command::Benchmark {
            file,
            as_cohort,
            out,
            quiet,
        } => {
            let mut progress = |line: &str| {
                if !quiet {
                    eprintln!("{line}");
                }
            };
            let done = run_benchmark(&file, as_cohort, out.as_deref(), &stop, &mut progress)?;
            progress(&done.to_string());
        }
        Command::Opencarp { specs, out } => {
            make_folder(&out)?;
            let beat = |file: &PathBuf| match read_task(file)? {
                TaskSpec::OrganBeat(spec) => Ok(*spec),
                _ => anyhow::bail!("{}: not the specification of an organ beat", file.display()),
            };
            let specs = specs.iter().map(beat).collect::<anyhow::Result<Vec<_>>>()?;
            for file in opencarp::write(&specs, &out)? {
                println!("{}", file.display());
            }
        }
        Command::Bench {
            kernel,
            json,
            nodes: Some(nodes),
            threads,
            element,
            cycle,
            step,
            tolerance,
            ..
        } => {
            let positive = [
                ("--cycle", cycle),
                ("--step", step),
                ("--tolerance", tolerance),
            ];
            for (name, value) in positive {
                anyhow::ensure!(
                    value > 0.0 && value.is_finite(),
                    "{name} {value}: expected a positive number"
                );
            }
            let element = match element {
                Elements::Linear => bench::Element::Linear,
                Elements::Pointwise => bench::Element::Pointwise,
            };
            let what = bench::VentricleBench {
                nodes,
                element,
                cycle_ms: cycle,
                step_ms: step,
                diastolic_step_ms: 0.0,
                tolerance,
            };
            let report = |word: &str| eprintln!("{word}");
            match kernel {
                Kernel::Beat => {
                    let counts: Vec<bench::Ranks<'_>> = threads
                        .iter()
                        .map(|n| bench::Ranks::Threads(*n as usize))
                        .collect();
                    let timings = bench::ventricle(&what, &counts, &stop, report)?;
                    print!("{}", bench::told(&timings, json)?);
                    anyhow::ensure!(
                        timings.iter().all(|t| t.diverged.is_none()),
                        "the beat did not reach its end"
                    );
                }
                Kernel::Shortcuts => {
                    let most = threads.iter().copied().max().unwrap_or(1) as usize;
                    let found = bench::shortcuts(&what, most, &stop, report)?;
                    if json {
                        println!("{}", serde_json::to_string(&found)?);
                    } else {
                        print!("{found}");
                    }
                }
                _ => anyhow::bail!("--nodes: only `beat` and `shortcuts` have a 3D ventricle"),
            }
        }
        Command::Bench {
            kernel,
            json,
            seeds,
            ..
        } => {
            let timing = match kernel {
                Kernel::Beat => serde_json::to_value(bench::beat()?)?,
                Kernel::Periodic => serde_json::to_value(bench::periodic()?)?,
                Kernel::Cell => serde_json::to_value(bench::cell()?)?,
                Kernel::Shortcuts => {
                    anyhow::bail!(
                        "shortcuts are those of a 3D beat: say --nodes, such as --nodes 2000"
                    )
                }
                Kernel::Strategies => {
                    let comparison = bench::strategies(seeds, |row| {
                        eprintln!("{}: {:?} done", row.case, row.strategy)
                    })?;
                    if !json {
                        print!("{}", comparison.table());
                        return Ok(ExitCode::SUCCESS);
                    }
                    serde_json::to_value(comparison)?
                }
            };
            if json {
                println!("{timing}");
            } else {
                let entries = timing.as_object().into_iter().flatten();
                entries.for_each(|(name, value)| println!("{name:<40}{value}"));
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}
