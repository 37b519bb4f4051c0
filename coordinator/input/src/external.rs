//! Checks of `[solver.external]`, and hashes of the files that it names.

use std::path::{Path, PathBuf};

use cardiotwin_schemas::external::{
    COMMAND_PLACEHOLDERS, ExternalSettings, PlaceholderError, expand,
};
use cardiotwin_schemas::settings::{Fidelity, Settings};
use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::Problem;

use super::complaint::Complaint;
use super::hashed::hash;
use super::nearest::nearest;
use super::report::Report;

/// Quantities that `results.igb` may name.
const QUANTITIES: [&str; 3] = ["Sa_kPa", "lambda", "Ca_uM"];

/// Problems of an external solver's settings; empty if another solver is selected.
pub(super) fn complaints(settings: &Settings) -> Vec<Complaint> {
    if settings.solver.fidelity != Fidelity::External {
        return vec![];
    }
    let external = &settings.solver.external;
    let mut list = List(vec![]);
    list.command(external);
    for name in external
        .files
        .keys()
        .filter(|name| COMMAND_PLACEHOLDERS.contains(&name.as_str()))
    {
        let expected = format!("a name other than {}", COMMAND_PLACEHOLDERS.join(", "));
        list.add(
            &format!("files.{name}"),
            format!("the name `{name}`"),
            &expected,
            "give the file another name",
        );
    }
    for (made, template) in &external.templates {
        let key = format!("templates.{made}");
        list.inside(&key, made);
        if !external.files.contains_key(template) {
            let remedy = nearest(template, external.files.keys().map(String::as_str))
                .map_or("name the template's file there".to_owned(), |meant| {
                    format!("did you mean `{meant}`?")
                });
            list.add(
                &key,
                format!("`{template}`"),
                "a name of solver.external.files",
                &remedy,
            );
        }
    }
    let results = &external.results;
    let named = [
        ("traces", Some(&results.traces)),
        ("nodal", Some(&results.nodal)),
    ];
    let more = [
        ("activation", results.activation.as_ref()),
        ("weights", results.weights.as_ref()),
    ];
    for (key, name) in named.into_iter().chain(more) {
        if let Some(name) = name {
            list.inside(&format!("results.{key}"), name);
        }
    }
    for (quantity, name) in &results.igb {
        let key = format!("results.igb.{quantity}");
        list.inside(&key, name);
        if !QUANTITIES.contains(&quantity.as_str()) {
            list.add(
                &key,
                format!("`{quantity}`"),
                &format!("one of {}", QUANTITIES.join(", ")),
                "use one of these",
            );
        }
    }
    for quantity in QUANTITIES.into_iter().take(2) {
        if !results.igb.is_empty() && !results.igb.contains_key(quantity) {
            let remedy = "name the file, or leave results.igb empty for nodal traces in CSV";
            list.add(
                "results.igb",
                format!("no {quantity}"),
                "Sa_kPa and lambda, and Ca_uM if there is calcium",
                remedy,
            );
        }
    }
    let codes = &external.exit_codes;
    let all = [
        ("input", &codes.input),
        ("site", &codes.site),
        ("numerics", &codes.numerics),
        ("bug", &codes.bug),
    ];
    for (idx, (class, listed)) in all.iter().enumerate() {
        for code in listed.iter() {
            let key = format!("exit_codes.{class}");
            if !(1..=255).contains(code) {
                list.add(
                    &key,
                    code.to_string(),
                    "an exit code from 1 to 255",
                    "0 is success",
                );
            } else if let Some((other, _)) =
                all[..idx].iter().find(|(_, before)| before.contains(code))
            {
                list.add(
                    &key,
                    format!("{code}, which is {other}, too"),
                    "each code once",
                    "remove it from one of them",
                );
            }
        }
    }
    list.0
}

struct List(Vec<Complaint>);

impl List {
    fn add(&mut self, key: &str, found: impl Into<String>, expected: &str, remedy: &str) {
        self.0.push(Complaint {
            key: format!("solver.external.{key}"),
            against: Some("solver.fidelity".to_owned()),
            found: found.into(),
            expected: expected.to_owned(),
            remedy: remedy.to_owned(),
        });
    }

