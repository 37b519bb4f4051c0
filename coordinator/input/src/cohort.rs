//! A cohort's folder: `cohort.toml`, a folder per patient, and the effects accepted for them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_schemas::cohort::CohortFile;
use cardiotwin_schemas::overlay::ModelOverlay;
use cardiotwin_schemas::patient::PatientFile;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{Fidelity, Settings};
use cardiotwin_signals::{Position, Problem};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::document::Document;
use super::effects::Accepted;
use super::layers::{Layer, Merged, Origin, place, position_of, positions};
use super::nearest::nearest;
use super::outside::{self, Bounds};
use super::report::Report;
use super::seen::{Known, Marks};
use super::{data, mesh, patient, ranges, resolve, shape};

/// Options of a load beyond the files.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Ids of the patients to load; empty means all.
    pub only: Vec<String>,
    /// Settings stored by `rerun`, by patient.
    pub overrides: BTreeMap<String, Value>,
    /// Assignments `key=value` that the run keeps.
    pub kept: Vec<String>,
    /// Assignments `key=value` from the command line.
    pub set: Vec<String>,
    /// Whether patients' own meshes are read and checked, which takes seconds for large meshes.
    pub meshes: bool,
    /// Whether the effects accepted for patients are left unread, as where they are searched again or
    /// undone.
    pub unaccepted: bool,
    /// Patients that an earlier run has read. Those whose files are as they were are not read.
    /// `None` reads all.
    pub known: Option<Known>,
    /// Whether only the plans are wanted: what explains where a value comes from is left out,
    /// because of thousands of patients it fills the memory.
    pub plans_only: bool,
}

/// A cohort as read from its folder.
#[derive(Debug, Clone)]
pub struct Cohort {
    /// Folder of the cohort, as given.
    pub directory: PathBuf,
    /// Name of the cohort.
    pub name: String,
    /// Description in one sentence.
    pub description: String,
    /// Settings of the cohort, without any patient's own settings.
    pub settings: Arc<Merged>,
    /// Patients in the order of their folders' names, without the unchanged ones.
    pub patients: Vec<Patient>,
    /// Patients whose files are as an earlier run saw them, with their positions among all patients
    /// that have a plan.
    pub unchanged: Vec<(usize, String)>,
}

/// A patient as read from its folder.
#[derive(Debug, Clone)]
pub struct Patient {
    /// Pseudonym of the patient, which is its folder's name.
    pub id: String,
    /// Settings from all layers. Patients without settings of their own share the cohort's.
    pub settings: Arc<Merged>,
    /// Path of patient.toml, and the position of each of its keys.
    pub positions: (PathBuf, BTreeMap<String, Position>),
    /// Content of patient.toml, before defaults and estimates fill it.
    pub file: PatientFile,
    /// Folder that holds patient.toml.
    pub folder: PathBuf,
    /// The plan without anything accepted for the patient; `None` if the patient has errors.
    pub measured: Option<ResolvedPatient>,
    /// The plan; `None` if the patient has errors.
    pub resolved: Option<ResolvedPatient>,
    /// Mark by which a later run recognises the patient's files; `None` if it has to read them.
    pub mark: Option<String>,
}

impl Patient {
    /// Places where the value called `name` (the last part of a key) was set: dotted key and place,
    /// settings first. A value that nothing sets is a default.
    #[must_use]
    pub fn places_of(&self, name: &str) -> Vec<(String, String)> {
        let ends = |key: &str| key.rsplit('.').next() == Some(name);
        let leaves = self.settings.leaves().into_iter();
        let (defaults, set): (Vec<_>, Vec<_>) = leaves
            .filter(|(key, _, _)| ends(key))
            .map(|(key, _, origin)| (key, origin))
            .partition(|(_, origin)| matches!(origin, Origin::Default));
        let words = |(key, origin): (String, Origin)| (key, origin.to_string());
        let mut places: Vec<(String, String)> = set.into_iter().map(words).collect();
        let (file, positions) = &self.positions;
        let own = positions
            .iter()
            .filter(|(key, _)| ends(key) && !key.starts_with("settings."));
        places.extend(own.map(|(key, at)| {
            let place = format!("{}:{}", file.display(), at.line);
            (key.clone(), place)
        }));
        if places.is_empty() {
            places.extend(defaults.into_iter().map(words));
        }
        places
    }
}

