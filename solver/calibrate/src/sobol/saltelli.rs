//! Saltelli design in complete blocks. Each base point gives 2D + 2 rows, and any number of first
//! blocks is a design itself.
//!
//! Source: Saltelli 2002, Comput. Phys. Commun. 145:280. Rows and their order follow
//! `SALib.sample.sobol` with second order: A, then A with each parameter in turn taken from B, then
//! B with each parameter in turn taken from A, then B.

use super::error::SobolError;
use super::points::SobolPoints;
use crate::Interval;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Settings of a design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DesignSettings {
    /// Number of base points. A power of two keeps the balance of the sequence.
    pub n_blocks: usize,
    /// Number of first points of the sequence to skip, `SALib`'s `skip_values`.
    pub skip_points: u64,
    /// Seed of a scrambled sequence; `None` for a plain one.
    pub scramble: Option<u64>,
}

impl Default for DesignSettings {
    /// The paper's size, with `SALib`'s plain points.
    fn default() -> Self {
        Self {
            n_blocks: 1024,
            skip_points: 0,
            scramble: None,
        }
    }
}

impl DesignSettings {
    /// A plain design that skips as many first points as `SALib`'s older `saltelli` sampler does by
    /// default: the least power of two that is at least the number of blocks and at least 16. As
    /// far as known, the paper used this design.
    #[must_use]
    pub fn older_sampler(n_blocks: usize) -> Self {
        Self {
            n_blocks,
            skip_points: n_blocks.next_power_of_two().max(16) as u64,
            scramble: None,
        }
    }
}

/// A Saltelli design over a box, with rows computed on demand.
#[derive(Debug, Clone, PartialEq)]
pub struct SaltelliDesign {
    intervals: Vec<Interval>,
    points: SobolPoints,
    settings: DesignSettings,
}

impl SaltelliDesign {
    /// Creates a design over one interval per parameter.
    ///
    /// # Errors
    /// [`SobolError`] if the box is invalid, or parameters or points exceed the sequence.
    pub fn new(intervals: &[Interval], settings: DesignSettings) -> Result<Self, SobolError> {
        Interval::validate(intervals)?;
        let points = SobolPoints::new(2 * intervals.len(), settings.scramble)?;
        let n_points = settings
            .skip_points
            .saturating_add(settings.n_blocks as u64);
        if n_points > SobolPoints::N_POINTS {
            return Err(SobolError::Points {
                n_points,
                largest: SobolPoints::N_POINTS,
            });
        }
        Ok(Self {
            intervals: intervals.to_vec(),
            points,
            settings,
        })
    }

    /// Number of parameters, D.
    #[must_use]
    pub fn n_parameters(&self) -> usize {
        self.intervals.len()
    }

    /// Number of rows per block, 2D + 2.
    #[must_use]
    pub fn rows_per_block(&self) -> usize {
        rows_per_block(self.n_parameters())
    }

    /// Number of blocks, N.
    #[must_use]
    pub fn n_blocks(&self) -> usize {
        self.settings.n_blocks
    }

    /// Number of rows, N(2D + 2).
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.n_blocks() * self.rows_per_block()
    }

    /// Whether the balance of the sequence is kept. The number of blocks must be a power of two,
    /// and the number of skipped points zero or a power of two at least as large.
    #[must_use]
    pub fn is_balanced(&self) -> bool {
        let (n, skip) = (self.settings.n_blocks as u64, self.settings.skip_points);
        n.is_power_of_two() && (skip == 0 || (skip.is_power_of_two() && skip >= n))
    }

    /// Rows of a range of blocks, each of length D, in the parameters' units. Blocks beyond the
    /// last are omitted.
    ///
    /// The whole design is never built first: each chunk of a sweep computes its own blocks, on
    /// whatever machine it runs.
    #[must_use]
    pub fn rows(&self, blocks: Range<usize>) -> Vec<Vec<f64>> {
        let blocks = blocks.start.min(self.n_blocks())..blocks.end.min(self.n_blocks());
        let mut rows = Vec::with_capacity(blocks.len() * self.rows_per_block());
        for block in blocks {
            self.push_block(block, &mut rows);
        }
        rows
    }

    fn push_block(&self, block: usize, rows: &mut Vec<Vec<f64>>) {
        let n = self.n_parameters();
        let mut point = vec![0.0; 2 * n];
        self.points
            .write_point(self.settings.skip_points + block as u64, &mut point)
            .expect("the number of points was checked when the design was made");
        // SALib scales in this order; another order changes the last digit.
        let scale = |u: f64, i: &Interval| u * (i.upper - i.lower) + i.lower;
        let a: Vec<f64> = point[..n]
            .iter()
            .zip(&self.intervals)
            .map(|(u, i)| scale(*u, i))
            .collect();
        let b: Vec<f64> = point[n..]
            .iter()
            .zip(&self.intervals)
            .map(|(u, i)| scale(*u, i))
            .collect();
        let with_one_of = |base: &[f64], other: &[f64], d: usize| {
            let mut row = base.to_vec();
            row[d] = other[d];
            row
        };
        rows.push(a.clone());
        rows.extend((0..n).map(|d| with_one_of(&a, &b, d)));
        rows.extend((0..n).map(|d| with_one_of(&b, &a, d)));
        rows.push(b);
    }
}

