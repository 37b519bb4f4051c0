//! Nameless competitors: what may stand for a gap that no candidate names, alone and beside the named ones.
//!
//! An answer holds only if it does not depend on how the rest of the gap is treated. So every structure is fitted without
//! any competitor and with each: free bumps of the activation, smooth errors of pressure and volume, and a
//! candidate that improves the fit but may not be named (its strength is below what is worth a name, or at a bound).

use crate::fit::Fit;
use crate::forward::Forward;
use crate::least_squares::Settings;
use crate::measured::Measured;
use crate::noise::Tolerance;
use crate::problem::{Data, N_BUMPS, Problem, Structure};
use crate::search::{UNBENT, add_term, best, is_bent};
use rayon::prelude::*;

/// A competitor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nameless {
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
pub const ALWAYS: [Nameless; 3] = [Nameless::Nothing, Nameless::Activation, Nameless::Traces];

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
    pub fn new(measured: &Measured, tolerance: &Tolerance) -> Self {
        Self {
            plain: Data::new(measured.clone(), tolerance),
            traces: Data::new(measured.clone(), &Tolerance::discrepancy()),
        }
    }

    /// The problem with a competitor.
    pub fn problem<'a>(&'a self, forward: &'a dyn Forward, kind: Nameless) -> Problem<'a> {
        let data = match kind {
            Nameless::Nothing | Nameless::Activation | Nameless::Unnamed(_) => &self.plain,
            Nameless::Traces => &self.traces,
        };
        Problem { forward, data }
    }
}

/// One structure fitted without competitor and with some.
#[derive(Debug, Clone)]
pub struct Wide {
    /// Competitor and fit; the first is without any.
    pub fits: Vec<(Nameless, Fit)>,
}

impl Wide {
    /// The fit without competitor.
    #[must_use]
    pub fn plain(&self) -> &Fit {
        &self.fits[0].1
    }

    /// The fit with a competitor.
    #[must_use]
    pub fn with(&self, kind: Nameless) -> Option<&Fit> {
        self.fits
            .iter()
            .find(|(k, _)| *k == kind)
            .map(|(_, fit)| fit)
    }

    /// The best treatment of the rest.
    #[must_use]
    pub fn best(&self) -> &(Nameless, Fit) {
        self.fits
            .iter()
            .reduce(|a, b| if b.1.evidence < a.1.evidence { b } else { a })
            .expect("one fit at least")
    }

    /// Evidence under the best treatment of the rest.
    #[must_use]
    pub fn evidence(&self) -> f64 {
        self.best().1.evidence
    }

    /// The best competitor without a name of its own, and its evidence against none.
    #[must_use]
    pub fn nameless(&self) -> (Nameless, f64) {
        let gain = |fit: &Fit| self.plain().evidence - fit.evidence;
        self.fits
            .iter()
            .filter(|(kind, _)| !matches!(kind, Nameless::Nothing | Nameless::Unnamed(_)))
            .map(|(kind, fit)| (*kind, gain(fit)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((Nameless::Nothing, 0.0))
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
    kind: Nameless,
    known: &[&Fit],
    settings: &Settings,
) -> Option<Fit> {
    let problem = views.problem(forward, kind);
    if let Nameless::Unnamed(term) = kind {
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
            let (structure, mut z) = start(fit, kind == Nameless::Activation);
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
pub fn widen(
    views: &Views,
    forward: &dyn Forward,
    known: Wide,
    kinds: &[Nameless],
    settings: &Settings,
) -> Wide {
    let own = &known.plain().structure.terms;
    let missing: Vec<Nameless> = (kinds.iter().copied())
        .filter(|kind| {
            known.with(*kind).is_none() && !matches!(kind, Nameless::Unnamed(t) if own.contains(t))
        })
        .collect();
    let starts: Vec<&Fit> = known
        .fits
        .iter()
        .filter(|(k, _)| !matches!(k, Nameless::Unnamed(_)))
        .map(|(_, fit)| fit)
        .collect();
    let found: Vec<(Nameless, Option<Fit>)> = missing
        .par_iter()
        .map(|kind| (*kind, fit_with(views, forward, *kind, &starts, settings)))
        .collect();
    let mut fits = known.fits.clone();
    fits.extend(
        found
            .into_iter()
            .filter_map(|(kind, fit)| Some((kind, fit?))),
    );
    Wide { fits }
}
