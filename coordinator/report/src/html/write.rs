//! The files of a report.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::discover::DiscoverCases;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use maud::{Markup, PreEscaped, html};

use super::page::write;
use super::patient::Around;
use super::{anchor, cohort, discovery, figures, page, patient, summary};
use crate::results::tables::cohort::patients;
use crate::results::{Signals, WriteError};
use crate::table;

/// Largest number of patients in a report of one file.
pub const ONE_FILE: usize = 50;
/// Largest number of small pressure plots in an overview.
const TILES: usize = 60;

/// Pages of patients that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pages {
    /// Pages of all patients.
    All,
    /// Pages that are not there yet, and pages whose patient has other results than the page shows.
    Changed,
}

/// Paths of a report that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportPaths {
    /// File to open first.
    pub main: PathBuf,
    /// One page per patient in the cohort's order; empty if all patients are in one file.
    pub patients: Vec<PathBuf>,
}

/// Writes the report of a run to `out` (`report.html`): one file for up to [`ONE_FILE`] patients,
/// otherwise an index, with the patients' pages in a folder next to it (`report-patients/`).
/// `discovered` are the findings of searches next to the run; for more than [`ONE_FILE`] patients
/// only their tables are shown. The report names artefacts that cannot be read.
///
/// - `pages`: pages of patients that are written, where each patient has one
///
/// # Errors
/// [`WriteError`] if a file cannot be written. Each file is written atomically, the index last.
pub fn write_report(
    run: &RunRecord,
    discovered: Option<&DiscoverCases>,
    pages: Pages,
    out: &Path,
) -> Result<ReportPaths, WriteError> {
    if run.patients.len() <= ONE_FILE {
        one_file(run, discovered, out)
    } else {
        index(run, discovered, pages, out)
    }
}

/// A page with the section of one patient, which needs no other file.
#[must_use]
pub fn patient_page(record: &PatientRecord) -> String {
    let around = Around::default();
    let section = patient::section(record, &Signals::read(record), Some(&around));
    let title = format!("{} · cardiotwin", record.plan.id);
    page::page(&title, &html! {}, &section).0
}

fn one_file(
    run: &RunRecord,
    discovered: Option<&DiscoverCases>,
    out: &Path,
) -> Result<ReportPaths, WriteError> {
    let link = |p: &PatientRecord| format!("#{}", anchor::of(p.plan.id.as_str()));
    let named = |p: &PatientRecord| (link(p), p.plan.id.to_string());
    let top = run
        .patients
        .iter()
        .map(figures::top_pressure)
        .fold(1.0, f64::max);
    let mut tiles = Vec::new();
    let mut sections = Vec::new();
    for (i, p) in run.patients.iter().enumerate() {
        let signals = Signals::read(p);
        if let Some(chart) = figures::small_pressure(p, &signals, top) {
            tiles.push((p.plan.id.to_string(), link(p), chart.render()));
        }
        let before = i.checked_sub(1).and_then(|i| run.patients.get(i));
        let neighbours = [before, run.patients.get(i + 1)].map(|p| p.map(named));
        let id = p.plan.id.as_str();
        let found = discovered.filter(|cases| cases.contains_key(id));
        let missing = found.map(|_| format!("#{}", anchor::missing(id)));
        let around = Around {
            neighbours,
            missing,
        };
        sections.push(patient::section(p, &signals, Some(&around)));
    }
    let content = html! {
        div.view id="cohort" {
            (overview(run, &link))
            (at_a_glance(&tiles, 0))
        }
        @for section in &sections { (section) }
        @if let Some(cases) = discovered { (discovery::part(cases)) }
    };
    let shown = sections_of(&content, discovered.is_some());
    let nav = page::nav(run, "#top", &shown, &run.patients, &link);
    write(
        out,
        &page::page(&format!("{} · cardiotwin", run.cohort), &nav, &content),
    )?;
    Ok(ReportPaths {
        main: out.to_owned(),
        patients: Vec::new(),
    })
}

fn index(
    run: &RunRecord,
    discovered: Option<&DiscoverCases>,
    pages: Pages,
    out: &Path,
) -> Result<ReportPaths, WriteError> {
    let mut index = Index::new(run, pages, out)?;
    for patient in &run.patients {
        index.page(patient)?;
    }
    index.finish(discovered)
}

/// A report of many patients, written patient by patient.
pub struct Index<'a> {
    run: &'a RunRecord,
    pages: Pages,
    out: &'a Path,
    folder: PathBuf,
    /// Names of the patients' pages.
    names: Vec<String>,
    /// Position of each patient.
    places: HashMap<&'a str, usize>,
    home: String,
    /// Positions of the patients in the small plots.
    shown: Vec<usize>,
    /// Highest pressure of all patients, mmHg.
    top: f64,
    tiles: Vec<(String, String, Markup)>,
    written: Vec<PathBuf>,
}

