//! Tanh active stress (Jung 2022, eqs. A1-A3; Niederer 2011 in CARPentry): a function of time since activation and stretch.

mod equations;
mod lanes;

pub use equations::Tanh;

use equations::Length;
use lanes::{Each, EquallySpaced};
use pulp::Arch;

use super::{ActiveStress, Contraction, ContractionError, EachStep, NodeStep, UniformStep};

pub use cardiotwin_vocabulary::step1::TanhParameters;

impl Tanh {
    /// Stress of active nodes at equal distances in time, oldest first.
    fn equally_spaced(
        &self,
        times: &[f64],
        spacing: f64,
        length: &Length,
        stress: &mut [ActiveStress],
    ) {
        Arch::new().dispatch(EquallySpaced {
            tanh: *self,
            since_activation_ms: times,
            spacing_ms: spacing,
            length,
            stress,
        });
    }

    /// Stress of nodes that fall into runs of equal distances, as where a part of the wall is late. Within a run, oldest
    /// first, all are active where its ends are.
    fn runs(&self, times: &[f64], length: &Length, stress: &mut [ActiveStress]) {
        let p = &self.parameters;
        let is_active = |t: f64| t > p.t_emd_ms && t < p.t_emd_ms + p.t_cr_ms;
        let mut begin = 0;
        while begin < times.len() {
            let rest = &times[begin..];
            let spacing = if rest.len() > 1 {
                rest[0] - rest[1]
            } else {
                0.0
            };
            let is_far = |w: &[f64]| (w[0] - w[1] - spacing).abs() >= SPACING_TOLERANCE_MS;
            let n = rest
                .windows(2)
                .position(is_far)
                .map_or(rest.len(), |gap| gap + 1);
            let (run, out) = (&rest[..n], &mut stress[begin..begin + n]);
            if spacing >= 0.0 && is_active(run[0]) && is_active(run[n - 1]) {
                self.equally_spaced(run, spacing, length, out);
            } else {
                for (out, t) in out.iter_mut().zip(run) {
                    *out = self.stress(*t, length);
                }
            }
            begin += n;
        }
    }
}

/// Nodes at equal distances in activation time are recognised up to this deviation \[ms\].
const SPACING_TOLERANCE_MS: f64 = 1e-9;

impl Contraction for Tanh {
    fn n_states(&self) -> usize {
        0
    }

    fn needs_calcium(&self) -> bool {
        false
    }

    fn rest(&self, _state: &mut [f64]) {}

    /// Factor φ of the length on the stress, and its slope.
    fn length_factor(&self, lambda: f64) -> (f64, f64) {
        self.length(lambda)
            .map_or((0.0, 0.0), |length| (length.phi, length.dphi))
    }

    fn try_step(
        &self,
        step: &NodeStep,
        _state: &[f64],
        _trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        Ok(self.stress(step.since_activation_ms, &self.length(step.lambda)?))
    }

    fn try_step_each(
        &self,
        step: &EachStep<'_>,
        _states: &[f64],
        _trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        let is_wrong = |lambda: &&f64| !(**lambda > 0.0 && lambda.is_finite());
        if let Some(lambda) = step.lambda.iter().find(is_wrong) {
            return Err(ContractionError::Stretch { lambda: *lambda });
        }
        Arch::new().dispatch(Each {
            tanh: *self,
            since_activation_ms: step.since_activation_ms,
            lambda: step.lambda,
            stress,
        });
        Ok(())
    }

