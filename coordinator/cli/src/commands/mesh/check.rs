//! `cardiotwin mesh check`: defects that step 0 would report for a mesh, and the mesh's figures.

use std::path::Path;

use cardiotwin_input::{Report, mesh_problem};
use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres, Intake};
use cardiotwin_units::Ml;
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::file::Source;
use super::parse;
use super::summary::{Figures, Told};
use crate::error::CliError;
use crate::exit::Exit;
use crate::problems;
use crate::talk::{Talk, count};

/// Print a mesh's figures and all its defects, each with place, expectation and remedy
///
/// Step 0 and `cardiotwin check` make the same checks, with tags, volumes and activation from
/// patient.toml.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    source: Source,
    /// Tags of contracting tissue, separated by commas; without them tags are not checked
    #[arg(
        long,
        value_name = "TAGS",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    left_ventricle: Vec<i32>,
    /// Source of the fibres
    #[arg(long, value_name = "WHENCE", value_enum, default_value_t = Whence::Auto)]
    fibres: Whence,
    /// Expected volume of the cavity, in mL
    #[arg(long, value_name = "ML", value_parser = parse::positive)]
    cavity_ml: Option<f64>,
    /// Expected volume of the contracting wall, in mL
    #[arg(long, value_name = "ML", value_parser = parse::positive)]
    wall_ml: Option<f64>,
    /// Print one JSON object with every place of every defect
    #[arg(long)]
    json: bool,
}

/// Where fibres come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Whence {
    /// The mesh's own fibres if it has any, else the rule
    Auto,
    /// The mesh's own fibres
    Mesh,
    /// Rule-based fibres
    Rule,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    file: &'a Path,
    mesh: &'a Figures,
    defects: Vec<Told>,
}

/// Checks a mesh and prints its figures and defects.
///
/// # Errors
/// The file is not a mesh, its unit is unknown, or stdout cannot be written.
pub fn execute(args: &CheckArgs, talk: &Talk) -> Result<Exit, CliError> {
    let asked = Asked {
        unit: args.source.length_unit()?,
        left_ventricle: &args.left_ventricle,
        fibres: match args.fibres {
            Whence::Auto => Fibres::Auto,
            Whence::Mesh => Fibres::Mesh,
            Whence::Rule => Fibres::Rule,
        },
        cavity: args.cavity_ml.map(Ml),
        wall: args
            .wall_ml
            .map(Ml)
            .filter(|_| !args.left_ventricle.is_empty()),
        activation: Activation::Unasked,
        right_ventricle: None,
        sprung: &[],
    };
    let file = &args.source.file;
    let intake =
        intake::read(file, &asked).map_err(|error| CliError::Mesh(Box::new(error.into())))?;
    tell(&intake, file, args.json, talk)
}

/// Prints figures and defects. The exit code says whether the mesh can be used for a simulation.
pub fn tell(intake: &Intake, file: &Path, json: bool, talk: &Talk) -> Result<Exit, CliError> {
    let figures = Figures::of(intake);
    if json {
        let defects = intake.defects.iter().map(Told::of).collect();
        let schema_version = cardiotwin_schemas::formats::MESH_CHECK.version;
        talk.json(&Answer {
            schema_version,
            file,
            mesh: &figures,
            defects,
        })?;
    } else {
        let mut report = Report::default();
        intake
            .defects
            .iter()
            .for_each(|defect| report.add(None, mesh_problem(file, defect)));
        talk.data(&figures.text())?;
        talk.data(&problems::text(&report, talk.colour_out, true))?;
        let (errors, warnings) = (report.n_errors(), report.n_warnings());
        if errors + warnings == 0 {
            talk.data(&format!("{}: no problems\n", file.display()))?;
        } else {
            let (errors, warnings) = (count(errors, "error"), count(warnings, "warning"));
            talk.data(&format!("{}: {errors}, {warnings}\n", file.display()))?;
        }
    }
    Ok(if intake.is_sound() {
        Exit::Ok
    } else {
        Exit::Problems
    })
}
