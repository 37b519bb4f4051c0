//! Data go to stdout, talk to stderr; colour never says anything that the words do not.

use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

use clap::ValueEnum;
use serde::Serialize;

use super::error::CliError;

/// When to use colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ColourChoice {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// A colour with a meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// Failed, error.
    Bad,
    /// Stalled, warning.
    Doubtful,
    /// Done.
    Good,
    /// Less important.
    Quiet,
}

impl Tone {
    fn ansi(self) -> &'static str {
        match self {
            Self::Bad => "\x1b[31m",
            Self::Doubtful => "\x1b[33m",
            Self::Good => "\x1b[32m",
            Self::Quiet => "\x1b[2m",
        }
    }
}

/// Set once stdout has no reader any more.
static READER_LEFT: AtomicBool = AtomicBool::new(false);

/// How this program speaks to whoever called it.
#[derive(Debug, Clone, Copy)]
pub struct Talk {
    /// Colour on stdout.
    pub colour_out: bool,
    /// Colour on stderr.
    pub colour_err: bool,
    /// Say only errors.
    pub quiet: bool,
    /// Draw bars on stderr.
    pub bars: bool,
}

impl Talk {
    /// Looks at the terminal and the environment.
    #[must_use]
    pub fn new(colour: ColourChoice, quiet: bool) -> Self {
        let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let dumb = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
        let wanted = |terminal: bool| match colour {
            ColourChoice::Always => true,
            ColourChoice::Never => false,
            ColourChoice::Auto => terminal && !no_colour && !dumb,
        };
        let stderr = std::io::stderr().is_terminal();
        Self {
            colour_out: wanted(std::io::stdout().is_terminal()),
            colour_err: wanted(stderr),
            quiet,
            bars: stderr && !dumb && !quiet,
        }
    }

    /// Data, as they are.
    ///
    /// # Errors
    /// When stdout cannot be written. A reader that has left (`| head`) is no error: the command goes on to its own exit code
    /// ([`Talk::reader_left`]).
    pub fn data(&self, text: &str) -> Result<(), CliError> {
        let mut out = std::io::stdout().lock();
        match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {
                READER_LEFT.store(true, Ordering::Relaxed);
                Ok(())
            }
            result => result.map_err(|source| CliError::Io {
                what: "cannot write to stdout",
                source,
            }),
        }
    }

    /// Whether the reader of stdout has left: what is written for nobody need not go on.
    #[must_use]
    pub fn reader_left() -> bool {
        READER_LEFT.load(Ordering::Relaxed)
    }

    /// Data as JSON for machines.
    ///
    /// # Errors
    /// As [`Talk::data`].
    pub fn json<T: Serialize>(&self, value: &T) -> Result<(), CliError> {
        let text = serde_json::to_string_pretty(value).map_err(|error| CliError::Io {
            what: "cannot write JSON",
            source: error.into(),
        })?;
        self.data(&format!("{text}\n"))
    }

    /// Talk, unless it should be quiet.
    pub fn say(&self, text: &str) {
        if !self.quiet {
            // Nobody listens where stderr is closed.
            let _ = writeln!(std::io::stderr().lock(), "{text}");
        }
    }

    /// An error, always said: the chain of its causes in one line.
    pub fn error(&self, error: &dyn std::error::Error) {
        let mut text = error.to_string();
        let mut cause = error.source();
        while let Some(inner) = cause {
            let words = inner.to_string();
            // Transparent wrappers repeat their cause.
            if !text.ends_with(&words) {
                text.push_str(": ");
                text.push_str(&words);
            }
            cause = inner.source();
        }
        let _ = writeln!(
            std::io::stderr().lock(),
            "{}: {text}",
            paint(self.colour_err, Tone::Bad, "error")
        );
    }

    /// A hint about what to do next.
    pub fn hint(&self, text: &str) {
        self.say(&format!(
            "{}: {text}",
            paint(self.colour_err, Tone::Quiet, "hint")
        ));
    }
}

/// `text` in a colour where `on`.
#[must_use]
pub fn paint(on: bool, tone: Tone, text: &str) -> String {
    if on {
        format!("{}{text}\x1b[0m", tone.ansi())
    } else {
        text.to_owned()
    }
}

/// `1 error`, `2 errors`.
#[must_use]
pub fn count(n: usize, thing: &str) -> String {
    if n == 1 {
        format!("1 {thing}")
    } else {
        format!("{n} {thing}s")
    }
}
