//! Base fit from several starts, and every candidate refitted jointly with it.

use crate::fit::Fit;
use crate::forward::Candidate;
use crate::least_squares::Settings;
use crate::problem::{N_BUMPS, Problem, Structure};
use rayon::prelude::*;

/// How much a fit with a further term may lie above the one without before it counts as failed \[deviance\].
pub const RISE: f64 = 0.2;

/// Mean square of the white residuals from which on starts nearer to the prior are tried too.
const BENT: f64 = 1.35;
/// Share of the way from the prior's mean to the optimum without the term, where such a start is.
pub const UNBENT: f64 = 0.4;

/// Whether a fit is bent far to follow what it lacks: a bad start for what would unbend it.
#[must_use]
pub fn is_bent(problem: &Problem<'_>, fit: &Fit) -> bool {
    let n = (problem.data.pressure.len() + problem.data.volume.len()) as f64;
    fit.misfit.pressure + fit.misfit.volume > BENT * n
}

/// The fit of smallest deviance.
pub fn best(fits: impl IntoIterator<Item = Option<Fit>>) -> Option<Fit> {
    fits.into_iter()
        .flatten()
        .reduce(|a, b| if b.deviance < a.deviance { b } else { a })
}

/// z of a candidate's start values.
fn start_z(candidate: &Candidate, values: &[f64]) -> Vec<f64> {
    candidate
        .parameters
        .iter()
        .zip(values)
        .map(|(p, v)| p.z(*v))
        .collect()
}

/// The base model from all its starts; none when the model has no answer at any.
#[must_use]
pub fn fit_base(problem: &Problem<'_>, settings: &Settings) -> Option<Fit> {
    let n = problem.forward.base().len();
    let mut starts = vec![vec![0.0; n]];
    starts.extend(problem.forward.base_starts());
    let settings = Settings {
        max_iterations: settings.max_iterations * 2,
        ..*settings
    };
    let fits: Vec<Option<Fit>> = starts
        .par_iter()
        .map(|z| problem.fit(&Structure::default(), z, None, &settings))
        .collect();
    best(fits)
}

/// A structure with one more term, from the optimum without it and all starts of the term; never worse than without.
#[must_use]
pub fn add_term(
    problem: &Problem<'_>,
    without: &Fit,
    term: usize,
    settings: &Settings,
) -> Option<Fit> {
    let candidate = &problem.forward.candidates()[term];
    let mut structure = without.structure.clone();
    structure.terms.push(term);
    // The nameless bumps stay last.
    let end = without.z.len() - if structure.bumps { N_BUMPS } else { 0 };
    let bent = is_bent(problem, without);
    let mut starts: Vec<(f64, &Vec<f64>)> = candidate
        .starts
        .iter()
        .map(|values| (1.0, values))
        .collect();
    if bent {
        starts.extend(candidate.starts.iter().map(|values| (UNBENT, values)));
        // The prior's mean has a beat where the way to it may have none.
        starts.extend(candidate.starts.iter().map(|values| (0.0, values)));
    }
    let tries: Vec<Option<Fit>> = starts
        .par_iter()
        .map(|(share, values)| {
            let mut z: Vec<f64> = without.z.iter().map(|z| share * z).collect();
            z.splice(end..end, start_z(candidate, values));
            // Neither are its noise scales, which are as large as its misfit.
            problem.fit(&structure, &z, (*share == 1.0).then_some(without), settings)
        })
        .collect();
    let found = best(tries);
    if found
        .as_ref()
        .is_some_and(|f| f.deviance <= without.deviance + RISE)
    {
        return found;
    }
    // The optimiser failed: once more from next to the optimum without the term.
    let mut z = without.z.clone();
    let mut values = candidate.starts[0].clone();
    values[0] = candidate.off + 0.1 * (values[0] - candidate.off);
    z.splice(end..end, start_z(candidate, &values));
    best([found, problem.fit(&structure, &z, Some(without), settings)])
}

/// A structure from given z, near a fit.
#[must_use]
pub fn refit(
    problem: &Problem<'_>,
    structure: &Structure,
    z: &[f64],
    near: &Fit,
    settings: &Settings,
) -> Option<Fit> {
    problem.fit(structure, z, Some(near), settings)
}

/// Every candidate that the structure does not have yet, added to it; by candidate.
#[must_use]
pub fn scan(
    problem: &Problem<'_>,
    without: &Fit,
    among: &[usize],
    settings: &Settings,
) -> Vec<Option<Fit>> {
    let n = problem.forward.candidates().len();
    (0..n)
        .into_par_iter()
        .map(|term| {
            let wanted = among.contains(&term) && !without.structure.terms.contains(&term);
            wanted
                .then(|| add_term(problem, without, term, settings))
                .flatten()
        })
        .collect()
}
