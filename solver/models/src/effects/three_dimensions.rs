//! Transfer of effects to a finite-element ventricle, as each declares it ([`InThreeDimensions`]).

use super::assembly::{add_to_circulation, circuit};
use super::declaration::{Action, InThreeDimensions, OneFibreParts};
use super::{EffectError, EffectSetting, Surroundings};
use crate::circulation::{Circulation, ClosedLoop};
use crate::ventricle::{ActivationGroups, CavityPressureTerm, GroupContraction, OneFibrePassive};

/// A part of the wall with late activation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatePart {
    /// Delay of the activation \[ms\].
    pub delay_ms: f64,
    /// Share of the wall, on the side opposite the septum.
    pub share: f64,
}

/// Viscous stress along the fibre, `η dλ/dt`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FibreViscosity {
    /// η while the fibre lengthens \[kPa ms\].
    pub lengthening_kpa_ms: f64,
    /// η while it shortens \[kPa ms\].
    pub shortening_kpa_ms: f64,
}

/// Parts of a finite-element ventricle with effects, except for the mesh.
#[derive(Debug)]
pub struct InThreeDimensionsParts {
    /// Circulation in its initial state.
    pub circulation: Circulation,
    /// Contraction model of all points.
    pub contraction: GroupContraction,
    /// Additional terms of the cavity pressure.
    pub pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    /// Late part of the wall, if any.
    pub late: Option<LatePart>,
    /// Factor of all exponents of the passive law. The scale of the law must be fitted with it.
    pub exponent_factor: f64,
    /// Active stress across the fibre, in the plane of the wall, over active stress along the fibre.
    pub cross_fibre_share: f64,
    /// Viscous stress along the fibre, if any.
    pub viscosity: Option<FibreViscosity>,
}

/// Circulation, contraction and wall of a finite-element ventricle with any effects.
///
/// - `closed`: the loop around the left heart; `None` for the open circuit
/// - `reference`: a one-fibre ventricle with the same end-diastolic and wall volumes, which effects
///   use
///
/// # Errors
/// [`EffectError::NotInThreeDimensions`] with the reason, and the errors of [`super::assemble`].
pub fn in_three_dimensions(
    (surroundings, closed): (&Surroundings, Option<&ClosedLoop>),
    reference: OneFibrePassive,
    contraction: GroupContraction,
    effects: &[EffectSetting],
) -> Result<InThreeDimensionsParts, EffectError> {
    let mut circulation = circuit(&surroundings.heart, closed, effects)?;
    add_to_circulation(&mut circulation, surroundings, effects)?;
    let groups = ActivationGroups::new(vec![surroundings.onset.0], vec![1.0])?;
    let mut parts = OneFibreParts {
        passive: reference,
        groups,
        contraction,
        pressure_terms: Vec::new(),
    };
    let (mut late, mut exponent_factor, mut cross_fibre_share, mut viscosity) =
        (None, 1.0, 0.0, None);
    for setting in effects.iter().filter(|setting| !setting.is_off()) {
        let (effect, values) = (setting.effect, &setting.values);
        let refused = |why| {
            Err(EffectError::NotInThreeDimensions {
                effect: effect.name,
                why,
            })
        };
        match (effect.in_3d, effect.name, &effect.action) {
            (InThreeDimensions::AsItIs, _, Action::Wall(change)) => {
                parts = change(values, surroundings, parts)?
            }
            (InThreeDimensions::AsItIs, ..) => {}
            (InThreeDimensions::PassiveExponents { .. }, ..) => exponent_factor *= values[0],
            (InThreeDimensions::ActivationMap { .. }, "dyssynchrony", _) => {
                late = Some(LatePart {
                    delay_ms: values[0],
                    share: values[1],
                });
            }
            (InThreeDimensions::MaterialTerm { .. }, "cross_fibre_stress", _) => {
                cross_fibre_share = values[0]
            }
            (InThreeDimensions::MaterialTerm { .. }, "viscoelasticity", _) => {
                viscosity = Some(fibre_viscosity(values[0], values[1], &reference));
            }
            (InThreeDimensions::Cannot { why }, ..) => return refused(why),
            _ => return refused("the finite-element ventricle does not know how to take it over"),
        }
    }
    let OneFibreParts {
        contraction,
        pressure_terms,
        ..
    } = parts;
    Ok(InThreeDimensionsParts {
        circulation,
        contraction,
        pressure_terms,
        late,
        exponent_factor,
        cross_fibre_share,
        viscosity,
    })
}

