//! Ranking for the result: evidence, strength and probability of each candidate, and candidates
//! that the data cannot show.

use crate::bootstrap::Tangent;
use crate::fit::Fit;
use crate::moves::Loss;
use crate::stage::{Search, SearchStage};
use cardiotwin_vocabulary::findings::{NotIdentifiable, RankedEffect};
use std::collections::BTreeMap;

/// Misfit below which a typical strength cannot be shown.
const SHOWN: f64 = 6.0;

/// Rows of all candidates: first the accepted ones as fitted together, the largest loss first; then
/// the others by evidence, each added to the base alone, those first whose strength may get a name.
pub(crate) fn ranked_effects(
    search: &Search<'_>,
    stages: &[SearchStage],
    current: &Fit,
    losses: &[Loss],
) -> Vec<RankedEffect> {
    let candidates = search.forward.candidates();
    let ln_n = search.views.plain.n_effective().ln();
    let row = |term: usize,
               fit: &Fit,
               (delta_deviance, plain, robust): (f64, f64, f64),
               probability: f64| {
        let parameters = &candidates[term].parameters;
        let first = search.offset(fit, term);
        let (values, sd) = (fit.values(), fit.standard_deviations());
        let mut strength = BTreeMap::new();
        let mut interval = BTreeMap::new();
        for (i, p) in parameters.iter().enumerate() {
            let (value, half) = (values[first + i], 1.96 * sd[first + i]);
            strength.insert(p.name.clone(), value);
            interval.insert(
                p.name.clone(),
                [(value - half).max(p.lower), (value + half).min(p.upper)],
            );
        }
        RankedEffect {
            name: candidates[term].name.clone(),
            meaning: candidates[term].meaning.clone(),
            artefact: candidates[term].artefact,
            probability,
            delta_bic: delta_deviance - parameters.len() as f64 * ln_n,
            log_evidence: plain,
            robust_evidence: robust,
            delta_deviance,
            strength,
            interval,
            plausible: search.plausible(fit, term),
            in_3d: candidates[term].in_3d.clone(),
            remedy: candidates[term].remedy.clone(),
        }
    };
    let mut effects: Vec<RankedEffect> = Vec::new();
    for loss in losses {
        let stage = SearchStage::lacking(stages, loss.term);
        let probability = probability(search, stage, loss.term);
        effects.push(row(
            loss.term,
            current,
            (loss.deviance, loss.plain, loss.robust),
            probability,
        ));
    }
    let stage = &stages[0];
    for (term, _) in search.ranking(stage) {
        if losses.iter().any(|loss| loss.term == term) {
            continue;
        }
        let (Some(with), Some(plain), Some(robust)) =
            (&stage.with[term], stage.gain(term), stage.robust_gain(term))
        else {
            continue;
        };
        let delta_deviance = stage.own.plain().deviance - with.plain().deviance;
        effects.push(row(
            term,
            with.plain(),
            (delta_deviance, plain, robust),
            probability(search, stage, term),
        ));
    }
    effects[losses.len()..].sort_by_key(|effect| !effect.plausible);
    effects
}

/// Weight of a candidate among all of its stage and "nothing more", nameless competitors averaged; tempered where even the best model
/// misses the data (Yang and Zhu 2018: weights of wrong models are too near to zero and one).
pub(crate) fn probability(search: &Search<'_>, stage: &SearchStage, term: usize) -> f64 {
    let ranking = search.ranking(stage);
    let data = &search.views.plain;
    let n = (data.pressure.len() + data.volume.len()) as f64;
    let best = ranking
        .first()
        .and_then(|(t, _)| stage.with[*t].as_ref())
        .unwrap_or(&stage.own)
        .plain();
    let excess = (best.misfit.pressure + best.misfit.volume) / n;
    let heat = 0.5 * (1.0 / excess).min(1.0);
    let top = ranking.first().map_or(0.0, |(_, gain)| gain.max(0.0));
    let weight = |gain: f64| (heat * (gain - top)).exp();
    let sum: f64 = ranking.iter().map(|(_, gain)| weight(*gain)).sum::<f64>() + weight(0.0);
    ranking
        .iter()
        .find(|(t, _)| *t == term)
        .map_or(0.0, |(_, gain)| weight(*gain) / sum)
}

/// Candidates whose typical strength would not show in these data.
pub(crate) fn not_identifiable(
    search: &Search<'_>,
    stage: &SearchStage,
    accepted: &[usize],
) -> Vec<NotIdentifiable> {
    let candidates = search.forward.candidates();
    let mut list = Vec::new();
    for term in &search.among {
        let expected = stage
            .tangents
            .iter()
            .filter(|t| t.term == *term)
            .map(Tangent::expected_misfit)
            .fold(0.0, f64::max);
        let seen = stage.gain(*term).is_some_and(|gain| gain >= 0.5 * SHOWN);
        if expected < SHOWN && !seen && !accepted.contains(term) {
            let mut would_show = candidates[*term].separated_by.clone();
            would_show.extend(candidates[*term].hidden_because.clone());
            list.push(NotIdentifiable {
                name: candidates[*term].name.clone(),
                expected_misfit: expected,
                would_show,
            });
        }
    }
    list
}
