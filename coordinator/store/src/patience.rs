//! Waiting for a database that another program has locked: a backup, a shell, an editor of tables.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{StoreError, clock, foreign};

/// First pause between two tries \[ms\]; each further one is twice as long.
const SHORTEST_MS: u64 = 50;
/// Length above which the pause does not grow \[ms\].
const LONGEST_MS: u64 = 2_000;
/// How long a command waits without a person who decides otherwise \[ms\].
const PATIENCE_MS: i64 = 30_000;

/// A wait for another program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Waiting {
    /// Path of the database.
    pub file: PathBuf,
    /// The program that holds the lock, such as `process 4711 (sqlite3)`.
    pub holder: String,
    /// Time of the first try, UTC.
    pub since: String,
    /// Time since then \[ms\].
    pub waited_ms: i64,
}

type Decide = Box<dyn FnMut(&Waiting) -> bool + Send>;

/// Decides at each failed try whether to continue to wait.
pub struct Patience(Decide);

impl Patience {
    /// Asks this function. It is called after each try that the lock prevented.
    pub fn new(decide: impl FnMut(&Waiting) -> bool + Send + 'static) -> Self {
        Self(Box::new(decide))
    }

    /// Waits for so long, in ms.
    #[must_use]
    pub fn of_ms(limit_ms: i64) -> Self {
        Self::new(move |waiting| waiting.waited_ms < limit_ms)
    }

    /// Whether to continue to wait.
    pub fn goes_on(&mut self, waiting: &Waiting) -> bool {
        (self.0)(waiting)
    }

    /// A wait for this file that has not begun.
    pub(super) fn wait_for(&mut self, file: &Path) -> Wait<'_> {
        Wait {
            patience: self,
            file: file.to_owned(),
            since_ms: None,
            pause_ms: SHORTEST_MS,
        }
    }
}

impl Default for Patience {
    fn default() -> Self {
        Self::of_ms(PATIENCE_MS)
    }
}

impl std::fmt::Debug for Patience {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Patience")
    }
}

/// The tries of one operation.
pub(super) struct Wait<'a> {
    patience: &'a mut Patience,
    file: PathBuf,
    since_ms: Option<i64>,
    pause_ms: u64,
}

impl Wait<'_> {
    /// Pauses after an error that another program's lock caused. Any other error, and the lock when
    /// patience is at its end, is returned.
    pub(super) async fn after(&mut self, error: StoreError) -> Result<(), StoreError> {
        let StoreError::Busy { .. } = error else {
            return Err(error);
        };
        let now_ms = clock::now_ms();
        let since_ms = *self.since_ms.get_or_insert(now_ms);
        let waiting = Waiting {
            file: self.file.clone(),
            holder: foreign::holder(&self.file),
            since: clock::utc_text(since_ms),
            waited_ms: now_ms - since_ms,
        };
        if !self.patience.goes_on(&waiting) {
            let Waiting {
                file,
                holder,
                since,
                ..
            } = waiting;
            return Err(StoreError::Busy {
                file,
                holder,
                since,
            });
        }
        tokio::time::sleep(Duration::from_millis(self.pause_ms)).await;
        self.pause_ms = (self.pause_ms * 2).min(LONGEST_MS);
        Ok(())
    }
}
