//! Passes over a body's batches: volumes, forces, stiffness, and their scatter in the order of the batches.

use cardiotwin_linalg::{CondensedMatrix, NO_SLOT, Pattern};
use pulp::{Arch, Simd, WithSimd};

use super::Deformation;
use super::transpose::Shuffle;
use crate::element::batch::{Batch, vertex_values};
use crate::element::kernel::{
    ActivePoint, Gathered, Scratch, Viscous, VolumeChange, element, pair, squared_stretch,
    volume_and_stretch,
};
use crate::element::{BATCH, Eight};
use crate::linear::{PackedBlock, PackedTangent, PackedVolume, Sink};
use crate::material::Tissue;
use crate::material::tensor::determinant;

/// Nodal and point data that an assembly reads.
pub(super) struct Pass<'a> {
    pub arch: Arch,
    pub tissues: &'a [Tissue],
    pub volume: VolumeChange,
    pub reference: &'a [f64],
    pub displacement: &'a [f64],
    pub nodal_pressure: &'a [f64],
    pub active: &'a [ActivePoint],
    pub motion: Moving<'a>,
    /// Factor of the stiffness, and of nothing else.
    pub stiffness_factor: f64,
}

/// Velocity data of viscous tissue.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moving<'a> {
    /// Velocity \[mm/ms\], three numbers a node; empty without viscosity.
    pub velocity: &'a [f64],
    /// Viscosity of each tissue \[kPa·ms\]; empty without viscosity.
    pub viscosity_kpa_ms: &'a [f64],
    /// Derivative `∂v/∂u` of the velocity in the time scheme \[1/ms\].
    pub velocity_rate_per_ms: f64,
}

impl Moving<'_> {
    fn of_tissue(&self, tissue: usize) -> Viscous {
        match self.viscosity_kpa_ms.get(tissue) {
            Some(&viscosity_kpa_ms) if !self.velocity.is_empty() => Viscous {
                viscosity_kpa_ms,
                velocity_rate_per_ms: self.velocity_rate_per_ms,
            },
            _ => Viscous::NONE,
        }
    }
}

