//! Fit of the base from several starts, and joint refits with every candidate.

use crate::fit::{Fit, UNIT};
use crate::forward::Candidate;
use crate::least_squares::Settings;
use crate::parameter::Parameter;
use crate::problem::{N_BUMPS, Problem, Structure};
use crate::random::standard_normal;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Largest rise of the deviance by a further term before its fit counts as failed.
pub const RISE: f64 = 0.2;

/// Mean square of the white residuals above which starts closer to the prior are tried too.
const BENT: f64 = 1.35;
/// Position of such a start, as a share of the way from the prior mean to the optimum without the
/// term.
pub const UNBENT: f64 = 0.4;

/// Whether a fit is distorted because an effect is missing. It is then a poor start for a fit with
/// that effect.
#[must_use]
pub fn is_bent(problem: &Problem<'_>, fit: &Fit) -> bool {
    let n = (problem.data.pressure.len() + problem.data.volume.len()) as f64;
    fit.misfit.pressure + fit.misfit.volume > BENT * n
}

/// The fit with the smallest deviance.
pub fn best(fits: impl IntoIterator<Item = Option<Fit>>) -> Option<Fit> {
    fits.into_iter()
        .flatten()
        .reduce(|a, b| if b.deviance < a.deviance { b } else { a })
}

/// z of the values of a candidate's start.
fn start_z(candidate: &Candidate, values: &[f64]) -> Vec<f64> {
    candidate
        .parameters
        .iter()
        .zip(values)
        .map(|(p, v)| p.z(*v))
        .collect()
}

/// Number of points of the prior that are tried where the base model has no beat at its starts.
const N_DRAWS: usize = 256;
/// Number of fits from the best of them.
const N_FROM_DRAWS: usize = 4;

/// Fits the base model from all its starts, or from points of its prior where it has no beat at any
/// start; `None` if it has no beat at any of these points, either.
#[must_use]
pub fn fit_base(problem: &Problem<'_>, settings: &Settings) -> Option<Fit> {
    let n = problem.forward.base().len();
    let mut starts = vec![vec![0.0; n]];
    starts.extend(problem.forward.base_starts());
    let settings = Settings {
        max_iterations: settings.max_iterations * 2,
        ..*settings
    };
    let fit = |starts: &[Vec<f64>]| {
        let fits: Vec<Option<Fit>> = starts
            .par_iter()
            .map(|z| problem.fit(&Structure::default(), z, None, &settings))
            .collect();
        best(fits)
    };
    fit(&starts).or_else(|| fit(&likely_starts(problem)))
}

/// Points of the prior at which the base model has a beat, the best ones first.
fn likely_starts(problem: &Problem<'_>) -> Vec<Vec<f64>> {
    let parameters = problem.forward.base();
    let mut random = Pcg64::seed_from_u64(0);
    let draws: Vec<Vec<f64>> = (0..N_DRAWS)
        .map(|_| {
            let draw = |p: &Parameter| {
                let (lower, upper) = p.z_bounds();
                standard_normal(&mut random).clamp(lower, upper)
            };
            parameters.iter().map(draw).collect()
        })
        .collect();
    let misfit = |z: &Vec<f64>| {
        let found = problem.residuals(&Structure::default(), parameters, z, UNIT, None);
        found.map(|(residuals, _)| residuals.norm_squared())
    };
    let misfits: Vec<Option<f64>> = draws.par_iter().map(misfit).collect();
    let mut found: Vec<(f64, Vec<f64>)> = misfits
        .into_iter()
        .zip(draws)
        .filter_map(|(misfit, z)| Some((misfit?, z)))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(N_FROM_DRAWS);
    found.into_iter().map(|(_, z)| z).collect()
}

/// Adds one term to a structure, from the optimum without it and all starts of the term. The result
/// is never worse than without the term.
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
        // A beat exists at the prior mean, but possibly not on the way there.
        starts.extend(candidate.starts.iter().map(|values| (0.0, values)));
    }
    let tries: Vec<Option<Fit>> = starts
        .par_iter()
        .map(|(share, values)| {
            let mut z: Vec<f64> = without.z.iter().map(|z| share * z).collect();
            z.splice(end..end, start_z(candidate, values));
            // The noise scales of a distorted fit, which are as large as its misfit, are a poor
            // start too.
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
    // The optimiser failed; try once more from close to the optimum without the term.
    let mut z = without.z.clone();
    let mut values = candidate.starts[0].clone();
    values[0] = candidate.off + 0.1 * (values[0] - candidate.off);
    z.splice(end..end, start_z(candidate, &values));
    best([found, problem.fit(&structure, &z, Some(without), settings)])
}

/// Refits a structure from given z, with the state of a nearby fit.
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

/// Adds every candidate that the structure lacks; the result is ordered by candidate index.
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
