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
use super::files_seen::FilesSeen;
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
    /// Patients whose decisions wait for these files, each with the step that was published.
    undecided: Vec<(usize, Option<Step>)>,
}

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

    /// Files that have to be looked for before the decisions are complete; none when they are.
    pub fn questions(&mut self) -> Vec<PathBuf> {
        if self.undecided.is_empty() {
            // Files may come and go: the next decision looks for them anew.
            self.files = FilesSeen::default();
        }
        std::mem::take(&mut self.asked)
    }

    /// Makes the decisions that waited for files. They may ask for further ones.
    pub fn answer(&mut self, books: &mut Books, seen: FilesSeen) -> Result<(), EngineError> {
        self.files.extend(seen);
        for (i, published) in std::mem::take(&mut self.undecided) {
            self.decide_after(books, i, published)?;
        }
        Ok(())
    }

    /// Looks for files until the decisions are complete, for callers that may read.
    pub fn look_and_answer(&mut self, books: &mut Books) -> Result<(), EngineError> {
        loop {
            let asked = self.questions();
            if asked.is_empty() {
                return Ok(());
            }
            self.answer(books, FilesSeen::look(asked))?;
        }
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
