//! Journals of optimisers. With a journal, a later attempt continues the search of an earlier one,
//! and a search can be restarted from any of its generations.
//!
//! Optimisers are deterministic: the points they ask for follow from the costs they received. The
//! journal therefore holds the costs alone, a few bytes per evaluation, appended batch by batch.
//! When the optimiser receives them again, it passes through all its earlier states, and no cell is
//! computed. Each record also holds a hash of the requested points. If the optimiser asks for other
//! points, because it was changed in the meantime, this record and all later ones are ignored.
//!
//! The file is `checkpoint/<name>` in the attempt's directory. A line of JSON (format and name of
//! the search) comes first, then binary records in little endian: number of costs, hash of the
//! points, costs, and a hash of all of these chained to the previous record. The file is not
//! synced. After a power failure it may be truncated or damaged; the hashes detect this, and only
//! computing time is lost.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use cardiotwin_protocol::names;
use cardiotwin_schemas::formats::SEARCH_JOURNAL;
use cardiotwin_schemas::ids::AttemptId;
use serde::{Deserialize, Serialize};

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    format: u32,
    search: String,
}

/// Directories in which checkpoints are written and searched.
#[derive(Debug, Default)]
pub struct Checkpoints {
    /// Directory of this attempt; `None` if nothing is written.
    own: Option<PathBuf>,
    /// Directories that may hold an earlier journal, in order of preference.
    earlier: Vec<PathBuf>,
    /// Last generation that is recalled; `None` for no limit.
    last_generation: Option<u64>,
}

impl Checkpoints {
    /// Checkpoints in an attempt's directory. Earlier generations of the same task are searched
    /// next to it, newest first.
    #[must_use]
    pub fn of_attempt(directory: &Path, attempt: &AttemptId) -> Self {
        let earlier = (1..attempt.generation)
            .rev()
            .filter_map(|generation| sibling(directory, generation));
        Self {
            own: Some(directory.to_owned()),
            earlier: earlier.collect(),
            last_generation: None,
        }
    }

    /// Checkpoints in `directory`, continued from those in `other`, up to and including
    /// `last_generation` if given.
    #[must_use]
    pub fn restarting(directory: &Path, other: &Path, last_generation: Option<u64>) -> Self {
        Self {
            own: Some(directory.to_owned()),
            earlier: vec![other.to_owned()],
            last_generation,
        }
    }

    /// Checkpoints in `directory`, without any earlier ones.
    #[must_use]
    pub fn writing(directory: &Path) -> Self {
        Self {
            own: Some(directory.to_owned()),
            ..Self::default()
        }
    }

    /// No checkpoints: tasks start from the beginning and write nothing.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Last generation that is recalled; `None` for no limit.
    #[must_use]
    pub fn last_generation(&self) -> Option<u64> {
        self.last_generation
    }

    /// File to which this attempt writes the checkpoint `name`; `None` if it writes nothing.
    #[must_use]
    pub fn own_file(&self, name: &str) -> Option<PathBuf> {
        self.own
            .as_ref()
            .map(|directory| directory.join(names::CHECKPOINT).join(name))
    }

    /// Files in which earlier attempts may have left the checkpoint `name`, in order of preference.
    #[must_use]
    pub fn earlier_files(&self, name: &str) -> Vec<PathBuf> {
        self.earlier
            .iter()
            .map(|directory| directory.join(names::CHECKPOINT).join(name))
            .collect()
    }

    /// Creates the journal of a search and loads the first earlier journal of the same search.
    ///
    /// # Errors
    /// Any error of the file system while the new file is created.
    pub fn journal(&self, name: &str, search: &str) -> io::Result<Journal> {
        let earlier = self.earlier.iter().find_map(|directory| {
            let records = read(&directory.join(names::CHECKPOINT).join(name), search)?;
            Some((directory.clone(), records))
        });
        let file = self
            .own
            .as_ref()
            .map(|directory| create(&directory.join(names::CHECKPOINT), name, search))
            .transpose()?;
        let (from, records) = earlier.unzip();
        Ok(Journal {
            file,
            from,
            records: records.unwrap_or_default().into_iter(),
            chain: Chain::default(),
        })
    }
}

