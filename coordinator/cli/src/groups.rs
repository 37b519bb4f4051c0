//! Headings of the commands in `cardiotwin --help`.

use clap::Command;

/// Every command under its heading, in the order in which a user meets them. A test compares the table
/// with the commands, so that a new one gets its place here.
const GROUPS: [(&str, &[&str]); 6] = [
    (
        "Begin",
        &["init", "prepare", "check", "mesh", "config", "doctor"],
    ),
    (
        "Personalise",
        &["run", "plan", "advance", "rerun", "retry", "cancel"],
    ),
    (
        "Look",
        &[
            "status",
            "dashboard",
            "show",
            "explain",
            "jobs",
            "logs",
            "compare",
            "report",
        ],
    ),
    (
        "Use twins",
        &[
            "predict",
            "elastance",
            "simulate",
            "discover",
            "fit",
            "sweep",
        ],
    ),
    (
        "Keep",
        &["export", "verify", "backup", "du", "clean", "archive"],
    ),
    (
        "This program",
        &["version", "completions", "man", "schemas", "help"],
    ),
];

/// Width of the column of names, with its margins.
const NAMES: usize = 15;
/// Width of the help without a terminal, and the largest one.
const WIDTH: usize = 100;
const WIDEST: usize = 110;

/// The command with its subcommands under headings, wrapped to `width`.
pub fn grouped(mut command: Command, width: usize) -> Command {
    // `help` exists once the command is built.
    let about_help = "Print the help of a command";
    let mut text = String::new();
    for (heading, names) in GROUPS {
        text.push_str(&format!("{heading}:\n"));
        for name in names {
            let about = command
                .find_subcommand(name)
                .and_then(Command::get_about)
                .map_or_else(|| about_help.to_owned(), ToString::to_string);
            text.push_str(&row(name, &about, width));
        }
        text.push('\n');
    }
    // Braces would be tags of the template.
    let text = text.replace(['{', '}'], "");
    command = command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{text}Options:\n{{options}}{{after-help}}"
    ));
    command
}

/// Name and description, wrapped within their columns.
fn row(name: &str, about: &str, width: usize) -> String {
    let mut lines = vec![format!("  {name}")];
    for word in about.split_whitespace() {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if line.chars().count() >= NAMES && line.chars().count() + 1 + word.chars().count() > width
        {
            lines.push(" ".repeat(NAMES) + word);
        } else if line.chars().count() < NAMES {
            let pad = NAMES - line.chars().count();
            line.push_str(&(" ".repeat(pad) + word));
        } else {
            line.push_str(&format!(" {word}"));
        }
    }
    lines.join("\n") + "\n"
}

/// Width of the terminal, or of `COLUMNS`, as clap wraps the rest of the help.
#[must_use]
pub fn width() -> usize {
    let of_terminal = || {
        let size = rustix::termios::tcgetwinsize(std::io::stdout()).ok()?;
        (size.ws_col > 0).then_some(usize::from(size.ws_col))
    };
    let of_environment = || std::env::var("COLUMNS").ok()?.parse().ok();
    of_terminal()
        .or_else(of_environment)
        .unwrap_or(WIDTH)
        .clamp(2 * NAMES, WIDEST)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn every_command_has_one_heading() {
        let names: Vec<&str> = GROUPS
            .iter()
            .flat_map(|(_, names)| *names)
            .copied()
            .collect();
        let once: BTreeSet<&str> = names.iter().copied().collect();
        assert_eq!(names.len(), once.len(), "a command under two headings");
        let command = crate::Cli::command();
        let there: BTreeSet<&str> = command
            .get_subcommands()
            .filter(|inner| !inner.is_hide_set())
            .map(Command::get_name)
            .chain(["help"])
            .collect();
        assert_eq!(once, there);
    }

    #[test]
    fn help_wraps_to_a_narrow_terminal() {
        let width = 60;
        let mut command = grouped(crate::Cli::command(), width).term_width(width);
        let help = command.render_help().to_string();
        let longest = help.lines().map(|line| line.chars().count()).max();
        assert!(longest.is_some_and(|n| n <= width), "{longest:?}\n{help}");
        for (heading, names) in GROUPS {
            assert!(
                help.contains(&format!("{heading}:\n  {}", names[0])),
                "{help}"
            );
        }
    }
}
