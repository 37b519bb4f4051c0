//! A file of scenarios: changes to try on every twin of a cohort.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::change::Change;
use crate::error::CliError;

/// A scenario: changes and the patients to apply them to.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Description in one sentence, for readers of the file.
    #[serde(default)]
    pub description: String,
    /// Changes in the syntax of `--set`.
    pub set: Vec<String>,
    /// Ids of patients; `None` stands for every patient with a twin.
    #[serde(default)]
    pub patients: Option<Vec<String>>,
}

/// The scenarios of a file, by name.
///
/// # Errors
/// [`CliError::File`] if the file cannot be read, [`CliError::Usage`] with the file and the
/// scenario if its content is invalid.
pub fn read(path: &Path) -> Result<BTreeMap<String, Scenario>, CliError> {
    let text = std::fs::read_to_string(path).map_err(CliError::file("read", path))?;
    let refuse = |problem: String| CliError::Usage(format!("{}: {problem}", path.display()));
    let found: BTreeMap<String, Scenario> =
        toml::from_str(&text).map_err(|error| refuse(error.to_string()))?;
    if found.is_empty() {
        return Err(refuse(
            "no scenario found; expected a table such as [stent] with set = [\"KEY=-20%\"]"
                .to_owned(),
        ));
    }
    for (name, scenario) in &found {
        changes(&scenario.set).map_err(|problem| refuse(format!("[{name}] {problem}")))?;
    }
    Ok(found)
}

/// Parses a list of changes.
///
/// # Errors
/// A message about the first invalid change, a quantity that is changed twice, or an empty list.
pub fn changes(set: &[String]) -> Result<Vec<Change>, String> {
    if set.is_empty() {
        return Err("no change found; expected KEY=VALUE or KEY=±N%".to_owned());
    }
    let changes = (set.iter().map(|text| text.parse())).collect::<Result<Vec<Change>, String>>()?;
    for (n, change) in changes.iter().enumerate() {
        if changes[..n].iter().any(|other| other.key() == change.key()) {
            return Err(format!(
                "{}: changed twice; give one change of each quantity",
                change.key()
            ));
        }
    }
    Ok(changes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_scenarios_is_read_and_its_mistakes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenarios.toml");
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read(&path).map_err(|error| error.to_string())
        };
        let found =
            said("[stent]\nset = [\"peripheral_resistance_mmHg_s_per_mL=-20%\"]\n").unwrap();
        assert_eq!(found["stent"].patients, None);
        let wrong = said("[stent]\nset = [\"P_max_mmHg=1\"]\n").unwrap_err();
        assert!(
            wrong.contains("[stent] P_max_mmHg: is a result of the beat"),
            "{wrong}"
        );
        let twice = said("[stent]\nset = [\"phi=1\", \"phi=+10%\"]\n").unwrap_err();
        assert!(twice.contains("[stent] phi: changed twice"), "{twice}");
        assert!(said("[stent]\nsets = []\n").unwrap_err().contains("sets"));
        assert!(said("").unwrap_err().contains("no scenario"));
    }
}
