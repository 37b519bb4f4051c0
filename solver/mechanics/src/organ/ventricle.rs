//! The finite-element ventricle behind the interface of all ventricles.

use cardiotwin_models::circulation::{Circulation, CirculationError};
use cardiotwin_models::effects::FibreViscosity;
use cardiotwin_models::ventricle::{
    CavityPressureTerm, GroupContraction, TriedStep, Ventricle, VentricleError, VentricleSnapshot,
};
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg, Ms};

use super::anatomy::Anatomy;
use super::contraction::{NodeAverage, PointContraction};
use super::passive_state::PassiveState;
use super::wall::{WallError, WallParameters};
use crate::body::Deformation;
use crate::dynamics::{Candidate, Dynamics, State};
use crate::step::{Closure, PointStress, Solver, StepError, StepReport, StepSettings, step};

/// Kind in snapshots.
const KIND: &str = "finite-element 2";

/// Everything that defines a finite-element ventricle.
#[derive(Debug)]
pub struct VentricleParts<'a> {
    /// Anatomy.
    pub anatomy: &'a Anatomy,
    /// Wall, with the stiffness that was fitted.
    pub wall: &'a WallParameters,
    /// End-diastolic state.
    pub end_diastole: PassiveState,
    /// Contraction model of every point.
    pub contraction: GroupContraction,
    /// Activation time of each vertex of the mesh \[ms\].
    pub activation_ms: &'a [f64],
    /// Cycle length, after which every point is activated again.
    pub cycle_length: Ms,
    /// Further parts of the cavity pressure.
    pub pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    /// Viscous stress along the fibre.
    pub viscosity: Option<FibreViscosity>,
    /// Settings of the time steps.
    pub settings: StepSettings,
}

/// Work of all steps so far, failed ones included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VentricleWork {
    /// Steps tried.
    pub steps: usize,
    /// Newton iterations.
    pub newton_iterations: usize,
    /// Krylov iterations of both right-hand sides.
    pub krylov_iterations: usize,
    /// Factorisations.
    pub factorisations: usize,
}

/// The 3D ventricle.
#[derive(Debug)]
pub struct FiniteElementVentricle {
    dynamics: Dynamics,
    contraction: PointContraction,
    average: NodeAverage,
    node_activation_ms: Vec<f64>,
    pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    settings: StepSettings,
    solver: Solver,
    time_ms: f64,
    now: State,
    volume_mm3: f64,
    /// Pressure that the circulation sees: the wall's and the further parts' \[kPa\].
    cavity_kpa: f64,
    /// Change of the wall's pressure over the last step \[kPa/ms\].
    rate_kpa_per_ms: f64,
    trial: Option<Trial>,
    work: VentricleWork,
}

#[derive(Debug)]
struct Trial {
    time_ms: f64,
    dt_ms: f64,
    state: State,
    volume_mm3: f64,
    cavity_kpa: f64,
}

impl FiniteElementVentricle {
    /// A ventricle in end-diastole, at rest, time zero.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] for a cycle that ends before the last activation, or activation times that are not of
    /// the mesh; [`VentricleError::NoMotion`] where the wall cannot be supported.
    pub fn new(parts: VentricleParts<'_>) -> Result<Self, VentricleError> {
        let VentricleParts { anatomy, wall, end_diastole, contraction, activation_ms, cycle_length, .. } = parts;
        let parameter = |name, value, expected| Err(VentricleError::Parameter { name, value, expected });
        if activation_ms.len() != anatomy.n_vertices {
            return parameter("activation times", activation_ms.len() as f64, "as many as the mesh has nodes");
        }
        let mut of_muscle = vec![false; anatomy.n_vertices];
        for (corners, _) in anatomy.corners.iter().zip(&anatomy.contracts).filter(|(_, c)| **c) {
            corners.iter().for_each(|n| of_muscle[*n as usize] = true);
        }
        let latest = (0..anatomy.n_vertices).filter(|n| of_muscle[*n]).map(|n| activation_ms[n]).fold(0.0, f64::max);
        if !latest.is_finite() {
            return parameter("latest activation time", latest, "finite in all contracting tissue");
        }
        if !(cycle_length.0 > latest && cycle_length.0.is_finite()) {
            return parameter("cycle length", cycle_length.0, "longer than the latest activation time");
        }
        let failed =
            |error: &dyn std::error::Error| VentricleError::NoMotion { t_ms: 0.0, dt_ms: 0.0, reason: chain(error) };
        let PassiveState { mut dynamics, u, pressure_kpa, .. } = end_diastole;
        wall.support(anatomy, &mut dynamics, &u).map_err(|e: WallError| failed(&e))?;
        let mut deformation = Deformation::default();
        dynamics.body.deform(&u, dynamics.comm.as_ref(), &mut deformation);
        let convention = wall.active.convention;
        let mut points = PointContraction::new(
            contraction,
            cycle_length.0,
            convention,
            anatomy,
            &dynamics.body,
            activation_ms,
            &deformation,
        )
        .with_viscosity(parts.viscosity);
        // The stress at time zero: a step of vanishing length at constant stretch.
        let mut active = vec![];
        points
            .evaluate(1e-6, &deformation, &mut active)
            .map_err(|source| VentricleError::Contraction { t_ms: 0.0, source })?;
        points.commit();
        let mut now = dynamics.start(u, active, pressure_kpa).map_err(|s| failed(&inverted(s)))?;
        // What the solver of step 0 left is no load: the beat begins at rest.
        now.motion.a.fill(0.0);
        let average = points.node_average(anatomy, &dynamics.body);
        let node_activation_ms = average.nodes.iter().map(|n| activation_ms[*n as usize]).collect();
        let volume_mm3 = dynamics.cavity_volume(&now.motion.u);
        let solver = Solver::new();
        Ok(Self {
            dynamics,
            contraction: points,
            average,
            node_activation_ms,
            settings: parts.settings,
            solver,
            time_ms: 0.0,
            volume_mm3,
            cavity_kpa: pressure_kpa
                + parts.pressure_terms.iter().map(|t| t.pressure(1e-3 * volume_mm3, 0.0).0 / MMHG_PER_KPA).sum::<f64>(),
            pressure_terms: parts.pressure_terms,
            rate_kpa_per_ms: 0.0,
            now,
            trial: None,
            work: VentricleWork::default(),
        })
    }

