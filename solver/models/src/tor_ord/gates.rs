//! Gates of the channels: target and rate at a potential (Tomek 2019, appendix).

use super::CellType;

/// Position of each gate among the gates.
pub(super) mod gate {
    pub const M: usize = 0;
    pub const H: usize = 1;
    pub const J: usize = 2;
    /// Suffix P: of channels that CaMK has phosphorylated.
    pub const H_P: usize = 3;
    pub const J_P: usize = 4;
    pub const M_L: usize = 5;
    pub const H_L: usize = 6;
    pub const H_L_P: usize = 7;
    pub const A: usize = 8;
    pub const I_F: usize = 9;
    pub const I_S: usize = 10;
    pub const A_P: usize = 11;
    pub const I_F_P: usize = 12;
    pub const I_S_P: usize = 13;
    pub const D: usize = 14;
    pub const F_F: usize = 15;
    pub const F_S: usize = 16;
    pub const F_CA_F: usize = 17;
    pub const F_CA_S: usize = 18;
    pub const F_F_P: usize = 19;
    pub const F_CA_F_P: usize = 20;
    pub const X_S1: usize = 21;
    pub const X_S2: usize = 22;
    pub const J_CA: usize = 23;
    /// The rest depends on calcium as well: share of channels in the calcium-dependent mode, in the subspace.
    pub const N_CA_SS: usize = 24;
    /// The same at the cytosol.
    pub const N_CA_I: usize = 25;
    /// Release by ryanodine receptors \[mM/ms\].
    pub const J_REL: usize = 26;
    pub const J_REL_P: usize = 27;
    pub const N: usize = 28;
}

/// Targets of the gates, and rates at which they relax to them \[1/ms\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Relaxation {
    pub target: [f64; gate::N],
    pub per_ms: [f64; gate::N],
}

/// Faraday's constant \[C/mol\].
pub(super) const FARADAY: f64 = 96_485.0;
/// R T/F \[mV\] at 310 K.
pub(super) const RT_PER_F_MV: f64 = 8314.0 * 310.0 / FARADAY;

/// 1/(1 + eˣ).
pub(super) fn fall(x: f64) -> f64 {
    1.0 / (1.0 + x.exp())
}

/// Gates that the potential alone moves; zeros for the others.
pub(super) fn of_voltage(v: f64, cell: CellType) -> Relaxation {
    let mut gates = Relaxation {
        target: [0.0; gate::N],
        per_ms: [0.0; gate::N],
    };
    sodium(v, &mut gates);
    transient_outward(v, cell, &mut gates);
    calcium(v, &mut gates);
    slow_rectifier(v, &mut gates);
    gates
}

impl Relaxation {
    fn set(&mut self, idx: usize, target: f64, tau_ms: f64) {
        self.target[idx] = target;
        self.per_ms[idx] = 1.0 / tau_ms;
    }
}

/// Fast sodium of Grandi with phosphorylation, and late sodium.
fn sodium(v: f64, gates: &mut Relaxation) {
    let bell = |middle: f64, width: f64| (-((v - middle) / width).powi(2)).exp();
    let tau_m = 0.1292 * bell(-45.79, 15.54) + 0.06487 * bell(4.823, 51.12);
    gates.set(gate::M, fall(-(v + 56.86) / 9.03).powi(2), tau_m);
    let (rate_h, rate_j) = if v < -40.0 {
        let rise_h = 0.057 * (-(v + 80.0) / 6.8).exp();
        let fall_h = 2.7 * (0.079 * v).exp() + 3.1e5 * (0.3485 * v).exp();
        let strength = 2.5428e4 * (0.2444 * v).exp() + 6.948e-6 * (-0.04391 * v).exp();
        let rise_j = -strength * (v + 37.78) * fall(0.311 * (v + 79.23));
        let fall_j = 0.02424 * (-0.01052 * v).exp() * fall(-0.1378 * (v + 40.14));
        (rise_h + fall_h, rise_j + fall_j)
    } else {
        let fall_h = 0.77 / 0.13 * fall(-(v + 10.66) / 11.1);
        let fall_j = 0.6 * (0.057 * v).exp() * fall(-0.1 * (v + 32.0));
        (fall_h, fall_j)
    };
    let available = fall((v + 71.55) / 7.43).powi(2);
    let available_p = fall((v + 77.55) / 7.43).powi(2);
    gates.set(gate::H, available, 1.0 / rate_h);
    gates.set(gate::H_P, available_p, 1.0 / rate_h);
    gates.set(gate::J, available, 1.0 / rate_j);
    gates.set(gate::J_P, available, 1.46 / rate_j);
    gates.set(gate::M_L, fall(-(v + 42.85) / 5.264), tau_m);
    gates.set(gate::H_L, fall((v + 87.61) / 7.488), 200.0);
    gates.set(gate::H_L_P, fall((v + 93.81) / 7.488), 600.0);
}