/// The elements of a body, of either order.
pub(super) trait Elements: Send + Sync {
    fn n_batches(&self) -> usize;
    fn n_points(&self) -> usize;
    fn volumes(&self, pass: &Pass<'_>, out: &mut Deformation, vertex_volume: &mut [f64]);
    fn squared_stretches(&self, pass: &Pass<'_>, out: &mut [Eight]);
    fn forces(&self, pass: &Pass<'_>, force: &mut [f64]);
    fn tangent(&self, pass: &Pass<'_>, force: &mut [f64], tangent: Sink<'_>);
    fn lanes(&self, batch: usize) -> (usize, &[u32; BATCH]);
    fn point_weight(&self, batch: usize, point: usize) -> &Eight;
    fn vertex_shape(&self, point: usize) -> [f64; 4];
    fn add_masses(&self, tissues: &[Tissue], mass: &mut [f64]);
    /// Strain energy; an element shared by ranks counts by its share of nodes below `n_owned`.
    fn energy(&self, pass: &Pass<'_>, n_owned: usize) -> f64;
}

pub(super) struct Field<const N: usize, const Q: usize> {
    batches: Vec<Batch<N, Q>>,
    shape: [[f64; 4]; Q],
    /// Slots of the node pairs `(a, b)`, at `a · N + b`, for each lane.
    slots: Vec<[[u32; BATCH]; N]>,
    /// Whether the volume change is averaged at vertices.
    nodal: bool,
    /// Slots of the couplings `(a, vertex)`, at `a · 4 + v`; empty for linear elements, which use `slots`.
    coupling_slots: Vec<[u32; BATCH]>,
}

impl<const N: usize, const Q: usize> Field<N, Q> {
    pub(super) fn new(
        batches: Vec<Batch<N, Q>>,
        pattern: &Pattern,
        coupling: Option<&Pattern>,
    ) -> Self {
        let mut slots = Vec::with_capacity(batches.len() * N);
        let mut coupling_slots = Vec::new();
        for batch in &batches {
            for a in 0..N {
                slots.push(std::array::from_fn(|b| {
                    std::array::from_fn(|lane| {
                        pattern.slot(batch.nodes[a][lane], batch.nodes[b][lane])
                    })
                }));
            }
            if let Some(coupling) = coupling.filter(|_| N > 4) {
                for a in 0..N {
                    for v in 0..4 {
                        coupling_slots.push(std::array::from_fn(|lane| {
                            coupling.slot(batch.nodes[a][lane], batch.nodes[v][lane])
                        }));
                    }
                }
            }
        }
        Self {
            batches,
            shape: vertex_values::<Q>(),
            slots,
            nodal: coupling.is_some(),
            coupling_slots,
        }
    }

    #[inline(always)]
    fn gather(batch: &Batch<N, Q>, pass: &Pass<'_>, into: &mut Gathered<N>) {
        let (reference, _) = pass.reference.as_chunks::<3>();
        let (u, _) = pass.displacement.as_chunks::<3>();
        for a in 0..N {
            for lane in 0..BATCH {
                let node = batch.nodes[a][lane] as usize;
                for i in 0..3 {
                    into.x[a][i][lane] = reference[node][i] + u[node][i];
                }
            }
        }
        if !pass.nodal_pressure.is_empty() {
            for v in 0..4 {
                for lane in 0..BATCH {
                    into.pressure[v][lane] = pass.nodal_pressure[batch.nodes[v][lane] as usize];
                }
            }
        }
    }
}

/// Share of an element's mass at each node: equal for linear elements; proportional to the consistent mass's diagonal for
/// quadratic ones, whose row sums are negative at vertices (Hinton, Rock and Zienkiewicz 1976).
fn lumped_shares<const N: usize>() -> [f64; N] {
    std::array::from_fn(|a| match (N, a) {
        (4, _) => 0.25,
        (_, 0..4) => 1.0 / 36.0,
        _ => 4.0 / 27.0,
    })
}

struct Volumes<'a, const N: usize, const Q: usize>(
    &'a Field<N, Q>,
    &'a Pass<'a>,
    &'a mut Deformation,
    &'a mut [f64],
);

impl<const N: usize, const Q: usize> WithSimd for Volumes<'_, N, Q> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(field, pass, out, vertex_volume) = self;
        let mut input = Gathered::<N>::zeros();
        let (ratios, _) = out.volume_ratio.as_chunks_mut::<Q>();
        let (stretches, _) = out.squared_stretch.as_chunks_mut::<Q>();
        out.smallest = (f64::INFINITY, 0);
        for ((batch, j), c11) in field.batches.iter().zip(ratios).zip(stretches) {
            Field::gather(batch, pass, &mut input);
            volume_and_stretch(simd, batch, &input.x, j, c11);
            for (q, j) in j.iter().enumerate() {
                for lane in 0..batch.n {
                    // The comparison keeps a NaN, which would otherwise pass for a large volume.
                    if !out.smallest.0.is_nan() && !(j[lane] >= out.smallest.0) {
                        out.smallest = (j[lane], batch.elements[lane] as usize);
                    }
                    if !vertex_volume.is_empty() {
                        let volume = batch.points[q].weight[lane] * j[lane];
                        for v in 0..4 {
                            vertex_volume[batch.nodes[v][lane] as usize] +=
                                field.shape[q][v] * volume;
                        }
                    }
                }
            }
        }
    }
}

struct SquaredStretches<'a, const N: usize, const Q: usize>(
    &'a Field<N, Q>,
    &'a Pass<'a>,
    &'a mut [Eight],
);

impl<const N: usize, const Q: usize> WithSimd for SquaredStretches<'_, N, Q> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(field, pass, out) = self;
        let mut input = Gathered::<N>::zeros();
        for (batch, c11) in field.batches.iter().zip(out.as_chunks_mut::<Q>().0) {
            Field::gather(batch, pass, &mut input);
            squared_stretch(simd, batch, &input.x, c11);
        }
    }
}

struct Assembly<'a, const N: usize, const Q: usize, const TANGENT: bool>(
    &'a Field<N, Q>,
    &'a Pass<'a>,
    &'a mut [f64],
    Option<Sink<'a>>,
);