/// Costs of a search: recalled from an earlier attempt as long as it has records, then recorded.
#[derive(Debug)]
pub struct Journal {
    file: Option<File>,
    from: Option<PathBuf>,
    records: std::vec::IntoIter<Record>,
    chain: Chain,
}

#[derive(Debug, PartialEq)]
struct Record {
    asked: u64,
    costs: Vec<f64>,
}

impl Journal {
    /// Directory of the journal that is recalled, if any.
    #[must_use]
    pub fn from(&self) -> Option<&Path> {
        self.from.as_deref()
    }

    /// Costs of `points`, if they are next in the earlier journal.
    pub fn recall(&mut self, points: &[Vec<f64>]) -> Option<Vec<f64>> {
        let record = self.records.next()?;
        if record.asked == hash_of(points) && record.costs.len() == points.len() {
            return Some(record.costs);
        }
        tracing::warn!(
            "the optimiser asks for other points than the earlier attempt's: the rest of it is left aside"
        );
        self.forget();
        None
    }

    /// Ignores the rest of the earlier journal.
    pub fn forget(&mut self) {
        self.records = Vec::new().into_iter();
    }

    /// Appends the costs of `points`.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn record(&mut self, points: &[Vec<f64>], costs: &[f64]) -> io::Result<()> {
        let Some(file) = &mut self.file else {
            return Ok(());
        };
        let mut words = vec![costs.len() as u64, hash_of(points)];
        words.extend(costs.iter().map(|cost| cost.to_bits()));
        words.push(self.chain.next(&words));
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        file.write_all(&bytes)
    }
}

/// FNV-1a over 64-bit words. It detects damage, not manipulation.
fn fnv(start: u64, words: impl Iterator<Item = u64>) -> u64 {
    words.fold(start, |hash, word| {
        (hash ^ word).wrapping_mul(0x0100_0000_01b3).rotate_left(23)
    })
}

fn hash_of(points: &[Vec<f64>]) -> u64 {
    fnv(
        0xcbf2_9ce4_8422_2325,
        points.iter().flatten().map(|value| value.to_bits()),
    )
}

/// Running hash over all records so far.
#[derive(Debug, Clone, Copy)]
struct Chain(u64);

impl Default for Chain {
    fn default() -> Self {
        Self(0x6c62_272e_07bb_0142)
    }
}

impl Chain {
    fn next(&mut self, words: &[u64]) -> u64 {
        self.0 = fnv(self.0, words.iter().copied());
        self.0
    }
}

fn create(folder: &Path, name: &str, search: &str) -> io::Result<File> {
    fs::create_dir_all(folder)?;
    let header = Header {
        format: SEARCH_JOURNAL.version,
        search: search.to_owned(),
    };
    let mut file = File::create(folder.join(name))?;
    file.write_all(
        format!(
            "{}\n",
            serde_json::to_string(&header).map_err(io::Error::other)?
        )
        .as_bytes(),
    )?;
    Ok(file)
}

/// Directory of another generation of the same task: `…/<key>-g2` for `…/<key>-g3` and generation
/// 2.
fn sibling(directory: &Path, generation: u32) -> Option<PathBuf> {
    let absolute = fs::canonicalize(directory).ok()?;
    let (key, _) = absolute.file_name()?.to_str()?.rsplit_once("-g")?;
    Some(absolute.with_file_name(format!("{key}-g{generation}")))
}

