//! Passive state ("step 0") of the one-fibre ventricle: the unloaded volume and the passive fibre
//! law (SPEC sections 3, 4).
//!
//! Geometry: Arts 1991, `p = σ_f/3 · ln(1 + V_wall/V)`,
//! `λ = ((V + V_wall/3)/(V_ref + V_wall/3))^(1/3)`.

use super::VentricleError;
use crate::roots::increasing_root;
use cardiotwin_units::{Kpa, Ml, Mmhg, Ms, Stretch};
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::one_fibre::OneFibrePassive;

/// Exponent without a diastasis point: half of Guccione's b_f of 18.48, because E enters linearly
/// rather than squared.
pub const DEFAULT_EXPONENT: f64 = 18.48 / 2.0;
/// Range in which the exponent is fitted.
const EXPONENT_RANGE: (f64, f64) = (0.5, 80.0);

/// Conversion of fibre stress \[kPa\] to cavity pressure \[kPa\], per unit of stress (Arts 1991),
/// and its derivative with respect to the volume.
#[inline]
pub(crate) fn pressure_per_stress(volume_ml: f64, wall_ml: f64) -> (f64, f64) {
    (
        (wall_ml / volume_ml).ln_1p() / 3.0,
        -wall_ml / (3.0 * volume_ml * (volume_ml + wall_ml)),
    )
}

/// Fibre stretch from a reference volume, and its derivative with respect to the volume.
#[inline]
pub(crate) fn stretch(volume_ml: f64, reference_ml: f64, wall_ml: f64) -> (f64, f64) {
    let now = volume_ml + wall_ml / 3.0;
    // `cbrt` is avoided: its correctly rounded version costs three times as much, and a few ulp do
    // not matter here.
    let lambda = ((now / (reference_ml + wall_ml / 3.0)).ln() / 3.0).exp();
    (lambda, lambda / (3.0 * now))
}

/// Pressure and volume at the time of the whole-heart image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DiastasisPoint {
    /// Volume of the image.
    pub volume: Ml,
    /// Measured pressure at the time of the image.
    pub pressure: Mmhg,
}

/// State from which the beat starts (`start` in a patient file).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PassiveStateMode {
    /// The beat starts from the measured end-diastolic volume at end-diastolic pressure.
    #[default]
    EndDiastole,
    /// The beat starts as in the paper, where the image volume is taken as that at end-diastolic
    /// pressure.
    Diastasis,
}

/// Data to which the passive state is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassiveStateInput {
    /// Cavity volume that was measured at end-diastole.
    pub end_diastolic_volume: Ml,
    /// Cavity pressure that was measured at end-diastole.
    pub end_diastolic_pressure: Mmhg,
    /// Diastasis point, if known.
    pub diastasis: Option<DiastasisPoint>,
    /// Volume of the wall, constant in all states.
    pub wall_volume: Ml,
    /// State from which the beat starts.
    pub mode: PassiveStateMode,
}

pub use cardiotwin_signals::image::klotz_unloaded_volume;

/// Passive fibre law σ_p = s (e^{b E} − 1) with E = (λ_p² − 1)/2 and λ_p from the unloaded volume.
pub trait PassiveLaw: Sized {
    /// Fits the law through (V0, 0) and the loaded state, and through the diastasis point if
    /// possible (a volume between V0 and EDV at a pressure that the law can have there). Otherwise
    /// the exponent is the default. The second value tells whether the exponent was fitted.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] if a volume or pressure is not positive, or a diastasis start
    /// lacks a diastasis volume; [`VentricleError::PassiveState`] if V0 is not between zero and the
    /// loaded volume.
    fn fit(input: &PassiveStateInput) -> Result<(Self, bool), VentricleError>;

    /// The law with a given exponent, through (unloaded volume, 0) and a pressure at the reference
    /// volume.
    ///
    /// # Errors
    /// [`VentricleError::PassiveState`] unless 0 < unloaded < reference volume and the pressure is
    /// positive; [`VentricleError::Parameter`] if the wall volume or the exponent is not positive.
    fn through(
        unloaded: Ml,
        reference: Ml,
        pressure: Mmhg,
        wall: Ml,
        exponent: f64,
    ) -> Result<Self, VentricleError>;

