//! Statistics of a posterior's draws.

use std::collections::BTreeMap;

use cardiotwin_calibrate::posterior::{Draw, TruncatedNormal};
use cardiotwin_calibrate::statistics::{mean, quantile_of};
use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::organ_law::LearnedLaw;
use cardiotwin_schemas::outcome::Determination;
use cardiotwin_schemas::posterior::{
    Band, Deviations, ParameterSpread, PosteriorResult, PosteriorSpec, Sampling, Spread,
};
use cardiotwin_schemas::samples::BeatSamples;

use crate::tasks::proposal::axes::Axis;

/// Ratio of the 90 % intervals of posterior and prior, both of the logarithm, up to which a
/// parameter counts as determined.
const DETERMINED: f64 = 1.0 / 3.0;
/// Ratio from which on a parameter counts as not determined.
const NOT_DETERMINED: f64 = 0.8;

/// Corrected beat of the one-fibre ventricle.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Seen {
    pub(super) biomarkers: Biomarkers,
    pub(super) samples: BeatSamples,
}

/// Data from which the result of a posterior is made.
pub(super) struct Sampled<'a> {
    pub(super) spec: &'a PosteriorSpec,
    pub(super) axes: &'a [Axis],
    pub(super) prior: &'a [TruncatedNormal],
    pub(super) draws: &'a [Draw<Seen>],
    pub(super) asked_for: u64,
    /// Whether beats were corrected to the twin's.
    pub(super) is_corrected: bool,
    /// Residual of data and prior at the mode, divided by the expected sum of squares.
    pub(super) left: f64,
    pub(super) deviations: Deviations,
    pub(super) evaluations: u64,
    pub(super) learned_law: Option<LearnedLaw>,
}

/// Makes the result from the draws.
pub(super) fn of(sampled: &Sampled<'_>) -> PosteriorResult {
    let Sampled {
        spec,
        axes,
        prior,
        draws,
        ..
    } = *sampled;
    // Logarithms of the parameters, by parameter and draw.
    let coordinates: Vec<Vec<f64>> = (0..axes.len())
        .map(|j| {
            draws
                .iter()
                .map(|draw| prior[j].from_standard(draw.u[j]))
                .collect()
        })
        .collect();
    let parameters =
        axes.iter()
            .zip(prior)
            .zip(&coordinates)
            .map(|((axis, prior), coordinates)| {
                let twin = spec.twin.parameters.get(&axis.name).copied();
                (axis.name.clone(), parameter(axis, prior, coordinates, twin))
            });
    let parameters: BTreeMap<String, ParameterSpread> = parameters.collect();
    let biomarkers = Biomarker::OF_ORGAN.into_iter().filter_map(|biomarker| {
        // A biomarker that some draws lack has no distribution.
        let values: Option<Vec<f64>> = draws
            .iter()
            .map(|draw| draw.seen.biomarkers.get(biomarker))
            .collect();
        Some((biomarker.key().to_owned(), spread(values?)))
    });
    PosteriorResult {
        parameters,
        biomarkers: biomarkers.collect(),
        pressure_mmhg: band(draws, |seen| &seen.samples.pressure_mmhg),
        volume_ml: band(draws, |seen| &seen.samples.volume_ml),
        correlations: correlations(&coordinates),
        draws: (0..draws.len())
            .map(|d| {
                axes.iter()
                    .zip(&coordinates)
                    .map(|(axis, coordinates)| axis.value(coordinates[d]))
                    .collect()
            })
            .collect(),
        deviations: sampled.deviations,
        sampling: Sampling {
            converged_share: draws.iter().filter(|draw| draw.converged).count() as f64
                / sampled.asked_for as f64,
            left_over_expected: sampled.left,
            evaluations: sampled.evaluations,
            is_uncorrected: !sampled.is_corrected,
        },
        learned_law: sampled.learned_law.clone(),
    }
}

fn spread(mut values: Vec<f64>) -> Spread {
    values.sort_by(f64::total_cmp);
    let [p5, p50, p95] = [0.05, 0.5, 0.95].map(|share| quantile_of(&values, share));
    Spread { p5, p50, p95 }
}

/// - `coordinates`: draws of the logarithm
fn parameter(
    axis: &Axis,
    prior: &TruncatedNormal,
    coordinates: &[f64],
    twin: Option<f64>,
) -> ParameterSpread {
    let of = spread(coordinates.to_vec());
    let [low, middle, high] = [0.05, 0.5, 0.95].map(|share| prior.quantile(share));
    let share = (of.p95 - of.p5) / (high - low);
    let mark = match share {
        share if share <= DETERMINED => Determination::Determined,
        share if share < NOT_DETERMINED => Determination::Sloppy,
        _ => Determination::NotDetermined,
    };
    // For a negative parameter, the logarithm of the magnitude runs in the opposite direction.
    let in_units = |low: f64, middle: f64, high: f64| {
        let [a, p50, b] = [low, middle, high].map(|x| axis.value(x));
        Spread {
            p5: a.min(b),
            p50,
            p95: a.max(b),
        }
    };
    ParameterSpread {
        twin: twin.unwrap_or_else(|| axis.value(middle)),
        posterior: in_units(of.p5, of.p50, of.p95),
        prior: in_units(low, middle, high),
        mark,
    }
}

fn band(draws: &[Draw<Seen>], pick: impl Fn(&Seen) -> &Vec<f64>) -> Band {
    let n = draws
        .iter()
        .map(|draw| pick(&draw.seen).len())
        .min()
        .unwrap_or(0);
    let spreads: Vec<Spread> = (0..n)
        .map(|k| spread(draws.iter().map(|draw| pick(&draw.seen)[k]).collect()))
        .collect();
    Band {
        p5: spreads.iter().map(|s| s.p5).collect(),
        p50: spreads.iter().map(|s| s.p50).collect(),
        p95: spreads.iter().map(|s| s.p95).collect(),
    }
}

fn correlations(coordinates: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let centred: Vec<Vec<f64>> = coordinates
        .iter()
        .map(|all| {
            let middle = mean(all);
            all.iter().map(|x| x - middle).collect()
        })
        .collect();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let correlation = |a: &Vec<f64>, b: &Vec<f64>| {
        let scale = (product(a, a) * product(b, b)).sqrt();
        if scale > 0.0 {
            (1e4 * product(a, b) / scale).round() / 1e4
        } else {
            0.0
        }
    };
    centred
        .iter()
        .map(|a| centred.iter().map(|b| correlation(a, b)).collect())
        .collect()
}
