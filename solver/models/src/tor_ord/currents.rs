//! Currents through the membrane \[A/F\] (Tomek 2019, appendix).

use super::gates::{FARADAY, RT_PER_F_MV, fall, gate};
use super::state::{CA_I, CA_SS, HERG, K_I, K_SS, NA_I, NA_SS, State, V};
use super::{CellType, Factors, Outside, Troponin};

/// Chloride of the cell and of the bath \[mM\], both constant.
const CL_I_MM: f64 = 24.0;
const CL_O_MM: f64 = 150.0;
/// Share of the L-type channels at the subspace; the rest faces the cytosol.
const CAL_AT_SUBSPACE: f64 = 0.8;
/// Share of the exchangers at the subspace.
const NACA_AT_SUBSPACE: f64 = 0.35;

/// Maximum conductances \[mS/µF\], permeabilities \[cm/s\] and pump rates of one cell, with its factors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Strengths {
    g_na: f64,
    g_nal: f64,
    g_to: f64,
    p_ca: f64,
    g_kr: f64,
    g_ks: f64,
    g_k1: f64,
    g_kb: f64,
    g_naca: f64,
    p_nak: f64,
    p_nab: f64,
    p_cab: f64,
    g_pca: f64,
    g_clca: f64,
    g_clb: f64,
}

impl Strengths {
    pub fn new(cell: CellType, by: &Factors, outside: &Outside, troponin: Troponin) -> Self {
        let of = |epicardial: f64, mid: f64| match cell {
            CellType::Endocardial => 1.0,
            CellType::Epicardial => epicardial,
            CellType::MidMyocardial => mid,
        };
        let root_k = (outside.k_mm / 5.0).sqrt();
        // Margara lowered Tomek's factor of the middle.
        let p_ca_mid = match troponin {
            Troponin::Instantaneous => 2.0,
            Troponin::Land => 1.8,
        };
        Self {
            g_na: 11.7802 * by.i_na,
            g_nal: 0.0279 * of(0.6, 1.0) * by.i_nal,
            g_to: 0.16 * of(2.0, 2.0) * by.i_to,
            p_ca: 8.3757e-5 * of(1.2, p_ca_mid) * by.i_cal,
            g_kr: 0.0321 * root_k * of(1.3, 0.8) * by.i_kr,
            g_ks: 0.0011 * of(1.4, 1.0) * by.i_ks,
            g_k1: 0.6992 * root_k * of(1.2, 1.3) * by.i_k1,
            g_kb: 0.0189 * of(0.6, 1.0) * by.i_kb,
            g_naca: 0.0034 * of(1.1, 1.4) * by.i_naca,
            p_nak: 15.4509 * of(0.9, 0.7) * by.i_nak,
            p_nab: 1.9239e-9 * by.i_nab,
            p_cab: 5.9194e-8 * by.i_cab,
            g_pca: 5e-4 * by.i_pca,
            g_clca: 0.2843 * by.i_clca,
            g_clb: 1.98e-3 * by.i_clb,
        }
    }
}

/// Sums of currents by what they carry and where \[A/F\], and what other equations need of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Currents {
    /// All currents without the stimulus.
    pub total: f64,
    /// Charge of sodium into the cytosol.
    pub na_i: f64,
    /// Charge of sodium into the subspace.
    pub na_ss: f64,
    /// Charge of potassium into the cytosol.
    pub k_i: f64,
    /// Charge of potassium into the subspace.
    pub k_ss: f64,
    /// Charge of calcium into the cytosol.
    pub ca_i: f64,
    /// Charge of calcium into the subspace.
    pub ca_ss: f64,
    /// L-type calcium current into the subspace, which triggers release.
    pub cal_ss: f64,
}

