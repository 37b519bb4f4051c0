//! Lengths of the ellipsoid, with its points and closed-form volumes.

use super::EllipsoidSpec;
use crate::eikonal::Site;
use crate::vec3::Vec3;
use cardiotwin_units::Ms;
use std::f64::consts::PI;

/// A family of ellipsoids of revolution, one for each depth in the wall, cut by two planes.
///
/// At depth d (0 endocardium, 1 epicardium), the short semi-axis is a + w d and the long one k a +
/// ρ w d. The planes are the same for all depths: z = ζ_base k a, where the contracting wall ends,
/// and z = ζ_rim k a.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Endocardial short semi-axis a \[mm\].
    pub short_mm: f64,
    /// Wall thickness w at the equator \[mm\].
    pub wall_mm: f64,
    /// Ratio k of long to short endocardial semi-axis.
    pub long_to_short: f64,
    /// Ratio ρ of apical to equatorial thickness.
    pub apex_wall: f64,
    /// ζ of the contracting wall's upper end.
    pub base_height: f64,
    /// ζ of the rim.
    pub rim_height: f64,
}

impl Shape {
    /// Lengths for which the smooth body has the requested volumes.
    #[must_use]
    pub fn from_volumes(spec: &EllipsoidSpec) -> Self {
        let rim_height = spec.base_height + spec.ring_height;
        let per_cube =
            PI * spec.long_to_short * (2.0 / 3.0 + rim_height - rim_height.powi(3) / 3.0);
        let mut shape = Self {
            short_mm: (spec.cavity.0 * 1e3 / per_cube).cbrt(),
            wall_mm: 0.0,
            long_to_short: spec.long_to_short,
            apex_wall: spec.apex_wall,
            base_height: spec.base_height,
            rim_height,
        };
        let (mut low, mut high) = (0.0, 200.0);
        for _ in 0..100 {
            shape.wall_mm = 0.5 * (low + high);
            if shape.wall_mm3() < spec.wall.0 * 1e3 {
                low = shape.wall_mm;
            } else {
                high = shape.wall_mm;
            }
        }
        shape
    }

    /// Short and long semi-axis at a depth \[mm\].
    #[must_use]
    pub fn axes_mm(&self, depth: f64) -> [f64; 2] {
        let long = self.short_mm * self.long_to_short;
        [
            self.short_mm + self.wall_mm * depth,
            long + self.apex_wall * self.wall_mm * depth,
        ]
    }

    /// z of the contracting wall's upper end \[mm\].
    #[must_use]
    pub fn base_z_mm(&self) -> f64 {
        self.base_height * self.long_to_short * self.short_mm
    }

    /// z of the rim \[mm\].
    #[must_use]
    pub fn rim_z_mm(&self) -> f64 {
        self.rim_height * self.long_to_short * self.short_mm
    }

    /// Polar angle (0 at the apex) for a height, which is 0 at the apex, 1 at the base, 2 at the
    /// rim, and linear in between.
    #[must_use]
    pub fn polar(&self, depth: f64, height: f64) -> f64 {
        let [_, long] = self.axes_mm(depth);
        let base = (-self.base_z_mm() / long).acos();
        if height <= 1.0 {
            return height * base;
        }
        let rim = (-self.rim_z_mm() / long).acos();
        base + (height - 1.0) * (rim - base)
    }

    /// The point at a depth, height (see [`Self::polar`]) and angle around the axis \[mm\].
    #[must_use]
    pub fn point(&self, depth: f64, height: f64, angle: f64) -> Vec3 {
        let [short, long] = self.axes_mm(depth);
        let polar = self.polar(depth, height);
        let radius = short * polar.sin();
        // Exactly on the two planes, so that a cap is flat.
        let z = if height == 1.0 {
            self.base_z_mm()
        } else if height == 2.0 {
            self.rim_z_mm()
        } else {
            -long * polar.cos()
        };
        [radius * angle.cos(), radius * angle.sin(), z]
    }

    /// Activation sites of sinus rhythm on the endocardium: mid-septal, anterior and posterior
    /// fascicle, half-way from apex to base, as balls of 3 mm at time 0. The positions are our
    /// assumption.
    #[must_use]
    pub fn fascicles(&self) -> [Site; 3] {
        [PI, 0.5 * PI, -0.5 * PI].map(|angle| Site {
            at_mm: self.point(0.0, 0.5, angle),
            radius_mm: 3.0,
            time: Ms(0.0),
        })
    }

    /// Volume of the solid ellipsoid of a depth, from its apex up to z \[mm³\]: π a² (2c/3 + z −
    /// z³/(3c²)).
    #[must_use]
    pub fn solid_mm3(&self, depth: f64, z_mm: f64) -> f64 {
        let [a, c] = self.axes_mm(depth);
        PI * a * a * (2.0 * c / 3.0 + z_mm - z_mm.powi(3) / (3.0 * c * c))
    }

    /// Volume of the cavity up to the rim \[mm³\].
    #[must_use]
    pub fn cavity_mm3(&self) -> f64 {
        self.solid_mm3(0.0, self.rim_z_mm())
    }

    /// Volume of the contracting wall \[mm³\].
    #[must_use]
    pub fn wall_mm3(&self) -> f64 {
        self.solid_mm3(1.0, self.base_z_mm()) - self.solid_mm3(0.0, self.base_z_mm())
    }

    /// Arc length between two heights along a meridian at a depth \[mm\].
    #[must_use]
    pub fn meridian_mm(&self, depth: f64, from: f64, to: f64) -> f64 {
        let n = 400;
        (0..n)
            .map(|i| {
                let at =
                    |j: usize| self.point(depth, from + (to - from) * j as f64 / f64::from(n), 0.0);
                crate::vec3::distance(at(i as usize), at(i as usize + 1))
            })
            .sum()
    }
}
