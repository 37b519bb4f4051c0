//! Logging to stderr, as text or as JSON lines.

use clap::ValueEnum;
use tracing_subscriber::filter::EnvFilter;

/// How log lines look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Human,
    /// One JSON object a line.
    Json,
}

/// Starts logging. `CARDIOTWIN_LOG` (`debug`, `cardiotwin::engine=trace`, …) overrides `-v` and
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
        ",cardiotwin::cli::event_log=off"
    } else {
        ""
    };
    let default = format!("{level},sqlx=warn{events}");
    let filter =
        EnvFilter::try_from_env("CARDIOTWIN_LOG").unwrap_or_else(|_| EnvFilter::new(default));
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(colour);
    // A second start, as in tests, keeps the first subscriber.
    let _ = match format {
        LogFormat::Human => builder.try_init(),
        LogFormat::Json => builder.json().try_init(),
    };
}
