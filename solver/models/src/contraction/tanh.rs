//! Tanh active stress (Jung 2022, eqs. A1-A3; Niederer 2011 in CARPentry): a function of time since activation and stretch.

use super::{ActiveStress, Contraction, ContractionError, EachStep, NodeStep, UniformStep};
use crate::parameter::Domain;
use cardiotwin_units::{Kpa, Ms, Stretch};
use cardiotwin_vector_math::{Lane, Number};
use pulp::{Arch, Simd, WithSimd};

pub use cardiotwin_vocabulary::step1::TanhParameters;

/// Tanh active stress, `Sa = Smax_ref φ tanh²(ts/τ_SR) tanh²((t_CR − ts)/τ_SD)` for `0 < ts < t_CR`, else 0.
///
/// `ts = t − t_a − t_emd`, `φ = max(0, tanh(a6 (λ − a7)))`, `τ_SR = τ_SR_ref + a4 (1 − φ)` (Jung 2022, eqs. A1-A3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tanh {
    parameters: TanhParameters,
}

/// Length dependence at one stretch, shared by all nodes with it.
struct Length {
    phi: f64,
    dphi: f64,
    tau_sr_ms: f64,
    dtau_sr_ms: f64,
}

/// Square of tanh from `decay = e^{−2x}`, x ≥ 0, and its derivative 2 tanh sech² with x.
#[inline]
fn tanh_squared<T: Number>(decay: T) -> (T, T) {
    let one = T::of(1.0);
    let inverse = one / (one + decay);
    let tanh = (one - decay) * inverse;
    // sech² = 4 e^{−2x} / (1 + e^{−2x})²
    (tanh * tanh, T::of(8.0) * tanh * decay * inverse * inverse)
}