impl<'a> Index<'a> {
    /// A report of this run to `out`.
    ///
    /// - `run`: its patients need no traces, draws and fitted parameters
    /// - `pages`: pages of patients that are written
    ///
    /// # Errors
    /// [`WriteError`] if the folder of the pages cannot be made.
    pub fn new(run: &'a RunRecord, pages: Pages, out: &'a Path) -> Result<Self, WriteError> {
        let folder = folder_of(out);
        std::fs::create_dir_all(&folder).map_err(WriteError::folder(&folder))?;
        let home = format!(
            "../{}",
            out.file_name().unwrap_or_default().to_string_lossy()
        );
        let places = run.patients.iter().enumerate();
        Ok(Self {
            run,
            pages,
            out,
            folder,
            names: file_names(&run.patients),
            places: places.map(|(i, p)| (p.plan.id.as_str(), i)).collect(),
            home,
            shown: most_telling(&run.patients, TILES),
            top: run
                .patients
                .iter()
                .map(figures::top_pressure)
                .fold(1.0, f64::max),
            tiles: Vec::new(),
            written: Vec::new(),
        })
    }

    fn name(&self, p: &PatientRecord) -> &str {
        &self.names[self.places[p.plan.id.as_str()]]
    }

    fn link_of(&self, p: &PatientRecord) -> String {
        let folder = self.folder.file_name().unwrap_or_default();
        format!("{}/{}", folder.to_string_lossy(), self.name(p))
    }

    /// Writes the page of a patient, unless it is there. Patients that the run does not have are
    /// left out.
    ///
    /// - `p`: the whole record
    ///
    /// # Errors
    /// [`WriteError`] if the page cannot be written.
    pub fn page(&mut self, p: &PatientRecord) -> Result<(), WriteError> {
        let Some(&i) = self.places.get(p.plan.id.as_str()) else {
            return Ok(()); // it came while the report was written
        };
        let run = self.run;
        // Only neighbours are linked: with every patient on every page, the report would grow with
        // the square of the cohort's size.
        let near = &run.patients[i.saturating_sub(12)..run.patients.len().min(i + 13)];
        let nav = page::nav(run, &self.home, &[], near, &|p| self.name(p).to_owned());
        let title = format!("{} · {} · cardiotwin", p.plan.id, run.cohort);
        let file = self.folder.join(&self.names[i]);
        let stamp = stamp(p, &title, &nav);
        let is_current = self.pages == Pages::Changed && has_stamp(&file, &stamp);
        let is_shown = self.shown.contains(&i);
        if !is_current || is_shown {
            let signals = Signals::read(p);
            if is_shown && let Some(chart) = figures::small_pressure(p, &signals, self.top) {
                let tile = (p.plan.id.to_string(), self.link_of(p), chart.render());
                self.tiles.push(tile);
            }
            if !is_current {
                let named = |p: &PatientRecord| (self.name(p).to_owned(), p.plan.id.to_string());
                let before = i.checked_sub(1).and_then(|i| run.patients.get(i));
                let neighbours = [before, run.patients.get(i + 1)].map(|p| p.map(named));
                let around = Around {
                    neighbours,
                    missing: None,
                };
                let page = page::page(&title, &nav, &patient::section(p, &signals, Some(&around)));
                write(&file, &PreEscaped(format!("{stamp}{}", page.0)))?;
            }
        }
        self.written.push(file);
        Ok(())
    }

    /// Writes the index, and returns the paths of the report.
    ///
    /// # Errors
    /// [`WriteError`] if the index cannot be written.
    pub fn finish(self, discovered: Option<&DiscoverCases>) -> Result<ReportPaths, WriteError> {
        let (run, link_of) = (self.run, |p: &PatientRecord| self.link_of(p));
        let left_out = run.patients.len() - self.tiles.len();
        let content = html! {
            (overview(run, &link_of))
            (at_a_glance(&self.tiles, left_out))
            @if let Some(cases) = discovered { h2 id="missing" { "Missing effects of the model" } (discovery::cohort(cases)) }
        };
        let unfinished: Vec<PatientRecord> = self
            .shown
            .iter()
            .take(ONE_FILE)
            .map(|i| run.patients[*i].clone())
            .collect();
        let nav = page::nav(run, "#top", &[], &unfinished, &link_of);
        let page = page::page(&format!("{} · cardiotwin", run.cohort), &nav, &content);
        let mark = mark(&run.revision, discovered);
        write(self.out, &PreEscaped(format!("{mark}{}", page.0)))?;
        Ok(ReportPaths {
            main: self.out.to_owned(),
            patients: self.written,
        })
    }
}

