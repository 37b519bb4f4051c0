//! Static verification under refinement, a table a problem: `cargo run --release --manifest-path dev/Cargo.toml --example
//! verification [fine] [beam|inflation|contraction|sphere] [element=P1] [kappa=1000]`.

#[path = "../verification/mod.rs"]
mod verification;

use std::time::Instant;

use verification::problems::{
    APEX_ENDO, APEX_EPI, BEAM_TIP, Element, KAPPA_KPA, P1, P2, P2_NODAL, Problem, SPHERE, Solution,
    beam, contraction, inflation, p1_nodal, sphere,
};

fn elements() -> Vec<(&'static str, Element)> {
    let all = [
        ("P1 pointwise", P1),
        ("P1 nodal, s = 0", p1_nodal(0.0)),
        ("P1 nodal, s = 0.02", p1_nodal(0.02)),
        ("P1 nodal, s = 0.05", p1_nodal(0.05)),
        ("P1 nodal, s = 0.2", p1_nodal(0.2)),
        ("P2 pointwise", P2),
        ("P2 nodal", P2_NODAL),
    ];
    let wanted = |name: &str| {
        std::env::args()
            .filter_map(|a| a.strip_prefix("element=").map(str::to_owned))
            .all(|w| name.starts_with(&w))
    };
    all.into_iter().filter(|(name, _)| wanted(name)).collect()
}

fn row(name: &str, problem: &Problem, element: Element, figures: impl Fn(&Solution) -> Vec<f64>) {
    let start = Instant::now();
    let steps = cardiotwin_mechanics::statics::LoadSteps {
        first: problem.first_step,
        ..Default::default()
    };
    match problem.solve_with(element, &steps) {
        Ok(solution) => {
            let figures: Vec<String> = figures(&solution)
                .iter()
                .map(|x| format!("{x:10.4}"))
                .collect();
            println!(
                "| {name:20} | {:7} | {:7} | {} | {:3} | {:4} | {:5} | {:6.1} |",
                solution.n_tets,
                solution.degrees_of_freedom(),
                figures.join(" | "),
                solution.report.steps.len(),
                solution.report.iterations(),
                solution.report.n_cut,
                start.elapsed().as_secs_f64()
            );
        }
        Err(error) => println!("| {name:20} | {} |", chain(error.as_ref())),
    }
}

fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        text += &format!(": {inner}");
        source = inner.source();
    }
    text
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let fine = arguments.iter().any(|a| a == "fine");
    let wanted = |name: &str| {
        let named = ["beam", "inflation", "contraction", "sphere"]
            .iter()
            .any(|n| arguments.iter().any(|a| a == n));
        !named || arguments.iter().any(|a| a == name)
    };
    let kappa = arguments
        .iter()
        .find_map(|a| a.strip_prefix("kappa=")?.parse().ok())
        .unwrap_or(KAPPA_KPA);
    if wanted("beam") {
        println!(
            "| beam                 | tets    | dofs    | tip x      | tip z (4.169) | steps | Newton | cut | s |"
        );
        for n in if fine { vec![2, 4, 8] } else { vec![2, 4] } {
            for (name, element) in elements() {
                if !(element.quadratic && n > 4) {
                    row(name, &beam(n, kappa), element, |s| {
                        s.position(BEAM_TIP)[..]
                            .iter()
                            .step_by(2)
                            .copied()
                            .collect()
                    });
                }
            }
        }
    }
    type Make = fn(usize, usize, f64) -> Problem;
    for (name, make) in [
        ("inflation", inflation as Make),
        ("contraction", contraction as Make),
    ] {
        if wanted(name) {
            println!(
                "| {name:20} | tets    | dofs    | endo z     | epi z      | cavity mm3 | steps | Newton | cut | s |"
            );
            for (n, layers) in if fine {
                vec![(3, 3), (4, 2), (6, 3), (12, 4)]
            } else {
                vec![(3, 3), (4, 2)]
            } {
                for (label, element) in elements() {
                    if !(element.quadratic && n > 8) {
                        row(label, &make(n, layers, kappa), element, |s| {
                            vec![
                                s.position(APEX_ENDO)[2],
                                s.position(APEX_EPI)[2],
                                s.cavity_mm3,
                            ]
                        });
                    }
                }
            }
        }
    }
    if wanted("sphere") {
        println!(
            "| sphere, 0.2125 kPa   | tets    | dofs    | λ inner (1.3) | λ outer (1.1918) | steps | Newton | cut | s |"
        );
        for (n, layers) in if fine {
            vec![(4, 2), (8, 3), (16, 6)]
        } else {
            vec![(4, 2), (8, 3)]
        } {
            for (label, element) in elements() {
                if !(element.quadratic && n > 8) {
                    row(
                        label,
                        &sphere(n, layers, 0.212_497_356, kappa),
                        element,
                        |s| SPHERE.map(|r| s.position([r, 0.0, 0.0])[0] / r).to_vec(),
                    );
                }
            }
        }
    }
}
