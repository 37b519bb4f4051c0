//! Competitors without a name: terms that may stand for a gap that no candidate names, alone and
//! next to the named ones.
//!
//! A result must not depend on the treatment of the remaining gap. Every structure is therefore fitted
//! without a competitor and with each of them, and the evidence is averaged over these fits: free bumps of the
//! activation, smooth errors of pressure and volume, the errors by which the base misses healthy
//! hearts of other formulations, and a candidate that improves the fit but may not be named because
//! its strength is too small or at a bound.

use crate::fit::Fit;
use crate::forward::Forward;
use crate::learnt::Learnt;
use crate::least_squares::Settings;
use crate::measured::Measured;
use crate::noise::ErrorModel;
use crate::problem::{Data, N_BUMPS, Problem, Structure};
use crate::search::{UNBENT, add_term, best, is_bent};
use cardiotwin_models::effects::ONE_OF_MANY;
use rayon::prelude::*;

/// A nameless competitor of the candidates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DiscrepancyTerm {
    /// No competitor: the structure is fitted alone.
    Nothing,
    /// Free bumps of the activation.
    Activation,
    /// Smooth errors of pressure and volume.
    Traces,
    /// Errors by which the base misses healthy hearts of a formulation, by index.
    Formulation(usize),
    /// A candidate, by index, that may not be named.
    Unnamed(usize),
}

/// Prior odds of a competitor that stands for something missing: as those of an effect whose frequency
/// is not stated. Formulations of a healthy heart are as probable as none.
const ODDS_OF_A_GAP: f64 = ONE_OF_MANY;

impl DiscrepancyTerm {
    /// Whether a heart with this discrepancy lacks nothing.
    fn is_healthy(self) -> bool {
        matches!(self, Self::Nothing | Self::Formulation(_))
    }

    /// −2 ln of the weight in the average over competitors.
    fn neg2_log_weight(self) -> f64 {
        if self.is_healthy() {
            0.0
        } else {
            -2.0 * ODDS_OF_A_GAP.ln()
        }
    }
}

/// Twice the logarithm of a sum of odds, each given as twice its logarithm.
pub(crate) fn sum_of_odds(odds: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = odds.clone().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = odds.map(|odds| (0.5 * (odds - largest)).exp()).sum();
    largest + 2.0 * sum.ln()
}

/// −2 ln evidence, averaged over competitors up to a constant.
fn averaged(fits: impl Iterator<Item = (DiscrepancyTerm, f64)> + Clone) -> f64 {
    -sum_of_odds(fits.map(|(kind, neg2)| -neg2 - kind.neg2_log_weight()))
}

/// The data as each competitor sees them. A smooth error is part of the covariance.
#[derive(Debug)]
pub struct Views {
    /// Data without a competitor, which also serve for bumps of the activation.
    pub plain: Data,
    traces: Data,
    formulations: Vec<Data>,
}

impl Views {
    /// Computes the covariances of all views.
    #[must_use]
    pub fn new(measured: &Measured, error_model: &ErrorModel, learnt: &Learnt) -> Self {
        let data = |discrepancy, formulation| Data::new(measured.clone(), discrepancy, formulation);
        Self {
            plain: data(error_model, None),
            traces: data(&error_model.with_smooth_errors(), None),
            formulations: (learnt.formulations.iter())
                .map(|formulation| data(error_model, Some(formulation)))
                .collect(),
        }
    }

    /// Competitors with which every structure is fitted, the first of them none.
    #[must_use]
    pub fn kinds(&self) -> Vec<DiscrepancyTerm> {
        let mut kinds = vec![
            DiscrepancyTerm::Nothing,
            DiscrepancyTerm::Activation,
            DiscrepancyTerm::Traces,
        ];
        kinds.extend((0..self.formulations.len()).map(DiscrepancyTerm::Formulation));
        kinds
    }

