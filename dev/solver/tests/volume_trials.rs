//! Patch test of the ways to resist a change of volume that are compared in `docs/decisions/0005-linear-elements.md`.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_mechanics::material::{
    Guccione, Law, NeoHookean, Tissue, Volumetric, VolumetricLaw,
};
use verification::meshes::cuboid;
use verification::problems::Problem;
use verification::volume_trials::{Trial, homogeneous};

/// A unit cube of `n` cells an axis whose inner nodes lie anyhow.
fn irregular(n: usize, law: Law) -> Problem {
    let wave = |x: [f64; 3], i: usize| {
        (7.0 * x[i] + 5.0 * x[(i + 1) % 3] - 11.0 * x[(i + 2) % 3] + i as f64).sin()
    };
    let inside = |x: [f64; 3]| {
        x.iter()
            .map(|x| 4.0 * x * (1.0 - x))
            .product::<f64>()
            .powf(0.5)
    };
    let mesh = cuboid([n; 3], |x| {
        std::array::from_fn(|i| x[i] + 0.25 / n as f64 * inside(x) * wave(x, i))
    });
    Problem {
        mesh,
        middle: Box::new(|_, _| None),
        frame: Box::new(|_, _| [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]),
        tissue: Tissue {
            law,
            volumetric: Volumetric {
                law: VolumetricLaw::LnSquared,
                kappa_kpa: 1000.0,
            },
            active: None,
            density: 1.0,
        },
        pressure: (0, 0.0),
        fixed: Box::new(|x| [x.iter().any(|x| x.abs() < 1e-12 || (x - 1.0).abs() < 1e-12); 3]),
        active_kpa: 0.0,
        about: [0.0; 3],
        first_step: 1.0,
        copies: 1.0,
        grid: None,
    }
}

#[test]
fn a_homogeneous_deformation_is_an_equilibrium_on_an_irregular_mesh() {
    let f = [[1.15, 0.08, -0.03], [0.02, 0.93, 0.05], [-0.04, 0.06, 0.98]];
    let guccione = Law::Guccione(Guccione {
        c_kpa: 2.0,
        b_f: 8.0,
        b_t: 2.0,
        b_fs: 4.0,
    });
    for law in [guccione, Law::NeoHookean(NeoHookean { mu_kpa: 1.0 })] {
        let problem = irregular(4, law);
        for trial in [
            Trial::Nodal { share: 0.0 },
            Trial::Nodal { share: 0.01 },
            Trial::Projected { modulus_kpa: 1.0 },
            Trial::Projected { modulus_kpa: 20.0 },
            Trial::Patch {
                elements: 8,
                share: 0.0,
            },
            Trial::Patch {
                elements: 8,
                share: 0.01,
            },
        ] {
            let found = homogeneous(&problem, trial, f);
            // The forces inside over those on the surface, and how far from it Newton's method ends that begins next to it.
            assert!(found.force_inside < 1e-12, "{law:?}, {trial:?}: {found:?}");
            assert!(found.distance_mm < 1e-9, "{law:?}, {trial:?}: {found:?}");
        }
    }
}
