//! Cost of an iteration: squared relative differences between simulated and measured biomarkers.

use super::FixedPointError;
use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One term of the cost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Term {
    /// Biomarker that the term compares.
    pub biomarker: Biomarker,
    /// (clinical − simulated)/clinical, dimensionless; 1 if the simulation lacks the biomarker.
    pub relative_difference: f64,
}

/// Cost of an iteration, dimensionless, with its terms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Sum of the squared relative differences.
    pub total: f64,
    /// One term per measured biomarker, pressure first.
    pub terms: Vec<Term>,
}

impl Cost {
    /// Sum of squared relative differences (Jung 2022, eqs. 12, 14; unweighted, over all measured
    /// biomarkers).
    ///
    /// A biomarker that the simulation could not give counts with a relative difference of 1.
    #[must_use]
    pub fn of(measured: &Biomarkers, simulated: &Biomarkers) -> Self {
        let terms: Vec<Term> = Biomarker::OF_COST
            .into_iter()
            .filter_map(|biomarker| {
                let relative_difference =
                    difference(measured.get(biomarker)?, simulated.get(biomarker));
                Some(Term {
                    biomarker,
                    relative_difference,
                })
            })
            .collect();
        Self {
            total: terms.iter().map(|t| t.relative_difference.powi(2)).sum(),
            terms,
        }
    }
}

/// Weights of the squared relative differences in a misfit, which selects the best iteration within
/// the tolerance and which space mapping lowers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Weights([f64; Biomarker::OF_ORGAN.len()]);

impl Default for Weights {
    /// Weights of the cost, for which the misfit equals the cost.
    fn default() -> Self {
        Self(
            Biomarker::OF_ORGAN.map(|biomarker| if biomarker == Biomarker::Sv { 0.0 } else { 1.0 }),
        )
    }
}

impl Weights {
    /// Returns a copy with another weight for one biomarker of [`Biomarker::OF_ORGAN`]. Weights are
    /// finite, not negative and dimensionless. Other biomarkers have no weight.
    #[must_use]
    pub fn with(mut self, biomarker: Biomarker, weight: f64) -> Self {
        let place = Biomarker::OF_ORGAN.iter().position(|b| *b == biomarker);
        if let Some(place) = place.and_then(|idx| self.0.get_mut(idx)) {
            *place = weight;
        }
        self
    }

    /// The cost's weights, with other values for the biomarkers whose keys are given.
    ///
    /// # Errors
    /// [`FixedPointError::UnknownBiomarker`] if step 1 does not compare a biomarker of that key.
    pub fn of(given: &BTreeMap<String, f64>) -> Result<Self, FixedPointError> {
        given
            .iter()
            .try_fold(Self::default(), |weights, (name, weight)| {
                let biomarker = Biomarker::named(name)
                    .filter(|biomarker| Biomarker::OF_ORGAN.contains(biomarker))
                    .ok_or_else(|| FixedPointError::UnknownBiomarker { name: name.clone() })?;
                Ok(weights.with(biomarker, *weight))
            })
    }

    /// One over the variance of each relative difference. The standard deviations are given per
    /// biomarker key, in percent of the measured value; a biomarker without one has no weight.
    #[must_use]
    pub fn of_uncertainty_percent(uncertainty_percent: &BTreeMap<String, f64>) -> Self {
        let weight = |biomarker: Biomarker| {
            uncertainty_percent
                .get(biomarker.key())
                .map(|sd| (0.01 * sd).powi(-2))
        };
        Self(Biomarker::OF_ORGAN.map(|biomarker| weight(biomarker).unwrap_or(0.0)))
    }

    /// (clinical − simulated)/clinical times the root of the weight, for each measured biomarker
    /// that has a weight. The difference is 1 if the simulation lacks the biomarker.
    #[must_use]
    pub fn residuals(&self, measured: &Biomarkers, simulated: &Biomarkers) -> Vec<f64> {
        let weighted = Biomarker::OF_ORGAN
            .into_iter()
            .zip(self.0)
            .filter(|(_, weight)| *weight > 0.0);
        weighted
            .filter_map(|(b, weight)| {
                Some(weight.sqrt() * difference(measured.get(b)?, simulated.get(b)))
            })
            .collect()
    }

    /// Sum of the squared residuals.
    #[must_use]
    pub fn misfit(&self, measured: &Biomarkers, simulated: &Biomarkers) -> f64 {
        self.residuals(measured, simulated)
            .iter()
            .map(|r| r * r)
            .sum()
    }
}

/// (clinical − simulated)/clinical; 1 if the simulated value is missing or not finite.
fn difference(clinical: f64, simulated: Option<f64>) -> f64 {
    simulated
        .map(|s| (clinical - s) / clinical)
        .filter(|d| d.is_finite())
        .unwrap_or(1.0)
}
