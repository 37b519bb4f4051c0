//! Forces and stiffness of a batch of elements.
//!
//! Positions are in space and gradients in the fibre frame: `F = Σ xₐ ⊗ gₐ` maps the fibre frame to space, so that `C = FᵀF`
//! has the material's axes. Forces are `f_a = ∫ F S gₐ`, and the stiffness is `K_ab = ∫ BₐᵀD B_b + (gₐ·S g_b) I`.

use pulp::Simd;

use super::batch::Batch;
use super::shape::LINEAR;
use super::{BATCH, Eight};
use crate::material::tensor::{Sym, at};
use crate::material::{Load, Tissue, respond};
use crate::number::{Lanes, Real};

/// Number of node pairs `a ≤ b` of the largest element.
pub const MAX_PAIRS: usize = 55;

/// Active stress at each integration point of a batch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActivePoint {
    /// Active stress along the fibre \[kPa\].
    pub sa_kpa: Eight,
    /// Derivative of the active stress with respect to the fibre stretch \[kPa\].
    pub slope_kpa: Eight,
}

impl ActivePoint {
    /// Value for tissue without active stress.
    pub const NONE: Self = Self {
        sa_kpa: [0.0; BATCH],
        slope_kpa: [0.0; BATCH],
    };
}

/// Nodal values of a batch.
#[derive(Debug, Clone)]
pub struct Gathered<const N: usize> {
    /// Positions of the nodes in space \[mm\].
    pub x: [[Eight; 3]; N],
    /// Pressures at the vertices from averaged volume changes \[kPa\].
    pub pressure: [Eight; 4],
    /// Velocities \[mm/ms\], used in viscous tissue alone.
    pub velocity: [[Eight; 3]; N],
}

impl<const N: usize> Gathered<N> {
    /// A batch of zeros.
    #[must_use]
    pub fn zeros() -> Self {
        Self {
            x: [[[0.0; BATCH]; 3]; N],
            pressure: [[0.0; BATCH]; 4],
            velocity: [[[0.0; BATCH]; 3]; N],
        }
    }
}

/// Viscosity of a moving tissue: `S = η Ė`, from the pseudo-potential `η/2 tr Ė²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viscous {
    /// Viscosity η \[kPa·ms\], zero for none.
    pub viscosity_kpa_ms: f64,
    /// `∂v/∂u` of the time integration \[1/ms\].
    pub velocity_rate_per_ms: f64,
}

impl Viscous {
    /// Value for tissue without viscosity.
    pub const NONE: Self = Self {
        viscosity_kpa_ms: 0.0,
        velocity_rate_per_ms: 0.0,
    };
}

/// Output of the kernel, summed over integration points.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct Scratch<const N: usize> {
    /// Force on each node \[mN\].
    pub force: [[Eight; 3]; N],
    /// Stiffness of the node pairs `a ≤ b` \[mN/mm\], stored at [`pair`].
    pub stiffness: [[Eight; 9]; MAX_PAIRS],
    /// Derivative of each vertex's share of the deformed volume with respect to each node's position \[mm²\].
    pub coupling: [[[Eight; 3]; 4]; N],
}

impl<const N: usize> Scratch<N> {
    /// Output filled with zeros.
    #[must_use]
    pub fn new() -> Box<Self> {
        Box::new(Self {
            force: [[[0.0; BATCH]; 3]; N],
            stiffness: [[[0.0; BATCH]; 9]; MAX_PAIRS],
            coupling: [[[[0.0; BATCH]; 3]; 4]; N],
        })
    }
}

/// Index of the pair `a ≤ b` of an element with `n` nodes.
#[inline(always)]
#[must_use]
pub const fn pair(n: usize, a: usize, b: usize) -> usize {
    a * n + b - a * (a + 1) / 2
}

/// How elements resist a change of volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VolumeChange {
    /// A penalty at every integration point (P1/P0 for linear elements, as in the paper).
    Pointwise,
    /// A penalty on each vertex's average over its elements. A pointwise share removes the spurious modes of linear elements.
    Nodal {
        /// Share of κ that stays pointwise, 0 to 1.
        pointwise_share: f64,
    },
}

