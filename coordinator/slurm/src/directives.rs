//! Options of every job that a site's profile or a cohort adds to the batch script.

/// Options of a script that follow from the job, each with the setting that decides it; `None` for
/// those without a setting.
const OWN: [(&str, Option<&str>); 26] = [
    ("job-name", None),
    ("account", Some("executor.slurm.account")),
    ("partition", Some("executor.slurm.queue")),
    ("qos", Some("executor.slurm.queue")),
    ("time", Some("executor.slurm.walltime")),
    ("time-min", Some("executor.slurm.walltime")),
    ("nodes", Some("executor.slurm.bundle_nodes")),
    ("ntasks", None),
    ("ntasks-per-node", Some("executor.ranks_per_node")),
    ("ntasks-per-core", None),
    ("cpus-per-task", Some("executor.threads")),
    ("exclusive", None),
    ("mem", Some("executor.slurm.memory_MiB")),
    ("mem-per-cpu", Some("executor.slurm.memory_MiB")),
    ("array", None),
    ("requeue", None),
    ("no-requeue", None),
    ("open-mode", None),
    ("export", None),
    ("export-file", None),
    ("signal", Some("executor.slurm.warning_s")),
    ("chdir", None),
    ("output", None),
    ("error", None),
    ("wrap", None),
    ("test-only", None),
];
/// Option that adds to the nodes on which jobs failed.
pub(crate) const EXCLUDE: &str = "--exclude=";

/// Reason why a directive of a profile or of the settings is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DirectiveError {
    /// Not a long option with at most one value.
    #[error(
        "expected an option such as --reservation=NAME, without blanks, quotes, '\\', '#' or '%'"
    )]
    Form,
    /// The script has this option already.
    #[error("every job has its own --{option}{}", .setting.map_or_else(String::new, |setting| format!("; change {setting} instead")))]
    Own {
        /// Name of the option.
        option: &'static str,
        /// Setting that decides it.
        setting: Option<&'static str>,
    },
}

/// Checks an option that a profile or the settings add to every script.
///
/// # Errors
/// [`DirectiveError`] if it is no option, or one that the script decides.
pub fn check_directive(text: &str) -> Result<(), DirectiveError> {
    let name = text.strip_prefix("--").ok_or(DirectiveError::Form)?;
    let (name, value) = name
        .split_once('=')
        .map_or((name, None), |(name, value)| (name, Some(value)));
    let is_name = name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.bytes().all(|b| b.is_ascii_lowercase() || b == b'-');
    if !is_name || value.is_some_and(|value| !can_stand_in_directive(value)) {
        return Err(DirectiveError::Form);
    }
    match OWN.iter().find(|(own, _)| *own == name) {
        Some((option, setting)) => Err(DirectiveError::Own {
            option,
            setting: *setting,
        }),
        None => Ok(()),
    }
}

/// Whether a text can stand on a `#SBATCH` line. Slurm splits these lines at blanks, interprets
/// quotes and `\`, and replaces `%`.
pub(crate) fn can_stand_in_directive(value: &str) -> bool {
    let bad =
        |c: char| c.is_whitespace() || c.is_control() || matches!(c, '"' | '\'' | '\\' | '#' | '%');
    !value.is_empty() && !value.chars().any(bad)
}

#[cfg(test)]
mod tests {
    use super::check_directive;

    #[test]
    fn a_directive_that_the_script_decides_is_refused_with_its_setting() {
        for good in [
            "--reservation=dev",
            "--constraint=rome&ssd",
            "--licenses=a:2",
            "--no-kill",
        ] {
            assert_eq!(check_directive(good), Ok(()), "{good}");
        }
        let said = |text: &str| check_directive(text).expect_err(text).to_string();
        assert_eq!(
            said("--time=01:00:00"),
            "every job has its own --time; change executor.slurm.walltime instead"
        );
        assert_eq!(said("--array=0-3"), "every job has its own --array");
        for bad in [
            "-p",
            "--",
            "reservation=dev",
            "--reservation=a b",
            "--comment=\"x\"",
            "--A=b",
            "--x=%j",
        ] {
            assert!(said(bad).starts_with("expected an option"), "{bad}");
        }
    }
}
