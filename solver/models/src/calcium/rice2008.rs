//! Rice 2008 calcium transient (Jung 2022, eq. A16), in a form that is symmetric in the two time
//! constants.

use super::{Calcium, CalciumError};
use crate::parameter::parameters;
use crate::roots::{RootError, increasing_root};
use cardiotwin_units::Ms;
use cardiotwin_vector_math::{Lane, Number};
use pulp::{Arch, Simd, WithSimd};

parameters! {
    /// Parameters of [`Rice2008`] with the paper's names (Jung 2022, Table A4).
    pub struct Rice2008Parameters {
        /// Resting calcium Ca_res \[µM\].
        ca_res_um: "Ca_res", "Ca_res_uM", Positive;
        /// Peak calcium Ca_max \[µM\].
        ca_max_um: "Ca_max", "Ca_max_uM", Positive;
        /// Rise time constant τ_CR \[ms\].
        tau_cr_ms: "tau_CR", "tau_CR_ms", Positive;
        /// Decay time constant τ_CD \[ms\].
        tau_cd_ms: "tau_CD", "tau_CD_ms", Positive;
    }
}

/// Rice's transient normalised to a peak of one, `K e^{−a s} (1 − e^{−2 d s})`.
///
/// s is the time since activation, a the smaller rate and 2d the difference of the rates. The form
/// is symmetric in the two time constants and free of cancellation. For d → 0 it becomes
/// `(s/τ) e^{1 − s/τ}`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rice2008Shape {
    /// Smaller rate 1/max(τ) \[1/ms\]; the mean of the two in the limit.
    pub slow_per_ms: f64,
    /// Difference of the rates, 2d \[1/ms\]; zero selects the limit.
    pub gap_per_ms: f64,
    /// Normalisation K: dimensionless, or \[1/ms\] in the limit.
    pub scale: f64,
    /// Time of the peak \[ms\].
    pub peak_ms: f64,
}

impl Rice2008Shape {
    /// The shape for two positive time constants \[ms\]. The limit of equal rates is used where d
    /// is less than `equal_rates` times the mean rate; its error is of order (d s)²/6.
    #[must_use]
    pub fn new(tau_cr_ms: f64, tau_cd_ms: f64, equal_rates: f64) -> Self {
        let slow = 1.0 / tau_cr_ms.max(tau_cd_ms);
        // The difference comes from the time constants, where it is exact for close values, and not
        // from two rounded rates.
        let gap = (tau_cr_ms - tau_cd_ms).abs() / (tau_cr_ms * tau_cd_ms);
        let (mean, half) = (slow + 0.5 * gap, 0.5 * gap);
        let ratio = half / mean;
        let (slow_per_ms, gap_per_ms, peak_ms, scale) = if ratio < equal_rates {
            (mean, 0.0, 1.0 / mean, mean * std::f64::consts::E)
        } else {
            let peak = ratio.atanh() / half;
            (
                slow,
                gap,
                peak,
                (slow * peak).exp() / -(-gap * peak).exp_m1(),
            )
        };
        Self {
            slow_per_ms,
            gap_per_ms,
            scale,
            peak_ms,
        }
    }

    /// Value at a non-negative time \[ms\] since activation: 0 at activation, 1 at the peak.
    #[inline(always)]
    pub fn value<T: Number>(&self, s: T) -> T {
        let envelope = T::of(self.scale) * (T::of(-self.slow_per_ms) * s).exp();
        if self.gap_per_ms == 0.0 {
            T::of(self.scale) * s * (T::of(-self.slow_per_ms) * s).exp()
        } else {
            envelope * -(T::of(-self.gap_per_ms) * s).exp_m1()
        }
    }

