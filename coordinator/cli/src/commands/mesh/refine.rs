//! `cardiotwin mesh refine`: halves every edge of a mesh and keeps its surfaces, tags and fibres.

use cardiotwin_mesh::refine::halve_edges;
use clap::Args;

use super::file::{Source, Target};
use super::remesh::tell_written;
use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Split each element into eight by halving its edges; surfaces, tags and fibres are kept, and
/// facets stay where they are
#[derive(Debug, Args)]
pub struct RefineArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    target: Target,
    /// Number of times to refine
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=4))]
    times: u8,
    /// Print one JSON object with the figures of the written mesh
    #[arg(long)]
    json: bool,
}

/// Refines the mesh and writes it.
///
/// # Errors
/// A file cannot be read or written.
pub fn execute(args: &RefineArgs, talk: &Talk) -> Result<Exit, CliError> {
    args.target.refuse_existing()?;
    let mut mesh = args.source.read()?;
    for _ in 0..args.times {
        mesh = halve_edges(&mesh);
    }
    args.target.write(&mesh)?;
    tell_written(mesh, &args.target.out, args.json, talk)
}
