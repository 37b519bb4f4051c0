//! Pressure of the load for a measured flow that is linear between its samples.
//!
//! States: pressure Pa of the (proximal) compliance, creep x, flow q through the junction, pressure
//! Pb of the distal compliance, and flow through the parallel inertance. States of effects that are
//! off stay constant. A linear load advances by the matrix exponential, which is exact for such a
//! flow. A pressure-dependent compliance advances by the fourth-order Runge–Kutta method.

use super::effects::Effect;
use super::parameters::{Values, at};
use super::record::Record;
use nalgebra::{DMatrix, DVector, SMatrix};

/// Number of states of the load.
const N: usize = 5;
/// Number of states plus flow, its slope and a constant.
const AUGMENTED: usize = N + 3;
const PA: usize = 0;
const CREEP: usize = 1;
const JUNCTION: usize = 2;
const PB: usize = 3;
const PARALLEL: usize = 4;
/// Longest step of the nonlinear load \[s\].
const LONGEST_STEP_S: f64 = 1.5e-3;

/// Smallest impedance of a tube \[mmHg s/mL\].
const LEAST_IMPEDANCE: f64 = 1e-3;
/// Number of runs through the first cycle before the record behind a tube starts.
const TUBE_CYCLES: usize = 3;

type State = [f64; N];

/// Pressure of the compliance at the beginning of the record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// The pressure is fitted, so that the record may start anywhere and drift.
    #[default]
    Free,
    /// The pressure is that of the periodic steady state of the record's first cycle.
    Periodic,
}

/// Times of flow and pressure samples in one sequence, with the flow.
struct Grid {
    time_s: Vec<f64>,
    flow: Vec<f64>,
    /// Slope of the flow by central differences, linear between samples.
    slope: Vec<f64>,
    /// Index of each pressure sample in the grid.
    sample: Vec<usize>,
}

/// Largest distance between two times that count as equal \[s\].
const SAME_S: f64 = 1e-8;

impl Grid {
    /// Builds the grid, with pressure samples moved back by the lag to the time of the event they
    /// show.
    fn new(record: &Record, lag_s: f64) -> Self {
        let knots = &record.flow_time_s;
        let moved: Vec<f64> = record.pressure_time_s.iter().map(|t| t - lag_s).collect();
        let n = knots.len() + moved.len();
        let mut time_s: Vec<f64> = Vec::with_capacity(n);
        let mut sample = Vec::with_capacity(moved.len());
        // The load starts at the first pressure sample, wherever the flow starts.
        let mut k = knots.partition_point(|t| *t < moved[0] - SAME_S);
        for t in &moved {
            while k < knots.len() && knots[k] < t - SAME_S {
                push(&mut time_s, knots[k]);
                k += 1;
            }
            push(&mut time_s, *t);
            sample.push(time_s.len() - 1);
        }
        let slopes = central_slopes(knots, &record.flow);
        let mut i = 0;
        let (mut flow, mut slope) = (
            Vec::with_capacity(time_s.len()),
            Vec::with_capacity(time_s.len()),
        );
        for t in &time_s {
            while i + 2 < knots.len() && knots[i + 1] <= *t {
                i += 1;
            }
            let share = ((t - knots[i]) / (knots[i + 1] - knots[i])).clamp(0.0, 1.0);
            let between = |v: &[f64]| v[i] + share * (v[i + 1] - v[i]);
            flow.push(between(&record.flow));
            slope.push(between(&slopes));
        }
        Self {
            time_s,
            flow,
            slope,
            sample,
        }
    }
}

fn push(times: &mut Vec<f64>, t: f64) {
    if times.last().is_none_or(|last| t - last > SAME_S) {
        times.push(t);
    }
}

fn central_slopes(time: &[f64], value: &[f64]) -> Vec<f64> {
    let last = time.len() - 1;
    (0..=last)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (value[b] - value[a]) / (time[b] - time[a])
        })
        .collect()
}

/// Equations of the load at one set of parameters.
struct Load<'a> {
    p: &'a Values,
    mean_pressure: f64,
}

