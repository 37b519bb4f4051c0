//! Reduced ventricle: the thick-walled one-fibre law (Arts 1991) with groups of cells that are
//! activated one after another.
//!
//! All groups have the same stretch, and each has its own activation time and cell state. The fibre
//! stress is the weighted mean of the groups' active stress plus the passive law. The paper's
//! Sa/(f·Cf) f⊗f is a Cauchy fibre stress of Sa.

use super::law_wall::LawWall;
use super::organ_law::{OrganLaw, end_diastolic_stretch};
use super::passive_state::{
    OneFibrePassive, PassiveLaw as _, pressure_per_stress, stress_at_stretch, stretch,
    stretch_ratio,
};
use super::recent_inflow::RecentInflow;
use super::{
    ActivationGroups, ActivationSpread, GroupContraction, TriedStep, Ventricle, VentricleError,
    VentricleSnapshot,
};
use crate::calcium::Calcium;
use crate::circulation::Circulation;
use crate::contraction::{ActiveStress, Contraction, ContractionError, EachStep, UniformStep};
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg, Ms};
use std::sync::Arc;

/// An additional term of the cavity pressure, such as a pericardium or wall viscosity. The base
/// model has none.
pub trait CavityPressureTerm: std::fmt::Debug + Send + Sync {
    /// Pressure \[mmHg\] at a volume \[mL\] and its rate \[mL/s\], and the derivatives with respect
    /// to both.
    fn pressure(&self, volume_ml: f64, rate_ml_per_s: f64) -> (f64, f64, f64);
}

/// Parameters of a one-fibre ventricle.
#[derive(Debug)]
pub struct OneFibreParameters {
    /// Passive law and reference volumes.
    pub passive: OneFibrePassive,
    /// Activation of the groups.
    pub activation: ActivationSpread,
    /// Contraction model of all groups.
    pub contraction: GroupContraction,
    /// Cycle length, after which every group is activated again.
    pub cycle_length: Ms,
    /// Additional terms of the cavity pressure.
    pub pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    /// Law of the organ; `None` for the one-fibre ventricle itself.
    pub law: Option<Arc<OrganLaw>>,
}

/// Committed state of the ventricle.
#[derive(Debug, Clone, Default)]
struct State {
    time_ms: f64,
    volume_ml: f64,
    inflow: RecentInflow,
    pressure_mmhg: f64,
    /// Stretch of the cells, from which the next step starts.
    lambda: f64,
    cells: Vec<f64>,
    sa_kpa: Vec<f64>,
    ca_um: Vec<f64>,
}

/// A left ventricle of groups of cells, advanced with its circulation: the one-fibre ventricle, whose
/// groups share one stretch, or the ventricle of an organ's law.
#[derive(Debug)]
pub struct OneFibreVentricle {
    passive: OneFibrePassive,
    wall: Option<LawWall>,
    /// Stretch from the unloaded volume over stretch from end-diastole.
    stretch_ratio: f64,
    /// Stretch in the cells over stretch from end-diastole.
    cell_stretch: f64,
    model: Box<dyn Contraction>,
    calcium: Option<Arc<dyn Calcium>>,
    cycle_length_ms: f64,
    activation_ms: Vec<f64>,
    weights: Vec<f64>,
    pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    iteration_limit: usize,
    accepted_residual_ml: f64,
    is_plain: bool,
    now: State,
    trial: Trial,
}

/// Buffers of a tried step.
#[derive(Debug, Default)]
struct Trial {
    pending: bool,
    time_ms: f64,
    dt_ms: f64,
    volume_ml: f64,
    inflow_ml_per_s: f64,
    pressure_mmhg: f64,
    /// Stretch of the cells in the last evaluation.
    lambda: f64,
    since_activation_ms: Vec<f64>,
    ca_um: Vec<f64>,
    cells: Vec<f64>,
    stress: Vec<ActiveStress>,
}

