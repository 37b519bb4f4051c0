//! Conversion of the settings of wall, elements and equations to solver types. `crate::benchmark`
//! also takes its laws, elements and time integration from here, so that it verifies the
//! computations of a cohort.

use cardiotwin_mechanics::dynamics::Rayleigh;
use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::material::{ActiveLaw, Guccione, Law, NeoHookean};
use cardiotwin_mechanics::newton;
use cardiotwin_mechanics::organ::{self, PassiveTissue, Spring, SprungSurface, WallParameters};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_schemas::finite_element::{
    ElementKind, EquationSettings, LinearSolver, WallSettings,
};
use cardiotwin_schemas::muscle::{ActiveConvention, MuscleLaw};

/// Parameters of the wall, with all exponents multiplied by a factor and an additional share of the
/// active stress across the fibre.
#[must_use]
pub fn parameters(wall: &WallSettings, exponent_factor: f64, cross_fibre: f64) -> WallParameters {
    WallParameters {
        muscle: muscle(wall).scaled(1.0, exponent_factor),
        muscle_kappa_kpa: wall.kappa_kpa,
        active: ActiveLaw {
            // The sheet normal lies across the fibre in the plane of the wall. Stress along the sheet would resist the wall's
            // thickening instead.
            sheet_normal: wall.sheet_normal_share + cross_fibre,
            ..active(wall.active_convention, wall.cross_fibre_share)
        },
        epicardial_duration: wall.epicardial_duration_share,
        passive_mu_kpa: wall.aorta_mu_kpa,
        passive_kappa_kpa: wall.aorta_kappa_kpa,
        passive_of_tags: (wall.passive.iter())
            .map(|(tag, of)| PassiveTissue {
                tag: *tag,
                mu_kpa: of.mu_kpa,
                kappa_kpa: of.kappa_kpa,
            })
            .collect(),
        // Converts g/mm³ to mg/mm³.
        density: 1e3 * wall.density_g_per_mm3,
        pericardium: Spring {
            stiffness: wall.epicardial_spring_kpa_per_mm,
            damping: wall.epicardial_dashpot_kpa_ms_per_mm,
        },
        pericardial_base_share: wall.epicardial_base_share,
        rim: Spring {
            stiffness: wall.rim_spring_kpa_per_mm,
            damping: wall.rim_dashpot_kpa_ms_per_mm,
        },
        damping: Rayleigh {
            mass_per_ms: wall.mass_damping_per_ms,
            stiffness_ms: wall.stiffness_damping_ms,
        },
        spectral_radius: wall.spectral_radius,
        surfaces: (wall.surface.iter())
            .map(|(name, of)| SprungSurface {
                name: name.clone(),
                spring: Spring {
                    stiffness: of.spring_kpa_per_mm,
                    damping: of.dashpot_kpa_ms_per_mm,
                },
            })
            .collect(),
        ..WallParameters::default()
    }
}

/// The muscle's passive law.
#[must_use]
pub fn muscle(wall: &WallSettings) -> Law {
    match wall.muscle_law {
        MuscleLaw::Guccione => Law::Guccione(Guccione {
            c_kpa: wall.guccione_c_kpa,
            b_f: wall.b_f,
            b_t: wall.b_t,
            b_fs: wall.b_fs,
        }),
        MuscleLaw::HolzapfelOgden => Law::HolzapfelOgden(wall.holzapfel_ogden),
        MuscleLaw::NeoHookean => Law::NeoHookean(NeoHookean {
            mu_kpa: wall.neo_hookean_mu_kpa,
        }),
    }
}

/// The settings with the constants of `law`; [`muscle`] makes that law of them.
#[must_use]
pub fn with_muscle(wall: &WallSettings, law: Law) -> WallSettings {
    let mut wall = wall.clone();
    match law {
        Law::Guccione(Guccione {
            c_kpa,
            b_f,
            b_t,
            b_fs,
        }) => {
            wall.muscle_law = MuscleLaw::Guccione;
            (wall.guccione_c_kpa, wall.b_f, wall.b_t, wall.b_fs) = (c_kpa, b_f, b_t, b_fs);
        }
        Law::HolzapfelOgden(constants) => {
            wall.muscle_law = MuscleLaw::HolzapfelOgden;
            wall.holzapfel_ogden = constants;
        }
        Law::NeoHookean(NeoHookean { mu_kpa }) => {
            wall.muscle_law = MuscleLaw::NeoHookean;
            wall.neo_hookean_mu_kpa = mu_kpa;
        }
    }
    wall
}

/// Settings with another stiffness of their law and unchanged exponents.
#[must_use]
pub fn with_stiffness(wall: &WallSettings, kpa: f64) -> WallSettings {
    with_muscle(wall, muscle(wall).with_stiffness(kpa))
}