    fn command(&mut self, external: &ExternalSettings) {
        if external
            .command
            .first()
            .is_none_or(|program| program.trim().is_empty())
        {
            let expected = "a program and its arguments";
            let remedy =
                "for example command = [\"python3\", \"{model}\", \"{parameters}\", \"{out}\"]";
            self.add("command", "nothing", expected, remedy);
        }
        let known = || {
            COMMAND_PLACEHOLDERS
                .into_iter()
                .chain(external.files.keys().map(String::as_str))
        };
        for word in &external.command {
            let found = format!("`{word}`");
            match expand(word, |name| {
                known().any(|known| known == name).then(String::new)
            }) {
                Ok(_) => {}
                Err(PlaceholderError::Unknown { name, .. }) => {
                    let names: Vec<String> = known().map(|name| format!("{{{name}}}")).collect();
                    let remedy = nearest(&name, known()).map_or_else(
                        || {
                            "name the file in solver.external.files, or write {{ for a brace"
                                .to_owned()
                        },
                        |meant| format!("did you mean {{{meant}}}?"),
                    );
                    self.add(
                        "command",
                        found,
                        &format!("placeholders among {}", names.join(", ")),
                        &remedy,
                    );
                }
                Err(PlaceholderError::Brace { .. }) => {
                    self.add(
                        "command",
                        found,
                        "braces in pairs around a name",
                        "write {{ or }} for a brace",
                    );
                }
            }
        }
    }

    /// Checks that a name is a path inside the folder in which the solver runs.
    fn inside(&mut self, key: &str, name: &str) {
        let path = Path::new(name);
        let plain = path
            .components()
            .all(|part| matches!(part, std::path::Component::Normal(_)));
        if name.is_empty() || !plain {
            let expected = "a file inside the solver's folder";
            self.add(
                key,
                format!("`{name}`"),
                expected,
                "give a relative path without `..`",
            );
        }
    }
}

/// Path of one of the solver's files: in the patient's folder if it exists there, otherwise in the
/// cohort's.
pub(super) fn file(name: &str, patient_folder: &Path, cohort_folder: &Path) -> PathBuf {
    let own = patient_folder.join(name);
    if own.exists() {
        own
    } else {
        cohort_folder.join(name)
    }
}

/// The solver's files with their hashes, from the patient's folder if they exist there, otherwise
/// from the cohort's. A file that cannot be read becomes a problem in `report`, and the result is
/// `None`.
pub(super) fn files(
    settings: &Settings,
    patient_folder: &Path,
    cohort_folder: &Path,
    patient: &str,
    report: &mut Report,
) -> Option<Vec<InputFile>> {
    if settings.solver.fidelity != Fidelity::External {
        return Some(vec![]);
    }
    let mut found = vec![];
    for (name, file) in &settings.solver.external.files {
        let path = self::file(file, patient_folder, cohort_folder);
        if path.is_dir() {
            let problem = Problem::error(
                &path,
                "a folder",
                "a file",
                "name each file that the solver reads",
            )
            .at_key(format!("solver.external.files.{name}"));
            report.add(Some(patient), problem);
            return None;
        }
        found.push(hash(name, &path, patient, report)?);
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(change: impl FnOnce(&mut ExternalSettings)) -> Vec<String> {
        let mut settings = Settings::default();
        settings.solver.fidelity = Fidelity::External;
        let external = &mut settings.solver.external;
        external.command = ["python3", "{model}", "{parameters}", "--threads={threads}"]
            .map(str::to_owned)
            .into();
        external.files = [("model".to_owned(), "lv.py".to_owned())].into();
        change(external);
        complaints(&settings)
            .into_iter()
            .map(|c| c.key.replace("solver.external.", ""))
            .collect()
    }

    #[test]
    fn a_command_with_known_placeholders_is_accepted_and_others_are_named() {
        assert_eq!(keys(|_| {}), Vec::<String>::new());
        assert_eq!(keys(|s| s.command.clear()), ["command"]);
        assert_eq!(keys(|s| s.command.push("{modle}".into())), ["command"]);
        assert_eq!(keys(|s| s.command.push("{model".into())), ["command"]);
        assert_eq!(
            keys(|s| s.command.push("{{}}".into())),
            Vec::<String>::new()
        );
        assert_eq!(complaints(&Settings::default()), vec![], "another solver");
    }

    #[test]
    fn files_results_and_codes_that_cannot_be_are_named() {
        let files = |s: &mut ExternalSettings| drop(s.files.insert("out".into(), "x".into()));
        assert_eq!(keys(files), ["files.out"]);
        assert_eq!(
            keys(|s| drop(s.templates.insert("lv.par".into(), "par".into()))),
            ["templates.lv.par"]
        );
        assert_eq!(
            keys(|s| s.results.traces = "../traces.csv".into()),
            ["results.traces"]
        );
        let igb =
            |s: &mut ExternalSettings| drop(s.results.igb.insert("Sa_kPa".into(), "Sa.igb".into()));
        assert_eq!(keys(igb), ["results.igb"], "no stretch");
        assert_eq!(keys(|s| s.exit_codes.site = vec![0]), ["exit_codes.site"]);
        let twice = |s: &mut ExternalSettings| {
            s.exit_codes.site = vec![7];
            s.exit_codes.input = vec![7];
        };
        assert_eq!(keys(twice), ["exit_codes.site"]);
    }
}
