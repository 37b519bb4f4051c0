//! Search over structures: effects are added, alone or two together, exchanged and removed until the
//! data support no further change.

use crate::discrepancy::{DiscrepancyTerm, FitsByDiscrepancy};
use crate::fit::Fit;
use crate::held_out::{HeldOut, held_out};
use crate::moves::{Loss, same_terms};
use crate::search::RISE;
use crate::stage::{Search, SearchStage};
use cardiotwin_vocabulary::findings::is_confirmed;

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
    /// Effects that were taken out because held-out data do not confirm them.
    pub unconfirmed: Vec<Doubted>,
    /// Evaluations of stages that were left.
    pub n_evaluations_left: usize,
}

/// An effect that held-out data do not confirm, with their gap without and with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Doubted {
    /// Index of the effect.
    pub term: usize,
    /// Gap on held-out data without the effect.
    pub without: f64,
    /// Gap on held-out data with the effect.
    pub with: f64,
}

/// Adds, exchanges and removes effects. The search continues from the remaining structure if that
/// is new or fits better than before.
pub(crate) fn find(search: &Search<'_>, base: &Fit) -> Found {
    let mut stages: Vec<SearchStage> = Vec::new();
    let mut start = base.clone();
    let mut n_evaluations_left = 0;
    let mut returns = 0;
    let mut doubted: Vec<Doubted> = Vec::new();
    loop {
        let grown = grow(search, &mut stages, start);
        let Pruned {
            left,
            losses,
            held_out,
            unconfirmed,
        } = prune(search, &stages, grown);
        doubted.retain(|one| unconfirmed.iter().all(|new| new.term != one.term));
        doubted.extend(unconfirmed);
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
            // Confirmed beside other effects, it is none that is doubted.
            doubted.retain(|one| losses.iter().all(|loss| loss.term != one.term));
            return Found {
                stages,
                current: left,
                losses,
                held_out,
                unconfirmed: doubted,
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
    let candidates = search.forward.candidates();
    let prior = candidates[first].log_prior + candidates[second].log_prior;
    let of = |own: f64, with: f64| own - with + prior;
    let plain = of(
        stage.own.plain().neg2_log_evidence,
        both.plain().neg2_log_evidence,
    );
    let robust = of(stage.own.neg2_log_evidence(), both.neg2_log_evidence());
    (plain.min(robust) >= search.threshold(stage)).then_some((beside, both))
}

/// A structure from which nothing can be removed.
struct Pruned {
    left: FitsByDiscrepancy,
    losses: Vec<Loss>,
    held_out: (Option<HeldOut>, Option<HeldOut>),
    unconfirmed: Vec<Doubted>,
}

/// Removes effects, the least important first, that the data no longer support or that held-out
/// data do not confirm: their gap must fall with the effect. A later effect may have replaced an earlier one.
fn prune(search: &Search<'_>, stages: &[SearchStage], mut current: FitsByDiscrepancy) -> Pruned {
    let threshold = search.threshold(&stages[0]);
    let predict = |fit: &Fit| held_out(&search.plain(), fit, &search.settings.fit);
    let mut before = None;
    let mut unconfirmed = Vec::new();
    loop {
        let mut losses = search.losses(&current, stages);
        let kept = |loss: &Loss| search.enough(loss.term, (loss.plain, loss.robust), threshold);
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
                unconfirmed,
            };
        }
        let without = before
            .get_or_insert_with(|| predict(stages[0].own.plain()))
            .clone();
        let with = predict(current.plain());
        // Each effect is compared with the structure that lacks it: the others may confirm themselves.
        let alone = losses.len() == 1;
        let doubt = |(at, loss): (usize, &Loss)| {
            let lacking = match alone {
                true => without.as_ref()?.gap,
                false => predict(loss.without.plain())?.gap,
            };
            let with = with.as_ref()?.gap;
            let doubted = Doubted {
                term: loss.term,
                without: lacking,
                with,
            };
            (!is_confirmed(lacking, with)).then_some((at, doubted))
        };
        // The last entry has the smallest loss.
        let Some((at, doubted)) = losses.iter().enumerate().rev().find_map(doubt) else {
            return Pruned {
                left: current,
                losses,
                held_out: (without, with),
                unconfirmed,
            };
        };
        unconfirmed.push(doubted);
        current = losses.swap_remove(at).without;
    }
}