    /// Value at a time \[ms\] since activation, and its slope \[1/ms\].
    #[inline]
    fn value_and_slope(&self, s: f64) -> (f64, f64) {
        let envelope = self.scale * (-self.slow_per_ms * s).exp();
        if self.gap_per_ms == 0.0 {
            (envelope * s, envelope * (1.0 - self.slow_per_ms * s))
        } else {
            let m = (-self.gap_per_ms * s).exp_m1();
            (
                -envelope * m,
                envelope * (self.slow_per_ms * m + self.gap_per_ms * (m + 1.0)),
            )
        }
    }

    /// Time from activation until the transient has decayed by `fraction` of its amplitude, for
    /// example CTD50 with 0.5 and CTD90 with 0.9 (Jung 2022, Appendix C). It comes from the
    /// analytic curve without a limit at the cycle length.
    ///
    /// # Errors
    /// [`RootError`] if `fraction` is not inside (0, 1).
    pub fn decay_time(&self, fraction: f64) -> Result<Ms, RootError> {
        let level = 1.0 - fraction;
        // The slow exponential alone is an upper bound of the decay time.
        let bound = self.peak_ms + 60.0 / self.slow_per_ms;
        let guess = self.peak_ms + (1.0 + fraction) / self.slow_per_ms;
        increasing_root(self.peak_ms, bound, guess, 1e-10, |s| {
            let (shape, slope) = self.value_and_slope(s);
            (level - shape, -slope)
        })
        .map(Ms)
    }
}

/// The transient `Ca_res + (Ca_max − Ca_res) · shape(s)`, where s is the time since activation. Its
/// peak is exactly Ca_max.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rice2008 {
    parameters: Rice2008Parameters,
    shape: Rice2008Shape,
}

/// Relative difference of the rates below which the limit is exact to round-off.
const EQUAL_RATES: f64 = 1e-9;

impl Rice2008Parameters {
    /// Calcium \[µM\] at times \[ms\] after activation, of parameters that nobody has checked; the
    /// resting value before activation.
    #[must_use]
    pub fn transient_um(&self, times_ms: &[f64]) -> Vec<f64> {
        let rice = Rice2008::unchecked(*self);
        times_ms.iter().map(|s| rice.concentration_um(*s)).collect()
    }
}

impl Rice2008 {
    /// Checks the parameters and prepares the transient.
    ///
    /// # Errors
    /// [`CalciumError`] if a time constant or a concentration is not positive and finite.
    pub fn new(parameters: Rice2008Parameters) -> Result<Self, CalciumError> {
        let Rice2008Parameters {
            ca_res_um,
            ca_max_um,
            tau_cr_ms,
            tau_cd_ms,
        } = parameters;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        if !positive(tau_cr_ms) || !positive(tau_cd_ms) {
            return Err(CalciumError::TimeConstants {
                tau_cr_ms,
                tau_cd_ms,
            });
        }
        if !positive(ca_res_um) || !positive(ca_max_um) {
            return Err(CalciumError::Concentrations {
                ca_res_um,
                ca_max_um,
            });
        }
        Ok(Self::unchecked(parameters))
    }

    fn unchecked(parameters: Rice2008Parameters) -> Self {
        let Rice2008Parameters {
            tau_cr_ms,
            tau_cd_ms,
            ..
        } = parameters;
        Self {
            parameters,
            shape: Rice2008Shape::new(tau_cr_ms, tau_cd_ms, EQUAL_RATES),
        }
    }

    /// Parameters of the transient.
    #[must_use]
    pub fn parameters(&self) -> &Rice2008Parameters {
        &self.parameters
    }

    /// Time of the peak after activation, `ln(τ1/τ2) τ1 τ2/(τ1 − τ2)`.
    #[must_use]
    pub fn time_of_peak(&self) -> Ms {
        Ms(self.shape.peak_ms)
    }

    /// [`Rice2008Shape::decay_time`] of this transient.
    ///
    /// # Errors
    /// [`RootError`] if `fraction` is not inside (0, 1).
    pub fn decay_time(&self, fraction: f64) -> Result<Ms, RootError> {
        self.shape.decay_time(fraction)
    }
}

/// Number of times that are computed together.
const LANES: usize = 8;

