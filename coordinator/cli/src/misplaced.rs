//! Hints for an option that stands in the wrong place, or that is a setting.

use cardiotwin_schemas::settings::Settings;
use clap::error::{ContextKind, ContextValue, ErrorKind};

/// Where the unknown option of a call belongs; `None` if no command and no setting has it.
///
/// - `arguments`: those of the call, without the program's name
pub fn hint(
    error: &clap::Error,
    program: &clap::Command,
    arguments: impl Iterator<Item = String>,
) -> Option<String> {
    let invalid = error.get(ContextKind::InvalidArg);
    let is_from = |value: &ContextValue| value.to_string().starts_with("--from");
    if error.kind() == ErrorKind::ArgumentConflict && invalid.is_some_and(is_from) {
        return Some(
            "pressure and volume stand in one file, one sample a line; two files go into the folder \
             of a patient, which `cardiotwin init DIR` makes, as pressure.csv and volume.csv"
                .to_owned(),
        );
    }
    if error.kind() != ErrorKind::UnknownArgument {
        return None;
    }
    let ContextValue::String(unknown) = error.get(ContextKind::InvalidArg)? else {
        return None;
    };
    let name = unknown.strip_prefix("--")?.split('=').next()?;
    let words: Vec<String> = arguments.collect();
    let place = |word: &String| word.split('=').next() == Some(&format!("--{name}"));
    let at = words.iter().position(place)?;
    let is_command = |word: &&String| program.find_subcommand(word.as_str()).is_some();
    match words[..at].iter().find(is_command) {
        Some(command) => {
            let takes_set = |command: &clap::Command| takes(command, "set");
            let known = program.find_subcommand(command).filter(|c| takes_set(c))?;
            let key = setting(name)?;
            Some(format!(
                "this is a setting: `cardiotwin {} … --set {key}=VALUE`",
                known.get_name()
            ))
        }
        None => {
            let command = words[at..].iter().find(is_command)?;
            let known = program.find_subcommand(command)?;
            takes(known, name).then(|| {
                format!("options of a command stand after it: `cardiotwin {command} … --{name} …`")
            })
        }
    }
}

fn takes(command: &clap::Command, option: &str) -> bool {
    let mut arguments = command.get_arguments();
    arguments.any(|argument| argument.get_long() == Some(option))
}

/// The shortest key of the settings whose last part is this option, or else the kind of the table of
/// this name.
fn setting(option: &str) -> Option<String> {
    let name = option.replace('-', "_");
    let settings = serde_json::to_value(Settings::default()).expect("settings are JSON");
    let mut keys = Vec::new();
    collect(&settings, "", &mut keys);
    let of_name = keys
        .iter()
        .filter(|key| key.rsplit('.').next() == Some(name.as_str()));
    let kind = format!("{name}.kind");
    of_name
        .min_by_key(|key| (key.matches('.').count(), key.len()))
        .or_else(|| keys.iter().find(|key| **key == kind))
        .cloned()
}

fn collect(value: &serde_json::Value, path: &str, keys: &mut Vec<String>) {
    let serde_json::Value::Object(fields) = value else {
        keys.push(path.to_owned());
        return;
    };
    for (name, value) in fields {
        let dot = if path.is_empty() { "" } else { "." };
        collect(value, &format!("{path}{dot}{name}"), keys);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(call: &str) -> Option<String> {
        let words = || call.split_whitespace().map(str::to_owned);
        let with_name = std::iter::once("cardiotwin".to_owned()).chain(words());
        let error = crate::command()
            .try_get_matches_from(with_name)
            .unwrap_err();
        hint(&error, &crate::command(), words())
    }

    #[test]
    fn a_misplaced_option_and_a_setting_are_told_where_they_belong() {
        let before = said("--cohort c predict P1 --set phi=1").unwrap();
        assert!(
            before.ends_with("`cardiotwin predict … --cohort …`"),
            "{before}"
        );
        let setting = said("rerun P1 --from step1 --tolerance 0.1").unwrap();
        assert!(
            setting.ends_with("`cardiotwin rerun … --set step1.tolerance=VALUE`"),
            "{setting}"
        );
        let table = said("plan --executor=slurm c").unwrap();
        assert!(
            table.ends_with("`cardiotwin plan … --set executor.kind=VALUE`"),
            "{table}"
        );
        let twice = said("init my --from pressure.csv --from volume.csv").unwrap();
        assert!(
            twice.contains("which `cardiotwin init DIR` makes"),
            "{twice}"
        );
        for call in [
            "run c --nonsense",
            "--nonsense run c",
            "no-command --cohort c",
        ] {
            assert_eq!(said(call), None, "{call}");
        }
    }
}
