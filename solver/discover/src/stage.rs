//! One stage of the search: a structure, what each candidate adds to it, and what noise alone would give.

use crate::bootstrap::{Tangent, null_maxima, quantile, tangents};
use crate::discrepancy::{DiscrepancyTerm, FitsByDiscrepancy, Views, fit_by_discrepancy};
use crate::fit::Fit;
use crate::forward::Forward;
use crate::problem::Problem;
use crate::search::{RISE, add_term, best, refit, scan};
use crate::settings::Settings;
use rayon::prelude::*;

/// Evidence below which no result is preferred: "not worth more than a bare mention" (Kass and
/// Raftery 1995).
pub const BARE_MENTION: f64 = 2.0;
/// Score below which a candidate is not fitted where it has been fitted without the competitor, or at an earlier stage.
const WORTH_A_FIT: f64 = -3.0;
/// Evidence with which a candidate that may not be named acts as a competitor: "strong" (Kass and
/// Raftery 1995).
const CLEAR: f64 = 6.0;
/// Number of candidates that are fitted with all competitors.
const SHORT_LIST: usize = 4;
/// Number of candidates whose optima serve as starts for one another.
const CROSSED: usize = 3;

/// Inputs that stay constant during a search.
pub struct Search<'a> {
    /// Data, as each competitor sees them.
    pub views: &'a Views,
    /// Model with its catalogue.
    pub forward: &'a dyn Forward,
    /// Settings of the search.
    pub settings: &'a Settings,
    /// Indices of the candidates to consider.
    pub among: Vec<usize>,
}

/// Fits of a structure and of each candidate added to it.
pub struct SearchStage {
    /// Structure of the stage, with its competitors.
    pub own: FitsByDiscrepancy,
    /// The structure with each candidate added, by candidate index; `None` if it was not fitted.
    pub with: Vec<Option<FitsByDiscrepancy>>,
    /// Directions of the candidates at the structure's fit.
    pub tangents: Vec<Tangent>,
    /// Largest posterior odds of any candidate in draws of noise (twice their logarithm), sorted.
    pub maxima: Vec<f64>,
}

impl SearchStage {
    /// Number of evaluations of the stage's fits.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        let of = |wide: &FitsByDiscrepancy| {
            wide.fits
                .iter()
                .map(|(_, fit)| fit.n_evaluations)
                .sum::<usize>()
        };
        of(&self.own) + self.with.iter().flatten().map(of).sum::<usize>()
    }

    /// The last stage that lacks an effect, where it was fitted next to the others.
    #[must_use]
    pub fn lacking(stages: &[Self], term: usize) -> &Self {
        (stages.iter().rev())
            .find(|stage| stage.with[term].is_some())
            .unwrap_or(&stages[0])
    }

    /// Competitors of the stage that are candidates which may not be named.
    pub fn unnamed(&self) -> impl Iterator<Item = DiscrepancyTerm> {
        self.own
            .fits
            .iter()
            .map(|(kind, _)| *kind)
            .filter(|kind| matches!(kind, DiscrepancyTerm::Unnamed(_)))
    }

    /// Evidence for a candidate, without competitors on either side.
    #[must_use]
    pub fn gain(&self, term: usize) -> Option<f64> {
        Some(
            self.own.plain().neg2_log_evidence
                - self.with[term].as_ref()?.plain().neg2_log_evidence,
        )
    }

    /// Evidence for a candidate, averaged over the competitors on either side.
    #[must_use]
    pub fn robust_gain(&self, term: usize) -> Option<f64> {
        Some(self.own.neg2_log_evidence() - self.with[term].as_ref()?.neg2_log_evidence())
    }
}

