//! `cardiotwin mesh`: check, repair, remeshing and refinement of a patient's own mesh.

mod check;
mod file;
mod mmg;
mod parse;
mod refine;
mod remesh;
mod repair;
mod summary;

use clap::{Args, Subcommand};

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Check, repair, remesh or refine a tetrahedral mesh of a left ventricle
#[derive(Debug, Args)]
pub struct MeshArgs {
    #[command(subcommand)]
    command: MeshCommand,
}

#[derive(Debug, Subcommand)]
enum MeshCommand {
    Check(check::CheckArgs),
    Repair(Box<repair::RepairArgs>),
    Remesh(remesh::RemeshArgs),
    Refine(refine::RefineArgs),
}

/// Runs the mesh command.
///
/// # Errors
/// [`CliError::Mesh`] for files, [`CliError::Mmg`] if mmg is needed and is missing or fails,
/// [`CliError::Usage`] for arguments that contradict each other.
pub fn execute(args: &MeshArgs, talk: &Talk) -> Result<Exit, CliError> {
    match &args.command {
        MeshCommand::Check(args) => check::execute(args, talk),
        MeshCommand::Repair(args) => repair::execute(args, talk),
        MeshCommand::Remesh(args) => remesh::execute(args, talk),
        MeshCommand::Refine(args) => refine::execute(args, talk),
    }
}
