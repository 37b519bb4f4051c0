//! Rice's calcium transient.

use super::RiceParameters;

/// Relative difference of the rates below which the limit of equal rates is exact to round-off.
const EQUAL_RATES: f64 = 1e-9;

impl RiceParameters {
    /// Calcium in µM at times in ms after activation; the resting value before activation.
    ///
    /// Source: Jung et al. 2022, eq. A16 (Rice 2008), written as e^{−s/τ₁} (1 − e^{−s (1/τ₂ −
    /// 1/τ₁)}) over its peak, where τ₁ is the longer time constant. This form is symmetric in the
    /// two constants and free of cancellation where they are close.
    #[must_use]
    pub fn transient_um(&self, times_ms: &[f64]) -> Vec<f64> {
        let (longer, shorter) = (
            self.tau_cr_ms.max(self.tau_cd_ms),
            self.tau_cr_ms.min(self.tau_cd_ms),
        );
        let slow = 1.0 / longer;
        let gap = (longer - shorter) / (longer * shorter);
        let equal = 0.5 * gap < EQUAL_RATES * slow;
        let slow = if equal { slow + 0.5 * gap } else { slow };
        let shape = |s: f64| (-slow * s).exp() * if equal { s } else { -(-gap * s).exp_m1() };
        let peak = shape(if equal {
            1.0 / slow
        } else {
            (gap * longer).ln_1p() / gap
        });
        let rise = self.ca_max_um - self.ca_res_um;
        times_ms
            .iter()
            .map(|s| {
                self.ca_res_um
                    + if *s > 0.0 {
                        rise * (shape(*s) / peak)
                    } else {
                        0.0
                    }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rice(tau_cr_ms: f64, tau_cd_ms: f64, s: f64) -> f64 {
        RiceParameters {
            ca_res_um: 0.15,
            ca_max_um: 0.6,
            tau_cr_ms,
            tau_cd_ms,
        }
        .transient_um(&[s])[0]
    }

    /// Equation A16 as printed, with β's exponents as in docs/models.md, for time constants far
    /// enough apart to avoid cancellation.
    #[test]
    fn equals_the_printed_equation() {
        for (tau_cr, tau_cd) in [(129.0, 60.0), (30.0, 190.0), (192.5, 26.0)] {
            let r: f64 = tau_cr / tau_cd;
            let beta = r.powf(-1.0 / (r - 1.0)) - r.powf(-1.0 / (1.0 - 1.0 / r));
            for s in [0.0, 1.0, 20.0, 100.0, 500.0, 1200.0] {
                let printed = 0.15 + 0.45 / beta * (f64::exp(-s / tau_cr) - f64::exp(-s / tau_cd));
                assert!(
                    (rice(tau_cr, tau_cd, s) - printed).abs() < 1e-13,
                    "{tau_cr} {tau_cd} {s}"
                );
            }
        }
    }

    #[test]
    fn neighbouring_time_constants_approach_the_limit() {
        for s in [-3.0, 0.0, 5.0, 130.0, 700.0] {
            let after = f64::max(s, 0.0);
            let limit = 0.15 + 0.45 * after / 130.0 * (1.0 - after / 130.0).exp();
            for gap in [0.0, 1e-13, 1e-10, 1e-8, 1e-6, 1e-3] {
                let near = rice(130.0 * (1.0 + gap), 130.0 * (1.0 - gap), s);
                assert!(
                    (near - limit).abs() < 1e-14 + 100.0 * gap * gap,
                    "{gap} {s}"
                );
                assert_eq!(
                    near,
                    rice(130.0 * (1.0 - gap), 130.0 * (1.0 + gap), s),
                    "exchanged"
                );
            }
        }
    }
}
