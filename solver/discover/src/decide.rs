//! The decision: which effects are missing, if any, and whether they have a name.

use crate::bootstrap::{Tangent, null_maxima, p_value, quantile, tangents};
use crate::confusion::{SEPARABLE, confusables, rivals};
use crate::fit::Fit;
use crate::forward::Forward;
use crate::held_out::{gap, held_out};
use crate::least_squares::Settings as FitSettings;
use crate::locate::locate;
use crate::measured::{Measured, MeasuredError};
use crate::noise::Tolerance;
use crate::problem::{Data, Problem};
use crate::result::{Discovery, NotIdentifiable, RankedEffect, Unexplained};
use crate::search::{add_bumps, add_term, fit_base, refit, scan};
use crate::series::Series;
use crate::unexplained::depends_on;
use std::collections::BTreeMap;

/// Settings of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Of each fit.
    pub fit: FitSettings,
    /// What the model may miss without anything missing.
    pub tolerance: Tolerance,
    /// Least evidence, twice the logarithm of a Bayes factor, for a name: 6 is odds of 20 to 1 (Kass and Raftery 1995).
    pub least_evidence: f64,
    /// Probability of a name for data of the base model.
    pub false_alarm: f64,
    /// Draws of the bootstrap.
    pub n_bootstrap: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Most effects of one patient.
    pub max_effects: usize,
    /// Candidates by name; all when empty.
    pub effects: Vec<String>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            fit: FitSettings::default(),
            tolerance: Tolerance::default(),
            least_evidence: 6.0,
            false_alarm: 0.04,
            n_bootstrap: 2000,
            seed: 1,
            max_effects: 3,
            effects: Vec::new(),
        }
    }
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DiscoverError {
    /// Bad data.
    #[error(transparent)]
    Measured(#[from] MeasuredError),
    /// A candidate that the catalogue does not have.
    #[error("there is no effect {found}; there are {known}")]
    UnknownEffect {
        /// What was asked for.
        found: String,
        /// Names of the catalogue.
        known: String,
    },
    /// No start of the base fit gave a beat.
    #[error("the base model has no periodic beat at any start of its fit; check cycle length, pressure and volume")]
    NoBaseFit,
}

/// A typical strength that leaves less than this misfit cannot be shown.
const SHOWN: f64 = 6.0;
/// How much of the ranking is tried in the place of an accepted effect.
const N_SWAPS: usize = 4;

/// One level of the search: a structure, and what each candidate adds to it.
struct Level {
    fits: Vec<Option<Fit>>,
    tangents: Vec<Tangent>,
    maxima: Vec<f64>,
    bumps: Option<Fit>,
    /// Evidence for a smooth discrepancy of pressure and volume.
    discrepancy: f64,
}

impl Level {
    /// Evidence of the best nameless competitor for `current`.
    fn nameless(&self, current: &Fit) -> f64 {
        let bumps = self.bumps.as_ref().map_or(0.0, |fit| current.evidence - fit.evidence);
        bumps.max(self.discrepancy)
    }
}

struct Search<'a> {
    problem: &'a Problem<'a>,
    rough: &'a Problem<'a>,
    settings: &'a Settings,
    among: Vec<usize>,
}

