//! Uncertainty of a prediction: the same change on draws of the twin's posterior.

use std::collections::BTreeMap;
use std::panic::resume_unwind;
use std::path::Path;

use cardiotwin_calibrate::normal::quantile;
use cardiotwin_calibrate::statistics::quantile_of;
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::task::OrganBeatSpec;

use super::change::Change;
use super::circuit::{Both, Simulated, TwinsLoop, Ventricles, both};
use super::indices::{Traces, changes, indices};
use crate::error::CliError;
use crate::ventricle::AskedFor;

/// Interval of the relative change of an index over the draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// 5th percentile.
    pub low: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub high: f64,
}

impl Interval {
    fn of(mut changes: Vec<f64>) -> Self {
        changes.sort_by(f64::total_cmp);
        let at = |share| quantile_of(&changes, share);
        Self {
            low: at(0.05),
            median: at(0.5),
            high: at(0.95),
        }
    }

    /// Whether the draws have a change like this one.
    pub fn contains(&self, change: f64) -> bool {
        (self.low..=self.high).contains(&change)
    }

    /// The interval moved so that its median is `change`. The draws say how uncertain a change is; the twin says
    /// how large it is, because the twin fits the measurements that a user sees beside it.
    pub fn around(&self, change: f64) -> [f64; 2] {
        let shift = change - self.median;
        [self.low + shift, self.high + shift]
    }

    /// [`Self::around`] a change with a symmetric error beyond the draws, added in quadrature on each side.
    pub fn widened(&self, change: f64, half_width: f64) -> [f64; 2] {
        let [low, high] = self.around(change);
        [
            change - half_width.hypot(change - low),
            change + half_width.hypot(high - change),
        ]
    }
}

/// Intervals of the relative changes by index.
pub type Bands = BTreeMap<&'static str, Interval>;
/// Indices of one beat by name.
type Indices = Vec<(&'static str, f64)>;
/// Least number of draws with a successful beat from which a band is computed.
const FEWEST: usize = 20;

/// Bands of the relative changes of the indices over all draws: each draw is simulated as it is and
/// changed, both to the periodic state. The law's own error is added to its changes. Draws with a beat that fails are left out; fewer than
/// `FEWEST` successful draws give no bands.
///
/// - `twin`: the unchanged beat, and `own` the twin's indices; `closed`: the loop around it, `None` in the
///   open circuit; `asked`: the ventricle in which the draws are simulated
///
/// # Errors
/// [`CliError::Worker`] if the worker cannot be run.
pub fn of(
    posterior: &PosteriorResult,
    (twin, own): (&OrganBeatSpec, &[(&'static str, f64)]),
    made: &[Change],
    closed: Option<&TwinsLoop>,
    asked: AskedFor<'_>,
    worker: &Path,
) -> Result<Bands, CliError> {
    let n_threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let whole = |both: &Both| {
        let checks = [&both.before, &both.after].map(|(result, _)| result.failed_check());
        checks == [None; 2] && (closed.is_none() || both.are_periodic())
    };
    let read = |(result, traces): &Simulated, cycle_length_ms: f64| {
        indices(&result.biomarkers, &Traces::of(traces), cycle_length_ms)
    };
    // A thread simulates every n-th draw.
    let some = |first: usize| -> Result<Vec<Indices>, CliError> {
        let found = (first..posterior.draws.len()).step_by(n_threads).map(|at| {
            let draw = twin.with_parameters(&posterior.draw(at));
            // A change that is valid for the twin is valid for its draws, because their values have
            // the same signs.
            let both = match both(&draw, made, closed, Ventricles::only(asked, worker)) {
                Ok(both) if whole(&both) => both,
                Ok(_) | Err(CliError::Simulation { .. } | CliError::Usage(_)) => return Ok(None),
                Err(error) => return Err(error),
            };
            let before = read(&both.before, draw.cycle_length_ms);
            let after = read(&both.after, both.cycle_length_after_ms);
            let mut changes = changes(own, &before, &after);
            if let AskedFor::Law(_) = asked {
                add_error_of_law(&mut changes, at);
            }
            Ok(Some(changes))
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
    let interval = |(name, values): (&'static str, Vec<f64>)| (name, Interval::of(values));
    Ok(values.into_iter().map(interval).collect())
}

/// Relative standard deviations of a beat that the law has not seen, by index: the mean absolute
/// errors of the verification beats of eleven development patients in the law of step 1's only beat
/// (docs/organ-law.md#errors), times √(π/2). Other pressures count like P_max, other volumes like SV.
const ERROR_OF_LAW: [(&str, f64); 14] = [
    ("P_max_mmHg", P_MAX),
    ("EDP_mmHg", P_MAX),
    ("dPdt_max_mmHg_per_ms", 0.0150),
    ("dPdt_min_mmHg_per_ms", 0.0451),
    ("PTD90_ms", 0.0125),
    ("EDV_mL", SV),
    ("ESV_mL", SV),
    ("SV_mL", SV),
    ("ejection_fraction", SV),
    ("cardiac_output_L_per_min", SV),
    ("stroke_work_mJ", SV),
    ("aortic_systolic_mmHg", P_MAX),
    ("aortic_diastolic_mmHg", P_MAX),
    ("aortic_mean_mmHg", P_MAX),
];
const P_MAX: f64 = 0.0088;
const SV: f64 = 0.0125;

/// Adds an error of the law to the changes of a draw: quantiles of the normal distribution, which
/// follow each other by the golden ratio, so that they are spread evenly over the draws.
fn add_error_of_law(changes: &mut Indices, draw: usize) {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    for (name, change) in changes {
        if let Some(k) = ERROR_OF_LAW.iter().position(|(other, _)| other == name) {
            // Each index begins elsewhere, so that errors of different indices are not alike.
            let share = (GOLDEN * (draw as f64 + 1.0)
                + (k as f64 + 0.5) / ERROR_OF_LAW.len() as f64)
                .fract();
            let error = ERROR_OF_LAW[k].1 * quantile(share.clamp(1e-6, 1.0 - 1e-6));
            *change = (1.0 + *change) * (1.0 + error) - 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_moves_with_the_change_and_keeps_its_sides() {
        // A skewed distribution, whose percentiles are near 0.002, 0.25 and 0.92.
        let interval = Interval::of((0..=100).map(|k| f64::from(k * k) * 1e-4).collect());
        assert!(interval.contains(0.25) && !interval.contains(0.95));
        let [low, high] = interval.around(-0.1);
        assert!((low - (-0.1 - 0.248)).abs() < 0.005, "{low}");
        assert!((high - (-0.1 + 0.67)).abs() < 0.005, "{high}");
        let same = interval.widened(-0.1, 0.0);
        assert!((same[0] - low).abs() < 1e-12 && (same[1] - high).abs() < 1e-12);
        let [lower, higher] = interval.widened(-0.1, 0.3);
        assert!(lower < low && higher > high);
        assert!((lower - (-0.1 - 0.389)).abs() < 0.005, "{lower}");
    }
}
