//! A level of the hierarchy, with its matrix, its smoother, and the transfer to the next coarser
//! level.

use faer::linalg::solvers::{Llt, Solve as _};
use pulp::{Arch, Simd, WithSimd};

use super::aggregates::aggregates;
use super::blocks::{Block, Blocks, apply, inverse};
use super::coarsen::{galerkin, smoothed};
use super::halo::{Halo, first_numbers, localised, place_of};
use crate::parallel::{Communicator, Layout, Neighbour};

/// Number of unknowns below which a level is solved directly.
const DIRECT: usize = 1500;
/// Number of matrix products in a smoothing step.
const DEGREE: usize = 2;
/// Share of the largest eigenvalue down to which the smoother damps.
const SMOOTHED_SHARE: f32 = 0.1;
/// Number of products for the estimate of the largest eigenvalue.
const POWER_STEPS: usize = 15;

/// A matrix of `B` by `B` blocks, a Chebyshev–Jacobi smoother, and the prolongation from the next
/// level, which has six unknowns per node (a rigid motion). `W` is `B` with padding. A rank holds
/// the rows of its own nodes.
#[derive(Debug)]
pub(super) struct Level<const W: usize, const B: usize> {
    halo: Halo,
    matrix: Blocks<W, B>,
    inverses: Vec<Block<W, B>>,
    /// Largest eigenvalue of the Jacobi-preconditioned matrix.
    largest: f32,
    prolongation: Blocks<W, 6>,
    /// Distribution of the next level's nodes.
    below: Halo,
    arch: Arch,
}

/// The coarser part of the hierarchy below a level.
#[derive(Debug)]
pub(super) enum Coarse {
    /// A further level, and the hierarchy below it.
    Level(Box<(Level<8, 6>, Coarse)>),
    /// A factorisation of all ranks' rows, on each rank.
    Direct(Box<Factor>),
    /// No coarser level, because the matrix has no factorisation; only the smoother of the level
    /// above acts.
    Nothing,
}

/// Factorisation of a matrix of all ranks.
#[derive(Debug)]
pub(super) struct Factor {
    factor: Llt<f64>,
    /// Exchange of every rank's rows with all other ranks.
    all: Halo,
    /// Global numbers of the nodes that this rank holds, own ones first.
    numbers: Vec<u32>,
    n_owned: usize,
}

/// Rigid motions of a node about a centre. Arguments: position of the node, centre, and inverse
/// length scale of rotations \[1/mm\].
pub(super) type Rigid<'a, const W: usize> = dyn Fn(&[f64; 3], &[f64; 3], f64) -> Block<W, 6> + 'a;

struct Product<'a, const W: usize, const C: usize, const V: usize>(
    f32,
    &'a Blocks<W, C>,
    &'a [[f32; V]],
    &'a mut [[f32; W]],
);

impl<const W: usize, const C: usize, const V: usize> WithSimd for Product<'_, W, C, V> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        self.1.add_product(self.0, self.2, self.3);
    }
}

struct Restriction<'a, const W: usize>(&'a Blocks<W, 6>, &'a [[f32; W]], &'a mut [[f32; 8]]);

impl<const W: usize> WithSimd for Restriction<'_, W> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        self.0.transposed_product(self.1, self.2);
    }
}

