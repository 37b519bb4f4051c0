//! The last level: the inverse of all groups' stiffness together, by rows.

use std::collections::BTreeMap;

use faer::linalg::solvers::Solve as _;

use super::motion::{Block6, Six, moment_about, motion_about_origin, stiffness_about};
use crate::parallel::Communicator;

/// Share of the diagonal that is added, since small groups do not determine all rotations.
const RIDGE: f64 = 1e-7;

/// Rows of the inverse for the motions of this rank's groups about their centres, in single precision.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coarse {
    /// Number of this rank's first group, and of all groups.
    first: usize,
    n_groups: usize,
    centres: Vec<[f64; 3]>,
    /// Unit of rotations \[1/mm\].
    per_mm: f64,
    rows: Vec<f32>,
}

/// Sums over the ranks before this one, and over all of them. Collective.
pub(super) fn first_and_all(comm: &dyn Communicator, own: usize) -> (usize, usize) {
    let mut counts = vec![0.0; comm.n_ranks()];
    counts[comm.rank()] = own as f64;
    comm.sum(&mut counts);
    let sum = |counts: &[f64]| counts.iter().sum::<f64>() as usize;
    (sum(&counts[..comm.rank()]), sum(&counts))
}

impl Coarse {
    /// `None`, on all ranks, where the stiffness is not positive definite. Collective.
    ///
    /// - `centres`: of own groups
    /// - `pairs`: this rank's contributions, about the origin
    pub fn new(
        comm: &dyn Communicator,
        centres: Vec<[f64; 3]>,
        per_mm: f64,
        pairs: &BTreeMap<(u32, u32), Block6>,
    ) -> Option<Self> {
        let (first, n_groups) = first_and_all(comm, centres.len());
        let n = 6 * n_groups;
        let mut message = vec![centres.len() as f64];
        message.extend(centres.as_flattened());
        for ((row, column), block) in pairs {
            message.extend([f64::from(*row), f64::from(*column)]);
            message.extend(block);
        }
        let mut inverse = vec![0.0; n * n + 1];
        if let Some(messages) = comm.gather(&message)
            && let Some(found) = inverted(n, per_mm, &messages)
        {
            inverse[0] = 1.0;
            inverse[1..].copy_from_slice(&found);
        }
        comm.broadcast(&mut inverse);
        if inverse[0] == 0.0 {
            return None;
        }
        let own = 1 + 6 * first * n..1 + 6 * (first + centres.len()) * n;
        let rows = inverse[own].iter().map(|x| *x as f32).collect();
        Some(Self {
            first,
            n_groups,
            centres,
            per_mm,
            rows,
        })
    }

    /// Motions of own groups about the origin, for forces and moments about the origin. Collective.
    pub fn solve(&self, comm: &dyn Communicator, forces: &[Six]) -> Vec<Six> {
        let n = 6 * self.n_groups;
        let mut all = vec![0.0; n];
        for (k, (force, centre)) in forces.iter().zip(&self.centres).enumerate() {
            let about = moment_about(*centre, force);
            for i in 0..6 {
                let unit = if i < 3 { 1.0 } else { self.per_mm };
                all[6 * (self.first + k) + i] = unit * about[i];
            }
        }
        comm.sum(&mut all);
        // No value is too small for single precision.
        let largest = all.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        if !(largest > 0.0) {
            return vec![[0.0; 6]; self.centres.len()];
        }
        let single: Vec<f32> = all.iter().map(|x| (x / largest) as f32).collect();
        let of_group = |(k, centre): (usize, &[f64; 3])| {
            let about: Six = std::array::from_fn(|i| {
                let row = &self.rows[(6 * k + i) * n..(6 * k + i + 1) * n];
                let unit = if i < 3 { 1.0 } else { self.per_mm };
                unit * largest * f64::from(dot(row, &single))
            });
            motion_about_origin(*centre, &about)
        };
        self.centres.iter().enumerate().map(of_group).collect()
    }

    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let head = [
            self.first as f64,
            self.n_groups as f64,
            self.per_mm,
            self.centres.len() as f64,
        ];
        let rows = self.rows.iter().map(|x| f64::from(*x));
        head.into_iter()
            .chain(self.centres.as_flattened().iter().copied())
            .chain(rows)
    }

    pub fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (head, rest) = numbers.split_first_chunk::<4>()?;
        let [first, n_groups, own] = [head[0], head[1], head[3]].map(|x| x as usize);
        let (centres, rows) = rest.split_at_checked(own.checked_mul(3)?)?;
        (rows.len() == own.checked_mul(36)?.checked_mul(n_groups)?).then(|| Self {
            first,
            n_groups,
            per_mm: head[2],
            centres: centres.as_chunks().0.to_vec(),
            rows: rows.iter().map(|x| *x as f32).collect(),
        })
    }
}

/// Inverse of the whole stiffness about the groups' centres, from the messages of all ranks.
fn inverted(n: usize, per_mm: f64, messages: &[Vec<f64>]) -> Option<Vec<f64>> {
    let mut centres = vec![];
    let mut blocks = vec![];
    for message in messages {
        let (count, rest) = message.split_first()?;
        let (own, pairs) = rest.split_at(3 * *count as usize);
        centres.extend_from_slice(own.as_chunks::<3>().0);
        blocks.extend_from_slice(pairs.as_chunks::<38>().0);
    }
    let mut dense = faer::Mat::<f64>::zeros(n, n);
    for block in &blocks {
        let (row, column) = (block[0] as usize, block[1] as usize);
        let about_origin: &Block6 = block[2..].first_chunk()?;
        let centred = stiffness_about(centres[row], centres[column], about_origin);
        for i in 0..6 {
            for j in 0..6 {
                let unit = |k: usize| if k < 3 { 1.0 } else { per_mm };
                let half = 0.5 * unit(i) * unit(j) * centred[6 * i + j];
                dense[(6 * row + i, 6 * column + j)] += half;
                dense[(6 * column + j, 6 * row + i)] += half;
            }
        }
    }
    let largest = (0..n).fold(0.0_f64, |m, k| m.max(dense[(k, k)].abs()));
    for k in 0..n {
        dense[(k, k)] += RIDGE * dense[(k, k)].abs() + 1e-3 * RIDGE * largest;
    }
    let factor = dense.llt(faer::Side::Lower).ok()?;
    let mut inverse = faer::Mat::<f64>::identity(n, n);
    factor.solve_in_place(&mut inverse);
    let symmetric = |i: usize, j: usize| 0.5 * (inverse[(i, j)] + inverse[(j, i)]);
    Some(
        (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .map(|(i, j)| symmetric(i, j))
            .collect(),
    )
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a16, a_rest) = a.as_chunks::<16>();
    let (b16, b_rest) = b.as_chunks::<16>();
    let mut sums = [0.0; 16];
    for (x, y) in a16.iter().zip(b16) {
        for k in 0..16 {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f32>() + rest
}