/// Whether the file `out` is the index of a report that shows this revision of the run and these
/// findings, with as many pages next to it as there are patients. A report in one file never counts:
/// it is made again in no time.
#[must_use]
pub fn shows(
    out: &Path,
    revision: &str,
    discovered: Option<&DiscoverCases>,
    n_patients: usize,
) -> bool {
    let pages = std::fs::read_dir(folder_of(out)).map_or(0, Iterator::count);
    pages >= n_patients && has_stamp(out, &mark(revision, discovered))
}

/// Folder of the patients' pages next to an index.
fn folder_of(out: &Path) -> PathBuf {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!("{stem}-patients"))
}

/// Comment at the beginning of an index, by which a later run knows what the report shows.
fn mark(revision: &str, discovered: Option<&DiscoverCases>) -> String {
    let shown = (env!("CARGO_PKG_VERSION"), revision, discovered);
    let text = serde_json::to_string(&shown).unwrap_or_default();
    format!("<!-- {} -->\n", sha256_hex(text.as_bytes()))
}

/// Comment at the beginning of a patient's page, by which a later report knows what the page shows.
fn stamp(patient: &PatientRecord, title: &str, nav: &Markup) -> String {
    let mut patient = patient.clone();
    patient.status.for_s = 0.0;
    let shown = (env!("CARGO_PKG_VERSION"), title, &nav.0, &patient);
    let text = serde_json::to_string(&shown).unwrap_or_default();
    format!("<!-- {} -->\n", sha256_hex(text.as_bytes()))
}

/// Whether a file begins with this stamp.
fn has_stamp(file: &Path, stamp: &str) -> bool {
    let mut found = vec![0; stamp.len()];
    let read = File::open(file).and_then(|mut file| file.read_exact(&mut found));
    read.is_ok() && found == stamp.as_bytes()
}

/// The summary: model, errors, notes, patients.
fn overview(run: &RunRecord, link: cohort::Link) -> Markup {
    html! {
        div id="top" {}
        (cohort::header(run))
        @if run.patients.is_empty() { p.absent { "This run has no patients." } }
        @else {
            (cohort::against_the_paper(run))
            (summary::notes(run, link))
            h2 id="patients" { "Patients" }
            (table::html(&patients(run).linked(|k, _| link(&run.patients[k]))))
        }
    }
}

/// Sections of the cohort's view that `content` has: anchor and title.
fn sections_of(content: &Markup, discovered: bool) -> Vec<(&'static str, &'static str)> {
    let all = [
        ("errors", "Errors"),
        ("notes", "Notes"),
        ("patients", "Patients"),
        ("pressures", "Pressures"),
    ];
    let has = |anchor: &str| content.0.contains(&format!("<h2 id=\"{anchor}\""));
    let mut found: Vec<_> = all.into_iter().filter(|(anchor, _)| has(anchor)).collect();
    if discovered {
        found.push(("missing", "Missing effects"));
    }
    found
}

/// Plots of all patients side by side, which a printed summary leaves out.
fn at_a_glance(tiles: &[(String, String, Markup)], left_out: usize) -> Markup {
    html! {
        @if !tiles.is_empty() {
            div.beyond { (cohort::small_multiples(tiles, left_out)) }
        }
    }
}

/// Indices of the `n` patients to show first, in the cohort's order: failures, followed by the
/// largest costs of step 1.
fn most_telling(patients: &[PatientRecord], n: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..patients.len()).collect();
    let cost = |i: &usize| {
        patients[*i]
            .step1
            .as_ref()
            .map_or(f64::NEG_INFINITY, |s| s.cost)
    };
    order.sort_by(|a, b| {
        let failed = |i: &usize| patients[*i].failure.is_some();
        failed(b).cmp(&failed(a)).then(cost(b).total_cmp(&cost(a)))
    });
    order.truncate(n);
    order.sort_unstable();
    order
}

/// A distinct file name per patient: the id with `_` for characters that a file system or an
/// address might not allow.
fn file_names(patients: &[PatientRecord]) -> Vec<String> {
    let mut taken = HashSet::new();
    let names = patients.iter().map(|p| {
        let plain = |c: char| {
            if c.is_ascii_alphanumeric() || "-_.".contains(c) {
                c
            } else {
                '_'
            }
        };
        let base: String = p.plan.id.as_str().chars().map(plain).collect();
        let mut name = format!("{base}.html");
        let mut k = 2;
        // Names are compared without case, because P1 and p1 are the same file on some file
        // systems.
        while !taken.insert(name.to_lowercase()) {
            name = format!("{base}-{k}.html");
            k += 1;
        }
        name
    });
    names.collect()
}
