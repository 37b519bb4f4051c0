//! What one evaluation needs, and the constants derived from it once.

use serde::{Deserialize, Serialize};

use crate::calcium::calcium_shape;
use crate::lanes::lanes;

/// Number of parameters of a cell: Land active (17), Rice calcium (4), passive scale.
pub const N_PARAMETERS: usize = 22;

/// Order, and units in files, of [`CellInput::parameters`].
pub const PARAMETER_NAMES: [&str; N_PARAMETERS] = [
    "k_TRPN_per_ms",
    "n_TRPN",
    "Ca50_ref_uM",
    "k_U_per_ms",
    "n_Tm",
    "TRPN50",
    "k_UW_per_ms",
    "k_WS_per_ms",
    "r_W",
    "r_S",
    "gamma_S_per_ms",
    "gamma_W_per_ms",
    "phi",
    "A_eff",
    "beta_0",
    "beta_1_uM",
    "Smax_ref_kPa",
    "Ca_res_uM",
    "Ca_max_uM",
    "tau_CR_ms",
    "tau_CD_ms",
    "a_p_kPa",
];

/// Tables A2, A3 and A4 of Jung et al. 2022, in the order of [`PARAMETER_NAMES`].
pub const DEFAULT_PARAMETERS: [f64; N_PARAMETERS] = [
    0.1, 2.0, 0.805, 1.0, 5.0, 0.35, 0.182, 0.012, 0.5, 0.25, 0.0085, 0.615, 2.23, 25.0, 2.3, -2.4,
    120.0, 0.15, 0.6, 129.0, 128.0, 2.1,
];

/// Position of k_UW and the others that a check names.
pub(crate) mod at {
    pub const K_TRPN: usize = 0;
    pub const N_TRPN: usize = 1;
    pub const CA50: usize = 2;
    pub const K_U: usize = 3;
    pub const N_TM: usize = 4;
    pub const TRPN50: usize = 5;
    pub const K_UW: usize = 6;
    pub const K_WS: usize = 7;
    pub const R_W: usize = 8;
    pub const R_S: usize = 9;
    pub const GAMMA_S: usize = 10;
    pub const GAMMA_W: usize = 11;
    pub const PHI: usize = 12;
    pub const A_EFF: usize = 13;
    pub const BETA_0: usize = 14;
    pub const BETA_1: usize = 15;
    pub const SMAX: usize = 16;
    pub const CA_RES: usize = 17;
    pub const CA_MAX: usize = 18;
    pub const TAU_CR: usize = 19;
    pub const TAU_CD: usize = 20;
    pub const A_P: usize = 21;
}

/// Constants of Land's three-element passive model that no fit touches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PassiveConstants {
    /// Exponent b of the parallel spring.
    pub b: f64,
    /// Ratio k of the serial spring to the parallel one.
    pub k: f64,
    /// Dashpot while the serial spring is stretched \[ms\].
    pub eta_l_ms: f64,
    /// Dashpot while it is compressed \[ms\].
    pub eta_s_ms: f64,
}

impl Default for PassiveConstants {
    /// Table A3.
    fn default() -> Self {
        Self {
            b: 9.1,
            k: 7.0,
            eta_l_ms: 200.0,
            eta_s_ms: 20.0,
        }
    }
}

/// One cell to evaluate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellInput {
    /// In the order of [`PARAMETER_NAMES`].
    pub parameters: [f64; N_PARAMETERS],
    /// Period of the stimulation \[ms\].
    pub cycle_length_ms: f64,
    /// Initial stretch λ₀, to which the passive strain λ/λ₀ − 1 is relative.
    pub lambda_0: f64,
    /// The passive model's constants.
    pub passive: PassiveConstants,
}

impl CellInput {
    /// A cell with the passive model's published constants.
    #[must_use]
    pub fn new(parameters: [f64; N_PARAMETERS], cycle_length_ms: f64, lambda_0: f64) -> Self {
        Self {
            parameters,
            cycle_length_ms,
            lambda_0,
            passive: PassiveConstants::default(),
        }
    }
}

/// What to do with a cell whose k_WU = k_UW (1/r_W − 1) − k_WS is negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NegativeKwu {
    /// Evaluate it as it is, as the reference's sensitivity analysis does; the output says so.
    Keep,
    /// Refuse it.
    #[default]
    Refuse,
}

