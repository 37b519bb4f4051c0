//! Output of the program: data go to stdout, messages to stderr. Colour never adds information to
//! the words. Control characters of input files, logs, worker messages and names of folders never
//! reach a terminal.
//!
//! Our own colours are marks within a text, and become control characters when it is written: a name
//! cannot bring a colour of its own.

use std::borrow::Cow;
use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

pub use cardiotwin_report::table::Tone;
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

/// Each tone with the character that begins it within a text, to which Unicode assigns no meaning, and
/// with its colour: red, yellow, green, dim.
const TONES: [(Tone, char, &str); 4] = [
    (Tone::Bad, '\u{fdd0}', "\x1b[31m"),
    (Tone::Doubtful, '\u{fdd1}', "\x1b[33m"),
    (Tone::Good, '\u{fdd2}', "\x1b[32m"),
    (Tone::Quiet, '\u{fdd3}', "\x1b[2m"),
];
/// Character that ends a tone within a text.
const END: char = '\u{fdd4}';
/// Sequence that ends a colour.
const PLAIN: &str = "\x1b[0m";

/// Set once the reader of stdout has closed the pipe.
static READER_LEFT: AtomicBool = AtomicBool::new(false);

/// Settings of the program's output.
#[derive(Debug, Clone, Copy)]
pub struct Talk {
    /// Whether stdout is coloured.
    pub colour_out: bool,
    /// Whether stderr is coloured.
    pub colour_err: bool,
    /// Whether only errors are printed on stderr.
    pub quiet: bool,
    /// Whether progress bars are drawn on stderr.
    pub bars: bool,
}

impl Talk {
    /// Settings for the terminal and the environment of this process.
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

    /// Writes data to stdout: without control characters to a terminal, and else unchanged but for
    /// colours that were asked for.
    ///
    /// # Errors
    /// Stdout cannot be written. A reader that has closed the pipe (`| head`) is no error: the
    /// command continues to its own exit code ([`Talk::reader_left`]).
    pub fn data(&self, text: &str) -> Result<(), CliError> {
        let mut out = std::io::stdout().lock();
        let text = if out.is_terminal() {
            harmless(text)
        } else {
            Cow::Borrowed(text)
        };
        let text = match self.colour_out {
            true => coloured(&text),
            false => text,
        };
        Self::write(&mut out, &text)
    }

    fn write(out: &mut std::io::StdoutLock<'_>, text: &str) -> Result<(), CliError> {
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

    /// Whether the reader of stdout has closed the pipe, so that a command that repeats its output
    /// may end.
    #[must_use]
    pub fn reader_left() -> bool {
        READER_LEFT.load(Ordering::Relaxed)
    }

    /// Writes a value to stdout as JSON.
    ///
    /// # Errors
    /// The same as for [`Talk::data`].
    pub fn json<T: Serialize>(&self, value: &T) -> Result<(), CliError> {
        let text = serde_json::to_string_pretty(value).map_err(|error| CliError::Io {
            what: "cannot write JSON",
            source: error.into(),
        })?;
        self.data(&format!("{text}\n"))
    }

    /// Prints a message on stderr, unless the program is quiet.
    pub fn say(&self, text: &str) {
        if !self.quiet {
            self.insist(text);
        }
    }

    /// Prints a message on stderr, even if the program is quiet.
    pub fn insist(&self, text: &str) {
        // A closed stderr is ignored because nobody can read the message.
        let text = harmless(text);
        let text = match self.colour_err {
            true => coloured(&text),
            false => text,
        };
        let _ = writeln!(std::io::stderr().lock(), "{text}");
    }

    /// Prints an error with the chain of its causes in one line, even if the program is quiet.
    pub fn error(&self, error: &dyn std::error::Error) {
        self.insist(&format!(
            "{}: {}",
            paint(self.colour_err, Tone::Bad, "error"),
            with_causes(error)
        ));
    }

    /// Prints a hint about the next command.
    pub fn hint(&self, text: &str) {
        self.say(&format!(
            "{}: {text}",
            paint(self.colour_err, Tone::Quiet, "hint")
        ));
    }
}

/// An error with the chain of its causes in one line, outermost first.
#[must_use]
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        let words = inner.to_string();
        // Transparent wrappers repeat the text of their cause.
        if !text.ends_with(&words) {
            text.push_str(": ");
            text.push_str(&words);
        }
        cause = inner.source();
    }
    text
}

/// `text` in the tone if `on`, with marks that become colours when it is written.
#[must_use]
pub fn paint(on: bool, tone: Tone, text: &str) -> String {
    match TONES.iter().find(|(one, ..)| on && *one == tone) {
        Some((_, mark, _)) => format!("{mark}{text}{END}"),
        None => text.to_owned(),
    }
}

/// `text` with the marks of tones as control sequences of a terminal.
#[must_use]
pub fn coloured(text: &str) -> Cow<'_, str> {
    let colour = |c: char| TONES.iter().find(|(_, mark, _)| *mark == c);
    if !text.chars().any(|c| c == END || colour(c).is_some()) {
        return Cow::Borrowed(text);
    }
    let mut written = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match colour(c) {
            Some((.., sequence)) => written.push_str(sequence),
            None if c == END => written.push_str(PLAIN),
            None => written.push(c),
        }
    }
    Cow::Owned(written)
}

/// `text` with each control character but newline and tab as `\\u001b`.
#[must_use]
pub fn harmless(text: &str) -> Cow<'_, str> {
    let is_harmless = |c: char| !c.is_control() || matches!(c, '\n' | '\t');
    if text.chars().all(is_harmless) {
        return Cow::Borrowed(text);
    }
    let mut clean = String::with_capacity(text.len());
    for c in text.replace("\r\n", "\n").chars() {
        match is_harmless(c) {
            true => clean.push(c),
            false => clean.push_str(&format!("\\u{:04x}", u32::from(c))),
        }
    }
    Cow::Owned(clean)
}

/// A number with its noun, such as `1 error` or `2 errors`.
#[must_use]
pub fn count(n: usize, thing: &str) -> String {
    if n == 1 {
        format!("1 {thing}")
    } else {
        format!("{n} {thing}s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_our_colours_kept() {
        let sound = "P_max 120 mmHg\n\tü";
        assert!(matches!(harmless(sound), Cow::Borrowed(_)));
        let painted = paint(true, Tone::Bad, "failed");
        assert_eq!(coloured(&harmless(&painted)), "\x1b[31mfailed\x1b[0m");
        assert_eq!(paint(false, Tone::Bad, "failed"), "failed");
        // A name may not bring a colour, not even one of ours.
        let named = paint(true, Tone::Bad, "e\x1b[32mvil");
        assert_eq!(
            coloured(&harmless(&named)),
            "\x1b[31me\\u001b[32mvil\x1b[0m"
        );
        assert_eq!(harmless("a\r\nb"), "a\nb");
        assert_eq!(
            harmless("\x1b]0;title\x07 \x1b[2J \u{9b}31m a\rb \x7f"),
            r"\u001b]0;title\u0007 \u001b[2J \u009b31m a\u000db \u007f"
        );
    }
}
