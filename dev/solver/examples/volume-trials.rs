//! Ways to resist a change of volume on linear tetrahedra, next to the library's and quadratic elements: `cargo run --release
//! --manifest-path dev/Cargo.toml --example volume-trials beam|inflation|contraction|sphere NxLAYERS ... [active=60] [quadratic=0]`.

#[path = "../verification/mod.rs"]
mod verification;

use std::time::Instant;

use cardiotwin_mechanics::material::{ActiveLaw, Tissue, Volumetric, VolumetricLaw};
use cardiotwin_mechanics::organ::{Anatomy, ElementKind, WallParameters};
use cardiotwin_mechanics::statics::LoadSteps;
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::tags;
use cardiotwin_mesh::tet_mesh::surface_names;
use cardiotwin_units::Ml;
use verification::meshes::Mesh;
use verification::patches::neighbours;
use verification::problems::{
    APEX_ENDO, APEX_EPI, BEAM_TIP, KAPPA_KPA, P2_NODAL, Problem, SPHERE, beam, contraction,
    inflation, p1_nodal, sphere,
};
use verification::sphere::incompressible_pressure;
use verification::volume_trials::{Trial, equilibrium};

/// Root of the mean square of what is left of `x` by its mean.
fn spread(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
}

/// A generated ventricle as a cohort has it, its base held, under a pressure and an active stress \[kPa\].
fn ventricle(n_nodes: usize, pressure_kpa: f64, active_kpa: f64) -> Problem {
    let made = generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), n_nodes)).expect("a ventricle");
    let mut mesh = made.mesh;
    make(&mut mesh, &[tags::LEFT_VENTRICLE], &FibreAngles::default()).expect("fibres");
    let anatomy =
        Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], ElementKind::LINEAR_NODAL).expect("an anatomy");
    let axis = anatomy.axis;
    let length = (0..3)
        .map(|i| (axis.base_mm[i] - axis.apex_mm[i]).powi(2))
        .sum::<f64>()
        .sqrt();
    let wall = WallParameters::default();
    let sides = vec![
        mesh.surface(surface_names::ENDOCARDIUM)
            .expect("an endocardium")
            .triangles
            .clone(),
    ];
    let nodes = anatomy.nodes.clone();
    Problem {
        mesh: Mesh {
            nodes: nodes.clone(),
            tets: mesh.tets,
            sides,
        },
        middle: Box::new(|_, _| None),
        frame: Box::new(move |e, x| anatomy.frame_at(&nodes, e, x)),
        tissue: Tissue {
            law: wall.muscle.with_stiffness(0.8),
            volumetric: Volumetric {
                law: VolumetricLaw::LnSquared,
                kappa_kpa: KAPPA_KPA,
            },
            active: Some(ActiveLaw::BENCHMARK),
            density: 1.0,
        },
        pressure: (0, pressure_kpa),
        fixed: Box::new(move |x| [axis.height(x) > 1.0 - 1e-6 / length; 3]),
        active_kpa,
        about: axis.base_mm,
        first_step: 0.1,
        copies: 1.0,
        grid: None,
    }
}

struct Row<'a> {
    problem: &'a Problem,
    points: &'a [([f64; 3], usize)],
    /// Pressures of quadratic elements.
    reference: Option<Vec<f64>>,
}

