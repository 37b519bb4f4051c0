//! Assembly against finite differences, rigid motions and the patch test.

use cardiotwin_linalg::Operator as _;
use cardiotwin_linalg::parallel::SingleProcess;

use super::*;
use crate::element::quadratic::QuadraticMesh;
use crate::element::shape::EDGES;
use crate::linear::{Assembled, HalfTangent};
use crate::material::{ActiveLaw, Guccione, Law, Volumetric};

/// A cube of `n`³ cells of six tetrahedra, with inner nodes moved so that no element is regular.
fn cube(n: usize) -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
    let at = |i: usize, j: usize, k: usize| (i * (n + 1) + j) * (n + 1) + k;
    let mut nodes = vec![];
    for i in 0..=n {
        for j in 0..=n {
            for k in 0..=n {
                let inner = [i, j, k].iter().all(|x| (1..n).contains(x));
                let shift = |s: f64| {
                    if inner {
                        0.15 / n as f64 * (s * (1 + nodes.len()) as f64).sin()
                    } else {
                        0.0
                    }
                };
                nodes.push([
                    i as f64 / n as f64 + shift(1.7),
                    j as f64 / n as f64 + shift(2.9),
                    k as f64 / n as f64 + shift(4.3),
                ]);
            }
        }
    }
    let mut tets = vec![];
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                for order in [
                    [0, 1, 2],
                    [1, 2, 0],
                    [2, 0, 1],
                    [1, 0, 2],
                    [0, 2, 1],
                    [2, 1, 0],
                ] {
                    let mut p = [i, j, k];
                    let mut tet = [at(p[0], p[1], p[2]) as u32; 4];
                    for (m, axis) in order.into_iter().enumerate() {
                        p[axis] += 1;
                        tet[m + 1] = at(p[0], p[1], p[2]) as u32;
                    }
                    let even = matches!(order, [0, 1, 2] | [1, 2, 0] | [2, 0, 1]);
                    tets.push(if even {
                        tet
                    } else {
                        [tet[0], tet[2], tet[1], tet[3]]
                    });
                }
            }
        }
    }
    (nodes, tets)
}

fn tissue() -> Tissue {
    Tissue {
        law: Law::Guccione(Guccione::guccione1995(2.0)),
        volumetric: Volumetric {
            law: VolumetricLaw::LnSquared,
            kappa_kpa: 100.0,
        },
        active: Some(ActiveLaw::PAPER),
        density: 1.06,
    }
}

/// A frame that rotates from point to point.
fn frame(_: usize, x: [f64; 3]) -> Frame {
    let r = nalgebra::Rotation3::from_euler_angles(x[0], 0.5 + x[1], 2.0 * x[2]);
    std::array::from_fn(|i| std::array::from_fn(|k| r[(i, k)]))
}

fn bodies(n: usize) -> Vec<(&'static str, Body)> {
    let (nodes, tets) = cube(n);
    let quadratic = QuadraticMesh::new(&nodes, &tets, |_, _| None);
    let tissue_of = vec![0; tets.len()];
    let mut out = vec![];
    for (name, volume) in [
        ("pointwise", VolumeChange::Pointwise),
        (
            "nodal",
            VolumeChange::Nodal {
                pointwise_share: 0.05,
            },
        ),
    ] {
        let linear = Body::linear(
            &BodyInput {
                nodes: &nodes,
                n_vertices: nodes.len(),
                tets: &tets,
                tissues: vec![tissue()],
                tissue_of: &tissue_of,
                frame: &frame,
                volume,
                layout: Layout::whole(nodes.len()),
                elements: &[],
            },
            &SingleProcess,
        );
        let second = Body::quadratic(
            &BodyInput {
                nodes: &quadratic.nodes,
                n_vertices: quadratic.n_vertices,
                tets: &quadratic.tets,
                tissues: vec![tissue()],
                tissue_of: &tissue_of,
                frame: &frame,
                volume,
                layout: Layout::whole(quadratic.nodes.len()),
                elements: &[],
            },
            &SingleProcess,
        );
        out.push((name, linear.expect("a proper body")));
        out.push((name, second.expect("a proper body")));
    }
    out
}

/// Active tension that depends on stretch, at every point.
fn active(body: &Body, deformation: &Deformation) -> Vec<ActivePoint> {
    (0..body.n_point_batches())
        .map(|k| {
            let lambda = deformation.squared_stretch[k].map(f64::sqrt);
            ActivePoint {
                sa_kpa: lambda.map(|l| 30.0 * l),
                slope_kpa: [30.0; BATCH],
            }
        })
        .collect()
}

fn forces(body: &Body, u: &[f64]) -> Vec<f64> {
    let mut deformation = Deformation::default();
    body.deform(u, &SingleProcess, &mut deformation);
    let mut f = vec![0.0; u.len()];
    body.add_forces(u, &active(body, &deformation), &deformation, &mut f);
    f
}

fn wavy(body: &Body, size: f64) -> Vec<f64> {
    body.reference()
        .iter()
        .enumerate()
        .map(|(k, x)| size * (3.0 * x + k as f64).sin())
        .collect()
}