    /// Passive pressure at a volume.
    fn pressure(&self, volume: Ml) -> Mmhg;

    /// Stretch for the active stress at a volume; one at end-diastole.
    fn active_stretch(&self, volume: Ml) -> Stretch;
}

impl PassiveLaw for OneFibrePassive {
    fn fit(input: &PassiveStateInput) -> Result<(Self, bool), VentricleError> {
        let (volume, diastasis) = match (input.mode, input.diastasis) {
            (PassiveStateMode::EndDiastole, point) => (input.end_diastolic_volume, point),
            (PassiveStateMode::Diastasis, Some(point)) => (point.volume, None),
            (PassiveStateMode::Diastasis, None) => {
                let expected = "given when the beat starts from diastasis";
                return Err(VentricleError::Parameter {
                    name: "diastasis volume",
                    value: f64::NAN,
                    expected,
                });
            }
        };
        let pressure = input.end_diastolic_pressure;
        for (name, value) in [
            ("end-diastolic volume", volume.0),
            ("end-diastolic pressure", pressure.0),
            ("wall volume", input.wall_volume.0),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(VentricleError::Parameter {
                    name,
                    value,
                    expected: "positive",
                });
            }
        }
        let unloaded = klotz_unloaded_volume(volume, pressure);
        if !(unloaded.0 > 0.0 && unloaded.0 < volume.0) {
            let (v0_ml, volume_ml, pressure_mmhg) = (unloaded.0, volume.0, pressure.0);
            return Err(VentricleError::PassiveState {
                v0_ml,
                volume_ml,
                pressure_mmhg,
            });
        }
        let mut law = Self {
            wall_volume_ml: input.wall_volume.0,
            unloaded_volume_ml: unloaded.0,
            end_diastolic_volume_ml: volume.0,
            end_diastolic_pressure_mmhg: pressure.0,
            stiffness_kpa: 0.0,
            exponent: DEFAULT_EXPONENT,
        };
        let fitted = diastasis.and_then(|point| exponent_through(&law, pressure, point));
        law.exponent = fitted.unwrap_or(DEFAULT_EXPONENT);
        law.stiffness_kpa = stiffness_for(&law, pressure);
        Ok((law, fitted.is_some()))
    }

    fn through(
        unloaded: Ml,
        reference: Ml,
        pressure: Mmhg,
        wall: Ml,
        exponent: f64,
    ) -> Result<Self, VentricleError> {
        if !(unloaded.0 > 0.0
            && unloaded.0 < reference.0
            && reference.0.is_finite()
            && pressure.0 > 0.0)
        {
            let (v0_ml, volume_ml, pressure_mmhg) = (unloaded.0, reference.0, pressure.0);
            return Err(VentricleError::PassiveState {
                v0_ml,
                volume_ml,
                pressure_mmhg,
            });
        }
        for (name, value) in [("wall volume", wall.0), ("passive exponent", exponent)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(VentricleError::Parameter {
                    name,
                    value,
                    expected: "positive",
                });
            }
        }
        let mut law = Self {
            wall_volume_ml: wall.0,
            unloaded_volume_ml: unloaded.0,
            end_diastolic_volume_ml: reference.0,
            end_diastolic_pressure_mmhg: pressure.0,
            stiffness_kpa: 0.0,
            exponent,
        };
        law.stiffness_kpa = stiffness_for(&law, pressure);
        Ok(law)
    }

    fn pressure(&self, volume: Ml) -> Mmhg {
        Kpa(stress_at(self, volume.0).0 * pressure_per_stress(volume.0, self.wall_volume_ml).0)
            .into()
    }

    fn active_stretch(&self, volume: Ml) -> Stretch {
        Stretch(stretch(volume.0, self.end_diastolic_volume_ml, self.wall_volume_ml).0)
    }
}

/// Strain E at a volume.
fn strain(law: &OneFibrePassive, volume_ml: f64) -> f64 {
    let lambda = stretch(volume_ml, law.unloaded_volume_ml, law.wall_volume_ml).0;
    0.5 * (lambda * lambda - 1.0)
}