impl Load<'_> {
    fn is_split(&self) -> bool {
        self.p[at::JUNCTION_INERTANCE] > 0.0
    }

    /// Time derivatives of all states.
    fn rates(&self, x: &State, flow: f64) -> State {
        let p = self.p;
        let mut rates = [0.0; N];
        let softness = |pressure: f64| match p[at::STIFFENING] {
            0.0 => 1.0,
            beta => (-beta * (pressure - self.mean_pressure)).exp(),
        };
        let run_off = |pressure: f64| (pressure - p[at::OUTFLOW]) / p[at::R2];
        let (proximal, outflow) = if self.is_split() {
            let (f, c) = (p[at::PROXIMAL_SHARE], p[at::COMPLIANCE]);
            rates[JUNCTION] = (x[PA] - x[PB] - p[at::JUNCTION_RESISTANCE] * x[JUNCTION])
                / p[at::JUNCTION_INERTANCE];
            rates[PB] = (x[JUNCTION] - run_off(x[PB])) / ((1.0 - f) * c * softness(x[PB]));
            (f * c, x[JUNCTION])
        } else {
            (p[at::COMPLIANCE], run_off(x[PA]))
        };
        let share = p[at::CREEP_SHARE];
        if share > 0.0 {
            rates[CREEP] = (x[PA] - x[CREEP]) / p[at::CREEP_TIME];
        }
        // The wave that arrives through the tube is part of the flow; the wave that the compliance
        // sends back is not.
        let back = if p[at::TRAVEL] > 0.0 {
            0.5 * x[PA] / p[at::R1].max(LEAST_IMPEDANCE)
        } else {
            0.0
        };
        rates[PA] = ((flow - back - outflow) / proximal - share * rates[CREEP])
            / ((1.0 - share) * softness(x[PA]));
        if p[at::PARALLEL_RATE] > 0.0 {
            rates[PARALLEL] = p[at::PARALLEL_RATE] * (flow - x[PARALLEL]);
        }
        rates
    }

    /// States other than Pa whose effect is on.
    fn others(&self) -> Vec<usize> {
        let p = self.p;
        let on = [
            (CREEP, p[at::CREEP_SHARE] > 0.0),
            (JUNCTION, self.is_split()),
            (PB, self.is_split()),
            (PARALLEL, p[at::PARALLEL_RATE] > 0.0),
        ];
        on.into_iter()
            .filter(|(_, on)| *on)
            .map(|(state, _)| state)
            .collect()
    }

    /// Whether a state is a pressure counted from Pa, so that it moves with Pa while Pa is not
    /// periodic.
    fn counted_from_pa(state: usize) -> bool {
        state == CREEP || state == PB
    }
}

/// Integrator of the states. It expects few different step lengths.
struct Stepper<'a> {
    load: Load<'a>,
    /// Matrix of a linear load; `None` for a pressure-dependent compliance.
    matrix: Option<SMatrix<f64, AUGMENTED, AUGMENTED>>,
    /// Whether Pa is the only state that moves.
    alone: bool,
    /// Exponentials of the matrix, by step length in ns.
    exponentials: Vec<(i64, SMatrix<f64, N, AUGMENTED>)>,
}

impl<'a> Stepper<'a> {
    fn new(load: Load<'a>) -> Self {
        let matrix = (load.p[at::STIFFENING] == 0.0).then(|| {
            let constant = load.rates(&[0.0; N], 0.0);
            let by_flow = load.rates(&[0.0; N], 1.0);
            let mut matrix = SMatrix::<f64, AUGMENTED, AUGMENTED>::zeros();
            for column in 0..N {
                let mut unit = [0.0; N];
                unit[column] = 1.0;
                let slopes = load.rates(&unit, 0.0);
                (0..N).for_each(|row| matrix[(row, column)] = slopes[row] - constant[row]);
            }
            for row in 0..N {
                matrix[(row, N)] = by_flow[row] - constant[row];
                matrix[(row, N + 2)] = constant[row];
            }
            matrix[(N, N + 1)] = 1.0;
            matrix
        });
        let alone = load.others().is_empty();
        Self {
            load,
            matrix,
            alone,
            exponentials: Vec::new(),
        }
    }