/// Times that become calcium, to be compiled for each instruction set.
struct OfTimes<'a> {
    rice: &'a Rice2008,
    values: &'a mut [f64],
}

impl WithSimd for OfTimes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Rice2008 { parameters, shape } = *self.rice;
        let amplitude = parameters.ca_max_um - parameters.ca_res_um;
        for chunk in self.values.chunks_mut(LANES) {
            let mut lanes = [0.0; LANES];
            lanes[..chunk.len()].copy_from_slice(chunk);
            for lane in &mut lanes {
                let value = shape.value(Lane::<false>(*lane)).0;
                let value = if *lane < 0.0 { 0.0 } else { value };
                *lane = parameters.ca_res_um + amplitude * value;
            }
            chunk.copy_from_slice(&lanes[..chunk.len()]);
        }
    }
}

impl Calcium for Rice2008 {
    fn of_times(&self, times_to_um: &mut [f64]) {
        Arch::new().dispatch(OfTimes {
            rice: self,
            values: times_to_um,
        });
    }

    fn concentration_um(&self, since_activation_ms: f64) -> f64 {
        let Rice2008Parameters {
            ca_res_um,
            ca_max_um,
            ..
        } = self.parameters;
        if since_activation_ms < 0.0 {
            ca_res_um
        } else {
            ca_res_um + (ca_max_um - ca_res_um) * self.shape.value(since_activation_ms)
        }
    }