/// Stiffness \[kPa\] at which the law passes through the loaded state.
fn stiffness_for(law: &OneFibrePassive, pressure: Mmhg) -> f64 {
    let volume = law.end_diastolic_volume_ml;
    let stress = Kpa::from(pressure).0 / pressure_per_stress(volume, law.wall_volume_ml).0;
    stress / (law.exponent * strain(law, volume)).exp_m1()
}

/// Exponent at which the law also passes through the diastasis point; `None` if no exponent in
/// the range does.
fn exponent_through(law: &OneFibrePassive, loaded: Mmhg, point: DiastasisPoint) -> Option<f64> {
    let inside =
        point.volume.0 > law.unloaded_volume_ml && point.volume.0 < law.end_diastolic_volume_ml;
    if !(inside && point.pressure.0 > 0.0 && point.pressure.0 < loaded.0) {
        return None;
    }
    // A larger exponent lowers the pressure at the smaller volume.
    let (near, far) = (
        strain(law, point.volume.0),
        strain(law, law.end_diastolic_volume_ml),
    );
    let wall = law.wall_volume_ml;
    let wanted = Kpa::from(point.pressure).0 / pressure_per_stress(point.volume.0, wall).0;
    let stress = Kpa::from(loaded).0 / pressure_per_stress(law.end_diastolic_volume_ml, wall).0;
    let (low, high) = EXPONENT_RANGE;
    increasing_root(low, high, DEFAULT_EXPONENT, 1e-10, |b| {
        let (e, el) = ((b * near).exp_m1(), (b * far).exp_m1());
        let ratio = e / el;
        let slope = ratio * (near * (e + 1.0) / e - far * (el + 1.0) / el);
        (wanted - stress * ratio, -stress * slope)
    })
    .ok()
}

/// Passive fibre stress \[kPa\] at a volume, and its derivative with respect to the volume.
#[inline]
pub(crate) fn stress_at(law: &OneFibrePassive, volume_ml: f64) -> (f64, f64) {
    let (lambda, dlambda) = stretch(volume_ml, law.unloaded_volume_ml, law.wall_volume_ml);
    stress_at_stretch(law, lambda, dlambda)
}

/// Ratio of the stretch from the unloaded volume to the stretch from end-diastole.
pub(crate) fn stretch_ratio(law: &OneFibrePassive) -> f64 {
    stretch(
        law.end_diastolic_volume_ml,
        law.unloaded_volume_ml,
        law.wall_volume_ml,
    )
    .0
}

/// As [`stress_at`], from the stretch λ_p and its derivative with respect to the volume.
#[inline]
pub(crate) fn stress_at_stretch(law: &OneFibrePassive, lambda: f64, dlambda: f64) -> (f64, f64) {
    // The exponent is limited, as everywhere here: an extreme candidate gives a large stress,
    // not an infinite one.
    let exponential = (law.exponent * 0.5 * (lambda * lambda - 1.0))
        .min(200.0)
        .exp();
    (
        law.stiffness_kpa * (exponential - 1.0),
        law.stiffness_kpa * law.exponent * exponential * lambda * dlambda,
    )
}

