//! The organ's law: pressure and mean fibre stretch of a three-dimensional ventricle as smooth
//! functions of its cavity volume V and the mean active stress T of its wall.
//!
//! A wall without memory of its own has one pressure and one mean stretch at a volume and a mean
//! stress, whichever contraction model made the stress. The law is the one-fibre ventricle
//! (Arts 1991) with a correction that is linear in its coefficients, so that regression learns it
//! from beats of the organ:
//!
//! ```text
//! P = y [σ₁(V) + x (1 − x/x_ED)(p₁ + p₂ x) + T (a₀ + a₁ x + a₂ x² + b₀ T/T_N) + T₁ s(T; T₁)(c₀ + c₁ x)]
//! Λ = L(V) + q₁ x + q₂ x² + s(T; T_L)(m₀ + m₁ x + m₂ x²) + m₃ M/(T + T_D)
//! x = ln(V/V0)      y = ln(1 + V_wall/V)/3      s(T; τ) = T/(T + τ)
//! ```
//!
//! σ₁ and L are the passive fibre stress and the stretch of the one-fibre ventricle, Λ the mean
//! stretch from the unloaded wall. Groups of cells that carry more stress than the mean shorten
//! against the others:
//!
//! ```text
//! λ_g = λ(V, T) + ξ_g [D(V, T) − k M/(T + T_D)] − κ (T_g − T − ξ_g M)/(T + T_c)
//! D = d₁ x + d₂ x² + s(T; T_L)(e₀ + e₁ x + e₂ x²)      M = Σ w_g ξ_g T_g
//! ```
//!
//! The stretch differs from place to place, mostly along one pattern: fibres that are long at
//! end-diastole stay long until the wall relaxes. D is its standard deviation over the wall, and the
//! groups stand for its two halves, ξ = ±1. Fibres with more stress than their surroundings shorten
//! the pattern (k).
//!
//! Pfaller et al. 2020 (Int J Numer Methods Biomed Eng 36:e3320) reduce a ventricle by projection,
//! Regazzoni and Quarteroni 2021 (Comput Methods Appl Mech Eng 381:113812) learn a time-varying
//! elastance; here the contraction model stays outside of the law, so that cells can be fitted in it.

use super::ActivationSpread;
use super::passive_state::{
    OneFibrePassive, pressure_per_stress, stress_at_stretch, stretch, stretch_ratio,
};
use cardiotwin_units::MMHG_PER_KPA;
use serde::{Deserialize, Serialize};

/// Number of coefficients of the pressure: p₁, p₂, a₀, a₁, a₂, b₀, c₀, c₁.
pub const N_PRESSURE: usize = 8;
/// Number of coefficients of the stretch: q₁, q₂, m₀, m₁, m₂, m₃.
pub const N_STRETCH: usize = 6;

/// Number of coefficients of the stretch's deviation: d₁, d₂, e₀, e₁, e₂, k.
pub const N_DEVIATION: usize = N_STRETCH;

/// Stress T_N of the quadratic term \[kPa\].
const QUADRATIC_KPA: f64 = 50.0;
/// Stress T₁ over which the onset of the active pressure saturates \[kPa\].
const ONSET_KPA: f64 = 5.0;
/// Stress T_L over which the redistribution of stretch saturates \[kPa\].
const REDISTRIBUTION_KPA: f64 = 30.0;
/// Stress T_c at which the compliance between groups has fallen to half of that at rest \[kPa\].
const COMPLIANCE_KPA: f64 = 5.0;

/// Stress T_D at which the response to differences of stress has fallen to half of that at rest
/// \[kPa\].
const DIFFERENCE_KPA: f64 = 20.0;
/// Number of terms in volume and stress that mean and deviation of the stretch share.
const N_TERMS: usize = 5;

/// Smallest x of the domain, and the largest one beyond end-diastole.
const DOMAIN_X: [f64; 2] = [-0.5, 0.2];
/// Largest mean stress of the domain \[kPa\].
const DOMAIN_KPA: f64 = 150.0;