    /// Work so far.
    #[must_use]
    pub fn work(&self) -> VentricleWork {
        self.work
    }

    /// Committed state of motion: displacement from the unloaded geometry, three numbers a node.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.now
    }

    /// The moving wall.
    #[must_use]
    pub fn dynamics(&self) -> &Dynamics {
        &self.dynamics
    }

    /// Nodes (vertices of the mesh) of the nodal traces.
    #[must_use]
    pub fn nodes(&self) -> &[u32] {
        &self.average.nodes
    }

    /// Forgets what the solver keeps from step to step and a snapshot does not hold, a factorisation: before a checkpoint, so
    /// that the restarted beat is the uninterrupted one to the bit with a direct solver, too.
    pub fn forget_solver(&mut self) {
        self.solver.forget();
    }
}

fn inverted(s: crate::newton::Smallest) -> StepError {
    StepError::Inverted { element: s.element, volume_ratio: s.volume_ratio }
}

fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        text += &format!(": {inner}");
        source = inner.source();
    }
    text
}

/// Cavity pressure \[kPa\] and volume \[mm³\] that the circulation leaves, for the wall's pressure, with the volume's slope.
fn balance(
    circulation: &mut Circulation,
    terms: &[Box<dyn CavityPressureTerm>],
    start_mm3: f64,
    dt_ms: f64,
    wall_kpa: f64,
) -> Result<(f64, f64, f64), CirculationError> {
    let mut cavity = wall_kpa;
    for iteration in 0.. {
        let flow = circulation.try_step(Mmhg(cavity * MMHG_PER_KPA), Ms(dt_ms))?;
        // mL/s over ms are mm³.
        let volume = start_mm3 + dt_ms * flow.inflow_ml_per_s;
        let slope = dt_ms * flow.slope_ml_per_s_per_mmhg * MMHG_PER_KPA;
        if terms.is_empty() {
            return Ok((cavity, volume, slope));
        }
        let (mut added, mut added_slope) = (0.0, 0.0);
        for term in terms {
            let (p, by_volume, by_rate) = term.pressure(volume * 1e-3, flow.inflow_ml_per_s);
            added += p / MMHG_PER_KPA;
            added_slope += (by_volume * 1e-3 + by_rate / dt_ms) / MMHG_PER_KPA;
        }
        // p − p_wall − added(W(p)) grows with p: W falls with p, and added pressure grows with volume.
        let gain = 1.0 - added_slope * slope;
        let change = (cavity - wall_kpa - added) / gain;
        if change.abs() <= 1e-12 * (1.0 + cavity.abs()) || iteration >= 50 || !change.is_finite() {
            return Ok((cavity, volume, slope / gain));
        }
        cavity -= change;
    }
    unreachable!("the loop returns")
}

impl Ventricle for FiniteElementVentricle {
    fn time(&self) -> Ms {
        Ms(self.time_ms)
    }

    fn volume(&self) -> Ml {
        Ml(self.volume_mm3 * 1e-3)
    }

    fn pressure(&self) -> Mmhg {
        Mmhg(self.cavity_kpa * MMHG_PER_KPA)
    }