/// Number of rows per block for this number of parameters.
pub(super) fn rows_per_block(n_parameters: usize) -> usize {
    2 * n_parameters + 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn design(n_parameters: usize, settings: DesignSettings) -> SaltelliDesign {
        let intervals: Vec<Interval> = (0..n_parameters)
            .map(|d| Interval::new(-(d as f64), 2.0 + d as f64))
            .collect();
        SaltelliDesign::new(&intervals, settings).unwrap()
    }

    #[test]
    fn the_paper_s_design_has_45_056_rows() {
        let design = design(21, DesignSettings::default());
        assert_eq!(
            (design.n_rows(), design.rows_per_block(), design.n_blocks()),
            (45_056, 44, 1024)
        );
        assert!(design.is_balanced());
    }

    proptest! {
        /// Concatenated chunks of blocks give the whole design, and a smaller design is the
        /// beginning of a larger one.
        #[test]
        fn chunks_are_parts_of_the_whole(n in 1usize..6, cut in 0usize..16, skip in 0u64..40, seed: Option<u64>) {
            let of = |n_blocks| design(n, DesignSettings { n_blocks, skip_points: skip, scramble: seed });
            let whole = of(16).rows(0..16);
            let mut parts = of(16).rows(0..cut);
            prop_assert_eq!(&parts, &of(cut).rows(0..99));
            parts.extend(of(16).rows(cut..16));
            prop_assert_eq!(parts, whole);
        }

        /// Each row takes each parameter from A or B and lies inside the box.
        #[test]
        fn rows_are_crossed(n in 1usize..6, block in 0usize..64, seed: Option<u64>) {
            let design = design(n, DesignSettings { n_blocks: 64, skip_points: 0, scramble: seed });
            let rows = design.rows(block..block + 1);
            let (a, b) = (&rows[0], &rows[2 * n + 1]);
            for d in 0..n {
                for e in 0..n {
                    let (ab, ba) = (rows[1 + d][e], rows[1 + n + d][e]);
                    prop_assert_eq!((ab, ba), if d == e { (b[e], a[e]) } else { (a[e], b[e]) });
                }
            }
            prop_assert!(rows.iter().all(|r| r.iter().zip(&design.intervals).all(|(v, i)| i.contains(*v))));
        }
    }

    #[test]
    fn too_much_is_refused() {
        let intervals = vec![Interval::new(0.0, 1.0); 65];
        assert!(matches!(
            SaltelliDesign::new(&intervals, DesignSettings::default()),
            Err(SobolError::Dimensions {
                n_dimensions: 130,
                ..
            })
        ));
        let settings = DesignSettings {
            skip_points: u64::MAX,
            ..DesignSettings::default()
        };
        assert!(matches!(
            SaltelliDesign::new(&intervals[..2], settings),
            Err(SobolError::Points { .. })
        ));
        assert!(SaltelliDesign::new(&[], DesignSettings::default()).is_err());
    }

    #[test]
    fn balance_needs_powers_of_two() {
        let balanced = |n_blocks, skip_points| {
            design(
                2,
                DesignSettings {
                    n_blocks,
                    skip_points,
                    scramble: None,
                },
            )
            .is_balanced()
        };
        assert!(balanced(64, 0) && balanced(64, 64) && balanced(64, 128));
        assert!(!balanced(60, 0) && !balanced(64, 32) && !balanced(64, 70));
    }
}
