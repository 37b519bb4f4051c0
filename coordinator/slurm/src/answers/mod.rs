//! Parsers for the answers of Slurm's commands.
//!
//! They tolerate banners, cluster suffixes and cut output: a table is accepted only below its
//! header, and a row only with all its columns and its end. Lines that cannot be read are returned
//! as such, and no value is made up for them.

pub mod accounting;
pub mod config;
pub mod qos;
pub mod queue;
#[cfg(test)]
#[path = "../../tests/recorded/read.rs"]
pub(crate) mod recorded;
pub mod submit;
pub mod usage;

/// End of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// The command exited with this code.
    Code(i32),
    /// This signal killed the command.
    Signal(i32),
    /// The command exceeded its time limit.
    TimedOut,
}

/// Output of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Output {
    /// End of the command.
    pub exit: Exit,
    /// Standard output, with invalid UTF-8 replaced.
    pub stdout: String,
    /// Standard error, with invalid UTF-8 replaced.
    pub stderr: String,
}

/// Reason why an output is no answer. The state of the jobs is then unknown, not empty.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// The command ended with an exit code other than 0, by a signal, or at its time limit.
    #[error("{command} failed ({}): {said}", ended(*.exit))]
    Failed {
        /// Name of the command.
        command: &'static str,
        /// End of the command.
        exit: Exit,
        /// First line of standard error.
        said: String,
    },
    /// The command succeeded but did not print the expected header.
    #[error("{command} did not print the expected table but '{found}'")]
    NoHeader {
        /// Name of the command.
        command: &'static str,
        /// First line of standard output.
        found: String,
    },
}

impl NoAnswer {
    /// Whether `sacct` reports that there is no accounting at all.
    #[must_use]
    pub fn says_no_accounting(&self) -> bool {
        matches!(self, Self::Failed { said, .. } if said.contains("accounting storage is disabled"))
    }
}

fn ended(exit: Exit) -> String {
    match exit {
        Exit::Code(code) => format!("exit code {code}"),
        Exit::Signal(signal) => format!("killed by signal {signal}"),
        Exit::TimedOut => "timed out".to_owned(),
    }
}

/// Rows of a table, and the lines below its header that could not be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table<Row> {
    /// Rows that were read as a whole.
    pub rows: Vec<Row>,
    /// Lines that could not be read. The state of the jobs in them is unknown.
    pub unreadable: Vec<String>,
}

impl<Row> Table<Row> {
    /// Whether every row was read. Only then may a count of rows be taken for a count of jobs.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.unreadable.is_empty()
    }
}

/// Reads a table with columns separated by `|`, rows that end with `end`, and a last column that
/// may contain `|`. A line without its newline was cut. A cut header does not count as one, and a
/// cut row is unreadable, because a `|` in its last column looks like its end.
fn table<Row>(
    command: &'static str,
    output: &Output,
    header: &str,
    start: &str,
    end: &str,
    read: impl Fn(&[&str]) -> Option<Row>,
) -> Result<Table<Row>, NoAnswer> {
    if output.exit != Exit::Code(0) {
        let said = first_line(&output.stderr).to_owned();
        return Err(NoAnswer::Failed {
            command,
            exit: output.exit,
            said,
        });
    }
    let (whole, cut) = output
        .stdout
        .rsplit_once('\n')
        .unwrap_or(("", &output.stdout));
    let mut lines = whole
        .split('\n')
        .map(|line| line.strip_suffix('\r').unwrap_or(line));
    if !lines.any(|line| line == header) {
        return Err(NoAnswer::NoHeader {
            command,
            found: first_line(&output.stdout).to_owned(),
        });
    }
    let n_columns = header
        .strip_prefix(start)
        .and_then(|h| h.strip_suffix(end))
        .map_or(0, |h| h.split('|').count());
    let (mut rows, mut unreadable) = (Vec::new(), Vec::new());
    for line in lines.filter(|line| !line.trim().is_empty()) {
        let inner = line
            .strip_prefix(start)
            .and_then(|rest| rest.strip_suffix(end));
        let cells = inner.map(|inner| inner.splitn(n_columns, '|').collect::<Vec<_>>());
        match cells
            .filter(|cells| cells.len() == n_columns)
            .and_then(|cells| read(&cells))
        {
            Some(row) => rows.push(row),
            None => unreadable.push(line.to_owned()),
        }
    }
    if !cut.trim().is_empty() {
        unreadable.push(cut.to_owned());
    }
    Ok(Table { rows, unreadable })
}

fn first_line(text: &str) -> &str {
    text.lines()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("")
        .trim()
}
