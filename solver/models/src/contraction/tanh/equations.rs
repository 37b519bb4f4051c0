//! Equations of the Tanh active stress (Jung 2022, eqs. A1-A3), over any number.

use crate::contraction::{ActiveStress, ContractionError};
use crate::parameter::Domain;
use cardiotwin_units::{Kpa, Ms, Stretch};
use cardiotwin_vector_math::Number;
use cardiotwin_vocabulary::step1::TanhParameters;

/// Tanh active stress, `Sa = Smax_ref φ tanh²(ts/τ_SR) tanh²((t_CR − ts)/τ_SD)` for `0 < ts < t_CR`, else 0.
///
/// `ts = t − t_a − t_emd`, `φ = max(0, tanh(a6 (λ − a7)))`, `τ_SR = τ_SR_ref + a4 (1 − φ)` (Jung 2022, eqs. A1-A3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tanh {
    pub(super) parameters: TanhParameters,
}

/// Length dependence at one stretch, shared by all nodes with it.
pub(super) struct Length {
    pub(super) phi: f64,
    pub(super) dphi: f64,
    pub(super) tau_sr_ms: f64,
    pub(super) dtau_sr_ms: f64,
}

/// Square of tanh from `decay = e^{−2x}`, x ≥ 0, and its derivative 2 tanh sech² with x.
#[inline]
pub(super) fn tanh_squared<T: Number>(decay: T) -> (T, T) {
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
    pub(super) fn is_active(&self, ts: f64) -> bool {
        ts > 0.0 && ts < self.parameters.t_cr_ms
    }

    /// Equations A1-A3 over any number: φ and τ_SR \[ms\] at a stretch.
    #[inline]
    pub(super) fn phi_and_rise<T: Number>(&self, lambda: T) -> (T, T) {
        let (p, of) = (&self.parameters, T::of);
        // tanh from one exponential; what cancels near zero is of the order of round-off of one.
        let exponential = (of(2.0 * p.a6) * (lambda - of(p.a7))).exp();
        let phi = (of(1.0) - of(2.0) / (exponential + of(1.0))).max(of(0.0));
        (phi, of(p.tau_sr_ref_ms) + of(p.a4_ms) * (of(1.0) - phi))
    }

    /// Equations A1-A3 over any number: active stress \[kPa\] at `ts` after the delay \[ms\], with φ and τ_SR \[ms\].
    #[inline]
    pub(super) fn stress_kpa<T: Number>(&self, ts: T, (phi, tau_sr_ms): (T, T)) -> T {
        let (rise, fall) = self.decays(ts, tau_sr_ms);
        self.envelope(fall) * phi * tanh_squared(rise).0
    }

    /// `e^{−2 ts/τ_SR}` and `e^{−2 (t_CR − ts)/τ_SD}`.
    #[inline]
    pub(super) fn decays<T: Number>(&self, ts: T, tau_sr_ms: T) -> (T, T) {
        let (p, of) = (&self.parameters, T::of);
        (
            (of(-2.0) * ts / tau_sr_ms).exp(),
            (of(-2.0) * (of(p.t_cr_ms) - ts) / of(p.tau_sd_ms)).exp(),
        )
    }

    /// Smax_ref tanh² of the fall \[kPa\].
    #[inline]
    pub(super) fn envelope<T: Number>(&self, fall: T) -> T {
        T::of(self.parameters.smax_ref_kpa) * tanh_squared(fall).0
    }

    pub(super) fn length(&self, lambda: f64) -> Result<Length, ContractionError> {
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

    #[inline]
    pub(super) fn stress(&self, since_activation_ms: f64, length: &Length) -> ActiveStress {
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