impl Cohort {
    /// Plans of the patients without errors.
    #[must_use]
    pub fn plans(&self) -> Vec<ResolvedPatient> {
        self.patients
            .iter()
            .filter_map(|patient| patient.resolved.clone())
            .collect()
    }
}

/// Reads and checks a cohort. Every problem of every file goes to `report`. `None` if `cohort.toml`
/// cannot be read.
pub fn load(directory: &Path, options: &Options, report: &mut Report) -> Option<Cohort> {
    let path = inside(directory, "cohort.toml");
    let kept = Layer::from_kept(&options.kept, report);
    let command_line = Layer::from_command_line(&options.set, report);
    let document = Document::read(&path, None, report)?;
    let file: CohortFile = read_as(&document, None, report)?;
    let cohort_layer = Layer::from_file(&file.layer(), &document, "");
    let defaults = Layer::defaults();
    let layers = [&defaults, &cohort_layer, &kept, &command_line];
    let merged = Arc::new(merged(layers, &path, None, report)?);
    complain(&merged, None, report);
    check_defaults(&file, &document, report);
    let folders = patient_folders(directory, &file, &document, report);
    select(&folders, &options.only, report);
    let is_asked = |id: &String| options.only.is_empty() || options.only.contains(id);
    let asked: Vec<&(String, PathBuf)> = folders.iter().filter(|(id, _)| is_asked(id)).collect();
    let of_cohort = report.clone();
    let n_shared = of_cohort.findings().len();
    let marks = Marks::of(
        options.known.as_ref(),
        &context(directory, &path, options, &merged),
        options.meshes,
    );
    let loaded = in_parallel(&asked, |(id, folder)| {
        if marks.is_known(id, folder) {
            return Loaded::Unchanged(id.clone());
        }
        let mark = marks.mark(folder, SystemTime::now());
        let mut report = of_cohort.clone();
        let overrides = options
            .overrides
            .get(id)
            .map(|value| Layer::from_rerun(value, id, &mut report));
        let layers = Layers {
            defaults: &defaults,
            cohort: &cohort_layer,
            overrides,
            options: [&kept, &command_line],
            of_cohort: &merged,
            folder: directory,
            meshes: options.meshes,
            unaccepted: options.unaccepted,
        };
        let mut patient = load_patient(id, folder, &file, layers, &mut report);
        if let Some((patient, _)) = &mut patient {
            let covers = |plan: &ResolvedPatient| marks.covers(plan, folder);
            let is_plain = report.findings().len() == n_shared;
            patient.mark =
                mark.filter(|_| is_plain && patient.resolved.as_ref().is_some_and(covers));
            if options.plans_only {
                patient.measured = None;
                patient.positions.1.retain(|key, _| key == "id");
            }
        }
        Loaded::Read(Box::new((patient, report)))
    });
    let (mut patients, mut unchanged, mut n_plans) = (Vec::new(), Vec::new(), 0);
    for one in loaded {
        match one {
            Loaded::Unchanged(id) => {
                unchanged.push((n_plans, id));
                n_plans += 1;
            }
            Loaded::Read(read) => {
                let (patient, of_patient) = *read;
                report.absorb(of_patient, n_shared);
                let has_plan = |(patient, _): &(Patient, String)| patient.resolved.is_some();
                n_plans += usize::from(patient.as_ref().is_some_and(has_plan));
                patients.extend(patient);
            }
        }
    }
    same_ids(&patients, report);
    Some(Cohort {
        directory: directory.to_owned(),
        name: file.name,
        description: file.description,
        settings: merged,
        patients: patients.into_iter().map(|(patient, _)| patient).collect(),
        unchanged,
    })
}

/// A patient's folder as it was taken up.
enum Loaded {
    /// The patient, if there is one, and its report.
    Read(Box<(Option<(Patient, String)>, Report)>),
    /// The patient is as an earlier run saw it.
    Unchanged(String),
}

/// Everything outside a patient's folder on which the plans depend.
fn context(directory: &Path, file: &Path, options: &Options, merged: &Merged) -> Vec<String> {
    let text = input_files::read_text(file, MaxBytes::TEXT).unwrap_or_default();
    let place = directory.canonicalize().unwrap_or_default();
    let mut context = vec![
        place.to_string_lossy().into_owned(),
        text,
        merged.value.to_string(),
        serde_json::to_string(&options.overrides).expect("settings are JSON"),
        options.unaccepted.to_string(),
    ];
    // A tick says where it runs, which the merged settings hold, too.
    let assignments = options.kept.iter().chain(&options.set);
    context.extend(
        assignments
            .filter(|one| *one != "executor.kind=slurm")
            .cloned(),
    );
    context
}

