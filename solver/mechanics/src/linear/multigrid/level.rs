//! One level: its matrix, its smoother, and the way to the next coarser one.

use faer::linalg::solvers::{Llt, Solve as _};
use pulp::{Arch, Simd, WithSimd};

use super::aggregates::aggregates;
use super::blocks::{Block, Blocks, Row, add_times, add_transposed_times, apply, inverse};

/// Unknowns at which a level is solved directly.
const DIRECT: usize = 1500;
/// Matrix products of a smoothing.
const DEGREE: usize = 2;
/// The smoother damps eigenvalues down to this share of the largest.
const SMOOTHED_SHARE: f32 = 0.1;
/// Products with which the largest eigenvalue is estimated.
const POWER_STEPS: usize = 15;

/// A matrix of `B` by `B` blocks with Chebyshev's iteration on Jacobi's as smoother, and the prolongation from the next
/// level, which has six unknowns a node: a rigid motion. `W` is `B` with padding.
#[derive(Debug)]
pub(super) struct Level<const W: usize, const B: usize> {
    matrix: Blocks<W, B>,
    inverses: Vec<Block<W, B>>,
    /// Largest eigenvalue of the matrix with Jacobi's preconditioner.
    largest: f32,
    prolongation: Blocks<W, 6>,
    n_coarse: usize,
    arch: Arch,
}

/// What lies below a level.
#[derive(Debug)]
pub(super) enum Coarse {
    /// Another level, and what lies below it.
    Level(Box<(Level<8, 6>, Coarse)>),
    /// A factorisation.
    Direct(Llt<f64>),
    /// Nothing: a matrix without a factorisation, which the smoother above has to do without.
    Nothing,
}

/// The rigid motions of a node about a centre: its place, the centre, 1/mm for rotations.
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
    /// The level of a matrix whose nodes are at `places`, and all below.
    pub(super) fn new(matrix: Blocks<W, B>, places: Vec<[f64; 3]>, rigid: &Rigid<'_, W>) -> (Self, Coarse) {
        let arch = Arch::new();
        let n = places.len();
        let inverses: Vec<_> = (0..n)
            .map(|row| {
                let slot = matrix.pattern.slot(row as u32, row as u32) as usize;
                inverse(matrix.blocks.get(slot).unwrap_or(&[[0.0; W]; B]))
            })
            .collect();
        let largest = 1.1 * largest_eigenvalue(&matrix, &inverses, arch);
        let (group, n_coarse) = aggregates(&matrix.pattern);
        let (centres, per_mm) = centres(&places, &group, n_coarse);
        let tentative: Vec<Block<W, 6>> = (0..n)
            .map(|k| {
                let g = group[k] as usize;
                rigid(&places[k], &centres[g], per_mm)
            })
            .collect();
        let prolongation = smoothed(&matrix, &inverses, 4.0 / (3.0 * largest), &group, &tentative);
        let below = galerkin(&matrix, &prolongation, n_coarse);
        let coarse = if 6 * n_coarse <= DIRECT || n_coarse == n {
            factorised(&below)
        } else {
            // A coarse node's unknowns are a translation and a rotation in units of its own level.
            let of_node = move |place: &[f64; 3], centre: &[f64; 3], next_per_mm: f64| {
                let [x, y, z]: [f32; 3] = std::array::from_fn(|i| ((place[i] - centre[i]) * next_per_mm) as f32);
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
            Coarse::Level(Box::new(Level::<8, 6>::new(below, centres, &of_node)))
        };
        (Self { matrix, inverses, largest, prolongation, n_coarse, arch }, coarse)
    }

    pub(super) fn n(&self) -> usize {
        self.inverses.len()
    }

    /// One V-cycle from zero.
    pub(super) fn cycle(&self, right: &[[f32; W]], below: &Coarse) -> Vec<[f32; W]> {
        let mut x = vec![[0.0; W]; right.len()];
        let mut residual = right.to_vec();
        self.smooth(&mut x, &mut residual);
        let mut coarse = vec![[0.0; 8]; self.n_coarse];
        self.arch.dispatch(Restriction(&self.prolongation, &residual, &mut coarse));
        let correction = below.solve(&coarse);
        self.arch.dispatch(Product(1.0, &self.prolongation, &correction, &mut x));
        residual.copy_from_slice(right);
        self.arch.dispatch(Product(-1.0, &self.matrix, &x, &mut residual));
        self.smooth(&mut x, &mut residual);
        x
    }

    /// Chebyshev's iteration; `residual` is that of `x`, before and after.
    ///
    /// Source: Saad 2003, Iterative Methods for Sparse Linear Systems, algorithm 12.1.
    fn smooth(&self, x: &mut [[f32; W]], residual: &mut [[f32; W]]) {
        let (low, high) = (SMOOTHED_SHARE * self.largest, self.largest);
        let (theta, delta) = (0.5 * (high + low), 0.5 * (high - low));
        let sigma = theta / delta;
        let mut rho = 1.0 / sigma;
        let mut d: Vec<[f32; W]> =
            self.inverses.iter().zip(&*residual).map(|(m, r)| apply(m, r).map(|z| z / theta)).collect();
        for step in 1.. {
            for (x, d) in x.iter_mut().zip(&d) {
                (0..W).for_each(|i| x[i] += d[i]);
            }
            self.arch.dispatch(Product(-1.0, &self.matrix, &d, residual));
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
            Self::Direct(factor) => out.push(faer::linalg::solvers::ShapeCore::nrows(factor)),
            Self::Nothing => {}
        }
    }

    fn solve(&self, right: &[[f32; 8]]) -> Vec<[f32; 8]> {
        match self {
            Self::Level(level) => level.0.cycle(right, &level.1),
            Self::Direct(factor) => {
                let mut x = faer::Col::from_fn(6 * right.len(), |k| f64::from(right[k / 6][k % 6]));
                factor.solve_in_place(&mut x);
                (0..right.len())
                    .map(|k| std::array::from_fn(|i| if i < 6 { x[6 * k + i] as f32 } else { 0.0 }))
                    .collect()
            }
            Self::Nothing => vec![[0.0; 8]; right.len()],
        }
    }
}

