//! Exit codes of the program. `--help` and docs/operations.md list all of them.

use std::process::ExitCode;

/// Outcome of the program, as an exit code for scripts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// The command did everything that was requested.
    Ok,
    /// `check` found problems, or patients failed or were cancelled in a run.
    Problems,
    /// The command line is invalid.
    Usage,
    /// Cohort, patient files or settings are wrong, and nothing was run.
    Input,
    /// Another coordinator works on this run.
    Locked,
    /// The run's database is missing, damaged, of a newer version, or cannot be written.
    Store,
    /// A file, a directory or the worker's executable cannot be used.
    System,
    /// The run is done, but the twin of a patient is off: outside of the tolerances.
    Off,
    /// Jobs wait or run on a cluster; `advance` continues the run.
    Unfinished,
    /// A defect of the program.
    Bug,
    /// The program was stopped by Ctrl-C or SIGTERM; the same command continues.
    Interrupted,
}

impl Exit {
    /// All exit codes in ascending order.
    pub const ALL: [Self; 11] = [
        Self::Ok,
        Self::Problems,
        Self::Usage,
        Self::Input,
        Self::Locked,
        Self::Store,
        Self::System,
        Self::Off,
        Self::Unfinished,
        Self::Bug,
        Self::Interrupted,
    ];

    /// The number that the shell sees.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Problems => 1,
            Self::Usage => 2,
            Self::Input => 3,
            Self::Locked => 4,
            Self::Store => 5,
            Self::System => 6,
            Self::Off => 7,
            Self::Unfinished => 8,
            Self::Bug => 70,
            Self::Interrupted => 130,
        }
    }

    /// Meaning in a few words, as `--help` prints it.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Ok => "success",
            Self::Problems => {
                "`check` or `verify` found problems; patients of the run failed, were cancelled or \
                 refused"
            }
            Self::Usage => "invalid command line",
            Self::Input => {
                "`cohort.toml` or settings are wrong, or no patient is sound; nothing was run"
            }
            Self::Locked => "another coordinator works on this run",
            Self::Store => {
                "the run's database is missing, damaged, of a newer version, or cannot be written"
            }
            Self::System => "a file, a directory or the worker's executable cannot be used",
            Self::Off => {
                "the run is done, but the twin of at least one patient is off: outside of the \
                 tolerances"
            }
            Self::Unfinished => {
                "jobs are pending or running on a cluster; `advance` continues the \
                                 run"
            }
            Self::Bug => "a defect of cardiotwin; please report it",
            Self::Interrupted => "stopped by Ctrl-C or SIGTERM; the same command continues",
        }
    }

    /// The table of exit codes in `--help`.
    #[must_use]
    pub fn help() -> String {
        let mut text = "Exit codes:".to_owned();
        for exit in Self::ALL {
            text.push_str(&format!("\n  {:>3}  {}", exit.code(), exit.meaning()));
        }
        text
    }
}

/// Exit codes that each command may give, a defect aside. `docs/operations.md` has the same table, and
/// every end-to-end test holds the command that it calls to it.
#[cfg(test)]
const OF_COMMANDS: [(&[&str], &[Exit]); 14] = [
    (
        &["completions", "man", "schemas", "version"],
        &[Exit::Ok, Exit::Usage, Exit::System],
    ),
    (
        &[
            "status",
            "dashboard",
            "show",
            "jobs",
            "logs",
            "compare",
            "report",
            "backup",
            "du",
        ],
        &[Exit::Ok, Exit::Usage, Exit::Store, Exit::System],
    ),
    (
        &["export", "verify"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Store,
            Exit::System,
        ],
    ),
    (
        &["config", "plan", "explain"],
        &[
            Exit::Ok,
            Exit::Usage,
            Exit::Input,
            Exit::Store,
            Exit::System,
        ],
    ),
    (
        &["prepare", "fit"],
        &[Exit::Ok, Exit::Usage, Exit::Input, Exit::System],
    ),
    (
        &["check", "simulate", "predict", "elastance"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Input,
            Exit::Store,
            Exit::System,
        ],
    ),
    (
        &["mesh", "doctor", "init"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Input,
            Exit::System,
        ],
    ),
    (
        &["retry", "clean", "archive"],
        &[
            Exit::Ok,
            Exit::Usage,
            Exit::Locked,
            Exit::Store,
            Exit::System,
        ],
    ),
    (
        &["cancel"],
        &[
            Exit::Ok,
            Exit::Usage,
            Exit::Locked,
            Exit::Store,
            Exit::System,
            Exit::Unfinished,
        ],
    ),
    (
        &["rerun"],
        &[
            Exit::Ok,
            Exit::Usage,
            Exit::Input,
            Exit::Locked,
            Exit::Store,
            Exit::System,
            Exit::Unfinished,
        ],
    ),
    (
        &["discover"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Input,
            Exit::Locked,
            Exit::Store,
            Exit::System,
            Exit::Interrupted,
        ],
    ),
    (
        &["sweep"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Input,
            Exit::Locked,
            Exit::Store,
            Exit::System,
            Exit::Unfinished,
            Exit::Interrupted,
        ],
    ),
    (
        &["advance"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Input,
            Exit::Locked,
            Exit::Store,
            Exit::System,
            Exit::Off,
            Exit::Unfinished,
        ],
    ),
    (
        &["run"],
        &[
            Exit::Ok,
            Exit::Problems,
            Exit::Usage,
            Exit::Input,
            Exit::Locked,
            Exit::Store,
            Exit::System,
            Exit::Off,
            Exit::Unfinished,
            Exit::Interrupted,
        ],
    ),
];

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn docs_list_every_code_with_its_meaning() {
        let docs = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/operations.md");
        let docs = std::fs::read_to_string(docs).unwrap();
        for exit in Exit::ALL {
            let row = format!("| {} | {} |", exit.code(), exit.meaning());
            assert!(
                docs.contains(&row),
                "docs/operations.md lacks the row {row}"
            );
        }
    }

    #[test]
    fn docs_list_the_codes_of_every_command() {
        let docs = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/operations.md");
        let docs = std::fs::read_to_string(docs).unwrap();
        for (commands, exits) in OF_COMMANDS {
            let codes: Vec<String> = exits.iter().map(|exit| exit.code().to_string()).collect();
            let row = format!("| `{}` | {} |", commands.join("`, `"), codes.join(", "));
            assert!(
                docs.contains(&row),
                "docs/operations.md lacks the row {row}"
            );
        }
        let listed: Vec<&str> = OF_COMMANDS
            .iter()
            .flat_map(|(all, _)| *all)
            .copied()
            .collect();
        for command in crate::command().get_subcommands() {
            let is_listed = listed
                .iter()
                .filter(|name| **name == command.get_name())
                .count()
                == 1;
            assert!(is_listed || command.is_hide_set(), "{}", command.get_name());
        }
    }

    #[test]
    fn codes_are_distinct_and_in_order() {
        let codes = Exit::ALL.map(Exit::code);
        assert!(codes.windows(2).all(|pair| pair[0] < pair[1]), "{codes:?}");
    }
}