/// Kind of ventricle in snapshots.
const KIND: &str = "one-fibre 2";
/// The same with a law of the organ.
const KIND_WITH_LAW: &str = "organ-law 1";
/// Residual of the volume balance at which a step is accepted by default \[mL\].
const RESIDUAL_ML: f64 = 1e-8;
/// Volume \[mL\] over which the slope of a step's residual changes by a tenth at most. A correction δ of Newton's method leaves
/// a tenth of δ²/CURVATURE_ML.
const CURVATURE_ML: f64 = 1.0;
/// Largest correction \[mL\] without another evaluation of a model with states, which stay at the stretch before it.
const STATES_ML: f64 = 1e-4;
/// Residual of the volume balance \[mL\] that a search in the organ's law accepts after all iterations. Groups are linearised
/// around their last stretch, so that the wall's pressure jumps a little at kinks of the cells.
const KINK_ML: f64 = 1e-4;
/// Default limit of iterations, Newton's and bisection's together.
const ITERATIONS: usize = 60;

/// Ends and lengths \[ms\] of the steps from an activation before time zero to time zero, each of
/// at most one millisecond.
pub fn steps_before_the_beat(earliest_ms: f64) -> impl Iterator<Item = (f64, f64)> {
    let n = (-earliest_ms).max(0.0).ceil();
    let dt_ms = -earliest_ms / n.max(1.0);
    (0..n as usize)
        .rev()
        .map(move |left| (-dt_ms * left as f64, dt_ms))
}

