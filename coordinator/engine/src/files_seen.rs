//! What a decision asks for. Decisions read nothing: a decision that depends on whether a file
//! exists, or on an outcome that only the store still has, waits; the loop looks for it, and the
//! decision is made with the answer.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::ids::TaskKey;

/// Questions of decisions.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Asked {
    /// Files of which the decisions need to know whether they exist.
    pub files: Vec<PathBuf>,
    /// Tasks whose outcomes the decisions need in memory.
    pub tasks: Vec<TaskKey>,
}

impl Asked {
    /// Whether nothing is asked: the decisions are complete.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty() && self.tasks.is_empty()
    }
}

/// Files that were looked for, each with whether it exists.
#[derive(Debug, Default)]
pub struct FilesSeen(HashMap<PathBuf, bool>);

impl FilesSeen {
    /// Answers of the file system about these files.
    pub fn look(paths: Vec<PathBuf>) -> Self {
        let look = |path: PathBuf| {
            let exists = path.exists();
            (path, exists)
        };
        Self(paths.into_iter().map(look).collect())
    }

    /// An answer that no file system gave.
    #[cfg(test)]
    pub fn told(paths: Vec<PathBuf>, exist: bool) -> Self {
        Self(paths.into_iter().map(|path| (path, exist)).collect())
    }

    /// Whether a file exists; `None` if it was not looked for.
    pub fn exists(&self, path: &Path) -> Option<bool> {
        self.0.get(path).copied()
    }

    pub fn extend(&mut self, seen: Self) {
        self.0.extend(seen.0);
    }
}
