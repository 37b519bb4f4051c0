//! Tables of `docs/verification.md` about equilibrium under refinement, as CSV: `cargo run --release -p
//! cardiotwin-mechanics --example verification-static beam|inflation|contraction|sphere|order`.

#[path = "../verification/mod.rs"]
mod verification;

use std::time::Instant;

use cardiotwin_mechanics::statics::LoadSteps;
use verification::problems::{
    APEX_ENDO, APEX_EPI, BEAM_TIP, KAPPA_KPA, Problem, SPHERE, Solution, beam, compared, contraction, inflation, sphere,
};
use verification::sphere::{incompressible_pressure, inner_stretch};

/// Bulk moduli \[kPa\]: of the inflation, whose wall would grow by per cents at the customary one; of the convergence on
/// the sphere.
const INFLATION_KPA: f64 = 1e4;
const ORDER_KPA: f64 = 100.0;

/// A row for each element and size; a problem without a solution leaves its figures empty.
fn table(
    linear: &[(usize, usize)],
    quadratic: &[(usize, usize)],
    problem: impl Fn(usize, usize) -> Problem,
    figures: impl Fn(&Solution) -> [f64; 3],
) {
    println!("element,size,layers,tets,dofs,a,b,c,newton,seconds");
    for (name, element) in compared() {
        for &(n, layers) in if element.quadratic { quadratic } else { linear } {
            let problem = problem(n, layers);
            let start = Instant::now();
            let steps = LoadSteps { first: problem.first_step, ..LoadSteps::default() };
            match problem.solve_with(element, &steps) {
                Ok(s) => {
                    let [a, b, c] = figures(&s);
                    let (tets, dofs, newton) = (s.n_tets, s.degrees_of_freedom(), s.report.iterations());
                    let seconds = start.elapsed().as_secs_f64();
                    println!("{name},{n},{layers},{tets},{dofs},{a:.6},{b:.6},{c:.4},{newton},{seconds:.1}");
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
    [s.position(APEX_ENDO)[2], s.position(APEX_EPI)[2], s.cavity_mm3]
}

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let pressure = incompressible_pressure(1.3);
    let stretch = |s: &Solution| s.position([SPHERE[0], 0.0, 0.0])[0] / SPHERE[0];
    match wanted.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["beam"] => {
            let across = |n: &[usize]| n.iter().map(|n| (*n, *n)).collect::<Vec<_>>();
            let make = |n, _| beam(n, KAPPA_KPA);
            table(&across(&[2, 3, 4, 6, 8]), &across(&[1, 2, 3, 4]), make, |s| {
                let tip = s.position(BEAM_TIP);
                [tip[0], tip[2], 0.0]
            });
        }
        ["inflation"] => {
            let make = |n, layers| inflation(n, layers, INFLATION_KPA);
            table(&[(4, 2), (6, 3), (8, 4)], &[(2, 1), (3, 2), (4, 2), (6, 2)], make, apices);
        }
        ["contraction"] => {
            let make = |n, layers| contraction(n, layers, KAPPA_KPA);
            table(&[(2, 2), (4, 4), (6, 6), (8, 8)], &[(2, 2), (3, 2), (3, 3), (4, 3)], make, apices);
        }
        ["sphere"] => {
            table(
                &[(4, 2), (8, 3)],
                &[(4, 2)],
                |n, layers| sphere(n, layers, pressure, KAPPA_KPA),
                |s| [stretch(s), 1.3, 0.0],
            );
        }
        ["order"] => {
            let exact = inner_stretch(pressure, ORDER_KPA);
            let make = |n, layers| sphere(n, layers, pressure, ORDER_KPA);
            table(&[(4, 2), (8, 4), (16, 8)], &[(2, 1), (4, 2), (8, 4)], make, |s| [stretch(s), exact, 0.0]);
        }
        _ => {
            eprintln!("name one table: beam, inflation, contraction, sphere, order");
            std::process::exit(2);
        }
    }
}
