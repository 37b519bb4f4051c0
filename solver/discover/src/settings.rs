//! Settings of a search.

use cardiotwin_vocabulary::findings::SearchSettings;

use crate::learnt::Learnt;
use crate::least_squares::Settings as FitSettings;
use crate::noise::ErrorModel;

/// Settings of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Settings of each fit.
    pub fit: FitSettings,
    /// Discrepancy that the model may show although no effect is missing.
    pub error_model: ErrorModel,
    /// Discrepancies learnt on healthy hearts, besides.
    pub learnt: Learnt,
    /// Candidates and criteria. Without names of candidates, all effects of the catalogue are
    /// tried.
    pub search: SearchSettings,
    /// Seed of the bootstrap.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            fit: FitSettings::default(),
            error_model: ErrorModel::default(),
            learnt: Learnt::healthy_hearts(),
            search: SearchSettings::default(),
            seed: 1,
        }
    }
}