    /// Nodes at equal distances, oldest first, cost four exponentials together instead of two each.
    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        _states: &[f64],
        _trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        let length = self.length(step.lambda)?;
        let p = &self.parameters;
        let times = step.since_activation_ms;
        let is_active = |t: &f64| *t > p.t_emd_ms && *t < p.t_emd_ms + p.t_cr_ms;
        stress.fill(ActiveStress::default());
        let (Some(first), Some(last)) = (
            times.iter().position(is_active),
            times.iter().rposition(is_active),
        ) else {
            return Ok(());
        };
        let active = &times[first..=last];
        let spacing = if active.len() > 1 {
            active[0] - active[1]
        } else {
            0.0
        };
        let equal = spacing >= 0.0
            && active
                .windows(2)
                .all(|w| (w[0] - w[1] - spacing).abs() < SPACING_TOLERANCE_MS);
        if equal {
            self.equally_spaced(active, spacing, &length, &mut stress[first..=last]);
        } else {
            self.runs(active, &length, &mut stress[first..=last]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_units::{Ms, Stretch};
    use cardiotwin_vector_math::{Dual, Number as _};
    use proptest::prelude::*;

    fn at(p: TanhParameters, t: f64, lambda: f64) -> ActiveStress {
        let step = NodeStep {
            since_activation_ms: t,
            dt_ms: 1.0,
            ca_start_um: 0.0,
            ca_end_um: 0.0,
            lambda_prev: 1.0,
            lambda,
        };
        Tanh::new(p).unwrap().try_step(&step, &[], &mut []).unwrap()
    }

    #[test]
    fn nodes_with_stretches_of_their_own_have_the_stress_of_each() {
        let tanh = Tanh::new(TanhParameters::default()).unwrap();
        for n in [1, 7, 8, 9, 40] {
            let since: Vec<f64> = (0..n).map(|i| f64::from(i) * 29.0 - 60.0).collect();
            let lambda: Vec<f64> = (0..n).map(|i| 1.2 - 0.02 * f64::from(i)).collect();
            let step = EachStep {
                dt_ms: 1.0,
                lambda_prev: &lambda,
                lambda: &lambda,
                since_activation_ms: &since,
                ca_start_um: &[],
                ca_end_um: &[],
            };
            let mut stress = vec![ActiveStress::default(); n as usize];
            tanh.try_step_each(&step, &[], &mut [], &mut stress)
                .unwrap();
            for (node, found) in stress.iter().enumerate() {
                let alone = tanh.try_step(&step.node(node), &[], &mut []).unwrap();
                let (size, slope) = (1e-12 * (1.0 + alone.sa_kpa), alone.dsa_dlambda_kpa);
                assert!(
                    (found.sa_kpa - alone.sa_kpa).abs() < size,
                    "{found:?} {alone:?}"
                );
                assert!(
                    (found.dsa_dlambda_kpa - slope).abs() < 1e-12 * (1.0 + slope.abs()),
                    "{found:?} {alone:?}"
                );
            }
            assert!(n < 9 || stress.iter().any(|stress| stress.sa_kpa > 1.0));
        }
        let bad = EachStep {
            dt_ms: 1.0,
            lambda_prev: &[1.0; 2],
            lambda: &[1.0, f64::NAN],
            since_activation_ms: &[60.0; 2],
            ca_start_um: &[],
            ca_end_um: &[],
        };
        let found = tanh.try_step_each(&bad, &[], &mut [], &mut [ActiveStress::default(); 2]);
        assert!(matches!(found, Err(ContractionError::Stretch { .. })));
    }

    #[test]
    fn equals_the_printed_equation() {
        let p = TanhParameters::default();
        let phi: f64 = (5.0f64 * 0.3).tanh();
        assert!((phi - 0.905_148).abs() < 1e-6);
        for t in [16.0, 60.0, 200.0, 400.0, 564.0] {
            let ts = t - 15.0;
            let tau = 40.0 + 500.0 * (1.0 - phi);
            let expected =
                100.0 * phi * (ts / tau).tanh().powi(2) * ((550.0 - ts) / 110.0).tanh().powi(2);
            assert!((at(p, t, 1.0).sa_kpa - expected).abs() < 1e-11, "{t}");
        }
    }

    #[test]
    fn is_zero_outside_its_time_and_below_a7() {
        let p = TanhParameters::default();
        for t in [-100.0, 0.0, 15.0, 565.0, 900.0] {
            assert_eq!(at(p, t, 1.0), ActiveStress::default());
        }
        assert_eq!(at(p, 200.0, 0.69), ActiveStress::default());
    }

    #[test]
    fn each_parameter_moves_stress_and_tangent() {
        let base = TanhParameters::default();
        let reference = at(base, 150.0, 0.95);
        let moved = [
            TanhParameters {
                smax_ref_kpa: 101.0,
                ..base
            },
            TanhParameters {
                tau_sr_ref_ms: 41.0,
                ..base
            },
            TanhParameters {
                tau_sd_ms: 150.0,
                ..base
            },
            TanhParameters {
                t_cr_ms: 400.0,
                ..base
            },
            TanhParameters {
                t_emd_ms: 16.0,
                ..base
            },
            TanhParameters {
                a4_ms: 510.0,
                ..base
            },
            TanhParameters { a6: 5.1, ..base },
            TanhParameters { a7: 0.71, ..base },
        ];
        for p in moved {
            let other = at(p, 150.0, 0.95);
            assert!((other.sa_kpa - reference.sa_kpa).abs() > 1e-3, "{p:?}");
            assert!(
                (other.dsa_dlambda_kpa - reference.dsa_dlambda_kpa).abs() > 1e-3,
                "{p:?}"
            );
        }
    }

    #[test]
    fn refuses_nonsense() {
        let bad = TanhParameters {
            tau_sd_ms: -1.0,
            ..Default::default()
        };
        assert!(matches!(
            Tanh::new(bad),
            Err(ContractionError::Parameter { name: "tau_SD", .. })
        ));
        let cell = Tanh::new(TanhParameters::default()).unwrap();
        assert!(matches!(
            cell.active_stress(Ms(100.0), Stretch(f64::NAN)),
            Err(ContractionError::Stretch { .. })
        ));
    }

    proptest! {
        #[test]
        fn tangent_is_the_slope(t in 16.0..560.0f64, lambda in 0.71..1.2f64, tau in 0.5..80.0f64, a4 in 0.0..600.0f64) {
            let p = TanhParameters { tau_sr_ref_ms: tau, a4_ms: a4, ..Default::default() };
            let cell = Tanh::new(p).unwrap();
            let length = cell.phi_and_rise(Dual { v: lambda, d: 1.0 });
            let stress = cell.stress_kpa(Dual::of(t - p.t_emd_ms), length);
            let got = at(p, t, lambda);
            prop_assert_eq!(got.sa_kpa, stress.v);
            prop_assert!((got.dsa_dlambda_kpa - stress.d).abs() < 1e-11 * (1.0 + stress.d.abs()), "{got:?} {stress:?}");
        }

        #[test]
        fn equally_spaced_nodes_agree_with_single_nodes(
            t in -20.0..640.0f64, spacing in 0.0..4.0f64, lambda in 0.6..1.3f64, tau in 0.05..80.0f64, n in 1usize..40, bent in 0usize..2
        ) {
            let cell = Tanh::new(TanhParameters { tau_sr_ref_ms: tau, a4_ms: 5.0, tau_sd_ms: tau, ..Default::default() }).unwrap();
            let mut times: Vec<f64> = (0..n).map(|k| t - spacing * k as f64).collect();
            if bent == 1 {
                times[n / 2] += 0.3;
            }
            let step = UniformStep {
                dt_ms: 1.0, lambda_prev: 1.0, lambda, since_activation_ms: &times, ca_start_um: &[], ca_end_um: &[],
            };
            let mut stress = vec![ActiveStress::default(); n];
            cell.try_step_uniform(&step, &[], &mut [], &mut stress).unwrap();
            for (node_idx, out) in stress.iter().enumerate() {
                let single = cell.try_step(&step.node(node_idx), &[], &mut []).unwrap();
                prop_assert!((out.sa_kpa - single.sa_kpa).abs() < 1e-9);
                prop_assert!((out.dsa_dlambda_kpa - single.dsa_dlambda_kpa).abs() < 1e-8 * (1.0 + single.dsa_dlambda_kpa.abs()));
            }
        }
    }
}