#[test]
fn tangent_is_the_slope_of_the_forces() {
    for (name, body) in bodies(2) {
        let u = wavy(&body, 0.02);
        let mut deformation = Deformation::default();
        body.deform(&u, &SingleProcess, &mut deformation);
        let mut tangent = body.new_tangent();
        let mut f = vec![0.0; u.len()];
        body.tangent(
            &u,
            &active(&body, &deformation),
            &deformation,
            &mut f,
            &mut tangent,
        );
        let same = forces(&body, &u);
        let scale = same.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(
            f.iter()
                .zip(&same)
                .all(|(a, b)| (a - b).abs() < 1e-12 * scale),
            "{name}: both passes give one force"
        );
        let mut direction: Vec<f64> = (0..u.len()).map(|k| (k as f64 * 1.3).cos()).collect();
        let mut product = vec![0.0; u.len()];
        let space = cardiotwin_linalg::parallel::VectorLayout {
            comm: &SingleProcess,
            layout: body.layout(),
        };
        tangent.multiply(space, &mut direction, &mut product);
        if let Some(mut packed) = body.new_packed_tangent() {
            let mut f = vec![0.0; u.len()];
            body.tangent(
                &u,
                &active(&body, &deformation),
                &deformation,
                &mut f,
                &mut packed,
            );
            assert_eq!(
                f,
                forces(&body, &u),
                "{name}: a restarted beat may take either pass"
            );
            let mut larger = body.new_packed_tangent().expect("as before");
            let (slopes, factor) = (active(&body, &deformation), 1.25);
            body.tangent_in_motion(
                &u,
                (&[], 0.0),
                &slopes,
                &deformation,
                &mut vec![0.0; u.len()],
                (factor, &mut larger),
            );
            let mut products = [vec![0.0; u.len()], vec![0.0; u.len()]];
            packed.multiply(space, &mut direction, &mut products[0]);
            larger.multiply(space, &mut direction, &mut products[1]);
            let largest = products[1].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            for (one, more) in products[0].iter().zip(&products[1]) {
                assert!((factor * one - more).abs() < 1e-6 * largest, "{name}");
            }
            // Constrained components, weights and surfaces, as in a time step.
            let mut fixed = vec![[false; 3]; body.n_nodes()];
            fixed[1] = [true, false, true];
            let (mut whole, mut products) =
                (tangent.clone(), [vec![0.0; u.len()], vec![0.0; u.len()]]);
            for (matrix, product) in [&mut whole as &mut dyn Assembled, &mut packed]
                .into_iter()
                .zip(&mut products)
            {
                matrix.add_block(3, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
                matrix.add_to_diagonal(2, 30.0);
                matrix.constrain(&fixed, 50.0);
                matrix.multiply(space, &mut direction, product);
            }
            let [want, got] = products;
            let scale = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let off = want
                .iter()
                .zip(&got)
                .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(off < 1e-6 * scale && off > 0.0, "{name}: {off} of {scale}");
            let mut half = HalfTangent::zeros(body.pattern().clone());
            half.copy_from(&packed);
            let mut rounded = vec![0.0; u.len()];
            half.multiply(space, &mut direction, &mut rounded);
            let coarse = want
                .iter()
                .zip(&rounded)
                .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(
                off < coarse && coarse < 1e-3 * scale,
                "{name}: {coarse} of {scale}"
            );
            for row in 0..body.n_nodes() {
                let want = whole.diagonal(row);
                let size = want[0].abs() + want[4].abs() + want[8].abs();
                for (got, allowed) in [
                    (packed.diagonal(row), 1e-6),
                    (
                        cardiotwin_linalg::Operator::<f32>::diagonal(&half, row),
                        1e-3,
                    ),
                ] {
                    assert!(
                        want.iter()
                            .zip(got)
                            .all(|(a, b)| (a - b).abs() < allowed * size),
                        "{name}, row {row}"
                    );
                }
            }
        }
        let h = 1e-6;
        let moved = |s: f64| -> Vec<f64> {
            u.iter()
                .zip(&direction)
                .map(|(u, d)| u + s * h * d)
                .collect()
        };
        let (plus, minus) = (forces(&body, &moved(1.0)), forces(&body, &moved(-1.0)));
        let scale = product.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for (k, p) in product.iter().enumerate() {
            let slope = (plus[k] - minus[k]) / (2.0 * h);
            assert!(
                (p - slope).abs() < 2e-7 * scale,
                "{name}, {} nodes, component {k}: {p} for {slope}",
                body.n_nodes()
            );
        }
    }
}

#[test]
fn forces_turn_with_the_body_and_vanish_in_sum() {
    for (name, body) in bodies(2) {
        let u = wavy(&body, 0.03);
        let f = forces(&body, &u);
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.2);
        let x: Vec<f64> = body
            .reference()
            .iter()
            .zip(&u)
            .map(|(x, u)| x + u)
            .collect();
        let mut turned = vec![];
        for (x, reference) in x.chunks(3).zip(body.reference().chunks(3)) {
            let y = turn * nalgebra::Vector3::from_column_slice(x)
                + nalgebra::Vector3::new(3.0, -2.0, 1.0);
            turned.extend((0..3).map(|i| y[i] - reference[i]));
        }
        let g = forces(&body, &turned);
        let scale = f.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for (f, g) in f.chunks(3).zip(g.chunks(3)) {
            let want = turn * nalgebra::Vector3::from_column_slice(f);
            assert!(
                (0..3).all(|i| (want[i] - g[i]).abs() < 1e-10 * scale),
                "{name}"
            );
        }
        for i in 0..3 {
            assert!(
                f.iter().skip(i).step_by(3).sum::<f64>().abs() < 1e-11 * scale,
                "{name}: no net force"
            );
        }
    }
}

