//! Static verification at sizes that a test can afford; `examples/verification.rs` shows the refinement.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_linalg::KrylovSettings;
use cardiotwin_linalg::Operator as _;
use cardiotwin_linalg::parallel::{Layout, SingleProcess, VectorLayout};
use cardiotwin_mechanics::body::{Body, BodyInput};
use cardiotwin_mechanics::boundary::{PressureSurface, Robin, RobinDirection};
use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::material::{Law, NeoHookean, Tissue, Volumetric, VolumetricLaw};
use cardiotwin_mechanics::newton::{LinearSolver, NewtonSettings};
use cardiotwin_mechanics::organ::ElementKind;
use cardiotwin_mechanics::statics::{LoadSteps, StaticProblem, load};
use verification::meshes::cuboid;
use verification::problems::{
    APEX_ENDO, APEX_EPI, BEAM_TIP, Element, P1, P1_NODAL, P2_NODAL, SPHERE, beam, compared,
    contraction, inflation, sphere,
};
use verification::sphere::{incompressible_pressure, inner_stretch};

/// Stretch of the inner surface at 0.212497356 kPa, of the incompressible sphere's closed form.
fn inner_stretch_over_exact(n: usize, layers: usize, element: Element) -> f64 {
    let solution = sphere(n, layers, 0.212_497_356, 1000.0).solve(element);
    solution.position([SPHERE[0], 0.0, 0.0])[0] / SPHERE[0] / 1.3
}

#[test]
fn thick_sphere_meets_its_closed_form_on_a_coarse_mesh() {
    let quadratic = inner_stretch_over_exact(4, 2, P2_NODAL);
    assert!((quadratic - 1.0).abs() < 0.01, "{quadratic}");
    let linear = inner_stretch_over_exact(8, 3, P1_NODAL);
    assert!((linear - 1.0).abs() < 0.01, "{linear}");
}

/// Errors of the inner stretch against the radial problem, and orders from each mesh to one of half its edges.
fn orders(element: Element, sizes: &[(usize, usize)]) -> (Vec<f64>, Vec<f64>) {
    let pressure = incompressible_pressure(1.3);
    let exact = inner_stretch(pressure, 100.0);
    let error = |(n, layers): &(usize, usize)| {
        let solution = sphere(*n, *layers, pressure, 100.0).solve(element);
        (solution.position([SPHERE[0], 0.0, 0.0])[0] / SPHERE[0] - exact).abs()
    };
    let errors: Vec<f64> = sizes.iter().map(error).collect();
    let orders = errors
        .windows(2)
        .map(|pair| (pair[0] / pair[1]).log2())
        .collect();
    (errors, orders)
}

#[test]
fn thick_sphere_converges_with_the_order_of_its_elements() {
    // At a hundred thousand times the shear modulus the radial problem is the incompressible closed form.
    assert!((inner_stretch(incompressible_pressure(1.3), 1e5) - 1.3).abs() < 1e-4);
    assert!((incompressible_pressure(1.3) - 0.212_497_356).abs() < 1e-9);
    let (errors, linear) = orders(P1_NODAL, &[(4, 2), (8, 4), (16, 8)]);
    println!("linear {errors:?} {linear:?}");
    assert!(
        linear.iter().all(|order| (1.5..2.6).contains(order)),
        "{errors:?} {linear:?}"
    );
    let (errors, quadratic) = orders(P2_NODAL, &[(2, 1), (4, 2), (8, 4)]);
    println!("quadratic {errors:?} {quadratic:?}");
    assert!(
        quadratic.iter().all(|order| *order > 2.7),
        "{errors:?} {quadratic:?}"
    );
}