/// Weighted sums of the groups' stress \[kPa\] and of its slope. Four sums of each go side by
/// side, since a single one would wait for each addition.
fn weighted_mean(weights: &[f64], stress: &[ActiveStress]) -> (f64, f64) {
    let (mut sa, mut dsa) = ([0.0; 4], [0.0; 4]);
    for (weights, stress) in weights.chunks(4).zip(stress.chunks(4)) {
        for (lane, (weight, stress)) in weights.iter().zip(stress).enumerate() {
            sa[lane] += weight * stress.sa_kpa;
            dsa[lane] += weight * stress.dsa_dlambda_kpa;
        }
    }
    let sum = |lanes: [f64; 4]| (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
    (sum(sa), sum(dsa))
}

impl OneFibreVentricle {
    /// Creates a ventricle in its end-diastolic state at time zero.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] if the spread or the cycle length is invalid.
    pub fn new(parameters: OneFibreParameters) -> Result<Self, VentricleError> {
        let (times_ms, weights) = parameters.activation.groups()?;
        Self::with_groups(parameters, &ActivationGroups::new(times_ms, weights)?)
    }

    /// As [`Self::new`], with given groups in place of the spread, for a late part of the wall or a
    /// measured map.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] if the cycle ends before the last group's activation.
    pub fn with_groups(
        parameters: OneFibreParameters,
        groups: &ActivationGroups,
    ) -> Result<Self, VentricleError> {
        let OneFibreParameters {
            passive,
            activation,
            contraction,
            cycle_length,
            pressure_terms,
            law,
        } = parameters;
        let (activation_ms, weights) = (groups.times_ms().to_vec(), groups.weights().to_vec());
        let latest = activation_ms
            .iter()
            .fold(0.0, |latest: f64, t| latest.max(*t));
        if !(cycle_length.0 > latest && cycle_length.0.is_finite()) {
            let expected = "longer than the latest activation time";
            return Err(VentricleError::Parameter {
                name: "cycle length",
                value: cycle_length.0,
                expected,
            });
        }
        let n = activation_ms.len();
        let n_calcium = if contraction.calcium.is_some() { n } else { 0 };
        let volume_ml = passive.end_diastolic_volume_ml;
        let cells = contraction.start_state.repeat(n);
        let stretch_ratio = stretch_ratio(&passive);
        let end_diastolic = end_diastolic_stretch(&passive, law.as_deref());
        let cell_stretch = contraction.stretch.at_end_diastole(end_diastolic);
        let wall = law.map(|law| {
            LawWall::new(
                law,
                &passive,
                &activation,
                &activation_ms,
                &weights,
                cell_stretch,
            )
        });
        let mut ventricle = Self {
            model: contraction.model,
            calcium: contraction.calcium,
            cycle_length_ms: cycle_length.0,
            weights,
            pressure_terms,
            iteration_limit: ITERATIONS,
            accepted_residual_ml: RESIDUAL_ML,
            is_plain: false,
            now: State {
                volume_ml,
                lambda: cell_stretch,
                cells: cells.clone(),
                sa_kpa: vec![0.0; n],
                ca_um: vec![0.0; n_calcium],
                ..State::default()
            },
            trial: Trial {
                since_activation_ms: vec![0.0; n],
                ca_um: vec![0.0; n_calcium],
                cells,
                stress: vec![ActiveStress::default(); n],
                ..Trial::default()
            },
            stretch_ratio,
            cell_stretch,
            passive,
            wall,
            activation_ms,
        };
        ventricle.contract_until_the_beat()?;
        ventricle.prepare_groups(0.0);
        ventricle.now.ca_um.copy_from_slice(&ventricle.trial.ca_um);
        // The stress at time zero comes from a step of vanishing length at constant stretch.
        let dt = 1e-6;
        let pressure = ventricle.settled_pressure(volume_ml, dt)?;
        ventricle.now.pressure_mmhg = pressure;
        for (sa, stress) in ventricle.now.sa_kpa.iter_mut().zip(&ventricle.trial.stress) {
            *sa = stress.sa_kpa;
        }
        Ok(ventricle)
    }

    /// Contracts cells that are activated before time zero at their end-diastolic length until
    /// then.
    fn contract_until_the_beat(&mut self) -> Result<(), VentricleError> {
        let earliest_ms = self
            .activation_ms
            .iter()
            .fold(0.0, |earliest: f64, t| earliest.min(*t));
        for (k, (end_ms, dt_ms)) in steps_before_the_beat(earliest_ms).enumerate() {
            if k == 0 {
                self.prepare_groups(end_ms - dt_ms);
                self.now.ca_um.copy_from_slice(&self.trial.ca_um);
            }
            self.prepare_groups(end_ms);
            self.settled_pressure(self.now.volume_ml, dt_ms)?;
            std::mem::swap(&mut self.now.cells, &mut self.trial.cells);
            self.now.ca_um.copy_from_slice(&self.trial.ca_um);
        }
        Ok(())
    }

    /// Limits the iterations of a step (at least one). The beat shortens a step that exceeds the
    /// limit.
    pub fn limit_iterations(&mut self, limit: usize) {
        self.iteration_limit = limit.max(1);
    }

    /// Starts steps from the last inflow and evaluates the wall for each candidate, up to a residual
    /// of the volume balance \[mL\].
    pub(crate) fn solve_plainly(&mut self, residual_ml: f64) {
        self.accepted_residual_ml = residual_ml;
        self.is_plain = true;
    }

    /// Kind of ventricle in snapshots.
    fn kind(&self) -> &'static str {
        match self.wall {
            Some(_) => KIND_WITH_LAW,
            None => KIND,
        }
    }

    /// Passive law of the wall.
    #[must_use]
    pub fn passive(&self) -> &OneFibrePassive {
        &self.passive
    }

    /// State that the next beat depends on: volume \[mL\], then the states of the cells.
    pub(crate) fn beat_state(&self) -> impl Iterator<Item = f64> {
        std::iter::once(self.now.volume_ml).chain(self.now.cells.iter().copied())
    }

    /// Starts a beat at time zero from a state in the form of [`Self::beat_state`].
    pub(crate) fn begin_beat(&mut self, state: &[f64]) {
        self.trial.pending = false;
        self.now.time_ms = 0.0;
        self.now.volume_ml = state[0];
        self.now.lambda = self.cell_stretch(state[0]);
        if let Some(wall) = &mut self.wall {
            wall.relax(&self.passive, state[0], self.now.lambda);
        }
        self.now.cells.copy_from_slice(&state[1..]);
    }

    /// Stretch of the cells of a relaxed wall at a cavity volume \[mL\].
    fn cell_stretch(&self, volume_ml: f64) -> f64 {
        let from_end_diastole = match &self.wall {
            Some(wall) => wall.relaxed_stretch(&self.passive, volume_ml),
            None => self.passive.active_stretch(Ml(volume_ml)).0,
        };
        from_end_diastole * self.cell_stretch
    }

    /// Computes times since activation and calcium of all groups at the end of a step. In the first
    /// beat, a group that is not yet activated has a negative time and the tail of the previous
    /// calcium transient.
    fn prepare_groups(&mut self, end_ms: f64) {
        let length = self.cycle_length_ms;
        for (since, t_a) in self
            .trial
            .since_activation_ms
            .iter_mut()
            .zip(&self.activation_ms)
        {
            let time = end_ms - t_a;
            *since = if time >= length {
                time - (time / length).floor() * length
            } else {
                time
            };
        }
        if let Some(wall) = &self.wall {
            wall.slow_down(&mut self.trial.since_activation_ms);
        }
        if let Some(calcium) = &self.calcium {
            for (ca, since) in self
                .trial
                .ca_um
                .iter_mut()
                .zip(&self.trial.since_activation_ms)
            {
                *ca = if *since < 0.0 { since + length } else { *since };
            }
            calcium.of_times(&mut self.trial.ca_um);
        }
    }

    /// Cavity pressure \[mmHg\] at a volume that stays as it is.
    fn settled_pressure(&mut self, volume_ml: f64, dt_ms: f64) -> Result<f64, VentricleError> {
        if let Some(wall) = &mut self.wall {
            wall.begin_at_rest();
        }
        let mut pressure = self.cavity_pressure(volume_ml, dt_ms)?.0;
        for _ in 0..ITERATIONS {
            if self.is_consistent() {
                break;
            }
            pressure = self.cavity_pressure(volume_ml, dt_ms)?.0;
        }
        let has_states = !self.now.cells.is_empty();
        if let Some(wall) = &mut self.wall {
            wall.commit(volume_ml, has_states);
        }
        Ok(pressure)
    }

    /// Whether the cells' stretch in the last evaluation agrees with their stress.
    fn is_consistent(&self) -> bool {
        self.wall.as_ref().is_none_or(LawWall::is_consistent)
    }

    /// Cavity pressure \[mmHg\] for a candidate volume at the end of a step, and its derivative
    /// with respect to the volume. Fills the cells of the trial.
    fn cavity_pressure(
        &mut self,
        volume_ml: f64,
        dt_ms: f64,
    ) -> Result<(f64, f64), VentricleError> {
        let (mut pressure, mut slope) = if self.wall.is_some() {
            self.pressure_by_law(volume_ml, dt_ms)?
        } else {
            self.pressure_of_one_fibre(volume_ml, dt_ms)?
        };
        let per_s = 1e3 / dt_ms;
        for term in &self.pressure_terms {
            let (p, dp_dv, dp_drate) =
                term.pressure(volume_ml, (volume_ml - self.now.volume_ml) * per_s);
            pressure += p;
            slope += dp_dv + dp_drate * per_s;
        }
        Ok((pressure, slope))
    }

    fn pressure_of_one_fibre(
        &mut self,
        volume_ml: f64,
        dt_ms: f64,
    ) -> Result<(f64, f64), VentricleError> {
        let wall = self.passive.wall_volume_ml;
        let reference = self.passive.end_diastolic_volume_ml;
        let (lambda, dlambda) = stretch(volume_ml, reference, wall);
        let step = UniformStep {
            dt_ms,
            lambda_prev: self.now.lambda,
            lambda: lambda * self.cell_stretch,
            since_activation_ms: &self.trial.since_activation_ms,
            ca_start_um: &self.now.ca_um,
            ca_end_um: &self.trial.ca_um,
        };
        let tried = self.model.try_step_uniform(
            &step,
            &self.now.cells,
            &mut self.trial.cells,
            &mut self.trial.stress,
        );
        tried.map_err(|source| self.failed(dt_ms, source))?;
        self.trial.lambda = lambda * self.cell_stretch;
        let (sa, dsa) = weighted_mean(&self.weights, &self.trial.stress);
        let dsa = dsa * self.cell_stretch;
        let (lambda, dlambda_passive) = (lambda * self.stretch_ratio, dlambda * self.stretch_ratio);
        let (passive, dpassive) = stress_at_stretch(&self.passive, lambda, dlambda_passive);
        let (factor, dfactor) = pressure_per_stress(volume_ml, wall);
        let stress = sa + passive;
        let pressure = MMHG_PER_KPA * stress * factor;
        let slope = MMHG_PER_KPA * ((dsa * dlambda + dpassive) * factor + stress * dfactor);
        Ok((pressure, slope))
    }

    /// As [`Self::cavity_pressure`], with the organ's law.
    fn pressure_by_law(
        &mut self,
        volume_ml: f64,
        dt_ms: f64,
    ) -> Result<(f64, f64), VentricleError> {
        let wall = self.wall.as_mut().expect("the ventricle has a law");
        let (lambda_prev, lambda) = wall.aim(volume_ml);
        let step = EachStep {
            dt_ms,
            lambda_prev,
            lambda,
            since_activation_ms: &self.trial.since_activation_ms,
            ca_start_um: &self.now.ca_um,
            ca_end_um: &self.trial.ca_um,
        };
        let tried = self.model.try_step_each(
            &step,
            &self.now.cells,
            &mut self.trial.cells,
            &mut self.trial.stress,
        );
        if let Err(source) = tried {
            return Err(self.failed(dt_ms, source));
        }
        Ok(wall.solve(
            &self.passive,
            self.cell_stretch,
            &self.weights,
            &self.trial.stress,
            volume_ml,
        ))
    }

    fn failed(&self, dt_ms: f64, source: ContractionError) -> VentricleError {
        VentricleError::Contraction {
            t_ms: self.now.time_ms + dt_ms,
            source,
        }
    }

    /// Keeps the end of a step for [`Ventricle::commit`].
    fn found(
        &mut self,
        volume_ml: f64,
        pressure_mmhg: f64,
        inflow_ml_per_s: f64,
        iterations: usize,
    ) -> TriedStep {
        self.trial.volume_ml = volume_ml;
        self.trial.pressure_mmhg = pressure_mmhg;
        self.trial.inflow_ml_per_s = inflow_ml_per_s;
        TriedStep {
            pressure: Mmhg(pressure_mmhg),
            volume: Ml(volume_ml),
            iterations,
        }
    }

    /// Finds the volume at which the circulation delivers the change of volume. The residual
    /// `V − V_n − dt Q(p(V))` increases wherever the ventricle stiffens with volume. A bracket
    /// guards Newton where it does not, and across kinks of the valves.
    ///
    /// The first candidate extrapolates the recent inflow, so that Newton's first correction is
    /// mostly small. The wall is not evaluated again after a small correction, over which its
    /// pressure is linear to within the accepted residual. Cells with states stay at the stretch of
    /// the evaluation, from which their next step starts.
    fn solve(
        &mut self,
        circulation: &mut Circulation,
        dt_ms: f64,
    ) -> Result<TriedStep, VentricleError> {
        let dt_s = dt_ms * 1e-3;
        let start = self.now.volume_ml;
        // The bracket spans volumes from an empty cavity to three times the start.
        let (mut low, mut high) = (0.02 * start, 3.0 * start);
        let (inflow, small) = if self.is_plain {
            (self.now.inflow.last(), 0.0)
        } else {
            let small = (CURVATURE_ML * self.accepted_residual_ml).sqrt();
            let has_states = !self.now.cells.is_empty();
            let small = if has_states {
                small.min(STATES_ML)
            } else {
                small
            };
            (self.now.inflow.extrapolated(dt_ms), small)
        };
        let mut volume = (start + inflow * dt_s).clamp(0.9 * start, 1.1 * start);
        let mut residual = f64::NAN;
        let mut last = None;
        for iterations in 1..=self.iteration_limit {
            let (pressure, dpressure) = self.cavity_pressure(volume, dt_ms)?;
            let flow = circulation.try_step(Mmhg(pressure), Ms(dt_ms))?;
            residual = volume - start - dt_s * flow.inflow_ml_per_s;
            if !residual.is_finite() {
                break;
            }
            let is_consistent = self.is_consistent();
            if is_consistent && residual.abs() <= self.accepted_residual_ml {
                return Ok(self.found(volume, pressure, flow.inflow_ml_per_s, iterations));
            }
            last = is_consistent.then_some((pressure, flow.inflow_ml_per_s));
            let slope = 1.0 - dt_s * flow.slope_ml_per_s_per_mmhg * dpressure;
            let correction = -residual / slope;
            if is_consistent && correction.abs() <= small {
                let pressure = pressure + dpressure * correction;
                let flow = circulation.try_step(Mmhg(pressure), Ms(dt_ms))?;
                let delivered = start + dt_s * flow.inflow_ml_per_s;
                if (delivered - (volume + correction)).abs() <= self.accepted_residual_ml {
                    return Ok(self.found(delivered, pressure, flow.inflow_ml_per_s, iterations));
                }
            }
            if !is_consistent && iterations <= ITERATIONS / 3 {
                // The residual is one of linearised cells, so that the bracket does not count it.
                volume = (volume + correction).clamp(low, high);
                continue;
            }
            if residual < 0.0 {
                low = low.max(volume);
            } else {
                high = high.min(volume);
            }
            let newton = volume + correction;
            // The first third of the iterations may be Newton's; afterwards only the bracket
            // counts.
            let use_newton = iterations <= ITERATIONS / 3 && newton > low && newton < high;
            volume = if use_newton {
                newton
            } else {
                0.5 * (low + high)
            };
        }
        // A search cannot cut the step, on the other side of the kink.
        let may_jump = self.is_plain && self.wall.is_some();
        if let (Some((pressure, inflow_ml_per_s)), true) = (last, may_jump)
            && residual.abs() <= KINK_ML
        {
            let delivered = start + dt_s * inflow_ml_per_s;
            return Ok(self.found(delivered, pressure, inflow_ml_per_s, self.iteration_limit));
        }
        Err(VentricleError::NoVolume {
            t_ms: self.now.time_ms + dt_ms,
            dt_ms,
            volume_ml: start,
            pressure_mmhg: self.now.pressure_mmhg,
            candidate_ml: volume,
            residual_ml: residual,
            iterations: self.iteration_limit,
        })
    }
}

