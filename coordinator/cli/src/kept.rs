//! Options of `run` that a run keeps, so that the next one continues with them.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_engine::{Chosen, Reader, StoreError};

use super::error::CliError;
use super::talk::Talk;

/// Name of all kept options.
const ALL: &str = "all";

/// Choice that a run keeps; `None` where there is no run or it keeps none.
///
/// # Errors
/// Errors of the store, other than a missing one.
pub async fn chosen(run_dir: &Path) -> Result<Option<Chosen>, CliError> {
    match Reader::open(run_dir).await {
        Ok(reader) => Ok(reader.chosen().await?),
        Err(StoreError::Missing { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Assignments `key=value` that a run keeps.
///
/// # Errors
/// As [`chosen`].
pub async fn assignments(run_dir: &Path) -> Result<Vec<String>, CliError> {
    let kept = chosen(run_dir).await?.unwrap_or_default().set;
    Ok(as_assignments(&kept))
}

/// Options of a command over those that its run keeps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Choice {
    /// Choice of the last command in this run; `None` where there is no run or it keeps none.
    pub before: Option<Chosen>,
    /// Kept options that still apply, whether given again or not.
    pub kept: BTreeMap<String, String>,
    /// Value of every chosen option, which the run keeps from now on.
    pub set: BTreeMap<String, String>,
}

/// Options `given` over those that the run keeps, without those of `unset`. Says which kept ones
/// apply.
///
/// # Errors
/// As [`chosen`] and [`without`].
pub async fn choose(
    run_dir: &Path,
    unset: &[String],
    given: &[String],
    talk: &Talk,
) -> Result<Choice, CliError> {
    let before = chosen(run_dir).await?;
    let kept = before
        .as_ref()
        .map_or_else(BTreeMap::new, |c| c.set.clone());
    let kept = without(kept, unset)?;
    say(&kept, given, talk);
    Ok(Choice {
        before,
        set: with(kept.clone(), given),
        kept,
    })
}

/// As assignments `key=value`.
#[must_use]
pub fn as_assignments(kept: &BTreeMap<String, String>) -> Vec<String> {
    kept.iter()
        .map(|(key, value)| format!("{key}={value}"))
        .collect()
}

/// Kept options without those of `unset`; without any for `all`.
///
/// # Errors
/// [`CliError::Usage`] for an option that the run does not keep.
fn without(
    mut kept: BTreeMap<String, String>,
    unset: &[String],
) -> Result<BTreeMap<String, String>, CliError> {
    for key in unset {
        if key == ALL {
            kept.clear();
        } else if kept.remove(key).is_none() {
            let known: Vec<&str> = kept.keys().map(String::as_str).collect();
            let known = match known[..] {
                [] => "this run keeps no options".to_owned(),
                _ => format!("this run keeps {}", known.join(", ")),
            };
            return Err(CliError::Usage(format!("--unset {key}: {known}")));
        }
    }
    Ok(kept)
}

/// Kept options with the assignments `given` in the place of theirs.
fn with(mut kept: BTreeMap<String, String>, given: &[String]) -> BTreeMap<String, String> {
    for assignment in given {
        if let Some((key, value)) = assignment.split_once('=') {
            kept.insert(key.trim().to_owned(), value.trim().to_owned());
        }
    }
    kept
}

/// Says which kept options apply, because they are not given again.
fn say(kept: &BTreeMap<String, String>, given: &[String], talk: &Talk) {
    let given = with(BTreeMap::new(), given);
    let silent: Vec<String> = kept
        .iter()
        .filter(|(key, _)| !given.contains_key(*key))
        .map(|(key, value)| format!("{key}={value}"))
        .collect();
    if !silent.is_empty() {
        talk.say(&format!(
            "saved options: {} (--unset KEY drops one, --unset all drops them)",
            silent.join(", ")
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(assignments: &[&str]) -> Vec<String> {
        assignments.iter().map(|&a| a.to_owned()).collect()
    }

    #[test]
    fn a_given_option_replaces_the_kept_one_and_unset_drops_it() {
        let kept = with(BTreeMap::new(), &given(&["a.b=1", "c=x=y"]));
        assert_eq!(as_assignments(&kept), ["a.b=1", "c=x=y"]);
        let kept = with(kept, &given(&["a.b = 2"]));
        assert_eq!(as_assignments(&kept), ["a.b=2", "c=x=y"]);
        let kept = without(kept, &given(&["c"])).unwrap();
        assert_eq!(as_assignments(&kept), ["a.b=2"]);
        assert_eq!(without(kept.clone(), &given(&["all"])).unwrap(), [].into());
        let said = without(kept, &given(&["d"])).unwrap_err().to_string();
        assert_eq!(said, "--unset d: this run keeps a.b");
    }
}
