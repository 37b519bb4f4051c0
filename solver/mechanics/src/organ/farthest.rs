//! Where an inflated wall misses the image most.

/// Node of the image that an inflated wall missed most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Farthest {
    /// Distance of the inflated node from its place in the image \[mm\].
    pub distance_mm: f64,
    /// Place of the node in the image \[mm\].
    pub at_mm: [f64; 3],
}
