//! Answers of `squeue`: one row per job of the user, and one per element of an array.

use super::{NoAnswer, Output, Table};
use crate::job::{JobId, number};
use crate::state::SlurmState;
use crate::walltime::{self, Limit};

/// Requested format: a mark at both ends of a row, and the name last because it may contain any
/// character.
pub const FORMAT: &str = "ctq|%F|%K|%A|%T|%r|%P|%q|%a|%D|%C|%N|%V|%S|%e|%l|%j|ctq.";
/// Header that squeue prints for [`FORMAT`].
pub const HEADER: &str = "ctq|ARRAY_JOB_ID|ARRAY_TASK_ID|JOBID|STATE|REASON|PARTITION|QOS|ACCOUNT|NODES|CPUS|NODELIST|\
                          SUBMIT_TIME|START_TIME|END_TIME|TIME_LIMIT|NAME|ctq.";

/// A job in the queue, or one that ended less than `MinJobAge` ago.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QueueRow {
    /// Number of the job, with the index of an array's element.
    pub id: JobId,
    /// Number of the job itself, which for an element differs from the array's number.
    pub raw: u64,
    /// Name of the job.
    pub name: String,
    /// State of the job.
    pub state: SlurmState,
    /// Why the job waits, as Slurm's code.
    pub reason: String,
    /// Name of the partition.
    pub partition: String,
    /// Name of the QoS.
    pub qos: String,
    /// Name of the account.
    pub account: String,
    /// Number of requested or assigned nodes.
    pub n_nodes: Option<u32>,
    /// Number of requested or assigned cores.
    pub n_cores: Option<u32>,
    /// Names of the nodes in Slurm's compressed notation (`n[1-3]`); empty before the start.
    pub nodes: String,
    /// Time of submission, seconds since 1970.
    pub submitted: Option<i64>,
    /// Actual or expected start, seconds since 1970.
    pub start: Option<i64>,
    /// Actual or latest end, seconds since 1970.
    pub end: Option<i64>,
    /// Walltime of the job.
    pub limit: Option<Limit>,
}

/// Reads the answer to [`crate::commands::queue`].
///
/// # Errors
/// [`NoAnswer`] if squeue failed or the output is not the requested table: the queue is then
/// unknown, not empty.
pub fn read(output: &Output) -> Result<Table<QueueRow>, NoAnswer> {
    super::table("squeue", output, HEADER, "ctq|", "|ctq.", |cells| {
        let [
            array,
            element,
            raw,
            state,
            reason,
            partition,
            qos,
            account,
            n_nodes,
            n_cores,
            nodes,
            submit,
            start,
            end,
            limit,
            name,
        ] = cells
        else {
            return None;
        };
        let element = if *element == "N/A" {
            None
        } else {
            Some(number(element)?)
        };
        if state.is_empty() || name.is_empty() {
            return None;
        }
        Some(QueueRow {
            id: JobId {
                job: number(array)?,
                element,
            },
            raw: number(raw)?,
            name: (*name).to_owned(),
            state: SlurmState::parse(state),
            reason: (*reason).to_owned(),
            partition: (*partition).to_owned(),
            qos: (*qos).to_owned(),
            account: (*account).to_owned(),
            n_nodes: number(n_nodes),
            n_cores: number(n_cores),
            nodes: (*nodes).to_owned(),
            submitted: walltime::instant(submit),
            start: walltime::instant(start),
            end: walltime::instant(end),
            limit: walltime::parse(limit),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Exit, NoAnswer, Output, recorded};
    use super::{HEADER, read};
    use crate::job::JobId;
    use crate::state::SlurmState;
    use proptest::prelude::*;

    fn said(stdout: &str) -> Output {
        Output {
            exit: Exit::Code(0),
            stdout: stdout.to_owned(),
            stderr: String::new(),
        }
    }

    #[test]
    fn a_real_queue() {
        let table = read(&recorded::output("squeue-mixed")).expect("squeue answered");
        assert!(table.is_whole(), "{:?}", table.unreadable);
        let row = |name: &str| {
            table
                .rows
                .iter()
                .find(|row| row.name == name)
                .unwrap_or_else(|| panic!("{name}"))
        };
        assert_eq!(row("odd|name").state, SlurmState::Failed);
        assert_eq!(
            (
                row("ct-limit-5").reason.as_str(),
                row("ct-limit-5").nodes.as_str()
            ),
            ("QOSMaxJobsPerUserLimit", "")
        );
        assert_eq!(row("ct-two-nodes").n_nodes, Some(2));
        let array = table
            .rows
            .iter()
            .filter(|row| row.name == "ct-array")
            .map(|row| row.id)
            .collect::<Vec<_>>();
        assert_eq!(array.len(), 8, "{array:?}");
        assert!(array.contains(&JobId {
            element: Some(7),
            ..array[0]
        }));
    }

    #[test]
    fn nobody_is_there_is_not_nobody_answered() {
        assert_eq!(
            read(&said(&format!("{HEADER}\n")))
                .expect("an empty queue")
                .rows,
            []
        );
        for name in ["squeue-frozen", "squeue-no-slurmctld"] {
            assert!(
                matches!(read(&recorded::output(name)), Err(NoAnswer::Failed { .. })),
                "{name}"
            );
        }
        assert!(matches!(read(&said("")), Err(NoAnswer::NoHeader { .. })));
        assert!(matches!(
            read(&said("Welcome\n")),
            Err(NoAnswer::NoHeader { .. })
        ));
        assert!(
            matches!(read(&said(HEADER)), Err(NoAnswer::NoHeader { .. })),
            "a cut answer is no empty queue"
        );
    }

    #[test]
    fn every_recorded_queue_is_read_whole() {
        for name in recorded::names("squeue-") {
            if let Ok(table) = read(&recorded::output(&name)) {
                assert!(table.is_whole(), "{name}: {:?}", table.unreadable);
            }
        }
    }

    /// Wherever a real answer is cut, every row that is read is also a row of the whole answer.
    #[test]
    fn a_cut_answer_tells_less_and_nothing_else() {
        let whole = recorded::output("squeue-mixed");
        let rows = read(&whole).expect("squeue answered").rows;
        for (cut, _) in whole.stdout.char_indices() {
            if let Ok(table) = read(&said(&whole.stdout[..cut])) {
                assert_eq!(&rows[..table.rows.len()], &table.rows[..], "cut at {cut}");
                assert!(table.unreadable.len() <= 1, "cut at {cut}");
            }
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(odd in "(\\PC|\n){0,300}", below in any::<bool>()) {
            let odd = if below { format!("{HEADER}\n{odd}") } else { odd };
            if let Ok(table) = read(&said(&odd)) {
                prop_assert!(table.rows.is_empty() || odd.contains("|ctq."));
            }
        }

        /// A changed byte may hide a row or change a cell, but never adds a row.
        #[test]
        fn a_damaged_answer_adds_nothing(at in 0_usize..6000, byte in 32_u8..127) {
            let whole = recorded::output("squeue-mixed");
            let n = read(&whole).expect("squeue answered").rows.len();
            let mut bytes = whole.stdout.into_bytes();
            let at = at % bytes.len();
            bytes[at] = byte;
            if let Ok(table) = read(&said(&String::from_utf8_lossy(&bytes))) {
                prop_assert!(table.rows.len() <= n);
            }
        }
    }
}
