//! Settings of a search.

use crate::least_squares::Settings as FitSettings;
use crate::noise::ModelDiscrepancy;

/// Settings of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Settings of each fit.
    pub fit: FitSettings,
    /// Discrepancy that the model may show although no effect is missing.
    pub model_discrepancy: ModelDiscrepancy,
    /// Smallest evidence for a name, twice the logarithm of a Bayes factor: 6 is odds of 20 to 1
    /// (Kass and Raftery 1995).
    pub least_evidence: f64,
    /// Probability that data of the base model lead to a name.
    pub false_alarm: f64,
    /// Number of bootstrap draws.
    pub n_bootstrap: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Largest number of effects of one patient.
    pub max_effects: usize,
    /// Names of the candidates; all effects of the catalogue if empty.
    pub effects: Vec<String>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            fit: FitSettings::default(),
            model_discrepancy: ModelDiscrepancy::default(),
            least_evidence: 6.0,
            false_alarm: 0.04,
            n_bootstrap: 2000,
            seed: 1,
            max_effects: 3,
            effects: Vec::new(),
        }
    }
}
