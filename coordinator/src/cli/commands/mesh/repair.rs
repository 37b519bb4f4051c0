//! `cardiotwin mesh repair`: what can be mended without meshing anew.

use std::path::Path;

use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres};
use cardiotwin_mesh::repair::{Plane, Repair, repair};
use cardiotwin_mesh::vec3::Vec3;
use clap::Args;
use serde::Serialize;

use super::check;
use super::file::{MeshFileCommandError, Source, Target};
use super::parse;
use super::summary::{Figures, Told};
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::talk::Talk;

/// Mend what can be mended without meshing anew, and say what is left
///
/// Always: doubled and unused nodes, doubled and turned elements, tissue that touches itself in an edge, flat elements (inner nodes
/// are moved, the boundary stays), triangles turned outward, missing surfaces found. The rest is asked for.
#[derive(Debug, Args)]
pub struct RepairArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    target: Target,
    /// Remove pieces that do not hang together with the largest
    #[arg(long)]
    keep_largest: bool,
    /// Multiply all lengths
    #[arg(long, value_name = "FACTOR", value_parser = parse::positive)]
    scale: Option<f64>,
    /// Give elements another tag (may be given several times)
    #[arg(long = "tag", value_name = "NEW=OLD", value_parser = parse::tags)]
    tag: Vec<(i32, i32)>,
    /// Keep elements with these tags alone; the side towards the others becomes the septum
    #[arg(
        long,
        value_name = "TAGS",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    keep_tags: Vec<i32>,
    /// Remove elements with these tags: valve plugs that close the cavity, papillary muscles
    #[arg(
        long,
        value_name = "TAGS",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    remove_tags: Vec<i32>,
    /// Cut the base open at a plane: a point in mm, and a normal towards what goes
    #[arg(long, value_name = "x,y,z,nx,ny,nz", value_parser = parse::plane, allow_hyphen_values = true)]
    cut_plane: Option<Plane>,
    /// Make tissue above a plane passive: it gets the tag of --passive-tag
    #[arg(long, value_name = "x,y,z,nx,ny,nz", value_parser = parse::plane, allow_hyphen_values = true)]
    passive_above: Option<Plane>,
    /// Tag of passive tissue for --passive-above
    #[arg(long, value_name = "TAG", default_value_t = 2)]
    passive_tag: i32,
    /// Give a surface another name, such as endocardium=endo (may be given several times)
    #[arg(long, value_name = "NEW=OLD", value_parser = parse::pair)]
    surface: Vec<(String, String)>,
    /// Find endocardium, epicardium and rim anew though the file has some
    #[arg(long)]
    find_surfaces: bool,
    /// Plane of the base, where no sharp edge tells the rim: a point in mm, and a normal away from the apex
    #[arg(long, value_name = "x,y,z,nx,ny,nz", value_parser = parse::plane, allow_hyphen_values = true)]
    rim_plane: Option<Plane>,
    /// A point near the middle of the septum, in mm: the outer wall around it becomes the surface septum
    #[arg(long, value_name = "x,y,z", value_parser = parse::point, allow_hyphen_values = true)]
    septum: Option<Vec3>,
    /// How far the septum goes around the long axis, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 120.0)]
    septum_degrees: f64,
    /// Leave badly shaped elements as they are
    #[arg(long)]
    keep_shapes: bool,
    /// One JSON object: what was done, and what is left
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

/// Mends, writes, and checks what was written.
///
/// # Errors
/// When a file cannot be read or written, or when what was asked for cannot be done.
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
        true => talk.data("nothing to mend\n")?,
        false => done
            .steps
            .iter()
            .try_for_each(|step| talk.data(&format!("mended    {step}\n")))?,
    }
    let exit = check::tell(&intake, out, false, talk)?;
    talk.hint(&format!(
        "for patient.toml: [anatomy.mesh] with unit = \"{}\"",
        args.target.unit()
    ));
    Ok(exit)
}
