//! The passive laws: what each one has to say, and the enum over all of them.
//!
//! A further law is one file that implements [`PassiveLaw`] for its constants, and one line in `laws!`.
//!
//! Step 0 fits a law to a patient by two factors, one of all moduli and one of all exponents:
//!
//! | law | moduli | exponents |
//! |---|---|---|
//! | Guccione | `C` | `b_f`, `b_t`, `b_fs` |
//! | Holzapfel–Ogden | `a`, `a_f`, `a_s`, `a_fs`, represented by `a` | `b`, `b_f`, `b_s`, `b_fs`, but not the switch |
//! | neo-Hookean | `µ` | none |
//!
//! The energy is proportional to the moduli, and the exponents multiply strains inside the exponential function. The first
//! factor thus scales all stress at a given strain, and the second sets how soon the law stiffens.

use cardiotwin_vocabulary::passive_law::{Guccione, HolzapfelOgden, NeoHookean};

use super::tensor::Sym;
use super::{MaterialError, Response};
use crate::number::Real;

/// A passive law, with its constants as `self`.
pub trait PassiveLaw: Copy {
    /// Name of the law.
    const NAME: &'static str;

    /// Checks the range of every constant.
    fn check(&self) -> Result<(), MaterialError>;

    /// Energy density \[kPa\] of the isochoric right Cauchy–Green tensor.
    fn isochoric_energy<R: Real>(&self, cbar: &Sym<R>) -> R;

    /// Adds stress `∂W/∂Ē` and, with `TANGENT`, tangent of the isochoric part.
    fn add_isochoric<R: Real, const TANGENT: bool>(&self, cbar: &Sym<R>, out: &mut Response<R>);

    /// Energy density \[kPa\] of the part in the full right Cauchy–Green tensor; `None` if the law has no such part.
    fn fibre_energy<R: Real>(&self, _c: &Sym<R>) -> Option<R> {
        None
    }

    /// Adds stress and, with `TANGENT`, tangent of the part in the full right Cauchy–Green tensor.
    #[inline(always)]
    fn add_fibres<R: Real, const TANGENT: bool>(&self, _c: &Sym<R>, _out: &mut Response<R>) {}

    /// The modulus that represents the stiffness \[kPa\].
    fn stiffness_kpa(&self) -> f64;

    /// Replaces the stiffness \[kPa\] and scales all moduli in proportion.
    #[must_use]
    fn with_stiffness(self, kpa: f64) -> Self;

    /// The exponent that represents all exponents; `None` for a law without exponents.
    fn exponent(&self) -> Option<f64> {
        None
    }

    /// Multiplies all exponents by `factor`.
    #[must_use]
    fn with_exponents_times(self, _factor: f64) -> Self {
        self
    }
}

macro_rules! laws {
    ($($(#[doc = $doc:literal])* $law:ident;)*) => {
        /// A passive law of tissue.
        #[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
        pub enum Law {
            $($(#[doc = $doc])* $law($law),)*
        }

        impl Law {
            pub(super) fn check(&self) -> Result<(), MaterialError> {
                match self { $(Self::$law(law) => law.check(),)* }
            }

            pub(super) fn isochoric_energy<R: Real>(&self, cbar: &Sym<R>) -> R {
                match self { $(Self::$law(law) => law.isochoric_energy(cbar),)* }
            }

            pub(super) fn fibre_energy<R: Real>(&self, c: &Sym<R>) -> Option<R> {
                match self { $(Self::$law(law) => law.fibre_energy(c),)* }
            }

            #[inline(always)]
            pub(super) fn add_isochoric<R: Real, const TANGENT: bool>(
                &self,
                cbar: &Sym<R>,
                out: &mut Response<R>,
            ) {
                match self { $(Self::$law(law) => law.add_isochoric::<R, TANGENT>(cbar, out),)* }
            }

            #[inline(always)]
            pub(super) fn add_fibres<R: Real, const TANGENT: bool>(
                &self,
                c: &Sym<R>,
                out: &mut Response<R>,
            ) {
                match self { $(Self::$law(law) => law.add_fibres::<R, TANGENT>(c, out),)* }
            }

            /// The modulus that represents the stiffness \[kPa\].
            #[must_use]
            pub fn stiffness_kpa(&self) -> f64 {
                match self { $(Self::$law(law) => law.stiffness_kpa(),)* }
            }

            /// Replaces the stiffness \[kPa\] and scales all moduli in proportion.
            #[must_use]
            pub fn with_stiffness(self, kpa: f64) -> Self {
                match self { $(Self::$law(law) => Self::$law(law.with_stiffness(kpa)),)* }
            }

            /// Multiplies all exponents by `factor`.
            #[must_use]
            pub fn with_exponents_times(self, factor: f64) -> Self {
                match self { $(Self::$law(law) => Self::$law(law.with_exponents_times(factor)),)* }
            }

            /// The exponent that represents all exponents; `None` for a law without exponents.
            #[must_use]
            pub fn exponent(&self) -> Option<f64> {
                match self { $(Self::$law(law) => law.exponent(),)* }
            }

            /// Name of the law.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self { $(Self::$law(_) => <$law as PassiveLaw>::NAME,)* }
            }
        }
    };
}

laws! {
    /// Guccione's exponential, transversely isotropic law (1995).
    Guccione;
    /// Holzapfel and Ogden's orthotropic law (2009).
    HolzapfelOgden;
    /// The isotropic neo-Hookean law.
    NeoHookean;
}

impl Law {
    /// Multiplies all moduli by `stiffness` and all exponents by `exponents`.
    #[must_use]
    pub fn scaled(self, stiffness: f64, exponents: f64) -> Self {
        self.with_stiffness(self.stiffness_kpa() * stiffness)
            .with_exponents_times(exponents)
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
