//! Effects that cannot be distinguished from an accepted one in this case: rivals are fitted to its
//! noise-free output.

use crate::deciding::{Rival, SEPARABLE, separations};
use crate::fit::Fit;
use crate::forward::Candidate;
use crate::least_squares::Settings;
use crate::problem::{Data, Problem};
use crate::search::best;
use cardiotwin_vocabulary::findings::Confusable;
use rayon::prelude::*;

/// Data that the fitted model would give without noise.
fn noise_free(problem: &Problem<'_>, fit: &Fit) -> Option<Data> {
    let beat = problem.predict(&fit.structure, &fit.values(), Some(&fit.minimum.warm))?;
    let mut data = problem.data.clone();
    let sample = |times: &[f64], trace: &[f64]| times.iter().map(|t| beat.at(trace, *t)).collect();
    data.pressure = data
        .pressure
        .with_values(sample(&data.pressure.time_ms, &beat.pressure_mmhg));
    data.volume = data
        .volume
        .with_values(sample(&data.volume.time_ms, &beat.volume_ml));
    let side = &mut data.measured.side;
    if let Some(cuff) = &mut side.cuff {
        cuff.systolic.value = beat.systolic_mmhg;
        cuff.diastolic.value = beat.diastolic_mmhg;
    }
    if let Some(v) = &mut side.forward_stroke_volume {
        v.value = beat.forward_stroke_volume_ml;
    }
    if let Some(w) = &mut side.whole_heart {
        w.volume.value = beat.at(&beat.true_volume_ml, w.time_ms);
    }
    for (which, time) in side.valve_times.all_mut().into_iter().enumerate() {
        if let Some(time) = time {
            time.value = beat.valve_times_ms?[which];
        }
    }
    if let Some(qrs) = &mut side.qrs_ms {
        qrs.value = beat.qrs_ms;
    }
    data.further = data.further.of_beat(&beat);
    Some(data)
}

/// Rivals of one accepted term, with the misfit that each leaves on the fit's noise-free output, in
/// ascending order.
///
/// - `fits`: fits of rivals to the measured data, used as further starts
#[must_use]
pub fn confusables(
    problem: &Problem<'_>,
    fit: &Fit,
    term: usize,
    rivals: &[usize],
    fits: &[Option<Fit>],
    settings: &Settings,
) -> Vec<Rival> {
    let Some(data) = noise_free(problem, fit) else {
        return Vec::new();
    };
    let inner = Problem {
        forward: problem.forward,
        data: &data,
    };
    let candidates = problem.forward.candidates();
    let n_base = problem.forward.base().len();
    let mut own = Vec::new();
    // Base and other accepted terms, as fitted.
    let mut z = fit.z[..n_base].to_vec();
    let mut at = n_base;
    let mut structure = fit.structure.clone();
    for other in &fit.structure.terms {
        let n = candidates[*other].parameters.len();
        let part = &fit.z[at..at + n];
        if *other == term {
            own.extend_from_slice(part)
        } else {
            z.extend_from_slice(part)
        }
        at += n;
    }
    structure.terms.retain(|t| *t != term);
    // The pull of the prior on the effect itself is not a misfit.
    let itself = fit.misfit.prior;
    let found: Vec<Option<Rival>> = rivals
        .par_iter()
        .map(|rival| {
            let mut with = structure.clone();
            with.terms.push(*rival);
            let start = |values: &[f64]| {
                let mut z = z.clone();
                z.extend(
                    candidates[*rival]
                        .parameters
                        .iter()
                        .zip(values)
                        .map(|(p, v)| p.z(*v)),
                );
                z
            };
            let mut starts: Vec<Vec<f64>> =
                candidates[*rival].starts.iter().map(|v| start(v)).collect();
            if let Some(Some(known)) = fits
                .get(*rival)
                .filter(|f| f.as_ref().is_some_and(|f| f.structure == with))
            {
                starts.insert(0, known.z.clone());
                starts.truncate(2);
            }
            let tries = starts
                .iter()
                .map(|z| inner.fit(&with, z, Some(fit), settings))
                .collect::<Vec<_>>();
            let best = best(tries)?;
            let m = &best.misfit;
            let expected_misfit = (m.pressure + m.volume + m.side + m.prior - itself).max(0.0);
            let is_confusable = expected_misfit < SEPARABLE;
            Some(Rival {
                confusable: Confusable {
                    effect: candidates[term].name.clone(),
                    rival: candidates[*rival].name.clone(),
                    expected_misfit,
                },
                separations: if is_confusable {
                    separations(&inner, fit, &best)
                } else {
                    Vec::new()
                },
            })
        })
        .collect();
    let mut list: Vec<Rival> = found.into_iter().flatten().collect();
    list.sort_by(|a, b| {
        let misfit = |rival: &Rival| rival.confusable.expected_misfit;
        misfit(a).total_cmp(&misfit(b))
    });
    list
}

/// Candidates that might be confused with `term`: those declared in either direction, and the best
/// of the ranking.
#[must_use]
pub fn rivals(
    candidates: &[Candidate],
    term: usize,
    ranked: &[usize],
    n: usize,
    taken: &[usize],
) -> Vec<usize> {
    let mut list: Vec<usize> = (0..candidates.len())
        .filter(|i| {
            candidates[term]
                .confused_with
                .contains(&candidates[*i].name)
                || candidates[*i]
                    .confused_with
                    .contains(&candidates[term].name)
        })
        .collect();
    list.extend(ranked.iter().take(n));
    list.retain(|i| *i != term && !taken.contains(i));
    list.sort_unstable();
    list.dedup();
    list
}