    /// The fit problem with a competitor.
    pub fn problem<'a>(&'a self, forward: &'a dyn Forward, kind: DiscrepancyTerm) -> Problem<'a> {
        let data = match kind {
            DiscrepancyTerm::Nothing
            | DiscrepancyTerm::Activation
            | DiscrepancyTerm::Unnamed(_) => &self.plain,
            DiscrepancyTerm::Traces => &self.traces,
            DiscrepancyTerm::Formulation(at) => &self.formulations[at],
        };
        Problem { forward, data }
    }
}

/// One structure, fitted without a competitor and with some.
#[derive(Debug, Clone)]
pub struct FitsByDiscrepancy {
    /// Competitor and fit; the first entry has no competitor.
    pub fits: Vec<(DiscrepancyTerm, Fit)>,
}

impl FitsByDiscrepancy {
    /// The fit without a competitor.
    #[must_use]
    pub fn plain(&self) -> &Fit {
        &self.fits[0].1
    }

    /// The fit with a competitor, if it was made.
    #[must_use]
    pub fn with(&self, kind: DiscrepancyTerm) -> Option<&Fit> {
        self.fits
            .iter()
            .find(|(k, _)| *k == kind)
            .map(|(_, fit)| fit)
    }

    /// The fit with the best treatment of the remaining gap.
    #[must_use]
    pub fn best(&self) -> &(DiscrepancyTerm, Fit) {
        self.fits
            .iter()
            .reduce(|a, b| {
                if b.1.neg2_log_evidence < a.1.neg2_log_evidence {
                    b
                } else {
                    a
                }
            })
            .expect("one fit at least")
    }

    /// Takes over the better fits of the same structure with the competitors that these fits have.
    pub fn improve(&mut self, other: &Self) {
        for (kind, own) in &mut self.fits {
            if let Some(fit) = other.with(*kind).filter(|fit| fit.deviance < own.deviance) {
                *own = fit.clone();
            }
        }
    }

    /// Evidence averaged over the treatments of the remaining gap, up to a constant. A competitor that
    /// explains the same as an effect takes no more from it than its prior odds allow.
    #[must_use]
    pub fn neg2_log_evidence(&self) -> f64 {
        averaged((self.fits.iter()).map(|(kind, fit)| (*kind, fit.neg2_log_evidence)))
    }

    /// Best competitor that no healthy heart explains, and its evidence against the formulation of a
    /// healthy heart that is nearest to the data.
    #[must_use]
    pub fn unhealthy(&self) -> (DiscrepancyTerm, f64) {
        let healthy = (self.fits.iter())
            .filter(|(kind, _)| kind.is_healthy())
            .map(|(_, fit)| fit.neg2_log_evidence)
            .fold(f64::MAX, f64::min);
        (self.fits.iter())
            .filter(|(kind, _)| !kind.is_healthy() && !matches!(kind, DiscrepancyTerm::Unnamed(_)))
            .map(|(kind, fit)| (*kind, healthy - fit.neg2_log_evidence))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((DiscrepancyTerm::Nothing, 0.0))
    }