/// Action of the active stress.
#[must_use]
pub fn active(convention: ActiveConvention, cross_fibre: f64) -> ActiveLaw {
    ActiveLaw {
        convention,
        cross_fibre,
        sheet_normal: 0.0,
    }
}

/// Kind of finite elements in the solver.
///
/// - `pointwise_share`: [`WallSettings::pointwise_share`]
#[must_use]
pub fn element(kind: ElementKind, pointwise_share: Option<f64>) -> organ::ElementKind {
    let kind = match kind {
        ElementKind::LinearNodal => organ::ElementKind::LINEAR_NODAL,
        ElementKind::LinearPointwise => organ::ElementKind::LINEAR_POINTWISE,
        ElementKind::QuadraticNodal => organ::ElementKind::QUADRATIC_NODAL,
    };
    match (kind.volume, pointwise_share) {
        (VolumeChange::Nodal { .. }, Some(pointwise_share)) => organ::ElementKind {
            volume: VolumeChange::Nodal { pointwise_share },
            ..kind
        },
        _ => kind,
    }
}

/// Linear solver of the time steps.
#[must_use]
pub fn linear_solver(kind: LinearSolver) -> newton::LinearSolver {
    match kind {
        LinearSolver::RigidLevels => newton::LinearSolver::RigidLevels,
        LinearSolver::BlockJacobi => newton::LinearSolver::BlockJacobi,
        LinearSolver::SymmetricSweep => newton::LinearSolver::SymmetricSweep,
        LinearSolver::Direct => newton::LinearSolver::Direct,
    }
}

