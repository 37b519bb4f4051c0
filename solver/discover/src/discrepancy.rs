//! DiscrepancyTerm competitors: what may stand for a gap that no candidate names, alone and beside the named ones.
//!
//! An answer holds only if it does not depend on how the rest of the gap is treated. So every structure is fitted without
//! any competitor and with each: free bumps of the activation, smooth errors of pressure and volume, and a
//! candidate that improves the fit but may not be named (its strength is below what is worth a name, or at a bound).

use crate::fit::Fit;
use crate::forward::Forward;
use crate::least_squares::Settings;
use crate::measured::Measured;
use crate::noise::ModelDiscrepancy;
use crate::problem::{Data, N_BUMPS, Problem, Structure};
use crate::search::{UNBENT, add_term, best, is_bent};
use rayon::prelude::*;

/// A competitor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DiscrepancyTerm {
    /// None.
    Nothing,
    /// Free bumps of the activation.
    Activation,
    /// Smooth errors of pressure and volume.
    Traces,
    /// A candidate, by position, that may not be named.
    Unnamed(usize),
}

/// Those that every structure is fitted with.
pub const ALWAYS: [DiscrepancyTerm; 3] = [
    DiscrepancyTerm::Nothing,
    DiscrepancyTerm::Activation,
    DiscrepancyTerm::Traces,
];

/// The data as each competitor sees them: a smooth error is part of the covariance.
#[derive(Debug)]
pub struct Views {
    /// Without competitor, and with one of the activation.
    pub plain: Data,
    traces: Data,
}

impl Views {
    /// Covariances of all.
    #[must_use]
    pub fn new(measured: &Measured, model_discrepancy: &ModelDiscrepancy) -> Self {
        Self {
            plain: Data::new(measured.clone(), model_discrepancy),
            traces: Data::new(measured.clone(), &ModelDiscrepancy::discrepancy()),
        }
    }

    /// The problem with a competitor.
    pub fn problem<'a>(&'a self, forward: &'a dyn Forward, kind: DiscrepancyTerm) -> Problem<'a> {
        let data = match kind {
            DiscrepancyTerm::Nothing
            | DiscrepancyTerm::Activation
            | DiscrepancyTerm::Unnamed(_) => &self.plain,
            DiscrepancyTerm::Traces => &self.traces,
        };
        Problem { forward, data }
    }
}

/// One structure fitted without competitor and with some.
#[derive(Debug, Clone)]
pub struct FitsByDiscrepancy {
    /// Competitor and fit; the first is without any.
    pub fits: Vec<(DiscrepancyTerm, Fit)>,
}

impl FitsByDiscrepancy {
    /// The fit without competitor.
    #[must_use]
    pub fn plain(&self) -> &Fit {
        &self.fits[0].1
    }

    /// The fit with a competitor.
    #[must_use]
    pub fn with(&self, kind: DiscrepancyTerm) -> Option<&Fit> {
        self.fits
            .iter()
            .find(|(k, _)| *k == kind)
            .map(|(_, fit)| fit)
    }

    /// The best treatment of the rest.
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

    /// Evidence under the best treatment of the rest.
    #[must_use]
    pub fn neg2_log_evidence(&self) -> f64 {
        self.best().1.neg2_log_evidence
    }

    /// The best competitor without a name of its own, and its evidence against none.
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

/// Start of a structure with a competitor from a fit of the same terms with another one.
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

/// Fits the terms of `known` with a competitor, from each of the fits of the same terms.
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

/// The structure of `known` (first without competitor) with all of `kinds`; competitors that `known` has are kept.
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