impl<const W: usize, const B: usize> Level<W, B> {
    /// Builds the level of a matrix whose nodes, including ghosts, are at `places`, and all levels
    /// below. Collective.
    pub(super) fn new(
        comm: &dyn Communicator,
        layout: &Layout,
        matrix: Blocks<W, B>,
        places: &[[f64; 3]],
        rigid: &Rigid<'_, W>,
    ) -> (Self, Coarse) {
        let arch = Arch::new();
        let halo = Halo::new(layout);
        let n = halo.n_owned;
        let inverses: Vec<_> = (0..n)
            .map(|row| {
                let slot = matrix
                    .pattern
                    .row(row)
                    .find(|k| matrix.pattern.column[*k] as usize == row);
                inverse(slot.map_or(&[[0.0; W]; B], |slot| &matrix.blocks[slot]))
            })
            .collect();
        let largest = 1.1 * largest_eigenvalue(comm, &halo, &matrix, &inverses, arch);
        let (own_group, n_groups) = aggregates(&matrix.pattern);
        let first = first_numbers(comm, n_groups);
        let (begin, n_coarse) = (first[comm.rank()], first[first.len() - 1] as usize);
        let (centres, per_mm) = centres(comm, &places[..n], &own_group, n_groups);
        // Number and centre of the group of each node held.
        let mut groups = vec![[0.0; 4]; halo.n_local];
        for (to, g) in groups.iter_mut().zip(&own_group) {
            let [x, y, z] = centres[*g as usize];
            *to = [f64::from(begin + g), x, y, z];
        }
        halo.update_double(comm, 4, groups.as_flattened_mut());
        let tentative: Vec<Block<W, 6>> = places
            .iter()
            .zip(&groups)
            .map(|(place, [_, x, y, z])| rigid(place, &[*x, *y, *z], per_mm))
            .collect();
        let group: Vec<u32> = groups.iter().map(|[number, ..]| *number as u32).collect();
        let mut prolongation = smoothed(
            &matrix,
            &inverses,
            4.0 / (3.0 * largest),
            &group,
            &tentative,
        );
        let mut next = galerkin(comm, &halo, &matrix, &prolongation, &first);
        let mut n_fine = [n as f64];
        comm.sum(&mut n_fine);
        let is_last = 6 * n_coarse <= DIRECT || n_coarse == n_fine[0] as usize;
        let dense = is_last.then(|| factorised(comm, &next, &first)).flatten();
        let (layout, ghosts) = localised(&mut next.pattern, &first, comm.rank());
        prolongation
            .pattern
            .column
            .iter_mut()
            .for_each(|c| *c = place_of(begin, n_groups, &ghosts, *c));
        let below = Halo::new(&layout);
        let coarse = match dense {
            Some((factor, all)) => {
                let numbers = (begin..begin + n_groups as u32).chain(ghosts).collect();
                Coarse::Direct(Box::new(Factor {
                    factor,
                    all,
                    numbers,
                    n_owned: n_groups,
                }))
            }
            None if is_last => Coarse::Nothing,
            None => {
                let mut places = centres;
                places.resize(below.n_local, [0.0; 3]);
                below.update_double(comm, 3, places.as_flattened_mut());
                // Unknowns of a coarse node are a translation and a rotation, in units of its own
                // level.
                let of_node = move |place: &[f64; 3], centre: &[f64; 3], next_per_mm: f64| {
                    let [x, y, z]: [f32; 3] =
                        std::array::from_fn(|i| ((place[i] - centre[i]) * next_per_mm) as f32);
                    let turn = (next_per_mm / per_mm) as f32;
                    [
                        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                        [0.0, -z, y, turn, 0.0, 0.0, 0.0, 0.0],
                        [z, 0.0, -x, 0.0, turn, 0.0, 0.0, 0.0],
                        [-y, x, 0.0, 0.0, 0.0, turn, 0.0, 0.0],
                    ]
                };
                Coarse::Level(Box::new(Level::<8, 6>::new(
                    comm, &layout, next, &places, &of_node,
                )))
            }
        };
        (
            Self {
                halo,
                matrix,
                inverses,
                largest,
                prolongation,
                below,
                arch,
            },
            coarse,
        )
    }

    pub(super) fn n(&self) -> usize {
        self.inverses.len()
    }

    /// One V-cycle from zero for own nodes; the values of ghosts in the result are undefined.
    /// Collective.
    pub(super) fn cycle(
        &self,
        comm: &dyn Communicator,
        right: &[[f32; W]],
        below: &Coarse,
    ) -> Vec<[f32; W]> {
        let n = self.n();
        let mut x = vec![[0.0; W]; self.halo.n_local];
        let mut residual = right.to_vec();
        self.smooth(comm, &mut x, &mut residual, true);
        let mut coarse = vec![[0.0; 8]; self.below.n_local];
        self.arch
            .dispatch(Restriction(&self.prolongation, &residual, &mut coarse));
        self.below.add_back(comm, 6, &mut coarse);
        let correction = below.solve(comm, &self.below, &coarse[..self.below.n_owned]);
        self.arch
            .dispatch(Product(1.0, &self.prolongation, &correction, &mut x[..n]));
        self.halo.update(comm, B, &mut x);
        residual.copy_from_slice(right);
        self.arch
            .dispatch(Product(-1.0, &self.matrix, &x, &mut residual));
        self.smooth(comm, &mut x, &mut residual, false);
        x
    }

