//! Groups of cells in a wall with the organ's law: the stretch of each group, and the mean stress
//! that agrees with it.

use super::ActivationSpread;
use super::organ_law::{AtVolume, LawValue, OrganLaw, end_diastolic_x};
use super::passive_state::OneFibrePassive;
use crate::contraction::ActiveStress;
use cardiotwin_vector_math::max;
use pulp::{Arch, Simd, WithSimd};
use std::sync::Arc;

/// Largest distance of a group's stretch from the law in an accepted step. The stress is linearised
/// over it, which leaves an error of its square times the curvature, less than 1e-4 kPa.
const INCONSISTENCY: f64 = 1e-5;
/// Smallest slope of a group's residual. Stress that falls with stretch would make it smaller.
const SMALLEST_SLOPE: f64 = 0.2;
/// Smallest slope of the mean stress's equation. Stiff cells make it small; a settled law keeps it
/// positive.
const SMALLEST_FEEDBACK: f64 = 0.01;
/// Least mean square of ξ before it is normalised. Fewer than four groups have less.
const LEAST_SQUARE: f64 = 0.5;

/// Stretches of the groups at one time.
#[derive(Debug, Clone, Default, PartialEq)]
struct Stretches {
    volume_ml: f64,
    /// Mean active stress \[kPa\].
    stress_kpa: f64,
    /// Stretch of each group that agrees with volume and stress.
    lambda: Vec<f64>,
    /// Derivative of that stretch with respect to the volume.
    per_ml: Vec<f64>,
}

/// A wall of groups with one mean stretch.
#[derive(Debug)]
pub(super) struct LawWall {
    law: Arc<OrganLaw>,
    /// Mean stretch at end-diastole, from the unloaded wall.
    end_diastolic: f64,
    /// x of the law at end-diastole.
    end_diastolic_x: f64,
    /// Duration of each group's contraction over the mean.
    durations: Vec<f64>,
    /// Half of the wall for which each group stands, ξ: mean zero, mean square one.
    halves: Vec<f64>,
    now: Stretches,
    trial: Stretches,
    /// Change of each group's stretch over the last step, without that by the volume.
    drift: Vec<f64>,
    /// Stretch at which each group's cells begin the step.
    cells: Vec<f64>,
    /// Stretch at which each group's cells were evaluated last.
    evaluated: Vec<f64>,
    inconsistency: f64,
}

/// Groups that one vector holds.
const LANES: usize = 8;

/// Values of a step's equations that all groups share.
#[derive(Debug, Clone, Copy)]
struct Shared {
    /// Mean of the cells' stretch, its derivative per mL and per kPa.
    mean: [f64; 3],
    /// Deviation of the cells' stretch, likewise.
    deviation: [f64; 3],
    /// Mean stress at which both were taken \[kPa\].
    at_kpa: f64,
    coupling_per_kpa: f64,
    response_per_kpa: f64,
    rise_per_kpa: f64,
}

/// The equation of a group's stretch around its evaluation.
struct Group {
    /// Residual of the stretch without the mean stresses.
    own: f64,
    per_ml: f64,
    /// Derivatives with respect to T and M.
    per_t: f64,
    per_m: f64,
    /// Derivative of the residual with respect to the group's stretch.
    slope: f64,
}

impl Shared {
    /// λ_g + δ_g = own + per_t T + per_m M, with T_g + T_g' δ_g in T and M.
    #[inline(always)]
    fn group(&self, half: f64, lambda: f64, stress: &ActiveStress) -> Group {
        let [value, per_ml, per_kpa] = [
            self.mean[0] + half * self.deviation[0],
            self.mean[1] + half * self.deviation[1],
            self.mean[2] + half * self.deviation[2],
        ];
        let coupling = self.coupling_per_kpa;
        Group {
            own: value - per_kpa * self.at_kpa - coupling * stress.sa_kpa - lambda,
            per_ml,
            per_t: per_kpa + coupling,
            per_m: self.rise_per_kpa + half * (coupling - self.response_per_kpa),
            slope: max(1.0 + coupling * stress.dsa_dlambda_kpa, SMALLEST_SLOPE),
        }
    }
}

/// Means of the groups' stress, T and M, as linear functions of T, M and the volume.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Means {
    /// For T, then for M: the constant, and the derivatives with respect to T, M and the volume.
    of: [[f64; 4]; 2],
}

/// Sums over the groups, to be compiled for each instruction set.
struct Sum<'a> {
    shared: Shared,
    weights: &'a [f64],
    halves: &'a [f64],
    lambda: &'a [f64],
    stress: &'a [ActiveStress],
}