/// Viscosity of the wall that corresponds to the viscous cavity pressure of the one-fibre
/// ventricle, as declared by `viscoelasticity`: η_w = 9 η (V_ref + V_w/3)/ln(1 + V_w/V_ref).
fn fibre_viscosity(
    mmhg_s_per_ml: f64,
    shortening_share: f64,
    reference: &OneFibrePassive,
) -> FibreViscosity {
    let (volume, wall) = (reference.end_diastolic_volume_ml, reference.wall_volume_ml);
    // Conversion from mmHg s to kPa ms.
    let eta = 1e3 * mmhg_s_per_ml / cardiotwin_units::MMHG_PER_KPA;
    let lengthening_kpa_ms = 9.0 * eta * (volume + wall / 3.0) / (wall / volume).ln_1p();
    FibreViscosity {
        lengthening_kpa_ms,
        shortening_kpa_ms: shortening_share * lengthening_kpa_ms,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CATALOGUE, Kind};
    use super::*;
    use crate::ventricle::PassiveLaw as _;

    use crate::circulation::LeftHeart;
    use crate::contraction::{Tanh, TanhParameters};
    use cardiotwin_units::{Ml, Mmhg, Ms};

    fn surroundings() -> Surroundings {
        let heart = LeftHeart::of_an_adult(Mmhg(7.0), Ms(800.0));
        Surroundings {
            heart,
            onset: Ms(5.0),
        }
    }

    fn parts(effects: &[EffectSetting]) -> Result<InThreeDimensionsParts, EffectError> {
        let law =
            OneFibrePassive::through(Ml(70.0), Ml(120.0), Mmhg(9.0), Ml(100.0), 9.24).unwrap();
        let contraction = GroupContraction::tanh(Tanh::new(TanhParameters::default()).unwrap());
        in_three_dimensions((&surroundings(), None), law, contraction, effects)
    }

    #[test]
    fn every_effect_of_the_heart_acts_or_says_why_not() {
        let base = parts(&[]).unwrap();
        let circuit = |p: &InThreeDimensionsParts| format!("{:?}", p.circulation);
        let rest = |p: &InThreeDimensionsParts| {
            let InThreeDimensionsParts {
                contraction,
                pressure_terms,
                late,
                viscosity,
                ..
            } = p;
            format!(
                "{contraction:?}{pressure_terms:?}{late:?}{viscosity:?}{}{}",
                p.exponent_factor, p.cross_fibre_share
            )
        };
        for effect in CATALOGUE
            .into_iter()
            .filter(|effect| effect.kind == Kind::Physiology)
        {
            match parts(&[EffectSetting::typical(effect)]) {
                Ok(with) => {
                    let changed = (circuit(&with) != circuit(&base), rest(&with) != rest(&base));
                    let expected = matches!(effect.action, Action::Circulation(_));
                    assert_eq!(changed, (expected, !expected), "{}", effect.name);
                }
                Err(EffectError::NotInThreeDimensions { why, .. }) => {
                    assert!(
                        matches!(effect.in_3d, InThreeDimensions::Cannot { .. }) && !why.is_empty()
                    );
                }
                Err(other) => panic!("{}: {other}", effect.name),
            }
        }
    }

    #[test]
    fn viscosity_gives_the_pressure_that_the_one_fibre_ventricle_adds() {
        let law =
            OneFibrePassive::through(Ml(70.0), Ml(120.0), Mmhg(9.0), Ml(100.0), 9.24).unwrap();
        let eta = fibre_viscosity(0.02, 0.5, &law);
        assert_eq!(eta.shortening_kpa_ms, 0.5 * eta.lengthening_kpa_ms);
        // dλ/dt at λ = 1 for a flow of 100 mL/s, and the pressure of the resulting fibre stress.
        let rate_per_ms = 0.1 / (3.0 * (120.0 + 100.0 / 3.0));
        let pressure = eta.lengthening_kpa_ms * rate_per_ms * (100.0_f64 / 120.0).ln_1p() / 3.0;
        assert!(
            (pressure * cardiotwin_units::MMHG_PER_KPA - 2.0).abs() < 1e-9,
            "{pressure}"
        );
    }
}