/// Currents of a state.
///
/// - `phosphorylated`: share of channels that CaMK has phosphorylated
pub(super) fn currents(
    s: &Strengths,
    outside: &Outside,
    state: &State,
    phosphorylated: f64,
) -> Currents {
    let (x, gates) = (&state.0, state.gates());
    let (v, u) = (x[V], x[V] / RT_PER_F_MV);
    let (na_i, k_i, ca_i) = (x[NA_I], x[K_I], x[CA_I]);
    let mixed = |plain: f64, p: f64| plain + phosphorylated * (p - plain);
    let e_na = RT_PER_F_MV * (outside.na_mm / na_i).ln();
    let e_k = RT_PER_F_MV * (outside.k_mm / k_i).ln();
    let e_ks = {
        const SODIUM: f64 = 0.01833;
        let (o, i) = (outside.k_mm + SODIUM * outside.na_mm, k_i + SODIUM * na_i);
        RT_PER_F_MV * (o / i).ln()
    };
    let e_cl = RT_PER_F_MV * (CL_I_MM / CL_O_MM).ln();

    let hj = mixed(
        gates[gate::H] * gates[gate::J],
        gates[gate::H_P] * gates[gate::J_P],
    );
    let na = s.g_na * gates[gate::M].powi(3) * hj * (v - e_na);
    let late = mixed(gates[gate::H_L], gates[gate::H_L_P]);
    let nal = s.g_nal * gates[gate::M_L] * late * (v - e_na);

    let fast = fall((v - 213.6) / 151.2);
    let inactivated = |f: usize, slow: usize| fast * gates[f] + (1.0 - fast) * gates[slow];
    let to = s.g_to
        * (v - e_k)
        * mixed(
            gates[gate::A] * inactivated(gate::I_F, gate::I_S),
            gates[gate::A_P] * inactivated(gate::I_F_P, gate::I_S_P),
        );

    let cal = LType::of(v, gates, phosphorylated);
    let bath = Solution::new(outside.na_mm, outside.k_mm, CL_O_MM, outside.ca_mm);
    let subspace = Solution::new(x[NA_SS], x[K_SS], CL_I_MM, x[CA_SS]);
    let cytosol = Solution::new(na_i, k_i, CL_I_MM, ca_i);
    let at_ss = CAL_AT_SUBSPACE * s.p_ca * cal.open(gates[gate::N_CA_SS]);
    let at_i = (1.0 - CAL_AT_SUBSPACE) * s.p_ca * cal.open(gates[gate::N_CA_I]);
    let (single, double) = (Drive::new(1.0, u), Drive::new(2.0, u));
    let [cal_ss, cal_i] = [(at_ss, &subspace), (at_i, &cytosol)].map(|(open, inside)| {
        [
            open * double.of(inside.ca, bath.ca),
            0.00125 * open * single.of(inside.na, bath.na),
            3.574e-4 * open * single.of(inside.k, bath.k),
        ]
    });

    let kr = s.g_kr * x[HERG.start + 3] * (v - e_k);
    let by_calcium = 1.0 + 0.6 / (1.0 + (3.8e-5 / ca_i).powf(1.4));
    let ks = s.g_ks * by_calcium * gates[gate::X_S1] * gates[gate::X_S2] * (v - e_ks);
    let k1 = s.g_k1 * open_k1(v - e_k) * (v - e_k);
    let kb = s.g_kb * fall(-(v - 10.8968) / 23.9871) * (v - e_k);

    let exchange = Exchanger::new(u, outside);
    let naca_i = (1.0 - NACA_AT_SUBSPACE) * s.g_naca * exchange.current(na_i, ca_i);
    let naca_ss = NACA_AT_SUBSPACE * s.g_naca * exchange.current(x[NA_SS], x[CA_SS]);
    let nak = s.p_nak * pump(u, na_i, k_i, outside);

    let nab = s.p_nab * single.of(na_i, outside.na_mm);
    let cab = s.p_cab * double.of(cytosol.ca, bath.ca);
    let pca = s.g_pca * ca_i / (0.0005 + ca_i);
    let clca = s.g_clca * x[CA_SS] / (x[CA_SS] + 0.1) * (v - e_cl);
    let clb = s.g_clb * (v - e_cl);

    let of_na_i = cal_i[1] + na + nal + 3.0 * naca_i + 3.0 * nak + nab;
    let of_na_ss = cal_ss[1] + 3.0 * naca_ss;
    let of_k_i = cal_i[2] + to + kr + ks + k1 + kb - 2.0 * nak;
    let of_ca_i = cal_i[0] + pca + cab - 2.0 * naca_i;
    let of_ca_ss = cal_ss[0] - 2.0 * naca_ss;
    let total = of_na_i + of_na_ss + of_k_i + cal_ss[2] + of_ca_i + of_ca_ss + clca + clb;
    Currents {
        total,
        na_i: of_na_i,
        na_ss: of_na_ss,
        k_i: of_k_i,
        k_ss: cal_ss[2],
        ca_i: of_ca_i,
        ca_ss: of_ca_ss,
        cal_ss: cal_ss[0],
    }
}

/// Drive of Goldman, Hodgkin and Katz: z² F u (a_i e^{z u} − a_o)/(e^{z u} − 1) of activities \[mM\].
struct Drive {
    growth: f64,
    scale: f64,
}

impl Drive {
    fn new(z: f64, u: f64) -> Self {
        let x = z * u;
        let growth_m1 = x.exp_m1();
        // x/(eˣ − 1), which is 1 − x/2 where the quotient loses its digits.
        let share = if x.abs() < 1e-6 {
            1.0 - 0.5 * x
        } else {
            x / growth_m1
        };
        Self {
            growth: 1.0 + growth_m1,
            scale: z * FARADAY * share,
        }
    }

