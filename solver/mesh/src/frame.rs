//! Directions of tissue at a point, and their turn by the angles of the fibre rule.

use crate::vec3::{Vec3, axpy, scale};

/// Orthonormal directions of an element's tissue, with `normal` = fibre × sheet up to sign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Unit vector f₀ along the fibre.
    pub fibre: Vec3,
    /// Sheet direction s₀, in the sheet and across the fibre; transmural if the sheet angle is
    /// zero.
    pub sheet: Vec3,
    /// Unit vector n₀ across the sheet.
    pub normal: Vec3,
}

/// Frame for given circumferential, longitudinal and transmural directions and the two angles
/// \[radians\].
///
/// Source: Bayer 2012, Eq. 3 ("orient"): Q R(α) R(β), whose columns are fibre, sheet normal and
/// sheet.
#[must_use]
pub fn turned(around: Vec3, up: Vec3, out: Vec3, alpha: f64, beta: f64) -> Frame {
    let fibre = axpy(scale(around, alpha.cos()), alpha.sin(), up);
    let across = axpy(scale(up, alpha.cos()), -alpha.sin(), around);
    let sheet = axpy(scale(out, beta.cos()), beta.sin(), across);
    let normal = axpy(scale(across, beta.cos()), -beta.sin(), out);
    Frame {
        fibre,
        sheet,
        normal,
    }
}
