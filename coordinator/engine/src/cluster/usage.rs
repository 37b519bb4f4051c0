//! What jobs used, as the site's accounting knows it: processor time and energy.

use std::collections::HashMap;

use cardiotwin_slurm::access::{Installed, Scheduler as _};
use cardiotwin_slurm::answers::NoAnswer;
use cardiotwin_slurm::answers::usage::{UsageRow, read};
use cardiotwin_slurm::commands;
use cardiotwin_slurm::job::JobName;
use cardiotwin_store::JobCosts;

/// Use of one job or element, over all its runs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JobUsage {
    /// Processor time \[s\].
    pub processor_s: f64,
    /// Processor time that it could have used \[s\].
    pub available_s: f64,
    /// Energy \[J\]; `None` where the site does not measure it.
    pub energy_j: Option<f64>,
}

impl JobUsage {
    /// Processor time over what was available; `None` for a job that never ran.
    #[must_use]
    pub fn efficiency(&self) -> Option<f64> {
        (self.available_s > 0.0).then(|| self.processor_s / self.available_s)
    }

    /// Both together. Energy is known only if both know theirs.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self {
            processor_s: self.processor_s + other.processor_s,
            available_s: self.available_s + other.available_s,
            energy_j: self.energy_j.zip(other.energy_j).map(|(a, b)| a + b),
        }
    }

    fn of(row: &UsageRow) -> Self {
        Self {
            processor_s: row.processor_s,
            available_s: row.available_s(),
            energy_j: row.energy_j,
        }
    }
}

/// Asks Slurm's accounting once for all jobs, and returns what it knows by their numbers.
///
/// # Errors
/// [`NoAnswer`] without accounting, or if it does not answer.
pub async fn usage_of(costs: &JobCosts) -> Result<HashMap<String, JobUsage>, NoAnswer> {
    let mut names: Vec<&str> = costs.elements.iter().map(|one| &one.name[..]).collect();
    names.dedup();
    let names: Vec<JobName> = names
        .into_iter()
        .filter_map(|name| JobName::new(name).ok())
        .collect();
    let since_s = costs
        .elements
        .iter()
        .map(|one| one.intended_ms / 1000)
        .min();
    let command = commands::usage(&names, since_s.unwrap_or(0));
    let table = read(&Installed::default().ask(&command).await)?;
    Ok(by_number(&table.rows))
}

fn by_number(rows: &[UsageRow]) -> HashMap<String, JobUsage> {
    let mut found: HashMap<String, JobUsage> = HashMap::new();
    for row in rows {
        let usage = JobUsage::of(row);
        found
            .entry(row.id.clone())
            .and_modify(|all| *all = all.and(&usage))
            .or_insert(usage);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_a_requeued_job_count_together() {
        let run = |id: &str, elapsed_s, processor_s, energy_j| UsageRow {
            id: id.to_owned(),
            elapsed_s,
            n_processors: 4,
            processor_s,
            energy_j,
        };
        let found = by_number(&[
            run("7", 100, 300.0, Some(1e3)),
            run("7", 50, 0.0, Some(5e2)),
            run("8_1", 0, 0.0, None),
        ]);
        let requeued = found["7"];
        assert_eq!(requeued.efficiency(), Some(0.5));
        assert_eq!(requeued.energy_j, Some(1.5e3));
        assert_eq!(found["8_1"].efficiency(), None, "it never ran");
        assert_eq!(requeued.and(&found["8_1"]).energy_j, None);
    }
}
