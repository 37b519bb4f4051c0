//! Ranking of parameters by the sum of total indices over the outputs, with intervals of the ranks.
//!
//! Source: Jung et al. 2022, section 3.1, which passes the first nine of 21 parameters to step 2.
//! Close ranks exchange places from one resample to the next; each rank therefore has an interval.

use super::indices::Analysis;
use crate::normal;
use serde::{Deserialize, Serialize};

/// Rank of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ranked {
    /// Index of the parameter.
    pub parameter: usize,
    /// Sum of the parameter's total indices over the outputs, dimensionless.
    pub sum_of_totals: f64,
    /// Half-width of the sum's interval, from the bootstrap; `None` with fewer than two resamples.
    pub half_width: Option<f64>,
    /// Number of outputs with a total index of this parameter.
    pub n_outputs: usize,
    /// Smallest and largest rank, from 1, that enclose the middle share of the resamples given by
    /// the confidence level; `None` without resamples.
    pub rank_interval: Option<[usize; 2]>,
    /// Share of the resamples in which the parameter has rank 1, 2, …, D; empty without resamples.
    pub rank_shares: Vec<f64>,
}

impl Ranked {
    /// Share of the resamples in which the parameter is among the first `n`; `None` without
    /// resamples.
    #[must_use]
    pub fn share_among_first(&self, n: usize) -> Option<f64> {
        (!self.rank_shares.is_empty())
            .then(|| self.rank_shares.iter().take(n).sum::<f64>().min(1.0))
    }
}

/// Parameters from the most to the least influential.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ranking {
    /// All parameters in rank order; the first has rank 1.
    pub parameters: Vec<Ranked>,
}

impl Ranking {
    /// Ranks the parameters of an analysis. Outputs that do not vary are ignored.
    #[must_use]
    pub fn of(analysis: &Analysis) -> Self {
        let (n, n_resamples) = (analysis.n_parameters, analysis.settings.n_resamples);
        let totals = |p: usize| analysis.outputs.iter().filter_map(move |o| o.total[p]);
        let sums: Vec<f64> = (0..n).map(|p| totals(p).map(|i| i.value).sum()).collect();
        let resampled: Vec<Vec<f64>> = (0..n_resamples)
            .map(|r| {
                let total = |p: usize| {
                    analysis
                        .outputs
                        .iter()
                        .filter_map(move |o| o.total_resamples.get(r * n + p))
                };
                (0..n)
                    .map(|p| total(p).filter(|v| v.is_finite()).sum())
                    .collect()
            })
            .collect();
        let mut counts = vec![vec![0; if n_resamples == 0 { 0 } else { n }]; n];
        for sums in &resampled {
            for (rank, parameter) in order(sums).into_iter().enumerate() {
                counts[parameter][rank] += 1;
            }
        }
        let rank_shares = |p: usize| {
            counts[p]
                .iter()
                .map(|c| f64::from(*c) / n_resamples as f64)
                .collect()
        };
        let level = analysis.settings.confidence_level;
        let z = normal::quantile(0.5 + 0.5 * level);
        let half_width = |p: usize| {
            let values: Vec<f64> = resampled.iter().map(|sums| sums[p]).collect();
            (n_resamples > 1).then(|| z * crate::statistics::standard_deviation(&values))
        };
        let parameters = order(&sums)
            .into_iter()
            .map(|p| Ranked {
                parameter: p,
                sum_of_totals: sums[p],
                half_width: half_width(p),
                n_outputs: totals(p).count(),
                rank_interval: rank_interval(&counts[p], level),
                rank_shares: rank_shares(p),
            })
            .collect();
        Self { parameters }
    }

    /// Indices of the `n` most influential parameters, the most influential first.
    #[must_use]
    pub fn select(&self, n: usize) -> Vec<usize> {
        self.parameters
            .iter()
            .take(n)
            .map(|r| r.parameter)
            .collect()
    }

    /// Rank of a parameter, from 1; `None` if the index is out of range.
    #[must_use]
    pub fn rank_of(&self, parameter: usize) -> Option<usize> {
        self.parameters
            .iter()
            .position(|r| r.parameter == parameter)
            .map(|idx| idx + 1)
    }
}

/// Indices from the largest to the smallest sum; equal sums keep their order.
fn order(sums: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..sums.len()).collect();
    order.sort_by(|a, b| sums[*b].total_cmp(&sums[*a]));
    order
}