fn transient_outward(v: f64, cell: CellType, gates: &mut Relaxation) {
    let opening = fall(-(v - 18.4099) / 29.3814) / 1.2089;
    let tau_a = 1.0515 / (opening + 3.5 * fall((v + 100.0) / 29.3814));
    gates.set(gate::A, fall(-(v - 14.34) / 14.82), tau_a);
    gates.set(gate::A_P, fall(-(v - 24.34) / 14.82), tau_a);
    let slowing = match cell {
        CellType::Epicardial => 1.0 - 0.95 * fall((v + 70.0) / 5.0),
        CellType::Endocardial | CellType::MidMyocardial => 1.0,
    };
    let fast = 0.3933 * (-(v + 100.0) / 100.0).exp() + 0.08004 * ((v + 50.0) / 16.59).exp();
    let slow = 0.001416 * (-(v + 96.52) / 59.05).exp() + 1.780e-8 * ((v + 114.1) / 8.079).exp();
    let (tau_f, tau_s) = (
        slowing * (4.562 + 1.0 / fast),
        slowing * (23.62 + 1.0 / slow),
    );
    let developing = 1.354 + 1e-4 / (((v - 167.4) / 15.89).exp() + (-(v - 12.23) / 0.2154).exp());
    let phosphorylated = developing * (1.0 - 0.5 * fall((v + 70.0) / 20.0));
    let available = fall((v + 43.94) / 5.711);
    gates.set(gate::I_F, available, tau_f);
    gates.set(gate::I_S, available, tau_s);
    gates.set(gate::I_F_P, available, phosphorylated * tau_f);
    gates.set(gate::I_S_P, available, phosphorylated * tau_s);
}

/// L-type calcium: activation is a Gompertz curve that ends at one.
fn calcium(v: f64, gates: &mut Relaxation) {
    let open = if v > 31.4978 {
        1.0
    } else {
        1.0763 * (-1.007 * (-0.0829 * v).exp()).exp()
    };
    let tau_d = 0.6 + 1.0 / ((-0.05 * (v + 6.0)).exp() + (0.09 * (v + 14.0)).exp());
    gates.set(gate::D, open, tau_d);
    let two_sided = |size: f64, middle: f64, left: f64, right: f64| {
        1.0 / (size * ((-(v - middle) / left).exp() + ((v - middle) / right).exp()))
    };
    let available = fall((v + 19.58) / 3.696);
    let fast = 7.0 + two_sided(0.0045, -20.0, 10.0, 10.0);
    let fast_ca = 7.0 + two_sided(0.04, 4.0, 7.0, 7.0);
    gates.set(gate::F_F, available, fast);
    gates.set(gate::F_F_P, available, 2.5 * fast);
    gates.set(
        gate::F_S,
        available,
        1000.0 + two_sided(3.5e-5, -5.0, 4.0, 6.0),
    );
    gates.set(gate::F_CA_F, available, fast_ca);
    gates.set(gate::F_CA_F_P, available, 2.5 * fast_ca);
    gates.set(
        gate::F_CA_S,
        available,
        100.0 + two_sided(1.2e-4, 0.0, 3.0, 7.0),
    );
    gates.set(gate::J_CA, fall((v + 18.08) / 2.7916), 75.0);
}

fn slow_rectifier(v: f64, gates: &mut Relaxation) {
    let open = fall(-(v + 11.6) / 8.932);
    let slow = 2.326e-4 * ((v + 48.28) / 17.8).exp() + 0.001292 * (-(v + 210.0) / 230.0).exp();
    let fast = 0.01 * ((v - 50.0) / 20.0).exp() + 0.0193 * (-(v + 66.54) / 31.0).exp();
    gates.set(gate::X_S1, open, 817.3 + 1.0 / slow);
    gates.set(gate::X_S2, open, 1.0 / fast);
}

/// Rates from the second closed state of hERG to the third and back, at any potential \[1/ms\].
const HERG_SECOND: [f64; 2] = [1.25 * 0.1235, 0.1911];

/// Rates between the Markov states of hERG \[1/ms\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Herg {
    /// From the first closed state to the second, and back.
    pub first: [f64; 2],
    /// From the third closed state to the open one, and back.
    pub opening: [f64; 2],
    /// From the open state to the inactivated one, and back.
    pub inactivation: [f64; 2],
    /// From the third closed state to the inactivated one, and back (by microscopic reversibility).
    pub closed_inactivation: [f64; 2],
}

