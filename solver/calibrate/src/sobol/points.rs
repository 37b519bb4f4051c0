//! Points of the Sobol sequence, plain or scrambled, with random access.
//!
//! Source: Sobol 1967, with Joe and Kuo's direction numbers, in Gray code order (Antonov and Saleev
//! 1979). Scrambling is Matoušek's random linear one with a digital shift (Matoušek 1998, J.
//! Complexity 14:527), 30 bits.
//!
//! Points equal those of `scipy.stats.qmc.Sobol`, and hence of `SALib.sample.sobol`, bit for bit:
//! plain points including the first one (the origin), points after skipped ones, and scrambled
//! points of the same integer seed. `SALib`'s older `saltelli` sampler differs only in the points
//! it skips: by default the least power of two that is at least the number of points and at least
//! 16.

use super::direction_numbers::DIMENSIONS;
use super::error::SobolError;
use super::numpy_random::NumpyRandom;

/// Number of bits of a coordinate, `SciPy`'s default.
const N_BITS: usize = 30;

/// A Sobol sequence. Point `i` can be computed without the points before it.
#[derive(Debug, Clone, PartialEq)]
pub struct SobolPoints {
    /// Direction numbers of each dimension, as fractions of 2³⁰.
    directions: Vec<[u32; N_BITS]>,
    /// Digital shift, which is also the first point; zero without scrambling.
    shift: Vec<u32>,
}

impl SobolPoints {
    /// Largest number of dimensions.
    pub const LARGEST_DIMENSION: usize = DIMENSIONS.len() + 1;
    /// Number of points after which the sequence would repeat itself.
    pub const N_POINTS: u64 = 1 << N_BITS;

    /// Creates a sequence of `n_dimensions`; `scramble` is the seed of a scrambled sequence.
    ///
    /// # Errors
    /// [`SobolError::Dimensions`] for zero dimensions or more than [`Self::LARGEST_DIMENSION`].
    pub fn new(n_dimensions: usize, scramble: Option<u64>) -> Result<Self, SobolError> {
        if !(1..=Self::LARGEST_DIMENSION).contains(&n_dimensions) {
            return Err(SobolError::Dimensions {
                n_dimensions,
                largest: Self::LARGEST_DIMENSION,
            });
        }
        let mut points = Self {
            directions: (0..n_dimensions).map(direction_numbers).collect(),
            shift: vec![0; n_dimensions],
        };
        if let Some(seed) = scramble {
            points.scramble(&mut NumpyRandom::new(seed));
        }
        Ok(points)
    }

    /// Number of coordinates of each point.
    #[must_use]
    pub fn n_dimensions(&self) -> usize {
        self.shift.len()
    }

    /// Point `idx` of the sequence, from 0, in the half-open unit cube.
    ///
    /// # Errors
    /// [`SobolError::Points`] beyond the sequence's end.
    pub fn point(&self, idx: u64) -> Result<Vec<f64>, SobolError> {
        let mut point = vec![0.0; self.n_dimensions()];
        self.write_point(idx, &mut point)?;
        Ok(point)
    }

    /// Writes point `idx` into a slice with one element per dimension, as [`Self::point`].
    ///
    /// # Errors
    /// [`SobolError::Points`] beyond the sequence's end.
    ///
    /// # Panics
    /// If the length of the slice differs from the number of dimensions.
    pub fn write_point(&self, idx: u64, point: &mut [f64]) -> Result<(), SobolError> {
        assert_eq!(
            point.len(),
            self.n_dimensions(),
            "a point needs a place for each dimension"
        );
        if idx >= Self::N_POINTS {
            return Err(SobolError::Points {
                n_points: idx + 1,
                largest: Self::N_POINTS,
            });
        }
        let gray = idx ^ (idx >> 1);
        for ((value, directions), shift) in point.iter_mut().zip(&self.directions).zip(&self.shift)
        {
            let (mut digits, mut bits) = (*shift, gray);
            while bits != 0 {
                digits ^= directions[bits.trailing_zeros() as usize];
                bits &= bits - 1;
            }
            *value = f64::from(digits) / Self::N_POINTS as f64;
        }
        Ok(())
    }

