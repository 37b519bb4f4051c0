//! Input of one evaluation, and the constants derived from it once.

use serde::{Deserialize, Serialize};

use cardiotwin_models::calcium::Rice2008Shape;
use cardiotwin_models::cell0d::{LandPassive, LandPassiveParameters};
use cardiotwin_models::contraction::Land2017Parameters;
use cardiotwin_models::contraction::land2017::Equations;
use cardiotwin_vocabulary::cell::{CELL, CELL_DEFAULTS, CELL_PARAMETERS};

use crate::calcium::EQUAL_RATES;
use crate::input_problem::InputProblem;
use crate::lanes::lanes;

/// Number of parameters of a cell: Land active (17), Rice calcium (4), passive scale.
pub const N_PARAMETERS: usize = CELL.len();

/// Order, and units in files, of [`CellInput::parameters`].
pub const PARAMETER_NAMES: [&str; N_PARAMETERS] = CELL_PARAMETERS;

/// Defaults in the order of [`PARAMETER_NAMES`].
pub const DEFAULT_PARAMETERS: [f64; N_PARAMETERS] = CELL_DEFAULTS;

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
    pub const SMAX: usize = 16;
    pub const CA_RES: usize = 17;
    pub const CA_MAX: usize = 18;
    pub const TAU_CR: usize = 19;
    pub const TAU_CD: usize = 20;
    pub const A_P: usize = 21;
}

/// One cell to evaluate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellInput {
    /// Values in the order of [`PARAMETER_NAMES`].
    pub parameters: [f64; N_PARAMETERS],
    /// Period of the stimulation \[ms\].
    pub cycle_length_ms: f64,
    /// Initial stretch λ₀, to which the passive strain λ/λ₀ − 1 is relative.
    pub lambda_0: f64,
}

impl CellInput {
    /// A cell whose passive constants b, k, η_l and η_s are those of the default
    /// [`LandPassiveParameters`].
    #[must_use]
    pub fn new(parameters: [f64; N_PARAMETERS], cycle_length_ms: f64, lambda_0: f64) -> Self {
        Self {
            parameters,
            cycle_length_ms,
            lambda_0,
        }
    }
}

/// Treatment of a cell whose k_WU = k_UW (1/r_W − 1) − k_WS is negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NegativeKwu {
    /// Evaluates the cell as it is, as the reference's sensitivity analysis does; the output says
    /// so.
    Keep,
    /// Refuses the cell before any step.
    #[default]
    Refuse,
}

