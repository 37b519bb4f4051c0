//! Triangles of a surface, linear or quadratic.

/// Triangles of a surface with three or six nodes.
#[derive(Debug, Clone, PartialEq)]
pub enum Triangles {
    /// Triangles with three nodes.
    Linear(Vec<[u32; 3]>),
    /// Triangles with six nodes.
    Quadratic(Vec<[u32; 6]>),
}