impl WithSimd for Sum<'_> {
    type Output = Means;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Means {
        let mut sums = [[0.0; LANES]; 8];
        let n = self.weights.len();
        let mut first = 0;
        // Lanes beyond the last group have no weight.
        let mut last = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let mut last_stress = [ActiveStress::default(); LANES];
        while first < n {
            let (weights, halves, lambda, stress) = if first + LANES <= n {
                let range = first..first + LANES;
                (
                    as_lanes(&self.weights[range.clone()]),
                    as_lanes(&self.halves[range.clone()]),
                    as_lanes(&self.lambda[range.clone()]),
                    as_lanes(&self.stress[range]),
                )
            } else {
                let left = n - first;
                last.0[..left].copy_from_slice(&self.weights[first..]);
                last.1[..left].copy_from_slice(&self.halves[first..]);
                last.2[..left].copy_from_slice(&self.lambda[first..]);
                last_stress[..left].copy_from_slice(&self.stress[first..]);
                (&last.0, &last.1, &last.2, &last_stress)
            };
            for lane in 0..LANES {
                let (weight, half) = (weights[lane], halves[lane]);
                let group = self.shared.group(half, lambda[lane], &stress[lane]);
                let answer = weight * stress[lane].dsa_dlambda_kpa / group.slope;
                let fixed = weight * stress[lane].sa_kpa + answer * group.own;
                let (per_t, per_m) = (answer * group.per_t, answer * group.per_m);
                let per_ml = answer * group.per_ml;
                sums[0][lane] += fixed;
                sums[1][lane] += per_t;
                sums[2][lane] += per_m;
                sums[3][lane] += per_ml;
                sums[4][lane] += half * fixed;
                sums[5][lane] += half * per_t;
                sums[6][lane] += half * per_m;
                sums[7][lane] += half * per_ml;
            }
            first += LANES;
        }
        let mut of = [[0.0; 4]; 2];
        for k in 0..8 {
            let [a, b, c, d, e, f, g, h] = sums[k];
            of[k / 4][k % 4] = ((a + b) + (c + d)) + ((e + f) + (g + h));
        }
        Means { of }
    }
}

/// Weighted mean of the groups' stress \[kPa\]. Four sums go side by side, since a single one would
/// wait for each addition.
fn mean_stress(weights: &[f64], stress: &[ActiveStress]) -> f64 {
    let mut sums = [0.0; 4];
    for (weights, stress) in weights.chunks(4).zip(stress.chunks(4)) {
        for (lane, (weight, stress)) in weights.iter().zip(stress).enumerate() {
            sums[lane] += weight * stress.sa_kpa;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// A slice of [`LANES`] values.
#[inline(always)]
fn as_lanes<T>(values: &[T]) -> &[T; LANES] {
    values.first_chunk().expect("as many as lanes")
}

/// Corrections of the groups' stretch, to be compiled for each instruction set. The result is the
/// largest of them.
struct Correct<'a> {
    shared: Shared,
    /// T and M \[kPa\], and their derivatives per mL.
    means_kpa: [f64; 2],
    means_per_ml: [f64; 2],
    halves: &'a [f64],
    evaluated: &'a [f64],
    stress: &'a [ActiveStress],
    lambda: &'a mut [f64],
    per_ml: &'a mut [f64],
}

impl WithSimd for Correct<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let n = self.lambda.len();
        let (halves, evaluated) = (&self.halves[..n], &self.evaluated[..n]);
        let (stress, per_ml) = (&self.stress[..n], &mut self.per_ml[..n]);
        let [mean, difference] = self.means_kpa;
        let [mean_per_ml, difference_per_ml] = self.means_per_ml;
        let mut largest = 0.0;
        for idx in 0..n {
            let group = self.shared.group(halves[idx], evaluated[idx], &stress[idx]);
            let correction =
                (group.own + group.per_t * mean + group.per_m * difference) / group.slope;
            largest = max(correction.abs(), largest);
            self.lambda[idx] = evaluated[idx] + correction;
            per_ml[idx] =
                (group.per_ml + group.per_t * mean_per_ml + group.per_m * difference_per_ml)
                    / group.slope;
        }
        largest
    }
}

/// Halves ξ of the wall for which groups stand, in an order that repeats within a few groups, without
/// a trend over the activation. All zero if there are too few groups.
pub(super) fn halves(activation_ms: &[f64], weights: &[f64]) -> Vec<f64> {
    let mean = |x: &[f64]| x.iter().zip(weights).map(|(x, w)| x * w).sum::<f64>();
    let product = |x: &[f64], y: &[f64]| {
        let products: Vec<f64> = x.iter().zip(y).map(|(x, y)| x * y).collect();
        mean(&products)
    };
    let centred = |x: &[f64]| {
        let mean = mean(x);
        x.iter().map(|x| x - mean).collect::<Vec<f64>>()
    };
    let order = centred(activation_ms);
    let signs: Vec<f64> = (0..weights.len())
        .map(|idx| if matches!(idx % 4, 0 | 3) { 1.0 } else { -1.0 })
        .collect();
    let mut halves = centred(&signs);
    let trend = product(&halves, &order) / product(&order, &order).max(f64::MIN_POSITIVE);
    for (half, order) in halves.iter_mut().zip(&order) {
        *half -= trend * order;
    }
    let square = product(&halves, &halves);
    let scale = if square > LEAST_SQUARE {
        square.sqrt().recip()
    } else {
        0.0
    };
    halves.iter().map(|half| half * scale).collect()
}

