//! Evaluated points of a model, and derivatives from those near a point.

use nalgebra::DMatrix;

use super::mode::Mode;
use crate::descent::DIFFERENCE;

/// Number of near points that count, over the number of parameters.
const NEIGHBOURS: usize = 4;
/// Least scale of a coordinate, over the largest one.
const LEAST_SCALE: f64 = 0.05;

/// Evaluated points, and the mode with its derivatives.
pub(super) struct Points {
    /// The mode, with derivatives of shape (residuals, parameters).
    anchor: (Vec<f64>, DMatrix<f64>),
    /// Coordinates of each point.
    u: Vec<Vec<f64>>,
    /// Residuals of each point.
    residuals: Vec<Vec<f64>>,
    /// Scale of each coordinate: the length of its derivative at the mode over the largest one.
    scale: Vec<f64>,
}

impl Points {
    /// No points but the mode.
    pub(super) fn new(mode: &Mode) -> Self {
        Self {
            anchor: (mode.u.clone(), mode.jacobian.clone()),
            u: Vec::new(),
            residuals: Vec::new(),
            scale: scale(&mode.jacobian),
        }
    }

    /// Adds a point.
    pub(super) fn add(&mut self, u: &[f64], residuals: &[f64]) {
        self.u.push(u.to_vec());
        self.residuals.push(residuals.to_vec());
    }

