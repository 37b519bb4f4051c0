//! Identifiers with distinct types, so that they cannot be confused: patient, task, attempt and
//! allocation.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! text_id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
        #[serde(transparent)]
        pub struct $name(pub String);

        impl $name {
            /// Text of the identifier, as in files and paths.
            #[must_use]
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&self.0)
            }
        }

        impl From<&str> for $name {
            fn from(text: &str) -> Self {
                Self(text.to_owned())
            }
        }
    };
}

text_id!(
    /// Pseudonym of a patient, unique in the cohort.
    PatientId
);
text_id!(
    /// Key of a task: hash of the canonical spec, the contents of its inputs and the model version
    /// (64 hex digits).
    TaskKey
);
text_id!(
    /// Identifier given by the executor: a process id (local) or a job id (Slurm).
    ExternalId
);

/// Identifier of an attempt at a task. Only the current generation may publish, which excludes
/// earlier attempts.
#[derive(
    Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
pub struct AttemptId {
    /// Key of the task.
    pub task: TaskKey,
    /// Number of the attempt, from 1.
    pub generation: u32,
}

impl fmt::Display for AttemptId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}#{}",
            &self.task.0[..self.task.0.len().min(12)],
            self.generation
        )
    }
}