/// Why a cell was refused before any step.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InputProblem {
    /// A number is not finite, or outside of what the equations allow.
    #[error("{name} is {value}, expected {expected}")]
    Range {
        /// Which number.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What the equations need.
        expected: &'static str,
    },
    /// The waiting crossbridges would return at a negative rate.
    #[error(
        "k_WU = k_UW (1/r_W - 1) - k_WS is {value_per_ms:.6} per ms, negative: lower k_WS or r_W, or keep such cells by the engine's setting"
    )]
    NegativeKwu {
        /// k_WU \[1/ms\].
        value_per_ms: f64,
    },
    /// Calcium sensitivity is lost at the initial stretch.
    #[error(
        "Ca50 at the initial stretch is {value_um} uM, expected more than 0: raise Ca50_ref or beta_1"
    )]
    Ca50 {
        /// Ca50_ref + beta_1 (min(lambda_0, 1.2) - 1) \[µM\].
        value_um: f64,
    },
}

lanes! {
    /// Constants of one cell as the right-hand side uses them (ms, kPa, µM).
    Constants, ConstantLanes {
        /// k_TRPN.
        k_trpn,
        /// n_TRPN.
        n_trpn,
        /// Ca50 at λ = 0: Ca50_ref − β1.
        ca50_0,
        /// β1.
        beta_1,
        /// k_U.
        k_u,
        /// k_B · c^(n_Tm/2).
        k_b,
        /// n_Tm / 2.
        half_n_tm,
        /// k_UW.
        k_uw,
        /// k_WS.
        k_ws,
        /// k_WU.
        k_wu,
        /// k_SU.
        k_su,
        /// γ_S.
        gamma_s,
        /// γ_W.
        gamma_w,
        /// A.
        a,
        /// c_W.
        c_w,
        /// c_S.
        c_s,
        /// β0.
        beta_0,
        /// Smax_ref / r_S.
        s_scale,
        /// Ca_res.
        ca_res,
        /// Ca_max.
        ca_max,
        /// Amplitude on slow(t)·(1 − fast(t)); zero for equal time constants.
        ca_gap_scale,
        /// Amplitude on slow(t)·t; zero unless the time constants are equal.
        ca_limit_scale,
        /// 1 / max(τ).
        ca_slow,
        /// 1 / min(τ) − 1 / max(τ).
        ca_gap,
        /// a_p.
        a_p,
        /// Exponent b of the passive model.
        b,
        /// a_p · k.
        a_p_k,
        /// k / η_l.
        rate_l,
        /// k / η_s.
        rate_s,
        /// 1 / λ₀.
        inv_lambda_0,
        /// λ₀.
        lambda_0,
        /// Cycle length.
        cycle,
    }
}

impl CellInput {
    fn check(&self) -> Result<(), InputProblem> {
        let p = &self.parameters;
        for (name, &value) in PARAMETER_NAMES.iter().zip(p) {
            if !value.is_finite() || value.abs() > 1e9 {
                return Err(InputProblem::Range {
                    name,
                    value,
                    expected: "a finite number below 1e9",
                });
            }
        }
        let positive = [
            at::K_TRPN,
            at::N_TRPN,
            at::CA50,
            at::K_U,
            at::N_TM,
            at::TRPN50,
            at::K_UW,
            at::K_WS,
            at::R_W,
            at::R_S,
            at::SMAX,
            at::CA_RES,
            at::CA_MAX,
            at::TAU_CR,
            at::TAU_CD,
            at::A_P,
        ];
        for i in positive {
            if p[i] < 1e-9 {
                return Err(InputProblem::Range {
                    name: PARAMETER_NAMES[i],
                    value: p[i],
                    expected: "at least 1e-9",
                });
            }
        }
        for i in [at::R_W, at::R_S, at::TRPN50] {
            if p[i] >= 1.0 {
                return Err(InputProblem::Range {
                    name: PARAMETER_NAMES[i],
                    value: p[i],
                    expected: "less than 1",
                });
            }
        }
        for i in [at::GAMMA_S, at::GAMMA_W, at::PHI, at::A_EFF, at::BETA_0] {
            if p[i] < 0.0 {
                return Err(InputProblem::Range {
                    name: PARAMETER_NAMES[i],
                    value: p[i],
                    expected: "0 or more",
                });
            }
        }
        if p[at::CA_MAX] < p[at::CA_RES] {
            return Err(InputProblem::Range {
                name: "Ca_max_uM",
                value: p[at::CA_MAX],
                expected: "at least Ca_res_uM",
            });
        }
        for i in [at::N_TRPN, at::N_TM] {
            if p[i] > 50.0 {
                return Err(InputProblem::Range {
                    name: PARAMETER_NAMES[i],
                    value: p[i],
                    expected: "50 or less",
                });
            }
        }
        let passive = self.passive;
        let others = [
            (
                "cycle_length_ms",
                self.cycle_length_ms,
                10.0,
                1e5,
                "10 to 100000",
            ),
            ("lambda_0", self.lambda_0, 0.2, 5.0, "0.2 to 5"),
            ("passive b", passive.b, 1e-3, 100.0, "0.001 to 100"),
            ("passive k", passive.k, 1e-3, 1e4, "0.001 to 10000"),
            (
                "passive eta_l_ms",
                passive.eta_l_ms,
                1e-3,
                1e6,
                "0.001 to 1e6",
            ),
            (
                "passive eta_s_ms",
                passive.eta_s_ms,
                1e-3,
                1e6,
                "0.001 to 1e6",
            ),
        ];
        for (name, value, low, high, expected) in others {
            if !(low..=high).contains(&value) {
                return Err(InputProblem::Range {
                    name,
                    value,
                    expected,
                });
            }
        }
        Ok(())
    }

