//! Stress against the slope of the energy, tangent against the slope of the stress, both by dual numbers (exact).

use proptest::prelude::*;

use super::tensor::{Sym, at, contract, determinant};
use super::*;
use crate::number::Dual;

const KAPPA: f64 = 350.0;

fn tissue(law: Law, form: VolumetricLaw, active: Option<ActiveLaw>) -> Tissue {
    Tissue {
        law,
        volumetric: Volumetric {
            law: form,
            kappa_kpa: KAPPA,
        },
        active,
        density: 1.06,
    }
}

fn laws() -> [Law; 3] {
    [
        Law::Guccione(Guccione::guccione1995(0.876)),
        Law::HolzapfelOgden(HolzapfelOgden::arostica2025()),
        Law::NeoHookean(NeoHookean { mu_kpa: 26.66 }),
    ]
}

/// An active tension that grows with stretch, as in a cell.
fn tension<R: Real>(lambda: R) -> (R, R) {
    (
        lambda.times(40.0) - lambda.like(10.0) + lambda * lambda,
        lambda.like(40.0) + lambda.times(2.0),
    )
}

fn stress<R: Real, const T: bool>(tissue: &Tissue, c: &Sym<R>) -> Response<R> {
    let j = determinant(c).sqrt();
    let (p, q) = tissue.volumetric.law.slopes(j);
    let (active, active_slope) = tension(c[0].sqrt());
    let load = Load {
        pressure: p.times(KAPPA),
        bulk: q.times(KAPPA),
        active,
        active_slope,
    };
    respond::<R, T>(tissue, c, j, &load)
}

fn energy(tissue: &Tissue, c: &Sym<Dual>) -> Dual {
    let j = determinant(c).sqrt();
    tissue.law.energy(c, j) + tissue.volumetric.law.energy(j).times(KAPPA)
}

/// `C + ε·direction`, the direction in engineering strain of component `k`: δE_k = 1 or 2 δE₁₂ = 1.
fn along(c: &Sym<f64>, k: usize) -> Sym<Dual> {
    std::array::from_fn(|i| Dual {
        value: c[i],
        slope: if i == k {
            if k < 3 { 2.0 } else { 1.0 }
        } else {
            0.0
        },
    })
}

fn strain() -> impl Strategy<Value = Sym<f64>> {
    let entry = || -0.25..0.25;
    [
        entry(),
        entry(),
        entry(),
        entry(),
        entry(),
        entry(),
        entry(),
        entry(),
        entry(),
    ]
    .prop_map(|h| {
        let f = nalgebra::Matrix3::identity() + nalgebra::Matrix3::from_row_slice(&h);
        let c: nalgebra::Matrix3<f64> = f.transpose() * f;
        [
            c[(0, 0)],
            c[(1, 1)],
            c[(2, 2)],
            c[(0, 1)],
            c[(0, 2)],
            c[(1, 2)],
        ]
    })
}

fn near(got: f64, want: f64, scale: f64) -> bool {
    (got - want).abs() <= 1e-11 * scale.max(1.0)
}

