//! Fibres of truncated-ellipsoid ventricles, in closed form from the depth in the wall.

use cardiotwin_linalg::vec3::{cross, norm};

use cardiotwin_mechanics::element::batch::Frame;

/// Half-axes and angles of the fibre rule: `f = e_u sin α + e_v cos α` on the ellipsoid through a point, `α` linear in depth.
///
/// `x = (r_l cos u, r_s sin u cos v, r_s sin u sin v)`, where the first coordinate runs along the axis and is negative at the
/// apex; `e_u` and `e_v` are the unit vectors of increasing `u` and `v`.
///
/// Sources: Aróstica et al. 2025, Comput Methods Appl Mech Eng 435:117485; Land et al. 2015, Proc R Soc A 471:20150641, whose
/// `u` has the opposite direction, which flips the sign of the angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EllipsoidFibres {
    /// Index of the coordinate along the axis; the other two follow in cyclic order.
    pub axis: usize,
    /// Short half-axis at endocardium and epicardium \[mm\].
    pub short_mm: [f64; 2],
    /// Long half-axis at endocardium and epicardium \[mm\].
    pub long_mm: [f64; 2],
    /// Angle at endocardium and epicardium \[degrees\].
    pub alpha_deg: [f64; 2],
}

impl EllipsoidFibres {
    fn half_axes(&self, depth: f64) -> [f64; 2] {
        let at = |r: [f64; 2]| r[0] + depth * (r[1] - r[0]);
        [at(self.short_mm), at(self.long_mm)]
    }

    /// Depth of the ellipsoid through `x`, from 0 at the endocardium to 1 at the epicardium, clamped to this range.
    #[must_use]
    pub fn depth(&self, x: [f64; 3]) -> f64 {
        let [along, b, c] = [0, 1, 2].map(|k| x[(self.axis + k) % 3]);
        let outside = |t: f64| {
            let [short, long] = self.half_axes(t);
            (b * b + c * c) / (short * short) + along * along / (long * long) > 1.0
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if outside(middle) {
                low = middle
            } else {
                high = middle
            }
        }
        0.5 * (low + high)
    }

    /// Frame at `x` \[mm\] and depth 0 to 1: fibre, the benchmark's sheet (in the plane of the wall), and the normal of both.
    #[must_use]
    pub fn frame(&self, x: [f64; 3], depth: f64) -> Frame {
        let t = depth.clamp(0.0, 1.0);
        let [along, b, c] = [0, 1, 2].map(|k| x[(self.axis + k) % 3]);
        let [short, long] = self.half_axes(t);
        let r = b.hypot(c);
        let (cos_v, sin_v) = if r > 1e-12 {
            (b / r, c / r)
        } else {
            (1.0, 0.0)
        };
        let u = (r / short).atan2(along / long);
        let (sin_u, cos_u) = u.sin_cos();
        let e_u = unit([-long * sin_u, short * cos_u * cos_v, short * cos_u * sin_v]);
        let e_v = [0.0, -sin_v, cos_v];
        let alpha = (self.alpha_deg[0] + t * (self.alpha_deg[1] - self.alpha_deg[0])).to_radians();
        let fibre: [f64; 3] = std::array::from_fn(|i| e_u[i] * alpha.sin() + e_v[i] * alpha.cos());
        // n = e_u × e_v, s = f × n; the third axis is f × s, so that the frame is right-handed.
        let sheet = cross(fibre, cross(e_u, e_v));
        let normal = cross(fibre, sheet);
        let mut frame = [[0.0; 3]; 3];
        for (k, axis) in [fibre, sheet, normal].into_iter().enumerate() {
            for i in 0..3 {
                frame[(self.axis + i) % 3][k] = axis[i];
            }
        }
        frame
    }
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let n = norm(a);
    a.map(|x| x / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fibres_lie_in_the_wall_and_turn_with_depth() {
        for axis in 0..3 {
            let rule = EllipsoidFibres {
                axis,
                short_mm: [7.0, 10.0],
                long_mm: [17.0, 20.0],
                alpha_deg: [-60.0, 60.0],
            };
            let place = |first: f64, second: f64, third: f64| {
                let mut x = [0.0; 3];
                (x[axis], x[(axis + 1) % 3], x[(axis + 2) % 3]) = (first, second, third);
                x
            };
            // On the equator of the mid-wall surface the fibre is circumferential.
            let x = place(0.0, 8.5, 0.0);
            assert!((rule.depth(x) - 0.5).abs() < 1e-9);
            let frame = rule.frame(x, 0.5);
            assert!((frame[(axis + 2) % 3][0] - 1.0).abs() < 1e-12, "{frame:?}");
            assert!(
                frame[(axis + 1) % 3][2].abs() > 1.0 - 1e-12,
                "the third axis points through the wall"
            );
            // At the epicardial equator the fibre is rotated by 60° towards increasing u, away from the base.
            let frame = rule.frame(place(0.0, 10.0, 0.0), 1.0);
            assert!((frame[axis][0] + 60.0_f64.to_radians().sin()).abs() < 1e-12);
            let product =
                |a: usize, b: usize| (0..3).map(|i| frame[i][a] * frame[i][b]).sum::<f64>();
            assert!(
                product(0, 1).abs() < 1e-12
                    && product(0, 2).abs() < 1e-12
                    && (product(2, 2) - 1.0).abs() < 1e-12
            );
        }
    }
}