impl Search<'_> {
    fn level(&self, current: &Fit, index: u64) -> Level {
        let fit = &self.settings.fit;
        let (fits, (bumps, discrepancy)) = rayon::join(
            || scan(self.problem, current, &self.among, fit),
            || rayon::join(|| add_bumps(self.problem, current, fit), || self.discrepancy(current)),
        );
        let tangents = tangents(self.problem, current, &self.among);
        let maxima = null_maxima(&tangents, self.settings.n_bootstrap, self.settings.seed ^ (index << 32));
        Level { fits, tangents, maxima, bumps, discrepancy }
    }

    /// Evidence for a smooth discrepancy beside `current`.
    fn discrepancy(&self, current: &Fit) -> f64 {
        let with = self.rough.fit(&current.structure, &current.z, Some(current), &self.settings.fit);
        with.map_or(0.0, |with| current.evidence - with.evidence)
    }

    fn threshold(&self, level: &Level) -> f64 {
        self.settings.least_evidence.max(quantile(&level.maxima, 1.0 - self.settings.false_alarm))
    }

    /// Strength and interval of a term of a fit, and whether it may be named.
    fn plausible(&self, fit: &Fit, term: usize) -> bool {
        let candidate = &self.problem.forward.candidates()[term];
        let strength = fit.values()[self.offset(fit, term)];
        let parameter = &candidate.parameters[0];
        let margin = 1e-3 * (parameter.upper - parameter.lower);
        let inside = (strength - parameter.lower > margin || (parameter.lower - candidate.off).abs() < margin)
            && (parameter.upper - strength > margin || (parameter.upper - candidate.off).abs() < margin);
        (strength - candidate.off).abs() >= candidate.smallest && inside
    }

    /// Position of a term's first parameter.
    fn offset(&self, fit: &Fit, term: usize) -> usize {
        let candidates = self.problem.forward.candidates();
        let before = fit.structure.terms.iter().take_while(|t| **t != term);
        self.problem.forward.base().len() + before.map(|t| candidates[*t].parameters.len()).sum::<usize>()
    }

    /// Candidates by evidence, best first.
    fn ranking(&self, current: &Fit, level: &Level) -> Vec<(usize, f64)> {
        let mut list: Vec<(usize, f64)> = (level.fits.iter().enumerate())
            .filter_map(|(term, fit)| fit.as_ref().map(|fit| (term, current.evidence - fit.evidence)))
            .collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        list
    }

    /// The best candidate that may be named, unless one that may not is clearly better.
    fn best(&self, current: &Fit, level: &Level) -> Option<(usize, f64)> {
        let ranking = self.ranking(current, level);
        let named =
            ranking.iter().find(|(term, _)| level.fits[*term].as_ref().is_some_and(|f| self.plausible(f, *term)))?;
        (ranking[0].1 - named.1 < self.settings.least_evidence).then_some(*named)
    }

    /// Tries others in the place of each accepted effect; returns a better fit if there is one.
    fn swap(&self, current: &Fit, alternatives: &[usize]) -> Option<Fit> {
        let mut better: Option<Fit> = None;
        for term in &current.structure.terms {
            let Some(without) = self.without(current, *term) else { continue };
            for other in alternatives.iter().filter(|t| !current.structure.terms.contains(t)) {
                let Some(with) = add_term(self.problem, &without, *other, &self.settings.fit) else { continue };
                let all = with.structure.terms.iter().all(|t| self.plausible(&with, *t));
                if all && with.evidence < better.as_ref().unwrap_or(current).evidence - 1.0 {
                    better = Some(with);
                }
            }
        }
        better
    }

    /// The fit without one of its terms.
    fn without(&self, current: &Fit, term: usize) -> Option<Fit> {
        let candidates = self.problem.forward.candidates();
        let at = self.offset(current, term);
        let mut z = current.z.clone();
        z.drain(at..at + candidates[term].parameters.len());
        let mut structure = current.structure.clone();
        structure.terms.retain(|t| *t != term);
        refit(self.problem, &structure, &z, current, &self.settings.fit)
    }
}