    /// Chebyshev iteration. `residual` is the residual of `x` on entry, and also on return if it
    /// `is_wanted`. Collective.
    ///
    /// Source: Saad 2003, Iterative Methods for Sparse Linear Systems, algorithm 12.1.
    fn smooth(
        &self,
        comm: &dyn Communicator,
        x: &mut [[f32; W]],
        residual: &mut [[f32; W]],
        is_wanted: bool,
    ) {
        let (low, high) = (SMOOTHED_SHARE * self.largest, self.largest);
        let (theta, delta) = (0.5 * (high + low), 0.5 * (high - low));
        let sigma = theta / delta;
        let mut rho = 1.0 / sigma;
        let mut d: Vec<[f32; W]> = self
            .inverses
            .iter()
            .zip(&*residual)
            .map(|(m, r)| apply(m, r).map(|z| z / theta))
            .collect();
        d.resize(x.len(), [0.0; W]);
        for step in 1.. {
            self.halo.update(comm, B, &mut d);
            for (x, d) in x.iter_mut().zip(&d) {
                (0..W).for_each(|i| x[i] += d[i]);
            }
            if step == DEGREE && !is_wanted {
                return;
            }
            self.arch
                .dispatch(Product(-1.0, &self.matrix, &d, residual));
            if step == DEGREE {
                return;
            }
            let next = 1.0 / (2.0 * sigma - rho);
            for ((d, m), r) in d.iter_mut().zip(&self.inverses).zip(&*residual) {
                let z = apply(m, r);
                (0..W).for_each(|i| d[i] = next * rho * d[i] + 2.0 * next / delta * z[i]);
            }
            rho = next;
        }
    }
}

impl Coarse {
    pub(super) fn sizes(&self, out: &mut Vec<usize>) {
        match self {
            Self::Level(level) => {
                out.push(6 * level.0.n());
                level.1.sizes(out);
            }
            Self::Direct(factor) => {
                out.push(faer::linalg::solvers::ShapeCore::nrows(&factor.factor))
            }
            Self::Nothing => {}
        }
    }

    /// Solution at all held nodes, for a right-hand side on own nodes. Collective.
    fn solve(&self, comm: &dyn Communicator, halo: &Halo, right: &[[f32; 8]]) -> Vec<[f32; 8]> {
        match self {
            Self::Level(level) => {
                let mut x = level.0.cycle(comm, right, &level.1);
                halo.update(comm, 6, &mut x);
                x
            }
            Self::Direct(factor) => factor.solve(comm, right),
            Self::Nothing => vec![[0.0; 8]; halo.n_local],
        }
    }
}

impl Factor {
    fn solve(&self, comm: &dyn Communicator, right: &[[f32; 8]]) -> Vec<[f32; 8]> {
        let mut all = vec![0.0; 6 * self.all.n_local];
        for (number, right) in self.numbers[..self.n_owned].iter().zip(right) {
            (0..6).for_each(|i| all[6 * *number as usize + i] = f64::from(right[i]));
        }
        self.all.update_double(comm, 6, &mut all);
        let mut x = faer::Col::from_fn(all.len(), |k| all[k]);
        self.factor.solve_in_place(&mut x);
        let of = |number: &u32| {
            std::array::from_fn(|i| {
                if i < 6 {
                    x[6 * *number as usize + i] as f32
                } else {
                    0.0
                }
            })
        };
        self.numbers.iter().map(of).collect()
    }
}

/// Power iteration from a fixed irregular vector. Collective.
fn largest_eigenvalue<const W: usize, const B: usize>(
    comm: &dyn Communicator,
    halo: &Halo,
    matrix: &Blocks<W, B>,
    inverses: &[Block<W, B>],
    arch: Arch,
) -> f32 {
    let n = inverses.len();
    let rough = |k: usize| (((k as f64) * 12.9898).sin() * 43_758.547).fract() as f32;
    let of_node = |k: usize| {
        std::array::from_fn(|i| {
            if i < B && k < n {
                rough(k * B + i)
            } else {
                0.0
            }
        })
    };
    let mut v: Vec<[f32; W]> = (0..halo.n_local).map(of_node).collect();
    let norm = |v: &[[f32; W]]| {
        let mut square = [v[..n]
            .as_flattened()
            .iter()
            .map(|x| f64::from(*x).powi(2))
            .sum::<f64>()];
        comm.sum(&mut square);
        square[0].sqrt()
    };
    let mut size = 1.0;
    for _ in 0..POWER_STEPS {
        let scale = norm(&v).max(f64::MIN_POSITIVE);
        v.as_flattened_mut()
            .iter_mut()
            .for_each(|x| *x = (f64::from(*x) / scale) as f32);
        halo.update(comm, B, &mut v);
        let mut product = vec![[0.0; W]; n];
        arch.dispatch(Product(1.0, matrix, &v, &mut product));
        for ((v, m), p) in v.iter_mut().zip(inverses).zip(&product) {
            *v = apply(m, p);
        }
        size = norm(&v);
    }
    (size as f32).max(f32::MIN_POSITIVE)
}

