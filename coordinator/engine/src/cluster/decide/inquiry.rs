//! Answers of Slurm and of jobs' folders about jobs, as far as they have come in a tick.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

use cardiotwin_slurm::answers::Table;
use cardiotwin_slurm::answers::accounting::AccountingRow;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::job_status::{self, JobStatus, Wanted};

use super::effects::ElementId;
use super::observation::Traces;

/// Rows by name and element, so that each element of a large array finds its own rows.
type Queued = HashMap<(String, Option<u32>), Table<QueueRow>>;
type Accounted = HashMap<String, Table<AccountingRow>>;

/// Answers about jobs in a tick; `None` from a source that did not answer or was not asked.
#[derive(Debug, Default)]
pub struct Inquiry {
    queued: Option<Queued>,
    accounted: Option<Accounted>,
    /// Traces of elements that have ended by Slurm's account.
    pub traces: BTreeMap<ElementId, Traces>,
}

impl Inquiry {
    pub fn take_queue(&mut self, table: Table<QueueRow>) {
        self.queued = Some(by_key(table, |row| (row.name.clone(), row.id.element)));
    }

    pub fn take_accounting(&mut self, table: Table<AccountingRow>) {
        self.accounted = Some(by_key(table, |row| row.name.clone()));
    }

    /// Whether the queue answered.
    pub fn has_queue(&self) -> bool {
        self.queued.is_some()
    }

    /// Status of an element by the queue alone.
    pub fn status_by_queue(&self, wanted: Wanted<'_>) -> JobStatus {
        job_status::of(wanted, self.queued(wanted), None)
    }

    /// Status of an element by queue and accounting.
    pub fn status(&self, wanted: Wanted<'_>) -> JobStatus {
        let accounted = of_key(self.accounted.as_ref(), &wanted.name.to_owned());
        job_status::of(wanted, self.queued(wanted), accounted)
    }

    fn queued(&self, wanted: Wanted<'_>) -> Option<&Table<QueueRow>> {
        let key = (wanted.name.to_owned(), wanted.element);
        of_key(self.queued.as_ref(), &key)
    }
}

/// Groups the rows of a table by a key. Unreadable lines may concern any row, so they are kept with
/// every group and alone under the default key.
fn by_key<Row, Key: Hash + Eq + Default>(
    table: Table<Row>,
    key: impl Fn(&Row) -> Key,
) -> HashMap<Key, Table<Row>> {
    let mut tables: HashMap<Key, Table<Row>> = HashMap::new();
    let unreadable = table.unreadable;
    for row in table.rows {
        let entry = tables.entry(key(&row));
        entry
            .or_insert_with(|| Table {
                rows: Vec::new(),
                unreadable: unreadable.clone(),
            })
            .rows
            .push(row);
    }
    tables.entry(Key::default()).or_insert_with(|| Table {
        rows: Vec::new(),
        unreadable,
    });
    tables
}

/// Rows of one key. Without any, the group of the default key still shows that there was an answer.
fn of_key<'a, Row, Key: Hash + Eq + Default>(
    tables: Option<&'a HashMap<Key, Table<Row>>>,
    key: &Key,
) -> Option<&'a Table<Row>> {
    let tables = tables?;
    tables.get(key).or_else(|| tables.get(&Key::default()))
}
