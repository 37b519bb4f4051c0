//! Classes of effects within which the data do not decide.
//!
//! A name needs odds against the model without the effect. Whether the data also prefer it to another
//! candidate is a question of its own: where the odds between two are below those of a name, the answer
//! is both. Effects that only together reach the odds of a name are an answer, too.

use crate::discrepancy::sum_of_odds;
use crate::moves::Loss;
use crate::ranked::probability;
use crate::stage::{Search, SearchStage};
use cardiotwin_vocabulary::findings::EffectClass;

impl Search<'_> {
    /// The classes of the accepted effects, or the class that suffices where none was accepted.
    pub(crate) fn classes(&self, stages: &[SearchStage], losses: &[Loss]) -> Vec<EffectClass> {
        if losses.is_empty() {
            return self.sufficient_together(&stages[0]).into_iter().collect();
        }
        let accepted: Vec<usize> = losses.iter().map(|loss| loss.term).collect();
        (accepted.iter())
            .filter_map(|term| {
                let stage = SearchStage::lacking(stages, *term);
                let alike = self.alike(stage, *term, &accepted);
                (alike.len() > 1).then(|| self.class(stage, &alike))
            })
            .collect()
    }

    /// A candidate and those that the data hardly reject against it: that may be named, and whose odds
    /// are less than those of a name behind.
    fn alike(&self, stage: &SearchStage, first: usize, taken: &[usize]) -> Vec<usize> {
        let ranking = self.ranking(stage);
        let odds = |term: usize| Some(ranking.iter().find(|(t, _)| *t == term)?.1);
        let mut alike = vec![first];
        if let Some(own) = odds(first) {
            let least = own - self.settings.search.least_evidence;
            alike.extend((ranking.iter().map(|(term, _)| *term)).filter(|term| {
                let may_be_named =
                    (stage.with[*term].as_ref()).is_some_and(|with| self.nameable(with, *term));
                let is_close = odds(*term).is_some_and(|odds| odds > least);
                let is_seen = self.odds(stage, *term).is_some_and(|odds| odds > 0.0);
                *term != first && !taken.contains(term) && may_be_named && is_close && is_seen
            }));
        }
        alike
    }

    /// Effects of which none has the odds of a name, but all together have.
    fn sufficient_together(&self, stage: &SearchStage) -> Option<EffectClass> {
        let alike = self.alike(stage, self.promising(stage)?, &[]);
        let plain = (alike.iter()).filter_map(|term| self.odds(stage, *term));
        let robust =
            (alike.iter()).filter_map(|term| Some(stage.robust_gain(*term)? + self.prior(*term)));
        let odds = (sum_of_odds(plain), sum_of_odds(robust));
        (alike.len() > 1 && self.enough(0.0, odds, self.threshold(stage)))
            .then(|| self.class(stage, &alike))
    }

    fn class(&self, stage: &SearchStage, terms: &[usize]) -> EffectClass {
        let candidates = self.forward.candidates();
        EffectClass {
            effects: (terms.iter())
                .map(|term| candidates[*term].name.clone())
                .collect(),
            probability: (terms.iter())
                .map(|term| probability(self, stage, *term))
                .sum(),
        }
    }
}
