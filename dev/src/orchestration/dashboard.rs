//! The dashboard next to a large run: the built program, and headless Chromium as its reader.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cardiotwin_chromium::{Browser, Look, Page};
use cardiotwin_engine::StopSignal;
use clap::Args;
use serde::Serialize;
use serde_json::Value;

use super::local::{self, BenchOptions};
use crate::arguments::Output;

/// Patients that the run gets while the page is open, in each round.
const NEW_IN_A_ROUND: usize = 5;
const ROUNDS: usize = 20;
/// Loads of the page.
const LOADS: usize = 9;

/// Arguments of `cardiotwin-dev bench dashboard`.
#[derive(Debug, Args)]
pub struct DashboardArgs {
    /// Number of patients
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(200..))]
    patients: u32,
    /// Seconds for which the idle server and the idle browser are watched
    #[arg(long, value_name = "S", default_value_t = 30)]
    idle_s: u64,
    /// The coordinator's executable [default: cardiotwin next to this program]
    #[arg(long, value_name = "PATH")]
    program: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

/// Figures of a dashboard.
#[derive(Debug, Serialize)]
struct Figures {
    patients: u32,
    /// First paint of each load, ms after the navigation began, sorted.
    first_paint_ms: Vec<f64>,
    /// Time at which the table of the cohort was drawn, ms after the navigation began, sorted.
    cohort_drawn_ms: Vec<f64>,
    /// Rows in the document with all patients in the table.
    rows_in_document: u64,
    /// Time from a patient's change of state to its row in the page, ms, sorted.
    delay_ms: Vec<f64>,
    /// Time of a frame while the table is scrolled from end to end, ms, sorted.
    frame_ms: Vec<f64>,
    /// Share of a core that the server takes while a page is open and nothing happens.
    idle_share: f64,
    /// Share of a core that the server takes without a page.
    alone_share: f64,
}

/// A process that is killed at the end.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Measures the dashboard and prints the figures.
///
/// # Errors
/// Errors of the engine or the browser; no Chromium in `PATH`; no program to measure.
pub fn measure(args: &DashboardArgs) -> anyhow::Result<()> {
    let browser = Browser::find()
        .context("no Chromium in PATH: `make deps` installs it, and this measurement needs it")?;
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    let run_dir = scratch.path().join("run");
    let n = args.patients as usize;
    let first = n - ROUNDS * NEW_IN_A_ROUND;
    run(&run_dir, first)?;

    let (server, url) = serve(&args.program()?, &run_dir)?;
    let look = Look {
        width: 1300,
        height: 900,
        dark: false,
    };
    let mut page = browser.open(&url, look)?;
    page.wait_for(&format!(
        "document.querySelector('[role=table]').ariaRowCount == {}",
        first + 1
    ))?;
    let delay_ms = delays(&mut page, &run_dir, n)?;
    let (mut first_paint_ms, mut cohort_drawn_ms) = (Vec::new(), Vec::new());
    for _ in 0..LOADS {
        page.call("Page.reload", serde_json::json!({"ignoreCache": true}))?;
        let drawn = "performance.getEntriesByName('cohort')[0]?.startTime";
        cohort_drawn_ms.extend(page.wait_for(drawn)?.as_f64());
        let painted = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime";
        first_paint_ms.extend(page.wait_for(painted)?.as_f64());
    }
    let rows = page.value("document.querySelectorAll('.row').length")?;
    let frames = page.value(SCROLL)?;
    let idle_share = share(server.0.id(), args.idle_s)?;
    anyhow::ensure!(page.complaints()?.is_empty(), "{:?}", page.complaints()?);
    drop(page);
    std::thread::sleep(Duration::from_secs(1));
    let alone_share = share(server.0.id(), args.idle_s)?;
    let figures = Figures {
        patients: args.patients,
        first_paint_ms: sorted(first_paint_ms),
        cohort_drawn_ms: sorted(cohort_drawn_ms),
        rows_in_document: rows.as_u64().unwrap_or_default(),
        delay_ms,
        frame_ms: sorted(numbers(&frames)),
        idle_share,
        alone_share,
    };
    args.output.print_as(&figures, text)
}

impl DashboardArgs {
    fn program(&self) -> anyhow::Result<PathBuf> {
        let own = std::env::current_exe().context("this program has no path")?;
        let program = self
            .program
            .clone()
            .unwrap_or_else(|| own.with_file_name("cardiotwin"));
        anyhow::ensure!(
            program.is_file(),
            "{} is not there: build it, or name it with --program",
            program.display()
        );
        Ok(program)
    }
}