impl Ventricle for OneFibreVentricle {
    fn time(&self) -> Ms {
        Ms(self.now.time_ms)
    }

    fn volume(&self) -> Ml {
        Ml(self.now.volume_ml)
    }

    fn pressure(&self) -> Mmhg {
        Mmhg(self.now.pressure_mmhg)
    }

    fn try_step(
        &mut self,
        circulation: &mut Circulation,
        dt: Ms,
    ) -> Result<TriedStep, VentricleError> {
        self.trial.pending = false;
        if !(dt.0 > 0.0 && dt.0.is_finite()) {
            return Err(VentricleError::Parameter {
                name: "time step",
                value: dt.0,
                expected: "positive",
            });
        }
        self.trial.time_ms = self.now.time_ms + dt.0;
        self.trial.dt_ms = dt.0;
        self.prepare_groups(self.trial.time_ms);
        if let Some(wall) = &mut self.wall {
            if dt.0 == self.now.inflow.step_ms() {
                wall.begin_step();
            } else {
                wall.begin_at_rest();
            }
        }
        let tried = self.solve(circulation, dt.0)?;
        self.trial.pending = true;
        Ok(tried)
    }

    fn commit(&mut self) {
        if !self.trial.pending {
            return;
        }
        self.trial.pending = false;
        // States of cells belong to the stretch of the last evaluation.
        let has_states = !self.now.cells.is_empty();
        if let Some(wall) = &mut self.wall {
            wall.commit(self.trial.volume_ml, has_states);
        }
        let lambda = if self.is_plain || !has_states {
            self.cell_stretch(self.trial.volume_ml)
        } else {
            self.trial.lambda
        };
        let (now, trial) = (&mut self.now, &mut self.trial);
        now.time_ms = trial.time_ms;
        now.volume_ml = trial.volume_ml;
        now.inflow.push(trial.inflow_ml_per_s, trial.dt_ms);
        now.pressure_mmhg = trial.pressure_mmhg;
        now.lambda = lambda;
        std::mem::swap(&mut now.cells, &mut trial.cells);
        now.ca_um.copy_from_slice(&trial.ca_um);
        for (sa, stress) in now.sa_kpa.iter_mut().zip(&trial.stress) {
            *sa = stress.sa_kpa;
        }
    }