    fn of(&self, inside: f64, outside: f64) -> f64 {
        self.scale * (inside * self.growth - outside)
    }
}

/// Activities of the ions in a solution \[mM\], by Davies' equation.
struct Solution {
    na: f64,
    k: f64,
    ca: f64,
}

impl Solution {
    fn new(na_mm: f64, k_mm: f64, cl_mm: f64, ca_mm: f64) -> Self {
        /// Debye's constant of water at 310 K, with a dielectric constant of 74: 1.82·10⁶ (74 · 310)^(−3/2).
        const DEBYE: f64 = 0.523_819_024_728;
        let root = (0.5e-3 * (na_mm + k_mm + cl_mm + 4.0 * ca_mm)).sqrt();
        let one = (-DEBYE * (root / (1.0 + root) - 0.3 * root * root)).exp();
        Self {
            na: one * na_mm,
            k: one * k_mm,
            ca: one.powi(4) * ca_mm,
        }
    }
}

/// Gating of the L-type channels.
struct LType {
    /// Activation, and factor of the permeability by phosphorylation.
    plain: f64,
    phosphorylated: f64,
    /// Inactivation by potential, then by calcium, each plain and phosphorylated.
    by_potential: [f64; 2],
    by_calcium: [f64; 2],
}

impl LType {
    fn of(v: f64, gates: &[f64], phosphorylated: f64) -> Self {
        let d = gates[gate::D];
        let fast_ca = 0.3 + 0.6 * fall((v - 10.0) / 10.0);
        let f = |fast: usize| 0.6 * gates[fast] + 0.4 * gates[gate::F_S];
        let f_ca = |fast: usize| {
            gates[gate::J_CA] * (fast_ca * gates[fast] + (1.0 - fast_ca) * gates[gate::F_CA_S])
        };
        Self {
            plain: (1.0 - phosphorylated) * d,
            phosphorylated: 1.1 * phosphorylated * d,
            by_potential: [f(gate::F_F), f(gate::F_F_P)],
            by_calcium: [f_ca(gate::F_CA_F), f_ca(gate::F_CA_F_P)],
        }
    }

    /// Open share where a share `n` of the channels is in the mode that calcium inactivates.
    fn open(&self, n: f64) -> f64 {
        let open = |k: usize| (1.0 - n) * self.by_potential[k] + n * self.by_calcium[k];
        self.plain * open(0) + self.phosphorylated * open(1)
    }
}

/// Open share of the inward rectifier at a distance \[mV\] from potassium's potential.
fn open_k1(over_e_k: f64) -> f64 {
    let opening = 4.094 * fall(0.1217 * (over_e_k - 49.934));
    let closing = (15.72 * (0.0674 * (over_e_k - 3.257)).exp()
        + (0.0618 * (over_e_k - 594.31)).exp())
        * fall(-0.1629 * (over_e_k + 14.207));
    opening / (opening + closing)
}

/// The sodium-calcium exchanger: a cycle of four states.
struct Exchanger {
    /// e^{q_Na u}, and e^{q_Ca u}.
    h_na: f64,
    h_ca: f64,
    /// Rates that the bath sets: calcium binding k1, return k3 and sodium binding k8.
    k1: f64,
    k3: f64,
    k8: f64,
    /// Part of k3 without a charge moved.
    k3_slow: f64,
}

const NACA_OFF: f64 = 5e3;
const NACA_MOVE: f64 = 6e4;
const NACA_SLOW: f64 = 5e3;
const NACA_ON_PER_MM: f64 = 1.5e6;
const NACA_KNA_MM: [f64; 3] = [15.0, 5.0, 88.12];

impl Exchanger {
    fn new(u: f64, outside: &Outside) -> Self {
        let [kna1, kna2, kna3] = NACA_KNA_MM;
        let (h_na, h_ca) = ((0.5224 * u).exp(), (0.167 * u).exp());
        let na = outside.na_mm;
        let far = na / (kna3 * h_na);
        let free = 1.0 + na / kna3 + far;
        let bound = far / free;
        let near = 12.5 + 1.0 + na / kna1 * (1.0 + na / kna2);
        let k3_slow = bound * NACA_SLOW;
        Self {
            h_na,
            h_ca,
            k1: outside.ca_mm * NACA_ON_PER_MM / near,
            k3: NACA_MOVE / free + k3_slow,
            k8: bound * na * na / (near * kna1 * kna2) * NACA_MOVE,
            k3_slow,
        }
    }

