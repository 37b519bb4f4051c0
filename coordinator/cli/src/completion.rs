//! Completion of commands, options, patients and steps: the shell asks the program itself.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use cardiotwin_engine::Reader;
use cardiotwin_input::patients_of;
use clap::{Arg, Command};
use clap_complete::CompletionCandidate;
use clap_complete::engine::ArgValueCompleter;
use clap_complete::env::{CompleteEnv, Shells};

use crate::place::{Folders, is_cohort};

/// Variable by which the shell's script asks.
const VARIABLE: &str = "CARDIOTWIN_COMPLETE";
/// Steps that `rerun --from` takes.
const STEPS: [&str; 7] = [
    "step0",
    "step1",
    "targets",
    "step2",
    "verification",
    "step3",
    "posterior",
];

/// Answers a shell that asks, and then ends the program.
pub fn answer(command: fn() -> Command) {
    CompleteEnv::with_factory(command).var(VARIABLE).complete();
}

/// The script that makes a shell ask; `None` for an unknown shell.
pub fn script(shell: &str) -> Option<std::io::Result<String>> {
    let shells = Shells::builtins();
    let shell = shells.completer(shell)?;
    let mut text = Vec::new();
    let written = shell.write_registration(
        VARIABLE,
        "cardiotwin",
        "cardiotwin",
        "cardiotwin",
        &mut text,
    );
    Some(written.map(|()| String::from_utf8_lossy(&text).into_owned()))
}

/// The command with completers at the arguments that name patients and steps.
pub fn with_completers(command: Command) -> Command {
    command
        .mut_args(with_completer)
        .mut_subcommands(with_completers)
}

fn with_completer(arg: Arg) -> Arg {
    let name = arg
        .get_value_names()
        .and_then(<[_]>::first)
        .map_or("", |name| name.as_str());
    match name {
        "PATIENT" => arg.add(ArgValueCompleter::new(patients)),
        "PATIENT|COHORT" => arg.add(ArgValueCompleter::new(patients_and_folders)),
        "STEP" => arg.add(ArgValueCompleter::new(steps)),
        _ => arg,
    }
}

fn steps(begun: &OsStr) -> Vec<CompletionCandidate> {
    candidates(STEPS.map(str::to_owned), begun)
}

fn patients(begun: &OsStr) -> Vec<CompletionCandidate> {
    let words: Vec<OsString> = std::env::args_os()
        .skip_while(|word| word != "--")
        .collect();
    candidates(names(&cohort_among(&words)), begun)
}

fn patients_and_folders(begun: &OsStr) -> Vec<CompletionCandidate> {
    use clap_complete::engine::{PathCompleter, ValueCompleter as _};
    let words: Vec<OsString> = std::env::args_os().collect();
    match option(&words, "--cohort") {
        Some(_) => patients(begun),
        None => PathCompleter::dir().complete(begun),
    }
}

fn candidates(words: impl IntoIterator<Item = String>, begun: &OsStr) -> Vec<CompletionCandidate> {
    let begun = begun.to_string_lossy().into_owned();
    let fitting = words.into_iter().filter(|word| word.starts_with(&begun));
    fitting.map(CompletionCandidate::new).collect()
}

/// Value of an option among the words that are typed so far.
fn option(words: &[OsString], name: &str) -> Option<PathBuf> {
    let after = words.windows(2).find(|pair| pair[0] == name);
    let joined = words.iter().find_map(|word| {
        let text = word.to_str()?.strip_prefix(name)?.strip_prefix('=')?;
        Some(PathBuf::from(text))
    });
    after.map(|pair| PathBuf::from(&pair[1])).or(joined)
}

/// The cohort and run among the words; those of the current directory if none is named.
fn cohort_among(words: &[OsString]) -> Folders {
    let named = option(words, "--cohort");
    let positional = || words.iter().map(PathBuf::from).find(|word| is_cohort(word));
    let folder = named.or_else(positional).unwrap_or_else(|| ".".into());
    Folders::of(&folder, option(words, "--run-dir").as_deref())
}

/// Names of the patients: of the cohort's folder, or else of the run.
fn names(folders: &Folders) -> Vec<String> {
    let cohort = folders.cohort.as_deref().filter(|folder| is_cohort(folder));
    match cohort {
        Some(cohort) => patients_of(cohort)
            .into_iter()
            .map(|(name, _)| name)
            .collect(),
        None => names_in_run(&folders.run).unwrap_or_default(),
    }
}

fn names_in_run(run: &Path) -> Option<Vec<String>> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .ok()?;
    let status = runtime.block_on(async { Reader::open(run).await?.status().await });
    let patients = status.ok()?.patients.into_iter();
    Some(patients.map(|patient| patient.patient).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cohort with two patients.
    fn cohort() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join("cohort.toml"),
            "name = 'c'\npatients = 'hearts'\n",
        )
        .unwrap();
        for name in ["01-CoA", "02-CoA", ".hidden"] {
            std::fs::create_dir_all(folder.path().join("hearts").join(name)).unwrap();
        }
        folder
    }

    #[test]
    fn patients_are_those_of_the_named_cohort() {
        let folder = cohort();
        let path = folder.path().as_os_str().to_owned();
        let joined = OsString::from(format!("--cohort={}", folder.path().display()));
        for words in [
            vec!["show".into(), "--cohort".into(), path.clone()],
            vec!["show".into(), joined],
            vec!["check".into(), path, "--patient".into()],
        ] {
            let found = names(&cohort_among(&words));
            assert_eq!(found, ["01-CoA", "02-CoA"], "{words:?}");
        }
        let elsewhere = names(&cohort_among(&["show".into()]));
        assert_eq!(elsewhere, Vec::<String>::new(), "no cohort here");
    }

    #[test]
    fn only_words_that_go_on_with_what_is_typed_are_offered() {
        let offered = |begun: &str| -> Vec<String> {
            let of = |one: &CompletionCandidate| one.get_value().to_string_lossy().into_owned();
            steps(OsStr::new(begun)).iter().map(of).collect()
        };
        assert_eq!(offered("step"), ["step0", "step1", "step2", "step3"]);
        assert_eq!(offered("ver"), ["verification"]);
        assert_eq!(offered("x"), Vec::<String>::new());
    }

    #[test]
    fn every_step_is_one_that_rerun_takes() {
        for step in STEPS {
            assert!(step.parse::<cardiotwin_engine::Stage>().is_ok(), "{step}");
        }
    }
}
