//! Parameters of Land 2017.

use crate::parameter::parameters;

parameters! {
    /// Parameters of [`super::Land2017`] with the paper's names (Jung 2022, Table A2).
    pub struct Land2017Parameters {
        /// Rate of calcium binding to troponin k_TRPN \[1/ms\].
        k_trpn_per_ms: "k_TRPN", "k_TRPN_per_ms", Positive;
        /// Cooperativity n_TRPN of calcium binding.
        n_trpn: "n_TRPN", "n_TRPN", Positive;
        /// Reference calcium sensitivity Ca50_ref \[µM\].
        ca50_ref_um: "Ca50_ref", "Ca50_ref_uM", Positive;
        /// Unblocking rate k_U \[1/ms\].
        k_u_per_ms: "k_U", "k_U_per_ms", Positive;
        /// Hill coefficient of unblocking n_Tm.
        n_tm: "n_Tm", "n_Tm", Positive;
        /// Troponin occupancy at half activation TRPN50.
        trpn50: "TRPN50", "TRPN50", Positive;
        /// Rate from unbound to weakly bound k_UW \[1/ms\].
        k_uw_per_ms: "k_UW", "k_UW_per_ms", Positive;
        /// Rate from weakly to strongly bound k_WS \[1/ms\].
        k_ws_per_ms: "k_WS", "k_WS_per_ms", Positive;
        /// Steady ratio of weakly bound r_W.
        r_w: "r_W", "r_W", Fraction;
        /// Steady ratio of strongly bound r_S.
        r_s: "r_S", "r_S", Fraction;
        /// Strain-dependent unbinding of strong bridges γ_S \[1/ms\].
        gamma_s_per_ms: "gamma_S", "gamma_S_per_ms", NotNegative;
        /// Strain-dependent unbinding of weak bridges γ_W \[1/ms\].
        gamma_w_per_ms: "gamma_W", "gamma_W_per_ms", NotNegative;
        /// Factor Φ of the decay of distortions.
        phi: "Phi", "phi", Positive;
        /// Magnitude of the instantaneous response to a stretch A_eff.
        a_eff: "A_eff", "A_eff", Positive;
        /// Length dependence of the stress β0.
        beta0: "beta0", "beta_0", NotNegative;
        /// Length dependence of the sensitivity β1 \[µM\].
        beta1_um: "beta1", "beta_1_uM", Finite;
        /// Reference stress Smax_ref \[kPa\].
        smax_ref_kpa: "Smax_ref", "Smax_ref_kPa", Positive;
    }
    switches {
        /// Caps CaTRPN^(−n_Tm/2) at 100 as the published implementations do; off as printed in the paper.
        cap_unblocking;
        /// Accepts a negative k_WU (4 % of Table A5's box), which only the sensitivity analysis may do.
        allow_negative_k_wu;
    }
}
