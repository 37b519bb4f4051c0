//! Decision of the search: which effects are missing, if any, and whether they have a name.

use crate::bootstrap::p_value;
use crate::calibration::Calibration;
use crate::confusion::{confusables, rivals};
use crate::deciding::{Rival, SEPARABLE};
use crate::discrepancy::{FitsByDiscrepancy, Views};
use crate::fit::Fit;
use crate::forward::Forward;
use crate::held_out::{HeldOut, gap};
use crate::locate::locate;
use crate::measured::{Measured, MeasuredError};
use crate::ranked::{not_identifiable, ranked_effects};
use crate::result::Discovery;
use crate::search::fit_base;
use crate::series::Tabulated;
use crate::settings::Settings;
use crate::stage::{Search, SearchStage};
use crate::stepwise::{Found, find};
use crate::unexplained::nameless_gap;
use cardiotwin_vocabulary::findings::{Confusable, Findings};
use std::collections::BTreeMap;

/// Evidence from which a gap without a name is reported instead of a name: "very strong" (Kass and
/// Raftery 1995).
const CLEAR_GAP: f64 = 10.0;

/// Reasons why a search gives no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DiscoverError {
    /// The measured data are invalid.
    #[error(transparent)]
    Measured(#[from] MeasuredError),
    /// A requested candidate is not in the catalogue.
    #[error("unknown effect {found}, expected one of {known}")]
    UnknownEffect {
        /// Name that was requested.
        found: String,
        /// Names of the catalogue.
        known: String,
    },
    /// No start of the base fit gave a periodic beat.
    #[error(
        "the base model has no periodic beat at any start of its fit; check cycle length, pressure and volume"
    )]
    NoBaseFit,
}

