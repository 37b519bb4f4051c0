//! Uncertainty of a prediction: the same change on draws of the twin's posterior.

use std::collections::BTreeMap;
use std::panic::resume_unwind;
use std::path::Path;

use cardiotwin_calibrate::statistics::quantile_of;
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::task::OrganBeatSpec;

use super::beat::simulate;
use super::change::Change;
use super::indices::{Traces, indices};
use crate::cli::error::CliError;
use crate::cli::ventricle::AskedFor;

/// 5th and 95th percentile over the draws, by index.
pub type Bands = BTreeMap<&'static str, [f64; 2]>;
/// Indices of one beat by name.
type Indices = Vec<(&'static str, f64)>;
/// Least number of draws with a successful beat from which a band is computed.
const FEWEST: usize = 20;

/// Bands of the changed beat over all draws, in the one-fibre ventricle and its periodic state.
/// Draws whose beat fails are left out; fewer than `FEWEST` successful draws give no bands.
///
/// - `twin`: the unchanged beat
///
/// # Errors
/// [`CliError::Worker`] if the worker cannot be run.
pub fn of(
    posterior: &PosteriorResult,
    twin: &OrganBeatSpec,
    changes: &[Change],
    worker: &Path,
) -> Result<Bands, CliError> {
    let n_threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    // A thread simulates every n-th draw.
    let some = |first: usize| -> Result<Vec<Indices>, CliError> {
        let found = (first..posterior.draws.len()).step_by(n_threads).map(|at| {
            let mut beat = twin.with_parameters(&posterior.draw(at));
            // A change that is valid for the twin is valid for its draws, because their values have
            // the same signs.
            if changes.iter().any(|change| change.make(&mut beat).is_err()) {
                return Ok(None);
            }
            match simulate(&beat, AskedFor::OneFibre, worker) {
                Ok((result, traces)) => Ok(result.failed_check().is_none().then(|| {
                    indices(
                        &result.biomarkers,
                        &Traces::of(&traces),
                        beat.cycle_length_ms,
                    )
                })),
                Err(CliError::Simulation { .. }) => Ok(None),
                Err(error) => Err(error),
            }
        });
        found.filter_map(Result::transpose).collect()
    };
    let found: Vec<Indices> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..n_threads)
            .map(|first| scope.spawn(move || some(first)))
            .collect();
        let of_all = threads
            .into_iter()
            .map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)));
        of_all.collect::<Result<Vec<_>, _>>()
    })?
    .concat();
    if found.len() < FEWEST {
        return Ok(Bands::new());
    }
    let mut values: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    found
        .into_iter()
        .flatten()
        .for_each(|(name, value)| values.entry(name).or_default().push(value));
    let band = |(name, mut values): (&'static str, Vec<f64>)| {
        values.sort_by(f64::total_cmp);
        (name, [0.05, 0.95].map(|share| quantile_of(&values, share)))
    };
    Ok(values.into_iter().map(band).collect())
}