/// The tangent is the residual's whole derivative, the follower pressure's unsymmetric part and the nodal volume change's
/// coupling included: each iteration squares the error.
#[test]
fn newton_is_quadratic_on_a_static_problem() {
    let newton = NewtonSettings {
        relative_tolerance: 1e-13,
        // Foreseen pressures are those of another tangent on the way.
        mixed_newton: false,
        krylov: KrylovSettings {
            relative_tolerance: 1e-13,
            ..KrylovSettings::default()
        },
        ..NewtonSettings::default()
    };
    let steps = LoadSteps {
        first: 0.25,
        largest: 0.25,
        newton,
        ..LoadSteps::default()
    };
    let solution = beam(2, 100.0)
        .solve_with(P1_NODAL, &steps)
        .expect("the beam bends");
    for step in &solution.report.steps {
        let residuals = &step.residuals;
        // Before the last drops the iterates are far from the solution; after them there is only round-off.
        let orders = residuals
            .windows(3)
            .map(|r| (r[2] / r[1]).ln() / (r[1] / r[0]).ln());
        let drops = residuals
            .windows(3)
            .zip(orders)
            .filter(|(r, _)| r[1] < 1e-1 * r[0] && r[1] > 1e-8 * residuals[1]);
        let best = drops.map(|(_, order)| order).fold(0.0, f64::max);
        assert!(best > 1.8, "{residuals:?}");
    }
}

#[test]
fn beam_of_land_2015_meets_the_consensus_with_quadratic_elements_and_locks_with_plain_linear_ones()
{
    let tip = |element| beam(3, 1000.0).solve(element).position(BEAM_TIP)[2];
    let quadratic = tip(P2_NODAL);
    assert!((quadratic - 4.169).abs() < 0.02, "{quadratic}");
    let (plain, nodal) = (tip(P1), tip(P1_NODAL));
    assert!(
        plain < nodal && nodal < quadratic,
        "{plain} {nodal} {quadratic}"
    );
    assert!(plain < 2.0, "P1/P0 locks on a coarse mesh: {plain}");
}

#[test]
fn inflated_ventricle_of_land_2015_meets_the_consensus() {
    // At 1000 kPa the wall's own volume grows by per cents under this load, and the apex lies half a millimetre lower.
    let solution = inflation(6, 2, 1e4).solve(P2_NODAL);
    let (endo, epi) = (
        solution.position(APEX_ENDO)[2],
        solution.position(APEX_EPI)[2],
    );
    assert!((endo + 26.612).abs() < 0.05, "endocardial apex {endo}");
    assert!((epi + 28.279).abs() < 0.05, "epicardial apex {epi}");
}

/// At the volumes as they are the tangent of this mesh is indefinite, and no load step is short enough.
#[test]
fn newton_needs_the_foreseen_pressures_where_soft_tissue_is_inflated() {
    let problem = inflation(6, 3, 1e4);
    let steps = |mixed_newton| {
        let newton = NewtonSettings {
            mixed_newton,
            ..NewtonSettings::default()
        };
        LoadSteps {
            first: problem.first_step,
            newton,
            ..LoadSteps::default()
        }
    };
    assert!(problem.solve_with(P1_NODAL, &steps(false)).is_err());
    let solution = problem
        .solve_with(P1_NODAL, &steps(true))
        .expect("an equilibrium");
    assert!(
        solution.report.iterations() < 100,
        "{}",
        solution.report.iterations()
    );
}

#[test]
fn contracting_ventricle_of_land_2015_meets_the_consensus() {
    let solution = contraction(3, 3, 1000.0).solve(P2_NODAL);
    let (endo, epi) = (
        solution.position(APEX_ENDO)[2],
        solution.position(APEX_EPI)[2],
    );
    assert!((endo + 12.347).abs() < 0.25, "endocardial apex {endo}");
    assert!((epi + 15.452).abs() < 0.25, "epicardial apex {epi}");
}

fn cube_body(nodes: &[[f64; 3]], tets: &[[u32; 4]]) -> Body {
    let tissue = Tissue {
        law: Law::NeoHookean(NeoHookean { mu_kpa: 5.0 }),
        volumetric: Volumetric {
            law: VolumetricLaw::Quadratic,
            kappa_kpa: 50.0,
        },
        active: None,
        density: 1.0,
    };
    let tissue_of = vec![0; tets.len()];
    let input = BodyInput {
        nodes,
        n_vertices: nodes.len(),
        tets,
        tissues: vec![tissue],
        tissue_of: &tissue_of,
        frame: &|_, _| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        volume: VolumeChange::Nodal {
            pointwise_share: 0.05,
        },
        layout: Layout::whole(nodes.len()),
        elements: &[],
    };
    Body::linear(&input, &SingleProcess).expect("a proper mesh")
}

