//! What `squeue` answers: one row for each job of the user, elements of arrays one by one.

use super::{NoAnswer, Output, Table};
use crate::job::{JobId, number};
use crate::state::SlurmState;
use crate::walltime::{self, Limit};

/// The format asked for: a mark at both ends of a row, the name, which may hold anything, last.
pub const FORMAT: &str = "ctq|%F|%K|%A|%T|%r|%P|%q|%a|%D|%C|%N|%V|%S|%e|%l|%j|ctq.";
/// The header that this format gets.
pub const HEADER: &str = "ctq|ARRAY_JOB_ID|ARRAY_TASK_ID|JOBID|STATE|REASON|PARTITION|QOS|ACCOUNT|NODES|CPUS|NODELIST|\
                          SUBMIT_TIME|START_TIME|END_TIME|TIME_LIMIT|NAME|ctq.";

/// A job in the queue, or one that ended a short while ago (`MinJobAge`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QueueRow {
    /// The job.
    pub id: JobId,
    /// Its own number, for an element of an array another one than the array's.
    pub raw: u64,
    /// Its name.
    pub name: String,
    /// Its state.
    pub state: SlurmState,
    /// Why it waits, in Slurm's word.
    pub reason: String,
    /// Partition.
    pub partition: String,
    /// Quality of service.
    pub qos: String,
    /// Account.
    pub account: String,
    /// Nodes asked for or given.
    pub n_nodes: Option<u32>,
    /// Cores asked for or given.
    pub n_cores: Option<u32>,
    /// Names of its nodes, compressed (`n[1-3]`); empty before it starts.
    pub nodes: String,
    /// When it was submitted, seconds since 1970.
    pub submitted: Option<i64>,
    /// When it started, or is expected to, seconds since 1970.
    pub start: Option<i64>,
    /// When it ended, or will end at the latest, seconds since 1970.
    pub end: Option<i64>,
    /// Its walltime.
    pub limit: Option<Limit>,
}

/// Reads the answer to [`crate::commands::queue`].
///
/// # Errors
/// [`NoAnswer`] where squeue failed or printed something else: the queue is unknown then, not empty.
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

    /// Wherever a real answer is cut, the rows that are read are rows of the whole answer, and no more.
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

        /// A byte changed anywhere may hide a row or change a cell, and never adds a row.
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