    fn step(&mut self, x: &State, flow: f64, slope: f64, dt: f64) -> State {
        let Some(matrix) = self.matrix else {
            return self.runge_kutta(x, flow, slope, dt);
        };
        if self.alone {
            // A single exponential decay is integrated in closed form, so that the spacing of
            // samples costs nothing.
            let (rate, gain, constant) = (-matrix[(PA, PA)], matrix[(PA, N)], matrix[(PA, N + 2)]);
            let reached = -(-rate * dt).exp_m1() / rate;
            let mut next = *x;
            next[PA] += (gain * flow + constant - rate * x[PA]) * reached
                + gain * slope * (dt - reached) / rate;
            return next;
        }
        let key = (dt * 1e9).round() as i64;
        let found = self
            .exponentials
            .iter()
            .position(|(length, _)| *length == key);
        let position = found.unwrap_or_else(|| {
            let exponential = (matrix * dt).exp();
            self.exponentials
                .push((key, exponential.fixed_rows::<N>(0).into_owned()));
            self.exponentials.len() - 1
        });
        let e = &self.exponentials[position].1;
        std::array::from_fn(|row| {
            let own: f64 = (0..N).map(|column| e[(row, column)] * x[column]).sum();
            own + e[(row, N)] * flow + e[(row, N + 1)] * slope + e[(row, N + 2)]
        })
    }

    fn runge_kutta(&self, x: &State, flow: f64, slope: f64, dt: f64) -> State {
        let n = (dt / LONGEST_STEP_S).ceil().max(1.0);
        let h = dt / n;
        let moved =
            |x: &State, k: &State, h: f64| -> State { std::array::from_fn(|i| x[i] + h * k[i]) };
        let mut x = *x;
        for i in 0..n as usize {
            let q = flow + slope * h * i as f64;
            let (middle, end) = (q + 0.5 * h * slope, q + h * slope);
            let k1 = self.load.rates(&x, q);
            let k2 = self.load.rates(&moved(&x, &k1, 0.5 * h), middle);
            let k3 = self.load.rates(&moved(&x, &k2, 0.5 * h), middle);
            let k4 = self.load.rates(&moved(&x, &k3, h), end);
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        x
    }

    /// Advances over the steps of the grid up to index `to`; `seen` receives each state.
    fn run(
        &mut self,
        grid: &Grid,
        to: usize,
        mut x: State,
        mut seen: impl FnMut(usize, &State),
    ) -> State {
        seen(0, &x);
        for i in 1..=to {
            let dt = grid.time_s[i] - grid.time_s[i - 1];
            let slope = (grid.flow[i] - grid.flow[i - 1]) / dt;
            x = self.step(&x, grid.flow[i - 1], slope, dt);
            seen(i, &x);
        }
        x
    }

    /// All states at the beginning. Those other than Pa (and Pa itself for a periodic start) repeat
    /// after the first cycle. One cycle from a guess and one from each unit change give the affine
    /// map whose fixed point they are.
    fn start(&mut self, grid: &Grid, cycle_s: f64, start: Start) -> State {
        let pa = self.load.p[at::START];
        let mut unknown = self.load.others();
        if start == Start::Periodic {
            unknown.push(PA);
        }
        let to = grid
            .time_s
            .partition_point(|t| *t <= grid.time_s[0] + cycle_s + SAME_S)
            - 1;
        let whole = |u: &DVector<f64>| -> State {
            let mut x = [0.0; N];
            x[PA] = pa;
            unknown
                .iter()
                .zip(u.iter())
                .for_each(|(state, value)| x[*state] = *value);
            let base = x[PA];
            unknown
                .iter()
                .filter(|s| Load::counted_from_pa(**s))
                .for_each(|s| x[*s] += base);
            x
        };
        if unknown.is_empty() {
            return whole(&DVector::zeros(0));
        }
        let m = unknown.len();
        let mut after = |u: &DVector<f64>| {
            let end = self.run(grid, to, whole(u), |_, _| {});
            DVector::from_fn(m, |i, _| {
                let state = unknown[i];
                if Load::counted_from_pa(state) {
                    end[state] - end[PA]
                } else {
                    end[state]
                }
            })
        };
        // A guess near the solution keeps the linearisation of the nonlinear load accurate.
        let guess = DVector::from_fn(m, |i, _| if unknown[i] == PA { pa } else { 0.0 });
        let from_guess = after(&guess);
        let mut matrix = DMatrix::identity(m, m);
        for column in 0..m {
            let mut moved = guess.clone();
            moved[column] += 1.0;
            let change = after(&moved) - &from_guess;
            matrix.set_column(column, &(matrix.column(column) - change));
        }
        let solution = matrix
            .lu()
            .solve(&(&from_guess - &guess))
            .map_or(from_guess, |d| guess + d);
        whole(&solution)
    }
}

/// A load behind a tube. Its runs return the states and the pressure Pa at each time of the grid.
struct Tube<'a> {
    record: &'a Record,
    grid: &'a Grid,
    travel: f64,
    impedance: f64,
    /// Pa at the times of the grid in the previous run, which fills the time before the record.
    cycle_before: Option<Vec<f64>>,
}