/// Coefficients of the organ's law.
///
/// The polynomials hold between 60 % of the unloaded volume and 120 % of the end-diastolic one, and
/// up to a mean stress of 150 kPa. Beyond, they approach constants with a continuous slope, so that
/// the law stays bounded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OrganLaw {
    /// Coefficients of the pressure, dimensionless but for p₁, p₂ \[kPa\].
    pub pressure: [f64; N_PRESSURE],
    /// Coefficients of the mean stretch, dimensionless.
    pub stretch: [f64; N_STRETCH],
    /// Coefficients of the stretch's deviation over the wall, dimensionless.
    pub deviation: [f64; N_DEVIATION],
    /// Compliance κ between groups, dimensionless.
    pub compliance: f64,
    /// Duration of the contraction of the last group over that of the first one.
    pub duration_share: f64,
}

impl Default for OrganLaw {
    /// The one-fibre ventricle.
    fn default() -> Self {
        let mut pressure = [0.0; N_PRESSURE];
        pressure[2] = 1.0;
        Self {
            pressure,
            stretch: [0.0; N_STRETCH],
            deviation: [0.0; N_DEVIATION],
            compliance: 0.0,
            duration_share: 1.0,
        }
    }
}

/// A value with its derivatives with respect to volume and mean stress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawValue {
    /// Pressure \[mmHg\] or stretch.
    pub value: f64,
    /// Derivative with respect to the volume, per mL.
    pub per_ml: f64,
    /// Derivative with respect to the mean active stress, per kPa.
    pub per_kpa: f64,
}

/// A term of the law with its derivatives with respect to x and T.
type Term = [f64; 3];

/// Share of a domain's width over which an argument approaches its limit beyond it.
const MARGIN: f64 = 0.25;

/// Limits an argument smoothly: itself inside the domain, and a constant far outside. Returns the
/// derivative, too.
fn limited(x: f64, [low, high]: [f64; 2]) -> (f64, f64) {
    let width = MARGIN * (high - low);
    let beyond = |edge: f64| {
        let tanh = ((x - edge) / width).tanh();
        (edge + width * tanh, 1.0 - tanh * tanh)
    };
    if x > high {
        beyond(high)
    } else if x < low {
        beyond(low)
    } else {
        (x, 1.0)
    }
}

/// T/(T + τ) with its derivative; linear below zero.
fn saturating(stress_kpa: f64, over_kpa: f64) -> (f64, f64) {
    if stress_kpa < 0.0 {
        return (stress_kpa / over_kpa, 1.0 / over_kpa);
    }
    let sum = stress_kpa + over_kpa;
    (stress_kpa / sum, over_kpa / (sum * sum))
}

/// A cavity volume as the law sees it. All of the law's functions share these values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtVolume {
    /// x, limited to the domain, and its derivative per mL.
    x: f64,
    per_ml: f64,
    /// x at end-diastole.
    x_ed: f64,
    /// Stretch of the one-fibre ventricle from the unloaded wall, and its derivative per mL.
    one_fibre: (f64, f64),
    /// Passive fibre stress of the one-fibre ventricle \[kPa\], and its derivative per mL.
    passive: (f64, f64),
    /// Pressure per fibre stress, and its derivative per mL.
    factor: (f64, f64),
}

impl AtVolume {
    /// Values at a cavity volume \[mL\].
    #[must_use]
    pub fn new(passive: &OneFibrePassive, volume_ml: f64) -> Self {
        Self::with_end_diastole(passive, end_diastolic_x(passive), volume_ml)
    }

    /// The same, with x at end-diastole, which is the same for all volumes.
    pub(super) fn with_end_diastole(passive: &OneFibrePassive, x_ed: f64, volume_ml: f64) -> Self {
        let x = (volume_ml / passive.unloaded_volume_ml).ln();
        let (x, dx) = limited(x, [DOMAIN_X[0], x_ed + DOMAIN_X[1]]);
        let one_fibre = unloaded_stretch(passive, volume_ml);
        Self {
            x,
            per_ml: dx / volume_ml,
            x_ed,
            one_fibre,
            passive: stress_at_stretch(passive, one_fibre.0, one_fibre.1),
            factor: pressure_per_stress(volume_ml, passive.wall_volume_ml),
        }
    }
}

/// x at end-diastole.
pub(super) fn end_diastolic_x(passive: &OneFibrePassive) -> f64 {
    (passive.end_diastolic_volume_ml / passive.unloaded_volume_ml).ln()
}

