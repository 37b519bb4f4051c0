//! Recorded answers of a real Slurm, for tests.

use super::{Exit, Output};

/// The folder, also from the crate of the model of Slurm, whose tests read the same answers.
const FOLDER: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../coordinator/slurm/tests/recorded"
);

/// Exit code and output of a command, read from `tests/recorded/NAME.txt`.
pub fn output(name: &str) -> Output {
    let file = format!("{FOLDER}/{name}.txt");
    let text = std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("cannot read {file}: {e}"));
    let (head, rest) = text
        .split_once("--- stdout\n")
        .expect("a recorded answer has its stdout");
    let (stdout, stderr) = rest
        .split_once("--- stderr\n")
        .expect("a recorded answer has its stderr");
    let code = head
        .lines()
        .find_map(|line| line.strip_prefix("rc "))
        .expect("a recorded answer has its exit code");
    let code = code.parse().expect("an exit code is a number");
    Output {
        exit: Exit::Code(code),
        stdout: stdout.to_owned(),
        stderr: stderr.to_owned(),
    }
}

/// Names of all recorded answers that begin with `start`.
pub fn names(start: &str) -> Vec<String> {
    let mut names = std::fs::read_dir(FOLDER)
        .expect("the folder of recorded answers")
        .filter_map(|entry| {
            entry
                .ok()?
                .file_name()
                .to_str()?
                .strip_suffix(".txt")
                .map(str::to_owned)
        })
        .filter(|name| name.starts_with(start))
        .collect::<Vec<_>>();
    names.sort();
    names
}
