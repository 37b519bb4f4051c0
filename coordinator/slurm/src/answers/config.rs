//! Answers of `scontrol show config`: the configuration of a site.

use super::{Exit, NoAnswer, Output, first_line};
use crate::job::number;

/// The part of a site's configuration on which decisions depend. A key that the site does not show
/// is `None`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SiteConfig {
    /// Version of Slurm, such as `22.05.8`.
    pub version: Option<String>,
    /// Name of the cluster.
    pub cluster: Option<String>,
    /// Upper bound of the array size. An index is at most one less; 0 means that arrays are not
    /// allowed.
    pub max_array_size: Option<u32>,
    /// Time for which squeue still shows an ended job, s.
    pub min_job_age_s: Option<u64>,
    /// Time between SIGTERM and SIGKILL, s.
    pub kill_wait_s: Option<u64>,
    /// Time by which a job may exceed its walltime, min; also `None` if it is unlimited.
    pub over_time_limit_min: Option<u64>,
    /// Whether jobs are requeued unless they ask otherwise.
    pub requeues_by_default: Option<bool>,
    /// Whether the site has a database for sacct.
    pub has_accounting: Option<bool>,
    /// Whether limits of QoS and associations are enforced.
    pub enforces_limits: Option<bool>,
}

/// Reads the answer to [`crate::commands::config`].
///
/// # Errors
/// [`NoAnswer`] if scontrol failed or the output is not a configuration.
pub fn read(output: &Output) -> Result<SiteConfig, NoAnswer> {
    let command = "scontrol show config";
    if output.exit != Exit::Code(0) {
        return Err(NoAnswer::Failed {
            command,
            exit: output.exit,
            said: first_line(&output.stderr).to_owned(),
        });
    }
    let mut lines = output.stdout.lines();
    if !lines.any(|line| line.starts_with("Configuration data as of ")) {
        return Err(NoAnswer::NoHeader {
            command,
            found: first_line(&output.stdout).to_owned(),
        });
    }
    let mut config = SiteConfig::default();
    for line in lines {
        if line.trim().is_empty() {
            break; // other sections follow, with keys of their own
        }
        let Some((key, value)) = line
            .split_once('=')
            .map(|(key, value)| (key.trim(), value.trim()))
        else {
            continue;
        };
        let counted = |unit: &str| number::<u64>(value.strip_suffix(unit).unwrap_or(value).trim());
        let said = (!value.is_empty() && value != "(null)").then(|| value.to_owned());
        match key {
            "SLURM_VERSION" => config.version = said,
            "ClusterName" => config.cluster = said,
            "MaxArraySize" => config.max_array_size = number(value),
            "MinJobAge" => config.min_job_age_s = counted("sec"),
            "KillWait" => config.kill_wait_s = counted("sec"),
            "OverTimeLimit" => config.over_time_limit_min = counted("min"),
            "JobRequeue" => config.requeues_by_default = number::<u8>(value).map(|n| n != 0),
            "AccountingStorageType" => {
                config.has_accounting = said.map(|kind| !kind.ends_with("/none"))
            }
            "AccountingStorageEnforce" => {
                config.enforces_limits = Some(
                    value
                        .split(',')
                        .any(|word| matches!(word, "limits" | "safe" | "all")),
                );
            }
            _ => {}
        }
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::super::{Exit, Output, recorded};
    use super::{SiteConfig, read};
    use proptest::prelude::*;

    #[test]
    fn a_real_configuration() {
        let expected = SiteConfig {
            version: Some("22.05.8".to_owned()),
            cluster: Some("one".to_owned()),
            max_array_size: Some(1001),
            min_job_age_s: Some(300),
            kill_wait_s: Some(5),
            over_time_limit_min: Some(0),
            requeues_by_default: Some(true),
            has_accounting: Some(true),
            enforces_limits: Some(true),
        };
        assert_eq!(read(&recorded::output("scontrol-config")), Ok(expected));
    }

    proptest! {
        #[test]
        fn no_text_panics_and_nothing_is_made_up(odd in "(\\PC|\n){0,200}") {
            let stdout = format!("Configuration data as of now\n{odd}");
            let config = read(&Output { exit: Exit::Code(0), stdout, stderr: String::new() }).expect("a header");
            prop_assert!(config == SiteConfig::default() || odd.contains('='));
            let without_header = Output { exit: Exit::Code(0), stdout: odd, stderr: String::new() };
            prop_assert!(read(&without_header).is_err());
        }
    }
}
