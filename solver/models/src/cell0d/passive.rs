//! Land passive stress of the 0D cell: an exponential spring beside a spring and dashpot in series (Jung 2022, eqs. A11-A15).

use serde::{Deserialize, Serialize};

/// Parameters of the passive element with the paper's names (Jung 2022, Table A3).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LandPassiveParameters {
    /// Stiffness a_p \[kPa\].
    pub a_p_kpa: f64,
    /// Exponent b.
    pub b: f64,
    /// Stiffness of the series spring relative to a_p, k.
    pub k: f64,
    /// Dashpot time constant on lengthening η_l \[ms\].
    pub eta_l_ms: f64,
    /// Dashpot time constant on shortening η_s \[ms\].
    pub eta_s_ms: f64,
}

impl Default for LandPassiveParameters {
    /// Jung 2022, Table A3, with the a_p of the sensitivity analysis.
    fn default() -> Self {
        Self {
            a_p_kpa: 42.0,
            b: 9.1,
            k: 7.0,
            eta_l_ms: 200.0,
            eta_s_ms: 20.0,
        }
    }
}

/// Passive stress and its slopes at one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PassiveStress {
    /// S_p = a_p (e^{bC} − 1) + a_p k C_S \[kPa\].
    pub sp_kpa: f64,
    /// Slope with respect to the total strain C \[kPa\].
    pub dsp_dstrain_kpa: f64,
    /// Rate of the dashpot strain C_V \[1/ms\].
    pub cv_rate_per_ms: f64,
    /// k/η \[1/ms\]: slope of that rate with C, and minus its slope with C_V.
    pub cv_stiffness_per_ms: f64,
}

impl LandPassiveParameters {
    /// Name and value of the first parameter that is not positive and finite.
    pub(crate) fn first_bad(&self) -> Option<(&'static str, f64)> {
        [
            ("a_p", self.a_p_kpa),
            ("b", self.b),
            ("k", self.k),
            ("eta_l", self.eta_l_ms),
            ("eta_s", self.eta_s_ms),
        ]
        .into_iter()
        .find(|(_, value)| !(*value > 0.0 && value.is_finite()))
    }

    /// Stress at total strain `c` and dashpot strain `cv`, both dimensionless.
    #[inline]
    pub(crate) fn stress(&self, c: f64, cv: f64) -> PassiveStress {
        // The exponent is limited so that a wild trial stage gives a large number, not an infinite one.
        let exponential = (self.b * c).min(200.0).exp();
        let cs = c - cv;
        let eta = if cs > 0.0 {
            self.eta_l_ms
        } else {
            self.eta_s_ms
        };
        let stiffness = self.k / eta;
        PassiveStress {
            sp_kpa: self.a_p_kpa * (exponential - 1.0 + self.k * cs),
            dsp_dstrain_kpa: self.a_p_kpa * (self.b * exponential + self.k),
            cv_rate_per_ms: stiffness * cs,
            cv_stiffness_per_ms: stiffness,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_printed_equations() {
        let p = LandPassiveParameters::default();
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
        let h = 1e-6;
        let slope =
            (p.stress(-0.1 + h, -0.08).sp_kpa - p.stress(-0.1 - h, -0.08).sp_kpa) / (2.0 * h);
        assert!((slope - p.stress(-0.1, -0.08).dsp_dstrain_kpa).abs() < 1e-5);
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
            assert_ne!(q.stress(-0.1, -0.08), p.stress(-0.1, -0.08), "{q:?}");
        }
        let q = LandPassiveParameters {
            eta_l_ms: 210.0,
            ..p
        };
        assert_ne!(q.stress(0.1, 0.08), p.stress(0.1, 0.08));
    }
}