    /// Derivatives of the residuals at an evaluated point, shape (residuals, parameters).
    ///
    /// The difference to a point at distance d, over d, is the derivative along its direction e with
    /// the error d eᵀHe/2, where H is the matrix of second derivatives. Derivatives of the mode
    /// are off by D H e, where D is its distance. If the entries of H are independent with variance c², and
    /// 2c² on the diagonal, these errors have the variances c² d²/2 and c² D². The estimate of least
    /// variance is then a regression with weights 2/d² and 1/D², in which c cancels.
    ///
    /// A parameter that hardly changes the residuals hardly changes their derivatives either. Distances
    /// and derivatives are therefore those of the coordinates times their scales, so that two points are
    /// near if they differ in such parameters only.
    pub(super) fn jacobian(&self, u: &[f64], residuals: &[f64]) -> DMatrix<f64> {
        let n = u.len();
        // Squares of the distance in the coordinates and in the scaled ones.
        let squares = |other: &[f64]| {
            let differences = other.iter().zip(u).zip(&self.scale);
            differences.fold([0.0, 0.0], |[plain, scaled], ((other, here), scale)| {
                let square = (other - here).powi(2);
                [plain + square, scaled + square * scale * scale]
            })
        };
        let (mode, of_mode) = &self.anchor;
        let from_mode = squares(mode)[1].max(DIFFERENCE.powi(2));
        let mut near: Vec<(f64, usize)> = self
            .u
            .iter()
            .map(|other| squares(other))
            .zip(0..)
            // Over shorter distances the roughness of a simulated beat counts.
            .filter(|([plain, _], _)| *plain >= DIFFERENCE.powi(2))
            .map(|([_, scaled], index)| (scaled, index))
            .collect();
        let n_near = near.len().min(NEIGHBOURS * n);
        if n_near == 0 {
            return of_mode.clone();
        }
        near.select_nth_unstable_by(n_near - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(n_near);
        near.sort_unstable_by_key(|(_, index)| *index);
        let mut directions = DMatrix::zeros(n, n_near);
        let mut slopes = DMatrix::zeros(residuals.len(), n_near);
        for (k, (square, index)) in near.iter().enumerate() {
            let scale = 2.0_f64.sqrt() / square;
            for (j, (other, here)) in self.u[*index].iter().zip(u).enumerate() {
                directions[(j, k)] = scale * self.scale[j] * (other - here);
            }
            for (i, (other, here)) in self.residuals[*index].iter().zip(residuals).enumerate() {
                slopes[(i, k)] = scale * (other - here);
            }
        }
        // Derivatives with respect to the scaled coordinates.
        let by_scale = |jacobian: &DMatrix<f64>, power: i32| {
            let mut scaled = jacobian.clone();
            for (mut column, scale) in scaled.column_iter_mut().zip(&self.scale) {
                column *= scale.powi(power);
            }
            scaled
        };
        let of_mode_scaled = by_scale(of_mode, -1);
        slopes -= &of_mode_scaled * &directions;
        let prior = 1.0 / from_mode;
        let matrix = &directions * directions.transpose() + DMatrix::identity(n, n) * prior;
        let Some(factor) = matrix.cholesky() else {
            return of_mode.clone();
        };
        let change = factor.solve(&(directions * slopes.transpose()));
        by_scale(&(of_mode_scaled + change.transpose()), 1)
    }
}

/// Scale of each coordinate from the derivatives of the residuals.
fn scale(jacobian: &DMatrix<f64>) -> Vec<f64> {
    let lengths: Vec<f64> = jacobian.column_iter().map(|column| column.norm()).collect();
    let largest = lengths.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let of = |length: f64| (length / largest).max(LEAST_SCALE);
    lengths.into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals with curvature, and their derivatives.
    fn residuals(u: &[f64]) -> Vec<f64> {
        vec![
            u[0] + 0.5 * u[1] + 0.2 * u[0] * u[2],
            3.0 * u[1] + 0.1 * u[1] * u[1] - u[2],
        ]
    }

    fn derivatives(u: &[f64]) -> DMatrix<f64> {
        DMatrix::from_row_slice(
            2,
            3,
            &[
                1.0 + 0.2 * u[2],
                0.5,
                0.2 * u[0],
                0.0,
                3.0 + 0.2 * u[1],
                -1.0,
            ],
        )
    }

    fn points(around: &[f64; 3], distance: f64) -> Points {
        let mode = vec![0.0; 3];
        let mut points = Points {
            scale: scale(&derivatives(&mode)),
            anchor: (mode.clone(), derivatives(&mode)),
            u: Vec::new(),
            residuals: Vec::new(),
        };
        for k in 0..24 {
            let phase = f64::from(k);
            let u = [
                around[0] + distance * (1.3 * phase).sin(),
                around[1] + distance * (2.1 * phase).cos(),
                around[2] + distance * (0.7 * phase + 1.0).sin(),
            ];
            points.add(&u, &residuals(&u));
        }
        points
    }

    #[test]
    fn coordinates_without_effect_do_not_make_points_distant() {
        // The first residual bends in the first coordinate alone; the third has no effect at all.
        let curve = |u: &[f64]| vec![u[0] + 0.3 * u[0] * u[0] + 0.5 * u[1]];
        let of_mode = DMatrix::from_row_slice(1, 3, &[1.0, 0.5, 0.0]);
        let here = [2.0, 0.0, 0.0];
        let found = |is_scaled: bool| {
            let mut points = Points {
                scale: if is_scaled {
                    scale(&of_mode)
                } else {
                    vec![1.0; 3]
                },
                anchor: (vec![0.0; 3], of_mode.clone()),
                u: Vec::new(),
                residuals: Vec::new(),
            };
            for k in 0..12 {
                let phase = f64::from(k);
                let (a, b) = (0.2 * phase.sin(), 0.2 * (2.0 * phase).cos());
                let u = [here[0] + a, b, 4.0 * (3.0 * phase).cos()];
                points.add(&u, &curve(&u));
            }
            points.jacobian(&here, &curve(&here))[(0, 0)]
        };
        let exact = 1.0 + 0.6 * here[0];
        let error = |found: f64| (found - exact).abs();
        assert!(error(found(true)) < 0.1, "{} {exact}", found(true));
        assert!(error(found(false)) > 0.3, "{} {exact}", found(false));
    }

    #[test]
    fn near_points_tell_more_than_the_mode() {
        let here = [1.5, -1.0, 2.0];
        let exact = derivatives(&here);
        let error = |found: DMatrix<f64>| (found - &exact).norm();
        let of_mode = error(derivatives(&[0.0; 3]));
        let near = error(points(&here, 0.1).jacobian(&here, &residuals(&here)));
        assert!(near < 0.1 * of_mode, "{near} {of_mode}");
        let alone = points(&here, 0.1);
        let alone = Points {
            u: Vec::new(),
            residuals: Vec::new(),
            ..alone
        };
        assert_eq!(
            alone.jacobian(&here, &residuals(&here)),
            derivatives(&[0.0; 3])
        );
    }
}
