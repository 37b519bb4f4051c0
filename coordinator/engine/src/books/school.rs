//! Pilots of the run with what they teach, as the store keeps them.

use std::collections::HashMap;

use cardiotwin_schemas::organ_law::LawLesson;
use cardiotwin_store::pilots::{LESSONS, PILOTS, Pilots};

/// Pilots with what they teach.
#[derive(Debug, Default)]
pub struct School {
    pub(super) pilots: Pilots,
    /// What the pilots teach; `None` until all have ended.
    pub(super) lessons: Option<Vec<LawLesson>>,
}

impl School {
    /// Takes the stored pilots and lessons.
    pub(super) fn of(meta: &HashMap<String, String>) -> Self {
        // Both are written by this program; text of a later one counts as none, and is made again.
        let read = |key: &str| meta.get(key).map(String::as_str);
        Self {
            pilots: read(PILOTS)
                .and_then(|text| serde_json::from_str(text).ok())
                .unwrap_or_default(),
            lessons: read(LESSONS).and_then(|text| serde_json::from_str(text).ok()?),
        }
    }
}