/// Mean position of each group's nodes, and the inverse of the mean radius of all groups.
/// Collective.
fn centres(
    comm: &dyn Communicator,
    places: &[[f64; 3]],
    group: &[u32],
    n_groups: usize,
) -> (Vec<[f64; 3]>, f64) {
    let mut centres = vec![[0.0; 3]; n_groups];
    let mut counts = vec![0.0; n_groups];
    for (x, g) in places.iter().zip(group) {
        counts[*g as usize] += 1.0;
        (0..3).for_each(|i| centres[*g as usize][i] += x[i]);
    }
    for (c, n) in centres.iter_mut().zip(&counts) {
        *c = c.map(|x| x / n);
    }
    let squares: f64 = places
        .iter()
        .zip(group)
        .map(|(x, g)| {
            (0..3)
                .map(|i| (x[i] - centres[*g as usize][i]).powi(2))
                .sum::<f64>()
        })
        .sum();
    let mut sums = [squares, places.len() as f64];
    comm.sum(&mut sums);
    let radius = (sums[0] / sums[1]).sqrt();
    (centres, if radius > 0.0 { 1.0 / radius } else { 1.0 })
}

/// Dense factorisation of all ranks' rows, on each rank; `None` if the matrix is not positive
/// definite. A hundred-thousandth of the diagonal is added, because small groups do not determine
/// all rotations. Collective.
fn factorised(
    comm: &dyn Communicator,
    matrix: &Blocks<8, 6>,
    first: &[u32],
) -> Option<(Llt<f64>, Halo)> {
    let (rank, n) = (comm.rank(), first[first.len() - 1]);
    let own: Vec<u32> = (first[rank]..first[rank + 1]).collect();
    let other = |other: usize| {
        let receive = (first[other]..first[other + 1]).collect();
        Neighbour {
            rank: other,
            send: own.clone(),
            receive,
        }
    };
    let neighbours = (0..comm.n_ranks())
        .filter(|r| *r != rank)
        .map(other)
        .collect();
    let all = Halo::new(&Layout {
        n_owned: own.len(),
        n_local: n as usize,
        neighbours,
    });
    // Row, column and values of each block, one block after the other.
    let mut entries = vec![];
    for (row, number) in own.iter().enumerate() {
        for slot in matrix.pattern.row(row) {
            entries.extend([f64::from(*number), f64::from(matrix.pattern.column[slot])]);
            entries.extend(
                matrix.blocks[slot]
                    .iter()
                    .flat_map(|column| &column[..6])
                    .map(|x| f64::from(*x)),
            );
        }
    }
    let mut lists = all.exchange(comm, &vec![entries.clone(); all.neighbours().len()]);
    lists.push(entries);
    let n = 6 * n as usize;
    let mut dense = faer::Mat::<f64>::zeros(n, n);
    for entry in lists.iter().flat_map(|list| list.as_chunks::<38>().0) {
        let (row, column) = (6 * entry[0] as usize, 6 * entry[1] as usize);
        for i in 0..6 {
            for j in 0..6 {
                let half = 0.5 * entry[2 + 6 * j + i];
                dense[(row + i, column + j)] += half;
                dense[(column + j, row + i)] += half;
            }
        }
    }
    let largest = (0..n).fold(0.0_f64, |m, k| m.max(dense[(k, k)].abs()));
    for k in 0..n {
        dense[(k, k)] += 1e-5 * dense[(k, k)].abs() + 1e-9 * largest;
    }
    Some((dense.llt(faer::Side::Lower).ok()?, all))
}
