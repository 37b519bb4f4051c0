//! Fits of structures: the most probable parameters with profiled noise scales, and the evidence of
//! the structure.

use crate::forward::Orbits;
use crate::least_squares::{Known, Minimum, Settings, minimise_from};
use crate::parameter::Parameter;
use crate::problem::{Misfit, Problem, Structure, Weights};
use nalgebra::{DMatrix, DVector};

/// Largest number of times that the noise scales are profiled again; starts with a large misfit
/// need several.
const ROUNDS: usize = 12;
/// Weights before the misfit is known.
pub(crate) const UNIT: Weights = Weights {
    pressure: 1.0,
    volume: 1.0,
};

/// A structure at its most probable parameters, with its evidence.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Structure that was fitted.
    pub structure: Structure,
    /// Parameters of the structure.
    pub parameters: Vec<Parameter>,
    /// z of the fitted parameters.
    pub z: Vec<f64>,
    /// White, weighted residuals at the optimum, priors last.
    pub minimum: Minimum<Orbits>,
    /// Weights of pressure and volume in the last minimisation.
    pub weights: Weights,
    /// Sums of squares by origin.
    pub misfit: Misfit,
    /// −2 ln(likelihood · prior) at the optimum with the noise scales integrated out, up to a
    /// constant of the data.
    pub deviance: f64,
    /// −2 ln of the evidence by Laplace's approximation, up to the same constant.
    pub neg2_log_evidence: f64,
    /// Number of evaluations over all rounds of the fit.
    pub n_evaluations: usize,
}

impl Fit {
    /// Fitted values, in the units of the parameters.
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        self.parameters
            .iter()
            .zip(&self.z)
            .map(|(p, z)| p.value(*z))
            .collect()
    }

    /// Curvature JᵀJ at the optimum, including priors.
    #[must_use]
    pub fn curvature(&self) -> DMatrix<f64> {
        self.minimum.jacobian.tr_mul(&self.minimum.jacobian)
    }

    /// Number of parameters that are determined by the data rather than by the prior: the trace of
    /// (H − I) H⁻¹.
    #[must_use]
    pub fn effective_parameters(&self) -> f64 {
        let n = self.z.len() as f64;
        self.curvature()
            .cholesky()
            .map_or(n, |c| n - c.inverse().trace())
    }

    /// Standard deviation of every value from the linearised model; infinite if the curvature is
    /// singular.
    #[must_use]
    pub fn standard_deviations(&self) -> Vec<f64> {
        let inverse = self.curvature().cholesky().map(|c| c.inverse());
        let sd = |i: usize| {
            inverse
                .as_ref()
                .map_or(f64::INFINITY, |m| m[(i, i)].max(0.0).sqrt())
        };
        self.parameters
            .iter()
            .zip(&self.z)
            .enumerate()
            .map(|(i, (p, z))| sd(i) * p.slope(*z).abs())
            .collect()
    }
}

/// Sets the derivative of the prior, the last rows, where a parameter has no derivatives because the
/// model has no beat next to it: without it the curvature would be singular.
fn keep_priors(jacobian: &mut DMatrix<f64>) {
    let (n_rows, n) = jacobian.shape();
    for i in 0..n {
        if jacobian.column(i).iter().all(|d| *d == 0.0) {
            jacobian[(n_rows - n + i, i)] = 1.0;
        }
    }
}

impl Problem<'_> {
    /// Degrees of freedom of the prior knowledge of the noise scales: pressure (also from its own
    /// high band) and volume.
    fn degrees(&self) -> (f64, f64) {
        let stated = self.data.error_model.stated_degrees();
        (2.0 * stated, stated)
    }

    /// Weights that profile the noise scales at this misfit.
    fn weights(&self, misfit: &Misfit) -> Weights {
        let (nu_p, nu_v) = self.degrees();
        let weight = |nu: f64, n: usize, chi2: f64| (nu + n as f64) / (nu + chi2);
        Weights {
            pressure: weight(nu_p, self.data.pressure.len(), misfit.pressure),
            volume: weight(nu_v, self.data.volume.len(), misfit.volume),
        }
    }

    /// Converts residuals and derivatives from one set of weights to another.
    fn reweighted(
        &self,
        mut r: DVector<f64>,
        mut jacobian: DMatrix<f64>,
        from: Weights,
        to: Weights,
    ) -> Known {
        let (n_p, n_v) = (self.data.pressure.len(), self.data.volume.len());
        let (p, v) = (
            (to.pressure / from.pressure).sqrt(),
            (to.volume / from.volume).sqrt(),
        );
        r.rows_mut(0, n_p).scale_mut(p);
        r.rows_mut(n_p, n_v).scale_mut(v);
        jacobian.rows_mut(0, n_p).scale_mut(p);
        jacobian.rows_mut(n_p, n_v).scale_mut(v);
        (r, jacobian)
    }

    /// −2 ln(likelihood · prior) with the noise scales integrated out.
    #[must_use]
    pub fn deviance(&self, misfit: &Misfit) -> f64 {
        let (nu_p, nu_v) = self.degrees();
        let part = |nu: f64, n: usize, chi2: f64| (nu + n as f64) * (chi2 / nu).ln_1p();
        part(nu_p, self.data.pressure.len(), misfit.pressure)
            + part(nu_v, self.data.volume.len(), misfit.volume)
            + misfit.side
            + misfit.prior
            + misfit.log_determinant
            + self.data.noise_log_determinant()
    }

    /// Fits a structure from one start, with the noise scales and orbit of a nearby fit; `None` if
    /// the model has no beat there.
    #[must_use]
    pub fn fit(
        &self,
        structure: &Structure,
        start: &[f64],
        near: Option<&Fit>,
        settings: &Settings,
    ) -> Option<Fit> {
        let parameters = self.parameters(structure);
        let bounds: Vec<(f64, f64)> = parameters.iter().map(Parameter::z_bounds).collect();
        let mut weights = near.map_or(UNIT, |fit| fit.weights);
        let mut warm = near.map(|fit| fit.minimum.warm.clone());
        let mut z = start.to_vec();
        let mut known = None;
        let mut n_evaluations = 0;
        let mut round = 0;
        loop {
            let residuals = |z: &[f64], warm: Option<&Orbits>| {
                self.residuals(structure, &parameters, z, weights, warm)
            };
            let mut minimum = minimise_from(
                &residuals,
                &z,
                warm.as_ref(),
                known.take(),
                &bounds,
                settings,
            )?;
            n_evaluations += minimum.n_evaluations;
            keep_priors(&mut minimum.jacobian);
            let misfit = self.misfit(&minimum.residuals, weights);
            let next = self.weights(&misfit);
            let change = (next.pressure / weights.pressure)
                .ln()
                .abs()
                .max((next.volume / weights.volume).ln().abs());
            round += 1;
            if change < 0.03 || round == ROUNDS {
                let deviance = self.deviance(&misfit);
                let normal = minimum.jacobian.tr_mul(&minimum.jacobian);
                let factor = normal.cholesky()?.l();
                let log_det = 2.0 * factor.diagonal().iter().map(|d| d.ln()).sum::<f64>();
                let neg2_log_evidence = deviance + log_det;
                let z = minimum.z.clone();
                let structure = structure.clone();
                return Some(Fit {
                    structure,
                    parameters,
                    z,
                    minimum,
                    weights,
                    misfit,
                    deviance,
                    neg2_log_evidence,
                    n_evaluations,
                });
            }
            known = Some(self.reweighted(minimum.residuals, minimum.jacobian, weights, next));
            weights = next;
            z = minimum.z;
            warm = Some(minimum.warm);
        }
    }
}
