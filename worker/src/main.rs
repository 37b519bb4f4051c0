//! `cardiotwin-worker`: executes one task.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::files::write_atomic;
use cardiotwin_worker::learn::law_file;
use cardiotwin_worker::memory::return_large_blocks;
use cardiotwin_worker::opencarp;
use cardiotwin_worker::program::{code_of, log, make_folder, read_law, read_task, restarting};
use cardiotwin_worker::provenance::VERSION_TEXT;
use cardiotwin_worker::run::{run_attempt, simulate, simulate_in_law};
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::tasks::proposal::in_one_fibre;
use clap::{Parser, Subcommand};
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
        /// Replace the finite-element ventricle of a beat by the law of the organ. This JSON file has a list `beats`
        /// of the objects `law` of outcomes of the organ's beats, and may have the law before them, `prior`
        #[arg(long, value_name = "FILE", conflicts_with = "one_fibre")]
        law: Option<PathBuf>,
        /// Continue the search of step 2 from the checkpoints in another attempt's directory; only settings that
        /// determine the end of the search may differ
        #[arg(long, value_name = "DIR")]
        restart: Option<PathBuf>,
        /// Generation from which --restart continues [default: the last one]
        #[arg(long, requires = "restart")]
        generation: Option<u64>,
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
    /// Learn the organ's law from finite-element beats and write a law file for further patients
    Learn {
        /// Patient and directory of the published attempt of a beat (may be given several times, oldest first)
        #[arg(long = "beat", required = true, num_args = 2, value_names = ["PATIENT", "DIR"])]
        beats: Vec<String>,
        /// Law file from which learning starts [default: the law of the program]
        #[arg(long, value_name = "FILE")]
        law: Option<PathBuf>,
        /// File to write
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
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
            law,
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
            let outcome = match law {
                Some(file) => simulate_in_law(&task, &read_law(&file)?, context),
                None => simulate(&task, context),
            };
            println!("{}", serde_json::to_string_pretty(&outcome)?);
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
        Command::Learn { beats, law, out } => {
            let beats: Vec<(String, PathBuf)> = beats
                .chunks(2)
                .map(|pair| (pair[0].clone(), PathBuf::from(&pair[1])))
                .collect();
            let file = law_file(&beats, law.as_deref())?;
            anyhow::ensure!(
                !file.organs.is_empty(),
                "none of the beats has samples of the organ's law"
            );
            let json = serde_json::to_vec_pretty(&file)?;
            write_atomic(&out, &json).with_context(|| format!("cannot write {}", out.display()))?;
            println!("{}", serde_json::to_string(&file.organs)?);
        }
    }
    Ok(ExitCode::SUCCESS)
}
