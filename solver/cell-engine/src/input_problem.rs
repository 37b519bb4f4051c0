//! Reasons why a cell was refused before any step.

/// Reasons why a cell was refused before any step.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InputProblem {
    /// A number is not finite, or outside of what the equations allow.
    #[error("{name} is {value}, expected {expected}")]
    Range {
        /// Name of the number.
        name: &'static str,
        /// Number as given.
        value: f64,
        /// Range that the equations need, in words.
        expected: &'static str,
    },
    /// The waiting crossbridges would return at a negative rate.
    #[error(
        "k_WU = k_UW (1/r_W - 1) - k_WS is {value_per_ms:.6} per ms, negative: lower k_WS or r_W, or keep such cells by the engine's setting"
    )]
    NegativeKwu {
        /// Rate k_WU at which waiting crossbridges would return \[1/ms\].
        value_per_ms: f64,
    },
    /// Calcium sensitivity is lost at the initial stretch.
    #[error(
        "Ca50 at the initial stretch is {value_um} uM, expected more than 0: raise Ca50_ref or beta_1"
    )]
    Ca50 {
        /// Ca50 at the initial stretch, Ca50_ref + beta_1 (min(lambda_0, 1.2) - 1) \[µM\].
        value_um: f64,
    },
}
