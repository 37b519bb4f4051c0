//! `cardiotwin mesh repair`: repairs that need no remeshing.

use std::path::Path;

use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres};
use cardiotwin_mesh::repair::{Plane, Repair, repair};
use cardiotwin_mesh::vec3::Vec3;
use clap::Args;
use serde::Serialize;

use super::check;
use super::file::{Source, Target};
use super::parse;
use super::summary::{Figures, Told};
use crate::error::CliError;
use crate::exit::Exit;
use crate::mesh_error::MeshFileCommandError;
use crate::talk::Talk;

/// Repair defects that need no remeshing, and list the remaining ones
///
/// The following is always repaired: duplicate and unused nodes, duplicate and inverted elements,
/// tissue that touches itself in an edge, flat elements (by moving inner nodes; the boundary
/// stays), inward triangles, and missing surfaces. Other repairs need an option.
#[derive(Debug, Args)]
pub struct RepairArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    target: Target,
    /// Remove pieces that are not connected to the largest one
    #[arg(long)]
    keep_largest: bool,
    /// Multiply all lengths by this factor
    #[arg(long, value_name = "FACTOR", value_parser = parse::positive)]
    scale: Option<f64>,
    /// Change the tag of elements (may be given several times)
    #[arg(long = "tag", value_name = "NEW=OLD", value_parser = parse::tags)]
    tag: Vec<(i32, i32)>,
    /// Keep only elements with these tags; their interface with the others becomes the septum
    #[arg(
        long,
        value_name = "TAGS",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    keep_tags: Vec<i32>,
    /// Remove elements with these tags, such as valve plugs that close the cavity, or papillary
    /// muscles
    #[arg(
        long,
        value_name = "TAGS",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    remove_tags: Vec<i32>,
    /// Cut the base open at a plane, given by a point in mm and a normal towards the removed side
    #[arg(long, value_name = "x,y,z,nx,ny,nz", value_parser = parse::plane, allow_hyphen_values = true)]
    cut_plane: Option<Plane>,
    /// Make tissue above a plane passive by giving it the tag of --passive-tag
    #[arg(long, value_name = "x,y,z,nx,ny,nz", value_parser = parse::plane, allow_hyphen_values = true)]
    passive_above: Option<Plane>,
    /// Tag of the passive tissue of --passive-above
    #[arg(long, value_name = "TAG", default_value_t = 2)]
    passive_tag: i32,
    /// Rename a surface, such as endocardium=endo (may be given several times)
    #[arg(long, value_name = "NEW=OLD", value_parser = parse::pair)]
    surface: Vec<(String, String)>,
    /// Find endocardium, epicardium and rim again even if the file has them
    #[arg(long)]
    find_surfaces: bool,
    /// Plane of the base for a mesh whose rim has no sharp edge, given by a point in mm and a
    /// normal away from the apex
    #[arg(long, value_name = "x,y,z,nx,ny,nz", value_parser = parse::plane, allow_hyphen_values = true)]
    rim_plane: Option<Plane>,
    /// Point near the middle of the septum, in mm; the outer wall around it becomes the surface
    /// septum
    #[arg(long, value_name = "x,y,z", value_parser = parse::point, allow_hyphen_values = true)]
    septum: Option<Vec3>,
    /// Extent of the septum around the long axis, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 120.0)]
    septum_degrees: f64,
    /// Do not repair badly shaped elements
    #[arg(long)]
    keep_shapes: bool,
    /// Print one JSON object with the repairs and the remaining defects
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    file: &'a Path,
    out: &'a Path,
    unit: &'static str,
    done: &'a [String],
    mesh: Figures,
    left: Vec<Told>,
}

/// Repairs the mesh, writes it, and checks the result.
///
/// # Errors
/// A file cannot be read or written, or a requested repair is impossible.
pub fn execute(args: &RepairArgs, talk: &Talk) -> Result<Exit, CliError> {
    args.target.refuse_existing()?;
    let mut mesh = args.source.read()?;
    let file = &args.source.file;
    let wanted = Repair {
        scale: args.scale,
        map_tags: args.tag.iter().map(|(new, old)| (*old, *new)).collect(),
        keep_tags: args.keep_tags.clone(),
        remove_tags: args.remove_tags.clone(),
        cut: args.cut_plane,
        passive_above: args.passive_above.map(|plane| (plane, args.passive_tag)),
        keep_largest: args.keep_largest,
        rename: args.surface.iter().cloned().collect(),
        find_surfaces: args.find_surfaces,
        rim_plane: args.rim_plane,
        septum: args.septum.map(|at_mm| (at_mm, args.septum_degrees)),
        keep_shapes: args.keep_shapes,
    };
    let done = repair(&mut mesh, &wanted).map_err(|source| {
        let path = file.display().to_string();
        CliError::Mesh(Box::new(MeshFileCommandError::Repair { path, source }))
    })?;
    args.target.write(&mesh)?;
    let asked = Asked {
        unit: cardiotwin_mesh::LengthUnit::Millimetre,
        left_ventricle: &[],
        fibres: Fibres::Auto,
        cavity: None,
        wall: None,
        activation: Activation::Unasked,
        right_ventricle: None,
        sprung: &[],
    };
    let intake = intake::look(mesh, &asked);
    let out = &args.target.out;
    if args.json {
        let left = intake.defects.iter().map(Told::of).collect();
        let (schema_version, unit) = (
            cardiotwin_schemas::formats::MESH_REPAIR.version,
            args.target.unit(),
        );
        let mesh = Figures::of(&intake);
        talk.json(&Answer {
            schema_version,
            file,
            out,
            unit,
            done: &done.steps,
            mesh,
            left,
        })?;
        return Ok(if intake.is_sound() {
            Exit::Ok
        } else {
            Exit::Problems
        });
    }
    match done.steps.is_empty() {
        true => talk.data("nothing to repair\n")?,
        false => done
            .steps
            .iter()
            .try_for_each(|step| talk.data(&format!("repaired  {step}\n")))?,
    }
    let exit = check::tell(&intake, out, false, talk)?;
    talk.hint(&format!(
        "for patient.toml: [anatomy.mesh] with unit = \"{}\"",
        args.target.unit()
    ));
    Ok(exit)
}
