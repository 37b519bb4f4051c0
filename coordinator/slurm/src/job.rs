//! What a job is called: its number, its place in an array, its name.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A job as Slurm's user sees it: a number, and for an element of an array its index. The number of an element alone
/// says nothing: the elements of array 803 may be 804, 805 and, the last of them, 803.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct JobId {
    /// Number of the job; of the whole array for an element.
    pub job: u64,
    /// Index in the array.
    pub element: Option<u32>,
}

impl JobId {
    /// A job that is no array.
    #[must_use]
    pub fn single(job: u64) -> Self {
        Self { job, element: None }
    }

    /// An element of an array.
    #[must_use]
    pub fn element(job: u64, element: u32) -> Self {
        Self {
            job,
            element: Some(element),
        }
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.element {
            Some(element) => write!(f, "{}_{element}", self.job),
            None => write!(f, "{}", self.job),
        }
    }
}

/// Jobs that one row of an answer speaks of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Jobs {
    /// One.
    One(JobId),
    /// Elements of an array that still wait, which sacct collapses: `12_[0-3,7%2]`.
    Waiting {
        /// The array.
        job: u64,
        /// Inclusive ranges of indices.
        ranges: Vec<(u32, u32)>,
        /// False where Slurm cut the list off (`...`): there are more than are listed.
        complete: bool,
    },
}

impl Jobs {
    /// Reads `12`, `12_3` and `12_[0-3,7%2]`; anything else, such as a step or a heterogeneous component, is `None`.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let Some((job, rest)) = text.split_once('_') else {
            return Some(Self::One(JobId::single(number(text)?)));
        };
        let job = number(job)?;
        let Some(list) = rest.strip_prefix('[') else {
            return Some(Self::One(JobId::element(job, number(rest)?)));
        };
        let list = list.strip_suffix(']')?;
        let list = list.split_once('%').map_or(list, |(list, _)| list);
        let (mut ranges, mut complete) = (Vec::new(), true);
        for part in list.split(',') {
            if part == "..." {
                complete = false;
                continue;
            }
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (
                number(first)?,
                number(last.split_once(':').map_or(last, |(last, _)| last))?,
            );
            if part.contains(':') {
                return None; // a stepped range: not written by the scripts of this crate
            }
            if first > last {
                return None;
            }
            ranges.push((first, last));
        }
        Some(Self::Waiting {
            job,
            ranges,
            complete,
        })
    }

    /// Whether the row speaks of this job. A cut list speaks of those that it shows.
    #[must_use]
    pub fn contains(&self, id: JobId) -> bool {
        match self {
            Self::One(one) => *one == id,
            Self::Waiting { job, ranges, .. } => {
                *job == id.job
                    && id.element.is_some_and(|element| {
                        ranges.iter().any(|(a, b)| (*a..=*b).contains(&element))
                    })
            }
        }
    }
}

/// Digits only: `str::parse` would take a sign, too.
pub(crate) fn number<T: std::str::FromStr>(text: &str) -> Option<T> {
    if !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit()) {
        text.parse().ok()
    } else {
        None
    }
}

/// Why a text is no name of ours.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' is no name for a job: expected 1 to 120 letters, digits, '.', '_' and '-', the first a letter or digit"
)]
pub struct NotAName(pub String);

/// A unique name of a submission, committed before `sbatch` and looked up after a doubtful answer. Restricted to what
/// no shell, format or list of names reads as anything else.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct JobName(String);

impl JobName {
    /// # Errors
    /// [`NotAName`] for an empty, long or unusual text.
    pub fn new(text: &str) -> Result<Self, NotAName> {
        let good = (1..=120).contains(&text.len())
            && text
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-'))
            && text.as_bytes()[0].is_ascii_alphanumeric();
        if good {
            Ok(Self(text.to_owned()))
        } else {
            Err(NotAName(text.to_owned()))
        }
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for JobName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for JobName {
    type Error = NotAName;
    fn try_from(text: String) -> Result<Self, NotAName> {
        Self::new(&text)
    }
}

impl From<JobName> for String {
    fn from(name: JobName) -> Self {
        name.0
    }
}

#[cfg(test)]
mod tests {
    use super::{JobId, JobName, Jobs};

    #[test]
    fn ids_as_slurm_writes_them() {
        assert_eq!(Jobs::parse("12"), Some(Jobs::One(JobId::single(12))));
        assert_eq!(Jobs::parse("12_3"), Some(Jobs::One(JobId::element(12, 3))));
        let waiting = Jobs::parse("12_[0-3,7%2]").expect("a collapsed row");
        for (element, inside) in [(0, true), (3, true), (4, false), (7, true), (8, false)] {
            assert_eq!(
                waiting.contains(JobId::element(12, element)),
                inside,
                "{element}"
            );
        }
        assert!(!waiting.contains(JobId::single(12)) && !waiting.contains(JobId::element(13, 0)));
        let cut = Jobs::parse("12_[1,3,...]").expect("a cut row");
        assert!(matches!(
            cut,
            Jobs::Waiting {
                complete: false,
                ..
            }
        ));
        for odd in [
            "",
            "12.batch",
            "12+1",
            "-12",
            "+12",
            "12_",
            "12_[",
            "12_[3-1]",
            "12_[0-8:2]",
            "12 ",
        ] {
            assert_eq!(Jobs::parse(odd), None, "{odd:?}");
        }
    }

    #[test]
    fn names_that_no_shell_misreads() {
        assert!(JobName::new("ct-coa-seven-P001-g2").is_ok());
        for odd in ["", "-x", "a b", "a|b", "a,b", "é", "a;b", &"x".repeat(121)] {
            assert!(JobName::new(odd).is_err(), "{odd:?}");
        }
    }
}
