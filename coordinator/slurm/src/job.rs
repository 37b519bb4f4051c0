//! Identifiers of jobs: number, index in an array, name.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A job as shown to Slurm's users: a number, and the index of an array's element. The number of an
/// element alone is not sufficient: the elements of array 803 may be 804, 805 and, for the last
/// one, 803.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct JobId {
    /// Number of the job; for an element, of the whole array.
    pub job: u64,
    /// Index in the array; `None` for a single job.
    pub element: Option<u32>,
}

impl JobId {
    /// Id of a job that is not an array.
    #[must_use]
    pub fn single(job: u64) -> Self {
        Self { job, element: None }
    }

    /// Id of an element of an array.
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

/// Jobs that one row of an answer stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Jobs {
    /// A single job or element.
    One(JobId),
    /// Waiting elements of an array, which sacct collapses: `12_[0-3,7%2]`.
    Waiting {
        /// Number of the array.
        job: u64,
        /// Inclusive ranges of indices.
        ranges: Vec<(u32, u32)>,
        /// False if Slurm cut off the list (`...`) and there are more elements than listed.
        complete: bool,
    },
}

impl Jobs {
    /// Reads `12`, `12_3` and `12_[0-3,7%2]`. Any other text, such as a step or a heterogeneous
    /// component, is `None`.
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
                return None; // a stepped range, which the scripts of this crate never use
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

    /// Whether the row stands for this job. A cut list counts only for the elements that it shows.
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

/// Reads a number of digits only; `str::parse` would accept a sign, too.
#[must_use]
pub fn number<T: std::str::FromStr>(text: &str) -> Option<T> {
    if !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit()) {
        text.parse().ok()
    } else {
        None
    }
}

/// Error for a text that is no valid name of a job.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' is not a valid job name: expected 1 to 120 letters, digits, '.', '_' and '-', beginning \
     with a letter or digit"
)]
pub struct NotAName(pub String);

/// A unique name of a submission, which is committed before `sbatch` and looked up after a doubtful
/// answer. It is restricted to characters that have no other meaning in a shell, a format or a list
/// of names.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct JobName(String);

impl JobName {
    /// Checks a name.
    ///
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

    /// The name as text.
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
