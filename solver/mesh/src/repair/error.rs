//! Reasons why a mesh cannot be repaired.

use crate::find_surfaces::FindError;
use crate::vec3::Vec3;

/// Reasons why a mesh cannot be repaired.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RepairError {
    /// An element refers to a node that does not exist.
    #[error(
        "element {element} names node {node}, but the mesh has {n_nodes} nodes: this cannot be repaired"
    )]
    NodeOutOfRange {
        /// Index of the element.
        element: usize,
        /// Number of its node.
        node: u32,
        /// Number of nodes in the mesh.
        n_nodes: usize,
    },
    /// No element would remain.
    #[error("no element is left {after}: check tags and plane")]
    Nothing {
        /// Step that removed the last element.
        after: &'static str,
    },
    /// A surface to be renamed does not exist.
    #[error("unknown surface {name:?}, expected one of {found:?}")]
    NoSurface {
        /// Name of the surface to be renamed.
        name: String,
        /// Names of the mesh's surfaces.
        found: Vec<String>,
    },
    /// The search for surfaces failed.
    #[error("cannot find the surfaces of the mesh")]
    Surfaces(#[from] FindError),
    /// The septum cannot be marked.
    #[error("no septum at ({:.1}, {:.1}, {:.1}) mm: {why}", at_mm[0], at_mm[1], at_mm[2])]
    Septum {
        /// Point that was given to mark the septum \[mm\].
        at_mm: Vec3,
        /// Reason why the septum cannot be marked there.
        why: &'static str,
    },
}