/// Frames of a scroll through the whole table.
const SCROLL: &str = "new Promise((resolve) => {
  const body = document.querySelector('#patients .tbody'), times = [], n = 120;
  let k = 0, last = null;
  const step = (now) => {
    if (last !== null) times.push(now - last);
    last = now;
    if (k++ > n) return resolve(times);
    body.scrollTop = (body.scrollHeight - body.clientHeight) * k / n;
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})";

/// Runs no-op patients up to the `n`th; those that are done stay so.
fn run(run_dir: &Path, n: usize) -> anyhow::Result<()> {
    let options = BenchOptions {
        run_dir: run_dir.to_owned(),
        patients: n,
        spawn: false,
        workers: 1,
        worker: None,
        victim: None,
    };
    super::runtime()?.block_on(local::once(&options, StopSignal::new()))?;
    Ok(())
}

fn serve(program: &Path, run_dir: &Path) -> anyhow::Result<(Server, String)> {
    let mut child = Command::new(program)
        .arg("--quiet")
        .arg("dashboard")
        .arg(run_dir)
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {}", program.display()))?;
    let out = child.stdout.take().context("a child without a pipe")?;
    let mut url = String::new();
    BufReader::new(out).read_line(&mut url)?;
    Ok((Server(child), url.trim().to_owned()))
}

/// Delays between changes of patients and their rows in the page, ms, sorted. The page itself
/// compares its clock with the coordinator's, which is the same machine's.
fn delays(page: &mut Page, run_dir: &Path, n: usize) -> anyhow::Result<Vec<f64>> {
    page.value(
        "import('/cohort.js').then(({ onUpdate, run }) => {
           globalThis.delays = [];
           onUpdate((changed) => { for (const name of changed) delays.push(Date.now() - run.patients.get(name).since_ms); });
         })",
    )?;
    for round in (0..ROUNDS).rev() {
        let until = n - round * NEW_IN_A_ROUND;
        run(run_dir, until)?;
        page.wait_for(&format!(
            "document.querySelector('[data-state=done]')?.textContent === '● {until} done'"
        ))?;
        // Rounds begin at different times between two questions to the database.
        std::thread::sleep(Duration::from_millis(37 * round as u64 % 250));
    }
    Ok(sorted(numbers(&page.value("delays")?)))
}

/// Share of a core that a process takes.
fn share(pid: u32, seconds: u64) -> anyhow::Result<f64> {
    let began = (Instant::now(), cpu_s(pid)?);
    std::thread::sleep(Duration::from_secs(seconds));
    Ok((cpu_s(pid)? - began.1) / began.0.elapsed().as_secs_f64())
}

/// Processor time of a process so far, s.
fn cpu_s(pid: u32) -> anyhow::Result<f64> {
    let mut all = 0.0;
    // Nanoseconds on a core come first in a thread's file; clock ticks would be too coarse.
    for task in std::fs::read_dir(format!("/proc/{pid}/task"))? {
        let text = std::fs::read_to_string(task?.path().join("schedstat")).unwrap_or_default();
        let ns: f64 = text
            .split(' ')
            .next()
            .and_then(|word| word.parse().ok())
            .unwrap_or_default();
        all += ns * 1e-9;
    }
    Ok(all)
}

fn numbers(values: &Value) -> Vec<f64> {
    let values = values.as_array().map_or(&[][..], Vec::as_slice);
    values.iter().filter_map(Value::as_f64).collect()
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

fn text(figures: &Figures) -> String {
    let median_and_last = |values: &[f64]| {
        let last = values.last().copied().unwrap_or(f64::NAN);
        let median = values.get(values.len() / 2).copied().unwrap_or(f64::NAN);
        format!(
            "median {median:7.1} ms, largest {last:7.1} ms of {}",
            values.len()
        )
    };
    let lines = [
        ("patients", figures.patients.to_string()),
        ("first paint", median_and_last(&figures.first_paint_ms)),
        ("cohort drawn", median_and_last(&figures.cohort_drawn_ms)),
        ("rows in the document", figures.rows_in_document.to_string()),
        ("delay of an update", median_and_last(&figures.delay_ms)),
        ("frame while scrolling", median_and_last(&figures.frame_ms)),
        (
            "idle, page open",
            format!("{:.2} % of a core", 100.0 * figures.idle_share),
        ),
        (
            "idle, no page",
            format!("{:.2} % of a core", 100.0 * figures.alone_share),
        ),
    ];
    lines
        .iter()
        .map(|(name, value)| format!("{name:<24}{value}\n"))
        .collect()
}