    fn try_step(&mut self, circulation: &mut Circulation, dt: Ms) -> Result<TriedStep, VentricleError> {
        self.trial = None;
        if !(dt.0 > 0.0 && dt.0.is_finite()) {
            return Err(VentricleError::Parameter { name: "time step", value: dt.0, expected: "positive" });
        }
        let dt_ms = dt.0;
        let end_ms = self.time_ms + dt_ms;
        self.contraction.begin_step(end_ms);
        let mut candidate = Candidate::default();
        self.dynamics.scheme.predict(dt_ms, &self.now.motion, &mut candidate.motion.u);
        candidate.pressure_kpa = self.now.pressure_kpa + dt_ms * self.rate_kpa_per_ms;
        let mut cavity_kpa = self.cavity_kpa;
        let (start, terms) = (self.volume_mm3, &self.pressure_terms);
        let mut volume_for = |wall_kpa: f64| {
            let (cavity, volume, slope) = balance(circulation, terms, start, dt_ms, wall_kpa)?;
            cavity_kpa = cavity;
            Ok((volume, slope))
        };
        self.work.steps += 1;
        let result = step(
            &self.dynamics,
            &self.now,
            dt_ms,
            &mut candidate,
            &mut self.contraction,
            &mut Closure::Balance(&mut volume_for),
            &mut self.solver,
            &self.settings,
        );
        let (force, report) = result.map_err(|error| match error {
            StepError::Contraction(source) => VentricleError::Contraction { t_ms: end_ms, source },
            StepError::Circulation(source) => VentricleError::Circulation(source),
            other => VentricleError::NoMotion { t_ms: end_ms, dt_ms, reason: chain(&other) },
        })?;
        let StepReport { iterations, krylov_iterations, factorisations, volume_residual_mm3, .. } = report;
        self.work.newton_iterations += iterations;
        self.work.krylov_iterations += krylov_iterations;
        self.work.factorisations += factorisations;
        // What passes the valves is what the volume changes by: the residual is not carried on.
        let volume_mm3 = self.dynamics.cavity_volume(&candidate.motion.u) - volume_residual_mm3;
        let state = State { motion: candidate.motion, force, pressure_kpa: candidate.pressure_kpa };
        self.trial = Some(Trial { time_ms: end_ms, dt_ms, state, volume_mm3, cavity_kpa });
        Ok(TriedStep { pressure: Mmhg(cavity_kpa * MMHG_PER_KPA), volume: Ml(volume_mm3 * 1e-3), iterations })
    }

    fn commit(&mut self) {
        if let Some(trial) = self.trial.take() {
            self.rate_kpa_per_ms = (trial.state.pressure_kpa - self.now.pressure_kpa) / trial.dt_ms;
            self.time_ms = trial.time_ms;
            self.now = trial.state;
            self.volume_mm3 = trial.volume_mm3;
            self.cavity_kpa = trial.cavity_kpa;
            self.contraction.commit();
        }
    }

    fn roll_back(&mut self) {
        self.trial = None;
    }

    fn activation_times_ms(&self) -> &[f64] {
        &self.node_activation_ms
    }

    fn node_weights(&self) -> &[f64] {
        &self.average.weights
    }

    fn active_stress_kpa(&self, out: &mut [f64]) {
        self.average.apply(self.contraction.committed()[1], out);
    }

    fn calcium_um(&self, out: &mut [f64]) {
        self.average.apply(self.contraction.committed()[2], out);
    }

    fn stretch(&self, out: &mut [f64]) {
        self.average.apply(self.contraction.committed()[0], out);
    }

    fn snapshot(&self) -> VentricleSnapshot {
        let State { motion, force, pressure_kpa } = &self.now;
        let mut values = vec![self.time_ms, self.volume_mm3, self.cavity_kpa, self.rate_kpa_per_ms, *pressure_kpa];
        for part in [&motion.u, &motion.v, &motion.a, force] {
            values.extend_from_slice(part);
        }
        values.extend(self.contraction.snapshot());
        values.extend_from_slice(self.solver.response());
        VentricleSnapshot { kind: KIND.to_owned(), values }
    }

    fn restore(&mut self, snapshot: &VentricleSnapshot) -> Result<(), VentricleError> {
        let n = self.now.motion.u.len();
        let expected_values = 5 + 4 * n + self.contraction.snapshot_len();
        // A solver that has not solved yet has no start for its next solve.
        let lengths = [expected_values, expected_values + n];
        if snapshot.kind != KIND || !lengths.contains(&snapshot.values.len()) {
            return Err(VentricleError::ForeignSnapshot {
                found: snapshot.kind.clone(),
                found_values: snapshot.values.len(),
                expected: KIND,
                expected_values,
            });
        }
        let (scalars, mut rest) = snapshot.values.split_at(5);
        self.time_ms = scalars[0];
        self.volume_mm3 = scalars[1];
        self.cavity_kpa = scalars[2];
        self.rate_kpa_per_ms = scalars[3];
        self.now.pressure_kpa = scalars[4];
        let State { motion, force, .. } = &mut self.now;
        for part in [&mut motion.u, &mut motion.v, &mut motion.a, force] {
            let (own, others) = rest.split_at(n);
            part.clear();
            part.extend_from_slice(own);
            rest = others;
        }
        let (own, response) = rest.split_at(self.contraction.snapshot_len());
        self.contraction.restore(own);
        self.trial = None;
        self.solver.forget();
        self.solver.respond_from(response);
        Ok(())
    }
}
