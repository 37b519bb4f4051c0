//! Tests of all solvers against the direct factorisation, on a lattice with 3×3 blocks.

use std::sync::Arc;

use super::*;
use crate::parallel::{Layout, SingleProcess, VectorLayout};

type Solver = fn(
    VectorLayout<'_>,
    &dyn Operator,
    &dyn Preconditioner,
    &[f64],
    &mut [f64],
    &KrylovSettings,
) -> KrylovReport;

/// A graph Laplacian of 3×3 blocks on an `n`³ lattice, with a coupling. `shift` is added to the
/// diagonal, and `skew` makes the matrix unsymmetric.
fn lattice(n: usize, shift: f64, skew: f64) -> (CondensedMatrix, Vec<f64>) {
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
        // A symmetric positive definite block for each edge, which differs between edges.
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
        CondensedMatrix {
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
    let space = VectorLayout {
        comm: &SingleProcess,
        layout: &layout,
    };
    let b = right_hand_side(648);
    let mut direct = Direct::new(&a, &points).expect("a pattern");
    direct.factorise(&a).expect("a positive definite matrix");
    let mut want = vec![0.0; 648];
    // Iterative refinement of the single-precision factorisation, with residuals in double
    // precision.
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
        VectorLayout<'_>,
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
    // A sweep at least halves the iterations of block Jacobi; the single-precision factorisation
    // needs three.
    for of in counts.chunks(3) {
        assert!(2 * of[1] <= of[0] + 6 && of[2] <= 3, "{counts:?}");
    }
}

/// Number of iterations of conjugate gradients, and their solution, whose residual is checked.
fn converged(
    space: VectorLayout<'_>,
    a: &CondensedMatrix,
    m: &dyn Preconditioner,
    b: &[f64],
    relative_tolerance: f64,
) -> (usize, Vec<f64>) {
    let settings = KrylovSettings {
        relative_tolerance,
        ..KrylovSettings::default()
    };
    let (mut x, mut r) = (vec![0.0; b.len()], vec![0.0; b.len()]);
    let report = conjugate_gradients(space, a, m, b, &mut x, &settings);
    assert_eq!(report.ending, KrylovEnding::Converged, "{report:?}");
    a.multiply(space, &mut x, &mut r);
    r.iter_mut().zip(b).for_each(|(r, b)| *r -= b);
    assert!(space.norm(&r) < 2.0 * relative_tolerance * space.norm(b));
    (report.iterations, x)
}

#[test]
fn multigrid_needs_few_iterations_whatever_the_size() {
    let mut counts = vec![];
    for n in [8, 16] {
        let (mut a, points) = lattice(n, 1e-3, 0.0);
        a.bulk.fill(0.2);
        let layout = Layout::whole(n * n * n);
        let space = VectorLayout {
            comm: &SingleProcess,
            layout: &layout,
        };
        let b = right_hand_side(3 * n * n * n);
        let multigrid = Multigrid::new(
            space,
            &a.stiffness.pattern,
            &|slot| a.stiffness_block(slot),
            &points,
        );
        assert!(
            multigrid.sizes()[1] < 3 * n * n * n,
            "{:?}",
            multigrid.sizes()
        );
        let jacobi = BlockJacobi::new(&a);
        let of = |m: &dyn Preconditioner| converged(space, &a, m, &b, 1e-6).0;
        counts.push([of(&multigrid), of(&jacobi)]);
    }
    assert!(
        counts[1][0] <= counts[0][0] + 8 && 3 * counts[1][0] < counts[1][1],
        "{counts:?}"
    );
}

impl Entries for CondensedMatrix {
    fn pattern(&self) -> &Pattern {
        &self.stiffness.pattern
    }

    fn stiffness(&self, slot: usize) -> [[f64; 3]; 3] {
        let b = &self.stiffness.blocks[slot];
        std::array::from_fn(|i| std::array::from_fn(|j| b[3 * i + j]))
    }

    fn volume_of_row(&self, slot: usize) -> [f64; 3] {
        let pattern = &self.stiffness.pattern;
        let row = pattern.row_start.partition_point(|k| *k as usize <= slot) - 1;
        let turned = pattern.slot(pattern.column[slot], row as u32);
        self.volume_of_column(turned as usize)
    }

    fn volume_of_column(&self, slot: usize) -> [f64; 3] {
        self.coupling.as_ref().expect("a coupling").blocks[slot]
    }

    fn bulk(&self) -> &[f64] {
        &self.bulk
    }
}

#[test]
fn rigid_levels_save_most_iterations_and_survive_a_copy_in_numbers() {
    let n = 16;
    let (a, points) = lattice(n, 1e-3, 0.0);
    let layout = Layout::whole(n * n * n);
    let space = VectorLayout {
        comm: &SingleProcess,
        layout: &layout,
    };
    let b = right_hand_side(3 * n * n * n);
    let levels = RigidLevels::new(space, &a, &points, &points);
    let numbers = levels.numbers();
    let copy = RigidLevels::from_numbers(space, &points, &numbers);
    assert_eq!(copy.as_ref(), Some(&levels));
    assert_eq!(
        RigidLevels::from_numbers(space, &points, &numbers[..100]),
        None
    );
    let solved = |m: &dyn Preconditioner| converged(space, &a, m, &b, 1e-8);
    let (many, x) = solved(&BlockJacobi::new(&a));
    let (jacobi, levels) = (SingleBlockJacobi::new(&a), &levels);
    let (few, y) = solved(&WithLevels { jacobi, levels });
    assert!(5 * few < 2 * many, "{few} {many}");
    let largest = x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(
        x.iter()
            .zip(&y)
            .all(|(x, y)| (x - y).abs() < 1e-5 * largest)
    );
}

#[test]
fn an_indefinite_matrix_stops_conjugate_gradients_but_not_minres_and_gmres() {
    let (a, points) = lattice(5, -0.35, 0.0);
    let layout = Layout::whole(125);
    let space = VectorLayout {
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
    let space = VectorLayout {
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