impl Row<'_> {
    #[expect(clippy::too_many_arguments, reason = "the columns of a table")]
    fn print(
        &self,
        name: &str,
        u: &[f64],
        pressure: &[f64],
        ratios: &[f64],
        cavity: f64,
        newton: usize,
        n_cut: usize,
        seconds: f64,
    ) {
        let nodes = &self.problem.mesh.nodes;
        let figures: Vec<String> = (self.points.iter())
            .map(|(at, axis)| {
                let distance =
                    |k: &usize| (0..3).map(|i| (nodes[*k][i] - at[i]).powi(2)).sum::<f64>();
                let k = (0..nodes.len())
                    .min_by(|a, b| distance(a).total_cmp(&distance(b)))
                    .expect("a node");
                format!("{:.4}", nodes[k][*axis] + u[3 * k + axis])
            })
            .collect();
        let figures: Vec<String> = figures
            .into_iter()
            .chain([format!("{cavity:.1}")])
            .collect();
        let pairs = neighbours(&self.problem.mesh.tets);
        let jumps = pairs
            .iter()
            .map(|(a, b)| (pressure[*a] - pressure[*b]).powi(2))
            .sum::<f64>()
            / pairs.len() as f64;
        let (jump, off) = match &self.reference {
            Some(reference) => {
                let apart: Vec<f64> = pressure.iter().zip(reference).map(|(a, b)| a - b).collect();
                let off = apart.iter().map(|x| x * x).sum::<f64>() / apart.len() as f64;
                (
                    jumps.sqrt() / spread(reference),
                    format!("{:.2}", off.sqrt() / spread(reference)),
                )
            }
            None => (jumps.sqrt() / spread(pressure), String::new()),
        };
        let extreme = |pick: fn(f64, f64) -> f64| ratios.iter().copied().reduce(pick);
        let range = match (extreme(f64::min), extreme(f64::max)) {
            (Some(least), Some(largest)) => format!("{least:.3} to {largest:.3}"),
            _ => String::new(),
        };
        println!(
            "| {name} | {} | {jump:.2} | {off} | {range} | {newton} | {n_cut} | {seconds:.1} |",
            figures.join(" | ")
        );
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str| {
        arguments
            .iter()
            .find_map(|a| a.strip_prefix(name)?.strip_prefix('=')?.parse::<f64>().ok())
    };
    let sizes = arguments.iter().filter_map(|a| {
        let (n, layers) = a.split_once('x')?;
        Some((n.parse::<usize>().ok()?, layers.parse::<usize>().ok()?))
    });
    let apices = [(APEX_ENDO, 2), (APEX_EPI, 2)];
    let tip = [(BEAM_TIP, 2)];
    let inner = [([SPHERE[0], 0.0, 0.0], 0)];
    for (n, layers) in sizes {
        // Shear modulus of the law at rest.
        let (mut problem, points, modulus) = match arguments[0].as_str() {
            "beam" => (beam(n, 1e3), &tip[..], 2.0),
            "inflation" => (inflation(n, layers, 1e4), &apices[..], 5.0),
            "contraction" => (contraction(n, layers, 1e3), &apices[..], 2.0),
            "ventricle" => (
                ventricle(n, number("pressure").unwrap_or(1.2), 0.0),
                &[][..],
                1.4,
            ),
            "sphere" => (
                sphere(n, layers, incompressible_pressure(1.3), 1e3),
                &inner[..],
                1.0,
            ),
            _ => panic!("beam, inflation, contraction or sphere"),
        };
        if let Some(active) = number("active") {
            problem.active_kpa = active;
        }
        println!(
            "{} {n} x {layers}, {} tetrahedra, {} vertices",
            arguments[0],
            problem.mesh.tets.len(),
            problem.mesh.nodes.len()
        );
        println!("| element | figures | jump of pressure | off quadratic | J | Newton | cut | s |");
        let mut row = Row {
            problem: &problem,
            points,
            reference: None,
        };
        let steps = LoadSteps {
            first: problem.first_step,
            ..LoadSteps::default()
        };
        let library = [
            ("quadratic nodal", P2_NODAL),
            ("linear nodal, 0.01", p1_nodal(0.01)),
        ];
        for (name, element) in library
            .into_iter()
            .skip(usize::from(number("quadratic") == Some(0.0)))
        {
            let start = Instant::now();
            match problem.solve_with(element, &steps) {
                Ok(s) => {
                    let seconds = start.elapsed().as_secs_f64();
                    row.print(
                        name,
                        &s.displacement,
                        &s.pressure_kpa,
                        &[],
                        s.cavity_mm3,
                        s.report.iterations(),
                        s.report.n_cut,
                        seconds,
                    );
                    if element == P2_NODAL {
                        row.reference = Some(s.pressure_kpa);
                    }
                }
                Err(error) => println!("| {name} | {error} |"),
            }
        }
        let mut trials = vec![];
        for share in [0.01, 0.005, 0.0] {
            trials.push((format!("nodal, {share}"), Trial::Nodal { share }));
        }
        for times in [0.1, 0.3, 1.0, 3.0, 10.0] {
            let name = format!("P1-P1, projection at {times} mu");
            trials.push((
                name,
                Trial::Projected {
                    modulus_kpa: times * modulus,
                },
            ));
        }
        for share in [0.0, 0.01] {
            trials.push((
                format!("patches of 8, {share}"),
                Trial::Patch { elements: 8, share },
            ));
        }
        for (name, trial) in trials {
            let start = Instant::now();
            match equilibrium(&problem, trial) {
                Ok(s) => {
                    let seconds = start.elapsed().as_secs_f64();
                    row.print(
                        &name,
                        &s.displacement,
                        &s.pressure_kpa,
                        &s.volume_ratio,
                        s.cavity_mm3,
                        s.newton,
                        s.n_cut,
                        seconds,
                    );
                }
                Err(reached) => {
                    println!("| {name} | fails at {:.1} % of the load |", 100.0 * reached)
                }
            }
        }
    }
}
