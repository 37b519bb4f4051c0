//! Evaluated points of a model, and derivatives from those near a point.

use nalgebra::DMatrix;

use super::mode::Mode;
use crate::descent::DIFFERENCE;

/// Number of near points that count, over the number of parameters.
const NEIGHBOURS: usize = 4;

/// Evaluated points, and the mode with its derivatives.
pub(super) struct Points {
    /// The mode, with derivatives of shape (residuals, parameters).
    anchor: (Vec<f64>, DMatrix<f64>),
    /// Coordinates of each point.
    u: Vec<Vec<f64>>,
    /// Residuals of each point.
    residuals: Vec<Vec<f64>>,
}

impl Points {
    /// No points but the mode.
    pub(super) fn new(mode: &Mode) -> Self {
        Self {
            anchor: (mode.u.clone(), mode.jacobian.clone()),
            u: Vec::new(),
            residuals: Vec::new(),
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
    pub(super) fn jacobian(&self, u: &[f64], residuals: &[f64]) -> DMatrix<f64> {
        let n = u.len();
        let square =
            |other: &[f64]| -> f64 { other.iter().zip(u).map(|(a, b)| (a - b).powi(2)).sum() };
        let (mode, of_mode) = &self.anchor;
        let from_mode = square(mode).max(DIFFERENCE.powi(2));
        let mut near: Vec<(f64, usize)> = self
            .u
            .iter()
            .map(|other| square(other))
            .zip(0..)
            // Over shorter distances the roughness of a simulated beat counts.
            .filter(|(square, _)| *square >= DIFFERENCE.powi(2))
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
                directions[(j, k)] = scale * (other - here);
            }
            for (i, (other, here)) in self.residuals[*index].iter().zip(residuals).enumerate() {
                slopes[(i, k)] = scale * (other - here);
            }
        }
        slopes -= of_mode * &directions;
        let prior = 1.0 / from_mode;
        let matrix = &directions * directions.transpose() + DMatrix::identity(n, n) * prior;
        let Some(factor) = matrix.cholesky() else {
            return of_mode.clone();
        };
        let change = factor.solve(&(directions * slopes.transpose()));
        of_mode + change.transpose()
    }
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
