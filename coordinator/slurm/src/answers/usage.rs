//! Answers of `sacct` about what jobs used: processor time and energy.

use super::{NoAnswer, Output, Table};
use crate::job::number;

/// Requested columns. The name comes last because it may contain any character.
pub const COLUMNS: &str = "JobID,JobIDRaw,ElapsedRaw,AllocCPUS,TotalCPU,ConsumedEnergyRaw,JobName";

/// What one run of a job, or of an array's element, used.
#[derive(Debug, Clone, PartialEq)]
pub struct UsageRow {
    /// Number as the user sees it: `4711`, or `4711_2` for an element.
    pub id: String,
    /// Time from start to end \[s\].
    pub elapsed_s: u64,
    /// Number of processors that Slurm counts for the job: cores, or threads where the site shares cores.
    pub n_processors: u64,
    /// Processor time of all steps \[s\].
    pub processor_s: f64,
    /// Energy \[J\]; `None` where the site does not measure it.
    pub energy_j: Option<f64>,
}

impl UsageRow {
    /// Processor time that the job could have used \[s\].
    #[must_use]
    pub fn available_s(&self) -> f64 {
        self.elapsed_s as f64 * self.n_processors as f64
    }
}

/// Processor time \[s\] of `MM:SS.mmm`, `HH:MM:SS` or `D-HH:MM:SS`.
fn processor_time(text: &str) -> Option<f64> {
    let (days, clock) = match text.split_once('-') {
        Some((days, clock)) => (number::<u64>(days)? as f64, clock),
        None => (0.0, text),
    };
    let parts: Vec<&str> = clock.split(':').collect();
    let (seconds, above) = parts.split_last()?;
    let seconds: f64 = seconds.parse().ok().filter(|s: &f64| *s >= 0.0)?;
    let minutes = above.iter().try_fold(0.0, |sum, part| {
        Some(60.0 * sum + number::<u64>(part)? as f64)
    })?;
    (1..=2)
        .contains(&above.len())
        .then_some(86_400.0 * days + 60.0 * minutes + seconds)
}

/// Reads the answer to [`crate::commands::usage`]. Rows of steps are left out: a job's row has their sum.
///
/// # Errors
/// [`NoAnswer`] if there is no accounting, its daemon is down, or the output is not the requested
/// table.
pub fn read(output: &Output) -> Result<Table<UsageRow>, NoAnswer> {
    let header = format!("{}|", COLUMNS.replace(',', "|"));
    let table = super::table("sacct", output, &header, "", "|", |cells| {
        let [id, _, elapsed, n_processors, processor, energy, _] = cells else {
            return None;
        };
        Some(UsageRow {
            id: (*id).to_owned(),
            elapsed_s: number(elapsed)?,
            n_processors: number(n_processors)?,
            processor_s: processor_time(processor)?,
            // A site without a meter writes nothing or 0.
            energy_j: number::<u64>(energy).filter(|j| *j > 0).map(|j| j as f64),
        })
    })?;
    let is_job = |row: &UsageRow| !row.id.contains('.');
    Ok(Table {
        rows: table.rows.into_iter().filter(is_job).collect(),
        ..table
    })
}

#[cfg(test)]
mod tests {
    use super::super::{NoAnswer, recorded};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn real_jobs_have_the_sum_of_their_steps() {
        let table = read(&recorded::output("sacct-usage")).expect("sacct answered");
        assert!(table.is_whole(), "{:?}", table.unreadable);
        assert!(
            table.rows.iter().any(|row| row.id.contains('_')),
            "elements"
        );
        assert!(
            table.rows.iter().all(|row| !row.id.contains('.')),
            "no steps"
        );
        // Two steps of 12 and 6 s, one after another, on one of two processors.
        let busy = table.rows.iter().find(|row| row.processor_s > 10.0);
        let busy = busy.expect("the busy job");
        assert_eq!((busy.n_processors, busy.energy_j), (2, None));
        assert!(
            (0.3..0.55).contains(&(busy.processor_s / busy.available_s())),
            "{busy:?}"
        );
    }

    #[test]
    fn times_as_slurm_writes_them() {
        for (text, seconds) in [
            ("00:13.374", Some(13.374)),
            ("01:02:03", Some(3723.0)),
            ("2-01:02:03", Some(176_523.0)),
            ("", None),
            ("7", None),
            ("1:-2", None),
        ] {
            assert_eq!(processor_time(text), seconds, "{text}");
        }
    }

    #[test]
    fn accounting_that_is_down_is_no_job_without_costs() {
        assert!(matches!(
            read(&recorded::output("sacct-no-slurmdbd")),
            Err(NoAnswer::Failed { .. })
        ));
    }

    proptest! {
        #[test]
        fn no_text_panics(odd in "\\PC{0,40}|[0-9:.-]{0,30}") {
            let _ = processor_time(&odd);
        }
    }
}