#[test]
fn a_prescribed_homogeneous_deformation_is_reproduced_inside_by_every_linear_solver() {
    let mesh = cuboid([3, 3, 3], |p| p);
    let body = cube_body(&mesh.nodes, &mesh.tets);
    let h = [[0.1, 0.2, 0.0], [0.0, -0.1, 0.1], [0.05, 0.0, 0.15]];
    let moved = |x: &[f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| (0..3).map(|k| h[i][k] * x[k]).sum())
    };
    let on_side = |x: &[f64; 3]| x.iter().any(|x| *x < 1e-9 || *x > 1.0 - 1e-9);
    let problem = StaticProblem {
        body: &body,
        comm: &SingleProcess,
        pressures: vec![],
        springs: vec![],
        fixed: mesh.nodes.iter().map(|x| [on_side(x); 3]).collect(),
        prescribed: mesh.nodes.iter().flat_map(moved).collect(),
        active: vec![],
    };
    for linear in [
        LinearSolver::Direct,
        LinearSolver::BlockJacobi,
        LinearSolver::SymmetricSweep,
    ] {
        let krylov = KrylovSettings {
            relative_tolerance: 1e-10,
            ..KrylovSettings::default()
        };
        let newton = NewtonSettings {
            linear,
            krylov,
            ..NewtonSettings::default()
        };
        let mut u = vec![0.0; 3 * mesh.nodes.len()];
        load(
            &problem,
            &mut u,
            &LoadSteps {
                newton,
                ..LoadSteps::default()
            },
        )
        .expect("an equilibrium");
        for (x, u) in mesh.nodes.iter().zip(u.chunks(3)) {
            let want = moved(x);
            assert!(
                (0..3).all(|i| (u[i] - want[i]).abs() < 1e-7),
                "{linear:?}: {u:?} for {want:?}"
            );
        }
    }
}

#[test]
fn newton_converges_fast_on_a_static_problem() {
    let solution = sphere(4, 2, 0.1, 100.0).solve(P2_NODAL);
    for step in &solution.report.steps {
        assert!(step.iterations() <= 8, "{:?}", step.residuals);
    }
}

#[test]
fn pressure_and_springs_have_the_tangent_of_their_forces() {
    let mesh = cuboid([2, 2, 2], |p| p);
    let body = cube_body(&mesh.nodes, &mesh.tets);
    let reference = body.reference().to_vec();
    let surface = PressureSurface::new(&mesh.sides[1], body.pattern()).expect("faces of the body");
    let robin =
        |d| Robin::new(&mesh.sides[3], d, &reference, body.pattern()).expect("faces of the body");
    let (normal, all) = (robin(RobinDirection::Normal), robin(RobinDirection::All));
    let forces = |u: &[f64]| {
        let mut f = vec![0.0; u.len()];
        surface.add_forces(2.0, &reference, u, &mut f);
        normal.add_forces(3.0, u, &mut f);
        all.add_forces(0.5, u, &mut f);
        f
    };
    let u: Vec<f64> = (0..reference.len())
        .map(|k| 0.1 * (k as f64).sin())
        .collect();
    let mut tangent = body.new_tangent();
    surface.add_tangent(2.0, &reference, &u, &mut tangent);
    normal.add_tangent(3.0, &mut tangent);
    all.add_tangent(0.5, &mut tangent);
    let mut d: Vec<f64> = (0..u.len()).map(|k| (1.7 * k as f64).cos()).collect();
    let mut got = vec![0.0; u.len()];
    tangent.multiply(
        VectorLayout {
            comm: &SingleProcess,
            layout: body.layout(),
        },
        &mut d,
        &mut got,
    );
    let at = |s: f64| forces(&u.iter().zip(&d).map(|(u, d)| u + s * d).collect::<Vec<_>>());
    for ((got, plus), minus) in got.iter().zip(at(1e-5)).zip(at(-1e-5)) {
        assert!((got - (plus - minus) / 2e-5).abs() < 1e-8, "{got}");
    }
    // A normal spring holds one direction, in all with the surface's area.
    let shift = |axis: usize| -> Vec<f64> {
        (0..u.len())
            .map(|k| if k % 3 == axis { 0.2 } else { 0.0 })
            .collect()
    };
    let push = |axis: usize| {
        let mut f = vec![0.0; u.len()];
        normal.add_forces(3.0, &shift(axis), &mut f);
        f
    };
    assert!((push(1).iter().sum::<f64>() - 3.0 * 0.2).abs() < 1e-12);
    assert!(push(0).iter().all(|f| f.abs() < 1e-15));
}

