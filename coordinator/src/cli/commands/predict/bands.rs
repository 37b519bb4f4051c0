//! How sure a prediction is: the change on draws of the twin's posterior.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use cardiotwin_calibrate::posterior::quantile_of;
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::task::OrganBeatSpec;

use super::change::Change;
use super::indices::{Traces, indices};
use super::simulate;
use crate::cli::error::CliError;
use crate::cli::ventricle::AskedFor;

/// Values below which 5 and 95 % of the draws lie, by index.
pub type Bands = BTreeMap<&'static str, [f64; 2]>;
/// Draws without whose beats there is no band.
const FEWEST: usize = 20;

/// The changed beat of each draw, in the one-fibre ventricle and its periodic state. Draws whose beat fails are left out;
/// nothing where hardly any is left.
///
/// - `twin`: the unchanged beat
///
/// # Errors
/// [`CliError::Worker`] where a worker cannot be asked.
pub fn of(
    posterior: &PosteriorResult,
    twin: &OrganBeatSpec,
    changes: &[Change],
    worker: &Path,
) -> Result<Bands, CliError> {
    let next = AtomicUsize::new(0);
    let found: Mutex<Vec<Vec<(&'static str, f64)>>> = Mutex::new(Vec::new());
    let failed: Mutex<Option<CliError>> = Mutex::new(None);
    let n_threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        for _ in 0..n_threads {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    if at >= posterior.draws.len() || failed.lock().is_ok_and(|failed| failed.is_some()) {
                        return;
                    }
                    let mut beat = twin.with_parameters(&posterior.draw(at));
                    // A change that makes sense of the twin does so of its draws: signs are the same.
                    if changes.iter().any(|change| change.make(&mut beat).is_err()) {
                        continue;
                    }
                    match simulate(&beat, AskedFor::OneFibre, worker) {
                        Ok((result, traces)) if result.failed_check().is_none() => {
                            let of_draw = indices(&result.biomarkers, &Traces::of(&traces), beat.cycle_length_ms);
                            if let Ok(mut found) = found.lock() {
                                found.push(of_draw);
                            }
                        }
                        Ok(_) | Err(CliError::Simulation { .. }) => {}
                        Err(error) => {
                            if let Ok(mut failed) = failed.lock() {
                                *failed = Some(error);
                            }
                        }
                    }
                }
            });
        }
    });
    if let Some(error) = failed.into_inner().ok().flatten() {
        return Err(error);
    }
    let found = found.into_inner().unwrap_or_default();
    if found.len() < FEWEST {
        return Ok(Bands::new());
    }
    let mut values: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    found.into_iter().flatten().for_each(|(name, value)| values.entry(name).or_default().push(value));
    let band = |(name, mut values): (&'static str, Vec<f64>)| {
        values.sort_by(f64::total_cmp);
        (name, [0.05, 0.95].map(|share| quantile_of(&values, share)))
    };
    Ok(values.into_iter().map(band).collect())
}
