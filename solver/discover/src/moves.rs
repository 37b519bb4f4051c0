//! Exchange and removal of accepted effects.

use crate::discrepancy::{DiscrepancyTerm, FitsByDiscrepancy, fit_by_discrepancy};
use crate::fit::Fit;
use crate::search::{add_term, refit};
use crate::stage::{BARE_MENTION, Search, SearchStage};
use rayon::prelude::*;

/// An accepted effect and the loss without it.
#[derive(Debug, Clone)]
pub struct Loss {
    /// Index of the effect.
    pub term: usize,
    /// Loss of evidence without the effect, no competitor on either side.
    pub plain: f64,
    /// Rise of the deviance without the effect, no competitor on either side.
    pub deviance: f64,
    /// Loss of evidence with the best competitor on either side.
    pub robust: f64,
    /// The structure without the effect.
    pub without: FitsByDiscrepancy,
}

/// Whether two fits have the same effects, in any order.
#[must_use]
pub fn same_terms(a: &Fit, b: &Fit) -> bool {
    let (mut a, mut b) = (a.structure.terms.clone(), b.structure.terms.clone());
    a.sort_unstable();
    b.sort_unstable();
    a == b
}

impl Search<'_> {
    /// Refits a structure after removal of one of its terms.
    fn without(&self, kind: DiscrepancyTerm, current: &Fit, term: usize) -> Option<Fit> {
        let at = self.offset(current, term);
        let mut z = current.z.clone();
        z.drain(at..at + self.forward.candidates()[term].parameters.len());
        let mut structure = current.structure.clone();
        structure.terms.retain(|t| *t != term);
        refit(
            &self.views.problem(self.forward, kind),
            &structure,
            &z,
            current,
            &self.settings.fit,
        )
    }

    /// The structure without one of its terms, with all competitors. It takes the better of a refit
    /// from `current` and an earlier fit in `levels`.
    #[must_use]
    pub fn lacking(
        &self,
        current: &FitsByDiscrepancy,
        term: usize,
        stages: &[SearchStage],
    ) -> Option<FitsByDiscrepancy> {
        let found: Vec<(DiscrepancyTerm, Option<Fit>)> = current
            .fits
            .par_iter()
            .map(|(kind, fit)| (*kind, self.without(*kind, fit, term)))
            .collect();
        let fits: Vec<(DiscrepancyTerm, Fit)> = found
            .into_iter()
            .filter_map(|(kind, fit)| Some((kind, fit?)))
            .collect();
        if fits
            .first()
            .is_none_or(|(kind, _)| *kind != DiscrepancyTerm::Nothing)
        {
            return None;
        }
        let mut without = FitsByDiscrepancy { fits };
        for stage in stages {
            if same_terms(stage.own.plain(), without.plain()) {
                without.improve(&stage.own);
                let missing = (stage.own.fits.iter()).filter(|(kind, _)| {
                    *kind != DiscrepancyTerm::Unnamed(term) && without.with(*kind).is_none()
                });
                let missing: Vec<_> = missing.cloned().collect();
                without.fits.extend(missing);
            }
        }
        Some(without)
    }

    /// Fits a structure with all competitors.
    #[must_use]
    pub fn with_discrepancies(&self, fit: Fit, kinds: &[DiscrepancyTerm]) -> FitsByDiscrepancy {
        fit_by_discrepancy(
            self.views,
            self.forward,
            FitsByDiscrepancy {
                fits: vec![(DiscrepancyTerm::Nothing, fit)],
            },
            kinds,
            &self.settings.fit,
        )
    }

    /// Losses without each effect, the largest first.
    #[must_use]
    pub fn losses(&self, current: &FitsByDiscrepancy, stages: &[SearchStage]) -> Vec<Loss> {
        let fit = current.plain();
        let mut list: Vec<Loss> = (fit.structure.terms.iter())
            .filter_map(|term| {
                let without = self.lacking(current, *term, stages)?;
                Some(Loss {
                    term: *term,
                    plain: without.plain().neg2_log_evidence - fit.neg2_log_evidence,
                    deviance: without.plain().deviance - fit.deviance,
                    robust: without.neg2_log_evidence() - current.neg2_log_evidence(),
                    without,
                })
            })
            .collect();
        list.sort_by(|a, b| b.robust.total_cmp(&a.robust).then(a.term.cmp(&b.term)));
        list
    }

    /// Best structure with one of `alternatives` in place of an accepted effect; `None` if it is
    /// not better than `current`.
    #[must_use]
    pub fn exchanged(
        &self,
        current: &FitsByDiscrepancy,
        alternatives: &[usize],
        unnamed: &[DiscrepancyTerm],
    ) -> Option<FitsByDiscrepancy> {
        let candidates = self.forward.candidates();
        let mut kinds = self.views.kinds();
        kinds.extend(unnamed);
        let fit = current.plain();
        let mut better: Option<(f64, FitsByDiscrepancy)> = None;
        for term in &fit.structure.terms {
            let Some(without) = self.without(DiscrepancyTerm::Nothing, fit, *term) else {
                continue;
            };
            for other in alternatives
                .iter()
                .filter(|t| !fit.structure.terms.contains(t))
            {
                let Some(with) = add_term(&self.plain(), &without, *other, &self.settings.fit)
                else {
                    continue;
                };
                let prior = candidates[*other].log_prior - candidates[*term].log_prior;
                // Fits with competitors cost five times more, and are made only if they may matter.
                if with.neg2_log_evidence - prior > fit.neg2_log_evidence + 5.0 * BARE_MENTION
                    || !with
                        .structure
                        .terms
                        .iter()
                        .all(|t| self.plausible(&with, *t))
                {
                    continue;
                }
                let with = self.with_discrepancies(with, &kinds);
                let gain = current.neg2_log_evidence() - with.neg2_log_evidence() + prior;
                if gain
                    > better
                        .as_ref()
                        .map_or(0.5 * BARE_MENTION, |(gain, _)| *gain)
                {
                    better = Some((gain, with));
                }
            }
        }
        better.map(|(_, wide)| wide)
    }
}