    /// Checks the numbers and derives what the right-hand side uses.
    ///
    /// # Errors
    /// [`InputProblem`] when the equations have no meaning for them.
    pub(crate) fn constants(&self, negative_kwu: NegativeKwu) -> Result<Constants, InputProblem> {
        self.check()?;
        let p = &self.parameters;
        let (r_w, r_s, k_uw, k_ws) = (p[at::R_W], p[at::R_S], p[at::K_UW], p[at::K_WS]);
        let k_wu = k_uw * (1.0 / r_w - 1.0) - k_ws;
        if k_wu < 0.0 && negative_kwu == NegativeKwu::Refuse {
            return Err(InputProblem::NegativeKwu { value_per_ms: k_wu });
        }
        let ca50 = p[at::CA50] + p[at::BETA_1] * (self.lambda_0.min(1.2) - 1.0);
        if ca50 <= 1e-6 {
            return Err(InputProblem::Ca50 { value_um: ca50 });
        }
        let calcium = calcium_shape(p[at::TAU_CR], p[at::TAU_CD]);
        let amplitude = p[at::CA_MAX] - p[at::CA_RES];
        Ok(Constants {
            k_trpn: p[at::K_TRPN],
            n_trpn: p[at::N_TRPN],
            ca50_0: p[at::CA50] - p[at::BETA_1],
            beta_1: p[at::BETA_1],
            k_u: p[at::K_U],
            k_b: p[at::K_U] * p[at::TRPN50].powf(p[at::N_TM]) / (1.0 - r_s - (1.0 - r_s) * r_w),
            half_n_tm: 0.5 * p[at::N_TM],
            k_uw,
            k_ws,
            k_wu,
            k_su: k_ws * r_w * (1.0 / r_s - 1.0),
            gamma_s: p[at::GAMMA_S],
            gamma_w: p[at::GAMMA_W],
            a: p[at::A_EFF] * r_s / ((1.0 - r_s) * r_w + r_s),
            c_w: p[at::PHI] * k_uw * (1.0 - r_w) / r_w,
            c_s: p[at::PHI] * k_ws * r_w * (1.0 - r_s) / r_s,
            beta_0: p[at::BETA_0],
            s_scale: p[at::SMAX] / r_s,
            ca_res: p[at::CA_RES],
            ca_max: p[at::CA_MAX],
            ca_gap_scale: amplitude * calcium.gap_scale,
            ca_limit_scale: amplitude * calcium.limit_scale,
            ca_slow: calcium.slow,
            ca_gap: calcium.gap,
            a_p: p[at::A_P],
            b: self.passive.b,
            a_p_k: p[at::A_P] * self.passive.k,
            rate_l: self.passive.k / self.passive.eta_l_ms,
            rate_s: self.passive.k / self.passive.eta_s_ms,
            inv_lambda_0: 1.0 / self.lambda_0,
            lambda_0: self.lambda_0,
            cycle: self.cycle_length_ms,
        })
    }
}