/// Reads and checks a patient's folder that may lie outside any cohort, without the effects accepted
/// for it. Its id is the one in its file. Every problem goes to `report`. `None` if `patient.toml` cannot be read.
pub fn load_alone(folder: &Path, report: &mut Report) -> Option<Patient> {
    let own_id = || {
        let text = input_files::read_text(&folder.join("patient.toml"), MaxBytes::TEXT).ok()?;
        Some(
            toml::from_str::<toml::Table>(&text)
                .ok()?
                .get("id")?
                .as_str()?
                .to_owned(),
        )
    };
    let id = own_id().unwrap_or_else(|| {
        folder
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    });
    let file = CohortFile {
        name: id.clone(),
        description: String::new(),
        patients: String::new(),
        allow_outside: false,
        defaults: Default::default(),
        solver: None,
        step1: None,
        step2: None,
        verification: None,
        step3: None,
        posterior: None,
        workflow: None,
        executor: None,
    };
    let nothing = Layer::default();
    let defaults = Layer::defaults();
    let of_cohort = Arc::new(merged([&defaults], folder, None, report)?);
    let layers = Layers {
        defaults: &defaults,
        cohort: &nothing,
        overrides: None,
        options: [&nothing; 2],
        of_cohort: &of_cohort,
        folder,
        meshes: false,
        unaccepted: true,
    };
    load_patient(&id, folder, &file, layers, report).map(|(patient, _)| patient)
}

