//! Circulation of one ventricle: compartments, paths, and the consistent pressures at the end of a
//! step.

use super::component::{CirculationError, Compartment, FlowPath, TimeStep};
use cardiotwin_units::{Ml, MlPerS, Mmhg, Ms};
use serde::{Deserialize, Serialize};

/// Direction of a path as seen from the ventricle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Direction {
    /// From the compartment into the ventricle.
    IntoVentricle,
    /// From the ventricle into the compartment.
    OutOfVentricle,
}

/// One path between the ventricle and a compartment.
#[derive(Debug)]
pub(super) struct Connection {
    pub(super) path: Box<dyn FlowPath>,
    pub(super) compartment_idx: usize,
    pub(super) direction: Direction,
}

/// One path between two compartments, which closes the circuit behind the ventricle.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) path: Box<dyn FlowPath>,
    pub(super) from_idx: usize,
    pub(super) to_idx: usize,
}

impl Connection {
    /// Pressure difference that drives the path's flow \[mmHg\].
    pub(super) fn difference(&self, cavity_mmhg: f64, compartment_mmhg: f64) -> f64 {
        match self.direction {
            Direction::OutOfVentricle => cavity_mmhg - compartment_mmhg,
            Direction::IntoVentricle => compartment_mmhg - cavity_mmhg,
        }
    }

    /// A flow in the path's direction, counted into the compartment.
    pub(super) fn signed(&self, flow: f64) -> f64 {
        match self.direction {
            Direction::OutOfVentricle => flow,
            Direction::IntoVentricle => -flow,
        }
    }
}

impl Link {
    /// Pressure difference that drives the path's flow \[mmHg\].
    pub(super) fn difference(&self, pressures_mmhg: &[f64]) -> f64 {
        pressures_mmhg[self.from_idx] - pressures_mmhg[self.to_idx]
    }

    /// A flow in the path's direction, counted into a compartment.
    pub(super) fn signed(&self, compartment_idx: usize, flow: f64) -> f64 {
        if compartment_idx == self.to_idx {
            flow
        } else if compartment_idx == self.from_idx {
            -flow
        } else {
            0.0
        }
    }
}

/// Response of the circulation to a candidate cavity pressure at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetFlow {
    /// Mean net flow into the ventricle over the step \[mL/s\].
    pub inflow_ml_per_s: f64,
    /// Derivative of the inflow with respect to the cavity pressure \[mL/s/mmHg\], never positive.
    pub slope_ml_per_s_per_mmhg: f64,
}

/// All states of a circulation, which a restart needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CirculationState {
    /// Time of the last committed step \[ms\].
    pub time_ms: f64,
    /// States of the components, one compartment after another.
    pub states: Vec<f64>,
    /// Pressure of each compartment \[mmHg\].
    pub pressures_mmhg: Vec<f64>,
    /// Flow of each path \[mL/s\], positive in its direction: those to and from the ventricle, then
    /// those between compartments.
    pub flows_ml_per_s: Vec<f64>,
    /// Whether each path is open.
    pub open: Vec<bool>,
    /// Volume that passed each path since the start \[mL\].
    pub passed_ml: Vec<f64>,
}

/// The circulation of one ventricle.
#[derive(Debug)]
pub struct Circulation {
    pub(super) compartments: Vec<Box<dyn Compartment>>,
    /// Index of each compartment's first state.
    pub(super) first_state: Vec<usize>,
    pub(super) connections: Vec<Connection>,
    /// Paths between compartments; none in an open circuit, whose compartments do not depend on each
    /// other.
    pub(super) links: Vec<Link>,
    /// Paths whose blood has inertia: they are prepared before a step, and their flow is a state.
    pub(super) inertial: Vec<usize>,
    pub(super) now: CirculationState,
    /// Trial flows of the last evaluation, one per path.
    pub(super) trial: Vec<f64>,
    pub(super) trial_pressures: Vec<f64>,
    /// Weight of the flow at a step's start in the mean flow of the step.
    start_weight: f64,
    /// Step and cavity pressure of the trial.
    pending: Option<(TimeStep, Mmhg)>,
}

impl Default for Circulation {
    fn default() -> Self {
        Self::new()
    }
}

impl Circulation {
    /// An empty circulation, to be filled by [`Self::add_compartment`] and [`Self::connect`].
    #[must_use]
    pub fn new() -> Self {
        Self {
            compartments: Vec::new(),
            first_state: vec![0],
            connections: Vec::new(),
            links: Vec::new(),
            inertial: Vec::new(),
            now: CirculationState {
                time_ms: 0.0,
                states: Vec::new(),
                pressures_mmhg: Vec::new(),
                flows_ml_per_s: Vec::new(),
                open: Vec::new(),
                passed_ml: Vec::new(),
            },
            trial: Vec::new(),
            trial_pressures: Vec::new(),
            start_weight: 0.0,
            pending: None,
        }
    }

