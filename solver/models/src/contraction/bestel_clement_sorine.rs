//! Active stress of Bestel, Clément and Sorine as the benchmark of Aróstica et al. 2025 uses it: a first-order law whose
//! rate an activation function switches between rise and fall. It does not depend on the stretch.

use super::declaration::{ContractionModel, ModelParameter};
use super::{ActiveStress, Contraction, ContractionError, NodeStep};
use crate::parameter::Domain;

/// Catalogue entry of the law.
pub const MODEL: ContractionModel = ContractionModel {
    name: "bestel-clement-sorine",
    meaning: "A first-order law of active stress that rises while activated and falls afterwards, at any stretch.",
    equation: "dS/dt = −|a| S + σ₀ max(a, 0), a = α_max f − α_min (1 − f), f = ¼ (1 + tanh(t/γ)) (1 − tanh((t − t_off)/γ))",
    source: "Bestel, Clément and Sorine 2001, MICCAI, LNCS 2208:1159; Aróstica et al. 2025, CMAME 435:117485",
    parameters: &[
        ModelParameter {
            name: "sigma_0_kPa",
            meaning: "contractility σ₀, the stress that a long activation approaches",
            default: 150.0,
            domain: Domain::Positive,
        },
        ModelParameter {
            name: "alpha_max_per_s",
            meaning: "rate of the rise α_max",
            default: 5.0,
            domain: Domain::Positive,
        },
        ModelParameter {
            name: "alpha_min_per_s",
            meaning: "rate of the fall α_min, as a positive number",
            default: 30.0,
            domain: Domain::Positive,
        },
        ModelParameter {
            name: "t_off_ms",
            meaning: "time from activation to the end of the rise, t_off",
            default: 324.0,
            domain: Domain::Positive,
        },
        ModelParameter {
            name: "gamma_ms",
            meaning: "width γ of both switches",
            default: 5.0,
            domain: Domain::Positive,
        },
    ],
    build: |values| {
        Ok(Box::new(BestelClementSorine {
            sigma_0_kpa: values[0],
            alpha_max_per_ms: 1e-3 * values[1],
            alpha_min_per_ms: 1e-3 * values[2],
            t_off_ms: values[3],
            gamma_ms: values[4],
        }))
    },
};

/// Part of γ that one substep may have.
const SUBSTEP_PER_GAMMA: f64 = 0.2;

/// The law with its parameters; the state of a node is its stress \[kPa\].
#[derive(Debug, Clone, Copy)]
struct BestelClementSorine {
    sigma_0_kpa: f64,
    alpha_max_per_ms: f64,
    alpha_min_per_ms: f64,
    t_off_ms: f64,
    gamma_ms: f64,
}

impl BestelClementSorine {
    /// Activation a \[1/ms\] at a time since activation of the node.
    fn activation_per_ms(&self, since_activation_ms: f64) -> f64 {
        let on = 0.5 * (1.0 + (since_activation_ms / self.gamma_ms).tanh());
        let not_off = 0.5 * (1.0 - ((since_activation_ms - self.t_off_ms) / self.gamma_ms).tanh());
        let f = on * not_off;
        self.alpha_max_per_ms * f - self.alpha_min_per_ms * (1.0 - f)
    }
}

impl Contraction for BestelClementSorine {
    fn n_states(&self) -> usize {
        1
    }

    fn needs_calcium(&self) -> bool {
        false
    }

    fn rest(&self, state: &mut [f64]) {
        state[0] = 0.0;
    }

    /// Substeps with the activation of their middle, each solved exactly.
    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        let n = (step.dt_ms / (SUBSTEP_PER_GAMMA * self.gamma_ms))
            .ceil()
            .max(1.0);
        let dt_ms = step.dt_ms / n;
        let begin_ms = step.since_activation_ms - step.dt_ms;
        let mut stress = state[0];
        for k in 0..n as usize {
            let a = self.activation_per_ms(begin_ms + (k as f64 + 0.5) * dt_ms);
            let limit = if a > 0.0 { self.sigma_0_kpa } else { 0.0 };
            stress = limit + (stress - limit) * (-a.abs() * dt_ms).exp();
        }
        if !stress.is_finite() {
            return Err(ContractionError::NotFinite {
                since_activation_ms: step.since_activation_ms,
                lambda: step.lambda,
            });
        }
        trial[0] = stress;
        Ok(ActiveStress {
            sa_kpa: stress,
            dsa_dlambda_kpa: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Stress \[kPa\] every `dt_ms` from 100 ms before to 700 ms after the activation.
    fn beat(dt_ms: f64) -> Vec<f64> {
        let model = MODEL.with(&BTreeMap::new()).unwrap();
        let (mut state, mut trial) = ([0.0], [0.0]);
        let n = (800.0 / dt_ms).round() as usize;
        (1..=n)
            .map(|k| {
                let step = NodeStep {
                    since_activation_ms: -100.0 + k as f64 * dt_ms,
                    dt_ms,
                    ca_start_um: 0.0,
                    ca_end_um: 0.0,
                    lambda_prev: 1.0,
                    lambda: 1.0,
                };
                model.try_step(&step, &state, &mut trial).unwrap();
                state = trial;
                state[0]
            })
            .collect()
    }

    #[test]
    fn steps_of_five_milliseconds_agree_with_steps_of_a_hundredth() {
        let (coarse, fine) = (beat(5.0), beat(0.01));
        let largest = coarse
            .iter()
            .enumerate()
            .map(|(k, stress)| (stress - fine[500 * (k + 1) - 1]).abs())
            .fold(0.0, f64::max);
        assert!(largest < 0.05, "{largest} kPa");
    }

    #[test]
    fn long_after_the_switches_rise_and_fall_are_those_of_the_rates() {
        let fine = beat(0.1);
        let at = |ms: f64| fine[((ms + 100.0) * 10.0).round() as usize - 1];
        // Between 50 and 250 ms the activation is α_max: the distance to σ₀ shrinks by e^{−α_max t}.
        let rise = (150.0 - at(250.0)) / (150.0 - at(50.0));
        assert!((rise - (-5e-3_f64 * 200.0).exp()).abs() < 1e-6, "{rise}");
        let fall = at(420.0) / at(370.0);
        assert!((fall - (-30e-3_f64 * 50.0).exp()).abs() < 1e-6, "{fall}");
    }
}
