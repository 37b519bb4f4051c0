//! Scale factors of stiffness and exponents, by which a law is fitted to a patient.
//!
//! | law | stiffness | exponents |
//! |---|---|---|
//! | Guccione | `C` | `b_f`, `b_t`, `b_fs` |
//! | Holzapfel–Ogden | `a`, `a_f`, `a_s`, `a_fs`, represented by `a` | `b`, `b_f`, `b_s`, `b_fs`, but not the switch |
//! | neo-Hookean | `µ` | none |
//!
//! The energy is proportional to the stiffness, and the exponents multiply strains inside the exponential function. The first
//! factor thus scales all stress at a given strain, and the second sets how soon the law stiffens.

use super::{Guccione, HolzapfelOgden, Law, NeoHookean};

impl Law {
    /// The modulus that represents the stiffness \[kPa\].
    #[must_use]
    pub fn stiffness_kpa(&self) -> f64 {
        match self {
            Self::Guccione(law) => law.c_kpa,
            Self::HolzapfelOgden(law) => law.a_kpa,
            Self::NeoHookean(law) => law.mu_kpa,
        }
    }

    /// Replaces the stiffness \[kPa\] and scales all moduli in proportion.
    #[must_use]
    pub fn with_stiffness(self, kpa: f64) -> Self {
        match self {
            Self::Guccione(law) => Self::Guccione(Guccione { c_kpa: kpa, ..law }),
            Self::HolzapfelOgden(law) => {
                let factor = kpa / law.a_kpa;
                let [a_f_kpa, a_s_kpa, a_fs_kpa] =
                    [law.a_f_kpa, law.a_s_kpa, law.a_fs_kpa].map(|a| factor * a);
                Self::HolzapfelOgden(HolzapfelOgden {
                    a_kpa: kpa,
                    a_f_kpa,
                    a_s_kpa,
                    a_fs_kpa,
                    ..law
                })
            }
            Self::NeoHookean(_) => Self::NeoHookean(NeoHookean { mu_kpa: kpa }),
        }
    }

    /// Multiplies all moduli by `stiffness` and all exponents by `exponents`.
    #[must_use]
    pub fn scaled(self, stiffness: f64, exponents: f64) -> Self {
        match self.with_stiffness(self.stiffness_kpa() * stiffness) {
            Self::Guccione(law) => {
                let [b_f, b_t, b_fs] = [law.b_f, law.b_t, law.b_fs].map(|b| b * exponents);
                Self::Guccione(Guccione {
                    b_f,
                    b_t,
                    b_fs,
                    ..law
                })
            }
            Self::HolzapfelOgden(law) => {
                let [b, b_f, b_s, b_fs] =
                    [law.b, law.b_f, law.b_s, law.b_fs].map(|b| b * exponents);
                Self::HolzapfelOgden(HolzapfelOgden {
                    b,
                    b_f,
                    b_s,
                    b_fs,
                    ..law
                })
            }
            Self::NeoHookean(law) => Self::NeoHookean(law),
        }
    }

    /// The exponent that represents all exponents; `None` for a law without exponents.
    #[must_use]
    pub fn exponent(&self) -> Option<f64> {
        match self {
            Self::Guccione(law) => Some(law.b_f),
            Self::HolzapfelOgden(law) => Some(law.b_f),
            Self::NeoHookean(_) => None,
        }
    }

    /// Name of the law.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Guccione(_) => "Guccione",
            Self::HolzapfelOgden(_) => "Holzapfel-Ogden",
            Self::NeoHookean(_) => "neo-Hookean",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const C: [f64; 6] = [1.12, 0.94, 1.03, 0.05, -0.02, 0.03];

    fn laws() -> [Law; 3] {
        [
            Law::Guccione(Guccione::guccione1995(0.9)),
            Law::HolzapfelOgden(HolzapfelOgden::arostica2025()),
            Law::NeoHookean(NeoHookean { mu_kpa: 4.0 }),
        ]
    }

    fn energy(law: Law) -> f64 {
        law.energy(&C, super::super::tensor::determinant(&C).sqrt())
    }

    #[test]
    fn energy_is_proportional_to_stiffness() {
        for law in laws() {
            let twice = law.scaled(2.5, 1.0);
            assert!(
                (energy(twice) / energy(law) - 2.5).abs() < 1e-12,
                "{}",
                law.name()
            );
            assert_eq!(twice, law.with_stiffness(2.5 * law.stiffness_kpa()));
            assert_eq!(twice.exponent(), law.exponent());
        }
    }

    #[test]
    fn exponents_multiply_strain_energy_under_the_exponential() {
        // At small strain an exponential law becomes quadratic: Guccione's energy then grows with the exponents, Holzapfel and
        // Ogden's, divided by them, does not.
        let small = [1.002, 0.999, 1.0, 1e-4, 0.0, 0.0];
        let at =
            |law: Law, c: &[f64; 6]| law.energy(c, super::super::tensor::determinant(c).sqrt());
        let [guccione, ogden, neo] = laws();
        assert!((at(guccione.scaled(1.0, 1.5), &small) / at(guccione, &small) - 1.5).abs() < 1e-3);
        assert!((at(ogden.scaled(1.0, 1.5), &small) / at(ogden, &small) - 1.0).abs() < 1e-3);
        assert!(energy(ogden.scaled(1.0, 1.5)) > 1.05 * energy(ogden));
        assert_eq!(neo.scaled(1.0, 1.5), neo);
        assert_eq!(
            ogden.scaled(1.0, 1.5).exponent(),
            ogden.exponent().map(|b| b * 1.5)
        );
    }
}