/// Terms of the pressure \[kPa of fibre stress\].
#[inline]
fn pressure_terms(at: &AtVolume, stress_kpa: f64) -> [Term; N_PRESSURE] {
    let (x, x_ed, t) = (at.x, at.x_ed, stress_kpa);
    let (limited_t, dlimited) = limited(t, [0.0, DOMAIN_KPA]);
    let (onset, donset) = saturating(t, ONSET_KPA);
    let (onset, donset) = (ONSET_KPA * onset, ONSET_KPA * donset);
    [
        [x * (1.0 - x / x_ed), 1.0 - 2.0 * x / x_ed, 0.0],
        [x * x * (1.0 - x / x_ed), 2.0 * x - 3.0 * x * x / x_ed, 0.0],
        [t, 0.0, 1.0],
        [t * x, t, x],
        [t * x * x, 2.0 * t * x, x * x],
        [
            t * limited_t / QUADRATIC_KPA,
            0.0,
            (limited_t + t * dlimited) / QUADRATIC_KPA,
        ],
        [onset, 0.0, donset],
        [onset * x, onset, donset * x],
    ]
}

/// Terms of the stretch's mean and deviation without differences of stress.
#[inline]
fn stretch_terms(x: f64, stress_kpa: f64) -> [Term; N_TERMS] {
    let (s, ds) = saturating(stress_kpa, REDISTRIBUTION_KPA);
    [
        [x, 1.0, 0.0],
        [x * x, 2.0 * x, 0.0],
        [s, 0.0, ds],
        [s * x, s, ds * x],
        [s * x * x, 2.0 * s * x, ds * x * x],
    ]
}

#[inline]
fn sum<const N: usize>(coefficients: &[f64; N], terms: &[Term; N]) -> Term {
    let mut sum = [0.0; 3];
    for i in 0..N {
        for k in 0..3 {
            sum[k] += coefficients[i] * terms[i][k];
        }
    }
    sum
}

/// Sum of the terms in volume and stress; the last coefficient is of differences of stress.
fn stretch_sum(coefficients: &[f64; N_STRETCH], x: f64, stress_kpa: f64) -> Term {
    let of_terms = coefficients.first_chunk().expect("one more than terms");
    sum::<N_TERMS>(of_terms, &stretch_terms(x, stress_kpa))
}

/// Row of a regression for the stretch's mean or deviation.
fn difference_row(x: f64, stress_kpa: f64, difference: f64) -> [f64; N_STRETCH] {
    let terms = stretch_terms(x, stress_kpa);
    std::array::from_fn(|i| terms.get(i).map_or(difference, |[value, ..]| *value))
}

/// Stretch of the one-fibre ventricle from the unloaded wall, and its derivative per mL.
fn unloaded_stretch(passive: &OneFibrePassive, volume_ml: f64) -> (f64, f64) {
    stretch(
        volume_ml,
        passive.unloaded_volume_ml,
        passive.wall_volume_ml,
    )
}

/// Mean stretch at end-diastole from the unloaded wall: that of the law, or of the one-fibre ventricle.
#[must_use]
pub fn end_diastolic_stretch(passive: &OneFibrePassive, law: Option<&OrganLaw>) -> f64 {
    match law {
        Some(law) => law.end_diastolic_stretch(passive),
        None => stretch_ratio(passive),
    }
}

impl OrganLaw {
    /// Smallest and largest cavity volume \[mL\] for which the polynomials hold.
    #[must_use]
    pub fn domain_ml(passive: &OneFibrePassive) -> [f64; 2] {
        let [low, beyond] = DOMAIN_X.map(f64::exp);
        [
            passive.unloaded_volume_ml * low,
            passive.end_diastolic_volume_ml * beyond,
        ]
    }

    /// Cavity pressure \[mmHg\] at a cavity volume \[mL\] and a mean active stress \[kPa\].
    #[must_use]
    pub fn pressure(&self, passive: &OneFibrePassive, volume_ml: f64, stress_kpa: f64) -> LawValue {
        self.pressure_at(&AtVolume::new(passive, volume_ml), stress_kpa)
    }

