//! Log of computed samples, so that a later attempt continues with the first missing one.
//!
//! The file is `checkpoint/samples` in the attempt's directory, one for each worker. A line of JSON
//! comes first (format, and the subject of the samples). Each sample follows on one line: a
//! checksum of 16 hexadecimal digits, a blank, and the sample. The file is not synced. After a
//! power failure, checksums detect the damaged lines, and only the time to compute them again is
//! lost.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

use cardiotwin_schemas::formats::SAMPLE_LOG;
use serde::{Deserialize, Serialize};

use crate::checkpoint::Checkpoints;

/// Name of the file among an attempt's checkpoints.
pub const FILE: &str = "samples";

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    format: u32,
    samples: String,
}

/// Log of samples, to which lines are appended.
#[derive(Debug)]
pub struct SampleLog {
    file: Option<File>,
}

impl SampleLog {
    /// Creates the log of this attempt. It begins with the lines of the earlier attempt that got
    /// furthest, which are also returned.
    ///
    /// - `about`: subject of the samples; an earlier log with another subject is ignored
    ///
    /// # Errors
    /// Any error of the file system while the new file is created.
    pub fn open(checkpoints: &Checkpoints, about: &str) -> io::Result<(Self, Vec<String>)> {
        let header = Header {
            format: SAMPLE_LOG.version,
            samples: about.to_owned(),
        };
        let earlier = checkpoints.earlier_files(FILE);
        let lines = earlier
            .iter()
            .filter_map(|path| read(path, &header))
            .max_by_key(Vec::len)
            .unwrap_or_default();
        let mut log = Self { file: None };
        if let Some(path) = checkpoints.own_file(FILE) {
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder)?;
            }
            let mut file = File::create(path)?;
            file.write_all(
                format!(
                    "{}\n",
                    serde_json::to_string(&header).map_err(io::Error::other)?
                )
                .as_bytes(),
            )?;
            log.file = Some(file);
        }
        log.append(lines.iter().map(String::as_str))?;
        Ok((log, lines))
    }

    /// Appends all lines in one write call.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn append<'a>(&mut self, lines: impl Iterator<Item = &'a str>) -> io::Result<()> {
        let Some(file) = &mut self.file else {
            return Ok(());
        };
        let mut text = String::new();
        for line in lines {
            // Writing to a `String` cannot fail.
            let _ = writeln!(text, "{:016x} {line}", checksum(line));
        }
        file.write_all(text.as_bytes())
    }
}

/// FNV-1a hash. It detects damage, not manipulation.
fn checksum(line: &str) -> u64 {
    line.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Lines of a file up to the first damaged one; `None` if the file is not a log or has another
/// subject.
fn read(path: &Path, header: &Header) -> Option<Vec<String>> {
    let bytes = fs::read(path).ok()?;
    // The last line is complete only if it ends with a line break.
    let end = bytes.iter().rposition(|byte| *byte == b'\n')?;
    let mut lines = bytes[..end].split(|byte| *byte == b'\n');
    if serde_json::from_slice::<Header>(lines.next()?).ok()? != *header {
        tracing::warn!(file = %path.display(), "checkpoint is of other samples, and left aside");
        return None;
    }
    let sound = |line: &[u8]| {
        let (sum, line) = std::str::from_utf8(line).ok()?.split_once(' ')?;
        (u64::from_str_radix(sum, 16).ok()? == checksum(line)).then(|| line.to_owned())
    };
    Some(lines.map_while(sound).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::{AttemptId, TaskKey};
    use std::path::PathBuf;

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

    fn leave(root: &Path, generation: u32, lines: &[&str]) -> PathBuf {
        let (mut log, _) = SampleLog::open(&checkpoints(root, generation), "a").unwrap();
        log.append(lines.iter().copied()).unwrap();
        root.join(format!("abcd-g{generation}/checkpoint/{FILE}"))
    }

    fn recalled(root: &Path, generation: u32, about: &str) -> Vec<String> {
        SampleLog::open(&checkpoints(root, generation), about)
            .unwrap()
            .1
    }

    #[test]
    fn a_later_attempt_has_the_lines_of_the_one_that_came_furthest() {
        let root = tempfile::tempdir().unwrap();
        leave(root.path(), 1, &["0,0,x", "0,1,y", "0,2,z"]);
        assert_eq!(recalled(root.path(), 2, "a"), ["0,0,x", "0,1,y", "0,2,z"]);
        // The third attempt continues the second, whose log includes the lines of the first.
        fs::remove_dir_all(root.path().join("abcd-g1")).unwrap();
        assert_eq!(recalled(root.path(), 3, "a").len(), 3);
        assert!(recalled(root.path(), 4, "b").is_empty(), "of other samples");
        assert_eq!(
            recalled(root.path(), 5, "a").len(),
            3,
            "the fourth has none, the third has"
        );
    }

    #[test]
    fn a_log_is_read_and_written_as_the_golden_one() {
        let golden = include_bytes!("../tests/golden/samples");
        let lines = ["0,0,periodic,1.5", "0,1,failed,", "1,0,periodic,2.5"];
        let root = tempfile::tempdir().unwrap();
        let path = leave(root.path(), 1, &lines);
        assert_eq!(fs::read(&path).unwrap(), golden);
        fs::write(&path, golden).unwrap();
        assert_eq!(recalled(root.path(), 2, "a"), lines);
    }

    #[test]
    fn what_follows_damage_is_left_aside() {
        let root = tempfile::tempdir().unwrap();
        let path = leave(root.path(), 1, &["0,0,1.5", "0,1,2.5", "0,2,3.5"]);
        let sound = fs::read(&path).unwrap();
        for cut in 1..sound.len() {
            fs::write(&path, &sound[..sound.len() - cut]).unwrap();
            let left = recalled(root.path(), 2, "a");
            assert!(
                left.len() < 3 && left.iter().zip(["0,0,1.5", "0,1,2.5"]).all(|(a, b)| a == b),
                "{left:?}"
            );
            fs::remove_dir_all(root.path().join("abcd-g2")).unwrap();
        }
        let mut flipped = sound.clone();
        let second = sound.len() - 30;
        flipped[second] ^= 1;
        fs::write(&path, &flipped).unwrap();
        assert_eq!(recalled(root.path(), 2, "a"), ["0,0,1.5"]);
    }
}
