//! Keys that name files: the files lie in the cohort unless `allow_outside = true` in `cohort.toml`.
//!
//! A patient's folder may come from somebody else. Without this rule its keys or links could make
//! the program read, hash and copy any file of the user.

use std::fs;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::patient::PatientFile;
use cardiotwin_schemas::settings::Fidelity;
use cardiotwin_signals::Problem;

use super::document::Document;
use super::external;
use super::further;
use super::layers::{Merged, position_of};
use super::report::Report;

/// Folders in which a patient's files may lie.
pub(super) struct Bounds {
    /// `None` allows any place.
    folders: Option<[PathBuf; 2]>,
}

impl Bounds {
    /// - `folders`: the patient's folder and the cohort's
    /// - `allow_outside`: the cohort's key
    pub(super) fn of(folders: [&Path; 2], allow_outside: bool) -> Self {
        Self {
            folders: (!allow_outside).then(|| folders.map(Path::to_owned)),
        }
    }

    /// Place of an existing file that lies outside; `None` for all others.
    fn left_by(&self, file: &Path) -> Option<PathBuf> {
        let folders = self.folders.as_ref()?;
        let place = file.canonicalize().ok()?;
        let mut real = folders
            .iter()
            .filter_map(|folder| folder.canonicalize().ok());
        let is_inside = real.any(|folder| place.starts_with(folder));
        (!is_inside).then_some(place)
    }

    /// As [`Bounds::left_by`] for a file that a patient in `folder` names.
    fn left_by_named(&self, folder: &Path, name: &str) -> Option<PathBuf> {
        let file = folder.join(name);
        // A name without folders leads outside only by a link. Asking that is much cheaper than
        // resolving the path, which counts with thousands of patients.
        let is_plain = Path::new(name).file_name().is_some_and(|last| last == name);
        let is_link = || fs::symlink_metadata(&file).is_ok_and(|file| file.is_symlink());
        if is_plain && !is_link() {
            return None;
        }
        self.left_by(&file)
    }
}

/// Reports every key of a patient that names a file outside the cohort. Returns whether there is one;
/// none of the patient's files should be read then.
pub(super) fn check(
    file: &PatientFile,
    (folder, cohort_folder): (&Path, &Path),
    settings: &Merged,
    bounds: &Bounds,
    document: &Document,
    report: &mut Report,
) -> bool {
    let patient = folder.file_name().and_then(|name| name.to_str());
    let mut has_one = false;
    let mut refuse = |problem: Problem| {
        has_one = true;
        report.add(patient, problem);
    };
    let said = |stray: &Path| format!("a file outside the cohort, {}", stray.display());
    let (expected, remedy) = (
        "a file in the cohort's folder",
        "copy it there, or set `allow_outside = true` at the top of cohort.toml if you trust its \
         patients' files",
    );
    for (key, name) in named_files(file) {
        if let Some(stray) = bounds.left_by_named(folder, &name) {
            let problem = Problem::error(&document.file, said(&stray), expected, remedy);
            refuse(problem.at_key(key.as_str()).at(position_of(document, &key)));
        }
    }
    if settings.settings.solver.fidelity == Fidelity::External {
        for (name, file) in &settings.settings.solver.external.files {
            let path = external::file(file, folder, cohort_folder);
            if let Some(stray) = bounds.left_by(&path) {
                let key = format!("solver.external.files.{name}");
                refuse(settings.problem(&key, Some(document), [&said(&stray), expected, remedy]));
            }
        }
    }
    has_one
}

/// Keys of a patient's file that name files, with every file that belongs to them.
fn named_files(file: &PatientFile) -> Vec<(String, String)> {
    let measured = &file.measured;
    let mesh = file.anatomy.mesh.as_ref();
    let right = mesh.and_then(|mesh| mesh.right_ventricle.as_ref());
    let mut named = vec![
        ("measured.pressure", measured.pressure.clone()),
        ("measured.volume", measured.volume.clone()),
        ("measured.calcium", measured.calcium.clone()),
        (
            "anatomy.mesh.activation_times_ms",
            mesh.and_then(|mesh| mesh.activation_times_ms.clone()),
        ),
        (
            "anatomy.mesh.right_ventricle.pressure",
            right.and_then(|right| right.pressure.clone()),
        ),
    ];
    if let Some(mesh) = mesh {
        // A stem stands for several files, of which some are links perhaps.
        let endings = ["", ".pts", ".elem", ".lon"];
        let files = endings.map(|ending| format!("{}{ending}", mesh.file));
        named.extend(files.map(|file| ("anatomy.mesh.file", Some(file))));
    }
    let there = named
        .into_iter()
        .filter_map(|(key, name)| Some((key.to_owned(), name?)));
    there.chain(further::files(measured)).collect()
}
