//! State of a body's integration points at a displacement.

use crate::element::Eight;

/// State of the integration points at a displacement: batches of eight lanes, ordered by batch and then by point.
#[derive(Debug, Clone, Default)]
pub struct Deformation {
    /// Volume ratio `J`, deformed over reference volume.
    pub volume_ratio: Vec<Eight>,
    /// Squared fibre stretch `C₁₁`.
    pub squared_stretch: Vec<Eight>,
    /// Pressure of each vertex from its averaged volume change \[kPa\]; empty for a pointwise penalty.
    pub nodal_pressure: Vec<f64>,
    /// Derivative of that pressure with respect to the vertex's deformed volume \[kPa/mm³\].
    pub nodal_slope: Vec<f64>,
    /// Smallest `J` on this rank, and its element.
    pub smallest: (f64, usize),
}