/// Settings of the solver for the equations of a time step.
#[must_use]
pub fn steps(equations: &EquationSettings, newton_iterations: u32) -> StepSettings {
    let EquationSettings {
        tolerance,
        newton,
        linear_solver: linear,
        ..
    } = *equations;
    StepSettings {
        relative_tolerance: tolerance,
        max_iterations: newton_iterations as usize,
        max_halvings: newton.halvings as usize,
        smallest_volume_ratio: newton.smallest_volume_ratio,
        farthest_mm: if newton.farthest_mm > 0.0 {
            newton.farthest_mm
        } else {
            f64::INFINITY
        },
        linear: linear_solver(linear),
        ..StepSettings::default()
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::finite_element::{
        FiniteElementSettings, NewtonSettings, SurfaceSpring,
    };
    use cardiotwin_schemas::muscle::{HolzapfelOgden, PassiveTissueSettings};

    use super::*;

    #[test]
    fn default_settings_are_the_solvers_defaults() {
        let settings = WallSettings {
            guccione_c_kpa: 1.0,
            ..WallSettings::default()
        };
        assert_eq!(parameters(&settings, 1.0, 0.0), WallParameters::default());
        assert_eq!(
            element(ElementKind::default(), None),
            organ::ElementKind::default()
        );
        let defaults = FiniteElementSettings::default();
        assert_eq!(
            steps(&defaults.equations(), defaults.newton_iterations),
            StepSettings::default()
        );
        let ogden = WallSettings {
            muscle_law: MuscleLaw::HolzapfelOgden,
            ..WallSettings::default()
        };
        assert_eq!(
            muscle(&ogden),
            Law::HolzapfelOgden(HolzapfelOgden::arostica2025())
        );
    }

    #[test]
    fn a_cohort_chooses_the_share_of_elements_that_have_one() {
        let of = |kind| element(kind, Some(0.05)).volume;
        let nodal = VolumeChange::Nodal {
            pointwise_share: 0.05,
        };
        assert_eq!(
            (
                of(ElementKind::LinearNodal),
                of(ElementKind::QuadraticNodal)
            ),
            (nodal, nodal)
        );
        assert_eq!(of(ElementKind::LinearPointwise), VolumeChange::Pointwise);
        assert_eq!(
            element(ElementKind::QuadraticNodal, None),
            organ::ElementKind::QUADRATIC_NODAL
        );
    }

    #[test]
    fn every_setting_of_the_wall_reaches_the_solver() {
        let plain = WallSettings::default();
        let sprung = |spring_kpa_per_mm, dashpot_kpa_ms_per_mm| SurfaceSpring {
            spring_kpa_per_mm,
            dashpot_kpa_ms_per_mm,
        };
        let made = |change: &dyn Fn(&mut WallSettings)| {
            let mut wall = plain.clone();
            change(&mut wall);
            parameters(&wall, 1.0, 0.0)
        };
        let of_ogden = |change: fn(&mut HolzapfelOgden)| {
            made(&move |wall| {
                wall.muscle_law = MuscleLaw::HolzapfelOgden;
                change(&mut wall.holzapfel_ogden);
            })
        };
        let all = [
            made(&|_| {}),
            made(&|wall| wall.guccione_c_kpa *= 2.0),
            made(&|wall| wall.b_f *= 2.0),
            made(&|wall| wall.b_t *= 2.0),
            made(&|wall| wall.b_fs *= 2.0),
            of_ogden(|_| {}),
            of_ogden(|law| law.a_kpa *= 2.0),
            of_ogden(|law| law.b *= 2.0),
            of_ogden(|law| law.a_f_kpa *= 2.0),
            of_ogden(|law| law.b_f *= 2.0),
            of_ogden(|law| law.a_s_kpa *= 2.0),
            of_ogden(|law| law.b_s *= 2.0),
            of_ogden(|law| law.a_fs_kpa *= 2.0),
            of_ogden(|law| law.b_fs *= 2.0),
            of_ogden(|law| law.switch *= 2.0),
            made(&|wall| wall.muscle_law = MuscleLaw::NeoHookean),
            made(&|wall| (wall.muscle_law, wall.neo_hookean_mu_kpa) = (MuscleLaw::NeoHookean, 7.0)),
            made(&|wall| wall.kappa_kpa *= 2.0),
            made(&|wall| wall.active_convention = ActiveConvention::FirstPiola),
            made(&|wall| wall.active_convention = ActiveConvention::SecondPiola),
            made(&|wall| wall.cross_fibre_share = 0.2),
            made(&|wall| wall.aorta_mu_kpa *= 2.0),
            made(&|wall| wall.aorta_kappa_kpa *= 2.0),
            made(&|wall| {
                wall.passive.insert(
                    7,
                    PassiveTissueSettings {
                        mu_kpa: 3.0,
                        kappa_kpa: 300.0,
                    },
                );
            }),
            made(&|wall| wall.density_g_per_mm3 *= 2.0),
            made(&|wall| wall.mass_damping_per_ms *= 2.0),
            made(&|wall| wall.stiffness_damping_ms *= 2.0),
            made(&|wall| wall.epicardial_spring_kpa_per_mm *= 2.0),
            made(&|wall| wall.rim_spring_kpa_per_mm *= 2.0),
            made(&|wall| wall.spectral_radius = 0.5),
            made(&|wall| _ = wall.surface.insert("lung".to_owned(), sprung(2.0, 0.0))),
            made(&|wall| _ = wall.surface.insert("lung".to_owned(), sprung(0.0, 2.0))),
            made(&|wall| _ = wall.surface.insert("liver".to_owned(), sprung(2.0, 0.0))),
        ];
        for (k, one) in all.iter().enumerate() {
            assert!(
                all[..k].iter().all(|other| other != one),
                "change {k} is lost, or another's: {one:?}"
            );
        }
        let shares = WallSettings {
            cross_fibre_share: 0.1,
            sheet_normal_share: 0.2,
            ..plain
        };
        let active = parameters(&shares, 1.0, 0.3).active;
        assert_eq!((active.cross_fibre, active.sheet_normal), (0.1, 0.5));
    }

    #[test]
    fn every_setting_of_the_equations_reaches_the_solver() {
        let plain = FiniteElementSettings::default().equations();
        let newton = |newton| steps(&EquationSettings { newton, ..plain }, 12);
        let defaults = NewtonSettings::default();
        let all = [
            steps(&plain, 12),
            steps(&plain, 20),
            steps(
                &EquationSettings {
                    tolerance: 1e-5,
                    ..plain
                },
                12,
            ),
            steps(
                &EquationSettings {
                    linear_solver: LinearSolver::Direct,
                    ..plain
                },
                12,
            ),
            newton(NewtonSettings {
                halvings: 8,
                ..defaults
            }),
            newton(NewtonSettings {
                smallest_volume_ratio: 0.2,
                ..defaults
            }),
            newton(NewtonSettings {
                farthest_mm: 1.0,
                ..defaults
            }),
        ];
        for (k, one) in all.iter().enumerate() {
            assert!(
                all[..k].iter().all(|other| other != one),
                "change {k} is lost, or another's: {one:?}"
            );
        }
    }

    #[test]
    fn constants_of_a_law_come_back_from_its_settings() {
        for muscle_law in [
            MuscleLaw::Guccione,
            MuscleLaw::HolzapfelOgden,
            MuscleLaw::NeoHookean,
        ] {
            let settings = WallSettings {
                muscle_law,
                ..WallSettings::default()
            };
            let law = muscle(&settings).scaled(0.7, 1.3);
            assert_eq!(muscle(&with_muscle(&WallSettings::default(), law)), law);
            assert!((muscle(&with_stiffness(&settings, 0.3)).stiffness_kpa() - 0.3).abs() < 1e-15);
        }
    }
}
