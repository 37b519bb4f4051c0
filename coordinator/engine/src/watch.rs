//! Reading of the `progress.jsonl` of running attempts, and workers that write none.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cardiotwin_schemas::formats::PROGRESS;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::progress::Progress;

use crate::dispatch::AttemptFindings;

/// A worker is hung after so many times the longest time between two of its reports.
const PATIENCE: u32 = 10;
/// Least patience between reports: a file system or a suspended machine may stand still for minutes.
const LEAST_PATIENCE: Duration = Duration::from_secs(600);
/// Patience before a second report: a large mesh is set up in silence.
const FIRST_PATIENCE: Duration = Duration::from_secs(1800);

/// The running attempts of a loop.
#[derive(Debug, Default)]
pub struct Watch {
    tails: HashMap<AttemptId, Tail>,
    /// Attempts whose workers are being killed as hung, with the reason.
    hung: HashMap<AttemptId, String>,
}

/// Findings of a look at the running attempts.
#[derive(Debug, Default)]
pub struct Look {
    /// Attempts with new progress.
    pub progress: Vec<(AttemptId, Progress)>,
    /// Attempts without progress for too long, with the reason to kill their workers.
    pub hung: Vec<(AttemptId, String)>,
}

impl Watch {
    /// Starts watching the attempt in `directory`.
    pub fn begin(&mut self, attempt: &AttemptId, directory: &Path) {
        self.tails.insert(attempt.clone(), Tail::of(directory));
    }

    /// Whether the attempt is watched.
    #[must_use]
    pub fn has(&self, attempt: &AttemptId) -> bool {
        self.tails.contains_key(attempt)
    }

    /// Reads the progress of all watched attempts.
    ///
    /// - `timeout_s`: `executor.hang_timeout_s` of an attempt
    pub fn look(&mut self, timeout_s: impl Fn(&AttemptId) -> Option<f64>, now: Instant) -> Look {
        let mut look = Look::default();
        for (attempt, tail) in &mut self.tails {
            let progress = tail.next().map(|progress| (attempt.clone(), progress));
            look.progress.extend(progress);
            if let Some(why) = tail.hung(timeout_s(attempt), now)
                && !self.hung.contains_key(attempt)
            {
                look.hung.push((attempt.clone(), why));
            }
        }
        look
    }

    /// Notes that the attempt's worker is being killed as hung.
    pub fn kills(&mut self, attempt: AttemptId, why: String) {
        self.hung.insert(attempt, why);
    }

    /// Stops watching an attempt that ended. A killed worker leaves no evidence but the reason.
    pub fn ended(&mut self, attempt: &AttemptId, evidence: &mut AttemptFindings) {
        self.leaves(attempt);
        if let (Some(why), AttemptFindings::Nothing { reason, .. }) =
            (self.hung.remove(attempt), evidence)
        {
            *reason = why;
        }
    }

    /// Stops watching an attempt that is out of sight.
    pub fn leaves(&mut self, attempt: &AttemptId) {
        self.tails.remove(attempt);
    }
}

/// Reader of one attempt's progress.
#[derive(Debug)]
struct Tail {
    path: PathBuf,
    offset: u64,
    /// Time of the last growth, or of the opening.
    grew: Instant,
    /// Number of growths.
    n_reports: u32,
    /// Longest time between two growths.
    longest: Duration,
}

impl Tail {
    /// Starts reading the progress of the attempt in `directory`.
    fn of(directory: &Path) -> Self {
        Self {
            path: directory.join(cardiotwin_protocol::names::PROGRESS),
            offset: 0,
            grew: Instant::now(),
            n_reports: 0,
            longest: Duration::ZERO,
        }
    }

    /// Why the worker is considered hung at the time `now`; `None` if it is not. `timeout_s` is
    /// `executor.hang_timeout_s`.
    fn hung(&self, timeout_s: Option<f64>, now: Instant) -> Option<String> {
        let patience = match timeout_s {
            Some(0.0) => return None,
            Some(timeout_s) => Duration::from_secs_f64(timeout_s),
            None if self.n_reports < 2 => FIRST_PATIENCE,
            None => (self.longest * PATIENCE).max(LEAST_PATIENCE),
        };
        let patience_s = patience.as_secs_f64();
        (now.duration_since(self.grew) > patience).then(|| {
            format!("no progress for {patience_s:.0} s: the worker was considered hung and killed")
        })
    }

    /// The last complete line since the previous call; `None` if there is none. Progress is only
    /// informative, so unreadable lines are skipped.
    fn next(&mut self) -> Option<Progress> {
        let mut file = File::open(&self.path).ok()?;
        if file.metadata().ok()?.len() <= self.offset {
            return None;
        }
        file.seek(SeekFrom::Start(self.offset)).ok()?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).ok()?;
        let complete = bytes.iter().rposition(|byte| *byte == b'\n')? + 1;
        self.offset += complete as u64;
        let now = Instant::now();
        if self.n_reports > 0 {
            self.longest = self.longest.max(now.duration_since(self.grew));
        }
        self.n_reports += 1;
        self.grew = now;
        bytes[..complete]
            .split(|byte| *byte == b'\n')
            .rev()
            .find_map(|line| PROGRESS.read(&self.path.display(), line).ok())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_worker_is_hung_by_default() {
        let dir = tempfile::tempdir().unwrap();
        let mut tail = Tail::of(dir.path());
        let after = |tail: &Tail, s: u64| tail.grew + Duration::from_secs(s);
        assert_eq!(tail.hung(None, after(&tail, 1800)), None);
        assert!(tail.hung(None, after(&tail, 1801)).is_some());
        assert_eq!(tail.hung(Some(0.0), after(&tail, 1_000_000)), None);
        let said = tail.hung(Some(3.0), after(&tail, 4)).unwrap();
        assert!(said.contains("no progress for 3 s"), "{said}");

        let line = r#"{"at":"t","phase":"p","done":1,"total":4,"note":"n"}"#.to_owned() + "\n";
        let path = dir.path().join("progress.jsonl");
        for n in 1..=2 {
            std::fs::write(&path, line.repeat(n)).unwrap();
            assert!(tail.next().is_some());
        }
        assert_eq!(tail.hung(None, after(&tail, 600)), None);
        assert!(tail.hung(None, after(&tail, 601)).is_some());
        tail.longest = Duration::from_secs(90);
        assert_eq!(tail.hung(None, after(&tail, 899)), None);
        assert!(tail.hung(None, after(&tail, 901)).is_some());
    }

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