/// Finds the effects that explain the difference between a patient's data and a model.
///
/// # Errors
/// [`DiscoverError`] if the data are invalid, a candidate is unknown, or the base model has no beat
/// at any start.
pub fn discover(
    measured: &Measured,
    forward: &dyn Forward,
    settings: &Settings,
) -> Result<Discovery, DiscoverError> {
    measured.validate()?;
    let candidates = forward.candidates();
    let among = chosen(forward, &settings.search.effects)?;
    let views = Views::new(measured, &settings.error_model, &settings.learnt);
    let data = &views.plain;
    let search = Search {
        views: &views,
        forward,
        settings,
        among,
    };
    let problem = search.plain();
    let base = fit_base(&problem, &settings.fit).ok_or(DiscoverError::NoBaseFit)?;
    let Found {
        stages,
        current,
        losses,
        held_out: (held_before, held_after),
        n_evaluations_left,
    } = find(&search, &base);
    let left = current.unhealthy();
    let current = current.plain().clone();
    let base = if losses.is_empty() {
        current.clone()
    } else {
        stages[0].own.plain().clone()
    };
    let unhealthy = stages[0].own.unhealthy();
    let accepted: Vec<usize> = losses.iter().map(|loss| loss.term).collect();
    let beat_of =
        |fit: &Fit| problem.predict(&fit.structure, &fit.values(), Some(&fit.minimum.warm));
    let (before, after) = (
        beat_of(&base).ok_or(DiscoverError::NoBaseFit)?,
        beat_of(&current).ok_or(DiscoverError::NoBaseFit)?,
    );
    // Traces are compared as measured, with small calibration errors included.
    let calibration = Calibration::of(data, &after);
    let (seen_before, seen_after) = (
        Calibration::of(data, &before).apply(&before),
        calibration.apply(&after),
    );
    let n_evaluations = base.n_evaluations
        + n_evaluations_left
        + stages.iter().map(SearchStage::n_evaluations).sum::<usize>()
        + losses
            .iter()
            .flat_map(|l| &l.without.fits)
            .map(|(_, f)| f.n_evaluations)
            .sum::<usize>();
    let effects = ranked_effects(&search, &stages, &current, &losses);
    let mut confusable: Vec<Rival> = Vec::new();
    let plain_of =
        |with: &Option<FitsByDiscrepancy>| with.as_ref().map(|wide| wide.plain().clone());
    let known: Vec<Option<Fit>> = stages[accepted.len().saturating_sub(1).min(stages.len() - 1)]
        .with
        .iter()
        .map(plain_of)
        .collect();
    for term in &accepted {
        let ranked: Vec<usize> = search.ranking(&stages[0]).iter().map(|(t, _)| *t).collect();
        let list: Vec<usize> = rivals(candidates, *term, &ranked, 3, &accepted)
            .into_iter()
            .filter(|t| search.among.contains(t))
            .collect();
        confusable.extend(confusables(
            &problem,
            &current,
            *term,
            &list,
            &known,
            &settings.fit,
        ));
    }
    confusable.retain(|rival| rival.confusable.expected_misfit < SEPARABLE);
    let deciding = search.deciding(
        &stages[0],
        (!accepted.is_empty()).then_some(&confusable[..]),
    );
    let confusable: Vec<Confusable> = confusable
        .into_iter()
        .map(|rival| rival.confusable)
        .collect();

    let threshold = search.threshold(&stages[0]);
    let classes = search.classes(&stages, &losses);
    let is_unexplained = losses.is_empty() && unhealthy.1 >= threshold.max(CLEAR_GAP);
    let unexplained =
        (is_unexplained && classes.is_empty()).then(|| nameless_gap(&problem, &before, unhealthy));
    let remaining = (!is_unexplained && left.1 >= settings.search.least_evidence)
        .then(|| nameless_gap(&problem, &after, left));
    let best_odds = (0..candidates.len())
        .filter_map(|term| search.odds(&stages[0], term))
        .fold(0.0, f64::max);
    let Tabulated {
        phases,
        gaps,
        series,
    } = Tabulated::of(
        data,
        &seen_before,
        &seen_after,
        held_before.as_ref(),
        held_after.as_ref(),
    );
    let held_out_gap =
        |held: &Option<HeldOut>| held.as_ref().map(|h| h.gap).filter(|gap| gap.is_finite());
    let not_identifiable = not_identifiable(&search, &stages[0], &accepted);
    let findings = Findings {
        none: accepted.is_empty(),
        effects,
        accepted: accepted
            .iter()
            .map(|t| candidates[*t].name.clone())
            .collect(),
        confusable: distinct(confusable.iter().map(|c| &c.rival)),
        confusable_with: confusable,
        classes,
        deciding_measurement: deciding,
        not_identifiable: distinct(not_identifiable.iter().map(|n| &n.name)),
        not_identifiable_without: not_identifiable,
        unexplained,
        remaining,
        gap_before: gap(&problem, &seen_before),
        gap_after: gap(&problem, &seen_after),
        gap_heldout_before: held_out_gap(&held_before),
        gap_heldout_after: held_out_gap(&held_after),
        p_value: p_value(&stages[0].maxima, best_odds),
        threshold,
        nameless_evidence: unhealthy.1,
        places: locate(&problem, &before),
        where_after: locate(&problem, &after),
        gaps,
    };
    Ok(Discovery {
        findings,
        base: base_values(forward, &current),
        base_before: base_values(forward, &base),
        calibration,
        noise_seen_over_stated: data.levels.seen_over_stated,
        n_evaluations: n_evaluations as u64,
        phases,
        series,
        beats: [before, after],
    })
}

/// Names without repetitions, in the order of their first occurrence.
fn distinct<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    for name in names {
        if !list.contains(name) {
            list.push(name.clone());
        }
    }
    list
}

fn base_values(forward: &dyn Forward, fit: &Fit) -> BTreeMap<String, f64> {
    forward
        .base()
        .iter()
        .zip(fit.values())
        .map(|(p, value)| (p.name.clone(), value))
        .collect()
}

/// Indices of the requested candidates.
fn chosen(forward: &dyn Forward, names: &[String]) -> Result<Vec<usize>, DiscoverError> {
    let candidates = forward.candidates();
    if names.is_empty() {
        return Ok((0..candidates.len()).collect());
    }
    let find = |name: &String| {
        candidates
            .iter()
            .position(|c| c.name == *name)
            .ok_or_else(|| DiscoverError::UnknownEffect {
                found: name.clone(),
                known: candidates
                    .iter()
                    .map(|c| c.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", "),
            })
    };
    names.iter().map(find).collect()
}