proptest! {
    #[test]
    fn stress_is_the_slope_of_the_energy(c in strain()) {
        prop_assume!(determinant(&c) > 0.1);
        for law in laws() {
            for form in [VolumetricLaw::LnSquared, VolumetricLaw::Quadratic, VolumetricLaw::QuadraticLn] {
                let tissue = tissue(law, form, None);
                let s = stress::<f64, false>(&tissue, &c).s;
                let scale = s.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                for k in 0..6 {
                    let slope = energy(&tissue, &along(&c, k)).slope;
                    prop_assert!(near(s[k], slope, scale), "{law:?} {form:?} component {k}: {} for {slope}", s[k]);
                }
            }
        }
    }

    #[test]
    fn tangent_is_the_slope_of_the_stress(c in strain()) {
        prop_assume!(determinant(&c) > 0.1);
        for law in laws() {
            for convention in
                [ActiveConvention::SecondPiola, ActiveConvention::FirstPiola, ActiveConvention::PerSquaredStretch]
            {
                let tissue = tissue(law, VolumetricLaw::LnSquared, Some(ActiveLaw { convention, cross_fibre: 0.0, sheet_normal: 0.0 }));
                let d = stress::<f64, true>(&tissue, &c).d;
                let scale = d.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                for k in 0..6 {
                    let slope = stress::<Dual, false>(&tissue, &along(&c, k)).s;
                    for i in 0..6 {
                        prop_assert!(
                            near(d[at(i, k)], slope[i].slope, scale),
                            "{law:?} {convention:?} entry {i} {k}: {} for {}", d[at(i, k)], slope[i].slope
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn cross_fibre_share_leaves_its_coupling_out_of_the_tangent() {
    let c = [1.1, 0.95, 1.02, 0.03, -0.02, 0.05];
    let law = laws()[0];
    let make = |cross_fibre| {
        tissue(
            law,
            VolumetricLaw::LnSquared,
            Some(ActiveLaw {
                convention: ActiveConvention::FirstPiola,
                cross_fibre,
                sheet_normal: 0.0,
            }),
        )
    };
    let with = make(0.4);
    let d = stress::<f64, true>(&with, &c).d;
    let slope = |k: usize, i: usize| stress::<Dual, false>(&with, &along(&c, k)).s[i].slope;
    assert!(near(d[at(1, 1)], slope(1, 1), 1e3));
    // The fibre stress is independent of the sheet stretch; the reverse coupling is omitted.
    assert!(near(d[at(0, 1)], slope(1, 0), 1e3) && slope(0, 1) != slope(1, 0));
    let (ta, _) = tension(c[0].sqrt());
    let more = stress::<f64, false>(&with, &c).s[1] - stress::<f64, false>(&make(0.0), &c).s[1];
    assert!(near(more, 0.4 * ta / c[1].sqrt(), 1.0));
}

#[test]
fn every_parameter_of_every_law_moves_the_stress() {
    let c = [1.15, 0.93, 1.04, 0.06, -0.05, 0.08];
    let s = |law| stress::<f64, false>(&tissue(law, VolumetricLaw::LnSquared, None), &c).s;
    let g = Guccione::guccione1995(1.0);
    let h = HolzapfelOgden::arostica2025();
    let changed = [
        (
            Law::Guccione(g),
            Law::Guccione(Guccione { c_kpa: 1.1, ..g }),
        ),
        (Law::Guccione(g), Law::Guccione(Guccione { b_f: 19.0, ..g })),
        (Law::Guccione(g), Law::Guccione(Guccione { b_t: 4.0, ..g })),
        (Law::Guccione(g), Law::Guccione(Guccione { b_fs: 2.0, ..g })),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { a_kpa: 0.07, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { b: 9.0, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { a_f_kpa: 20.0, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { b_f: 17.0, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { a_s_kpa: 3.0, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { b_s: 12.0, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { a_fs_kpa: 0.3, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { b_fs: 20.0, ..h }),
        ),
        (
            Law::HolzapfelOgden(h),
            Law::HolzapfelOgden(HolzapfelOgden { switch: 20.0, ..h }),
        ),
        (
            Law::NeoHookean(NeoHookean { mu_kpa: 1.0 }),
            Law::NeoHookean(NeoHookean { mu_kpa: 1.1 }),
        ),
    ];
    for (before, after) in changed {
        let (a, b) = (s(before), s(after));
        assert!(
            a.iter().zip(b).any(|(x, y)| (x - y).abs() > 1e-6),
            "{before:?} {after:?}"
        );
    }
}

#[test]
fn rest_is_free_of_stress_and_linearises_to_the_shear_modulus() {
    let rest: Sym<f64> = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
    for law in laws() {
        let s = stress::<f64, false>(&tissue(law, VolumetricLaw::QuadraticLn, None), &rest).s;
        assert!(s.iter().all(|x| x.abs() < 1e-14), "{law:?}: {s:?}");
    }
    let neo = tissue(
        Law::NeoHookean(NeoHookean { mu_kpa: 3.0 }),
        VolumetricLaw::Quadratic,
        None,
    );
    let d = stress::<f64, true>(&neo, &rest).d;
    assert!(near(d[at(3, 3)], 3.0, 1.0));
    assert!(near(d[at(0, 0)], KAPPA + 4.0 / 3.0 * 3.0, 1.0));
    assert!(near(contract(&rest, &rest), 3.0, 1.0));
}

#[test]
fn a_parameter_out_of_range_is_named() {
    let bad = tissue(
        Law::Guccione(Guccione::guccione1995(-1.0)),
        VolumetricLaw::Quadratic,
        None,
    );
    assert_eq!(
        bad.check().expect_err("negative stiffness").to_string(),
        "material parameter C_kPa = -1 must be positive and finite"
    );
}
