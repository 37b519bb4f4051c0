//! Search over structures: effects are added, alone or two together, exchanged and removed until the
//! data support no further change.

use crate::discrepancy::{DiscrepancyTerm, FitsByDiscrepancy};
use crate::fit::Fit;
use crate::held_out::{HeldOut, held_out};
use crate::moves::{Loss, same_terms};
use crate::search::RISE;
use crate::stage::{Search, SearchStage};

/// Number of the ranking's first candidates that are tried in place of an accepted effect.
const N_SWAPS: usize = 4;
/// Number of times that the search continues from the remaining structure after effects were
/// removed.
const RETURNS: usize = 2;
/// Result of the search over structures.
pub(crate) struct Found {
    /// One stage per number of effects, the base first.
    pub stages: Vec<SearchStage>,
    /// Structure with which the search ended.
    pub current: FitsByDiscrepancy,
    /// Loss without each accepted effect, the largest first.
    pub losses: Vec<Loss>,
    /// Predictions for held-out data, without and with the effects.
    pub held_out: (Option<HeldOut>, Option<HeldOut>),
    /// Evaluations of stages that were left.
    pub n_evaluations_left: usize,
}

/// Adds, exchanges and removes effects. The search continues from the remaining structure if that
/// is new or fits better than before.
pub(crate) fn find(search: &Search<'_>, base: &Fit) -> Found {
    let mut stages: Vec<SearchStage> = Vec::new();
    let mut start = base.clone();
    let mut n_evaluations_left = 0;
    let mut returns = 0;
    loop {
        let grown = grow(search, &mut stages, start);
        let Pruned {
            left,
            losses,
            held_out,
        } = prune(search, &stages, grown);
        let n_terms = left.plain().structure.terms.len();
        let known = stages
            .iter()
            .position(|stage| same_terms(stage.own.plain(), left.plain()));
        let dropped = stages
            .last()
            .is_some_and(|stage| stage.own.plain().structure.terms.len() > n_terms);
        let better = known
            .map(|at| &stages[at].own)
            .is_none_or(|own| left.plain().deviance < own.plain().deviance - RISE);
        // A fit without an effect, from the optimum with it, may find what the stage missed.
        if let Some(at) = known {
            stages[at].own.improve(&left);
        }
        if !dropped || !better || returns == RETURNS {
            return Found {
                stages,
                current: left,
                losses,
                held_out,
                n_evaluations_left,
            };
        }
        n_evaluations_left += stages
            .drain(n_terms..)
            .map(|stage| stage.n_evaluations())
            .sum::<usize>();
        start = left.plain().clone();
        returns += 1;
    }
}

/// Adds effects to a fit, and exchanges them, as long as the data ask for more; one stage for each number of effects.
fn grow(search: &Search<'_>, stages: &mut Vec<SearchStage>, start: Fit) -> FitsByDiscrepancy {
    let mut current = FitsByDiscrepancy {
        fits: vec![(DiscrepancyTerm::Nothing, start)],
    };
    let mut unnamed: Vec<DiscrepancyTerm> = stages.iter().flat_map(SearchStage::unnamed).collect();
    loop {
        let stage = search.stage(&current, stages.len() as u64);
        unnamed.extend(stage.unnamed());
        unnamed.dedup();
        current = stage.own.clone();
        let n_terms = current.plain().structure.terms.len();
        let next = search
            .next(&stage)
            .filter(|_| n_terms < search.settings.search.max_effects as usize);
        let next = next.and_then(|term| stage.with[term].clone());
        let pair = match next {
            None if n_terms == 0 => pair(search, &stage),
            _ => None,
        };
        stages.push(stage);
        if let Some((beside, both)) = pair {
            unnamed.extend(beside.unnamed());
            stages.push(beside);
            current = both;
            continue;
        }
        let Some(next) = next else { return current };
        current = next;
        if n_terms > 0 {
            let alternatives: Vec<usize> = search
                .ranking(&stages[0])
                .iter()
                .take(N_SWAPS + 1)
                .map(|(term, _)| *term)
                .collect();
            current = search
                .exchanged(&current, &alternatives, &unnamed)
                .unwrap_or(current);
        }
    }
}

/// Two effects of which neither suffices alone: the stage with the more promising one, and the
/// structure with both.
fn pair(search: &Search<'_>, stage: &SearchStage) -> Option<(SearchStage, FitsByDiscrepancy)> {
    if search.settings.search.max_effects < 2 {
        return None;
    }
    let first = search.promising(stage)?;
    let beside = search.stage(stage.with[first].as_ref()?, 1);
    let second = search.next(&beside)?;
    let both = beside.with[second].clone()?;
    let prior = search.prior(first) + search.prior(second);
    let gains = (
        stage.own.plain().neg2_log_evidence - both.plain().neg2_log_evidence,
        stage.own.neg2_log_evidence() - both.neg2_log_evidence(),
    );
    (search.enough(prior, gains, search.threshold(stage))).then_some((beside, both))
}

/// A structure from which nothing can be removed.
struct Pruned {
    left: FitsByDiscrepancy,
    losses: Vec<Loss>,
    held_out: (Option<HeldOut>, Option<HeldOut>),
}

/// Removes effects, the least important first, that the data no longer support or that held-out
/// data do not confirm. A later effect may have replaced an earlier one.
fn prune(search: &Search<'_>, stages: &[SearchStage], mut current: FitsByDiscrepancy) -> Pruned {
    let threshold = search.threshold(&stages[0]);
    // One standard error of an rms of so many independent data.
    let rise = 1.0 + (2.0 * search.views.plain.n_effective()).sqrt().recip();
    let predict = |fit: &Fit| held_out(&search.plain(), fit, &search.settings.fit);
    let mut before = None;
    loop {
        let mut losses = search.losses(&current, stages);
        let kept = |loss: &Loss| {
            search.enough(
                search.prior(loss.term),
                (loss.plain, loss.robust),
                threshold,
            )
        };
        if let Some(at) = losses.iter().rposition(|loss| !kept(loss)) {
            current = losses.swap_remove(at).without;
            continue;
        }
        if losses.is_empty() {
            let held = predict(current.plain());
            return Pruned {
                left: current,
                losses,
                held_out: (held.clone(), held),
            };
        }
        let without = before
            .get_or_insert_with(|| predict(stages[0].own.plain()))
            .clone();
        let with = predict(current.plain());
        let confirmed = with
            .as_ref()
            .zip(without.as_ref())
            .is_none_or(|(a, b)| a.gap <= rise * b.gap);
        if confirmed {
            return Pruned {
                left: current,
                losses,
                held_out: (without, with),
            };
        }
        // The last entry has the smallest loss.
        current = losses.swap_remove(losses.len() - 1).without;
    }
}