#[test]
fn pressure_on_a_closed_surface_pushes_nowhere_and_does_the_work_of_the_volume() {
    let mesh = cuboid([2, 2, 2], |p| p);
    let body = cube_body(&mesh.nodes, &mesh.tets);
    let all: Vec<[u32; 3]> = mesh.sides.iter().flatten().copied().collect();
    let surface = PressureSurface::new(&all, body.pattern()).expect("faces of the body");
    let u: Vec<f64> = (0..body.reference().len())
        .map(|k| 0.1 * (k as f64).sin())
        .collect();
    let mut f = vec![0.0; u.len()];
    surface.add_forces(1.0, body.reference(), &u, &mut f);
    for i in 0..3 {
        assert!(f.iter().skip(i).step_by(3).sum::<f64>().abs() < 1e-13);
    }
    // The surface looks away from its inside: the volume about any point is minus that of the body.
    let volume = |u: &[f64]| surface.volume([0.3, 0.4, -0.2], body.reference(), u);
    assert!((volume(&vec![0.0; u.len()]) + 1.0).abs() < 1e-13);
    let d: Vec<f64> = (0..u.len()).map(|k| (0.9 * k as f64).cos()).collect();
    let at = |s: f64| volume(&u.iter().zip(&d).map(|(u, d)| u + s * d).collect::<Vec<_>>());
    let work: f64 = f.iter().zip(&d).map(|(f, d)| f * d).sum();
    assert!((work + (at(1e-5) - at(-1e-5)) / 2e-5).abs() < 1e-8);
}

#[test]
fn a_load_that_cannot_be_borne_ends_with_the_last_equilibrium_and_the_reason() {
    // Beyond the limit point of the sphere's inflation there is no equilibrium.
    let problem = sphere(4, 2, 0.4, 100.0);
    let steps = LoadSteps {
        first: 0.25,
        smallest: 0.02,
        ..LoadSteps::default()
    };
    let error = problem
        .solve_with(P1_NODAL, &steps)
        .err()
        .expect("no equilibrium at this pressure")
        .to_string();
    assert!(
        error.starts_with("no equilibrium found beyond 0."),
        "{error}"
    );
}

#[test]
fn tables_of_the_verification_begin_with_the_elements_of_a_ventricle_that_asks_for_none() {
    let compared = compared();
    assert_eq!(compared[0].1, ElementKind::default());
    assert_eq!(
        compared[0].0,
        format!("cohort's: {}", ElementKind::default())
    );
    let mut names: Vec<&String> = compared.iter().map(|(name, _)| name).collect();
    names.dedup();
    assert_eq!(
        names.len(),
        compared.len(),
        "each row tells its elements apart"
    );
    for (name, element) in [
        ("linear pointwise", ElementKind::LINEAR_POINTWISE),
        ("linear nodal (0.01 pointwise)", ElementKind::LINEAR_NODAL),
        ("quadratic nodal", ElementKind::QUADRATIC_NODAL),
    ] {
        assert_eq!(element.to_string(), name);
        assert!(
            compared.iter().any(|(_, other)| *other == element),
            "{name} is not beside it"
        );
    }
}