    /// Best nameless competitor and its evidence against no competitor.
    #[must_use]
    pub fn nameless(&self) -> (DiscrepancyTerm, f64) {
        let gain = |fit: &Fit| self.plain().neg2_log_evidence - fit.neg2_log_evidence;
        self.fits
            .iter()
            .filter(|(kind, _)| {
                !matches!(kind, DiscrepancyTerm::Nothing | DiscrepancyTerm::Unnamed(_))
            })
            .map(|(kind, fit)| (*kind, gain(fit)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((DiscrepancyTerm::Nothing, 0.0))
    }
}

/// Start of a structure with a competitor, from a fit of the same terms with another competitor.
fn start(fit: &Fit, bumps: bool) -> (Structure, Vec<f64>) {
    let mut z = fit.z.clone();
    match (fit.structure.bumps, bumps) {
        (false, true) => z.extend([0.0; N_BUMPS]),
        (true, false) => z.truncate(z.len() - N_BUMPS),
        _ => {}
    }
    (
        Structure {
            terms: fit.structure.terms.clone(),
            bumps,
        },
        z,
    )
}

/// Fits the terms of `known` with a competitor, from each of these fits.
#[must_use]
pub fn fit_with(
    views: &Views,
    forward: &dyn Forward,
    kind: DiscrepancyTerm,
    known: &[&Fit],
    settings: &Settings,
) -> Option<Fit> {
    let problem = views.problem(forward, kind);
    if let DiscrepancyTerm::Unnamed(term) = kind {
        return known
            .first()
            .and_then(|fit| add_term(&problem, fit, term, settings));
    }
    let mut starts: Vec<(&Fit, bool)> = known.iter().map(|fit| (*fit, false)).collect();
    starts.extend(
        known
            .first()
            .filter(|fit| is_bent(&problem, fit))
            .map(|fit| (*fit, true)),
    );
    let tries: Vec<Option<Fit>> = starts
        .par_iter()
        .map(|(fit, unbent)| {
            let (structure, mut z) = start(fit, kind == DiscrepancyTerm::Activation);
            if *unbent {
                z.iter_mut().for_each(|z| *z *= UNBENT);
            }
            problem.fit(&structure, &z, (!unbent).then_some(*fit), settings)
        })
        .collect();
    best(tries)
}

/// Adds all competitors of `kinds` to the structure of `known`, whose first fit has no competitor.
/// The fits of `known` are kept.
#[must_use]
pub fn fit_by_discrepancy(
    views: &Views,
    forward: &dyn Forward,
    known: FitsByDiscrepancy,
    kinds: &[DiscrepancyTerm],
    settings: &Settings,
) -> FitsByDiscrepancy {
    let own = &known.plain().structure.terms;
    let missing: Vec<DiscrepancyTerm> = (kinds.iter().copied())
        .filter(|kind| {
            known.with(*kind).is_none()
                && !matches!(kind, DiscrepancyTerm::Unnamed(t) if own.contains(t))
        })
        .collect();
    let starts: Vec<&Fit> = known
        .fits
        .iter()
        .filter(|(k, _)| !matches!(k, DiscrepancyTerm::Unnamed(_)))
        .map(|(_, fit)| fit)
        .collect();
    let found: Vec<(DiscrepancyTerm, Option<Fit>)> = missing
        .par_iter()
        .map(|kind| (*kind, fit_with(views, forward, *kind, &starts, settings)))
        .collect();
    let mut fits = known.fits.clone();
    fits.extend(
        found
            .into_iter()
            .filter_map(|(kind, fit)| Some((kind, fit?))),
    );
    FitsByDiscrepancy { fits }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_add() {
        let twice_log = |odds: f64| 2.0 * odds.ln();
        let sum = sum_of_odds([5.0, 4.0].map(twice_log).into_iter());
        assert!((sum - twice_log(9.0)).abs() < 1e-12);
        assert!((sum_of_odds([3.0].into_iter()) - 3.0).abs() < 1e-12);
    }

    /// Evidence of 20 for an effect whose gap a competitor explains as well.
    fn left(competitor: DiscrepancyTerm) -> f64 {
        let fits = |alone: f64| [(DiscrepancyTerm::Nothing, alone), (competitor, 80.0)].into_iter();
        averaged(fits(100.0)) - averaged(fits(80.0))
    }

    #[test]
    fn a_gap_without_a_name_leaves_an_effect_its_odds_and_a_healthy_formulation_does_not() {
        let nameless = left(DiscrepancyTerm::Traces);
        assert!((nameless - 2.0 * 11f64.ln()).abs() < 0.01, "{nameless}");
        let healthy = left(DiscrepancyTerm::Formulation(0));
        assert!((healthy - 2.0 * 2f64.ln()).abs() < 0.01, "{healthy}");
    }
}