/// Pressure of a sampled trace at a time, by linear interpolation and constant beyond the ends. It
/// gives the pressure at diastasis.
///
/// - `time_ms`, `pressure_mmhg`: samples of equal number, increasing in time; `None` if empty or
///   unequal
#[must_use]
pub fn pressure_at(time_ms: &[f64], pressure_mmhg: &[f64], time: Ms) -> Option<Mmhg> {
    if time_ms.is_empty() || time_ms.len() != pressure_mmhg.len() {
        return None;
    }
    let next = time_ms.partition_point(|t| *t <= time.0);
    if next == 0 {
        return Some(Mmhg(pressure_mmhg[0]));
    }
    if next == time_ms.len() {
        return Some(Mmhg(pressure_mmhg[next - 1]));
    }
    let share = (time.0 - time_ms[next - 1]) / (time_ms[next] - time_ms[next - 1]);
    Some(Mmhg(
        pressure_mmhg[next - 1] + share * (pressure_mmhg[next] - pressure_mmhg[next - 1]),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn input(diastasis: Option<DiastasisPoint>) -> PassiveStateInput {
        PassiveStateInput {
            end_diastolic_volume: Ml(161.0),
            end_diastolic_pressure: Mmhg(7.0),
            diastasis,
            wall_volume: Ml(121.0),
            mode: PassiveStateMode::EndDiastole,
        }
    }

    #[test]
    fn passes_through_its_points() {
        let point = DiastasisPoint {
            volume: Ml(138.0),
            pressure: Mmhg(4.2),
        };
        for diastasis in [None, Some(point)] {
            let (law, fitted) = OneFibrePassive::fit(&input(diastasis)).unwrap();
            assert!(law.pressure(Ml(law.unloaded_volume_ml)).0.abs() < 1e-12);
            assert!((law.pressure(Ml(161.0)).0 - 7.0).abs() < 1e-10);
            assert_eq!(fitted, diastasis.is_some());
            assert!((law.active_stretch(Ml(161.0)).0 - 1.0).abs() < 1e-15);
            if diastasis.is_some() {
                assert!((law.pressure(Ml(138.0)).0 - 4.2).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn an_impossible_diastasis_point_leaves_the_default_exponent() {
        for (volume, pressure) in [(170.0, 5.0), (138.0, 8.0), (138.0, -1.0), (50.0, 3.0)] {
            let point = DiastasisPoint {
                volume: Ml(volume),
                pressure: Mmhg(pressure),
            };
            let (law, fitted) = OneFibrePassive::fit(&input(Some(point))).unwrap();
            assert!(!fitted && law.exponent == DEFAULT_EXPONENT);
        }
    }

    #[test]
    fn diastasis_start_takes_the_image_volume_as_loaded() {
        let point = DiastasisPoint {
            volume: Ml(138.0),
            pressure: Mmhg(4.2),
        };
        let (law, _) = OneFibrePassive::fit(&PassiveStateInput {
            mode: PassiveStateMode::Diastasis,
            ..input(Some(point))
        })
        .unwrap();
        assert_eq!(law.end_diastolic_volume_ml, 138.0);
        assert!((law.pressure(Ml(138.0)).0 - 7.0).abs() < 1e-10);
        assert!(
            OneFibrePassive::fit(&PassiveStateInput {
                mode: PassiveStateMode::Diastasis,
                ..input(None)
            })
            .is_err()
        );
    }

    #[test]
    fn refuses_nonsense() {
        let bad = PassiveStateInput {
            end_diastolic_pressure: Mmhg(-2.0),
            ..input(None)
        };
        assert!(matches!(
            OneFibrePassive::fit(&bad),
            Err(VentricleError::Parameter { .. })
        ));
        let bad = PassiveStateInput {
            end_diastolic_pressure: Mmhg(120.0),
            ..input(None)
        };
        assert!(matches!(
            OneFibrePassive::fit(&bad),
            Err(VentricleError::PassiveState { .. })
        ));
    }

    #[test]
    fn pressure_at_interpolates_and_holds() {
        let (t, p) = ([0.0, 10.0, 20.0], [5.0, 7.0, 6.0]);
        let at = |time| pressure_at(&t, &p, Ms(time)).unwrap().0;
        assert_eq!(
            (at(-1.0), at(5.0), at(10.0), at(99.0)),
            (5.0, 6.0, 7.0, 6.0)
        );
        assert_eq!(pressure_at(&[], &[], Ms(1.0)), None);
    }

    proptest! {
        #[test]
        fn slopes_are_slopes(volume in 30.0..250.0f64, wall in 50.0..200.0f64) {
            let (law, _) = OneFibrePassive::fit(&PassiveStateInput { wall_volume: Ml(wall), ..input(None) }).unwrap();
            let h = 1e-4;
            let check = |f: &dyn Fn(f64) -> (f64, f64)| {
                let slope = (f(volume + h).0 - f(volume - h).0) / (2.0 * h);
                assert!((slope - f(volume).1).abs() < 1e-6 * (1e-3 + slope.abs()));
            };
            check(&|v| stress_at(&law, v));
            check(&|v| pressure_per_stress(v, wall));
            check(&|v| stretch(v, 150.0, wall));
        }
    }
}
