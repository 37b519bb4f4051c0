//! `cardiotwin mesh remesh`: another mesh of the same body, made by mmg.

use std::path::{Path, PathBuf};

use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres};
use cardiotwin_mesh::{LengthUnit, TetMesh};
use clap::Args;

use super::file::{Source, Target};
use super::{check, mmg, parse};
use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Number of mmg calls after which the search for a number of nodes ends.
const CALLS: usize = 4;
/// Accepted deviation of the number of nodes from the requested one, as a share.
const NEAR: f64 = 0.1;

/// Remesh the same body with mmg3d to an edge length or a number of nodes
///
/// Tags and surfaces are kept, and fibres are taken from the nearest old element. mmg3d is free
/// software: `pip install mmgpy`, or www.mmgtools.org.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("size").required(true).args(["edge_mm", "nodes"])))]
pub struct RemeshArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    target: Target,
    /// Edge length of the new mesh, in mm
    #[arg(long, value_name = "MM", value_parser = parse::positive)]
    edge_mm: Option<f64>,
    /// Approximate number of nodes of the new mesh
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..))]
    nodes: Option<u32>,
    /// Largest distance of the new surface from the old one, in mm [default: a twentieth of the
    /// edge length]
    #[arg(long, value_name = "MM", value_parser = parse::positive)]
    distance_mm: Option<f64>,
    /// Path of mmg3d [default: mmg3d_O3 or mmg3d in PATH]
    #[arg(long, value_name = "PATH")]
    mmg3d: Option<PathBuf>,
    /// Print one JSON object with the figures of the written mesh
    #[arg(long)]
    json: bool,
}

/// Meshes the body again and writes the mesh.
///
/// # Errors
/// A file cannot be read or written, or mmg is missing or fails.
pub fn execute(args: &RemeshArgs, talk: &Talk) -> Result<Exit, CliError> {
    args.target.refuse_existing()?;
    let program = mmg::program(args.mmg3d.as_deref())?;
    let old = args.source.read()?;
    let call = |edge_mm: f64| {
        mmg::remesh(
            &program,
            &old,
            edge_mm,
            args.distance_mm.unwrap_or(edge_mm / 20.0),
        )
    };
    let mesh = match (args.edge_mm, args.nodes) {
        (Some(edge_mm), _) => call(edge_mm)?,
        (None, Some(wanted)) => {
            let wanted = f64::from(wanted);
            let mut edge_mm = old.mean_edge_mm() * (old.n_nodes() as f64 / wanted).cbrt();
            let mut best: Option<(f64, TetMesh)> = None;
            for _ in 0..CALLS {
                let mesh = call(edge_mm)?;
                let share = mesh.n_nodes() as f64 / wanted;
                let off = share.ln().abs();
                if best.as_ref().is_none_or(|(least, _)| off < *least) {
                    best = Some((off, mesh));
                }
                if off <= NEAR.ln_1p() {
                    break;
                }
                edge_mm *= share.cbrt();
            }
            best.map(|(_, mesh)| mesh).unwrap_or_default()
        }
        (None, None) => return Err(CliError::Usage("give --edge-mm or --nodes".to_owned())),
    };
    args.target.write(&mesh)?;
    tell_written(mesh, &args.target.out, args.json, talk)
}

/// Prints figures and defects of a mesh that was written.
pub fn tell_written(mesh: TetMesh, out: &Path, json: bool, talk: &Talk) -> Result<Exit, CliError> {
    let asked = Asked {
        unit: LengthUnit::Millimetre,
        left_ventricle: &[],
        fibres: Fibres::Auto,
        cavity: None,
        wall: None,
        activation: Activation::Unasked,
        right_ventricle: None,
        sprung: &[],
    };
    check::tell(&intake::look(mesh, &asked), out, json, talk)
}