impl Tube<'_> {
    /// Pa at a time, from this run or, before its beginning, from the previous cycle shifted to
    /// join it.
    fn pa(&self, so_far: &[f64], t: f64) -> f64 {
        let grid = self.grid;
        let first = grid.time_s[0];
        if t >= first {
            return interpolated(&grid.time_s[..so_far.len()], so_far, t);
        }
        let end = first + self.record.cycle_s;
        self.cycle_before.as_ref().map_or(so_far[0], |before| {
            let at = |t: f64| interpolated(&grid.time_s[..before.len()], before, t);
            so_far[0] + at(t + self.record.cycle_s) - at(end)
        })
    }

    fn flow(&self, t: f64) -> f64 {
        let first = self.grid.time_s[0];
        let t = if t < first {
            t + self.record.cycle_s
        } else {
            t
        };
        interpolated(&self.grid.time_s, &self.grid.flow, t)
    }

    fn run(&self, stepper: &mut Stepper<'_>, to: usize, mut x: State) -> (Vec<State>, Vec<f64>) {
        let (mut states, mut pa) = (vec![x], vec![x[PA]]);
        let arriving = |pa: &[f64], t: f64| {
            self.flow(t - self.travel) + 0.5 * self.pa(pa, t - 2.0 * self.travel) / self.impedance
        };
        let mut from = arriving(&pa, self.grid.time_s[0]);
        for i in 1..=to {
            let dt = self.grid.time_s[i] - self.grid.time_s[i - 1];
            let here = arriving(&pa, self.grid.time_s[i]);
            x = stepper.step(&x, from, (here - from) / dt, dt);
            from = here;
            states.push(x);
            pa.push(x[PA]);
        }
        (states, pa)
    }
}

/// States at the times of the grid, with Pa as it arrives at the beginning of the tube.
fn through_tube(
    record: &Record,
    values: &Values,
    grid: &Grid,
    stepper: &mut Stepper<'_>,
) -> Vec<State> {
    let impedance = values[at::R1].max(LEAST_IMPEDANCE);
    let mut tube = Tube {
        record,
        grid,
        travel: values[at::TRAVEL],
        impedance,
        cycle_before: None,
    };
    let to = grid
        .time_s
        .partition_point(|t| *t <= grid.time_s[0] + record.cycle_s + SAME_S)
        - 1;
    let mut first = [0.0; N];
    for state in [PA, CREEP, PB] {
        first[state] = values[at::START];
    }
    for _ in 0..TUBE_CYCLES {
        let (states, pa) = tube.run(stepper, to, first);
        let end = states[to];
        let moved = values[at::START] - end[PA];
        first = std::array::from_fn(|i| {
            if matches!(i, PA | CREEP | PB) {
                end[i] + moved
            } else {
                end[i]
            }
        });
        tube.cycle_before = Some(pa);
    }
    let (mut states, pa) = tube.run(stepper, grid.time_s.len() - 1, first);
    states
        .iter_mut()
        .zip(&grid.time_s)
        .for_each(|(x, t)| x[PA] = tube.pa(&pa, t - tube.travel));
    states
}

/// Linear interpolation between samples, constant beyond them.
fn interpolated(time: &[f64], value: &[f64], t: f64) -> f64 {
    let i = time.partition_point(|x| *x <= t);
    if i == 0 || i == time.len() {
        return value[i.saturating_sub(1)];
    }
    value[i - 1] + (value[i] - value[i - 1]) * (t - time[i - 1]) / (time[i] - time[i - 1])
}