impl Search<'_> {
    /// The problem without a competitor.
    #[must_use]
    pub fn plain(&self) -> Problem<'_> {
        self.views.problem(self.forward, DiscrepancyTerm::Nothing)
    }

    /// Fits and evidence of one structure.
    ///
    /// - `known`: fits of the structure; those with competitors are kept where they are better than
    ///   what the stage finds
    #[must_use]
    pub fn stage(&self, known: &FitsByDiscrepancy, index: u64) -> SearchStage {
        let (fit, current) = (&self.settings.fit, known.plain());
        let plain = self.plain();
        let among = if index == 0 {
            self.among.clone()
        } else {
            self.worth_a_fit(&plain, current)
        };
        let mut fits = self.crossed(scan(&plain, current, &among, fit));
        let current = &self.unbent(current, &fits);
        for (term, found) in fits.iter_mut().enumerate() {
            if found
                .as_ref()
                .is_some_and(|f| f.deviance > current.deviance + RISE)
            {
                *found = best([found.take(), add_term(&plain, current, term, fit)]);
            }
        }
        let tangents = tangents(&plain, current, &self.among);
        let maxima = null_maxima(
            &tangents,
            self.settings.search.n_bootstrap as usize,
            self.settings.seed ^ (index << 32),
        );
        let only = FitsByDiscrepancy {
            fits: vec![(DiscrepancyTerm::Nothing, current.clone())],
        };
        let mut wide = fit_by_discrepancy(self.views, self.forward, only, &self.views.kinds(), fit);
        // A candidate with clear evidence that may not be named acts as a competitor.
        let gain = |f: &Fit| current.neg2_log_evidence - f.neg2_log_evidence;
        let unnamed = (fits.iter().enumerate())
            .filter_map(|(term, f)| f.as_ref().map(|f| (term, f)))
            .filter(|(term, f)| gain(f) >= CLEAR && !self.plausible(f, *term))
            .max_by(|a, b| gain(a.1).total_cmp(&gain(b.1)))
            .map(|(term, f)| (DiscrepancyTerm::Unnamed(term), f.clone()));
        wide.fits.extend(unnamed);
        // If a competitor explains much, candidates are also tried next to it.
        let (kind, nameless) = wide.nameless();
        let mut beside: Vec<Option<Fit>> = vec![None; fits.len()];
        let hopeful = self.hopeful(current, &fits, &maxima);
        if let Some(with) = wide.with(kind).filter(|_| nameless > BARE_MENTION) {
            let problem = self.views.problem(self.forward, kind);
            let mut among = self.worth_a_fit(&problem, with);
            among.retain(|term| hopeful.contains(term));
            beside = scan(&problem, with, &among, fit);
        }
        let list = short_list(&hopeful, &fits, &beside);
        let kinds: Vec<DiscrepancyTerm> = wide.fits.iter().map(|(kind, _)| *kind).collect();
        let with = (0..fits.len())
            .into_par_iter()
            .map(|term| {
                let plain = fits[term].clone()?;
                let mut known = FitsByDiscrepancy {
                    fits: vec![(DiscrepancyTerm::Nothing, plain)],
                };
                known.fits.extend(beside[term].clone().map(|f| (kind, f)));
                let wide = list.contains(&term);
                Some(if wide {
                    fit_by_discrepancy(self.views, self.forward, known, &kinds, fit)
                } else {
                    known
                })
            })
            .collect();
        wide.improve(known);
        SearchStage {
            own: wide,
            with,
            tangents,
            maxima,
        }
    }

    /// Candidates whose scores suggest that they improve a fit.
    fn worth_a_fit(&self, problem: &Problem<'_>, current: &Fit) -> Vec<usize> {
        let mut list: Vec<usize> = tangents(problem, current, &self.among)
            .iter()
            .filter(|tangent| tangent.score(&current.minimum.residuals) > WORTH_A_FIT)
            .map(|tangent| tangent.term)
            .collect();
        list.dedup();
        list
    }

    /// Candidates that may get a name by their evidence without a competitor. The others need no
    /// fits with competitors.
    fn hopeful(&self, current: &Fit, fits: &[Option<Fit>], maxima: &[f64]) -> Vec<usize> {
        let least = self.needed(maxima) - BARE_MENTION;
        let candidates = self.forward.candidates();
        (fits.iter().enumerate())
            .filter(|(term, found)| {
                found.as_ref().is_some_and(|with| {
                    let gain = current.neg2_log_evidence - with.neg2_log_evidence;
                    gain + candidates[*term].log_prior >= least
                })
            })
            .map(|(term, _)| term)
            .collect()
    }

    /// Refits the structure from the base values of its best candidates and returns the better
    /// optimum.
    fn unbent(&self, current: &Fit, fits: &[Option<Fit>]) -> Fit {
        let n_base = self.forward.base().len();
        let mut order: Vec<&Fit> = fits.iter().flatten().collect();
        order.sort_by(|a, b| a.neg2_log_evidence.total_cmp(&b.neg2_log_evidence));
        order.truncate(CROSSED);
        let tries: Vec<Option<Fit>> = order
            .par_iter()
            .map(|fit| {
                let mut z = current.z.clone();
                z[..n_base].copy_from_slice(&fit.z[..n_base]);
                refit(
                    &self.plain(),
                    &current.structure,
                    &z,
                    current,
                    &self.settings.fit,
                )
            })
            .collect();
        best(tries)
            .filter(|fit| fit.deviance < current.deviance - RISE)
            .unwrap_or_else(|| current.clone())
    }

    /// Refits the best candidates from the base values of one another, to find optima that a start
    /// missed.
    fn crossed(&self, mut fits: Vec<Option<Fit>>) -> Vec<Option<Fit>> {
        let n_base = self.forward.base().len();
        let mut order: Vec<(usize, f64)> = fits
            .iter()
            .enumerate()
            .filter_map(|(t, f)| Some((t, f.as_ref()?.neg2_log_evidence)))
            .collect();
        order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        order.truncate(CROSSED);
        let pairs: Vec<(usize, usize)> = (order.iter())
            .flat_map(|(to, _)| {
                order
                    .iter()
                    .filter(move |(from, _)| from != to)
                    .map(move |(from, _)| (*to, *from))
            })
            .collect();
        let plain = self.plain();
        let found: Vec<(usize, Option<Fit>)> = pairs
            .par_iter()
            .map(|(to, from)| {
                let (to_fit, from_fit) = (fits[*to].as_ref(), fits[*from].as_ref());
                let again = to_fit.zip(from_fit).and_then(|(to_fit, from_fit)| {
                    let mut z = to_fit.z.clone();
                    z[..n_base].copy_from_slice(&from_fit.z[..n_base]);
                    refit(&plain, &to_fit.structure, &z, to_fit, &self.settings.fit)
                });
                (*to, again)
            })
            .collect();
        for (to, again) in found {
            let old = fits[to].take();
            fits[to] = best([old, again]);
        }
        fits
    }

    /// Posterior odds required for a name, as twice their logarithm.
    #[must_use]
    pub fn threshold(&self, stage: &SearchStage) -> f64 {
        self.needed(&stage.maxima)
    }

    fn needed(&self, maxima: &[f64]) -> f64 {
        let criteria = &self.settings.search;
        criteria
            .least_evidence
            .max(quantile(maxima, 1.0 - criteria.false_alarm))
    }

    /// Index of a term's first parameter in a fit that contains the term.
    #[must_use]
    pub fn offset(&self, fit: &Fit, term: usize) -> usize {
        let candidates = self.forward.candidates();
        let before = fit.structure.terms.iter().take_while(|t| **t != term);
        self.forward.base().len()
            + before
                .map(|t| candidates[*t].parameters.len())
                .sum::<usize>()
    }

    /// Whether the strength of a fitted term lies inside its range and is large enough for a name.
    #[must_use]
    pub fn plausible(&self, fit: &Fit, term: usize) -> bool {
        let candidate = &self.forward.candidates()[term];
        let strength = fit.values()[self.offset(fit, term)];
        let parameter = &candidate.parameters[0];
        let margin = 1e-3 * (parameter.upper - parameter.lower);
        let inside = (strength - parameter.lower > margin
            || (parameter.lower - candidate.off).abs() < margin)
            && (parameter.upper - strength > margin
                || (parameter.upper - candidate.off).abs() < margin);
        (strength - candidate.off).abs() >= candidate.smallest && inside
    }

    /// Whether a candidate may be named, both in its best fit and without a competitor.
    pub(crate) fn nameable(&self, with: &FitsByDiscrepancy, term: usize) -> bool {
        self.plausible(&with.best().1, term) && self.plausible(with.plain(), term)
    }

    /// Candidates ordered by their evidence averaged over the competitors on either side, frequency
    /// included, the best first.
    #[must_use]
    pub fn ranking(&self, stage: &SearchStage) -> Vec<(usize, f64)> {
        let candidates = self.forward.candidates();
        let mut list: Vec<(usize, f64)> = (0..stage.with.len())
            .filter_map(|term| Some((term, stage.robust_gain(term)? + candidates[term].log_prior)))
            .collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        list
    }

    /// Whether the evidence for an effect, its prior odds included, suffices for a name.
    ///
    /// - `plain`: evidence without competitors on either side, which noise alone must not give
    /// - `robust`: evidence averaged over the competitors on either side
    /// - `needed`: posterior odds that the plain evidence requires, as twice their logarithm
    #[must_use]
    pub fn enough(&self, prior: f64, (plain, robust): (f64, f64), needed: f64) -> bool {
        plain + prior >= needed && robust + prior >= self.settings.search.least_evidence
    }

    /// Twice the logarithm of an effect's prior odds.
    #[must_use]
    pub fn prior(&self, term: usize) -> f64 {
        self.forward.candidates()[term].log_prior
    }

    /// Posterior odds of a candidate without competitors on either side, as twice their logarithm.
    #[must_use]
    pub fn odds(&self, stage: &SearchStage, term: usize) -> Option<f64> {
        Some(stage.gain(term)? + self.forward.candidates()[term].log_prior)
    }

    /// Candidate with the best evidence without competitors that may be named and is worth a look,
    /// frequency included.
    #[must_use]
    pub fn promising(&self, stage: &SearchStage) -> Option<usize> {
        let least = self.settings.search.least_evidence;
        (0..stage.with.len())
            .filter_map(|term| Some((term, self.odds(stage, term)?)))
            .filter(|(term, odds)| {
                let with = stage.with[*term].as_ref();
                *odds >= least && with.is_some_and(|with| self.nameable(with, *term))
            })
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(term, _)| term)
    }

    /// Best candidate that may be named; `None` if its evidence does not suffice.
    #[must_use]
    pub fn next(&self, stage: &SearchStage) -> Option<usize> {
        let threshold = self.threshold(stage);
        (self.ranking(stage).into_iter().map(|(term, _)| term))
            .filter_map(|term| Some((term, stage.with[term].as_ref()?)))
            .find(|(term, with)| self.nameable(with, *term))
            .filter(|(term, _)| {
                let gains = stage.gain(*term).zip(stage.robust_gain(*term));
                gains.is_some_and(|gains| self.enough(self.prior(*term), gains, threshold))
            })
            .map(|(term, _)| term)
    }
}

/// Best candidates without a competitor, and best candidates next to the best competitor, among the
/// hopeful ones.
fn short_list(hopeful: &[usize], fits: &[Option<Fit>], beside: &[Option<Fit>]) -> Vec<usize> {
    let mut list = Vec::new();
    for found in [fits, beside] {
        let mut order: Vec<(usize, f64)> = (hopeful.iter())
            .filter_map(|t| Some((*t, found[*t].as_ref()?.neg2_log_evidence)))
            .collect();
        order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        list.extend(order.into_iter().take(SHORT_LIST).map(|(t, _)| t));
    }
    list.sort_unstable();
    list.dedup();
    list
}