    /// As [`Self::pressure`].
    #[must_use]
    pub fn pressure_at(&self, at: &AtVolume, stress_kpa: f64) -> LawValue {
        let [active, per_x, per_kpa] = sum(&self.pressure, &pressure_terms(at, stress_kpa));
        let (of_one_fibre, dof_one_fibre) = at.passive;
        let (factor, dfactor) = at.factor;
        let stress = of_one_fibre + active;
        LawValue {
            value: MMHG_PER_KPA * stress * factor,
            per_ml: MMHG_PER_KPA
                * (stress * dfactor + (dof_one_fibre + per_x * at.per_ml) * factor),
            per_kpa: MMHG_PER_KPA * factor * per_kpa,
        }
    }

    /// Mean fibre stretch from the unloaded wall at a cavity volume \[mL\] and a mean active stress
    /// \[kPa\], without differences of stress.
    #[must_use]
    pub fn stretch(&self, passive: &OneFibrePassive, volume_ml: f64, stress_kpa: f64) -> LawValue {
        self.stretch_at(&AtVolume::new(passive, volume_ml), stress_kpa)
    }

    /// As [`Self::stretch`].
    #[must_use]
    pub fn stretch_at(&self, at: &AtVolume, stress_kpa: f64) -> LawValue {
        let [correction, per_x, per_kpa] = stretch_sum(&self.stretch, at.x, stress_kpa);
        let (lambda, dlambda) = at.one_fibre;
        LawValue {
            value: lambda + correction,
            per_ml: dlambda + per_x * at.per_ml,
            per_kpa,
        }
    }

    /// Standard deviation D of the stretch over the wall, signed: positive where the pattern is that
    /// of the contracted wall. Stress differences of zero.
    #[must_use]
    pub fn deviation(
        &self,
        passive: &OneFibrePassive,
        volume_ml: f64,
        stress_kpa: f64,
    ) -> LawValue {
        self.deviation_at(&AtVolume::new(passive, volume_ml), stress_kpa)
    }

    /// As [`Self::deviation`].
    #[must_use]
    pub fn deviation_at(&self, at: &AtVolume, stress_kpa: f64) -> LawValue {
        let [value, per_x, per_kpa] = stretch_sum(&self.deviation, at.x, stress_kpa);
        LawValue {
            value,
            per_ml: per_x * at.per_ml,
            per_kpa,
        }
    }

    /// Fall of the stretch's deviation per stress that the long fibres carry beyond the short ones
    /// \[1/kPa\], at a mean stress \[kPa\].
    #[must_use]
    pub fn response_per_kpa(&self, stress_kpa: f64) -> f64 {
        self.deviation[N_TERMS] / (stress_kpa.max(0.0) + DIFFERENCE_KPA)
    }

    /// Rise of the mean stretch per stress that the long fibres carry beyond the short ones \[1/kPa\],
    /// at a mean stress \[kPa\].
    #[must_use]
    pub fn stretch_per_difference(&self, stress_kpa: f64) -> f64 {
        self.stretch[N_TERMS] / (stress_kpa.max(0.0) + DIFFERENCE_KPA)
    }

    /// Row of a linear regression for the stretch's deviation: the derivative with respect to each
    /// coefficient.
    ///
    /// - `stress_deviation_kpa`: M, the stress along the pattern of the stretch
    #[must_use]
    pub fn deviation_row(
        passive: &OneFibrePassive,
        volume_ml: f64,
        stress_kpa: f64,
        stress_deviation_kpa: f64,
    ) -> [f64; N_DEVIATION] {
        let at = AtVolume::new(passive, volume_ml);
        let difference = stress_deviation_kpa / (stress_kpa.max(0.0) + DIFFERENCE_KPA);
        difference_row(at.x, stress_kpa, -difference)
    }

    /// Mean stretch of the relaxed wall at end-diastole, from the unloaded wall.
    #[must_use]
    pub fn end_diastolic_stretch(&self, passive: &OneFibrePassive) -> f64 {
        self.stretch(passive, passive.end_diastolic_volume_ml, 0.0)
            .value
    }

    /// Change of a group's stretch per stress beyond the mean \[1/kPa\], at a mean stress \[kPa\].
    #[must_use]
    pub fn coupling_per_kpa(&self, stress_kpa: f64) -> f64 {
        self.compliance / (stress_kpa.max(0.0) + COMPLIANCE_KPA)
    }