    /// Sets the weight of the flow at a step's start in the mean flow of the step: zero for the implicit Euler rule, which is
    /// the default, one half for the trapezoidal rule, which is of second order. Circuits with links keep the former.
    pub fn set_start_weight(&mut self, weight: f64) {
        self.start_weight = weight.clamp(0.0, 0.5);
    }

    /// Sets the flows to and from the ventricle, but for blood with inertia, to those at a cavity pressure, at which a run
    /// starts. Circuits with links, and flows that cannot be found, stay as they are: the first step says why.
    pub fn begin_flows(&mut self, cavity: Mmhg) {
        let still = TimeStep {
            end_ms: self.now.time_ms,
            dt_ms: 0.0,
        };
        if self.links.is_empty() {
            for idx in 0..self.compartments.len() {
                self.compartments[idx].prepare(still);
                if self.solve_compartment(idx, cavity.0, still).is_err() {
                    continue;
                }
                for (path, c) in self.connections.iter().enumerate() {
                    if c.compartment_idx == idx && !self.inertial.contains(&path) {
                        self.now.flows_ml_per_s[path] = self.trial[path];
                    }
                }
            }
        }
        self.roll_back();
    }

    /// Weight of the flow at a step's start in the mean flow of the step.
    fn start_weight(&self) -> f64 {
        if self.links.is_empty() {
            self.start_weight
        } else {
            0.0
        }
    }

    /// Mean flow of a path over the step of the trial \[mL/s\].
    fn mean_flow(&self, path_idx: usize) -> f64 {
        let (start, end) = (self.now.flows_ml_per_s[path_idx], self.trial[path_idx]);
        end + self.start_weight() * (start - end)
    }

    /// Committed flow into a compartment from the ventricle \[mL/s\].
    fn flow_into(&self, compartment_idx: usize) -> f64 {
        let into = self.connections.iter().zip(&self.now.flows_ml_per_s);
        into.filter(|(c, _)| c.compartment_idx == compartment_idx)
            .map(|(c, q)| c.signed(*q))
            .sum()
    }

    /// Adds a compartment in its initial state and returns its index.
    pub fn add_compartment(&mut self, compartment: Box<dyn Compartment>) -> usize {
        let first = self.now.states.len();
        self.now.states.resize(first + compartment.n_states(), 0.0);
        compartment.start(&mut self.now.states[first..]);
        let still = TimeStep {
            end_ms: self.now.time_ms,
            dt_ms: 0.0,
        };
        let (pressure, _) = compartment.pressure(&self.now.states[first..], 0.0, still);
        self.now.pressures_mmhg.push(pressure);
        self.trial_pressures.push(pressure);
        self.first_state.push(self.now.states.len());
        self.compartments.push(compartment);
        self.compartments.len() - 1
    }

    /// Connects the ventricle with a compartment and returns the index of the path. Paths of the
    /// ventricle come first: those between compartments move back by one.
    pub fn connect(
        &mut self,
        path: Box<dyn FlowPath>,
        compartment_idx: usize,
        direction: Direction,
    ) -> usize {
        let idx = self.connections.len();
        self.connections.push(Connection {
            path,
            compartment_idx,
            direction,
        });
        let behind = self
            .inertial
            .iter_mut()
            .filter(|inertial| **inertial >= idx);
        behind.for_each(|inertial| *inertial += 1);
        self.add_flow(idx)
    }

    /// Links two compartments and returns the index of the path.
    pub fn link(&mut self, path: Box<dyn FlowPath>, from_idx: usize, to_idx: usize) -> usize {
        self.links.push(Link {
            path,
            from_idx,
            to_idx,
        });
        self.add_flow(self.trial.len())
    }

    fn add_flow(&mut self, idx: usize) -> usize {
        self.now.flows_ml_per_s.insert(idx, 0.0);
        self.now.passed_ml.insert(idx, 0.0);
        self.now.open.insert(idx, false);
        self.trial.insert(idx, 0.0);
        idx
    }

    pub(super) fn path(&self, idx: usize) -> &dyn FlowPath {
        match idx.checked_sub(self.connections.len()) {
            None => self.connections[idx].path.as_ref(),
            Some(link) => self.links[link].path.as_ref(),
        }
    }

