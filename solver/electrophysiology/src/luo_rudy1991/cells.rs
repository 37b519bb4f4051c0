//! The membrane model for many cells at once.

use super::table::{INSTANTANEOUS, LEFT, OPEN_POTASSIUM, Row, Table};
use super::{Parameters, State, calcium_slope};
use rayon::prelude::*;

/// The membrane model with a fixed time step.
///
/// Gates follow their exact solution at the potential of the step's beginning (Rush, Larsen 1978,
/// IEEE Trans. Biomed. Eng. 25, 389), so that none of them limits the step. Potential and calcium
/// use the forward Euler method. The method is of first order in time. While the potential changes
/// fast, rates are evaluated at the middle of the step instead.
#[derive(Debug, Clone)]
pub struct Membrane {
    parameters: Parameters,
    table: Table,
    e_na_mv: f64,
    step_ms: f64,
}

impl Membrane {
    /// The model for steps of `step_ms`.
    #[must_use]
    pub fn new(parameters: Parameters, step_ms: f64) -> Self {
        let table = Table::new(&parameters, step_ms);
        Self {
            e_na_mv: parameters.e_na_mv(),
            parameters,
            table,
            step_ms,
        }
    }

    /// Length of the time step for which the table was made \[ms\].
    #[must_use]
    pub fn step_ms(&self) -> f64 {
        self.step_ms
    }

    /// Capacitance of the membrane per area \[µF/cm²\].
    #[must_use]
    pub fn capacitance_uf_cm2(&self) -> f64 {
        self.parameters.capacitance_uf_cm2
    }

    /// Advances one cell by one step, with its potential, gates m, h, j, d, f, X, and calcium.
    #[inline]
    fn advance(&self, v: &mut f64, gates: [&mut f64; 6], ca_mm: &mut f64) {
        let row = self.table.at(*v);
        let old = [
            *gates[0], *gates[1], *gates[2], *gates[3], *gates[4], *gates[5],
        ];
        let mut new: [f64; 6] = std::array::from_fn(|k| row[k] + row[LEFT + k] * (old[k] - row[k]));
        let (mut slope, mut i_si) = self.slope(*v, &new, *ca_mm, &row);
        if slope.abs() > FAST_MV_MS {
            let half: [f64; 6] =
                std::array::from_fn(|k| row[k] + row[LEFT + k].sqrt() * (old[k] - row[k]));
            let v_half = *v + 0.5 * self.step_ms * self.slope(*v, &old, *ca_mm, &row).0;
            let middle = self.table.at(v_half);
            new = std::array::from_fn(|k| middle[k] + middle[LEFT + k] * (old[k] - middle[k]));
            (slope, i_si) = self.slope(v_half, &half, *ca_mm, &middle);
        }
        for (gate, new) in gates.into_iter().zip(new) {
            *gate = new;
        }
        *ca_mm += self.step_ms * calcium_slope(*ca_mm, i_si);
        *v += self.step_ms * slope;
    }

    /// Rate of the potential \[mV/ms\] and the slow inward current \[µA/cm²\].
    #[inline]
    fn slope(&self, v: f64, gates: &[f64; 6], ca_mm: f64, row: &Row) -> (f64, f64) {
        let p = &self.parameters;
        let [m, h, j, d, f, x] = *gates;
        let i_na = p.g_na * m * m * m * h * j * (v - self.e_na_mv);
        let i_si = p.slow_inward(v, d, f, ca_mm);
        let total = i_na + i_si + x * row[OPEN_POTASSIUM] + row[INSTANTANEOUS];
        (-total / p.capacitance_uf_cm2, i_si)
    }
}

/// Rate of the potential above which a cell uses the midpoint \[mV/ms\]. In the upstroke, a
/// first-order step of 0.025 ms has an error of more than 1 mV, and few cells are in their upstroke
/// at any time.
const FAST_MV_MS: f64 = 2.0;

/// States of many cells, with one array per variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells {
    /// Transmembrane potential of each cell \[mV\].
    pub v_mv: Vec<f64>,
    /// Gates m, h, j, d, f, X.
    pub gates: [Vec<f64>; 6],
    /// Intracellular calcium of each cell \[mM\].
    pub ca_mm: Vec<f64>,
}

/// Number of cells that a thread takes at once. Cells are independent, so that the result does not
/// depend on it.
const CHUNK: usize = 2048;

impl Cells {
    /// `n` cells in the same state.
    #[must_use]
    pub fn new(n: usize, state: &State) -> Self {
        let State {
            v_mv,
            m,
            h,
            j,
            d,
            f,
            x,
            ca_mm,
        } = *state;
        Self {
            v_mv: vec![v_mv; n],
            gates: [m, h, j, d, f, x].map(|gate| vec![gate; n]),
            ca_mm: vec![ca_mm; n],
        }
    }

    /// Number of cells, each with its own state.
    #[must_use]
    pub fn len(&self) -> usize {
        self.v_mv.len()
    }

