//! Mode of a posterior.

use nalgebra::DMatrix;

use super::Target;
use crate::descent::{Aim, Descent};

/// Mode of a posterior, where its density is highest.
#[derive(Debug, Clone)]
pub struct Mode {
    /// Mode in standard coordinates.
    pub u: Vec<f64>,
    /// Residuals at the mode.
    pub(super) residuals: Vec<f64>,
    /// Derivatives of the residuals, shape (residuals, parameters).
    pub(super) jacobian: DMatrix<f64>,
    /// Number of evaluations of the model.
    pub evaluations: usize,
}

impl Mode {
    /// Half the sum of squares of the residuals and of the standard coordinates.
    #[must_use]
    pub fn height(&self) -> f64 {
        0.5 * self
            .residuals
            .iter()
            .chain(&self.u)
            .map(|v| v * v)
            .sum::<f64>()
    }

    /// Sum of squares left by data and prior, over its expected value. It is about 1 if the model,
    /// the prior and the errors are right.
    ///
    /// - `error_factor`: factor by which the standard deviations of the residuals were enlarged
    #[must_use]
    pub fn left(&self, error_factor: f64) -> f64 {
        let squares = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
        (error_factor.powi(2) * squares(&self.residuals) + squares(&self.u))
            / self.residuals.len().max(1) as f64
    }
}

/// Mode of a posterior near a point; `None` if the model has no result at the start.
///
/// - `start`: point in standard coordinates
#[must_use]
pub fn mode<Q>(target: &Target<'_, Q>, start: &[f64], max_steps: usize) -> Option<Mode> {
    let found = target.at(start)?;
    let model = |u: &[f64]| target.at(u);
    let aim = Aim {
        errors: vec![0.0; found.residuals.len()],
        prior: vec![0.0; start.len()],
        weight: 1.0,
    };
    let mut descent = Descent {
        model: &model,
        aim,
        evaluations: 1,
    };
    let end = descent.from(start.to_vec(), found, max_steps)?;
    Some(Mode {
        u: end.u,
        residuals: end.found.residuals,
        jacobian: end.jacobian,
        evaluations: descent.evaluations,
    })
}