/// Finds what a patient's data miss in a model.
///
/// # Errors
/// [`DiscoverError`] for bad data, unknown candidates, or a model without an answer anywhere.
pub fn discover(measured: &Measured, forward: &dyn Forward, settings: &Settings) -> Result<Discovery, DiscoverError> {
    measured.validate()?;
    let candidates = forward.candidates();
    let among = chosen(forward, &settings.effects)?;
    let data = Data::new(measured.clone(), &settings.tolerance);
    let rough_data = Data::new(measured.clone(), &Tolerance::discrepancy());
    let problem = Problem { forward, data: &data };
    let rough = Problem { forward, data: &rough_data };
    let base = fit_base(&problem, &settings.fit).ok_or(DiscoverError::NoBaseFit)?;
    let search = Search { problem: &problem, rough: &rough, settings, among };

    let mut current = base.clone();
    let mut levels: Vec<Level> = Vec::new();
    let mut accepted_gain = Vec::new();
    let mut path = vec![base.clone()];
    loop {
        let level = search.level(&current, levels.len() as u64);
        let best = search.best(&current, &level).filter(|(_, gain)| *gain >= search.threshold(&level));
        let next = best.and_then(|(term, gain)| level.fits[term].clone().map(|fit| (fit, gain)));
        levels.push(level);
        let Some((fit, gain)) = next.filter(|_| current.structure.terms.len() < settings.max_effects) else { break };
        accepted_gain.push(gain);
        current = fit;
        if current.structure.terms.len() > 1 {
            let ranked = search.ranking(&base, &levels[0]);
            let alternatives: Vec<usize> = ranked.iter().take(N_SWAPS + 1).map(|(t, _)| *t).collect();
            if let Some(better) = search.swap(&current, &alternatives) {
                current = better;
            }
        }
        path.push(current.clone());
    }
    // Named is the longest part of the path that beats the nameless competitors of each of its steps: those of a step may
    // win over the next effect alone, as they stand for all that is still missing.
    let nameless = levels[0].nameless(&base);
    let beats = |n: usize| (0..n).all(|k| path[k].evidence - path[n].evidence >= levels[k].nameless(&path[k]));
    let named = (1..path.len()).rev().find(|n| beats(*n)).unwrap_or(0);
    current = path[named].clone();
    let last = &levels[named.min(levels.len() - 1)];
    let nameless_left = last.nameless(&current);
    let beat_of = |fit: &Fit| problem.predict(&fit.structure, &fit.values(), Some(&fit.minimum.warm));
    let (before, after) =
        (beat_of(&base).ok_or(DiscoverError::NoBaseFit)?, beat_of(&current).ok_or(DiscoverError::NoBaseFit)?);
    let accepted = ordered(&search, &current);
    let held_before = held_out(&problem, &base, &settings.fit);
    let held_after = if named == 0 { held_before.clone() } else { held_out(&problem, &current, &settings.fit) };

    let n_evaluations = base.n_evaluations
        + levels.iter().flat_map(|l| l.fits.iter().flatten()).map(|f| f.n_evaluations).sum::<usize>();
    let effects = ranked_effects(&search, &base, &levels, &path[..=named], &accepted);
    let mut confusable = Vec::new();
    for term in &accepted {
        let ranked: Vec<usize> = search.ranking(&base, &levels[0]).iter().map(|(t, _)| *t).collect();
        let list: Vec<usize> =
            rivals(candidates, *term, &ranked, 3, &accepted).into_iter().filter(|t| search.among.contains(t)).collect();
        confusable.extend(confusables(&problem, &current, *term, &list, &levels[named - 1].fits, &settings.fit));
    }
    confusable.retain(|c| c.expected_misfit < SEPARABLE);
    let mut deciding: Vec<String> = Vec::new();
    for c in &confusable {
        let of = |name: &str| candidates.iter().find(|k| k.name == name).map(|k| k.separated_by.clone());
        deciding.extend(of(&c.effect).into_iter().chain(of(&c.rival)).flatten());
    }
    let mut seen = std::collections::BTreeSet::new();
    deciding.retain(|d| seen.insert(d.clone()));

    let threshold = search.threshold(&levels[0]);
    let unexplained = (named == 0 && nameless >= threshold.max(10.0)).then(|| {
        let worst = locate(&problem, &before).into_iter().max_by(|a, b| a.share.total_cmp(&b.share));
        Unexplained {
            kind: if levels[0].discrepancy >= nameless { "discrepancy" } else { "activation" }.to_owned(),
            log_evidence: nameless_left,
            place: worst.expect("the table has rows"),
            depends_on: depends_on(&data, &before),
        }
    });
    let best_gain = search.ranking(&base, &levels[0]).first().map_or(0.0, |(_, gain)| *gain);
    Ok(Discovery {
        none: accepted.is_empty(),
        accepted: accepted.iter().map(|t| candidates[*t].name.clone()).collect(),
        effects,
        confusable,
        deciding_measurement: deciding,
        not_identifiable: not_identifiable(&search, &base, &levels[0], &accepted),
        unexplained,
        gap_before: gap(&problem, &before),
        gap_after: gap(&problem, &after),
        gap_heldout_before: held_before.as_ref().map_or(f64::NAN, |h| h.gap),
        gap_heldout_after: held_after.as_ref().map_or(f64::NAN, |h| h.gap),
        p_value: p_value(&levels[0].maxima, best_gain),
        threshold,
        nameless_evidence: nameless,
        base: base_values(forward, &current),
        base_before: base_values(forward, &base),
        located: locate(&problem, &before),
        located_after: locate(&problem, &after),
        noise_seen_over_stated: data.levels.seen_over_stated,
        n_evaluations,
        series: Series::of(&data, &before, &after, held_before.as_ref(), held_after.as_ref()),
    })
}

fn base_values(forward: &dyn Forward, fit: &Fit) -> BTreeMap<String, f64> {
    forward.base().iter().zip(fit.values()).map(|(p, value)| (p.name.clone(), value)).collect()
}

/// Positions of the candidates asked for.
fn chosen(forward: &dyn Forward, names: &[String]) -> Result<Vec<usize>, DiscoverError> {
    let candidates = forward.candidates();
    if names.is_empty() {
        return Ok((0..candidates.len()).collect());
    }
    let find = |name: &String| {
        candidates.iter().position(|c| c.name == *name).ok_or_else(|| DiscoverError::UnknownEffect {
            found: name.clone(),
            known: candidates.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", "),
        })
    };
    names.iter().map(find).collect()
}