    fn path_mut(&mut self, idx: usize) -> &mut Box<dyn FlowPath> {
        match idx.checked_sub(self.connections.len()) {
            None => &mut self.connections[idx].path,
            Some(link) => &mut self.links[link].path,
        }
    }

    /// Replaces a compartment by another in its initial state. Paths do not change, but all
    /// compartments return to their initial states.
    ///
    /// # Panics
    /// If there is no compartment with this index.
    pub fn replace_compartment(&mut self, idx: usize, compartment: Box<dyn Compartment>) {
        let mut compartments = std::mem::take(&mut self.compartments);
        compartments[idx] = compartment;
        self.first_state.truncate(1);
        self.now.states.clear();
        self.now.pressures_mmhg.clear();
        self.trial_pressures.clear();
        self.pending = None;
        for compartment in compartments {
            self.add_compartment(compartment);
        }
    }

    /// Replaces a path by another with the same compartment and direction.
    ///
    /// # Panics
    /// If there is no path with this index.
    pub fn replace_path(&mut self, idx: usize, path: Box<dyn FlowPath>) {
        *self.path_mut(idx) = path;
    }

    /// Gives the blood in a path an inertance \[mmHg·s²/mL\].
    ///
    /// # Panics
    /// If there is no path with this index.
    pub fn set_inertance(&mut self, path_idx: usize, inertance: f64) {
        self.path_mut(path_idx).set_inertance(inertance);
        self.inertial.retain(|idx| *idx != path_idx);
        if inertance > 0.0 {
            self.inertial.push(path_idx);
        }
    }

    /// Time of the last committed step.
    #[must_use]
    pub fn time(&self) -> Ms {
        Ms(self.now.time_ms)
    }

    /// Index of the path with this name.
    #[must_use]
    pub fn path_idx(&self, name: &str) -> Option<usize> {
        (0..self.trial.len()).find(|idx| self.path(*idx).name() == name)
    }

    /// Index of the compartment with this name.
    #[must_use]
    pub fn compartment_idx(&self, name: &str) -> Option<usize> {
        self.compartments.iter().position(|c| c.name() == name)
    }

    /// Indices of the paths from the compartment with this name into the ventricle.
    #[must_use]
    pub fn paths_back_from(&self, compartment: &str) -> Vec<usize> {
        self.paths(compartment, Direction::IntoVentricle)
    }

    /// Indices of the paths out of the ventricle to the compartment with this name.
    #[must_use]
    pub fn paths_out_to(&self, compartment: &str) -> Vec<usize> {
        self.paths(compartment, Direction::OutOfVentricle)
    }

    fn paths(&self, compartment: &str, direction: Direction) -> Vec<usize> {
        let between = |c: &Connection| {
            c.direction == direction && self.compartments[c.compartment_idx].name() == compartment
        };
        (0..self.connections.len())
            .filter(|idx| between(&self.connections[*idx]))
            .collect()
    }

    /// Committed pressure of a compartment.
    #[must_use]
    pub fn pressure(&self, compartment_idx: usize) -> Mmhg {
        Mmhg(self.now.pressures_mmhg[compartment_idx])
    }

    /// Committed flow of a path, positive in its direction.
    #[must_use]
    pub fn flow(&self, path_idx: usize) -> MlPerS {
        MlPerS(self.now.flows_ml_per_s[path_idx])
    }

    /// Whether a path was open at the end of the last committed step.
    #[must_use]
    pub fn is_open(&self, path_idx: usize) -> bool {
        self.now.open[path_idx]
    }

    /// Committed net flow into the ventricle.
    #[must_use]
    pub fn net_inflow(&self) -> MlPerS {
        MlPerS(self.signed_sum(&self.now.flows_ml_per_s))
    }

    /// Net volume that entered the ventricle since the start, which equals the growth of its
    /// volume.
    #[must_use]
    pub fn net_volume_in(&self) -> Ml {
        Ml(self.signed_sum(&self.now.passed_ml))
    }

    /// Volume that passed a path since the start, in its direction.
    #[must_use]
    pub fn passed(&self, path_idx: usize) -> Ml {
        Ml(self.now.passed_ml[path_idx])
    }

    fn signed_sum(&self, values: &[f64]) -> f64 {
        self.connections
            .iter()
            .zip(values)
            .map(|(c, v)| -c.signed(*v))
            .sum()
    }

