//! Specification of an ellipsoid.

use cardiotwin_units::Ml;

/// Specification of an ellipsoid. [`EllipsoidSpec::new`] gives the default proportions.
#[derive(Debug, Clone, PartialEq)]
pub struct EllipsoidSpec {
    /// Cavity volume below the rim, in the state to be meshed (diastasis, if the image shows it).
    pub cavity: Ml,
    /// Volume of the contracting wall, without the passive ring.
    pub wall: Ml,
    /// Requested number of nodes; met within a few percent.
    pub n_nodes: usize,
    /// Ratio of long to short endocardial semi-axis.
    pub long_to_short: f64,
    /// Height of the contracting wall's upper end above the equator, divided by the endocardial
    /// long semi-axis.
    pub base_height: f64,
    /// Height of the passive ring, divided by the endocardial long semi-axis; 0 for no ring.
    pub ring_height: f64,
    /// Ratio of the wall thickness at the apex to that at the equator.
    pub apex_wall: f64,
    /// Angle of the septum around the axis, centred at −x \[degrees\]; 0 for no septum.
    pub septum_deg: f64,
}

impl EllipsoidSpec {
    /// Default proportions: ratio of semi-axes 2.43, wall up to 0.3 and ring up to 0.34 of the long
    /// semi-axis above the equator, apical wall 0.8 of the equatorial one, a third of the
    /// circumference for the septum. These proportions are our assumption.
    #[must_use]
    pub fn new(cavity: Ml, wall: Ml, n_nodes: usize) -> Self {
        Self {
            cavity,
            wall,
            n_nodes,
            long_to_short: 2.43,
            base_height: 0.3,
            ring_height: 0.04,
            apex_wall: 0.8,
            septum_deg: 120.0,
        }
    }
}