/// Power iteration from a fixed rough vector.
fn largest_eigenvalue<const W: usize, const B: usize>(
    matrix: &Blocks<W, B>,
    inverses: &[Block<W, B>],
    arch: Arch,
) -> f32 {
    let rough = |k: usize| (((k as f64) * 12.9898).sin() * 43_758.547).fract() as f32;
    let mut v: Vec<[f32; W]> =
        (0..inverses.len()).map(|k| std::array::from_fn(|i| if i < B { rough(k * B + i) } else { 0.0 })).collect();
    let mut size = 1.0;
    for _ in 0..POWER_STEPS {
        let norm = v.as_flattened().iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        v.as_flattened_mut().iter_mut().for_each(|x| *x = (f64::from(*x) / norm) as f32);
        let mut product = vec![[0.0; W]; v.len()];
        arch.dispatch(Product(1.0, matrix, &v, &mut product));
        for ((v, m), p) in v.iter_mut().zip(inverses).zip(&product) {
            *v = apply(m, p);
        }
        size = v.as_flattened().iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
    }
    (size as f32).max(f32::MIN_POSITIVE)
}

/// Mean place of each group's nodes, and one over the groups' mean radius.
fn centres(places: &[[f64; 3]], group: &[u32], n_groups: usize) -> (Vec<[f64; 3]>, f64) {
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
        .map(|(x, g)| (0..3).map(|i| (x[i] - centres[*g as usize][i]).powi(2)).sum::<f64>())
        .sum();
    let radius = (squares / places.len() as f64).sqrt();
    (centres, if radius > 0.0 { 1.0 / radius } else { 1.0 })
}

