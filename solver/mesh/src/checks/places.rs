//! Places of a mesh's elements, nodes, edges and triangles.

use super::defect::{Item, Place};
use crate::tet_mesh::TetMesh;
use crate::vec3::{Vec3, add, scale};

/// Mean position of nodes.
pub(super) fn middle(mesh: &TetMesh, nodes: &[u32]) -> Vec3 {
    let sum = nodes.iter().fold([0.0; 3], |sum, node| {
        add(sum, mesh.nodes_mm[*node as usize])
    });
    scale(sum, 1.0 / nodes.len() as f64)
}

pub(super) fn at_element(mesh: &TetMesh, e: usize) -> Place {
    Place {
        item: Item::Element(e),
        at_mm: mesh.centroid_mm(e),
    }
}

pub(super) fn at_node(mesh: &TetMesh, node: u32) -> Place {
    Place {
        item: Item::Node(node),
        at_mm: mesh.nodes_mm[node as usize],
    }
}

pub(super) fn at_edge(mesh: &TetMesh, edge: [u32; 2]) -> Place {
    Place {
        item: Item::Edge(edge),
        at_mm: middle(mesh, &edge),
    }
}

pub(super) fn at_triangle(mesh: &TetMesh, triangle: [u32; 3]) -> Place {
    Place {
        item: Item::Triangle(triangle),
        at_mm: middle(mesh, &triangle),
    }
}