impl<const N: usize, const Q: usize, const TANGENT: bool> WithSimd for Assembly<'_, N, Q, TANGENT> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(field, pass, force, mut tangent) = self;
        let mut input = Gathered::<N>::zeros();
        let mut scratch = Scratch::<N>::new();
        let shuffle = Shuffle::new();
        let none = [ActivePoint::NONE; Q];
        let (force, _) = force.as_chunks_mut::<3>();
        for (idx, batch) in field.batches.iter().enumerate() {
            Field::gather(batch, pass, &mut input);
            if Q > 1 {
                scratch.force.as_flattened_mut().fill([0.0; BATCH]);
            }
            if TANGENT && Q > 1 {
                scratch.stiffness[..N * (N + 1) / 2]
                    .as_flattened_mut()
                    .fill([0.0; BATCH]);
                scratch
                    .coupling
                    .as_flattened_mut()
                    .as_flattened_mut()
                    .fill([0.0; BATCH]);
            }
            let tissue = &pass.tissues[batch.tissue];
            let viscous = pass.motion.of_tissue(batch.tissue);
            if viscous.viscosity_kpa_ms > 0.0 {
                let (velocity, _) = pass.motion.velocity.as_chunks::<3>();
                for a in 0..N {
                    for lane in 0..BATCH {
                        let v = &velocity[batch.nodes[a][lane] as usize];
                        for i in 0..3 {
                            input.velocity[a][i][lane] = v[i];
                        }
                    }
                }
            }
            let active = if pass.active.is_empty() {
                &none[..]
            } else {
                &pass.active[idx * Q..(idx + 1) * Q]
            };
            element::<S, N, Q, TANGENT>(
                simd,
                tissue,
                viscous,
                pass.volume,
                &field.shape,
                batch,
                &input,
                active,
                &mut scratch,
            );
            for lane in 0..batch.n {
                for a in 0..N {
                    let to = &mut force[batch.nodes[a][lane] as usize];
                    for i in 0..3 {
                        to[i] += scratch.force[a][i][lane];
                    }
                }
            }
            match &mut tangent {
                Some(Sink::Full(tangent)) => {
                    field.scatter(idx, batch.n, &scratch, pass.stiffness_factor, tangent);
                }
                Some(Sink::Packed(tangent)) => {
                    let factor = pass.stiffness_factor;
                    field.scatter_packed(idx, batch.n, &scratch, factor, shuffle, tangent);
                }
                None => {}
            }
        }
    }
}

impl<const N: usize, const Q: usize> Field<N, Q> {
    #[inline(always)]
    fn scatter(
        &self,
        idx: usize,
        n_lanes: usize,
        scratch: &Scratch<N>,
        factor: f64,
        tangent: &mut CondensedMatrix,
    ) {
        let slots = &self.slots[idx * N..(idx + 1) * N];
        for lane in 0..n_lanes {
            for a in 0..N {
                for b in a..N {
                    let from = &scratch.stiffness[pair(N, a, b)];
                    let block: [f64; 9] = std::array::from_fn(|k| factor * from[k][lane]);
                    let slot = slots[a][b][lane];
                    if slot != NO_SLOT {
                        let to = &mut tangent.stiffness.blocks[slot as usize];
                        for k in 0..9 {
                            to[k] += block[k];
                        }
                    }
                    let slot = slots[b][a][lane];
                    if a != b && slot != NO_SLOT {
                        let to = &mut tangent.stiffness.blocks[slot as usize];
                        for i in 0..3 {
                            for k in 0..3 {
                                to[3 * i + k] += block[3 * k + i];
                            }
                        }
                    }
                }
            }
        }
        if let Some(coupling) = &mut tangent.coupling {
            for lane in 0..n_lanes {
                for a in 0..N {
                    for v in 0..4 {
                        let slot = if N == 4 {
                            slots[a][v][lane]
                        } else {
                            self.coupling_slots[(idx * N + a) * 4 + v][lane]
                        };
                        if slot != NO_SLOT {
                            let to = &mut coupling.blocks[slot as usize];
                            for i in 0..3 {
                                to[i] += scratch.coupling[a][if Q == 1 { 0 } else { v }][i][lane];
                            }
                        }
                    }
                }
            }
        }
    }
}

