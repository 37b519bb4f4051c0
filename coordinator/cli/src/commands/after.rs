//! `run --after`: jobs that wait for other jobs of Slurm.

use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};

use crate::error::CliError;

/// Option of `sbatch` that makes a job wait for others.
const DEPENDENCY: &str = "--dependency";

/// A job of Slurm, or an element of an array, as `sbatch --dependency` takes it.
pub fn job_number(text: &str) -> Result<String, String> {
    let is_number = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let (job, element) = text
        .split_once('_')
        .map_or((text, None), |(job, element)| (job, Some(element)));
    if is_number(job) && element.is_none_or(is_number) {
        Ok(text.to_owned())
    } else {
        Err("expected the number of a job, such as 4711 or 4711_3".to_owned())
    }
}

/// Settings whose jobs begin after those of `--after` have ended, whatever their ends were. The run does not keep this: Slurm
/// forgets ended jobs.
///
/// # Errors
/// [`CliError::Usage`] without Slurm, or where the directives have a dependency already.
pub fn with_dependency(
    mut executor: ExecutorSettings,
    after: &[String],
) -> Result<ExecutorSettings, CliError> {
    if after.is_empty() {
        return Ok(executor);
    }
    if executor.kind != ExecutorKind::Slurm {
        return Err(CliError::Usage(
            "--after waits for jobs of Slurm; this run uses local processes (executor.kind)"
                .to_owned(),
        ));
    }
    let directives = &mut executor.slurm.directives;
    if let Some(own) = directives.iter().find(|d| d.starts_with(DEPENDENCY)) {
        return Err(CliError::Usage(format!(
            "--after: executor.slurm.directives has `{own}` already; remove one of them"
        )));
    }
    directives.push(format!("{DEPENDENCY}=afterany:{}", after.join(":")));
    Ok(executor)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on_slurm() -> ExecutorSettings {
        ExecutorSettings {
            kind: ExecutorKind::Slurm,
            ..ExecutorSettings::default()
        }
    }

    #[test]
    fn jobs_wait_for_those_of_after() {
        let after = ["4711", "12_3"].map(|job| job_number(job).unwrap());
        let executor = with_dependency(on_slurm(), &after).unwrap();
        assert_eq!(
            executor.slurm.directives,
            ["--dependency=afterany:4711:12_3"]
        );
        assert_eq!(with_dependency(on_slurm(), &[]).unwrap(), on_slurm());
        for wrong in ["", "4711_", "_3", "4711:12", "job", "4711 "] {
            assert!(job_number(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn after_is_refused_without_slurm_and_next_to_another_dependency() {
        let after = ["4711".to_owned()];
        let refusal = |executor| with_dependency(executor, &after).unwrap_err().to_string();
        assert!(refusal(ExecutorSettings::default()).contains("executor.kind"));
        let mut executor = on_slurm();
        executor.slurm.directives = vec!["--dependency=singleton".to_owned()];
        assert!(refusal(executor).contains("`--dependency=singleton`"));
    }
}
