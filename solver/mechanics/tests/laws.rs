//! Laws of muscle and of passive tissue by tag: step 0 with each.

mod support;

use cardiotwin_mechanics::material::{HolzapfelOgden, Law, NeoHookean};
use cardiotwin_mechanics::organ::passive_fit::{fit, stiffened};
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, Fitted, PassiveFit, PassiveState, PassiveStateError, PassiveTissue,
    Piece, Search, UnloadingSettings, WallParameters,
};
use cardiotwin_mesh::tags;
use support::{MUSCLE, heart};

/// Diastasis and end-diastole of a heart of 112 mL, and what it holds without pressure.
const THREE_POINTS: PassiveFit = PassiveFit::ThreePoints {
    image_pressure_kpa: 0.8,
    end_diastolic_pressure_kpa: 1.6,
    end_diastolic_volume_mm3: 126e3,
    unloaded_volume_mm3: 70e3,
};

fn anatomy() -> Anatomy {
    Anatomy::of(&heart().0, &MUSCLE, ElementKind::LINEAR_NODAL).expect("an anatomy")
}

fn search() -> Search<'static> {
    Search::new(UnloadingSettings::default())
}

#[test]
fn holzapfel_and_ogdens_law_meets_three_points_and_is_steepened() {
    let anatomy = anatomy();
    let start = Law::HolzapfelOgden(HolzapfelOgden::arostica2025());
    let wall = WallParameters {
        muscle: start,
        ..WallParameters::default()
    };
    let fitted = fit(
        &Piece::whole(&anatomy),
        &wall,
        &THREE_POINTS,
        None,
        &mut search(),
    )
    .expect("a law through three points");
    let Fitted { state, wall, .. } = &fitted;
    assert!(
        (state.volume_mm3() / 126e3 - 1.0).abs() < 1e-3,
        "{} mm³",
        state.volume_mm3()
    );
    assert!(
        (state.unloaded_volume_mm3() / 70e3 - 1.0).abs() < 0.01,
        "{} mm³",
        state.unloaded_volume_mm3()
    );
    // All moduli by one factor, all exponents by another.
    let (Law::HolzapfelOgden(found), Law::HolzapfelOgden(first)) = (wall.muscle, start) else {
        panic!("another law")
    };
    let (moduli, exponents) = (found.a_kpa / first.a_kpa, found.b / first.b);
    for (found, first, factor) in [
        (found.a_f_kpa, first.a_f_kpa, moduli),
        (found.a_s_kpa, first.a_s_kpa, moduli),
        (found.a_fs_kpa, first.a_fs_kpa, moduli),
        (found.b_f, first.b_f, exponents),
        (found.b_s, first.b_s, exponents),
        (found.b_fs, first.b_fs, exponents),
        (found.switch, first.switch, 1.0),
    ] {
        assert!(
            (found / first / factor - 1.0).abs() < 1e-12,
            "{found} of {first}, factor {factor}"
        );
    }
    assert!(
        (moduli - 1.0).abs() > 0.05 && (exponents - 1.0).abs() > 0.01,
        "{moduli} {exponents}"
    );
    let Fitted { state: steeper, .. } =
        stiffened(&Piece::whole(&anatomy), &fitted, 1.3, &mut search()).expect("a steeper law");
    assert!(
        (steeper.volume_mm3() / state.volume_mm3() - 1.0).abs() < 1e-3,
        "{} mm³",
        steeper.volume_mm3()
    );
}

#[test]
fn a_neo_hookean_law_meets_one_volume_and_says_why_it_cannot_meet_two() {
    let anatomy = anatomy();
    let muscle = Law::NeoHookean(NeoHookean { mu_kpa: 5.0 });
    let wall = WallParameters {
        muscle,
        ..WallParameters::default()
    };
    let refused = fit(
        &Piece::whole(&anatomy),
        &wall,
        &THREE_POINTS,
        None,
        &mut search(),
    )
    .err();
    assert_eq!(
        refused,
        Some(PassiveStateError::NoExponents { law: "neo-Hookean" })
    );
    let klotz = PassiveFit::Unloaded {
        end_diastolic_pressure_kpa: 1.6,
        unloaded_volume_mm3: 90e3,
    };
    let fitted =
        fit(&Piece::whole(&anatomy), &wall, &klotz, None, &mut search()).expect("a stiffness");
    assert!(
        (fitted.state.unloaded_volume_mm3() / 90e3 - 1.0).abs() < 2e-3,
        "{}",
        fitted.state.unloaded_volume_mm3()
    );
    let refused = stiffened(&Piece::whole(&anatomy), &fitted, 1.3, &mut search()).err();
    assert_eq!(
        refused,
        Some(PassiveStateError::NoExponents { law: "neo-Hookean" })
    );
}

#[test]
fn passive_tissue_of_a_tag_has_its_own_moduli() {
    let anatomy = anatomy();
    let volume = |passive_of_tags| {
        let wall = WallParameters {
            passive_of_tags,
            ..WallParameters::default()
        };
        let mut state =
            PassiveState::unloaded_image(&Piece::whole(&anatomy), &wall).expect("a wall");
        state.inflate(1.2, &mut search()).expect("inflates");
        state.volume_mm3()
    };
    let WallParameters {
        passive_mu_kpa,
        passive_kappa_kpa,
        ..
    } = WallParameters::default();
    let of = |tag, mu_kpa| {
        vec![PassiveTissue {
            tag,
            mu_kpa,
            kappa_kpa: passive_kappa_kpa,
        }]
    };
    let plain = volume(vec![]);
    assert_eq!(
        volume(of(tags::AORTIC_ROOT, passive_mu_kpa)),
        plain,
        "the same moduli by tag"
    );
    assert!(
        volume(of(tags::AORTIC_ROOT, 1.0)) > plain + 100.0,
        "a soft root gives way"
    );
    // A tag of muscle, or of nothing, names no passive tissue.
    assert_eq!(volume(of(tags::LEFT_VENTRICLE, 1.0)), plain);
    assert_eq!(volume(of(99, 1.0)), plain);
}
