//! Patients whose files are as an earlier run saw them, recognised without being read.
//!
//! A patient's mark is a hash of the program, of the cohort's settings and of name, inode, size and
//! times of everything in the patient's folder. An equal mark means that reading the folder again
//! leads to the same plan. As in git's index, a mark counts only if everything had been at rest for
//! [`REST`] when it was read: a file that is written again within the same tick of the file system's
//! clock, with the same size, would otherwise keep its mark.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::Fidelity;
use serde_json::Value;

/// Time for which a file must not have changed before it was read, so that a later change is seen in
/// its times. The coarsest clocks of file systems tick every 2 s.
pub const REST: Duration = Duration::from_secs(2);

/// Patients that an earlier run has read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Known {
    /// Identity of the program that reads; another program may find other plans in the same files.
    pub program: String,
    /// Mark of each patient, by its folder's name.
    pub marks: BTreeMap<String, String>,
}

/// What the marks of a cohort's patients have in common.
#[derive(Debug)]
pub(super) struct Marks<'a> {
    known: Option<&'a Known>,
    /// Everything outside the patient's folder on which its plan depends.
    context: String,
    meshes: bool,
}

impl<'a> Marks<'a> {
    /// - `known`: `None` if nothing is to be recognised
    /// - `context`: cohort.toml, options and merged settings
    /// - `meshes`: whether patients' own meshes are read and checked
    pub(super) fn of(known: Option<&'a Known>, context: &[String], meshes: bool) -> Self {
        let program = known.map_or("", |known| &known.program);
        let text = serde_json::to_string(&(program, context)).expect("texts are JSON");
        Self {
            // Without an identity it is not known whether the same program reads.
            known: known.filter(|known| !known.program.is_empty()),
            context: sha256_hex(text.as_bytes()),
            meshes,
        }
    }

    /// Mark of a folder at this moment; `None` if the folder cannot be recognised later, because
    /// something in it is no plain file or is still changing.
    pub(super) fn mark(&self, folder: &Path, now: SystemTime) -> Option<String> {
        self.known?;
        let (mark, newest) = mark(&self.context, folder)?;
        let age = now.duration_since(newest).ok()?;
        (age >= REST).then_some(mark)
    }

    /// Whether a folder is as an earlier run saw it.
    pub(super) fn is_known(&self, id: &str, folder: &Path) -> bool {
        let before = self.known.and_then(|known| known.marks.get(id));
        before.is_some_and(|before| {
            mark(&self.context, folder).is_some_and(|(mark, _)| mark == *before)
        })
    }

    /// Whether the plan depends on nothing but the context and plain files in the patient's folder.
    pub(super) fn covers(&self, plan: &ResolvedPatient, folder: &Path) -> bool {
        let Ok(folder) = folder.canonicalize() else {
            return false;
        };
        let is_apart = plan.settings.solver.fidelity != Fidelity::External
            // Pilots are chosen among the plans of all patients.
            && plan.n_pilots() == 0
            && (self.meshes || plan.step0.own_mesh.is_none());
        let value = serde_json::to_value(plan).expect("a plan is JSON");
        is_apart && names_only(&value, &folder)
    }
}

/// Whether every file that a plan names (a `path` next to a `sha256`, at any depth) lies in a folder
/// itself, and not below it.
fn names_only(value: &Value, folder: &Path) -> bool {
    match value {
        Value::Object(fields) => {
            let is_inside = match (fields.get("path"), fields.get("sha256")) {
                (Some(Value::String(path)), Some(_)) => Path::new(path).parent() == Some(folder),
                _ => true,
            };
            is_inside && fields.values().all(|value| names_only(value, folder))
        }
        Value::Array(values) => values.iter().all(|value| names_only(value, folder)),
        _ => true,
    }
}

/// Mark of a folder of plain files, and the newest of all their times; `None` for any other folder.
fn mark(context: &str, folder: &Path) -> Option<(String, SystemTime)> {
    let own = fs::symlink_metadata(folder).ok()?;
    if !own.is_dir() {
        return None;
    }
    let mut newest = changed_at(&own)?;
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).ok()? {
        let entry = entry.ok()?;
        // Of a link its own times are read, not those of the file to which it leads.
        let found = entry.metadata().ok()?;
        if !found.is_file() {
            return None;
        }
        newest = newest.max(changed_at(&found)?);
        entries.push((entry.file_name(), found));
    }
    entries.sort_by(|(one, _), (other, _)| one.cmp(other));
    let mut text = format!("{context}\n{}\n", folder.display());
    let mut add = |name: &[u8], of: &Metadata| {
        let _ = writeln!(
            text,
            "{} {} {} {} {}.{} {}.{}",
            name.escape_ascii(),
            of.dev(),
            of.ino(),
            of.size(),
            of.mtime(),
            of.mtime_nsec(),
            of.ctime(),
            of.ctime_nsec()
        );
    };
    add(b"", &own);
    for (name, found) in &entries {
        add(name.as_encoded_bytes(), found);
    }
    Some((sha256_hex(text.as_bytes()), newest))
}