impl LawWall {
    /// A relaxed wall at end-diastole.
    ///
    /// - `activation_ms`, `weights`: activation time and share of the wall of each group
    /// - `lambda`: stretch of the cells at end-diastole
    pub(super) fn new(
        law: Arc<OrganLaw>,
        passive: &OneFibrePassive,
        spread: &ActivationSpread,
        activation_ms: &[f64],
        weights: &[f64],
        lambda: f64,
    ) -> Self {
        let duration = |time_ms: &f64| law.duration(spread, *time_ms);
        let mut wall = Self {
            durations: activation_ms.iter().map(duration).collect(),
            halves: halves(activation_ms, weights),
            end_diastolic: law.end_diastolic_stretch(passive),
            end_diastolic_x: end_diastolic_x(passive),
            law,
            now: Stretches::default(),
            trial: Stretches::default(),
            drift: Vec::new(),
            cells: Vec::new(),
            evaluated: Vec::new(),
            inconsistency: 0.0,
        };
        wall.relax(passive, passive.end_diastolic_volume_ml, lambda);
        wall
    }

    /// Relaxes the wall, for the start of a beat.
    ///
    /// - `lambda`: mean stretch of the cells
    pub(super) fn relax(&mut self, passive: &OneFibrePassive, volume_ml: f64, lambda: f64) {
        let n = self.halves.len();
        let ratio = lambda / self.law.stretch(passive, volume_ml, 0.0).value;
        let deviation = ratio * self.law.deviation(passive, volume_ml, 0.0).value;
        let stretches: Vec<f64> = self
            .halves
            .iter()
            .map(|half| lambda + half * deviation)
            .collect();
        self.now = Stretches {
            volume_ml,
            stress_kpa: 0.0,
            lambda: stretches.clone(),
            per_ml: vec![0.0; n],
        };
        self.drift = vec![0.0; n];
        self.cells.clone_from(&stretches);
        self.evaluated = stretches;
        self.trial = self.now.clone();
    }

    /// Lets the time since activation run more slowly where contraction lasts longer.
    pub(super) fn slow_down(&self, since_activation_ms: &mut [f64]) {
        for (since, duration) in since_activation_ms.iter_mut().zip(&self.durations) {
            if *since > 0.0 {
                *since /= duration;
            }
        }
    }

    /// Mean stretch of the relaxed wall from end-diastole, at a cavity volume \[mL\].
    pub(super) fn relaxed_stretch(&self, passive: &OneFibrePassive, volume_ml: f64) -> f64 {
        self.law.stretch(passive, volume_ml, 0.0).value / self.end_diastolic
    }

    /// Begins a step of the recent length: stretches are expected to drift as over the last one.
    pub(super) fn begin_step(&mut self) {
        self.trial.clone_from(&self.now);
        for (lambda, drift) in self.trial.lambda.iter_mut().zip(&self.drift) {
            *lambda += drift;
        }
    }

    /// Begins a step without expectations.
    pub(super) fn begin_at_rest(&mut self) {
        self.trial.clone_from(&self.now);
    }

    /// Stretches at the start of the step, and those at which the cells are evaluated for a
    /// candidate volume.
    pub(super) fn aim(&mut self, volume_ml: f64) -> (&[f64], &[f64]) {
        let change = volume_ml - self.trial.volume_ml;
        for ((lambda, near), per_ml) in self
            .evaluated
            .iter_mut()
            .zip(&self.trial.lambda)
            .zip(&self.trial.per_ml)
        {
            *lambda = near + per_ml * change;
        }
        (&self.cells, &self.evaluated)
    }