    #[inline]
    fn value_and_rate(&self, since_activation_ms: f64) -> (f64, f64) {
        let Rice2008Parameters {
            ca_res_um,
            ca_max_um,
            ..
        } = self.parameters;
        if since_activation_ms < 0.0 {
            return (ca_res_um, 0.0);
        }
        let (shape, slope) = self.shape.value_and_slope(since_activation_ms);
        (
            ca_res_um + (ca_max_um - ca_res_um) * shape,
            (ca_max_um - ca_res_um) * slope,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_vector_math::Dual;
    use proptest::prelude::*;

    fn rice(tau_cr_ms: f64, tau_cd_ms: f64) -> Rice2008 {
        Rice2008::new(Rice2008Parameters {
            tau_cr_ms,
            tau_cd_ms,
            ..Default::default()
        })
        .unwrap()
    }

    /// Equation A16 as printed (with SPEC's β), for time constants far enough apart to avoid
    /// cancellation.
    fn printed(s: f64, tau_cr: f64, tau_cd: f64) -> f64 {
        let r = tau_cr / tau_cd;
        let beta = r.powf(-1.0 / (r - 1.0)) - r.powf(-1.0 / (1.0 - 1.0 / r));
        0.15 + 0.45 / beta * ((-s / tau_cr).exp() - (-s / tau_cd).exp())
    }

    #[test]
    fn many_times_agree_with_one_by_one() {
        let times: Vec<f64> = (-3..40).map(|k| 17.3 * f64::from(k)).collect();
        for (tau_cr, tau_cd) in [(129.0, 60.0), (30.0, 190.0), (80.0, 80.0)] {
            let ca = rice(tau_cr, tau_cd);
            let mut together = times.clone();
            ca.of_times(&mut together);
            for (s, found) in times.iter().zip(together) {
                assert!((found - ca.concentration_um(*s)).abs() < 1e-14, "{s}");
            }
        }
    }

    #[test]
    fn equals_the_printed_equation() {
        for (tau_cr, tau_cd) in [(129.0, 60.0), (30.0, 190.0), (192.5, 26.0)] {
            let ca = rice(tau_cr, tau_cd);
            for s in [0.0, 1.0, 20.0, 100.0, 500.0, 1200.0] {
                assert!(
                    (ca.concentration_um(s) - printed(s, tau_cr, tau_cd)).abs() < 1e-13,
                    "{tau_cr} {tau_cd} {s}"
                );
            }
        }
    }

    #[test]
    fn peak_is_ca_max_at_the_closed_form_time() {
        let ca = rice(129.0, 128.0);
        let expected = (129.0f64 / 128.0).ln() * 129.0 * 128.0;
        assert!((ca.time_of_peak().0 - expected).abs() < 1e-9);
        assert!((ca.concentration_um(expected) - 0.6).abs() < 1e-15);
        assert!(ca.value_and_rate(expected).1.abs() < 1e-15);
    }

    #[test]
    fn equal_time_constants_are_the_limit() {
        let equal = rice(130.0, 130.0);
        for s in [0.0, 5.0, 130.0, 700.0] {
            let limit = 0.15 + 0.45 * s / 130.0 * (1.0 - s / 130.0f64).exp();
            assert!((equal.concentration_um(s) - limit).abs() < 1e-15);
            for gap in [1e-3, 1e-6, 1e-8, 1e-10, 1e-13] {
                let near = rice(130.0 * (1.0 + gap), 130.0 * (1.0 - gap));
                assert!(
                    (near.concentration_um(s) - limit).abs() < 1e-15 + 2.0 * gap * gap * 50.0,
                    "{gap} {s}"
                );
            }
        }
    }

    #[test]
    fn reference_decay_times() {
        let ca = rice(129.0, 128.0);
        assert!((ca.decay_time(0.5).unwrap().0 - 344.165_571_937_979).abs() < 1e-8);
        assert!((ca.decay_time(0.9).unwrap().0 - 628.328_866_988_942).abs() < 1e-8);
    }

    #[test]
    fn before_activation_it_rests() {
        assert_eq!(rice(129.0, 128.0).concentration_um(-3.0), 0.15);
    }

    #[test]
    fn each_parameter_moves_the_transient() {
        let base = Rice2008Parameters::default();
        let value = |p: Rice2008Parameters| Rice2008::new(p).unwrap().concentration_um(250.0);
        let moved = [
            Rice2008Parameters {
                ca_res_um: 0.16,
                ..base
            },
            Rice2008Parameters {
                ca_max_um: 0.61,
                ..base
            },
            Rice2008Parameters {
                tau_cr_ms: 130.0,
                ..base
            },
            Rice2008Parameters {
                tau_cd_ms: 127.0,
                ..base
            },
        ];
        for p in moved {
            assert!((value(p) - value(base)).abs() > 1e-6, "{p:?}");
        }
    }

    #[test]
    fn refuses_nonsense() {
        let bad = Rice2008Parameters {
            tau_cr_ms: 0.0,
            ..Default::default()
        };
        assert!(matches!(
            Rice2008::new(bad),
            Err(CalciumError::TimeConstants { .. })
        ));
        let bad = Rice2008Parameters {
            ca_res_um: f64::NAN,
            ..Default::default()
        };
        assert!(matches!(
            Rice2008::new(bad),
            Err(CalciumError::Concentrations { .. })
        ));
    }

    proptest! {
        #[test]
        fn swapping_the_time_constants_changes_nothing(a in 20.0..200.0f64, b in 20.0..200.0f64, s in 0.0..1500.0f64) {
            prop_assert_eq!(rice(a, b).concentration_um(s), rice(b, a).concentration_um(s));
        }

        #[test]
        fn slope_is_that_of_the_shape(a in 20.0..200.0f64, b in 20.0..200.0f64, s in 0.0..1000.0f64) {
            let shape = rice(a, b).shape;
            let dual = shape.value(Dual { v: s, d: 1.0 });
            let (value, slope) = shape.value_and_slope(s);
            prop_assert!((value - dual.v).abs() < 1e-14 && (slope - dual.d).abs() < 1e-15, "{:?} {} {}", dual, value, slope);
        }

        #[test]
        fn stays_between_rest_and_peak(a in 20.0..200.0f64, b in 20.0..200.0f64, s in 0.0..3000.0f64) {
            let ca = rice(a, b).concentration_um(s);
            prop_assert!((0.15..=0.6 + 1e-14).contains(&ca));
        }
    }
}
