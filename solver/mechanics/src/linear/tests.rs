//! Every solver against the direct factorisation, on a lattice with 3×3 blocks.

use std::sync::Arc;

use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_units::Ml;

use super::*;
use crate::parallel::{
    Communicator as _, Layout, Part, SingleProcess, Space, ThreadSettings, on_threads, owners,
};

type Solver = fn(
    Space<'_>,
    &dyn Operator,
    &dyn Preconditioner,
    &[f64],
    &mut [f64],
    &KrylovSettings,
) -> KrylovReport;

/// A graph Laplacian of 3×3 blocks on an `n`³ lattice, with a coupling; `shift` on the diagonal, `skew` makes it
/// unsymmetric.
fn lattice(n: usize, shift: f64, skew: f64) -> (Tangent, Vec<f64>) {
    let at = |i: usize, j: usize, k: usize| ((i * n + j) * n + k) as u32;
    let (mut pairs, mut points) = (vec![], vec![]);
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                points.extend([i as f64, j as f64, k as f64]);
                for other in [(i + 1, j, k), (i, j + 1, k), (i, j, k + 1)] {
                    if other.0 < n && other.1 < n && other.2 < n {
                        pairs.push([at(i, j, k), at(other.0, other.1, other.2)]);
                    }
                }
            }
        }
    }
    let pattern = Arc::new(Pattern::of_elements(
        n * n * n,
        pairs.iter().map(|p| (&p[..], &p[..])),
    ));
    let mut stiffness = BlockCsr::zeros(pattern.clone());
    let mut coupling = Coupling::zeros(pattern.clone());
    for (e, [a, b]) in pairs.iter().enumerate() {
        // A symmetric positive block for each edge, another one from edge to edge.
        let d = |k: usize| 1.0 + 0.4 * ((e * 3 + k) as f64).sin();
        let block = [d(0), 0.3, 0.1, 0.3, d(1), -0.2, 0.1, -0.2, d(2)];
        for (r, c, sign) in [(*a, *a, 1.0), (*b, *b, 1.0), (*a, *b, -1.0), (*b, *a, -1.0)] {
            let to = &mut stiffness.blocks[pattern.slot(r, c) as usize];
            for k in 0..9 {
                to[k] += sign * block[k];
            }
        }
        stiffness.blocks[pattern.slot(*a, *b) as usize][1] += skew;
        for (r, c) in [(*a, *b), (*b, *a), (*a, *a)] {
            coupling.blocks[pattern.slot(r, c) as usize][e % 3] +=
                0.3 * ((e + r as usize) as f64).cos();
        }
    }
    for r in 0..n * n * n {
        let to = &mut stiffness.blocks[pattern.slot(r as u32, r as u32) as usize];
        for i in 0..3 {
            to[4 * i] += shift;
        }
    }
    (
        Tangent {
            stiffness,
            coupling: Some(coupling),
            bulk: vec![2.0; n * n * n],
        },
        points,
    )
}

fn right_hand_side(n: usize) -> Vec<f64> {
    (0..n).map(|k| (k as f64 * 0.7).sin()).collect()
}

#[test]
fn every_solver_finds_the_same_solution() {
    let (a, points) = lattice(6, 0.05, 0.0);
    let layout = Layout::whole(216);
    let space = Space {
        comm: &SingleProcess,
        layout: &layout,
    };
    let b = right_hand_side(648);
    let mut direct = Direct::new(&a, &points).expect("a pattern");
    direct.factorise(&a).expect("a positive definite matrix");
    let mut want = vec![0.0; 648];
    // A factor in single precision, refined with residuals in double precision.
    for _ in 0..4 {
        let (mut r, mut z) = (vec![0.0; 648], vec![0.0; 648]);
        a.multiply(space, &mut want, &mut r);
        r.iter_mut().zip(&b).for_each(|(r, b)| *r = b - *r);
        direct.apply(space, &r, &mut z);
        want.iter_mut().zip(&z).for_each(|(x, z)| *x += z);
    }
    let settings = KrylovSettings {
        relative_tolerance: 1e-11,
        ..KrylovSettings::default()
    };
    let jacobi = BlockJacobi::new(&a);
    let sweep = SymmetricSweep::new(&a);
    type Solver = fn(
        Space<'_>,
        &dyn Operator,
        &dyn Preconditioner,
        &[f64],
        &mut [f64],
        &KrylovSettings,
    ) -> KrylovReport;
    let mut counts = vec![];
    for solver in [conjugate_gradients as Solver, minres, gmres] {
        for m in [&jacobi as &dyn Preconditioner, &sweep, &direct] {
            let mut x = vec![0.0; 648];
            let report = solver(space, &a, m, &b, &mut x, &settings);
            assert_eq!(report.ending, KrylovEnding::Converged, "{report:?}");
            let scale = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            assert!(
                x.iter()
                    .zip(&want)
                    .all(|(x, w)| (x - w).abs() < 1e-8 * scale)
            );
            counts.push(report.iterations);
        }
    }
    // A sweep halves the iterations of block Jacobi at least; the factorisation in single precision needs three.
    for of in counts.chunks(3) {
        assert!(2 * of[1] <= of[0] + 6 && of[2] <= 3, "{counts:?}");
    }
}