    /// Pressure \[mmHg\] at a candidate volume, and its derivative with respect to the volume, from
    /// the groups' stress at the stretches of [`Self::aim`].
    ///
    /// The stretch of a group is λ_g = Λ(V, T) + q M + ξ_g [D(V, T) − r M] − c (T_g − T − ξ_g M), where
    /// Λ and D are the laws of the stretch's mean and deviation, T is the mean of the groups' stress T_g
    /// and M the mean of ξ_g T_g. All are linearised to the point where they agree. The compliance c
    /// follows the stress at the start of the step.
    ///
    /// - `cell_stretch`: ratio of the cells' stretch to the stretch from end-diastole
    pub(super) fn solve(
        &mut self,
        passive: &OneFibrePassive,
        cell_stretch: f64,
        weights: &[f64],
        stress: &[ActiveStress],
        volume_ml: f64,
    ) -> (f64, f64) {
        let ratio = cell_stretch / self.end_diastolic;
        let arch = Arch::new();
        let at = AtVolume::with_end_diastole(passive, self.end_diastolic_x, volume_ml);
        let at_kpa = mean_stress(weights, stress);
        let of_cells = |law: LawValue| [law.value * ratio, law.per_ml * ratio, law.per_kpa * ratio];
        let shared = Shared {
            mean: of_cells(self.law.stretch_at(&at, at_kpa)),
            deviation: of_cells(self.law.deviation_at(&at, at_kpa)),
            at_kpa,
            coupling_per_kpa: self.law.coupling_per_kpa(self.now.stress_kpa),
            response_per_kpa: ratio * self.law.response_per_kpa(at_kpa),
            rise_per_kpa: ratio * self.law.stretch_per_difference(at_kpa),
        };
        let Means { of: [of_t, of_m] } = arch.dispatch(Sum {
            shared,
            weights,
            halves: &self.halves,
            lambda: &self.evaluated,
            stress,
        });
        // T = of_t(T, M) and M = of_m(T, M): M is eliminated.
        let [t, t_per_t, t_per_m, t_per_ml] = of_t;
        let [m, m_per_t, m_per_m, m_per_ml] = of_m;
        let own_m = (1.0 - m_per_m).max(SMALLEST_SLOPE);
        let through_m = t_per_m / own_m;
        let feedback = (1.0 - t_per_t - through_m * m_per_t).max(SMALLEST_FEEDBACK);
        let mean_kpa = (t + through_m * m) / feedback;
        let kpa_per_ml = (t_per_ml + through_m * m_per_ml) / feedback;
        let difference_kpa = (m + m_per_t * mean_kpa) / own_m;
        let difference_per_ml = (m_per_ml + m_per_t * kpa_per_ml) / own_m;
        let inconsistency = arch.dispatch(Correct {
            shared,
            means_kpa: [mean_kpa, difference_kpa],
            means_per_ml: [kpa_per_ml, difference_per_ml],
            halves: &self.halves,
            evaluated: &self.evaluated,
            stress,
            lambda: &mut self.trial.lambda,
            per_ml: &mut self.trial.per_ml,
        });
        self.inconsistency = inconsistency;
        self.trial.volume_ml = volume_ml;
        self.trial.stress_kpa = mean_kpa;
        let pressure = self.law.pressure_at(&at, mean_kpa);
        (
            pressure.value,
            pressure.per_ml + pressure.per_kpa * kpa_per_ml,
        )
    }

    /// Whether stretches and stress agreed in the last evaluation.
    pub(super) fn is_consistent(&self) -> bool {
        self.inconsistency <= INCONSISTENCY
    }

    /// Accepts the step. Cells with states stay at the stretch of their evaluation.
    pub(super) fn commit(&mut self, volume_ml: f64, has_states: bool) {
        let change = volume_ml - self.trial.volume_ml;
        let moved = volume_ml - self.now.volume_ml;
        for idx in 0..self.drift.len() {
            let per_ml = self.trial.per_ml[idx];
            self.trial.lambda[idx] += per_ml * change;
            self.drift[idx] = self.trial.lambda[idx] - self.now.lambda[idx] - per_ml * moved;
            self.cells[idx] = if has_states {
                self.evaluated[idx]
            } else {
                self.trial.lambda[idx]
            };
        }
        self.trial.volume_ml = volume_ml;
        std::mem::swap(&mut self.now, &mut self.trial);
    }

    /// Stretch of each group's cells.
    pub(super) fn stretches(&self) -> &[f64] {
        &self.cells
    }

    /// Number of values in snapshots of `n` groups.
    pub(super) fn n_values(n: usize) -> usize {
        2 + 4 * n
    }

    /// Values for a snapshot.
    pub(super) fn values(&self) -> impl Iterator<Item = f64> {
        [self.now.volume_ml, self.now.stress_kpa].into_iter().chain(
            [&self.now.lambda, &self.now.per_ml, &self.drift, &self.cells]
                .into_iter()
                .flatten()
                .copied(),
        )
    }

    /// Restores [`Self::n_values`] values of a snapshot.
    pub(super) fn restore(&mut self, values: &[f64]) {
        let n = self.drift.len();
        let (scalars, lists) = values.split_at(2);
        [self.now.volume_ml, self.now.stress_kpa] = [scalars[0], scalars[1]];
        for (list, values) in [
            &mut self.now.lambda,
            &mut self.now.per_ml,
            &mut self.drift,
            &mut self.cells,
        ]
        .into_iter()
        .zip(lists.chunks(n))
        {
            list.copy_from_slice(values);
        }
        self.trial.clone_from(&self.now);
    }
}