impl Tanh {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ContractionError::Parameter`] for a stress or time constant that is not positive, or a negative a4.
    pub fn new(parameters: TanhParameters) -> Result<Self, ContractionError> {
        let p = parameters;
        for (name, value, domain) in [
            ("Smax_ref", p.smax_ref_kpa, Domain::Positive),
            ("tau_SR_ref", p.tau_sr_ref_ms, Domain::Positive),
            ("tau_SD", p.tau_sd_ms, Domain::Positive),
            ("t_CR", p.t_cr_ms, Domain::Positive),
            ("t_emd", p.t_emd_ms, Domain::NotNegative),
            ("a4", p.a4_ms, Domain::NotNegative),
            ("a6", p.a6, Domain::Positive),
            ("a7", p.a7, Domain::NotNegative),
        ] {
            if !domain.contains(value) {
                let expected = domain.expected();
                return Err(ContractionError::Parameter {
                    name,
                    value,
                    expected,
                });
            }
        }
        Ok(Self { parameters })
    }

    /// The parameters it was made from.
    #[must_use]
    pub fn parameters(&self) -> &TanhParameters {
        &self.parameters
    }

    /// Active stress at a time since activation and a stretch (eqs. A1-A3). Verified by `tanh_reference_traces`.
    ///
    /// # Errors
    /// [`ContractionError::Stretch`] when the stretch is not positive and finite.
    pub fn active_stress(
        &self,
        since_activation: Ms,
        lambda: Stretch,
    ) -> Result<Kpa, ContractionError> {
        let length = self.length(lambda.0)?;
        let ts = since_activation.0 - self.parameters.t_emd_ms;
        if !self.is_active(ts) {
            return Ok(Kpa(0.0));
        }
        Ok(Kpa(self.stress_kpa(ts, (length.phi, length.tau_sr_ms))))
    }

    /// Whether there is stress `ts` after the delay \[ms\].
    #[inline]
    fn is_active(&self, ts: f64) -> bool {
        ts > 0.0 && ts < self.parameters.t_cr_ms
    }

    /// Equations A1-A3 over any number: φ and τ_SR \[ms\] at a stretch.
    #[inline]
    fn phi_and_rise<T: Number>(&self, lambda: T) -> (T, T) {
        let (p, of) = (&self.parameters, T::of);
        // tanh from one exponential; what cancels near zero is of the order of round-off of one.
        let exponential = (of(2.0 * p.a6) * (lambda - of(p.a7))).exp();
        let phi = (of(1.0) - of(2.0) / (exponential + of(1.0))).max(of(0.0));
        (phi, of(p.tau_sr_ref_ms) + of(p.a4_ms) * (of(1.0) - phi))
    }

    /// Equations A1-A3 over any number: active stress \[kPa\] at `ts` after the delay \[ms\], with φ and τ_SR \[ms\].
    #[inline]
    fn stress_kpa<T: Number>(&self, ts: T, (phi, tau_sr_ms): (T, T)) -> T {
        let (rise, fall) = self.decays(ts, tau_sr_ms);
        self.envelope(fall) * phi * tanh_squared(rise).0
    }

    /// `e^{−2 ts/τ_SR}` and `e^{−2 (t_CR − ts)/τ_SD}`.
    #[inline]
    fn decays<T: Number>(&self, ts: T, tau_sr_ms: T) -> (T, T) {
        let (p, of) = (&self.parameters, T::of);
        (
            (of(-2.0) * ts / tau_sr_ms).exp(),
            (of(-2.0) * (of(p.t_cr_ms) - ts) / of(p.tau_sd_ms)).exp(),
        )
    }

    /// Smax_ref tanh² of the fall \[kPa\].
    #[inline]
    fn envelope<T: Number>(&self, fall: T) -> T {
        T::of(self.parameters.smax_ref_kpa) * tanh_squared(fall).0
    }

    fn length(&self, lambda: f64) -> Result<Length, ContractionError> {
        if !(lambda > 0.0 && lambda.is_finite()) {
            return Err(ContractionError::Stretch { lambda });
        }
        let p = &self.parameters;
        let (phi, tau_sr_ms) = self.phi_and_rise(lambda);
        let dphi = if phi > 0.0 {
            p.a6 * (1.0 - phi * phi)
        } else {
            0.0
        };
        Ok(Length {
            phi,
            dphi,
            tau_sr_ms,
            dtau_sr_ms: -p.a4_ms * dphi,
        })
    }

    /// Stress of active nodes at equal distances in time, oldest first: from node to node both exponentials change by a
    /// constant factor. The rise's sequence starts at the youngest node and the fall's at the oldest, where each is largest,
    /// so that they only ever underflow to the right value, zero.
    fn equally_spaced(
        &self,
        times: &[f64],
        spacing: f64,
        length: &Length,
        stress: &mut [ActiveStress],
    ) {
        let p = &self.parameters;
        let n = times.len();
        let rise_ratio = (-2.0 * spacing / length.tau_sr_ms).exp();
        let fall_ratio = (-2.0 * spacing / p.tau_sd_ms).exp();
        let rise = (-2.0 * (times[n - 1] - p.t_emd_ms) / length.tau_sr_ms).exp();
        let fall = (-2.0 * (p.t_cr_ms - (times[0] - p.t_emd_ms)) / p.tau_sd_ms).exp();
        // Four sequences side by side: a single one would wait for each product.
        let powers = |start: f64, q: f64| {
            (
                [start, start * q, start * q * q, start * q * q * q],
                (q * q) * (q * q),
            )
        };
        let ((mut fall, fall_ratio), (mut rise, rise_ratio)) =
            (powers(fall, fall_ratio), powers(rise, rise_ratio));
        for chunk in stress.chunks_mut(4) {
            for (out, f) in chunk.iter_mut().zip(&mut fall) {
                out.sa_kpa = *f;
                *f *= fall_ratio;
            }
        }
        let factor = -length.dtau_sr_ms / (length.tau_sr_ms * length.tau_sr_ms);
        for (chunk, times) in stress.rchunks_mut(4).zip(times.rchunks(4)) {
            for ((out, t), r) in chunk.iter_mut().zip(times).rev().zip(&mut rise) {
                // As `stress`, with one division for both factors.
                let fall = out.sa_kpa;
                let inverse = 1.0 / ((1.0 + *r) * (1.0 + fall));
                let tanh = (1.0 - *r) * (1.0 + fall) * inverse;
                let tanh_fall = (1.0 - fall) * (1.0 + *r) * inverse;
                let sech = (1.0 + fall) * inverse;
                let envelope = p.smax_ref_kpa * tanh_fall * tanh_fall;
                let (up, dup) = (tanh * tanh, 8.0 * tanh * *r * sech * sech);
                out.sa_kpa = envelope * length.phi * up;
                out.dsa_dlambda_kpa =
                    envelope * (length.dphi * up + length.phi * dup * (t - p.t_emd_ms) * factor);
                *r *= rise_ratio;
            }
        }
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

    #[inline]
    fn stress(&self, since_activation_ms: f64, length: &Length) -> ActiveStress {
        let ts = since_activation_ms - self.parameters.t_emd_ms;
        if !self.is_active(ts) {
            return ActiveStress::default();
        }
        let (rise, fall) = self.decays(ts, length.tau_sr_ms);
        let (up, dup) = tanh_squared(rise);
        let envelope = self.envelope(fall);
        let dx = -ts / (length.tau_sr_ms * length.tau_sr_ms) * length.dtau_sr_ms;
        ActiveStress {
            sa_kpa: envelope * length.phi * up,
            dsa_dlambda_kpa: envelope * (length.dphi * up + length.phi * dup * dx),
        }
    }
}

/// Nodes that are computed together.
const LANES: usize = 8;

impl Tanh {
    /// As [`Self::stress`] without a branch, in the numbers of vector code. Products are not fused with sums, so that every
    /// processor gives the same bits.
    #[inline(always)]
    fn lane(&self, since_activation_ms: f64, lambda: f64) -> (f64, f64) {
        let p = &self.parameters;
        let ts = since_activation_ms - p.t_emd_ms;
        let (Lane(phi), tau_sr) = self.phi_and_rise(Lane::<false>(lambda));
        let dphi = if phi > 0.0 {
            p.a6 * (1.0 - phi * phi)
        } else {
            0.0
        };
        let (rise, fall) = self.decays(Lane(ts), tau_sr);
        let (Lane(up), Lane(dup)) = tanh_squared(rise);
        let Lane(envelope) = self.envelope(fall);
        let dx = ts / (tau_sr.0 * tau_sr.0) * p.a4_ms * dphi;
        let stress = (envelope * phi * up, envelope * (dphi * up + phi * dup * dx));
        // Both comparisons are made, since a branch would keep the loop from vector code.
        if (ts > 0.0) & (ts < p.t_cr_ms) {
            stress
        } else {
            (0.0, 0.0)
        }
    }
}

/// Nodes with stretches of their own, to be compiled for each instruction set.
struct Each<'a> {
    tanh: Tanh,
    since_activation_ms: &'a [f64],
    lambda: &'a [f64],
    stress: &'a mut [ActiveStress],
}

impl WithSimd for Each<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { tanh, stress, .. } = self;
        let since = self.since_activation_ms.chunks(LANES);
        for ((since, lambda), out) in since
            .zip(self.lambda.chunks(LANES))
            .zip(stress.chunks_mut(LANES))
        {
            let is_active = |t: &f64| tanh.is_active(t - tanh.parameters.t_emd_ms);
            if !since.iter().any(is_active) {
                out.fill(ActiveStress::default());
                continue;
            }
            let n = out.len();
            let (mut times, mut stretches) = ([0.0; LANES], [1.0; LANES]);
            times[..n].copy_from_slice(since);
            stretches[..n].copy_from_slice(lambda);
            let (mut sa, mut dsa) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                (sa[lane], dsa[lane]) = tanh.lane(times[lane], stretches[lane]);
            }
            for ((out, sa_kpa), dsa_dlambda_kpa) in out.iter_mut().zip(sa).zip(dsa) {
                *out = ActiveStress {
                    sa_kpa,
                    dsa_dlambda_kpa,
                };
            }
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
    use cardiotwin_vector_math::Dual;
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
