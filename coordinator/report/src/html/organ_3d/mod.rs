//! Report on a patient's finite-element ventricle: pictures, the nodes' spread, mesh and cost, and
//! the changes by accepted effects.

mod before;
mod camera;
mod cost;
mod heart;
mod palette;
mod spread;

use cardiotwin_schemas::heart::HeartSurface;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::Fidelity;
use maud::{Markup, PreEscaped, html};

use super::figures::figure;
use crate::results::{HeartError, HeartFile, Signals, SpreadFile};

pub use palette::css;
pub use spread::spread_svg;

/// Files of the simulations that this part draws.
#[derive(Debug, Default)]
pub struct Drawn {
    /// Surface of the wall in step 1's result.
    pub heart: Option<HeartFile>,
    /// Quantiles of its nodes' traces.
    pub spread: Option<SpreadFile>,
    /// One sentence for each file that is recorded but cannot be used.
    pub problems: Vec<String>,
}

impl Drawn {
    /// Reads the files named in the record; none for organs without a mesh.
    #[must_use]
    pub fn of(patient: &PatientRecord) -> Self {
        let mut drawn = Self::default();
        if !is_3d(patient) {
            return drawn;
        }
        match HeartFile::read(patient) {
            Ok(heart) => drawn.heart = heart,
            Err(HeartError::Format(error)) => drawn.problems.push(error.in_full()),
            Err(error) => drawn.problems.push(error.to_string()),
        }
        match SpreadFile::read(patient) {
            Ok(spread) => drawn.spread = spread,
            Err(error) => drawn.problems.push(error.to_string()),
        }
        drawn
    }
}

fn is_3d(patient: &PatientRecord) -> bool {
    match &patient.step0 {
        Some(step0) => matches!(step0.result.organ, OrganSpec::FiniteElement(_)),
        None => patient.plan.settings.solver.fidelity == Fidelity::FiniteElement,
    }
}

/// Frames of the beat as a block of data, for the script that draws the heart; empty without frames.
#[must_use]
pub fn moving(drawn: &Drawn) -> Markup {
    let Some(file) = drawn
        .heart
        .as_ref()
        .filter(|file| file.heart.beat.is_some())
    else {
        return Markup::default();
    };
    let heart = HeartSurface {
        states: Vec::new(),
        ..file.heart.clone()
    };
    // In a script element only `<` could end the data early.
    let json = serde_json::to_string(&heart).unwrap_or_default();
    let json = json.replace('<', "\\u003c");
    html! { script.heart-data type="application/json" data-name=(file.name) { (PreEscaped(json)) } }
}

/// The part for a patient with a finite-element ventricle; empty for other organs.
#[must_use]
pub fn part(patient: &PatientRecord, signals: &Signals, drawn: &Drawn) -> Markup {
    if !is_3d(patient) {
        return Markup::default();
    }
    html! {
        h3 { "3D ventricle" }
        @for problem in &drawn.problems { p.absent { (problem) } }
        @match &drawn.heart {
            Some(file) => (heart::pictures(&file.heart, patient.plan.id.as_str(), &file.name)),
            None if patient.iterations.iter().any(|i| i.run.is_some()) => p.absent {
                "No picture: this simulation was computed by a version of the program that stored none. "
                code { "cardiotwin run COHORT --run-dir NEW" } " repeats the simulation and stores one."
            },
            None => p.absent { "No picture: no simulation of this patient has finished." },
        }
        (spread_figures(patient, drawn.spread.as_ref()))
        (before::part(patient, signals))
        div.tables {
            @if let Some(table) = cost::mesh(patient) { (table) }
            @if let Some(table) = cost::simulations(patient) { (table) }
        }
    }
}

/// Charts of the nodes' spread. In a reduced ventricle the nodes are its activation groups.
fn spread_figures(patient: &PatientRecord, spread: Option<&SpreadFile>) -> Markup {
    let Some(file) = spread else {
        return html! {
            @if patient.targets.is_some() {
                p.absent { "No spread over the nodes: the targets were computed by a version of the program that stored none." }
            }
        };
    };
    let note = html! { span.quiet { ": median, half and nine tenths of the wall" } };
    html! {
        p.quiet {
            "Nodal traces of step 1's result, aligned by activation time: the line is the median that step 2 aims at, the dark "
            "band holds half of the wall, the light one nine tenths."
        }
        div.figures {
            @for (title, chart) in spread::charts(file, patient.plan.id.as_str()) { (figure(title, Some(chart), "", &note)) }
        }
    }
}
