//! A run of the expensive model.

use crate::fixed_point::Outcome;
use serde::{Deserialize, Serialize};

/// A run of the expensive model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Simulated point, as logarithms of the parameters.
    pub x: Vec<f64>,
    /// Outcome of the simulation.
    pub outcome: Outcome,
    /// Residuals outside the biomarkers, as [`super::Trial::also`].
    pub also: Vec<f64>,
    /// Misfit of the corrected cheap model at the point; `None` if no proposal led to it.
    pub predicted_misfit: Option<f64>,
}