#[test]
fn multigrid_needs_few_iterations_whatever_the_size() {
    let mut counts = vec![];
    for n in [8, 16] {
        let (mut a, points) = lattice(n, 1e-3, 0.0);
        a.bulk.fill(0.2);
        let layout = Layout::whole(n * n * n);
        let space = Space {
            comm: &SingleProcess,
            layout: &layout,
        };
        let b = right_hand_side(3 * n * n * n);
        let settings = KrylovSettings {
            relative_tolerance: 1e-6,
            ..KrylovSettings::default()
        };
        let multigrid = Multigrid::new(space, &a, &points);
        assert!(
            multigrid.sizes()[1] < 3 * n * n * n,
            "{:?}",
            multigrid.sizes()
        );
        let jacobi = BlockJacobi::new(&a);
        let of = |m: &dyn Preconditioner| {
            let mut x = vec![0.0; b.len()];
            let report = conjugate_gradients(space, &a, m, &b, &mut x, &settings);
            assert_eq!(report.ending, KrylovEnding::Converged, "{report:?}");
            let mut r = vec![0.0; b.len()];
            a.multiply(space, &mut x, &mut r);
            r.iter_mut().zip(&b).for_each(|(r, b)| *r -= b);
            assert!(space.norm(&r) < 2e-6 * space.norm(&b));
            report.iterations
        };
        counts.push([of(&multigrid), of(&jacobi)]);
    }
    assert!(
        counts[1][0] <= counts[0][0] + 8 && 3 * counts[1][0] < counts[1][1],
        "{counts:?}"
    );
}

#[test]
fn multigrid_on_ranks_is_that_on_one_but_for_groups_at_borders() {
    let mesh = generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), 7000))
        .expect("a mesh")
        .mesh;
    let (n, tets) = (mesh.n_nodes(), &mesh.tets);
    // Springs along the elements' edges, a little of them to the ground.
    let stiffness = |part: &Part| {
        let local = |e: &u32| tets[*e as usize].map(|node| part.local(node).expect("held"));
        let held: Vec<[u32; 4]> = part.elements.iter().map(local).collect();
        let pattern = Arc::new(Pattern::of_elements(
            part.layout.n_owned,
            held.iter().map(|t| (&t[..], &t[..])),
        ));
        let mut stiffness = BlockCsr::zeros(pattern.clone());
        let mut add = |row: u32, column: u32, block: [f64; 9]| {
            let slot = pattern.slot(row, column);
            if slot != NO_SLOT {
                stiffness.blocks[slot as usize]
                    .iter_mut()
                    .zip(block)
                    .for_each(|(to, from)| *to += from);
            }
        };
        for t in &held {
            for (a, b) in
                [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(a, b)| (t[a], t[b]))
            {
                let [x, y] = [a, b].map(|node| mesh.nodes_mm[part.nodes[node as usize] as usize]);
                let d: [f64; 3] = std::array::from_fn(|i| x[i] - y[i]);
                let size = d.iter().map(|x| x * x).sum::<f64>();
                let spring: [f64; 9] = std::array::from_fn(|k| {
                    d[k / 3] * d[k % 3] / size + if k % 4 == 0 { 0.05 } else { 0.0 }
                });
                for (row, column, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                    add(row, column, spring.map(|x| sign * x));
                }
            }
            t.iter().for_each(|a| {
                add(
                    *a,
                    *a,
                    std::array::from_fn(|k| if k % 4 == 0 { 1e-4 } else { 0.0 }),
                )
            });
        }
        Tangent {
            stiffness,
            coupling: None,
            bulk: vec![],
        }
    };
    let b = right_hand_side(3 * n);
    let settings = KrylovSettings {
        relative_tolerance: 1e-8,
        ..KrylovSettings::default()
    };
    let solved = |n_ranks: usize| {
        let owners = owners(n, tets, n_ranks).expect("a cut");
        let of_ranks = on_threads(n_ranks, ThreadSettings::default(), |comm| {
            let part = Part::of(comm.rank(), &owners, tets);
            let space = Space {
                comm: &comm,
                layout: &part.layout,
            };
            let a = stiffness(&part);
            let multigrid = Multigrid::new(space, &a, &part.take(3, mesh.nodes_mm.as_flattened()));
            let (b, mut x) = (part.take(3, &b), vec![0.0; 3 * part.nodes.len()]);
            let report = conjugate_gradients(space, &a, &multigrid, &b, &mut x, &settings);
            assert_eq!(report.ending, KrylovEnding::Converged, "{report:?}");
            // Symmetric, or conjugate gradients would not be.
            let (mut ma, mut mb) = (vec![0.0; b.len()], vec![0.0; b.len()]);
            let other: Vec<f64> = part.take(
                3,
                &(0..3 * n)
                    .map(|k| (k as f64 * 1.3).cos())
                    .collect::<Vec<_>>(),
            );
            multigrid.apply(space, &b, &mut mb);
            multigrid.apply(space, &other, &mut ma);
            let [left, right, size] = space.dots([(&other, &mb), (&b, &ma), (&b, &mb)]);
            assert!(
                (left - right).abs() < 1e-4 * size,
                "{left} {right} of {size}"
            );
            x.truncate(space.n_owned());
            (
                report.iterations,
                multigrid.sizes().len(),
                part.owned_nodes().to_vec(),
                x,
            )
        })
        .expect("no rank fails");
        let mut all = vec![0.0; 3 * n];
        for (_, _, nodes, x) in &of_ranks {
            for (node, x) in nodes.iter().zip(x.as_chunks::<3>().0) {
                all[3 * *node as usize..][..3].copy_from_slice(x);
            }
        }
        (of_ranks[0].0, of_ranks[0].1, all)
    };
    let (alone, levels, want) = solved(1);
    assert_eq!(
        levels, 3,
        "a level of groups, too, before the factorisation"
    );
    let largest = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    for n_ranks in [2, 3, 5] {
        let (iterations, _, x) = solved(n_ranks);
        assert!(
            iterations <= alone + alone / 4 + 2,
            "{n_ranks} ranks: {iterations} iterations, {alone} on one"
        );
        let apart = x
            .iter()
            .zip(&want)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(
            apart < 1e-4 * largest,
            "{n_ranks} ranks: {apart} of {largest}"
        );
    }
}

