//! Delayed relaxation: a slow decay of active stress.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::contraction::{ActiveStress, Contraction, ContractionError, NodeStep, UniformStep};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of the delayed relaxation.
pub const EFFECT: Effect = Effect {
    name: "delayed_relaxation",
    kind: Kind::Physiology,
    meaning: "The muscle lets go slowly: its activation falls no faster than an exponential, and perhaps not to zero.",
    equation: "a = Sa/φ(λ), da/dt ≥ −(a − r a_peak)/τ; φ the stretch factor of the contraction model",
    source: "Our values, of the active stress. Pressure falls with 46 ms in ejecting hearts of dogs (Weiss, Frederiksen and Weisfeldt 1976, J Clin Invest 58:751, abstract). It falls with 35 ms in healthy people and 59 ms in diastolic heart failure (Zile, Baicu and Gaasch 2004, N Engl J Med 350:1953, abstract). Zile and Brutsaert 2002, Circulation 105:1387, was not read",
    parameters: &[
        Parameter {
            name: "tau_ms",
            unit: "ms",
            meaning: "time constant τ of the fall",
            range: (0.0, 120.0),
            off: Some(0.0),
            smallest: 20.0,
            typical: 45.0,
            prior_scale: 25.0,
            role: Role::Strength,
        },
        Parameter {
            name: "residual_share",
            unit: "1",
            meaning: "share r of the peak that remains",
            range: (0.0, 0.1),
            off: Some(0.0),
            smallest: 0.0,
            typical: 0.0,
            prior_scale: 0.03,
            role: Role::Held,
        },
    ],
    signature: "isovolumic relaxation and rapid filling: an exponential tail in the place of a sharp foot; least pressure high \
                and late; low |dP/dt| min with a normal dP/dt max; filling begins late",
    marks: &[
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Volume,
            sign: Sign::Down,
        },
    ],
    confused_with: &["dyssynchrony", "catheter_response", "viscoelasticity"],
    separated_by: &[
        Measurement::ValveTimes.words(),
        Measurement::Qrs.words(),
        "tissue Doppler (e')",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: None,
    action: Action::Wall(add),
};

/// Smallest stretch factor by which a stress is divided.
const SMALLEST_FACTOR: f64 = 1e-6;

/// A contraction model whose activation falls no faster than an exponential.
///
/// Its own states at a node are the activation and its peak since the last activation of the node
/// [kPa\].
#[derive(Debug)]
struct SlowRelaxation {
    inner: Box<dyn Contraction>,
    tau_ms: f64,
    residual_share: f64,
}

/// Values for one step's floor, which are equal for all nodes of a uniform step.
struct Floor {
    factor: (f64, f64),
    keep: f64,
    dt_ms: f64,
    residual_share: f64,
}

impl SlowRelaxation {
    fn floor(&self, dt_ms: f64, lambda: f64) -> Floor {
        Floor {
            factor: self.inner.length_factor(lambda),
            keep: if self.tau_ms > 0.0 {
                (-dt_ms / self.tau_ms).exp()
            } else {
                0.0
            },
            dt_ms,
            residual_share: self.residual_share,
        }
    }
}

impl Floor {
    #[inline]
    fn hold(
        &self,
        stress: ActiveStress,
        since_activation_ms: f64,
        own: &[f64],
        trial: &mut [f64],
    ) -> ActiveStress {
        let (phi, dphi) = self.factor;
        let is_new_beat = (0.0..self.dt_ms).contains(&since_activation_ms);
        let peak = if is_new_beat { 0.0 } else { own[1] };
        let residual = self.residual_share * peak;
        let least = residual + (own[0] - residual) * self.keep;
        let held = if stress.sa_kpa < least * phi {
            ActiveStress {
                sa_kpa: least * phi,
                dsa_dlambda_kpa: least * dphi,
            }
        } else {
            stress
        };
        // Below the smallest factor, only the fall of the activation is known.
        trial[0] = if phi > SMALLEST_FACTOR {
            held.sa_kpa / phi
        } else {
            least
        };
        trial[1] = if self.residual_share > 0.0 {
            trial[0].max(peak)
        } else {
            0.0
        };
        held
    }
}

impl Contraction for SlowRelaxation {
    fn n_states(&self) -> usize {
        self.inner.n_states() + 2
    }

    fn needs_calcium(&self) -> bool {
        self.inner.needs_calcium()
    }

    fn rest(&self, state: &mut [f64]) {
        let (inner, own) = state.split_at_mut(self.inner.n_states());
        self.inner.rest(inner);
        own.fill(0.0);
    }