/// Results of `work` in the order of the items. Each core takes a share of them: thousands of small
/// files are read and checked.
fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    let share = items.len().div_ceil(n_threads).max(1);
    std::thread::scope(|scope| {
        let threads: Vec<_> = items
            .chunks(share)
            .map(|share| scope.spawn(|| share.iter().map(&work).collect::<Vec<R>>()))
            .collect();
        let joined = threads.into_iter().map(|thread| thread.join());
        joined
            .flat_map(|results| results.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

struct Layers<'a> {
    defaults: &'a Layer,
    cohort: &'a Layer,
    overrides: Option<Layer>,
    /// Options that the run keeps, and those of the command line.
    options: [&'a Layer; 2],
    /// The layers of all patients, merged and checked.
    of_cohort: &'a Arc<Merged>,
    /// Folder of the cohort.
    folder: &'a Path,
    /// Whether meshes are read and checked, as in [`Options::meshes`].
    meshes: bool,
    /// Whether accepted effects are left unread, as in [`Options::unaccepted`].
    unaccepted: bool,
}

/// A patient, and the id in its file.
fn load_patient(
    id: &str,
    folder: &Path,
    cohort: &CohortFile,
    layers: Layers<'_>,
    report: &mut Report,
) -> Option<(Patient, String)> {
    let document = Document::read(&folder.join("patient.toml"), Some(id), report)?;
    let file: PatientFile = read_as(&document, Some(id), report)?;
    patient::check_values(&file, &document, id, report);
    let own = Layer::from_file(
        &file.settings.clone().unwrap_or_default(),
        &document,
        "settings",
    );
    let overrides = layers.overrides.unwrap_or_default();
    let settings = if own.is_empty() && overrides.is_empty() {
        Arc::clone(layers.of_cohort)
    } else {
        // A rerun applies to one patient and overrides settings that apply to all.
        let all = [
            layers.defaults,
            layers.cohort,
            &own,
            layers.options[0],
            layers.options[1],
            &overrides,
        ];
        let settings = merged(all, &document.file, Some(id), report)?;
        complain(&settings, Some((id, &document)), report);
        Arc::new(settings)
    };
    patient::check_completeness(&file, &settings.settings, &document, report);
    let overlay = (!layers.unaccepted)
        .then(|| overlay(id, folder, report))
        .flatten();
    let accepted = overlay
        .as_ref()
        .map(|(overlay, document)| Accepted { overlay, document });
    if let Some(accepted) = &accepted {
        accepted.check(id, &settings.settings.solver, report);
    }
    let folders = (folder, layers.folder);
    let bounds = Bounds::of([folder, layers.folder], cohort.allow_outside);
    let has_strays = outside::check(&file, folders, &settings, &bounds, &document, report);
    if !has_strays {
        data::check(&file, folder, &document, &cohort.defaults, report);
        if layers.meshes && settings.settings.solver.fidelity == Fidelity::FiniteElement {
            mesh::check(
                &file,
                folder,
                &settings,
                &document,
                accepted.as_ref(),
                report,
            );
        }
    }
    let measured = if report.has_error_of(id) {
        None
    } else {
        resolve::resolve(&file, folders, &cohort.defaults, &settings.settings, report)
    };
    let resolved = measured.clone().map(|plan| match &overlay {
        Some((overlay, _)) => resolve::with_overlay(plan, overlay),
        None => plan,
    });
    let positions = (document.file.clone(), positions(&document.root, ""));
    let named = file.id.clone();
    Some((
        Patient {
            id: id.to_owned(),
            settings,
            positions,
            file,
            folder: folder.to_owned(),
            measured,
            resolved,
            mark: None,
        },
        named,
    ))
}

/// Merged layers. A value that the settings' type refuses is reported.
fn merged<'a>(
    layers: impl IntoIterator<Item = &'a Layer>,
    file: &Path,
    patient: Option<&str>,
    report: &mut Report,
) -> Option<Merged> {
    match Merged::of(layers) {
        Ok(merged) => Some(merged),
        Err(error) => {
            let found = format!("settings that cannot be merged ({error})");
            let problem = Problem::error(
                file,
                found,
                "values of the settings' types",
                "correct the value",
            );
            report.add(patient, problem);
            None
        }
    }
}

/// A document as its type. Values that do not fit are reported.
pub(super) fn read_as<T: DeserializeOwned + schemars::JsonSchema + 'static>(
    document: &Document,
    patient: Option<&str>,
    report: &mut Report,
) -> Option<T> {
    let value = shape::fit(document, shape::schema_of::<T>(), patient, report);
    match serde_json::from_value(value) {
        Ok(file) => Some(file),
        Err(error) => {
            // The schema allows a value that the type refuses, so that the type's error is
            // reported.
            let remedy = "correct the value";
            report.add(
                patient,
                Problem::error(
                    &document.file,
                    error.to_string(),
                    "a value of the key's type",
                    remedy,
                ),
            );
            None
        }
    }
}

/// Checks the settings with `layer` on top of `base`. Invalid values go to `report`.
pub fn check_on_top(base: &Settings, layer: &Layer, report: &mut Report) {
    if let Ok(merged) = Merged::of([&Layer::base(base), layer]) {
        complain(&merged, None, report);
    }
}

/// Reports invalid settings at the place where they were set.
fn complain(merged: &Merged, patient: Option<(&str, &Document)>, report: &mut Report) {
    for complaint in ranges::complaints(&merged.settings) {
        let mut origin = merged.origin(&complaint.key);
        if let (Origin::Default, Some(against)) = (origin, &complaint.against) {
            origin = merged.origin(against);
        }
        let own = patient.filter(|(_, document)| match origin {
            Origin::File(file, _) => *file == document.file,
            Origin::Rerun => true,
            _ => false,
        });
        let document = patient.map(|(_, document)| document);
        let (file, at, key) = place(origin, &complaint.key, document);
        let problem = Problem::error(file, complaint.found, complaint.expected, complaint.remedy);
        report.add(own.map(|(id, _)| id), problem.at_key(key).at(at));
    }
}

fn check_defaults(file: &CohortFile, document: &Document, report: &mut Report) {
    let mut range = |key: &str, value: Option<f64>, low: f64, high: f64| {
        if let Some(value) = value.filter(|value| !(low..=high).contains(value)) {
            let expected = format!("{low} to {high}");
            let problem = Problem::error(
                &document.file,
                value.to_string(),
                expected,
                "correct the value",
            );
            report.add(None, problem.at_key(key).at(position_of(document, key)));
        }
    };
    range(
        "defaults.left_atrial_pressure_mmHg",
        file.defaults.left_atrial_pressure_mmhg,
        -5.0,
        60.0,
    );
    range(
        "defaults.passive_exponent",
        file.defaults.passive_exponent,
        0.1,
        100.0,
    );
    if file.name.trim().is_empty() && !report.is_broken(&document.file, "name") {
        let problem = Problem::error(
            &document.file,
            "an empty name",
            "a short name",
            "name the cohort",
        );
        report.add(
            None,
            problem.at_key("name").at(position_of(document, "name")),
        );
    }
}

/// A path in the cohort's folder, without `./` if that is the current directory.
fn inside(directory: &Path, name: &str) -> PathBuf {
    if directory == Path::new(".") {
        PathBuf::from(name)
    } else {
        directory.join(name)
    }
}

/// Names and folders of a cohort's patients, sorted, without a look at their files; empty without a
/// readable cohort.
#[must_use]
pub fn patients_of(directory: &Path) -> Vec<(String, PathBuf)> {
    let mut report = Report::default();
    let path = inside(directory, "cohort.toml");
    let Some(document) = Document::read(&path, None, &mut report) else {
        return Vec::new();
    };
    let Some(file) = read_as::<CohortFile>(&document, None, &mut report) else {
        return Vec::new();
    };
    patient_folders(directory, &file, &document, &mut report)
}

/// Patients' folders with their names, sorted, without hidden ones.
fn patient_folders(
    directory: &Path,
    file: &CohortFile,
    document: &Document,
    report: &mut Report,
) -> Vec<(String, PathBuf)> {
    let parent = inside(directory, &file.patients);
    let here = |found: String, remedy: &str| {
        Problem::error(
            &document.file,
            found,
            "a folder with one folder per patient",
            remedy,
        )
        .at_key("patients")
        .at(position_of(document, "patients"))
    };
    let entries = match std::fs::read_dir(&parent) {
        Ok(entries) => entries,
        Err(error) => {
            let found = format!("no readable folder {} ({error})", parent.display());
            report.add(
                None,
                here(
                    found,
                    "create it, or name the right one with `patients = \"…\"`",
                ),
            );
            return Vec::new();
        }
    };
    let mut folders: Vec<(String, PathBuf)> = entries
        .filter_map(Result::ok)
        .filter(|entry| entry.path().is_dir())
        .map(|entry| {
            (
                entry.file_name().to_string_lossy().into_owned(),
                entry.path(),
            )
        })
        .filter(|(name, _)| !name.starts_with('.'))
        .collect();
    folders.sort();
    if folders.is_empty() {
        let found = format!("no patient folder in {}", parent.display());
        report.add(
            None,
            here(
                found,
                "add a folder with patient.toml; `cardiotwin init DIR` writes a template",
            ),
        );
    }
    folders
}

fn select(folders: &[(String, PathBuf)], only: &[String], report: &mut Report) {
    let known: Vec<&str> = folders.iter().map(|(id, _)| id.as_str()).collect();
    for id in only.iter().filter(|id| !known.contains(&id.as_str())) {
        let remedy = nearest(id, known.iter().copied())
            .map_or("name one of these".to_owned(), |meant| {
                format!("did you mean `{meant}`?")
            });
        let expected = format!("one of {}", known.join(", "));
        report.add(
            None,
            Problem::error(
                Path::new("--patient"),
                format!("the unknown patient `{id}`"),
                expected,
                remedy,
            ),
        );
    }
}

/// Reports folders whose files have the same id, such as a copy that was not renamed.
fn same_ids(patients: &[(Patient, String)], report: &mut Report) {
    let mut first: BTreeMap<&str, &str> = BTreeMap::new();
    for (patient, id) in patients.iter().filter(|(_, id)| !id.is_empty()) {
        if let Some(other) = first.get(id.as_str()) {
            let found = format!("id {id:?} in the folders {other} and {}", patient.id);
            let remedy = "give each patient its own id, equal to its folder's name";
            let (file, positions) = &patient.positions;
            let problem = Problem::error(file, found, "each id once", remedy).at_key("id");
            report.add(None, problem.at(positions.get("id").copied()));
        } else {
            first.insert(id, &patient.id);
        }
    }
}

/// Reads `model.toml` next to `patient.toml`, which holds the effects accepted for this patient.
fn overlay(id: &str, folder: &Path, report: &mut Report) -> Option<(ModelOverlay, Document)> {
    let path = folder.join("model.toml");
    if !path.exists() {
        return None;
    }
    let document = Document::read(&path, Some(id), report)?;
    let overlay: ModelOverlay = read_as(&document, Some(id), report)?;
    if overlay.patient != id && !report.is_broken(&path, "patient") {
        let expected = format!("{id:?}, the folder's name");
        let problem = Problem::error(
            &path,
            format!("{:?}", overlay.patient),
            expected,
            "check whether this is another patient's model",
        );
        report.add(
            Some(id),
            problem
                .at_key("patient")
                .at(position_of(&document, "patient")),
        );
    }
    Some((overlay, document))
}