/// Accepted terms, the one that would be missed most first.
fn ordered(search: &Search<'_>, current: &Fit) -> Vec<usize> {
    let terms = current.structure.terms.clone();
    if terms.len() < 2 {
        return terms;
    }
    let loss = |term: usize| search.without(current, term).map_or(f64::MAX, |fit| fit.evidence - current.evidence);
    let mut list: Vec<(usize, f64)> = terms.iter().map(|t| (*t, loss(*t))).collect();
    list.sort_by(|a, b| b.1.total_cmp(&a.1));
    list.into_iter().map(|(t, _)| t).collect()
}

/// Candidates with probabilities: accepted first, then the rest of the last level's ranking.
fn ranked_effects(
    search: &Search<'_>,
    base: &Fit,
    levels: &[Level],
    path: &[Fit],
    accepted: &[usize],
) -> Vec<RankedEffect> {
    let candidates = search.problem.forward.candidates();
    let ln_n = search.problem.data.n_effective().ln();
    let mut effects = Vec::new();
    let mut done = Vec::new();
    // Each accepted term at the level at which it, or what it took the place of, was added.
    let rows = accepted
        .iter()
        .map(|t| (*t, true))
        .chain(search.ranking(base, &levels[0]).into_iter().map(|(t, _)| (t, false)));
    for (term, is_accepted) in rows {
        if done.contains(&term) {
            continue;
        }
        done.push(term);
        let at = path[1..].iter().position(|fit| fit.structure.terms.contains(&term)).unwrap_or(0);
        let at = if is_accepted { at } else { 0 };
        let (before, level) = (&path[at], &levels[at]);
        let last = path.last().expect("the path begins with the base");
        let fit = if is_accepted { Some(last) } else { level.fits[term].as_ref() };
        let alone = level.fits[term].as_ref();
        let (Some(fit), Some(alone)) = (fit, alone.or(fit)) else { continue };
        let parameters = &candidates[term].parameters;
        let first = search.offset(fit, term);
        let (values, sd) = (fit.values(), fit.standard_deviations());
        let mut strength = BTreeMap::new();
        let mut interval = BTreeMap::new();
        for (i, p) in parameters.iter().enumerate() {
            let (value, half) = (values[first + i], 1.96 * sd[first + i]);
            strength.insert(p.name.clone(), value);
            interval.insert(p.name.clone(), [(value - half).max(p.lower), (value + half).min(p.upper)]);
        }
        let delta_deviance = before.deviance - alone.deviance;
        effects.push(RankedEffect {
            name: candidates[term].name.clone(),
            artefact: candidates[term].artefact,
            probability: probability(search, before, level, term),
            delta_bic: delta_deviance - parameters.len() as f64 * ln_n,
            log_evidence: before.evidence - alone.evidence,
            delta_deviance,
            strength,
            interval,
            plausible: search.plausible(fit, term),
        });
    }
    effects
}

/// Weight of a candidate among all of its level, the nameless ones and "nothing more"; tempered where even the best model
/// misses the data (Yang and Zhu 2018: weights of wrong models are too near to zero and one).
fn probability(search: &Search<'_>, before: &Fit, level: &Level, term: usize) -> f64 {
    let ranking = search.ranking(before, level);
    let data = search.problem.data;
    let n = (data.pressure.len() + data.volume.len()) as f64;
    let best = ranking.first().and_then(|(t, _)| level.fits[*t].as_ref()).unwrap_or(before);
    let excess = (best.misfit.pressure + best.misfit.volume) / n;
    let heat = 0.5 * (1.0 / excess).min(1.0);
    let nameless = level.nameless(before);
    let top = ranking.first().map_or(0.0, |(_, gain)| gain.max(nameless).max(0.0));
    let weight = |gain: f64| (heat * (gain - top)).exp();
    let sum: f64 = ranking.iter().map(|(_, gain)| weight(*gain)).sum::<f64>() + weight(nameless) + weight(0.0);
    ranking.iter().find(|(t, _)| *t == term).map_or(0.0, |(_, gain)| weight(*gain) / sum)
}

/// Candidates whose typical strength these data would not show.
fn not_identifiable(search: &Search<'_>, base: &Fit, level: &Level, accepted: &[usize]) -> Vec<NotIdentifiable> {
    let candidates = search.problem.forward.candidates();
    let mut list = Vec::new();
    for term in &search.among {
        let expected =
            level.tangents.iter().filter(|t| t.term == *term).map(Tangent::expected_misfit).fold(0.0, f64::max);
        let seen = level.fits[*term].as_ref().is_some_and(|fit| base.evidence - fit.evidence >= 0.5 * SHOWN);
        if expected < SHOWN && !seen && !accepted.contains(term) {
            let mut would_show = candidates[*term].separated_by.clone();
            would_show.extend(candidates[*term].hidden_because.clone());
            list.push(NotIdentifiable { name: candidates[*term].name.clone(), expected_misfit: expected, would_show });
        }
    }
    list
}
