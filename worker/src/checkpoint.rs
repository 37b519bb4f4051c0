//! Work in hand, kept so that the next attempt at the same task goes on from it.
//!
//! A checkpoint is one file, `checkpoint/<name>`, in the attempt's directory: a header line in JSON (format, task key,
//! hash of the rest), then the state in JSON. A further attempt looks into the directories of earlier generations of
//! the same task, `<key>-g<k>` beside its own, newest first, and takes the first whose hash and key are right.
//!
//! The file is replaced whole, but not synced: after a power failure it may be lost or torn, which the hash tells, and
//! costs only the time to do the work again; a sync after every generation would cost more than the generation.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::AttemptId;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Raised when an older state would be misread.
const FORMAT: u32 = 1;

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    format: u32,
    task: String,
    sha256: String,
}

/// Where checkpoints of a task are written and looked for.
#[derive(Debug)]
pub struct Checkpoints(Option<Place>);

#[derive(Debug)]
struct Place {
    directory: PathBuf,
    task: String,
    generation: u32,
}

impl Checkpoints {
    /// Checkpoints of `attempt`, whose directory is named `<key>-g<generation>`.
    #[must_use]
    pub fn of_attempt(directory: &Path, attempt: &AttemptId) -> Self {
        let (task, generation) = (attempt.task.0.clone(), attempt.generation);
        Self(Some(Place { directory: directory.to_owned(), task, generation }))
    }

    /// No checkpoints: nothing is kept and nothing is found.
    #[must_use]
    pub fn none() -> Self {
        Self(None)
    }

    /// Keeps `state` under `name`, in place of what was kept before.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn save<T: Serialize>(&self, name: &str, state: &T) -> io::Result<()> {
        let Some(place) = &self.0 else { return Ok(()) };
        let body = serde_json::to_string(state).map_err(io::Error::other)?;
        let header = Header { format: FORMAT, task: place.task.clone(), sha256: sha256_hex(body.as_bytes()) };
        let folder = place.directory.join("checkpoint");
        fs::create_dir_all(&folder)?;
        let temporary = folder.join(format!(".{name}.tmp"));
        fs::write(&temporary, format!("{}\n{body}", serde_json::to_string(&header).map_err(io::Error::other)?))?;
        fs::rename(temporary, folder.join(name))
    }

    /// The newest state of an earlier attempt at the same task, with the generation that left it.
    #[must_use]
    pub fn load<T: DeserializeOwned>(&self, name: &str) -> Option<(u32, T)> {
        let place = self.0.as_ref()?;
        (1..place.generation).rev().find_map(|generation| {
            let directory = sibling(&place.directory, generation)?;
            let state = read(&directory.join("checkpoint").join(name), &place.task)?;
            Some((generation, state))
        })
    }
}

/// The directory of another generation: `…/<key>-g3` gives `…/<key>-g2`.
fn sibling(directory: &Path, generation: u32) -> Option<PathBuf> {
    let absolute = fs::canonicalize(directory).ok()?;
    let (key, _) = absolute.file_name()?.to_str()?.rsplit_once("-g")?;
    Some(absolute.with_file_name(format!("{key}-g{generation}")))
}

/// The state in a file, if the file is whole and belongs to the task.
fn read<T: DeserializeOwned>(path: &Path, task: &str) -> Option<T> {
    let text = fs::read_to_string(path).ok()?;
    let (header, body) = text.split_once('\n')?;
    let header: Header = serde_json::from_str(header).ok()?;
    let expected = Header { format: FORMAT, task: task.to_owned(), sha256: sha256_hex(body.as_bytes()) };
    if header != expected {
        tracing::warn!(file = %path.display(), "checkpoint is damaged or of another task, and left aside");
        return None;
    }
    serde_json::from_str(body).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::TaskKey;

    fn checkpoints(root: &Path, task: &str, generation: u32) -> Checkpoints {
        let directory = root.join(format!("{}-g{generation}", &task[..4]));
        fs::create_dir_all(&directory).unwrap();
        Checkpoints::of_attempt(&directory, &AttemptId { task: TaskKey(task.into()), generation })
    }

    #[test]
    fn a_later_generation_finds_the_newest_state_bit_for_bit() {
        let root = tempfile::tempdir().unwrap();
        let state = vec![0.1 + 0.2, f64::MIN_POSITIVE, -1.0 / 3.0];
        checkpoints(root.path(), "abcdef", 1).save("de", &vec![1.0]).unwrap();
        checkpoints(root.path(), "abcdef", 3).save("de", &state).unwrap();
        assert_eq!(checkpoints(root.path(), "abcdef", 4).load::<Vec<f64>>("de"), Some((3, state)));
        assert_eq!(checkpoints(root.path(), "abcdef", 3).load::<Vec<f64>>("de"), Some((1, vec![1.0])));
        assert_eq!(checkpoints(root.path(), "abcdef", 1).load::<Vec<f64>>("de"), None);
    }

    #[test]
    fn a_damaged_state_or_one_of_another_task_is_left_aside_for_an_older_one() {
        let root = tempfile::tempdir().unwrap();
        checkpoints(root.path(), "abcdef", 1).save("de", &vec![1.0]).unwrap();
        checkpoints(root.path(), "abcdef", 2).save("de", &vec![2.0]).unwrap();
        let path = root.path().join("abcd-g2/checkpoint/de");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 1]).unwrap();
        assert_eq!(checkpoints(root.path(), "abcdef", 3).load::<Vec<f64>>("de"), Some((1, vec![1.0])));
        assert_eq!(checkpoints(root.path(), "abcdXX", 3).load::<Vec<f64>>("de"), None);
    }
}