/// `(I − ω D⁻¹ A) T`, with `T` the groups' rigid motions.
fn smoothed<const W: usize, const B: usize>(
    matrix: &Blocks<W, B>,
    inverses: &[Block<W, B>],
    omega: f32,
    group: &[u32],
    tentative: &[Block<W, 6>],
) -> Blocks<W, 6> {
    let mut out = Blocks::empty();
    let mut row = Row::<W, 6>::new();
    for k in 0..group.len() {
        row.clear();
        for slot in matrix.pattern.row(k) {
            let other = matrix.pattern.column[slot] as usize;
            add_times(&matrix.blocks[slot], &tentative[other], row.at(group[other]));
        }
        for block in row.blocks_mut() {
            let mut scaled = [[0.0; W]; 6];
            add_times(&inverses[k], block, &mut scaled);
            *block = scaled.map(|column| column.map(|x| -omega * x));
        }
        let own = row.at(group[k]);
        for j in 0..6 {
            for i in 0..W {
                own[j][i] += tentative[k][j][i];
            }
        }
        row.append_to(&mut out);
    }
    out
}

/// `Pᵀ A P`.
fn galerkin<const W: usize, const B: usize>(matrix: &Blocks<W, B>, p: &Blocks<W, 6>, n_coarse: usize) -> Blocks<8, 6> {
    let n = p.pattern.n_rows();
    // Rows of P that reach a coarse node.
    let mut start = vec![0_u32; n_coarse + 1];
    for c in &p.pattern.column {
        start[*c as usize + 1] += 1;
    }
    for k in 0..n_coarse {
        start[k + 1] += start[k];
    }
    let mut next = start.clone();
    let mut reaching = vec![(0_u32, 0_u32); p.pattern.column.len()];
    for row in 0..n {
        for slot in p.pattern.row(row) {
            let at = &mut next[p.pattern.column[slot] as usize];
            reaching[*at as usize] = (row as u32, slot as u32);
            *at += 1;
        }
    }
    // A P, row by row.
    let mut product = Blocks::<W, 6>::empty();
    let mut row = Row::<W, 6>::new();
    for k in 0..n {
        row.clear();
        for slot in matrix.pattern.row(k) {
            for q in p.pattern.row(matrix.pattern.column[slot] as usize) {
                add_times(&matrix.blocks[slot], &p.blocks[q], row.at(p.pattern.column[q]));
            }
        }
        row.append_to(&mut product);
    }
    let mut out = Blocks::empty();
    let mut row = Row::<8, 6>::new();
    for c in 0..n_coarse {
        row.clear();
        for (k, slot) in &reaching[start[c] as usize..start[c + 1] as usize] {
            for q in product.pattern.row(*k as usize) {
                add_transposed_times(&p.blocks[*slot as usize], &product.blocks[q], row.at(product.pattern.column[q]));
            }
        }
        row.append_to(&mut out);
    }
    out
}

/// A dense factorisation; a hundred-thousandth of the diagonal is added, which holds rotations that a small group cannot make.
fn factorised(matrix: &Blocks<8, 6>) -> Coarse {
    let n = matrix.pattern.n_rows();
    let mut dense = faer::Mat::<f64>::zeros(6 * n, 6 * n);
    for row in 0..n {
        for slot in matrix.pattern.row(row) {
            let column = matrix.pattern.column[slot] as usize;
            for i in 0..6 {
                for j in 0..6 {
                    let half = 0.5 * f64::from(matrix.blocks[slot][j][i]);
                    dense[(6 * row + i, 6 * column + j)] += half;
                    dense[(6 * column + j, 6 * row + i)] += half;
                }
            }
        }
    }
    let largest = (0..6 * n).fold(0.0_f64, |m, k| m.max(dense[(k, k)].abs()));
    for k in 0..6 * n {
        dense[(k, k)] += 1e-5 * dense[(k, k)].abs() + 1e-9 * largest;
    }
    match dense.llt(faer::Side::Lower) {
        Ok(factor) => Coarse::Direct(factor),
        Err(_) => Coarse::Nothing,
    }
}
