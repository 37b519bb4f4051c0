//! Tables of `docs/verification.md` about equilibrium under refinement, as CSV: `cargo run --release --manifest-path
//! dev/Cargo.toml --example verification-static beam|inflation|contraction|sphere|order`. With sizes, `NxLAYERS
//! ...`, those of a cohort's elements alone.

#[path = "../verification/mod.rs"]
mod verification;

use std::time::Instant;

use cardiotwin_linalg::KrylovSettings;
use cardiotwin_mechanics::newton::{LinearSolver, NewtonSettings};
use cardiotwin_mechanics::organ::ElementKind;
use cardiotwin_mechanics::statics::LoadSteps;
use verification::problems::{
    APEX_ENDO, APEX_EPI, BEAM_TIP, KAPPA_KPA, Problem, SPHERE, Solution, beam, compared,
    contraction, inflation, sphere,
};
use verification::sphere::{incompressible_pressure, inner_stretch};

/// Bulk moduli \[kPa\]: of the inflation, whose wall would grow by per cents at the customary one; of the convergence on
/// the sphere.
const INFLATION_KPA: f64 = 1e4;
const ORDER_KPA: f64 = 100.0;

/// Nodes of linear elements from which multigrid takes less time than a factorisation.
const LARGE: usize = 3000;

/// Load steps of a problem: as the library's, on large meshes with multigrid and at once from a guess.
fn steps(problem: &Problem, element: ElementKind, guessed: bool) -> LoadSteps {
    let first = if guessed { 1.0 } else { problem.first_step };
    if element.quadratic || problem.mesh.nodes.len() < LARGE {
        return LoadSteps {
            first,
            ..LoadSteps::default()
        };
    }
    // Loose: a displacement's error stays below a thousandth of a millimetre.
    let krylov = KrylovSettings {
        relative_tolerance: 0.1,
        ..KrylovSettings::default()
    };
    let linear = LinearSolver::Multigrid;
    let newton = NewtonSettings {
        linear,
        krylov,
        relative_tolerance: 1e-5,
        ..NewtonSettings::default()
    };
    LoadSteps {
        first,
        newton,
        grow_after: 1,
        ..LoadSteps::default()
    }
}

/// Meshes (edges a side, layers) that a table computes with linear elements, with a cohort's alone, with quadratic ones.
#[derive(Clone, Copy)]
struct Sizes<'a> {
    linear: &'a [(usize, usize)],
    large: &'a [(usize, usize)],
    quadratic: &'a [(usize, usize)],
}

/// A row for each element and size; a problem without a solution leaves its figures empty.
fn table(
    sizes: Sizes<'_>,
    problem: impl Fn(usize, usize) -> Problem,
    figures: impl Fn(&Solution) -> [f64; 3],
) {
    println!("element,size,layers,tets,dofs,a,b,c,newton,seconds");
    for (name, element) in compared() {
        let more = if element == ElementKind::default() {
            sizes.large
        } else {
            &[]
        };
        let mut coarse: Option<(Problem, Solution)> = None;
        for (k, &(n, layers)) in if element.quadratic {
            sizes.quadratic
        } else {
            sizes.linear
        }
        .iter()
        .chain(more)
        .enumerate()
        {
            let problem = problem(n, layers);
            let start = Instant::now();
            let large = k >= sizes.linear.len() && !element.quadratic;
            let before = coarse.as_ref().filter(|_| large);
            let guess = before
                .and_then(|(coarse, solution)| problem.interpolated(coarse, solution))
                .unwrap_or_default();
            let steps = steps(&problem, element, !guess.is_empty());
            match problem.solve_from(element, &steps, guess) {
                Ok(s) => {
                    let [a, b, c] = figures(&s);
                    let (tets, dofs, newton) =
                        (s.n_tets, s.degrees_of_freedom(), s.report.iterations());
                    let seconds = start.elapsed().as_secs_f64();
                    println!(
                        "{name},{n},{layers},{tets},{dofs},{a:.6},{b:.6},{c:.4},{newton},{seconds:.1}"
                    );
                    coarse = Some((problem, s));
                }
                Err(error) => {
                    eprintln!("{name}, {n} × {layers}: {error}");
                    println!("{name},{n},{layers},,,,,,,");
                }
            }
        }
    }
}

fn apices(s: &Solution) -> [f64; 3] {
    [
        s.position(APEX_ENDO)[2],
        s.position(APEX_EPI)[2],
        s.cavity_mm3,
    ]
}

/// Sizes that are named on the command line.
fn named(arguments: &[String]) -> Vec<(usize, usize)> {
    let size = |text: &String| {
        let (n, layers) = text.split_once('x')?;
        Some((n.parse().ok()?, layers.parse().ok()?))
    };
    arguments.iter().filter_map(size).collect()
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let named = named(&arguments);
    let sizes = |linear, large, quadratic| match named[..] {
        [] => Sizes {
            linear,
            large,
            quadratic,
        },
        _ => Sizes {
            linear: &[],
            large: &named,
            quadratic: &[],
        },
    };
    let pressure = incompressible_pressure(1.3);
    let stretch = |s: &Solution| s.position([SPHERE[0], 0.0, 0.0])[0] / SPHERE[0];
    match arguments.first().map(String::as_str) {
        Some("beam") => {
            let sizes = sizes(
                &[(2, 2), (3, 3), (4, 4), (6, 6), (8, 8)],
                &[(12, 12), (16, 16), (28, 28)],
                &[(1, 1), (2, 2), (3, 3), (4, 4)],
            );
            table(
                sizes,
                |n, _| beam(n, KAPPA_KPA),
                |s| {
                    let tip = s.position(BEAM_TIP);
                    [tip[0], tip[2], 0.0]
                },
            );
        }
        Some("inflation") => {
            let sizes = sizes(
                &[(4, 2), (6, 3), (8, 4)],
                &[(16, 8), (36, 18)],
                &[(2, 1), (3, 2), (4, 2), (6, 2)],
            );
            table(
                sizes,
                |n, layers| inflation(n, layers, INFLATION_KPA),
                apices,
            );
        }
        Some("contraction") => {
            let sizes = sizes(
                &[(2, 2), (4, 4), (6, 6), (8, 8)],
                &[(12, 12), (16, 16)],
                &[(2, 2), (3, 2), (3, 3), (4, 3)],
            );
            table(sizes, |n, layers| contraction(n, layers, KAPPA_KPA), apices);
        }
        Some("sphere") => {
            let sizes = sizes(&[(4, 2), (8, 3)], &[], &[(4, 2)]);
            table(
                sizes,
                |n, layers| sphere(n, layers, pressure, KAPPA_KPA),
                |s| [stretch(s), 1.3, 0.0],
            );
        }
        Some("order") => {
            let exact = inner_stretch(pressure, ORDER_KPA);
            let sizes = sizes(&[(4, 2), (8, 4), (16, 8)], &[], &[(2, 1), (4, 2), (8, 4)]);
            table(
                sizes,
                |n, layers| sphere(n, layers, pressure, ORDER_KPA),
                |s| [stretch(s), exact, 0.0],
            );
        }
        _ => {
            eprintln!("name one table: beam, inflation, contraction, sphere, order");
            std::process::exit(2);
        }
    }
}
