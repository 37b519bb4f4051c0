//! Reading and writing of mesh files for the `mesh` commands: units of the input, and no
//! overwriting of the output.

use std::path::{Path, PathBuf};

use cardiotwin_mesh::files::{self, LengthUnit, MeshFileError, vtu};
use cardiotwin_mesh::intake::readable_path;
use cardiotwin_mesh::{TetMesh, files::carp, files::medit};
use clap::{Args, ValueEnum};

use crate::error::CliError;
use crate::mesh_error::MeshFileCommandError;

/// Units of coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Unit {
    /// Micrometres, the unit of CARP files
    Um,
    /// Millimetres
    Mm,
    /// Centimetres
    Cm,
    /// Metres
    M,
}

impl Unit {
    fn length(self) -> LengthUnit {
        match self {
            Self::Um => LengthUnit::Micrometre,
            Self::Mm => LengthUnit::Millimetre,
            Self::Cm => LengthUnit::Centimetre,
            Self::M => LengthUnit::Metre,
        }
    }
}

/// The mesh to be read.
#[derive(Debug, Args)]
pub struct Source {
    /// Stem of CARP files (`heart` for heart.pts, heart.elem …), or a .vtu, .msh (gmsh) or .mesh (Medit) file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Unit of the coordinates; optional for CARP files, which are in um
    #[arg(long, value_name = "UNIT", value_enum)]
    pub unit: Option<Unit>,
}

impl Source {
    /// The unit given with `--unit`, or the one that the file format implies.
    ///
    /// # Errors
    /// [`CliError::Usage`] if neither determines the unit.
    pub fn length_unit(&self) -> Result<LengthUnit, CliError> {
        match (self.unit, is_carp(&self.file)) {
            (Some(unit), _) => Ok(unit.length()),
            (None, true) => Ok(LengthUnit::Micrometre),
            (None, false) => Err(CliError::Usage(format!(
                "{} does not state the unit of its coordinates: add --unit um, mm, cm or m",
                self.file.display()
            ))),
        }
    }

    /// Reads the mesh.
    ///
    /// # Errors
    /// [`CliError::Mesh`] if the file is not a mesh, [`CliError::Usage`] if its unit is unknown.
    pub fn read(&self) -> Result<TetMesh, CliError> {
        let read = files::read(&readable_path(&self.file), self.length_unit()?);
        read.map_err(|error| CliError::Mesh(Box::new(error.into())))
    }
}

/// The mesh to be written.
#[derive(Debug, Args)]
pub struct Target {
    /// File to write: a .vtu file (mm), a .mesh file (mm), or the stem of CARP files (um)
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
}

fn is_carp(file: &Path) -> bool {
    !matches!(
        file.extension().and_then(|e| e.to_str()),
        Some("vtu" | "msh" | "mesh")
    )
}

impl Target {
    /// Refuses to overwrite a file, before any work is done.
    ///
    /// # Errors
    /// [`CliError::Mesh`] if an output file exists and `--force` was not given, [`CliError::Usage`]
    /// for a gmsh file, which cannot be written.
    pub fn refuse_existing(&self) -> Result<(), CliError> {
        if self.out.extension().is_some_and(|e| e == "msh") {
            return Err(CliError::Usage(
                "gmsh files cannot be written: use .vtu, .mesh or a stem of CARP files".into(),
            ));
        }
        let there = if is_carp(&self.out) {
            self.carp_files()
        } else {
            vec![self.out.clone()]
        };
        match there
            .into_iter()
            .find(|file| file.exists())
            .filter(|_| !self.force)
        {
            Some(file) => {
                let path = file.display().to_string();
                Err(CliError::Mesh(Box::new(MeshFileCommandError::Exists {
                    path,
                })))
            }
            None => Ok(()),
        }
    }

    /// CARP files with this stem: surfaces that exist, and the files that will be written.
    fn carp_files(&self) -> Vec<PathBuf> {
        let stem = readable_path(&self.out);
        let name = stem
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let folder = stem
            .parent()
            .filter(|f| !f.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        let surface = |path: &PathBuf| {
            let file = path.file_name().unwrap_or_default().to_string_lossy();
            file.starts_with(&format!("{name}.")) && file.ends_with(".surf")
        };
        let entries = std::fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path());
        let mut files: Vec<PathBuf> = entries.filter(surface).collect();
        files.extend(["pts", "elem", "lon"].map(|ending| folder.join(format!("{name}.{ending}"))));
        files
    }

    /// Writes a mesh in the format that the file's extension names.
    ///
    /// # Errors
    /// The errors of [`Target::refuse_existing`]; [`CliError::Mesh`] if the mesh cannot be written,
    /// [`CliError::File`] if an old file cannot be removed.
    pub fn write(&self, mesh: &TetMesh) -> Result<(), CliError> {
        self.refuse_existing()?;
        let failed = |error: MeshFileError| CliError::Mesh(Box::new(error.into()));
        match self.out.extension().and_then(|e| e.to_str()) {
            Some("vtu") => {
                let content = vtu::Content {
                    surfaces: true,
                    ..vtu::Content::default()
                };
                vtu::write(&self.out, mesh, &content).map_err(failed)
            }
            Some("mesh") => medit::write(mesh, &self.out).map_err(failed),
            _ => {
                // Surface and fibre files left over from another mesh would be read as belonging to
                // this one.
                for file in self.carp_files().into_iter().filter(|file| file.exists()) {
                    std::fs::remove_file(&file).map_err(CliError::file("replace", &file))?;
                }
                carp::write(mesh, &readable_path(&self.out)).map_err(failed)
            }
        }
    }

    /// Unit of the coordinates in the written file.
    pub fn unit(&self) -> &'static str {
        if is_carp(&self.out) { "um" } else { "mm" }
    }
}
