//! Sampling distribution of one run and its adaptation, in unit coordinates.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Weights and rates that follow from the dimension and the population size.
pub(super) struct Rates {
    /// Weights of the better half, the best one first; they sum to one.
    weights: Vec<f64>,
    /// Variance-effective number of parents.
    n_effective: f64,
    path_sigma: f64,
    path_covariance: f64,
    rank_one: f64,
    rank_mu: f64,
    damping: f64,
    /// Expected length of a standard normal vector.
    length: f64,
}

impl Rates {
    pub(super) fn new(n_dimensions: usize, n_candidates: usize) -> Self {
        let n = n_dimensions as f64;
        let raw: Vec<f64> = (1..=n_candidates / 2)
            .map(|i| (0.5 * (n_candidates as f64 + 1.0)).ln() - (i as f64).ln())
            .collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|w| w / sum).collect();
        let mu = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let path_sigma = (mu + 2.0) / (n + mu + 5.0);
        let rank_one = 2.0 / ((n + 1.3).powi(2) + mu);
        Self {
            n_effective: mu,
            path_sigma,
            path_covariance: (4.0 + mu / n) / (n + 4.0 + 2.0 * mu / n),
            rank_one,
            rank_mu: (2.0 * (mu - 2.0 + 1.0 / mu) / ((n + 2.0).powi(2) + mu))
                .clamp(0.0, 1.0 - rank_one),
            damping: 1.0 + 2.0 * (((mu - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + path_sigma,
            length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
            weights,
        }
    }
}

/// Mean, scale and shape of the sampling distribution of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Distribution {
    pub(super) mean: Vec<f64>,
    pub(super) sigma: f64,
    /// Covariance, column by column.
    covariance: Vec<f64>,
    path_sigma: Vec<f64>,
    path_covariance: Vec<f64>,
    n_updates: usize,
}

/// Axes of the covariance: its eigenvectors and the square roots of its eigenvalues.
pub(super) struct Axes {
    vectors: DMatrix<f64>,
    lengths: DVector<f64>,
}

impl Axes {
    /// Converts standard normal numbers to a step of the distribution.
    pub(super) fn step(&self, normal: &[f64]) -> Vec<f64> {
        let scaled = DVector::from_iterator(
            normal.len(),
            normal.iter().zip(self.lengths.iter()).map(|(z, l)| z * l),
        );
        (&self.vectors * scaled).as_slice().to_vec()
    }

    /// Scales a step to unit variance: its product with the inverse square root of the covariance.
    fn whiten(&self, step: &DVector<f64>) -> DVector<f64> {
        let along = self.vectors.tr_mul(step);
        &self.vectors * along.zip_map(&self.lengths, |a, l| a / l)
    }

    /// Ratio of the longest to the shortest axis.
    pub(super) fn condition(&self) -> f64 {
        self.lengths.max() / self.lengths.min()
    }
}

impl Distribution {
    pub(super) fn new(mean: Vec<f64>, sigma: f64) -> Self {
        let n = mean.len();
        Self {
            mean,
            sigma,
            covariance: DMatrix::<f64>::identity(n, n).as_slice().to_vec(),
            path_sigma: vec![0.0; n],
            path_covariance: vec![0.0; n],
            n_updates: 0,
        }
    }

    fn covariance(&self) -> DMatrix<f64> {
        DMatrix::from_column_slice(self.mean.len(), self.mean.len(), &self.covariance)
    }

    pub(super) fn axes(&self) -> Axes {
        let eigen = SymmetricEigen::new(self.covariance());
        // Rounding may leave an eigenvalue below zero on an axis that has shrunk to nothing.
        Axes {
            vectors: eigen.eigenvectors,
            lengths: eigen.eigenvalues.map(|v| v.max(1e-30).sqrt()),
        }
    }

    /// Mean variance of a sample's coordinates.
    pub(super) fn mean_variance(&self) -> f64 {
        self.sigma * self.sigma * self.covariance().trace() / self.mean.len() as f64
    }

    /// Largest standard deviation of a sample's coordinates.
    pub(super) fn largest_deviation(&self) -> f64 {
        self.sigma * self.covariance().diagonal().max().sqrt()
    }

    /// Adapts to the steps of the better half, the best one first, in units of sigma.
    pub(super) fn update(&mut self, steps: &[Vec<f64>], rates: &Rates, axes: &Axes) {
        self.n_updates += 1;
        let n = self.mean.len();
        let vector = |v: &[f64]| DVector::from_column_slice(v);
        let ranked = || rates.weights.iter().zip(steps);
        let mean_step = ranked().fold(DVector::zeros(n), |sum, (w, step)| sum + *w * vector(step));
        for (mean, step) in self.mean.iter_mut().zip(mean_step.iter()) {
            // Penalties push the mean back, so that it need not go further than this.
            *mean = (*mean + self.sigma * step).clamp(-0.1, 1.1);
        }
        let gain = |rate: f64| (rate * (2.0 - rate) * rates.n_effective).sqrt();
        let path_sigma = (1.0 - rates.path_sigma) * vector(&self.path_sigma)
            + gain(rates.path_sigma) * axes.whiten(&mean_step);
        let length = path_sigma.norm() / rates.length;
        // While the scale still grows fast, the covariance's path would blow up.
        let start = (1.0 - (1.0 - rates.path_sigma).powi(2 * self.n_updates as i32)).sqrt();
        let moves = f64::from(u8::from(length / start < 1.4 + 2.0 / (n as f64 + 1.0)));
        let path_covariance = (1.0 - rates.path_covariance) * vector(&self.path_covariance)
            + moves * gain(rates.path_covariance) * &mean_step;
        let missing = (1.0 - moves) * rates.path_covariance * (2.0 - rates.path_covariance);
        let mut covariance =
            self.covariance() * (1.0 - rates.rank_one - rates.rank_mu + rates.rank_one * missing);
        covariance.ger(rates.rank_one, &path_covariance, &path_covariance, 1.0);
        for (weight, step) in ranked() {
            let step = vector(step);
            covariance.ger(rates.rank_mu * weight, &step, &step, 1.0);
        }
        self.sigma =
            (self.sigma * (rates.path_sigma / rates.damping * (length - 1.0)).exp()).min(1.0);
        self.covariance = covariance.as_slice().to_vec();
        self.path_sigma = path_sigma.as_slice().to_vec();
        self.path_covariance = path_covariance.as_slice().to_vec();
    }
}
