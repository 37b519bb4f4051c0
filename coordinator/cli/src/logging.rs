//! Logging to stderr, as text or as JSON lines.

use clap::ValueEnum;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// How log lines look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Human,
    /// One JSON object a line.
    Json,
}

/// Starts logging. `CARDIOTWIN_LOG` (`debug`, `cardiotwin_engine=trace`, …) overrides `-v` and
/// `--quiet`.
pub fn start(verbose: u8, quiet: bool, format: LogFormat, colour: bool) {
    let level = match (quiet, verbose) {
        (true, _) => "error",
        (false, 0) => "warn",
        (false, 1) => "info",
        (false, 2) => "debug",
        (false, _) => "trace",
    };
    // Without -v the watcher prints a sentence for each event, which would only be repeated here.
    let events = if verbose == 0 && matches!(format, LogFormat::Human) {
        ",cardiotwin::event_log=off"
    } else {
        ""
    };
    let default = format!("{level},sqlx=warn{events}");
    let said = std::env::var("CARDIOTWIN_LOG").unwrap_or_default();
    let filter: Targets = [said, default]
        .iter()
        .filter(|levels| !levels.is_empty())
        .find_map(|levels| levels.parse().ok())
        .unwrap_or_default();
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(colour);
    let lines = match format {
        LogFormat::Human => lines.boxed(),
        LogFormat::Json => lines.json().boxed(),
    };
    // A second start, as in tests, keeps the first subscriber.
    let _ = tracing_subscriber::registry()
        .with(lines.with_filter(filter))
        .try_init();
}
