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
            /// Identifier as text.
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
    /// A patient's pseudonym, unique in the cohort.
    PatientId
);
text_id!(
    /// What is wanted: hash of the canonical spec, its inputs' contents and the model version (64 hex digits).
    TaskKey
);
text_id!(
    /// What a scheduler gave: a process id for the local executor, a job id for Slurm.
    ExternalId
);

/// One try at a task: the generation fences it, since only the current generation publishes.
#[derive(
    Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
pub struct AttemptId {
    /// The task that is tried.
    pub task: TaskKey,
    /// 1 for the first try, raised by one at each further one.
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