    fn roll_back(&mut self) {
        self.trial.pending = false;
    }

    fn activation_times_ms(&self) -> &[f64] {
        &self.activation_ms
    }

    fn node_weights(&self) -> &[f64] {
        &self.weights
    }

    fn active_stress_kpa(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.now.sa_kpa);
    }

    fn calcium_um(&self, out: &mut [f64]) {
        if self.now.ca_um.is_empty() {
            out.fill(0.0);
        } else {
            out.copy_from_slice(&self.now.ca_um);
        }
    }

    fn stretch(&self, out: &mut [f64]) {
        match &self.wall {
            Some(wall) => out.copy_from_slice(wall.stretches()),
            None => out.fill(self.now.lambda),
        }
    }

    fn snapshot(&self) -> VentricleSnapshot {
        let now = &self.now;
        let mut values = vec![now.time_ms, now.volume_ml, now.pressure_mmhg, now.lambda];
        values.extend(now.inflow.to_values());
        values.extend(self.wall.iter().flat_map(LawWall::values));
        for part in [&now.cells, &now.sa_kpa, &now.ca_um] {
            values.extend_from_slice(part);
        }
        VentricleSnapshot {
            kind: self.kind().to_owned(),
            values,
        }
    }

    fn restore(&mut self, snapshot: &VentricleSnapshot) -> Result<(), VentricleError> {
        let now = &self.now;
        let lengths = [now.cells.len(), now.sa_kpa.len(), now.ca_um.len()];
        let n_wall = match self.wall {
            Some(_) => LawWall::n_values(now.sa_kpa.len()),
            None => 0,
        };
        let expected_values = 4 + RecentInflow::VALUES + n_wall + lengths.iter().sum::<usize>();
        if snapshot.kind != self.kind() || snapshot.values.len() != expected_values {
            return Err(VentricleError::ForeignSnapshot {
                found: snapshot.kind.clone(),
                found_values: snapshot.values.len(),
                expected: self.kind(),
                expected_values,
            });
        }
        let (scalars, rest) = snapshot.values.split_at(4);
        let (inflow, rest) = rest.split_at(RecentInflow::VALUES);
        let (of_wall, rest) = rest.split_at(n_wall);
        if let Some(wall) = &mut self.wall {
            wall.restore(of_wall);
        }
        let now = &mut self.now;
        now.time_ms = scalars[0];
        now.volume_ml = scalars[1];
        now.pressure_mmhg = scalars[2];
        now.lambda = scalars[3];
        now.inflow = RecentInflow::of_values(inflow);
        let (cells, rest) = rest.split_at(lengths[0]);
        let (sa, ca) = rest.split_at(lengths[1]);
        now.cells.copy_from_slice(cells);
        now.sa_kpa.copy_from_slice(sa);
        now.ca_um.copy_from_slice(ca);
        self.trial.pending = false;
        Ok(())
    }
}

#[cfg(test)]
#[path = "one_fibre_tests.rs"]
mod tests;