    /// Sum of the flows into a compartment at its candidate pressure, and its derivative with
    /// respect to the cavity pressure. The laws depend only on the pressure difference, so that the
    /// derivative with respect to the compartment pressure is the negative of it. Keeps the flows as
    /// the trial.
    fn inflow(
        &mut self,
        compartment_idx: usize,
        cavity_mmhg: f64,
        pressure_mmhg: f64,
    ) -> (f64, f64) {
        let (mut flow, mut slope) = (0.0, 0.0);
        for (c, trial) in self.connections.iter().zip(&mut self.trial) {
            if c.compartment_idx != compartment_idx {
                continue;
            }
            let (q, dq) = c.path.flow(c.difference(cavity_mmhg, pressure_mmhg));
            *trial = q;
            flow += c.signed(q);
            slope += dq;
        }
        (flow, slope)
    }

    /// Evaluates a step of `dt` that ends with this cavity pressure and keeps it as the pending
    /// trial. The committed state does not change, so that the step can be evaluated again.
    ///
    /// The residual of each compartment increases with its pressure and is piecewise smooth. A
    /// Newton step that leaves the bracket of the root is replaced by bisection, so that valves
    /// that change state during the iteration cannot cause a cycle.
    ///
    /// # Errors
    /// [`CirculationError::NoPressure`] if the pressure of a compartment is not found (a value is
    /// not finite).
    pub fn try_step(&mut self, cavity: Mmhg, dt: Ms) -> Result<NetFlow, CirculationError> {
        let step = TimeStep {
            end_ms: self.now.time_ms + dt.0,
            dt_ms: dt.0,
        };
        for i in 0..self.inertial.len() {
            let idx = self.inertial[i];
            let flow = self.now.flows_ml_per_s[idx];
            self.path_mut(idx).prepare(step, flow);
        }
        if !self.links.is_empty() {
            let net = self.solve_together(cavity.0, step)?;
            self.pending = Some((step, cavity));
            return Ok(net);
        }
        let (mut net, mut slope) = (0.0, 0.0);
        for idx in 0..self.compartments.len() {
            self.compartments[idx].prepare(step);
            let (flow, dflow) = self.solve_compartment(idx, cavity.0, step)?;
            net -= flow;
            slope -= dflow;
        }
        self.pending = Some((step, cavity));
        Ok(NetFlow {
            inflow_ml_per_s: net,
            slope_ml_per_s_per_mmhg: slope,
        })
    }

    /// Finds the pressure of one compartment; returns the flow into it and the total derivative of
    /// that flow with respect to the cavity pressure.
    fn solve_compartment(
        &mut self,
        idx: usize,
        cavity_mmhg: f64,
        step: TimeStep,
    ) -> Result<(f64, f64), CirculationError> {
        const LIMIT: usize = 100;
        let states = self.first_state[idx]..self.first_state[idx + 1];
        let weight = self.start_weight();
        let at_start = if weight > 0.0 {
            self.flow_into(idx)
        } else {
            0.0
        };
        let mean = |flow: f64| (1.0 - weight) * flow + weight * at_start;
        if self.compartments[idx].is_source() {
            let state = &self.now.states[states.clone()];
            let (pressure, _) = self.compartments[idx].pressure(state, 0.0, step);
            let (flow, slope) = self.inflow(idx, cavity_mmhg, pressure);
            self.trial_pressures[idx] = pressure;
            if flow.is_finite() {
                return Ok((mean(flow), (1.0 - weight) * slope));
            }
        }
        let series = self.compartments[idx].series_resistance();
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut pressure = self.trial_pressures[idx];
        for _ in 0..LIMIT {
            let (flow, slope) = self.inflow(idx, cavity_mmhg, pressure);
            let state = &self.now.states[states.clone()];
            let (mut wanted, mut stiffness) =
                self.compartments[idx].pressure(state, mean(flow), step);
            if weight > 0.0 {
                // States follow the mean flow, but the pressure behind the resistance that of the end.
                wanted += series * (flow - mean(flow));
                stiffness += weight * (series - stiffness);
            }
            let residual = pressure - wanted;
            let gain = 1.0 + stiffness * slope;
            if !residual.is_finite() {
                break;
            }
            // The correction is tested, not the residual, which includes round-off of the flow
            // through a tiny resistance.
            if residual.abs() <= 1e-12 * gain * (1.0 + pressure.abs())
                || high - low <= 1e-13 * (1.0 + pressure.abs())
            {
                self.trial_pressures[idx] = pressure;
                return Ok((mean(flow), (1.0 - weight) * slope / gain));
            }
            if residual < 0.0 {
                low = low.max(pressure);
            } else {
                high = high.min(pressure);
            }
            let newton = pressure - residual / gain;
            pressure = if newton > low && newton < high {
                newton
            } else {
                0.5 * (low + high)
            };
            if !pressure.is_finite() {
                break;
            }
        }
        self.trial_pressures[idx] = self.now.pressures_mmhg[idx];
        let compartment = self.compartments[idx].name();
        Err(CirculationError::NoPressure {
            compartment,
            cavity_mmhg,
            t_ms: step.end_ms,
            dt_ms: step.dt_ms,
        })
    }