    /// Current per conductance with sodium and calcium \[mM\] on the inner side.
    fn current(&self, na_mm: f64, ca_mm: f64) -> f64 {
        let [kna1, kna2, kna3] = NACA_KNA_MM;
        let Self { k1, k3, k8, .. } = *self;
        let (k2, k5) = (NACA_OFF, NACA_OFF);
        let far = na_mm * self.h_na / kna3;
        let free = 1.0 + na_mm / kna3 + far;
        let bound = far / free;
        let near = 1.0 + na_mm / kna1 * (1.0 + na_mm / kna2);
        let k4_slow = bound * NACA_SLOW;
        let k4 = NACA_MOVE / (free * self.h_ca) + k4_slow;
        let k6 = ca_mm * NACA_ON_PER_MM / near;
        let k7 = bound * na_mm * na_mm / (near * kna1 * kna2) * NACA_MOVE;
        let x = [
            k2 * k4 * (k7 + k6) + k5 * k7 * (k2 + k3),
            k1 * k7 * (k4 + k5) + k4 * k6 * (k1 + k8),
            k1 * k3 * (k7 + k6) + k8 * k6 * (k2 + k3),
            k2 * k8 * (k4 + k5) + k3 * k5 * (k1 + k8),
        ];
        let sum: f64 = x.iter().sum();
        let sodium = 3.0 * (x[3] * k7 - x[0] * k8) + x[2] * k4_slow - x[1] * self.k3_slow;
        let calcium = x[1] * k2 - x[0] * k1;
        let allosteric = 1.0 / (1.0 + (150e-6 / ca_mm).powi(2));
        allosteric * (sodium + 2.0 * calcium) / sum
    }
}

/// Current of the sodium-potassium pump per rate: a cycle of four states.
fn pump(u: f64, na_mm: f64, k_mm: f64, outside: &Outside) -> f64 {
    const ADP_MM: f64 = 0.05;
    const ATP_PER_K: f64 = 9.8 / 1.698e-7;
    const PROTONS_MM: f64 = 1e-7;
    const ASYMMETRY: f64 = -0.155;
    let inside_na = na_mm / (9.073 * (ASYMMETRY * u / 3.0).exp());
    let outside_na = outside.na_mm / (27.78 * ((1.0 - ASYMMETRY) * u / 3.0).exp());
    let (inside_k, outside_k) = (k_mm / 0.5, outside.k_mm / 0.3582);
    let phosphate = 4.2 / (1.0 + PROTONS_MM / 1.698e-7 + na_mm / 224.0 + k_mm / 292.0);
    let inside = (1.0 + inside_na).powi(3) + (1.0 + inside_k).powi(2) - 1.0;
    let outer = (1.0 + outside_na).powi(3) + (1.0 + outside_k).powi(2) - 1.0;
    let a = [
        949.5 * inside_na.powi(3) / inside,
        687.2,
        1899.0 * outside_k.powi(2) / outer,
        639.0 * ATP_PER_K / (1.0 + ATP_PER_K),
    ];
    let b = [
        182.4 * ADP_MM,
        39.4 * outside_na.powi(3) / outer,
        79_300.0 * phosphate * PROTONS_MM / (1.0 + ATP_PER_K),
        40.0 * inside_k.powi(2) / inside,
    ];
    let x = [
        a[3] * a[0] * a[1] + b[1] * b[3] * b[2] + a[1] * b[3] * b[2] + b[2] * a[0] * a[1],
        b[1] * b[0] * b[3] + a[0] * a[1] * a[2] + a[2] * b[0] * b[3] + a[1] * a[2] * b[3],
        a[1] * a[2] * a[3] + b[2] * b[1] * b[0] + b[1] * b[0] * a[3] + a[2] * a[3] * b[0],
        b[3] * b[2] * b[1] + a[2] * a[3] * a[0] + b[1] * a[3] * a[0] + b[2] * b[1] * a[0],
    ];
    let sum: f64 = x.iter().sum();
    let sodium = 3.0 * (x[0] * a[2] - x[1] * b[2]);
    let potassium = 2.0 * (x[3] * b[0] - x[2] * a[0]);
    (sodium + potassium) / sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drive_is_continuous_at_zero() {
        for z in [1.0, 2.0] {
            let at = |u: f64| Drive::new(z, u).of(12.0, 140.0);
            assert!((at(0.0) - at(1e-5)).abs() < 1e-4 * at(0.0).abs());
            assert!((at(9e-7 / z) - at(1.1e-6 / z)).abs() < 1e-6 * at(0.0).abs());
        }
    }

    #[test]
    fn debyes_constant_is_that_of_its_formula() {
        let one = Solution::new(150.0, 5.0, 150.0, 1.8).na / 150.0;
        let root = (0.5e-3 * (150.0 + 5.0 + 150.0 + 7.2_f64)).sqrt();
        let expected =
            -1.82e6 * (74.0_f64 * 310.0).powf(-1.5) * (root / (1.0 + root) - 0.3 * root * root);
        assert!((one.ln() - expected).abs() < 1e-10);
    }
}