/// Pressure at each pressure sample of the record, mmHg, for the flow of the record.
///
/// - `three`: R1, R2 (mmHg s/mL) and C (mL/mmHg)
/// - `start_mmhg`: pressure of the compliance at the first pressure sample
/// - `terms`: effects with their parameters, in the units and the order of their names
#[must_use]
pub fn simulate(
    record: &Record,
    three: [f64; 3],
    start_mmhg: f64,
    terms: &[(&Effect, &[f64])],
) -> Vec<f64> {
    let mut values = [0.0; at::N];
    values[..3].copy_from_slice(&three);
    values[at::START] = start_mmhg;
    for (effect, strengths) in terms {
        for (parameter, strength) in effect.parameters.iter().zip(*strengths) {
            values[parameter.position] = strength / parameter.factor;
        }
    }
    pressure(record, &values, Start::Free)
}

/// Pressure at each pressure sample of the record \[mmHg\].
pub(super) fn pressure(record: &Record, values: &Values, start: Start) -> Vec<f64> {
    let grid = Grid::new(record, values[at::LAG]);
    let mean_pressure = record.pressure.iter().sum::<f64>() / record.pressure.len() as f64;
    let mut stepper = Stepper::new(Load {
        p: values,
        mean_pressure,
    });
    let last = grid.time_s.len() - 1;
    let states = if values[at::TRAVEL] > 0.0 {
        through_tube(record, values, &grid, &mut stepper)
    } else {
        let first = stepper.start(&grid, record.cycle_s, start);
        let mut states = Vec::with_capacity(last + 1);
        stepper.run(&grid, last, first, |_, x| states.push(*x));
        states
    };
    let measured = |i: usize| {
        let (x, q) = (&states[i], grid.flow[i]);
        x[PA]
            + values[at::R1] * (q - x[PARALLEL])
            + values[at::SERIES_INERTANCE] * grid.slope[i]
            + values[at::LOSS] * q * q.abs()
    };
    let whole: Vec<f64> = (0..=last).map(measured).collect();
    let p: Vec<f64> = grid.sample.iter().map(|i| whole[*i]).collect();
    if values[at::CATHETER_PERIOD] > 0.0 {
        return catheter(
            &record.pressure_time_s,
            &p,
            values[at::CATHETER_PERIOD],
            values[at::CATHETER_DAMPING],
        );
    }
    p
}

/// Response of the damped oscillator, exact for a pressure that is linear between its samples. At
/// the beginning the oscillator follows the first straight line at rest.
fn catheter(time_s: &[f64], p: &[f64], period_s: f64, damping: f64) -> Vec<f64> {
    let w = std::f64::consts::TAU / period_s;
    // States: y, y', p, slope.
    let matrix = SMatrix::<f64, 4, 4>::new(
        0.0,
        1.0,
        0.0,
        0.0, //
        -w * w,
        -2.0 * damping * w,
        w * w,
        0.0, //
        0.0,
        0.0,
        0.0,
        1.0, //
        0.0,
        0.0,
        0.0,
        0.0,
    );
    let mut exponentials: Vec<(i64, SMatrix<f64, 4, 4>)> = Vec::new();
    let slope = (p[1] - p[0]) / (time_s[1] - time_s[0]);
    let (mut y, mut dy) = (p[0] - 2.0 * damping / w * slope, slope);
    let mut out = vec![y];
    for i in 1..p.len() {
        let dt = time_s[i] - time_s[i - 1];
        let key = (dt * 1e9).round() as i64;
        let position = exponentials
            .iter()
            .position(|(length, _)| *length == key)
            .unwrap_or_else(|| {
                exponentials.push((key, (matrix * dt).exp()));
                exponentials.len() - 1
            });
        let e = &exponentials[position].1;
        let slope = (p[i] - p[i - 1]) / dt;
        let at = |row: usize| {
            e[(row, 0)] * y + e[(row, 1)] * dy + e[(row, 2)] * p[i - 1] + e[(row, 3)] * slope
        };
        (y, dy) = (at(0), at(1));
        out.push(y);
    }
    out
}
