//! Reading of the `progress.jsonl` of running attempts.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_schemas::progress::Progress;

/// Reader of one attempt's progress.
#[derive(Debug)]
pub struct Tail {
    path: PathBuf,
    offset: u64,
    /// Time of the last growth, or of the opening.
    pub grew: Instant,
}

impl Tail {
    /// Starts reading the progress of the attempt in `directory`.
    #[must_use]
    pub fn of(directory: &Path) -> Self {
        Self {
            path: directory.join(cardiotwin_protocol::names::PROGRESS),
            offset: 0,
            grew: Instant::now(),
        }
    }

    /// The last complete line since the previous call; `None` if there is none. Progress is only
    /// informative, so unreadable lines are skipped.
    pub fn next(&mut self) -> Option<Progress> {
        let mut file = File::open(&self.path).ok()?;
        if file.metadata().ok()?.len() <= self.offset {
            return None;
        }
        file.seek(SeekFrom::Start(self.offset)).ok()?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).ok()?;
        let complete = bytes.iter().rposition(|byte| *byte == b'\n')? + 1;
        self.offset += complete as u64;
        self.grew = Instant::now();
        bytes[..complete]
            .split(|byte| *byte == b'\n')
            .rev()
            .find_map(|line| serde_json::from_slice(line).ok())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_is_told_once_and_half_a_line_is_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let line = |done: u32| {
            format!(r#"{{"at":"t","phase":"p","done":{done},"total":4,"note":"n"}}"#) + "\n"
        };
        let path = dir.path().join("progress.jsonl");
        let mut tail = Tail::of(dir.path());
        assert_eq!(tail.next(), None);
        let half = line(3);
        std::fs::write(&path, line(1) + &line(2) + &half[..10]).unwrap();
        assert_eq!(tail.next().map(|p| p.done), Some(2.0));
        assert_eq!(tail.next(), None);
        std::fs::write(&path, line(1) + &line(2) + &half).unwrap();
        assert_eq!(tail.next().map(|p| p.done), Some(3.0));
    }
}