    fn length_factor(&self, lambda: f64) -> (f64, f64) {
        self.inner.length_factor(lambda)
    }

    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        let n = self.inner.n_states();
        let (inner_trial, own_trial) = trial.split_at_mut(n);
        let stress = self.inner.try_step(step, &state[..n], inner_trial)?;
        Ok(self.floor(step.dt_ms, step.lambda).hold(
            stress,
            step.since_activation_ms,
            &state[n..],
            own_trial,
        ))
    }

    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        let n = self.n_states();
        if n == 2 {
            // The inner model has no states: all its nodes are advanced together.
            self.inner.try_step_uniform(step, &[], &mut [], stress)?;
            let floor = self.floor(step.dt_ms, step.lambda);
            let own = states.chunks(2).zip(trials.chunks_mut(2));
            for ((out, since), (own, trial)) in
                stress.iter_mut().zip(step.since_activation_ms).zip(own)
            {
                *out = floor.hold(*out, *since, own, trial);
            }
            return Ok(());
        }
        for (node_idx, out) in stress.iter_mut().enumerate() {
            let range = node_idx * n..(node_idx + 1) * n;
            *out = self.try_step(
                &step.node(node_idx),
                &states[range.clone()],
                &mut trials[range],
            )?;
        }
        Ok(())
    }
}

fn add(
    values: &[f64],
    _around: &Surroundings,
    mut parts: OneFibreParts,
) -> Result<OneFibreParts, EffectError> {
    let (tau_ms, residual_share) = (values[0], values[1]);
    parts.contraction = parts.contraction.wrapped(&[0.0, 0.0], |inner| {
        Box::new(SlowRelaxation {
            inner,
            tau_ms,
            residual_share,
        })
    });
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contraction::{Land2017, Tanh, TanhParameters};
    use proptest::prelude::*;

    fn slow(tau_ms: f64, residual_share: f64) -> SlowRelaxation {
        let fast = TanhParameters {
            tau_sd_ms: 10.0,
            t_cr_ms: 300.0,
            ..TanhParameters::default()
        };
        SlowRelaxation {
            inner: Box::new(Tanh::new(fast).unwrap()),
            tau_ms,
            residual_share,
        }
    }

    /// Stress of an isometric twitch every 1 ms.
    fn twitch(cell: &SlowRelaxation, until_ms: usize) -> Vec<f64> {
        let (mut state, mut trial) = ([0.0; 2], [0.0; 2]);
        (1..=until_ms)
            .map(|t| {
                let step = NodeStep {
                    since_activation_ms: t as f64,
                    dt_ms: 1.0,
                    ca_start_um: 0.0,
                    ca_end_um: 0.0,
                    lambda_prev: 1.0,
                    lambda: 1.0,
                };
                let sa = cell.try_step(&step, &state, &mut trial).unwrap().sa_kpa;
                state = trial;
                sa
            })
            .collect()
    }

    #[test]
    fn the_tail_is_exponential_and_the_rise_is_untouched() {
        let (slow, plain) = (twitch(&slow(40.0, 0.0), 600), twitch(&slow(0.0, 0.0), 600));
        assert_eq!(slow[..250], plain[..250]);
        assert!((slow[500] / slow[400] - (-100.0f64 / 40.0).exp()).abs() < 1e-9);
        assert_eq!(plain[400], 0.0);
    }

    #[test]
    fn a_residual_remains() {
        let sa = twitch(&slow(30.0, 0.05), 900);
        let peak = sa.iter().copied().fold(0.0, f64::max);
        assert!((sa[899] / peak - 0.05).abs() < 0.005, "{}", sa[899] / peak);
    }

    #[test]
    fn nodes_with_states_of_their_own_agree_one_by_one() {
        let land = Land2017::new(Default::default()).unwrap();
        let cell = SlowRelaxation {
            inner: Box::new(land),
            tau_ms: 40.0,
            residual_share: 0.0,
        };
        let n = cell.n_states();
        let mut one = vec![0.0; n];
        cell.rest(&mut one);
        one[n - 2] = 30.0;
        let states = one.repeat(2);
        let step = UniformStep {
            dt_ms: 1.0,
            lambda_prev: 1.0,
            lambda: 0.99,
            since_activation_ms: &[20.0, 25.0],
            ca_start_um: &[0.3, 0.4],
            ca_end_um: &[0.31, 0.41],
        };
        let (mut trials, mut stress) = (states.clone(), [ActiveStress::default(); 2]);
        cell.try_step_uniform(&step, &states, &mut trials, &mut stress)
            .unwrap();
        assert!(
            (stress[0].sa_kpa - 30.0 * (-1.0f64 / 40.0).exp()).abs() < 1e-9,
            "{stress:?}"
        );
        assert_eq!(trials[n - 2], trials[2 * n - 2]);
    }

    proptest! {
        #[test]
        fn tangent_is_the_slope(t in 200.0..400.0f64, lambda in 0.75..1.2f64, activation in 0.0..200.0f64) {
            let cell = slow(50.0, 0.03);
            let at = |lambda: f64| {
                let step = NodeStep {
                    since_activation_ms: t, dt_ms: 1.0, ca_start_um: 0.0, ca_end_um: 0.0, lambda_prev: 1.0, lambda,
                };
                cell.try_step(&step, &[activation, 150.0], &mut [0.0; 2]).unwrap()
            };
            let (up, down, here) = (at(lambda + 1e-6), at(lambda - 1e-6), at(lambda));
            let slope = (up.sa_kpa - down.sa_kpa) / 2e-6;
            let kink = (up.dsa_dlambda_kpa - down.dsa_dlambda_kpa).abs();
            prop_assert!((slope - here.dsa_dlambda_kpa).abs() < 1e-4 * (1.0 + slope.abs()) + kink);
        }
    }
}
