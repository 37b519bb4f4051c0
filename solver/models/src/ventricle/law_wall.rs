//! Groups of cells in a wall with the organ's law: the stretch of each group, and the mean stress
//! that agrees with it.

use super::ActivationSpread;
use super::organ_law::{LawValue, OrganLaw};
use super::passive_state::OneFibrePassive;
use crate::contraction::ActiveStress;
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
    sa: f64,
    slope_of_stress: f64,
}

/// A weighted mean of the groups' stress as a linear function of T, M and the volume.
#[derive(Debug, Default)]
struct Sums {
    fixed: f64,
    per_t: f64,
    per_m: f64,
    per_ml: f64,
}

impl Sums {
    fn add(&mut self, weight: f64, group: &Group) {
        let answer = weight * group.slope_of_stress / group.slope;
        self.fixed += weight * group.sa + answer * group.own;
        self.per_t += answer * group.per_t;
        self.per_m += answer * group.per_m;
        self.per_ml += answer * group.per_ml;
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
        let evaluated_kpa: f64 = stress.iter().zip(weights).map(|(s, w)| w * s.sa_kpa).sum();
        let coupling = self.law.coupling_per_kpa(self.now.stress_kpa);
        let response = ratio * self.law.response_per_kpa(evaluated_kpa);
        let rise = ratio * self.law.stretch_per_difference(evaluated_kpa);
        let of_cells = |law: LawValue| [law.value, law.per_ml, law.per_kpa].map(|x| x * ratio);
        let mean = of_cells(self.law.stretch(passive, volume_ml, evaluated_kpa));
        let deviation = of_cells(self.law.deviation(passive, volume_ml, evaluated_kpa));
        // λ_g + δ_g = own + per_t T + per_m M, with T_g + T_g' δ_g in T and M.
        let group = |idx: usize| {
            let (half, lambda) = (self.halves[idx], self.evaluated[idx]);
            let ActiveStress {
                sa_kpa: sa,
                dsa_dlambda_kpa: slope_of_stress,
            } = stress[idx];
            let [value, per_ml, per_kpa]: [f64; 3] =
                std::array::from_fn(|k| mean[k] + half * deviation[k]);
            Group {
                own: value - per_kpa * evaluated_kpa - coupling * sa - lambda,
                per_ml,
                per_t: per_kpa + coupling,
                per_m: rise + half * (coupling - response),
                slope: (1.0 + coupling * slope_of_stress).max(SMALLEST_SLOPE),
                sa,
                slope_of_stress,
            }
        };
        let (mut of_t, mut of_m) = (Sums::default(), Sums::default());
        for (idx, weight) in weights.iter().enumerate() {
            let group = group(idx);
            of_t.add(*weight, &group);
            of_m.add(*weight * self.halves[idx], &group);
        }
        // T = of_t(T, M) and M = of_m(T, M): M is eliminated.
        let own_m = (1.0 - of_m.per_m).max(SMALLEST_SLOPE);
        let through_m = of_t.per_m / own_m;
        let feedback = (1.0 - of_t.per_t - through_m * of_m.per_t).max(SMALLEST_FEEDBACK);
        let mean_kpa = (of_t.fixed + through_m * of_m.fixed) / feedback;
        let kpa_per_ml = (of_t.per_ml + through_m * of_m.per_ml) / feedback;
        let difference_kpa = (of_m.fixed + of_m.per_t * mean_kpa) / own_m;
        let difference_per_ml = (of_m.per_ml + of_m.per_t * kpa_per_ml) / own_m;
        let mut inconsistency: f64 = 0.0;
        for idx in 0..weights.len() {
            let group = group(idx);
            let correction =
                (group.own + group.per_t * mean_kpa + group.per_m * difference_kpa) / group.slope;
            inconsistency = inconsistency.max(correction.abs());
            self.trial.lambda[idx] = self.evaluated[idx] + correction;
            self.trial.per_ml[idx] =
                (group.per_ml + group.per_t * kpa_per_ml + group.per_m * difference_per_ml)
                    / group.slope;
        }
        self.inconsistency = inconsistency;
        self.trial.volume_ml = volume_ml;
        self.trial.stress_kpa = mean_kpa;
        let pressure = self.law.pressure(passive, volume_ml, mean_kpa);
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
