//! Search over structures: effects are added, exchanged and removed until the data support no
//! further change.

use crate::fit::Fit;
use crate::held_out::{HeldOut, held_out};
use crate::level::{Level, Search};
use crate::moves::{Loss, same_terms};
use crate::nameless::{Nameless, Wide};
use crate::search::RISE;

/// Number of the ranking's first candidates that are tried in place of an accepted effect.
const N_SWAPS: usize = 4;
/// Number of times that the search continues from the remaining structure after effects were
/// removed.
const RETURNS: usize = 2;
/// Ratio of the gap on held-out data with effects to the gap without them, above which the effects
/// count as fitted to chance.
const HELD_OUT_RISE: f64 = 1.02;

/// Result of the search over structures.
pub(crate) struct Found {
    /// One level per number of effects, the base first.
    pub levels: Vec<Level>,
    /// The final structure.
    pub current: Wide,
    /// Loss without each accepted effect, the largest first.
    pub losses: Vec<Loss>,
    /// Predictions for held-out data, without and with the effects.
    pub held_out: (Option<HeldOut>, Option<HeldOut>),
    /// Number of evaluations of levels that were abandoned.
    pub n_evaluations_left: usize,
}

/// Adds, exchanges and removes effects. The search continues from the remaining structure if that
/// is new or fits better than before.
pub(crate) fn find(search: &Search<'_>, base: &Fit) -> Found {
    let mut levels: Vec<Level> = Vec::new();
    let mut start = base.clone();
    let mut n_evaluations_left = 0;
    let mut returns = 0;
    loop {
        let grown = grow(search, &mut levels, start);
        let Pruned {
            left,
            losses,
            held_out,
        } = prune(search, &levels, grown);
        let n_terms = left.plain().structure.terms.len();
        let known = levels
            .iter()
            .find(|level| same_terms(level.wide.plain(), left.plain()));
        let dropped = levels
            .last()
            .is_some_and(|level| level.wide.plain().structure.terms.len() > n_terms);
        let better =
            known.is_none_or(|level| left.plain().deviance < level.wide.plain().deviance - RISE);
        if !dropped || !better || returns == RETURNS {
            return Found {
                levels,
                current: left,
                losses,
                held_out,
                n_evaluations_left,
            };
        }
        n_evaluations_left += levels
            .drain(n_terms..)
            .map(|level| level.n_evaluations())
            .sum::<usize>();
        start = left.plain().clone();
        returns += 1;
    }
}

/// Adds and exchanges effects as long as the data support it, with one level per number of effects.
fn grow(search: &Search<'_>, levels: &mut Vec<Level>, start: Fit) -> Wide {
    let mut current = Wide {
        fits: vec![(Nameless::Nothing, start)],
    };
    let mut unnamed: Vec<Nameless> = levels.iter().flat_map(Level::unnamed).collect();
    loop {
        let level = search.level(current.plain(), levels.len() as u64);
        unnamed.extend(level.unnamed());
        unnamed.dedup();
        current = level.wide.clone();
        let n_terms = current.plain().structure.terms.len();
        let next = search
            .next(&level)
            .filter(|_| n_terms < search.settings.max_effects);
        let next = next.and_then(|term| level.with[term].clone());
        levels.push(level);
        let Some(next) = next else { return current };
        current = next;
        if n_terms > 0 {
            let alternatives: Vec<usize> = search
                .ranking(&levels[0])
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

/// A structure from which nothing can be removed.
struct Pruned {
    left: Wide,
    losses: Vec<Loss>,
    held_out: (Option<HeldOut>, Option<HeldOut>),
}

/// Removes effects, the least important first, that the data no longer support or that held-out
/// data do not confirm. A later effect may have replaced an earlier one.
fn prune(search: &Search<'_>, levels: &[Level], mut current: Wide) -> Pruned {
    let threshold = search.threshold(&levels[0]);
    let predict = |fit: &Fit| held_out(&search.plain(), fit, &search.settings.fit);
    let mut before = None;
    loop {
        let mut losses = search.losses(&current, levels);
        let kept = |loss: &Loss| {
            let nameless = loss.without.plain().evidence - loss.without.evidence();
            let needed = search.needed(current.plain(), loss.term, threshold);
            Search::enough((loss.plain, loss.robust, nameless), needed)
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
            .get_or_insert_with(|| predict(levels[0].wide.plain()))
            .clone();
        let with = predict(current.plain());
        let confirmed = with
            .as_ref()
            .zip(without.as_ref())
            .is_none_or(|(a, b)| a.gap <= HELD_OUT_RISE * b.gap);
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