    /// Multiplies the direction numbers of each dimension by a random lower triangular matrix over
    /// the two-element field, and draws its shift. As in `SciPy`, all shifts are drawn first, then
    /// all matrices including their upper triangles.
    fn scramble(&mut self, random: &mut NumpyRandom) {
        for shift in &mut self.shift {
            *shift = (0..N_BITS).fold(0, |digits, bit| digits | (random.bit() << bit));
        }
        for directions in &mut self.directions {
            // Row p computes digit p, counted from the most significant one, from the digits up to
            // p.
            let rows: [u32; N_BITS] = std::array::from_fn(|p| {
                let row = (0..N_BITS).fold(0, |row, k| row | (random.bit() << (N_BITS - 1 - k)));
                let up_to_diagonal = u32::MAX << (N_BITS - 1 - p);
                (row & up_to_diagonal) | (1 << (N_BITS - 1 - p))
            });
            for direction in directions {
                let old = *direction;
                *direction = rows.iter().fold(0, |digits, row| {
                    (digits << 1) | ((row & old).count_ones() & 1)
                });
            }
        }
    }
}

/// Direction numbers of one dimension, counted from 0, as fractions of 2³⁰ (Bratley and Fox 1988,
/// ACM Trans. Math. Softw. 14:88).
fn direction_numbers(dimension: usize) -> [u32; N_BITS] {
    let mut v = [1u32; N_BITS];
    if let Some((polynomial, first)) = dimension.checked_sub(1).map(|idx| DIMENSIONS[idx]) {
        let degree = first.len();
        v[..degree].copy_from_slice(first);
        for j in degree..N_BITS {
            v[j] = (1..=degree).fold(v[j - degree], |sum, k| {
                if (polynomial >> (degree - k)) & 1 == 1 {
                    sum ^ (v[j - k] << k)
                } else {
                    sum
                }
            });
        }
    }
    for (j, value) in v.iter_mut().enumerate() {
        *value <<= N_BITS - 1 - j;
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn first_points_are_sobol_s() {
        let points = SobolPoints::new(3, None).unwrap();
        let of = |idx| points.point(idx).unwrap();
        assert_eq!(of(0), [0.0, 0.0, 0.0]);
        assert_eq!(of(1), [0.5, 0.5, 0.5]);
        assert_eq!(of(2), [0.75, 0.25, 0.25]);
        assert_eq!(of(3), [0.25, 0.75, 0.75]);
        assert_eq!(of(4), [0.375, 0.375, 0.625]);
    }

    /// The first 2^m points of each dimension, scrambled or not, fill 2^m equal intervals with one
    /// point each. The pair of the first two dimensions fills the boxes of every shape.
    #[test]
    fn points_are_a_net() {
        for scramble in [None, Some(3)] {
            let sequence = SobolPoints::new(SobolPoints::LARGEST_DIMENSION, scramble).unwrap();
            for m in [1, 4, 8] {
                let n = 1usize << m;
                let points: Vec<Vec<f64>> =
                    (0..n as u64).map(|i| sequence.point(i).unwrap()).collect();
                for d in 0..sequence.n_dimensions() {
                    let mut taken = vec![false; n];
                    for point in &points {
                        assert!(!std::mem::replace(
                            &mut taken[(point[d] * n as f64) as usize],
                            true
                        ));
                    }
                }
                for split in 0..=m {
                    let (nx, ny) = (1usize << split, 1usize << (m - split));
                    let mut taken = vec![false; n];
                    for p in &points {
                        let cell = (p[0] * nx as f64) as usize * ny + (p[1] * ny as f64) as usize;
                        assert!(!std::mem::replace(&mut taken[cell], true));
                    }
                }
            }
        }
    }

    proptest! {
        /// Neighbours in Gray code order differ by one direction number, the recurrence of other
        /// implementations.
        #[test]
        fn random_access_agrees_with_the_recurrence(idx in 0u64..1 << 20, seed: u64) {
            let points = SobolPoints::new(5, Some(seed)).unwrap();
            let (here, next) = (points.point(idx).unwrap(), points.point(idx + 1).unwrap());
            let bit = (!idx).trailing_zeros() as usize;
            for d in 0..5 {
                let digits = |p: &[f64]| (p[d] * SobolPoints::N_POINTS as f64) as u32;
                prop_assert_eq!(digits(&here) ^ digits(&next), points.directions[d][bit]);
            }
        }
    }

    #[test]
    fn seeds_scramble_differently() {
        let of = |seed| SobolPoints::new(4, seed).unwrap().point(9).unwrap();
        assert_eq!(of(Some(1)), of(Some(1)));
        assert_ne!(of(Some(1)), of(Some(2)));
        assert_ne!(of(Some(1)), of(None));
    }

    #[test]
    fn too_much_is_refused() {
        assert!(SobolPoints::new(0, None).is_err());
        let message = SobolPoints::new(129, None).unwrap_err().to_string();
        assert!(
            message.contains("129 dimensions") && message.contains("1 to 128"),
            "{message}"
        );
        assert!(SobolPoints::new(2, None).unwrap().point(1 << 30).is_err());
    }
}
