//! The membrane model of Luo and Rudy 1991 (LR1): eight states, six currents.
//!
//! Source: Luo, Rudy 1991, "A model of the ventricular cardiac action potential. Depolarization,
//! repolarization, and their interaction", Circ. Res. 68, 1501, Table 1 and text, in the form
//! curated in the CellML repository (constants as in [`Parameters::default`]). Reversal potentials
//! are computed from the concentrations; the paper gives rounded values.

pub mod cells;
pub mod paced;
mod table;

pub use paced::Stimulus;

/// Constants of the model, with the paper's values as defaults.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Capacitance of the membrane per area \[µF/cm²\].
    pub capacitance_uf_cm2: f64,
    /// Fast sodium conductance \[mS/cm²\].
    pub g_na: f64,
    /// Slow inward (calcium) conductance \[mS/cm²\].
    pub g_si: f64,
    /// Time-dependent potassium conductance at 5.4 mM of extracellular potassium \[mS/cm²\].
    pub g_k: f64,
    /// Time-independent potassium conductance at 5.4 mM of extracellular potassium \[mS/cm²\].
    pub g_k1: f64,
    /// Plateau potassium conductance \[mS/cm²\].
    pub g_kp: f64,
    /// Conductance of the background current \[mS/cm²\].
    pub g_b: f64,
    /// Reversal potential of the background current \[mV\].
    pub e_b_mv: f64,
    /// Ratio of the time-dependent potassium channel's permeability to sodium to that to potassium.
    pub pr_na_k: f64,
    /// Concentration of potassium outside of the cell \[mM\].
    pub k_o_mm: f64,
    /// Concentration of potassium inside the cell \[mM\].
    pub k_i_mm: f64,
    /// Concentration of sodium outside of the cell \[mM\].
    pub na_o_mm: f64,
    /// Concentration of sodium inside the cell \[mM\].
    pub na_i_mm: f64,
    /// Temperature, which enters the reversal potentials \[K\].
    pub temperature_k: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            capacitance_uf_cm2: 1.0,
            g_na: 23.0,
            g_si: 0.09,
            g_k: 0.282,
            g_k1: 0.6047,
            g_kp: 0.0183,
            g_b: 0.03921,
            e_b_mv: -59.87,
            pr_na_k: 0.01833,
            k_o_mm: 5.4,
            k_i_mm: 145.0,
            na_o_mm: 140.0,
            na_i_mm: 18.0,
            temperature_k: 310.0,
        }
    }
}

/// Gas constant \[J/(kmol K)\] and Faraday's constant \[C/mol\], as in the CellML repository's
/// file.
const GAS: f64 = 8314.0;
const FARADAY: f64 = 96_484.6;

impl Parameters {
    fn rt_over_f_mv(&self) -> f64 {
        GAS * self.temperature_k / FARADAY
    }

    /// Reversal potential of the fast sodium current \[mV\] (the paper gives 54.4).
    #[must_use]
    pub fn e_na_mv(&self) -> f64 {
        self.rt_over_f_mv() * (self.na_o_mm / self.na_i_mm).ln()
    }

    /// Reversal potential of the time-dependent potassium current \[mV\] (the paper gives −77).
    #[must_use]
    pub fn e_k_mv(&self) -> f64 {
        let out = self.k_o_mm + self.pr_na_k * self.na_o_mm;
        self.rt_over_f_mv() * (out / (self.k_i_mm + self.pr_na_k * self.na_i_mm)).ln()
    }

    /// Reversal potential of the other potassium currents \[mV\].
    #[must_use]
    pub fn e_k1_mv(&self) -> f64 {
        self.rt_over_f_mv() * (self.k_o_mm / self.k_i_mm).ln()
    }

    /// Current through the time-dependent potassium channel with its gate X fully open \[µA/cm²\].
    fn open_potassium(&self, v: f64) -> f64 {
        let xi = if v > -100.0 {
            2.837 * 0.04 * relative_growth(0.04 * (v + 77.0)) / (0.04 * (v + 35.0)).exp()
        } else {
            1.0
        };
        self.g_k * (self.k_o_mm / 5.4).sqrt() * xi * (v - self.e_k_mv())
    }

    /// Currents that depend only on the potential, I_K1 + I_Kp + I_b \[µA/cm²\].
    fn instantaneous(&self, v: f64) -> f64 {
        let e_k1 = self.e_k1_mv();
        let above = v - e_k1;
        let alpha = 1.02 / (1.0 + (0.2385 * (above - 59.215)).exp());
        let beta = (0.49124 * (0.08032 * (above + 5.476)).exp()
            + (0.06175 * (above - 594.31)).exp())
            / (1.0 + (-0.5143 * (above + 4.753)).exp());
        let i_k1 = self.g_k1 * (self.k_o_mm / 5.4).sqrt() * alpha / (alpha + beta) * above;
        let i_kp = self.g_kp / (1.0 + ((7.488 - v) / 5.98).exp()) * above;
        i_k1 + i_kp + self.g_b * (v - self.e_b_mv)
    }

    /// Slow inward current \[µA/cm²\]. Its reversal potential takes calcium in mM.
    fn slow_inward(&self, v: f64, d: f64, f: f64, ca_mm: f64) -> f64 {
        self.g_si * d * f * (v - (7.7 - 13.0287 * ca_mm.ln()))
    }