#[test]
fn a_homogeneous_deformation_leaves_inner_nodes_in_balance() {
    for (name, body) in bodies(3) {
        // A passive law with a uniform frame makes the stress uniform.
        let h = [
            [0.08, 0.05, -0.02],
            [0.01, -0.04, 0.06],
            [0.03, -0.07, 0.05],
        ];
        let u: Vec<f64> = body
            .reference()
            .chunks(3)
            .flat_map(|x| {
                (0..3)
                    .map(|i| (0..3).map(|k| h[i][k] * x[k]).sum::<f64>())
                    .collect::<Vec<_>>()
            })
            .collect();
        let (nodes, tets) = cube(3);
        let axes = frame(0, [0.3, 0.2, 0.1]);
        let fixed = |_: usize, _: [f64; 3]| axes;
        let quadratic = QuadraticMesh::new(&nodes, &tets, |_, _| None);
        let tissue_of = vec![0; tets.len()];
        let one = if body.n_nodes() == nodes.len() {
            let layout = Layout::whole(nodes.len());
            let input = BodyInput {
                nodes: &nodes,
                n_vertices: nodes.len(),
                tets: &tets,
                tissues: vec![tissue()],
                tissue_of: &tissue_of,
                frame: &fixed,
                volume: body.volume,
                layout,
                elements: &[],
            };
            Body::linear(&input, &SingleProcess)
        } else {
            let layout = Layout::whole(quadratic.nodes.len());
            let input = BodyInput {
                nodes: &quadratic.nodes,
                n_vertices: nodes.len(),
                tets: &quadratic.tets,
                tissues: vec![tissue()],
                tissue_of: &tissue_of,
                frame: &fixed,
                volume: body.volume,
                layout,
                elements: &[],
            };
            Body::quadratic(&input, &SingleProcess)
        }
        .expect("a proper body");
        let mut deformation = Deformation::default();
        one.deform(&u, &SingleProcess, &mut deformation);
        let mut f = vec![0.0; u.len()];
        one.add_forces(&u, &[], &deformation, &mut f);
        let scale = f.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(scale > 1e-2);
        for (x, f) in one.reference().chunks(3).zip(f.chunks(3)) {
            if x.iter().all(|x| *x > 1e-9 && *x < 1.0 - 1e-9) {
                assert!(
                    f.iter().all(|f| f.abs() < 1e-11 * scale.max(1.0)),
                    "{name}, {} nodes: {f:?} at {x:?}",
                    one.n_nodes()
                );
            }
        }
    }
}

#[test]
fn an_inverted_element_shows_in_the_smallest_volume_ratio() {
    let (_, body) = bodies(2).remove(0);
    let mut u = vec![0.0; 3 * body.n_nodes()];
    u[0] = 3.0;
    let mut deformation = Deformation::default();
    body.deform(&u, &SingleProcess, &mut deformation);
    assert!(deformation.smallest.0 < 0.0);
    u[0] = f64::NAN;
    body.deform(&u, &SingleProcess, &mut deformation);
    assert!(!(deformation.smallest.0 > 0.0));
    assert_eq!(EDGES.len(), 6);
}

#[test]
fn forces_are_the_slope_of_the_strain_energy() {
    for (name, body) in bodies(2) {
        let u = wavy(&body, 0.01);
        let d: Vec<f64> = (0..u.len()).map(|k| (1.3 * k as f64).cos()).collect();
        let mut deformation = Deformation::default();
        body.deform(&u, &SingleProcess, &mut deformation);
        let mut f = vec![0.0; u.len()];
        body.add_forces(&u, &[], &deformation, &mut f);
        let at = |s: f64| {
            body.strain_energy(&u.iter().zip(&d).map(|(u, d)| u + s * d).collect::<Vec<_>>())
        };
        let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
        let power: f64 = f.iter().zip(&d).map(|(f, d)| f * d).sum();
        assert!(
            (slope - power).abs() < 1e-6 * power.abs().max(1.0),
            "{name}: {slope} {power}"
        );
    }
}

#[test]
fn lumped_masses_are_positive_and_sum_to_the_mass_of_the_cube() {
    for (name, body) in bodies(2) {
        let mass = body.masses();
        assert!(mass.iter().all(|m| *m > 0.0), "{name}");
        assert!((mass.iter().sum::<f64>() - 1.06).abs() < 1e-12, "{name}");
    }
}