    /// Accepts the pending trial, if there is one.
    pub fn commit(&mut self) {
        let Some((step, cavity)) = self.pending.take() else {
            return;
        };
        for (idx, compartment) in self.compartments.iter().enumerate() {
            let into = self.connections.iter().enumerate();
            let mut inflow: f64 = (into.filter(|(_, c)| c.compartment_idx == idx))
                .map(|(path, c)| c.signed(self.mean_flow(path)))
                .sum();
            for (link, q) in self.links.iter().zip(&self.trial[self.connections.len()..]) {
                inflow += link.signed(idx, *q);
            }
            compartment.advance(
                &mut self.now.states[self.first_state[idx]..self.first_state[idx + 1]],
                inflow,
                step,
            );
        }
        for idx in 0..self.trial.len() {
            self.now.passed_ml[idx] += self.mean_flow(idx) * step.dt_ms * 1e-3;
        }
        self.now
            .pressures_mmhg
            .copy_from_slice(&self.trial_pressures);
        self.now.flows_ml_per_s.copy_from_slice(&self.trial);
        for (open, c) in self.now.open.iter_mut().zip(&self.connections) {
            let difference = c.difference(cavity.0, self.trial_pressures[c.compartment_idx]);
            *open = c.path.is_open(difference);
        }
        let links = self.now.open[self.connections.len()..].iter_mut();
        for (open, link) in links.zip(&self.links) {
            *open = link.path.is_open(link.difference(&self.trial_pressures));
        }
        self.now.time_ms = step.end_ms;
    }

    /// Drops the pending trial.
    pub fn roll_back(&mut self) {
        self.pending = None;
        self.trial_pressures
            .copy_from_slice(&self.now.pressures_mmhg);
    }

    /// Blood in all compartments; `None` if one of them does not hold what flows in, so that the
    /// circuit is open.
    #[must_use]
    pub fn volume(&self) -> Option<Ml> {
        let volumes = (self.compartments.iter().enumerate()).map(|(idx, compartment)| {
            let states = self.first_state[idx]..self.first_state[idx + 1];
            compartment.volume_ml(&self.now.states[states])
        });
        volumes.sum::<Option<f64>>().map(Ml)
    }

    /// Index in [`Self::beat_state`] of the first state of the compartment with this name.
    pub(crate) fn first_state_of(&self, name: &str) -> Option<usize> {
        self.compartment_idx(name).map(|idx| self.first_state[idx])
    }

    /// Copy of all committed states.
    #[must_use]
    pub fn snapshot(&self) -> CirculationState {
        self.now.clone()
    }

    /// States that the next beat depends on: those of the components, and flows with inertia.
    pub(crate) fn beat_state(&self) -> impl Iterator<Item = f64> {
        let flow = |idx: &usize| self.now.flows_ml_per_s[*idx];
        (self.now.states.iter().copied()).chain(self.inertial.iter().map(flow))
    }

    /// Starts a beat at time zero with these states.
    pub(crate) fn begin_beat(&mut self, states: &[f64]) {
        let (states, flows) = states.split_at(self.now.states.len());
        self.now.states.copy_from_slice(states);
        for (idx, flow) in self.inertial.iter().zip(flows) {
            self.now.flows_ml_per_s[*idx] = *flow;
        }
        self.now.time_ms = 0.0;
        self.roll_back();
    }

    /// Restores a snapshot and drops any pending trial.
    ///
    /// # Errors
    /// [`CirculationError::ForeignSnapshot`] if its sizes differ from those of this circulation.
    pub fn restore(&mut self, state: &CirculationState) -> Result<(), CirculationError> {
        let fits = state.states.len() == self.now.states.len()
            && state.pressures_mmhg.len() == self.compartments.len()
            && [
                state.flows_ml_per_s.len(),
                state.open.len(),
                state.passed_ml.len(),
            ] == [self.trial.len(); 3];
        if !fits {
            return Err(CirculationError::ForeignSnapshot {
                found: state.states.len(),
                found_paths: state.flows_ml_per_s.len(),
                expected: self.now.states.len(),
                expected_paths: self.trial.len(),
            });
        }
        self.now.clone_from(state);
        self.roll_back();
        Ok(())
    }
}