#[test]
fn an_indefinite_matrix_stops_conjugate_gradients_but_not_minres_and_gmres() {
    let (a, points) = lattice(5, -0.35, 0.0);
    let layout = Layout::whole(125);
    let space = Space {
        comm: &SingleProcess,
        layout: &layout,
    };
    let b = right_hand_side(375);
    let jacobi = BlockJacobi::new(&a);
    let settings = KrylovSettings {
        relative_tolerance: 1e-9,
        restart: 400,
        ..KrylovSettings::default()
    };
    let solve = |solver: Solver| {
        let mut x = vec![0.0; 375];
        (solver(space, &a, &jacobi, &b, &mut x, &settings), x)
    };
    assert_eq!(
        solve(conjugate_gradients).0.ending,
        KrylovEnding::Indefinite
    );
    let (m, x) = solve(minres);
    let (g, y) = solve(gmres);
    assert_eq!(
        (m.ending, g.ending),
        (KrylovEnding::Converged, KrylovEnding::Converged)
    );
    assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-5));
    let mut direct = Direct::new(&a, &points).expect("a pattern");
    direct.factorise(&a).expect("no pivot vanishes");
}

#[test]
fn gmres_with_the_symmetric_half_solves_an_unsymmetric_matrix_in_a_few_steps() {
    let (a, points) = lattice(6, 0.5, 0.05);
    let layout = Layout::whole(216);
    let space = Space {
        comm: &SingleProcess,
        layout: &layout,
    };
    let b = right_hand_side(648);
    let mut direct = Direct::new(&a, &points).expect("a pattern");
    direct
        .factorise(&a)
        .expect("its symmetric half is positive definite");
    let mut x = vec![0.0; 648];
    let report = gmres(space, &a, &direct, &b, &mut x, &KrylovSettings::default());
    assert_eq!(report.ending, KrylovEnding::Converged);
    assert!(report.iterations <= 15, "{report:?}");
}

#[test]
fn dissection_orders_every_row_once_and_fills_in_less_than_the_given_order() {
    let (a, points) = lattice(9, 1.0, 0.0);
    let mut order = nested_dissection(&a.stiffness.pattern, &points);
    let scrambled: Vec<f64> = vec![0.0; points.len()];
    let with = Direct::new(&a, &points).expect("a pattern").fill();
    let without = Direct::new(&a, &scrambled).expect("a pattern").fill();
    assert!(with < without, "{with} {without}");
    order.sort_unstable();
    assert!(order.iter().enumerate().all(|(k, o)| k == *o as usize));
}

#[test]
fn fixed_components_keep_their_value() {
    let (mut a, _) = lattice(4, 0.5, 0.0);
    let mut fixed = vec![[false; 3]; 64];
    fixed[5] = [true, false, true];
    a.constrain(&fixed, 7.0);
    let layout = Layout::whole(64);
    let space = Space {
        comm: &SingleProcess,
        layout: &layout,
    };
    let mut x = right_hand_side(192);
    let mut y = vec![0.0; 192];
    a.multiply(space, &mut x, &mut y);
    assert!((y[15] - 7.0 * x[15]).abs() < 1e-14 && (y[17] - 7.0 * x[17]).abs() < 1e-14);
    let before = y.clone();
    x[15] += 1.0;
    a.multiply(space, &mut x, &mut y);
    assert!(
        before
            .iter()
            .zip(&y)
            .enumerate()
            .all(|(k, (b, y))| k == 15 || b == y),
        "no other row sees a fixed component"
    );
}