/// Narrowest interval of ranks that leaves on each side at most half of the share outside `level`;
/// `counts` holds the resamples per rank.
fn rank_interval(counts: &[u32], level: f64) -> Option<[usize; 2]> {
    let n: u32 = counts.iter().sum();
    let outside = 0.5 * (1.0 - level) * f64::from(n);
    let holds_more = |counts: Vec<u32>| {
        let mut sum = 0;
        counts.into_iter().position(|c| {
            sum += c;
            f64::from(sum) > outside
        })
    };
    let low = holds_more(counts.to_vec())?;
    let high = holds_more(counts.iter().rev().copied().collect())?;
    Some([low + 1, counts.len() - high])
}

#[cfg(test)]
mod tests {
    use super::super::indices::{AnalysisSettings, analyse};
    use super::super::saltelli::{DesignSettings, SaltelliDesign};
    use super::*;
    use crate::Interval;

    /// An additive function with known shares of the variance: 0.9 and 0.1 of the first output,
    /// equal shares of the second.
    fn analysis(n_resamples: usize) -> Analysis {
        let design = SaltelliDesign::new(
            &[Interval::new(0.0, 1.0); 4],
            DesignSettings {
                n_blocks: 256,
                ..DesignSettings::default()
            },
        )
        .unwrap();
        let values: Vec<f64> = design
            .rows(0..256)
            .iter()
            .flat_map(|x| [3.0 * x[2] + x[0], x[2] + x[0] + 0.99 * x[1], 5.0])
            .collect();
        analyse(
            4,
            3,
            &values,
            AnalysisSettings {
                n_resamples,
                ..AnalysisSettings::default()
            },
        )
        .unwrap()
    }

    #[test]
    fn sums_of_known_indices_rank() {
        let ranking = Ranking::of(&analysis(200));
        assert_eq!(ranking.select(2), [2, 0]);
        assert_eq!(ranking.select(9), [2, 0, 1, 3]);
        let expected = [0.9 + 1.0 / 2.9801, 0.1 + 1.0 / 2.9801, 0.9801 / 2.9801, 0.0];
        for (ranked, expected) in ranking.parameters.iter().zip(expected) {
            assert!(
                (ranked.sum_of_totals - expected).abs() < 0.02,
                "{ranked:?} {expected}"
            );
            assert!((ranked.sum_of_totals - expected).abs() <= 2.0 * ranked.half_width.unwrap());
            // The constant output has no indices.
            assert_eq!(ranked.n_outputs, 2);
            assert!((ranked.rank_shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert_eq!(
            (ranking.rank_of(2), ranking.rank_of(3), ranking.rank_of(4)),
            (Some(1), Some(4), None)
        );
    }

    #[test]
    fn ranks_that_are_close_are_unsure_and_others_are_not() {
        let ranking = Ranking::of(&analysis(400));
        let of = |parameter| {
            ranking
                .parameters
                .iter()
                .find(|r| r.parameter == parameter)
                .unwrap()
        };
        assert_eq!(
            (of(2).rank_interval, of(2).share_among_first(1)),
            (Some([1, 1]), Some(1.0))
        );
        assert_eq!(of(3).rank_interval, Some([4, 4]));
        // The sums are 0.435 and 0.329, each with a half-width of about 0.05: mostly second.
        assert!(of(0).share_among_first(2).unwrap() > 0.9);
        assert_eq!(of(0).share_among_first(3), Some(1.0));
    }

    #[test]
    fn without_resamples_there_are_ranks_but_no_intervals() {
        let ranking = Ranking::of(&analysis(0));
        assert_eq!(ranking.select(2), [2, 0]);
        let first = &ranking.parameters[0];
        assert_eq!(
            (
                first.half_width,
                first.rank_interval,
                first.share_among_first(1)
            ),
            (None, None, None)
        );
    }

    #[test]
    fn intervals_of_ranks_hold_the_confidence_level() {
        assert_eq!(rank_interval(&[10, 40, 900, 50], 0.95), Some([2, 4]));
        assert_eq!(rank_interval(&[30, 950, 20, 0], 0.95), Some([1, 2]));
        assert_eq!(rank_interval(&[0, 100], 0.95), Some([2, 2]));
        assert_eq!(rank_interval(&[], 0.95), None);
    }
}