lanes! {
    /// Constants of one cell as the right-hand side uses them (ms, kPa, µM).
    Constants, ConstantLanes {
        /// Unbinding rate k_TRPN of calcium from troponin C.
        k_trpn,
        /// Hill exponent n_TRPN of calcium binding.
        n_trpn,
        /// Half-saturation Ca50_ref at a stretch of 1.
        ca50_ref,
        /// Slope β1 of Ca50 with the stretch.
        beta_1,
        /// Unblocking rate k_U of binding sites.
        k_u,
        /// Blocking rate k_B of binding sites.
        k_b,
        /// Half of the exponent n_Tm, as it appears in the rates.
        half_n_tm,
        /// Rate k_UW from unblocked to weakly bound.
        k_uw,
        /// Rate k_WS from weakly to strongly bound.
        k_ws,
        /// Rate k_WU from weakly bound back to unblocked.
        k_wu,
        /// Rate k_SU from strongly bound back to unblocked.
        k_su,
        /// Factor γ_S of distortion on the unbinding of strongly bound crossbridges.
        gamma_s,
        /// Factor γ_W of distortion on the unbinding of weakly bound crossbridges.
        gamma_w,
        /// Distortion A per change of the stretch.
        a,
        /// Decay rate c_W of the distortion ζ_W.
        c_w,
        /// Decay rate c_S of the distortion ζ_S.
        c_s,
        /// Slope β0 of the overlap h with the stretch.
        beta_0,
        /// Stress per pulling crossbridge, Smax_ref / r_S.
        s_scale,
        /// Resting calcium Ca_res.
        ca_res,
        /// Peak calcium Ca_max.
        ca_max,
        /// Amplitude on slow(t)·(1 − fast(t)); zero for equal time constants.
        ca_gap_scale,
        /// Amplitude on slow(t)·t; zero unless the time constants are equal.
        ca_limit_scale,
        /// Rate of the slower exponential, 1 / max(τ).
        ca_slow,
        /// Rate by which the faster exponential exceeds the slower, 1 / min(τ) − 1 / max(τ).
        ca_gap,
        /// Scale a_p of the passive stress.
        a_p,
        /// Exponent b of the passive model.
        b,
        /// Ratio k of the serial spring to the parallel one.
        k,
        /// Stiffness a_p · k of the serial spring.
        a_p_k,
        /// Rate k / η_l of C_V while the serial spring is stretched.
        rate_l,
        /// Rate k / η_s of C_V while it is compressed.
        rate_s,
        /// Reciprocal of the initial stretch, 1 / λ₀.
        inv_lambda_0,
        /// Initial stretch λ₀.
        lambda_0,
        /// Cycle length, at whose multiples the cell is activated.
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
        let others = [
            (
                "cycle_length_ms",
                self.cycle_length_ms,
                10.0,
                1e5,
                "10 to 100000",
            ),
            ("lambda_0", self.lambda_0, 0.2, 5.0, "0.2 to 5"),
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
        let [active @ .., _, _, _, _, a_p_kpa] = *p;
        let land = Equations::new(&Land2017Parameters::from_values(active));
        let passive = LandPassive::new(&LandPassiveParameters {
            a_p_kpa,
            ..LandPassiveParameters::default()
        });
        if land.k_wu < 0.0 && negative_kwu == NegativeKwu::Refuse {
            return Err(InputProblem::NegativeKwu {
                value_per_ms: land.k_wu,
            });
        }
        let ca50 = land.ca50(self.lambda_0);
        if ca50 <= 1e-6 {
            return Err(InputProblem::Ca50 { value_um: ca50 });
        }
        let calcium = Rice2008Shape::new(p[at::TAU_CR], p[at::TAU_CD], EQUAL_RATES);
        let amplitude = (p[at::CA_MAX] - p[at::CA_RES]) * calcium.scale;
        let is_limit = calcium.gap_per_ms == 0.0;
        Ok(Constants {
            k_trpn: land.k_trpn,
            n_trpn: land.n_trpn,
            ca50_ref: land.ca50_ref,
            beta_1: land.beta1,
            k_u: land.k_u,
            k_b: land.k_b,
            half_n_tm: land.half_n_tm,
            k_uw: land.k_uw,
            k_ws: land.k_ws,
            k_wu: land.k_wu,
            k_su: land.k_su,
            gamma_s: land.gamma_s,
            gamma_w: land.gamma_w,
            a: land.a,
            c_w: land.c_w,
            c_s: land.c_s,
            beta_0: land.beta0,
            s_scale: land.stress_scale,
            ca_res: p[at::CA_RES],
            ca_max: p[at::CA_MAX],
            ca_gap_scale: if is_limit { 0.0 } else { amplitude },
            ca_limit_scale: if is_limit { amplitude } else { 0.0 },
            ca_slow: calcium.slow_per_ms,
            ca_gap: calcium.gap_per_ms,
            a_p: passive.a_p_kpa,
            b: passive.b,
            k: passive.k,
            a_p_k: passive.a_p_kpa * passive.k,
            rate_l: passive.rate_l_per_ms,
            rate_s: passive.rate_s_per_ms,
            inv_lambda_0: 1.0 / self.lambda_0,
            lambda_0: self.lambda_0,
            cycle: self.cycle_length_ms,
        })
    }
}