/// Intact records of a file; `None` if it cannot be read or belongs to another search.
fn read(path: &Path, search: &str) -> Option<Vec<Record>> {
    let bytes = fs::read(path).ok()?;
    let end = bytes.iter().position(|byte| *byte == b'\n')?;
    let header: Header = serde_json::from_slice(&bytes[..end]).ok()?;
    if header
        != (Header {
            format: SEARCH_JOURNAL.version,
            search: search.to_owned(),
        })
    {
        tracing::warn!(file = %path.display(), "checkpoint is of another search, and left aside");
        return None;
    }
    let words: Vec<u64> = bytes[end + 1..]
        .as_chunks::<8>()
        .0
        .iter()
        .map(|word| u64::from_le_bytes(*word))
        .collect();
    let mut records = Vec::new();
    let (mut rest, mut chain) = (words.as_slice(), Chain::default());
    while let Some(&n) = rest.first() {
        let whole = usize::try_from(n)
            .ok()
            .and_then(|n| n.checked_add(3))
            .and_then(|len| rest.split_at_checked(len));
        let sound = whole.and_then(|(record, after)| {
            let (sum, content) = record.split_last()?;
            (chain.next(content) == *sum).then_some((content, after))
        });
        let Some((content, after)) = sound else {
            tracing::warn!(file = %path.display(), batches = records.len(), "checkpoint is damaged beyond its first batches");
            break;
        };
        records.push(Record {
            asked: content[1],
            costs: content[2..].iter().map(|w| f64::from_bits(*w)).collect(),
        });
        rest = after;
    }
    Some(records).filter(|records| !records.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::TaskKey;

    const NAME: &str = "told-costs";

    fn checkpoints(root: &Path, generation: u32) -> Checkpoints {
        let directory = root.join(format!("abcd-g{generation}"));
        fs::create_dir_all(&directory).unwrap();
        Checkpoints::of_attempt(
            &directory,
            &AttemptId {
                task: TaskKey("abcd".into()),
                generation,
            },
        )
    }

    fn points(k: usize) -> Vec<Vec<f64>> {
        vec![vec![k as f64, 0.5], vec![1.0 / 3.0, -2.0]]
    }

    fn costs(k: usize) -> Vec<f64> {
        vec![0.1 + 0.2 * k as f64, f64::INFINITY]
    }

    fn leave(root: &Path, generation: u32, n: usize) -> PathBuf {
        let mut journal = checkpoints(root, generation).journal(NAME, "a").unwrap();
        (0..n).for_each(|k| journal.record(&points(k), &costs(k)).unwrap());
        root.join(format!("abcd-g{generation}/checkpoint/{NAME}"))
    }

    fn recalled(root: &Path, generation: u32, search: &str) -> usize {
        let mut journal = checkpoints(root, generation).journal(NAME, search).unwrap();
        (0..)
            .take_while(|k| journal.recall(&points(*k)) == Some(costs(*k)))
            .count()
    }

    #[test]
    fn a_later_generation_recalls_the_newest_journal_bit_for_bit() {
        let root = tempfile::tempdir().unwrap();
        leave(root.path(), 1, 2);
        leave(root.path(), 3, 4);
        assert_eq!(recalled(root.path(), 5, "a"), 4);
        assert_eq!(recalled(root.path(), 2, "a"), 2);
        assert_eq!(recalled(root.path(), 1, "a"), 0);
        assert_eq!(recalled(root.path(), 5, "b"), 0, "another search");
    }

    #[test]
    fn a_journal_is_read_and_written_as_the_golden_one() {
        let golden = include_bytes!("../tests/golden/told-costs");
        let root = tempfile::tempdir().unwrap();
        let path = leave(root.path(), 1, 3);
        assert_eq!(fs::read(&path).unwrap(), golden);
        fs::write(&path, golden).unwrap();
        assert_eq!(recalled(root.path(), 2, "a"), 3);
    }

    #[test]
    fn what_follows_damage_is_left_aside() {
        let root = tempfile::tempdir().unwrap();
        let path = leave(root.path(), 1, 4);
        let sound = fs::read(&path).unwrap();
        fs::write(&path, &sound[..sound.len() - 3]).unwrap();
        assert_eq!(recalled(root.path(), 2, "a"), 3, "torn");
        let mut flipped = sound.clone();
        let second = sound.len() - 2 * 5 * 8 - 9;
        flipped[second] ^= 1;
        fs::write(&path, &flipped).unwrap();
        assert_eq!(
            recalled(root.path(), 3, "a"),
            1,
            "a bit of the second record flipped"
        );
        fs::write(&path, [sound.as_slice(), &u64::MAX.to_le_bytes()].concat()).unwrap();
        assert_eq!(recalled(root.path(), 4, "a"), 4, "a length that cannot be");
    }

    #[test]
    fn other_points_end_the_recalling() {
        let root = tempfile::tempdir().unwrap();
        leave(root.path(), 1, 3);
        let mut journal = checkpoints(root.path(), 2).journal(NAME, "a").unwrap();
        assert!(journal.from().is_some());
        assert_eq!(journal.recall(&points(0)), Some(costs(0)));
        assert_eq!(journal.recall(&points(7)), None);
        assert_eq!(journal.recall(&points(2)), None);
    }
}