    /// Duration of a group's contraction over the mean. Activation goes from the endocardium to the
    /// epicardium, where contraction lasts for another time.
    #[must_use]
    pub fn duration(&self, spread: &ActivationSpread, activation_ms: f64) -> f64 {
        let depth = if spread.spread.0 > 0.0 {
            ((activation_ms - spread.onset.0) / spread.spread.0).clamp(0.0, 1.0)
        } else {
            0.5
        };
        let longer = 2.0 * (self.duration_share - 1.0) / (self.duration_share + 1.0);
        1.0 + longer * (depth - 0.5)
    }

    /// Row of a linear regression for the pressure: the pressure without coefficients \[mmHg\], and
    /// the derivative with respect to each coefficient.
    #[must_use]
    pub fn pressure_row(
        passive: &OneFibrePassive,
        volume_ml: f64,
        stress_kpa: f64,
    ) -> (f64, [f64; N_PRESSURE]) {
        let at = AtVolume::new(passive, volume_ml);
        let factor = MMHG_PER_KPA * at.factor.0;
        let terms = pressure_terms(&at, stress_kpa);
        (
            factor * at.passive.0,
            terms.map(|[value, ..]| factor * value),
        )
    }

    /// Row of a linear regression for the mean stretch from the unloaded wall: the stretch without
    /// coefficients, and the derivative with respect to each coefficient.
    ///
    /// - `stress_deviation_kpa`: M, the stress along the pattern of the stretch
    #[must_use]
    pub fn stretch_row(
        passive: &OneFibrePassive,
        volume_ml: f64,
        stress_kpa: f64,
        stress_deviation_kpa: f64,
    ) -> (f64, [f64; N_STRETCH]) {
        let at = AtVolume::new(passive, volume_ml);
        let difference = stress_deviation_kpa / (stress_kpa.max(0.0) + DIFFERENCE_KPA);
        (at.one_fibre.0, difference_row(at.x, stress_kpa, difference))
    }

    /// Whether cells of any stiffness find one stress: where no cell may change its length, the mean
    /// stretch must fall with stress, also through the pattern that the stress changes.
    #[must_use]
    pub fn is_settled(&self, passive: &OneFibrePassive) -> bool {
        const POINTS: usize = 24;
        let of_pattern = if self.deviation[N_TERMS] > 0.0 {
            self.stretch[N_TERMS] / self.deviation[N_TERMS]
        } else {
            return self.stretch[N_TERMS] == 0.0;
        };
        let high =
            (passive.end_diastolic_volume_ml / passive.unloaded_volume_ml).ln() + DOMAIN_X[1];
        (0..=POINTS).all(|i| {
            let x = DOMAIN_X[0] + (high - DOMAIN_X[0]) * i as f64 / POINTS as f64;
            // All terms of the stress saturate alike, so that one stress speaks for all.
            let [_, _, of_mean] = stretch_sum(&self.stretch, x, 0.0);
            let [_, _, of_deviation] = stretch_sum(&self.deviation, x, 0.0);
            of_mean + of_pattern * of_deviation < 0.0
        })
    }

    /// Whether pressure increases with stress everywhere in the domain, and with volume in the
    /// relaxed wall from the unloaded volume on.
    #[must_use]
    pub fn is_monotone(&self, passive: &OneFibrePassive) -> bool {
        const POINTS: usize = 24;
        let high =
            (passive.end_diastolic_volume_ml / passive.unloaded_volume_ml).ln() + DOMAIN_X[1];
        let volume = |k: usize, from: f64| {
            let x = from + (high - from) * k as f64 / POINTS as f64;
            passive.unloaded_volume_ml * x.exp()
        };
        let stress = |k: usize| DOMAIN_KPA * k as f64 / POINTS as f64;
        let with_stress = (0..=POINTS).all(|i| {
            (0..=POINTS).all(|j| {
                let volume_ml = volume(i, DOMAIN_X[0]);
                self.pressure(passive, volume_ml, stress(j)).per_kpa > 0.0
            })
        });
        let with_volume =
            (0..=POINTS).all(|i| self.pressure(passive, volume(i, 0.0), 0.0).per_ml > 0.0);
        with_stress && with_volume
    }
}

#[cfg(test)]
#[path = "organ_law_tests.rs"]
mod tests;