    /// Whether there are no cells.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.v_mv.is_empty()
    }

    /// The state of one cell.
    #[must_use]
    pub fn state(&self, i: usize) -> State {
        let [m, h, j, d, f, x] = std::array::from_fn(|k| self.gates[k][i]);
        State {
            v_mv: self.v_mv[i],
            m,
            h,
            j,
            d,
            f,
            x,
            ca_mm: self.ca_mm[i],
        }
    }

    /// Advances all cells by one step, in rayon's pool if there are many.
    pub fn step(&mut self, membrane: &Membrane) {
        let [m, h, j, d, f, x] = &mut self.gates;
        let part = |v: &mut [f64], g: [&mut [f64]; 6], ca: &mut [f64]| {
            let [m, h, j, d, f, x] = g;
            let n = v.len();
            // Equal slice lengths let the compiler omit bounds checks.
            let (m, h, j) = (&mut m[..n], &mut h[..n], &mut j[..n]);
            let (d, f, x, ca) = (&mut d[..n], &mut f[..n], &mut x[..n], &mut ca[..n]);
            for i in 0..n {
                let gates = [
                    &mut m[i], &mut h[i], &mut j[i], &mut d[i], &mut f[i], &mut x[i],
                ];
                membrane.advance(&mut v[i], gates, &mut ca[i]);
            }
        };
        if self.v_mv.len() <= CHUNK {
            part(&mut self.v_mv, [m, h, j, d, f, x], &mut self.ca_mm);
            return;
        }
        (
            self.v_mv.par_chunks_mut(CHUNK),
            m.par_chunks_mut(CHUNK),
            h.par_chunks_mut(CHUNK),
            j.par_chunks_mut(CHUNK),
            d.par_chunks_mut(CHUNK),
            f.par_chunks_mut(CHUNK),
            x.par_chunks_mut(CHUNK),
            self.ca_mm.par_chunks_mut(CHUNK),
        )
            .into_par_iter()
            .for_each(|(v, m, h, j, d, f, x, ca)| part(v, [m, h, j, d, f, x], ca));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::luo_rudy1991::paced::rest;

    #[test]
    fn a_step_follows_the_derivatives() {
        let parameters = Parameters::default();
        let excited = State {
            v_mv: -31.0,
            m: 0.4,
            h: 0.5,
            j: 0.7,
            d: 0.1,
            f: 0.8,
            x: 0.1,
            ca_mm: 4e-4,
        };
        let step = 1e-5;
        let membrane = Membrane::new(parameters.clone(), step);
        let mut cells = Cells::new(3, &excited);
        cells.step(&membrane);
        let slope = parameters.slope(&excited, 0.0);
        let after = cells.state(2);
        let close = |found: f64, expected: f64| {
            assert!(
                (found - expected).abs() < 1e-3 * expected.abs().max(1e-6),
                "{found} {expected}"
            );
        };
        close((after.v_mv - excited.v_mv) / step, slope.v_mv);
        close((after.m - excited.m) / step, slope.m);
        close((after.h - excited.h) / step, slope.h);
        close((after.j - excited.j) / step, slope.j);
        close((after.d - excited.d) / step, slope.d);
        close((after.f - excited.f) / step, slope.f);
        close((after.x - excited.x) / step, slope.x);
        close((after.ca_mm - excited.ca_mm) / step, slope.ca_mm);
    }

    #[test]
    fn many_cells_are_each_alone() {
        let membrane = Membrane::new(Parameters::default(), 0.025);
        let state = rest(&Parameters::default());
        let mut many = Cells::new(2 * CHUNK + 5, &state);
        let n = many.len();
        let mut one = Cells::new(1, &state);
        many.v_mv[n - 1] = -40.0;
        one.v_mv[0] = -40.0;
        for _ in 0..400 {
            many.step(&membrane);
            one.step(&membrane);
        }
        assert_eq!(many.state(n - 1), one.state(0));
        assert!((many.v_mv[0] - state.v_mv).abs() < 1e-3);
    }

    /// Potentials at 1.6 ms and at 20 ms of a cell that starts depolarised at −50 mV, with steps of
    /// `step_ms`.
    fn potentials(step_ms: f64) -> [f64; 2] {
        let membrane = Membrane::new(Parameters::default(), step_ms);
        let mut cell = Cells::new(
            1,
            &State {
                v_mv: -50.0,
                ..rest(&Parameters::default())
            },
        );
        [1.6, 18.4].map(|length_ms| {
            for _ in 0..(length_ms / step_ms).round() as usize {
                cell.step(&membrane);
            }
            cell.v_mv[0]
        })
    }

    #[test]
    fn the_method_is_of_first_order_and_better_in_the_upstroke() {
        let fine = [1.0 / 1280.0, 1.0 / 2560.0].map(potentials);
        let errors = |at: usize| {
            // Reference by extrapolation. Because two gates switch at −40 mV, the upstroke does not
            // reach second order.
            let exact = if at == 0 {
                (4.0 * fine[1][0] - fine[0][0]) / 3.0
            } else {
                2.0 * fine[1][1] - fine[0][1]
            };
            [20.0, 40.0, 80.0, 160.0].map(|n: f64| (potentials(1.0 / n)[at] - exact).abs())
        };
        for (at, least) in [(0, 1.3), (1, 0.8)] {
            let errors = errors(at);
            let order = (errors[0] / errors[3]).log2() / 3.0;
            assert!(order > least, "{order}: {errors:?}");
        }
    }

    #[test]
    fn steps_four_times_as_long_are_stable_through_a_beat() {
        let membrane = Membrane::new(Parameters::default(), 0.1);
        let mut cell = Cells::new(1, &rest(&Parameters::default()));
        let start = cell.v_mv[0];
        let mut highest = f64::MIN;
        for step in 0..8000 {
            if step < 20 {
                cell.v_mv[0] += 2.55;
            }
            cell.step(&membrane);
            highest = highest.max(cell.v_mv[0]);
        }
        assert!((30.0..60.0).contains(&highest), "{highest}");
        assert!((cell.v_mv[0] - start).abs() < 1.5, "{}", cell.v_mv[0]);
    }
}