    /// Time derivatives of all states per ms, with a stimulus \[µA/cm²\] that depolarises if
    /// positive. The batched solver [`cells::Cells`] takes the same terms from a table and is
    /// tested against this function.
    #[must_use]
    pub fn slope(&self, x: &State, stimulus_ua_cm2: f64) -> State {
        let gates = gates(x.v_mv);
        let rate = |value: f64, gate: Gate| (gate.steady - value) / gate.tau_ms;
        let i_na = self.g_na * x.m.powi(3) * x.h * x.j * (x.v_mv - self.e_na_mv());
        let i_si = self.slow_inward(x.v_mv, x.d, x.f, x.ca_mm);
        let total = i_na + i_si + x.x * self.open_potassium(x.v_mv) + self.instantaneous(x.v_mv);
        State {
            v_mv: (stimulus_ua_cm2 - total) / self.capacitance_uf_cm2,
            m: rate(x.m, gates[0]),
            h: rate(x.h, gates[1]),
            j: rate(x.j, gates[2]),
            d: rate(x.d, gates[3]),
            f: rate(x.f, gates[4]),
            x: rate(x.x, gates[5]),
            ca_mm: calcium_slope(x.ca_mm, i_si),
        }
    }
}

/// d`Ca`/dt \[mM/ms\], for a slow inward current in µA/cm².
fn calcium_slope(ca_mm: f64, i_si: f64) -> f64 {
    -1e-4 * i_si + 0.07 * (1e-4 - ca_mm)
}

/// State of one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Potential inside minus potential outside \[mV\].
    pub v_mv: f64,
    /// Activation of the sodium channel.
    pub m: f64,
    /// Fast inactivation of the sodium channel.
    pub h: f64,
    /// Slow inactivation of the sodium channel.
    pub j: f64,
    /// Activation of the slow inward channel.
    pub d: f64,
    /// Inactivation of the slow inward channel.
    pub f: f64,
    /// Activation of the time-dependent potassium channel.
    pub x: f64,
    /// Intracellular calcium of this model \[mM\]. The contraction model has its own calcium.
    pub ca_mm: f64,
}

/// Steady value and time constant of a gate at a fixed potential.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Gate {
    steady: f64,
    tau_ms: f64,
}

impl Gate {
    fn of(alpha: f64, beta: f64) -> Self {
        Self {
            steady: alpha / (alpha + beta),
            tau_ms: 1.0 / (alpha + beta),
        }
    }
}

/// (eˣ − 1)/x, continued through zero.
fn relative_growth(x: f64) -> f64 {
    if x.abs() < 1e-8 {
        1.0 + 0.5 * x
    } else {
        x.exp_m1() / x
    }
}

/// The gates m, h, j, d, f, X. Source: Luo 1991, Table 1.
fn gates(v: f64) -> [Gate; 6] {
    let m = Gate::of(
        3.2 / relative_growth(-0.1 * (v + 47.13)),
        0.08 * (-v / 11.0).exp(),
    );
    let (h, j) = if v >= -40.0 {
        (
            Gate::of(0.0, 1.0 / (0.13 * (1.0 + ((v + 10.66) / -11.1).exp()))),
            Gate::of(
                0.0,
                0.3 * (-2.535e-7 * v).exp() / (1.0 + (-0.1 * (v + 32.0)).exp()),
            ),
        )
    } else {
        let alpha_j = (-127_140.0 * (0.2444 * v).exp() - 3.474e-5 * (-0.04391 * v).exp())
            * (v + 37.78)
            / (1.0 + (0.311 * (v + 79.23)).exp());
        (
            Gate::of(
                0.135 * ((80.0 + v) / -6.8).exp(),
                3.56 * (0.079 * v).exp() + 3.1e5 * (0.35 * v).exp(),
            ),
            Gate::of(
                alpha_j,
                0.1212 * (-0.01052 * v).exp() / (1.0 + (-0.1378 * (v + 40.14)).exp()),
            ),
        )
    };
    let d = Gate::of(
        0.095 * (-0.01 * (v - 5.0)).exp() / (1.0 + (-0.072 * (v - 5.0)).exp()),
        0.07 * (-0.017 * (v + 44.0)).exp() / (1.0 + (0.05 * (v + 44.0)).exp()),
    );
    let f = Gate::of(
        0.012 * (-0.008 * (v + 28.0)).exp() / (1.0 + (0.15 * (v + 28.0)).exp()),
        0.0065 * (-0.02 * (v + 30.0)).exp() / (1.0 + (-0.2 * (v + 30.0)).exp()),
    );
    let x = Gate::of(
        0.0005 * (0.083 * (v + 50.0)).exp() / (1.0 + (0.057 * (v + 50.0)).exp()),
        0.0013 * (-0.06 * (v + 20.0)).exp() / (1.0 + (-0.04 * (v + 20.0)).exp()),
    );
    [m, h, j, d, f, x]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reversal_potentials_are_the_papers_to_its_rounding() {
        let p = Parameters::default();
        assert!((p.e_na_mv() - 54.4).abs() < 0.5, "{}", p.e_na_mv());
        assert!((p.e_k_mv() + 77.0).abs() < 0.6, "{}", p.e_k_mv());
        assert!((p.e_k1_mv() + 87.9).abs() < 0.1, "{}", p.e_k1_mv());
    }

    #[test]
    fn removable_singularities_are_removed() {
        let p = Parameters::default();
        let near = |f: &dyn Fn(f64) -> f64, v: f64| {
            let middle = 0.5 * (f(v - 1e-3) + f(v + 1e-3));
            assert!(
                (f(v) - middle).abs() < 1e-6 * (1.0 + middle.abs()),
                "{v}: {} {middle}",
                f(v)
            );
        };
        near(&|v| gates(v)[0].tau_ms, -47.13);
        near(&|v| p.open_potassium(v), -77.0);
    }

    #[test]
    fn gates_are_fractions_that_relax() {
        for i in -1200..=800 {
            for gate in gates(f64::from(i) * 0.1) {
                assert!(
                    (0.0..=1.0).contains(&gate.steady) && gate.tau_ms > 0.0,
                    "{i} {gate:?}"
                );
            }
        }
    }
}
