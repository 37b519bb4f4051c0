//! Tetrahedral meshes of the left ventricle for finite-element simulations.
//!
//! Lengths are in mm, times in ms, speeds in mm/ms (= m/s), and volumes in mm³, unless a type
//! states another unit. Files have their own units (`.pts` is in µm), which are converted when they
//! are read and written. `docs/mesh.md` is the guide.

pub mod adjacency;
pub mod cavity;
pub mod checks;
pub mod cutaway;
pub mod decimate;
pub mod eikonal;
pub mod ellipsoid;
pub mod fibres;
pub mod files;
pub mod find_surfaces;
mod frame;
pub mod intake;
pub mod joint;
pub mod landmarks;
pub mod laplace;
pub mod node_fibres;
pub mod order;
pub mod partition;
pub mod quality;
pub mod refine;
pub mod repair;
pub mod right_ventricle;
pub mod surface;
#[cfg(test)]
mod test_meshes;
pub mod tet_mesh;
pub mod transfer;

pub use adjacency::Adjacency;
pub use cardiotwin_linalg::vec3;
pub use cavity::Cavity;
pub use ellipsoid::EllipsoidSpec;
pub use files::{LengthUnit, MeshFileError};
pub use node_fibres::NodeFibres;
pub use surface::Surface;
pub use tet_mesh::{Frame, TetMesh, tags};
