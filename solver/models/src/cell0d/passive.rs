//! Land passive stress of the 0D cell: an exponential spring next to a spring and dashpot in series (Jung 2022, eqs. A11-A15).

use crate::parameter::parameters;
use cardiotwin_vector_math::Number;

parameters! {
    /// Parameters of the passive element with the paper's names (Jung 2022, Table A3).
    pub struct LandPassiveParameters {
        /// Stiffness a_p of the parallel spring \[kPa\].
        a_p_kpa: "a_p", "a_p_kPa", Positive;
        /// Exponent b of the parallel spring.
        b: "b", "b", Positive;
        /// Stiffness of the series spring relative to a_p, k.
        k: "k", "k", Positive;
        /// Dashpot time constant on lengthening η_l \[ms\].
        eta_l_ms: "eta_l", "eta_l_ms", Positive;
        /// Dashpot time constant on shortening η_s \[ms\].
        eta_s_ms: "eta_s", "eta_s_ms", Positive;
    }
}

/// Passive stress and its slopes at one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassiveStress<T = f64> {
    /// S_p = a_p (e^{bC} − 1) + a_p k C_S \[kPa\].
    pub sp_kpa: T,
    /// Slope with respect to the total strain C \[kPa\].
    pub dsp_dstrain_kpa: T,
    /// Rate of the dashpot strain C_V \[1/ms\].
    pub cv_rate_per_ms: T,
    /// k/η \[1/ms\]: slope of that rate with C, and minus its slope with C_V.
    pub cv_stiffness_per_ms: T,
}

/// The passive element with its derived constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandPassive {
    /// Stiffness a_p of the parallel spring \[kPa\].
    pub a_p_kpa: f64,
    /// Exponent b of the parallel spring.
    pub b: f64,
    /// Stiffness of the series spring relative to a_p, k.
    pub k: f64,
    /// Rate k/η_l of the dashpot strain on lengthening \[1/ms\].
    pub rate_l_per_ms: f64,
    /// Rate k/η_s of the dashpot strain on shortening \[1/ms\].
    pub rate_s_per_ms: f64,
}

impl LandPassive {
    /// Constants of parameters that nobody has checked.
    #[must_use]
    pub fn new(p: &LandPassiveParameters) -> Self {
        Self {
            a_p_kpa: p.a_p_kpa,
            b: p.b,
            k: p.k,
            rate_l_per_ms: p.k / p.eta_l_ms,
            rate_s_per_ms: p.k / p.eta_s_ms,
        }
    }

    /// Stress at total strain `c` and dashpot strain `cv`, both dimensionless, over any number.
    #[inline(always)]
    pub fn stress<T: Number>(&self, c: T, cv: T) -> PassiveStress<T> {
        let of = T::of;
        // The exponent is limited so that a wild trial stage gives a large number, not an infinite one.
        let exponential = (of(self.b) * c).min(of(200.0)).exp();
        let cs = c - cv;
        let rate = if of(0.0).is_below(cs) {
            self.rate_l_per_ms
        } else {
            self.rate_s_per_ms
        };
        PassiveStress {
            sp_kpa: of(self.a_p_kpa) * of(self.k).mul_add(cs, exponential - of(1.0)),
            dsp_dstrain_kpa: of(self.a_p_kpa) * of(self.b).mul_add(exponential, of(self.k)),
            cv_rate_per_ms: of(rate) * cs,
            cv_stiffness_per_ms: of(rate),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_printed_equations() {
        let p = LandPassive::new(&LandPassiveParameters::default());
        let at = p.stress(-0.1, -0.08);
        assert!((at.sp_kpa - (42.0 * ((-0.91f64).exp() - 1.0) + 42.0 * 7.0 * -0.02)).abs() < 1e-12);
        assert!(
            (at.cv_rate_per_ms - 7.0 / 20.0 * -0.02).abs() < 1e-15,
            "shortening"
        );
        assert!(
            (p.stress(0.1, 0.08).cv_rate_per_ms - 7.0 / 200.0 * 0.02).abs() < 1e-15,
            "lengthening"
        );
        assert_eq!(p.stress(0.0, 0.0).sp_kpa, 0.0);
    }

    #[test]
    fn slope_and_every_parameter() {
        let p = LandPassiveParameters::default();
        let of = |p: LandPassiveParameters| LandPassive::new(&p);
        let h = 1e-6;
        let slope = (of(p).stress(-0.1 + h, -0.08).sp_kpa - of(p).stress(-0.1 - h, -0.08).sp_kpa)
            / (2.0 * h);
        assert!((slope - of(p).stress(-0.1, -0.08).dsp_dstrain_kpa).abs() < 1e-5);
        let moved = [
            LandPassiveParameters { a_p_kpa: 43.0, ..p },
            LandPassiveParameters { b: 9.2, ..p },
            LandPassiveParameters { k: 7.1, ..p },
            LandPassiveParameters {
                eta_s_ms: 21.0,
                ..p
            },
        ];
        for q in moved {
            assert_ne!(
                of(q).stress(-0.1, -0.08),
                of(p).stress(-0.1, -0.08),
                "{q:?}"
            );
        }
        let q = LandPassiveParameters {
            eta_l_ms: 210.0,
            ..p
        };
        assert_ne!(of(q).stress(0.1, 0.08), of(p).stress(0.1, 0.08));
    }
}