impl Herg {
    /// Rates at a potential \[mV\].
    pub fn of(v: f64) -> Self {
        let u = v / RT_PER_F_MV;
        let opening = [0.0578 * (0.971 * u).exp(), 0.349e-3 * (-1.062 * u).exp()];
        let inactivation = [
            0.2533 * (0.5953 * u).exp(),
            1.25 * 0.0522 * (-0.8209 * u).exp(),
        ];
        let into = 0.52e-4 * (1.525 * u).exp();
        let out_of = opening[1] * inactivation[1] * into / (opening[0] * inactivation[0]);
        Self {
            first: [0.1161 * (0.299 * u).exp(), 0.2442 * (-1.604 * u).exp()],
            opening,
            inactivation,
            closed_inactivation: [into, out_of],
        }
    }

    /// The rates one after the other.
    pub fn varying(&self) -> [f64; 8] {
        let [a, b] = self.first;
        let [c, d] = self.opening;
        let [e, f] = self.inactivation;
        let [g, h] = self.closed_inactivation;
        [a, b, c, d, e, f, g, h]
    }

    /// From the numbers of [`Self::varying`].
    pub fn from_varying([a, b, c, d, e, f, g, h]: [f64; 8]) -> Self {
        Self {
            first: [a, b],
            opening: [c, d],
            inactivation: [e, f],
            closed_inactivation: [g, h],
        }
    }

    /// Probabilities after a step, by the L-stable approximation 1/(1 − z + z²/2) of the exponential.
    ///
    /// The two closed states exchange at up to 50 per ms in diastole; this keeps their sum and their equilibrium at any step.
    pub fn after(&self, x: &[f64; 5], h_ms: f64) -> [f64; 5] {
        let a = self.scaled(h_ms);
        let mut system = [[0.0; 5]; 5];
        for (row, (system_row, a_row)) in system.iter_mut().zip(&a).enumerate() {
            for (column, entry) in system_row.iter_mut().enumerate() {
                let mut squared = 0.0;
                for (factor, other) in a_row.iter().zip(&a) {
                    squared += factor * other[column];
                }
                let unit = f64::from(u8::from(row == column));
                *entry = unit - a_row[column] + 0.5 * squared;
            }
        }
        solved(system, *x)
    }

    /// The matrix of rates, times a step.
    fn scaled(&self, h_ms: f64) -> [[f64; 5]; 5] {
        let mut a = [[0.0; 5]; 5];
        let mut exchange = |from: usize, to: usize, [there, back]: [f64; 2]| {
            for (source, target, rate) in [(from, to, h_ms * there), (to, from, h_ms * back)] {
                a[target][source] += rate;
                a[source][source] -= rate;
            }
        };
        exchange(0, 1, self.first);
        exchange(1, 2, HERG_SECOND);
        exchange(2, 3, self.opening);
        exchange(3, 4, self.inactivation);
        exchange(2, 4, self.closed_inactivation);
        a
    }
}

/// Solution of five equations by elimination; the diagonal dominates, so that rows keep their order.
fn solved(mut a: [[f64; 5]; 5], mut b: [f64; 5]) -> [f64; 5] {
    for k in 0..5 {
        for row in k + 1..5 {
            let factor = a[row][k] / a[k][k];
            let pivot = a[k];
            for (value, of_pivot) in a[row].iter_mut().zip(pivot).skip(k) {
                *value -= factor * of_pivot;
            }
            b[row] -= factor * b[k];
        }
    }
    for k in (0..5).rev() {
        let rest: f64 = (k + 1..5).map(|column| a[k][column] * b[column]).sum();
        b[k] = (b[k] - rest) / a[k][k];
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn herg_keeps_its_sum_and_approaches_the_exponential() {
        let x = [0.2, 0.3, 0.1, 0.3, 0.1];
        for v in [-90.0, -40.0, 0.0, 40.0] {
            let herg = Herg::of(v);
            let far = herg.after(&x, 50.0);
            assert!((far.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{v}");
            let [coarse, fine] =
                [20, 200].map(|n| (0..n).fold(x, |x, _| herg.after(&x, 0.4 / f64::from(n))));
            let finest = (0..20_000).fold(x, |x, _| herg.after(&x, 0.4 / 20_000.0));
            let error = |y: [f64; 5]| (0..5).map(|k| (y[k] - finest[k]).abs()).fold(0.0, f64::max);
            // Second order: a tenth of the step leaves about a hundredth of the error.
            assert!(
                error(fine) < 0.03 * error(coarse),
                "{v}: {coarse:?} {fine:?}"
            );
        }
    }
}