impl VolumeChange {
    /// Share of κ at the integration points.
    #[inline(always)]
    #[must_use]
    pub fn pointwise(self) -> f64 {
        match self {
            Self::Pointwise => 1.0,
            Self::Nodal { pointwise_share } => pointwise_share,
        }
    }
}

/// The first `K` columns of the deformation gradient `F` at an integration point.
#[inline(always)]
fn deformation<S: Simd, const N: usize, const K: usize>(
    simd: S,
    x: &[[Eight; 3]; N],
    grad: &[[Eight; 3]; N],
    lane: usize,
) -> [[Lanes<S>; K]; 3] {
    let mut f = [[Lanes::splat(simd, 0.0); K]; 3];
    for a in 0..N {
        for k in 0..K {
            let g = Lanes::load(simd, &grad[a][k][lane..]);
            for i in 0..3 {
                f[i][k] = Lanes::load(simd, &x[a][i][lane..]).mul_add(g, f[i][k]);
            }
        }
    }
    f
}

#[inline(always)]
fn add<S: Simd>(simd: S, to: &mut Eight, lane: usize, x: Lanes<S>) {
    (Lanes::load(simd, &to[lane..]) + x).store(&mut to[lane..]);
}

#[inline(always)]
fn cofactor<R: Real>(f: &[[R; 3]; 3]) -> [[R; 3]; 3] {
    let mut out = *f;
    for r in 0..3 {
        for c in 0..3 {
            let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
            out[r][c] = f[r1][c1] * f[r2][c2] - f[r1][c2] * f[r2][c1];
        }
    }
    out
}

/// Squared length of the first column of `F`.
#[inline(always)]
fn squared_fibre<R: Real, const K: usize>(f: &[[R; K]; 3]) -> R {
    f[0][0].mul_add(f[0][0], f[1][0].mul_add(f[1][0], f[2][0] * f[2][0]))
}

/// Volume ratio and squared fibre stretch at each integration point.
#[inline(always)]
pub fn volume_and_stretch<S: Simd, const N: usize, const Q: usize>(
    simd: S,
    batch: &Batch<N, Q>,
    x: &[[Eight; 3]; N],
    volume_ratio: &mut [Eight; Q],
    squared_stretch: &mut [Eight; Q],
) {
    for lane in (0..BATCH).step_by(S::F64_LANES) {
        for q in 0..Q {
            let f = deformation(simd, x, &batch.points[q].grad, lane);
            let cof = cofactor(&f);
            let j = f[0][0].mul_add(cof[0][0], f[0][1].mul_add(cof[0][1], f[0][2] * cof[0][2]));
            j.store(&mut volume_ratio[q][lane..]);
            squared_fibre(&f).store(&mut squared_stretch[q][lane..]);
        }
    }
}

/// Squared fibre stretch at each integration point, which reads a third of the gradients.
#[inline(always)]
pub fn squared_stretch<S: Simd, const N: usize, const Q: usize>(
    simd: S,
    batch: &Batch<N, Q>,
    x: &[[Eight; 3]; N],
    out: &mut [Eight; Q],
) {
    for lane in (0..BATCH).step_by(S::F64_LANES) {
        for q in 0..Q {
            let fibre: [[Lanes<S>; 1]; 3] = deformation(simd, x, &batch.points[q].grad, lane);
            squared_fibre(&fibre).store(&mut out[q][lane..]);
        }
    }
}

/// Adds forces and, with `TANGENT`, stiffness and volume coupling of a batch to `out`. With a single integration point they
/// overwrite it; the coupling of a linear element is then stored for the first vertex only, as it is equal for all four.
///
/// - `shape`: linear shape functions of the vertices at each integration point
/// - `active`: active stress at each integration point
///
/// The viscous tangent holds `∂Ė/∂v ∂v/∂u`, but not the change of `Ė` with `F` at fixed velocity: that part is unsymmetric and
/// smaller by the strain of a time step.
#[inline(always)]
#[expect(
    clippy::too_many_arguments,
    reason = "what an element needs, each of its own kind"
)]
pub fn element<S: Simd, const N: usize, const Q: usize, const TANGENT: bool>(
    simd: S,
    tissue: &Tissue,
    viscous: Viscous,
    volume: VolumeChange,
    shape: &[[f64; 4]; Q],
    batch: &Batch<N, Q>,
    input: &Gathered<N>,
    active: &[ActivePoint],
    out: &mut Scratch<N>,
) {
    for lane in (0..BATCH).step_by(S::F64_LANES) {
        for q in 0..Q {
            point::<S, N, Q, TANGENT>(
                simd, tissue, viscous, volume, &shape[q], batch, input, &active[q], out, lane, q,
            );
        }
    }
}

