//! Decisions on the books. They read and write nothing else: what they need to know is handed in,
//! and what they ask for is an action in the outbox.

mod pilots;
mod purged;
mod requests;
#[cfg(test)]
mod tests;
mod transitions;

use std::collections::HashSet;
use std::path::PathBuf;

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_workflow::patient::Step;

use super::books::Books;
use super::files_seen::{Asked, FilesSeen};
use super::{EngineError, EngineEvent};

/// Circumstance by which a missing outcome is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Circumstance {
    /// The worker ended while this coordinator watched it.
    Watched,
    /// The worker was ended by the coordinator, or found dead at a restart.
    Excused,
}

/// Decides, and collects events to be sent after the commit.
#[derive(Debug, Default)]
pub struct Decider {
    /// Events to be sent after the commit.
    events: Vec<EngineEvent>,
    /// Number of patients that are over, among those worked on.
    over: usize,
    /// Number of patients worked on.
    of: usize,
    /// Number of tasks published.
    published: u64,
    /// Number of site failures of a task that are forgiven.
    site_retries: u32,
    /// Published tasks that were reopened because their files were gone.
    remade: HashSet<TaskKey>,
    /// Files that were looked for since the last decision was complete.
    files: FilesSeen,
    /// Files about which decisions ask.
    asked: Vec<PathBuf>,
    /// Tasks whose outcomes the present decision needs in memory.
    recalls: Vec<TaskKey>,
    /// Patients whose decisions wait for answers.
    undecided: Vec<Undecided>,
}

/// A patient whose decision waits for answers.
#[derive(Debug)]
struct Undecided {
    /// Index of the patient.
    patient: usize,
    /// Step that was published.
    published: Option<Step>,
    /// Tasks whose outcomes it needs, until they are asked for.
    recalls: Vec<TaskKey>,
    /// Whether everything that it needs was asked for.
    is_asked: bool,
}

/// Largest number of outcomes asked for at a time, so that those of a large cohort are never in
/// memory all at once.
const MOST_RECALLED: usize = 4096;

impl Decider {
    /// A decider that forgives so many site failures of a task.
    pub fn new(site_retries: u32) -> Self {
        Self {
            site_retries,
            ..Self::default()
        }
    }

    /// Counts the selected patients.
    pub fn count(&mut self, books: &Books) {
        self.of = books.selected_states().count();
        self.over = books.selected_states().filter(|s| s.is_final()).count();
    }

    /// Number of patients that are over, among those worked on.
    pub fn over(&self) -> usize {
        self.over
    }

    /// Number of patients worked on.
    pub fn of(&self) -> usize {
        self.of
    }

    /// Number of tasks published.
    pub fn published(&self) -> u64 {
        self.published
    }

    /// Adds an event, to be sent after the commit.
    pub fn tell(&mut self, event: EngineEvent) {
        self.events.push(event);
    }

    /// Adds an event before all others.
    pub fn tell_first(&mut self, event: EngineEvent) {
        self.events.insert(0, event);
    }

    pub fn take_events(&mut self) -> Vec<EngineEvent> {
        std::mem::take(&mut self.events)
    }

    /// What has to be looked for before the decisions are complete; nothing when they are.
    pub fn questions(&mut self) -> Asked {
        if self.undecided.is_empty() {
            // Files may come and go: the next decision looks for them again.
            self.files = FilesSeen::default();
        }
        let mut tasks = Vec::new();
        for undecided in &mut self.undecided {
            if undecided.recalls.is_empty() || tasks.len() < MOST_RECALLED {
                tasks.append(&mut undecided.recalls);
                undecided.is_asked = true;
            }
        }
        Asked {
            files: std::mem::take(&mut self.asked),
            tasks,
        }
    }

    /// Makes the decisions that waited for answers. They may ask for more.
    pub fn answer(&mut self, books: &mut Books, seen: FilesSeen) -> Result<(), EngineError> {
        self.files.extend(seen);
        let all = std::mem::take(&mut self.undecided);
        let (answered, others) = all.into_iter().partition(|one| one.is_asked);
        self.undecided = others;
        for Undecided {
            patient, published, ..
        } in answered
        {
            self.decide_after(books, patient, published)?;
            let waits = |one: &Undecided| one.patient == patient;
            if !self.undecided.last().is_some_and(waits) {
                books.leave(patient);
            }
        }
        Ok(())
    }

    /// Looks for files until the decisions are complete, for callers that may read. Their books
    /// hold all outcomes.
    pub fn look_and_answer(&mut self, books: &mut Books) -> Result<(), EngineError> {
        loop {
            let asked = self.questions();
            if asked.files.is_empty() {
                return Ok(());
            }
            self.answer(books, FilesSeen::look(asked.files))?;
        }
    }

    /// Whether a patient's decision has to wait because outcomes that it asked for are not in
    /// memory.
    pub(super) fn must_recall(&mut self, books: &Books, i: usize) -> bool {
        let absent = books.take_absent();
        if absent.is_empty() {
            return false;
        }
        self.recalls.extend(absent);
        self.recalls.extend(books.absent_of(i));
        true
    }

    /// Which of these files are missing; `None`, and a question, if that is not known.
    pub(super) fn missing(&mut self, paths: Vec<PathBuf>) -> Option<Vec<PathBuf>> {
        let is_unseen = |path: &&PathBuf| self.files.exists(path).is_none();
        let unseen: Vec<PathBuf> = paths.iter().filter(is_unseen).cloned().collect();
        if !unseen.is_empty() {
            self.asked.extend(unseen);
            return None;
        }
        let is_missing = |path: &PathBuf| self.files.exists(path) == Some(false);
        Some(paths.into_iter().filter(is_missing).collect())
    }
}
