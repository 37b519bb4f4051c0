//! Requirements on a mesh.

use cardiotwin_units::Ml;

/// Requirements on a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Expected<'a> {
    /// Tags of contracting tissue; each of them must occur.
    pub muscle_tags: &'a [i32],
    /// Whether contracting elements need fibre directions.
    pub fibres: bool,
    /// Names of surfaces that the mesh must have.
    pub surfaces: &'a [&'a str],
    /// Name of the right ventricle's endocardium, if a pressure acts on it.
    pub right_ventricle: Option<&'a str>,
    /// Names of surfaces with springs of their own.
    pub sprung: &'a [&'a str],
    /// Reason why missing surfaces could not be found on the mesh; `None` if this was not tried.
    pub surfaces_not_found: Option<String>,
    /// Measured volume of the cavity, with the accepted relative difference.
    pub cavity: Option<(Ml, f64)>,
    /// Stated volume of the contracting wall, with the accepted relative difference.
    pub wall: Option<(Ml, f64)>,
}