/// The later of the times of content and of attributes; `None` before 1970.
fn changed_at(of: &Metadata) -> Option<SystemTime> {
    let time = |seconds: i64, nanoseconds: i64| {
        let seconds = Duration::from_secs(u64::try_from(seconds).ok()?);
        Some(UNIX_EPOCH + seconds + Duration::from_nanos(u64::try_from(nanoseconds).ok()?))
    };
    Some(time(of.mtime(), of.mtime_nsec())?.max(time(of.ctime(), of.ctime_nsec())?))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::Options;
    use crate::tests::{COHORT, Folder, PATIENT};

    fn known(program: &str) -> Known {
        Known {
            program: program.to_owned(),
            marks: BTreeMap::new(),
        }
    }

    /// A change right after the first look, in the same tick of the clock and with the same size:
    /// a folder that is still changing has no mark.
    #[test]
    fn a_folder_that_changes_within_a_tick_is_never_recognised() {
        for change in [
            |at: &Path| fs::write(at.join("pressure.csv"), "xyz"),
            |at: &Path| fs::write(at.join("model.toml"), ""),
            |at: &Path| fs::remove_file(at.join("pressure.csv")),
            |at: &Path| fs::rename(at.join("pressure.csv"), at.join("volume.csv")),
            |at: &Path| std::os::unix::fs::symlink("/etc/hostname", at.join("link")),
            |at: &Path| fs::create_dir(at.join("mesh")),
        ] {
            let folder = tempfile::tempdir().unwrap();
            fs::write(folder.path().join("pressure.csv"), "abc").unwrap();
            let program = known("p");
            let marks = Marks::of(Some(&program), &["c".to_owned()], true);
            let before = marks.mark(folder.path(), SystemTime::now());
            change(folder.path()).unwrap();
            let marks = before.into_iter().map(|mark| ("P1".to_owned(), mark));
            let later = Known {
                marks: marks.collect(),
                ..known("p")
            };
            let marks = Marks::of(Some(&later), &["c".to_owned()], true);
            assert!(!marks.is_known("P1", folder.path()));
        }
    }

    #[test]
    fn a_folder_at_rest_is_recognised_and_each_later_change_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pressure.csv");
        fs::write(&file, "abc").unwrap();
        let program = known("p");
        let marks = Marks::of(Some(&program), &["c".to_owned()], true);
        let now = SystemTime::now();
        assert_eq!(marks.mark(folder.path(), now), None, "it changed just now");
        let mark = marks.mark(folder.path(), now + REST).unwrap();
        // Longer than a tick of the file system's clock.
        std::thread::sleep(Duration::from_millis(50));
        let later = |program: &str, context: &str| {
            let known = Known {
                program: program.to_owned(),
                marks: [("P1".to_owned(), mark.clone())].into(),
            };
            Marks::of(Some(&known), &[context.to_owned()], true).is_known("P1", folder.path())
        };
        assert!(later("p", "c"));
        assert!(!later("q", "c"), "another program may find another plan");
        assert!(!later("p", "d"), "other settings");
        assert!(!later("", "c"), "an unknown program");

        // The same size and the old time of the content: the time of the attributes differs.
        let modified = fs::metadata(&file).unwrap().modified().unwrap();
        fs::write(&file, "abd").unwrap();
        let written = fs::File::options().write(true).open(&file).unwrap();
        written.set_modified(modified).unwrap();
        assert!(!later("p", "c"));
    }

    /// The names of the patients that were read, those of the others with their positions, and the
    /// marks for the next load.
    fn loaded(of: &Folder, known: Known, set: &str) -> (Vec<String>, Vec<(usize, String)>, Known) {
        let options = Options {
            known: Some(known.clone()),
            set: vec![set.to_owned()],
            ..Options::default()
        };
        let (cohort, said) = of.load(&options);
        assert_eq!(said, Vec::<String>::new());
        let cohort = cohort.unwrap();
        let read = cohort.patients.iter().map(|patient| patient.id.clone());
        let marks = cohort.patients.iter();
        let marks = marks.filter_map(|one| Some((one.id.clone(), one.mark.clone()?)));
        let marks = Known {
            marks: known.marks.into_iter().chain(marks).collect(),
            ..known
        };
        (read.collect(), cohort.unchanged, marks)
    }

    #[test]
    fn unchanged_patients_are_not_read_and_keep_their_positions() {
        let names = ["P1", "P2", "P3"];
        let texts = names.map(|name| PATIENT.replace("P1", name));
        let patients: Vec<(&str, &str)> =
            names.into_iter().zip(texts.iter().map(|t| &**t)).collect();
        let folder = Folder::new(COHORT, &patients);
        let (at_rest, set) = (REST + Duration::from_millis(100), "step1.damping=0.5");
        std::thread::sleep(at_rest);
        let (read, unchanged, marks) = loaded(&folder, known("p"), set);
        assert_eq!((read.len(), unchanged.len(), marks.marks.len()), (3, 0, 3));
        let (read, unchanged, _) = loaded(&folder, marks.clone(), set);
        assert!(read.is_empty());
        let all = names.into_iter().map(str::to_owned).enumerate();
        assert_eq!(unchanged, all.collect::<Vec<_>>());

        assert_eq!(loaded(&folder, marks.clone(), "step1.damping=0.6").0, names);
        let second = folder.path().join("patients/P2/patient.toml");
        fs::write(&second, texts[1].replace("700", "701")).unwrap();
        let (read, unchanged, later) = loaded(&folder, marks.clone(), set);
        assert_eq!(read, ["P2"]);
        assert_eq!(unchanged, [(0, "P1".to_owned()), (2, "P3".to_owned())]);
        assert_eq!(
            later.marks["P2"], marks.marks["P2"],
            "it was still changing"
        );
        fs::write(folder.path().join("cohort.toml"), format!("{COHORT}\n")).unwrap();
        assert_eq!(loaded(&folder, marks, set).0, names);
    }
}