#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "the inner half of `element`")]
fn point<S: Simd, const N: usize, const Q: usize, const TANGENT: bool>(
    simd: S,
    tissue: &Tissue,
    viscous: Viscous,
    volume: VolumeChange,
    shape: &[f64; 4],
    batch: &Batch<N, Q>,
    input: &Gathered<N>,
    active: &ActivePoint,
    out: &mut Scratch<N>,
    lane: usize,
    q: usize,
) {
    let zero = Lanes::splat(simd, 0.0);
    let grad = &batch.points[q].grad;
    let weight = Lanes::load(simd, &batch.points[q].weight[lane..]);
    let f: [[Lanes<S>; 3]; 3] = deformation(simd, &input.x, grad, lane);
    let cof = cofactor(&f);
    let j = f[0][0].mul_add(cof[0][0], f[0][1].mul_add(cof[0][1], f[0][2] * cof[0][2]));
    let mut c: Sym<Lanes<S>> = [zero; 6];
    for (k, (m, n)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        .into_iter()
        .enumerate()
    {
        c[k] = f[0][m].mul_add(f[0][n], f[1][m].mul_add(f[1][n], f[2][m] * f[2][n]));
    }
    let (slope, curvature) = tissue.volumetric.law.slopes(j);
    let kappa = volume.pointwise() * tissue.volumetric.kappa_kpa;
    let mut pressure = slope.times(kappa);
    if let VolumeChange::Nodal { .. } = volume {
        for v in 0..4 {
            pressure = Lanes::load(simd, &input.pressure[v][lane..])
                .mul_add(zero.like(shape[v]), pressure);
        }
    }
    let load = Load {
        pressure,
        bulk: curvature.times(kappa),
        active: Lanes::load(simd, &active.sa_kpa[lane..]),
        active_slope: Lanes::load(simd, &active.slope_kpa[lane..]),
    };
    let response = respond::<Lanes<S>, TANGENT>(tissue, &c, j, &load);
    let (mut s, mut d) = (response.s, response.d);
    if viscous.viscosity_kpa_ms > 0.0 {
        let rate: [[Lanes<S>; 3]; 3] = deformation(simd, &input.velocity, grad, lane);
        for (k, (m, n)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
            .into_iter()
            .enumerate()
        {
            let mut twice = zero;
            for i in 0..3 {
                twice = f[i][m].mul_add(rate[i][n], f[i][n].mul_add(rate[i][m], twice));
            }
            s[k] = twice.times(0.5 * viscous.viscosity_kpa_ms) + s[k];
            // D acts on engineering shear strains.
            let share = if k < 3 { 1.0 } else { 0.5 };
            let stiffness = share * viscous.viscosity_kpa_ms * viscous.velocity_rate_per_ms;
            d[at(k, k)] = d[at(k, k)] + zero.like(stiffness);
        }
    }
    for k in 0..6 {
        s[k] = s[k] * weight;
    }
    let full = [[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]];
    // The shape-function gradients of a linear element sum to zero, so the first node's terms follow from the others'.
    let first = if N == LINEAR { 1 } else { 0 };
    let mut g = [[zero; 3]; N];
    // S gₐ enters both the force F S gₐ and the geometric stiffness gₐ·S g_b.
    let mut sg = [[zero; 3]; N];
    for a in first..N {
        for k in 0..3 {
            g[a][k] = Lanes::load(simd, &grad[a][k][lane..]);
        }
        for k in 0..3 {
            sg[a][k] =
                full[k][0].mul_add(g[a][0], full[k][1].mul_add(g[a][1], full[k][2] * g[a][2]));
        }
    }
    let mut rest = [zero; 3];
    for a in first..N {
        for i in 0..3 {
            let force = f[i][0].mul_add(sg[a][0], f[i][1].mul_add(sg[a][1], f[i][2] * sg[a][2]));
            put::<S, Q>(simd, &mut out.force[a][i], lane, force);
            rest[i] = rest[i] - force;
        }
    }
    if N == LINEAR {
        for i in 0..3 {
            put::<S, Q>(simd, &mut out.force[0][i], lane, rest[i]);
        }
    }
    if !TANGENT {
        return;
    }
    if let VolumeChange::Nodal { .. } = volume {
        // At the centre of a linear element all vertices have the same weight.
        let n_vertices = if N == LINEAR { 1 } else { 4 };
        let mut rest = [zero; 3];
        for a in first..N {
            for i in 0..3 {
                let h = cof[i][0].mul_add(g[a][0], cof[i][1].mul_add(g[a][1], cof[i][2] * g[a][2]))
                    * weight;
                rest[i] = rest[i] - h;
                for v in 0..n_vertices {
                    put::<S, Q>(simd, &mut out.coupling[a][v][i], lane, h.times(shape[v]));
                }
            }
        }
        if N == LINEAR {
            for i in 0..3 {
                put::<S, Q>(
                    simd,
                    &mut out.coupling[0][0][i],
                    lane,
                    rest[i].times(shape[0]),
                );
            }
        }
    }
    for k in 0..21 {
        d[k] = d[k] * weight;
    }
    // Bₐ maps the displacement of node a to engineering strain: [component][direction].
    let mut strain = [[[zero; 3]; 6]; N];
    for a in first..N {
        for i in 0..3 {
            for k in 0..3 {
                strain[a][k][i] = f[i][k] * g[a][k];
            }
            for (r, (k, l)) in [(3, (0, 1)), (4, (0, 2)), (5, (1, 2))] {
                strain[a][r][i] = f[i][k].mul_add(g[a][l], f[i][l] * g[a][k]);
            }
        }
    }
    for b in first..N {
        let mut db = [[zero; 3]; 6];
        for r in 0..6 {
            for c in 0..6 {
                for i in 0..3 {
                    db[r][i] = d[at(r, c)].mul_add(strain[b][c][i], db[r][i]);
                }
            }
        }
        for a in first..=b {
            let geometric =
                g[a][0].mul_add(sg[b][0], g[a][1].mul_add(sg[b][1], g[a][2] * sg[b][2]));
            let block = &mut out.stiffness[pair(N, a, b)];
            for i in 0..3 {
                for k in 0..3 {
                    let mut x = if i == k { geometric } else { zero };
                    for r in 0..6 {
                        x = strain[a][r][i].mul_add(db[r][k], x);
                    }
                    put::<S, Q>(simd, &mut block[3 * i + k], lane, x);
                }
            }
        }
    }
    if N == LINEAR {
        complete_stiffness(simd, &mut out.stiffness, lane);
    }
}

/// Adds to a sum over integration points, or overwrites it if there is a single point.
#[inline(always)]
fn put<S: Simd, const Q: usize>(simd: S, to: &mut Eight, lane: usize, x: Lanes<S>) {
    if Q == 1 {
        x.store(&mut to[lane..]);
    } else {
        add(simd, to, lane, x);
    }
}

/// Stiffness of a linear element's first node, from that of the other three.
#[inline(always)]
fn complete_stiffness<S: Simd>(simd: S, stiffness: &mut [[Eight; 9]; MAX_PAIRS], lane: usize) {
    let get = |stiffness: &[[Eight; 9]; MAX_PAIRS], a: usize, b: usize, i: usize, k: usize| {
        let (pair, at) = if a <= b {
            (pair(LINEAR, a, b), 3 * i + k)
        } else {
            (pair(LINEAR, b, a), 3 * k + i)
        };
        Lanes::load(simd, &stiffness[pair][at][lane..])
    };
    for i in 0..3 {
        for k in 0..3 {
            let mut of_first = Lanes::splat(simd, 0.0);
            for b in 1..LINEAR {
                let sum = get(stiffness, 1, b, i, k)
                    + get(stiffness, 2, b, i, k)
                    + get(stiffness, 3, b, i, k);
                (-sum).store(&mut stiffness[pair(LINEAR, 0, b)][3 * i + k][lane..]);
                of_first = of_first + sum;
            }
            of_first.store(&mut stiffness[pair(LINEAR, 0, 0)][3 * i + k][lane..]);
        }
    }
}
