//! Answers of `sacct`: past jobs from Slurm's database. It lags behind by seconds, may be down or
//! absent, and lists a requeued job more than once.

use super::{NoAnswer, Output, Table};
use crate::job::{Jobs, number};
use crate::state::{SlurmState, cancelled_by};
use crate::walltime;

/// Requested columns. The name comes last because it may contain any character.
pub const COLUMNS: &str = "JobID,JobIDRaw,State,ExitCode,Reason,Submit,Start,End,ElapsedRaw,NNodes,AllocCPUS,NodeList,Partition,QOS,JobName";

/// Exit of a job: the code of its script, or the signal that ended it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ExitCode {
    /// Exit code of the script.
    pub code: u8,
    /// Signal, or 0 if there was none. Slurm reports 125 here for a job out of memory, although
    /// that is no signal.
    pub signal: u8,
}

/// A job, or one run of a requeued job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AccountingRow {
    /// Job or jobs of the row.
    pub jobs: Jobs,
    /// Number of the job itself; `None` for collapsed rows.
    pub raw: Option<u64>,
    /// Name of the job.
    pub name: String,
    /// State of the job.
    pub state: SlurmState,
    /// User id of the canceller; `None` without a name.
    pub cancelled_by: Option<u32>,
    /// Exit of the job; `None` if it cannot be read.
    pub exit: Option<ExitCode>,
    /// Last reason that Slurm gave.
    pub reason: String,
    /// Time of submission, seconds since 1970.
    pub submitted: Option<i64>,
    /// Time of the start, seconds since 1970.
    pub start: Option<i64>,
    /// Time of the end, seconds since 1970.
    pub end: Option<i64>,
    /// Time from start to end, or until now for a running job \[s\]; `None` if it cannot be read.
    pub elapsed_s: Option<u64>,
    /// Number of nodes that the job was given; `None` if it cannot be read.
    pub n_nodes: Option<u32>,
    /// Number of cores that the job was given on all its nodes; `None` if it cannot be read.
    pub n_cores: Option<u32>,
    /// Names of the nodes in Slurm's compressed notation; empty if none were assigned.
    pub nodes: String,
    /// Name of the partition.
    pub partition: String,
    /// Name of the QoS.
    pub qos: String,
}

/// Reads the answer to [`crate::commands::accounting`].
///
/// # Errors
/// [`NoAnswer`] if there is no accounting, its daemon is down, or the output is not the requested
/// table.
pub fn read(output: &Output) -> Result<Table<AccountingRow>, NoAnswer> {
    let header = format!("{}|", COLUMNS.replace(',', "|"));
    super::table("sacct", output, &header, "", "|", |cells| {
        let [
            id,
            raw,
            state,
            exit,
            reason,
            submit,
            start,
            end,
            elapsed,
            n_nodes,
            n_cores,
            nodes,
            partition,
            qos,
            name,
        ] = cells
        else {
            return None;
        };
        if state.is_empty() || name.is_empty() {
            return None;
        }
        let n_exit = exit
            .split_once(':')
            .map(|(code, signal)| (number::<u8>(code), number::<u8>(signal)));
        Some(AccountingRow {
            jobs: Jobs::parse(id)?,
            raw: number(raw),
            name: (*name).to_owned(),
            state: SlurmState::parse(state),
            cancelled_by: cancelled_by(state),
            exit: n_exit.and_then(|(code, signal)| {
                Some(ExitCode {
                    code: code?,
                    signal: signal?,
                })
            }),
            reason: (*reason).to_owned(),
            submitted: walltime::instant(submit),
            start: walltime::instant(start),
            end: walltime::instant(end),
            elapsed_s: number(elapsed),
            n_nodes: number(n_nodes),
            n_cores: number(n_cores),
            nodes: if *nodes == "None assigned" {
                String::new()
            } else {
                (*nodes).to_owned()
            },
            partition: (*partition).to_owned(),
            qos: (*qos).to_owned(),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Exit, NoAnswer, Output, recorded};
    use super::{COLUMNS, ExitCode, read};
    use crate::state::SlurmState;
    use proptest::prelude::*;

    #[test]
    fn real_endings() {
        let table = read(&recorded::output("sacct-ended")).expect("sacct answered");
        assert!(table.is_whole(), "{:?}", table.unreadable);
        let row = |name: &str| {
            table
                .rows
                .iter()
                .find(|row| row.name == name)
                .unwrap_or_else(|| panic!("{name}"))
        };
        let exit = |code, signal| Some(ExitCode { code, signal });
        assert_eq!(
            (&row("ct-short").state, row("ct-short").exit),
            (&SlurmState::Completed, exit(0, 0))
        );
        assert_eq!(
            (&row("ct-exit3").state, row("ct-exit3").exit),
            (&SlurmState::Failed, exit(3, 0))
        );
        assert_eq!(
            (&row("ct-killed").state, row("ct-killed").exit),
            (&SlurmState::Failed, exit(0, 9))
        );
        assert_eq!(row("ct-walltime").state, SlurmState::Timeout);
        assert_eq!(row("ct-node").state, SlurmState::NodeFail);
        assert_eq!(
            (&row("ct-person").state, row("ct-person").cancelled_by),
            (&SlurmState::Cancelled, Some(0))
        );
        assert_eq!(row("odd|name").exit, exit(3, 0));
        let requeued = table
            .rows
            .iter()
            .filter(|row| row.name == "ct-requeued")
            .map(|row| &row.state);
        assert_eq!(
            requeued.collect::<Vec<_>>(),
            [&SlurmState::NodeFail, &SlurmState::Cancelled],
            "both runs, by --duplicates"
        );
    }

    #[test]
    fn a_database_that_does_not_answer_is_no_empty_database() {
        assert!(matches!(
            read(&recorded::output("sacct-no-slurmdbd")),
            Err(NoAnswer::Failed { .. })
        ));
        assert_eq!(
            read(&recorded::output("sacct-lag"))
                .expect("an empty answer")
                .rows,
            []
        );
    }

    /// Holds also if a job's name contains the mark that ends a row.
    #[test]
    fn a_cut_answer_tells_less_and_nothing_else() {
        let whole = recorded::output("sacct-ended");
        let rows = read(&whole).expect("sacct answered").rows;
        for (cut, _) in whole.stdout.char_indices() {
            let output = Output {
                stdout: whole.stdout[..cut].to_owned(),
                ..whole.clone()
            };
            if let Ok(table) = read(&output) {
                assert_eq!(&rows[..table.rows.len()], &table.rows[..], "cut at {cut}");
                assert!(table.unreadable.len() <= 1, "cut at {cut}");
            }
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(odd in "(\\PC|\n){0,300}") {
            let stdout = format!("{}|\n{odd}", COLUMNS.replace(',', "|"));
            let _ = read(&Output { exit: Exit::Code(0), stdout, stderr: String::new() });
        }
    }
}
