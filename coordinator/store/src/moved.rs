//! Files of a cohort that was copied or moved together with its run.

use std::path::{Path, PathBuf};

/// File by which a cohort's folder is recognised.
const COHORT: &str = "cohort.toml";

/// A cohort that lies elsewhere than when the run read its files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MovedCohort {
    /// Folder in which the run read the files.
    pub was: PathBuf,
    /// Folder in which the run's folder lies now.
    pub is: PathBuf,
}

impl MovedCohort {
    /// The cohort of a run whose folder was copied or moved with it; `None` for any other run.
    ///
    /// - `was_run`, `is_run`: absolute folders of the run
    pub(super) fn of(was_run: &Path, is_run: &Path) -> Option<Self> {
        let (was, is) = (was_run.parent()?, is_run.parent()?);
        let same_name = was_run.file_name() == is_run.file_name();
        let stayed = was == is || was.canonicalize().ok() == is.canonicalize().ok();
        (same_name && !stayed && is.join(COHORT).exists()).then(|| Self {
            was: was.to_owned(),
            is: is.to_owned(),
        })
    }

    /// The plan's text with the paths of the cohort's files where they lie now.
    pub(super) fn plan(moved: Option<&Self>, text: String) -> String {
        let Some(moved) = moved else { return text };
        let below = |folder: &Path| {
            let path = format!("{}/", folder.display());
            let text = serde_json::Value::from(path).to_string();
            format!("\"path\":{}", text.trim_end_matches('"'))
        };
        text.replace(&below(&moved.was), &below(&moved.is))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_below_the_former_cohort_lie_below_the_present_one() {
        let folder = tempfile::tempdir().unwrap();
        let is = folder.path().join("copy");
        std::fs::create_dir_all(is.join("run")).unwrap();
        let was_run = Path::new("/data/coa/run");
        assert_eq!(MovedCohort::of(was_run, &is.join("run")), None, "no cohort");
        std::fs::write(is.join(COHORT), "").unwrap();
        assert_eq!(MovedCohort::of(&is.join("run"), &is.join("run")), None);
        assert_eq!(MovedCohort::of(was_run, &is.join("other")), None);
        let moved = MovedCohort::of(was_run, &is.join("run"));
        let text = |folder: &Path| {
            let inside = folder.join("P1/p.csv");
            format!(
                r#"{{"path":"{}"}},{{"path":"/data/coa-2/p.csv"}}"#,
                inside.display()
            )
        };
        let found = MovedCohort::plan(moved.as_ref(), text(Path::new("/data/coa")));
        assert_eq!(found, text(&is));
    }
}