impl<const N: usize, const Q: usize> Field<N, Q> {
    /// Scatters linear elements into a packed tangent.
    #[inline(always)]
    fn scatter_packed(
        &self,
        idx: usize,
        n_lanes: usize,
        scratch: &Scratch<N>,
        factor: f64,
        shuffle: Shuffle,
        tangent: &mut PackedTangent,
    ) {
        let slots = &self.slots[idx * N..(idx + 1) * N];
        let nodal = self.nodal;
        let mut single = [[[0.0_f32; BATCH]; 9]; 10];
        for (to, from) in single.iter_mut().zip(&scratch.stiffness) {
            for k in 0..9 {
                for lane in 0..BATCH {
                    to[k][lane] = (factor * from[k][lane]) as f32;
                }
            }
        }
        let mut volume = [[[0.0_f32; BATCH]; 3]; N];
        if nodal {
            for a in 0..N {
                for i in 0..3 {
                    for lane in 0..BATCH {
                        volume[a][i][lane] = scratch.coupling[a][0][i][lane] as f32;
                    }
                }
            }
        }
        let (blocks, volumes) = tangent.entries_mut();
        for a in 0..N {
            let of_volume =
                shuffle.transposed([&volume[a][0], &volume[a][1], &volume[a][2], &[0.0; BATCH]]);
            for b in 0..N {
                let from = &single[pair(N, a.min(b), a.max(b))];
                let (along, across) = if a <= b { (3, 1) } else { (1, 3) };
                let mut columns = [[[0.0_f32; 4]; BATCH]; 3];
                for j in 0..3 {
                    let row = |i: usize| &from[along * i + across * j];
                    columns[j] = shuffle.transposed([row(0), row(1), row(2), &volume[b][j]]);
                }
                for lane in 0..n_lanes {
                    let slot = slots[a][b][lane];
                    if slot == NO_SLOT {
                        continue;
                    }
                    let PackedBlock(to) = &mut blocks[slot as usize];
                    let mut sum = *to;
                    for i in 0..4 {
                        sum[0][i] += columns[0][lane][i];
                        sum[1][i] += columns[1][lane][i];
                        sum[2][i] += columns[2][lane][i];
                    }
                    *to = sum;
                    if nodal {
                        let PackedVolume(to) = &mut volumes[slot as usize];
                        let mut sum = *to;
                        for i in 0..4 {
                            sum[i] += of_volume[lane][i];
                        }
                        *to = sum;
                    }
                }
            }
        }
    }
}

impl<const N: usize, const Q: usize> Elements for Field<N, Q> {
    fn n_batches(&self) -> usize {
        self.batches.len()
    }
    fn n_points(&self) -> usize {
        Q
    }
    fn volumes(&self, pass: &Pass<'_>, out: &mut Deformation, vertex_volume: &mut [f64]) {
        pass.arch.dispatch(Volumes(self, pass, out, vertex_volume));
    }
    fn squared_stretches(&self, pass: &Pass<'_>, out: &mut [Eight]) {
        pass.arch.dispatch(SquaredStretches(self, pass, out));
    }
    fn forces(&self, pass: &Pass<'_>, force: &mut [f64]) {
        pass.arch
            .dispatch(Assembly::<N, Q, false>(self, pass, force, None));
    }
    fn tangent(&self, pass: &Pass<'_>, force: &mut [f64], tangent: Sink<'_>) {
        pass.arch
            .dispatch(Assembly::<N, Q, true>(self, pass, force, Some(tangent)));
    }
    fn lanes(&self, batch: usize) -> (usize, &[u32; BATCH]) {
        (self.batches[batch].n, &self.batches[batch].elements)
    }
    fn point_weight(&self, batch: usize, point: usize) -> &Eight {
        &self.batches[batch].points[point].weight
    }
    fn vertex_shape(&self, point: usize) -> [f64; 4] {
        self.shape[point]
    }
    fn add_masses(&self, tissues: &[Tissue], mass: &mut [f64]) {
        let share = lumped_shares::<N>();
        for batch in &self.batches {
            for lane in 0..batch.n {
                let volume: f64 = batch.points.iter().map(|p| p.weight[lane]).sum();
                for a in 0..N {
                    mass[batch.nodes[a][lane] as usize] +=
                        tissues[batch.tissue].density * volume * share[a];
                }
            }
        }
    }
    fn energy(&self, pass: &Pass<'_>, n_owned: usize) -> f64 {
        let mut input = Gathered::<N>::zeros();
        let mut energy = 0.0;
        for batch in &self.batches {
            Self::gather(batch, pass, &mut input);
            let tissue = &pass.tissues[batch.tissue];
            for point in &batch.points {
                for lane in 0..batch.n {
                    let mut f = [[0.0; 3]; 3];
                    for a in 0..N {
                        for k in 0..3 {
                            for i in 0..3 {
                                f[i][k] += input.x[a][i][lane] * point.grad[a][k][lane];
                            }
                        }
                    }
                    let product =
                        |m: usize, n: usize| (0..3).map(|i| f[i][m] * f[i][n]).sum::<f64>();
                    let c = [
                        product(0, 0),
                        product(1, 1),
                        product(2, 2),
                        product(0, 1),
                        product(0, 2),
                        product(1, 2),
                    ];
                    let j = determinant(&c).sqrt();
                    let kappa = pass.volume.pointwise() * tissue.volumetric.kappa_kpa;
                    let owned = (0..N)
                        .filter(|a| (batch.nodes[*a][lane] as usize) < n_owned)
                        .count();
                    let share = owned as f64 / N as f64;
                    energy += share
                        * point.weight[lane]
                        * (tissue.law.energy(&c, j) + kappa * tissue.volumetric.law.energy(j));
                }
            }
        }
        energy
    }
}
