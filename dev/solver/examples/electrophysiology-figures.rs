//! Figures of `docs/electrophysiology.md`: `cargo run --release --manifest-path dev/Cargo.toml
//! --example electrophysiology-figures [cell] [waves] [ventricle] [large] [FILE.svg]` prints the
//! named tables and draws the potentials of a ventricle into a file. `traces` and `eikonal` print
//! the data of figures in `docs/verification.md` as CSV.

#[path = "../../../solver/electrophysiology/tests/common/action_potential.rs"]
mod action_potential;
#[path = "../../../solver/electrophysiology/tests/common/mod.rs"]
mod common;

use cardiotwin_electrophysiology::luo_rudy1991::paced::{Stimulus, paced, rest};
use cardiotwin_electrophysiology::{
    Membrane, Parameters, ReactionEikonal, Settings, State, Tissue,
};
use cardiotwin_mesh::eikonal::{Conduction, Site, Speeds, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::{TetMesh, tags};
use cardiotwin_units::{Ml, Ms};
use std::fmt::Write as _;
use std::time::Instant;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    if wanted.is_empty() {
        return Err(
            "name what to print: cell, waves, ventricle, large, traces, eikonal, or a file FILE.svg to draw into"
                .into(),
        );
    }
    for part in &wanted {
        match part.as_str() {
            "cell" => steps(),
            "waves" => edges()?,
            "traces" => traces(),
            "eikonal" => orders()?,
            "ventricle" => ventricle(&[2000, 8000])?,
            "large" => ventricle(&[64_000])?,
            file if file.ends_with(".svg") => std::fs::write(file, draw()?)?,
            other => {
                return Err(format!(
                    "{other} is neither cell, waves, ventricle, large, traces, eikonal nor a .svg file"
                )
                .into());
            }
        }
    }
    Ok(())
}

/// Compares the action potential of a single cell with Myokit's, for several step lengths.
fn steps() {
    println!(
        "single cell minus reference: step/ms  beats  away/mV  peak/mV  upstroke/ms  APD90/ms  off/ms  rest/mV  calcium"
    );
    for (name, cycle_ms, n_beats) in [
        ("rest", 600.0, 1),
        ("cycle-1000ms", 1000.0, 8),
        ("cycle-600ms", 600.0, 10),
    ] {
        for step_ms in [0.00625, 0.025, 0.05, 0.1] {
            let found = action_potential::compare(name, cycle_ms, n_beats, step_ms);
            println!(
                "{step_ms:>35}  {name}  {:.2}  {:.2}  {:.3}  {:.1}  {:.2}  {:.3}  {:.1e}",
                found.away_mv,
                found.peak_mv,
                found.upstroke_ms,
                found.apd90_ms,
                found.apd90_off_ms,
                found.rest_mv,
                found.calcium
            );
        }
    }
}

/// Prints action potentials and Myokit's at its sample times.
fn traces() {
    println!("beat,t_ms,myokit_mv,here_mv");
    for (name, cycle_ms, n_beats) in [
        ("rest", 600.0, 1),
        ("cycle-1000ms", 1000.0, 8),
        ("cycle-600ms", 600.0, 10),
    ] {
        let here = action_potential::simulated(cycle_ms, n_beats, 0.025);
        for [t, v, _] in action_potential::reference(name) {
            println!("{name},{t},{v:.4},{:.4}", action_potential::at(&here, t, 1));
        }
    }
}

/// Largest errors of the eikonal's times in a cube of 20 mm with oblique fibres, for a point source
/// in its centre, the same with exact times in a ball of 6 mm around it, and a plane wave along
/// fibres from a face.
fn orders() -> Result<(), Failure> {
    println!("side_mm,point_ms,ball_ms,plane_ms");
    let speeds = Speeds {
        fibre: 0.6,
        sheet: 0.4,
        normal: 0.25,
    };
    let along = [speeds.fibre, speeds.sheet, speeds.normal];
    for n in [6, 12, 24] {
        let mesh = common::block([n; 3], [20.0; 3], [1.0, 2.0, 0.5]);
        let times = |mesh: &TetMesh, sites: Vec<Site>| {
            activation_ms(
                mesh,
                &Conduction {
                    speeds,
                    endocardial_speed: None,
                    tags: vec![1],
                    sites,
                },
            )
        };
        let axes = mesh.frames[0];
        let from_middle = |x: &[f64; 3]| {
            let part = |axis: [f64; 3]| (0..3).map(|i| axis[i] * (x[i] - 10.0)).sum::<f64>();
            let parts = [axes.fibre, axes.sheet, axes.normal].map(part);
            (0..3)
                .map(|i| (parts[i] / along[i]).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let largest = |mesh: &TetMesh, times: &[f64], exact: &dyn Fn(&[f64; 3]) -> f64| {
            mesh.nodes_mm
                .iter()
                .zip(times)
                .map(|(x, t)| (t - exact(x)).abs())
                .fold(0.0, f64::max)
        };
        let mut errors = vec![];
        for radius_mm in [0.0, 6.0] {
            let site = Site {
                at_mm: [10.0; 3],
                radius_mm,
                time: Ms(0.0),
            };
            errors.push(largest(&mesh, &times(&mesh, vec![site])?, &from_middle));
        }
        let straight = common::block([n; 3], [20.0; 3], [1.0, 0.0, 0.0]);
        let face = straight.nodes_mm.iter().filter(|x| x[0] == 0.0);
        let sites = face
            .map(|x| Site {
                at_mm: *x,
                radius_mm: 0.0,
                time: Ms(0.0),
            })
            .collect();
        let plane = largest(&straight, &times(&straight, sites)?, &|x| {
            x[0] / speeds.fibre
        });
        println!(
            "{:.4},{:.6},{:.6},{plane:.2e}",
            20.0 / n as f64,
            errors[0],
            errors[1]
        );
    }
    Ok(())
}

/// Wave speed along the fibre on increasingly coarse bars, with the eikonal and with diffusion
/// alone.
fn edges() -> Result<(), Failure> {
    println!(
        "\nplane wave along the fibre, eikonal 0.6 mm/ms: edge/mm  led  diffusion alone (mm/ms)"
    );
    for edge_mm in [0.35, 0.69, 1.5, 3.5] {
        let side = edge_mm / 1.2612;
        let n = (24.0_f64 / side).ceil() as usize;
        let mesh = common::block(
            [n, 2, 2],
            [n as f64 * side, 2.0 * side, 2.0 * side],
            [1.0, 0.0, 0.0],
        );
        let speed = |led: bool| -> Result<f64, Failure> {
            let faces = mesh.nodes_mm.iter().filter(|x| x[0] == 0.0);
            let sites = faces
                .map(|x| Site {
                    at_mm: *x,
                    radius_mm: 0.0,
                    time: Ms(0.0),
                })
                .collect();
            let speeds = Speeds::default();
            let conduction = Conduction {
                speeds,
                endocardial_speed: None,
                tags: vec![1],
                sites,
            };
            let mut times = activation_ms(&mesh, &conduction)?;
            if !led {
                for (time, x) in times.iter_mut().zip(&mesh.nodes_mm) {
                    *time = if x[0] > 1.5_f64.max(1.1 * side) {
                        f64::INFINITY
                    } else {
                        0.0
                    };
                }
            }
            let start = rest(&Parameters::default());
            let tissue = Tissue::matching(&speeds);
            let mut model =
                ReactionEikonal::new(&mesh, &[1], &times, &tissue, &start, &Settings::default())?;
            model.advance_to(100.0)?;
            let up = &model.crossings().up_ms;
            let at = |x: f64| {
                let near = |i: &usize| (mesh.nodes_mm[*i][0] - x).abs();
                (0..mesh.n_nodes())
                    .min_by(|a, b| near(a).total_cmp(&near(b)))
                    .unwrap_or(0)
            };
            let (a, b) = (at(8.0), at(20.0));
            Ok((mesh.nodes_mm[b][0] - mesh.nodes_mm[a][0]) / (up[b] - up[a]))
        };
        println!("{edge_mm:>53}  {:.3}  {:.3}", speed(true)?, speed(false)?);
    }
    Ok(())
}

fn heart(n_nodes: usize) -> Result<(TetMesh, Vec<f64>), Failure> {
    let made = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), n_nodes))?;
    let mut mesh = made.mesh;
    let muscle = &[tags::LEFT_VENTRICLE];
    make(&mut mesh, muscle, &FibreAngles::default())?;
    let conduction = Conduction::of_left_ventricle(&made.shape.fascicles());
    let times = activation_ms(&mesh, &conduction)?;
    Ok((mesh, times))
}

/// State of a cell paced at 75 beats per minute.
fn start() -> State {
    let parameters = Parameters::default();
    paced(
        &Membrane::new(parameters.clone(), 0.025),
        &rest(&parameters),
        &Stimulus::default(),
        800.0,
        10,
    )
}

fn ventricle(sizes: &[usize]) -> Result<(), Failure> {
    println!(
        "\nventricle, 80 ms: nodes  edge/mm  variant  upstroke behind eikonal/ms (min mean max)  CG/step  ns/(node step)"
    );
    let start = start();
    for n_nodes in sizes.iter().copied() {
        let (mesh, times) = heart(n_nodes)?;
        for diffusion in [true, false] {
            let settings = Settings {
                diffusion,
                ..Settings::default()
            };
            let tissue = Tissue::matching(&Speeds::default());
            let mut model = ReactionEikonal::new(
                &mesh,
                &[tags::LEFT_VENTRICLE],
                &times,
                &tissue,
                &start,
                &settings,
            )?;
            let begun = Instant::now();
            model.advance_to(80.0)?;
            let cost = begun.elapsed().as_secs_f64() / (3200.0 * model.nodes().len() as f64) * 1e9;
            let up = &model.crossings().up_ms;
            let lag: Vec<f64> = model
                .nodes()
                .iter()
                .zip(up)
                .map(|(node, up)| up - times[*node as usize])
                .collect();
            let mean = lag.iter().sum::<f64>() / lag.len() as f64;
            let (least, most) = lag
                .iter()
                .fold((f64::MAX, f64::MIN), |(a, b), lag| (lag.min(a), lag.max(b)));
            let (edge, cg) = (mesh.mean_edge_mm(), model.mean_iterations());
            let name = if diffusion { "R-E+" } else { "R-E-" };
            let nodes = model.nodes().len();
            println!(
                "{nodes:>24}  {edge:>7.2}  {name:>7}  {least:>28.2} {mean:.2} {most:.2}  {cg:>17.1}  {cost:>13.0}"
            );
        }
    }
    Ok(())
}

/// Section through the axis, coloured by potential, at several times.
fn draw() -> Result<String, Failure> {
    let (mesh, times) = heart(8000)?;
    let tissue = Tissue::matching(&Speeds::default());
    let muscle = &[tags::LEFT_VENTRICLE];
    let mut model = ReactionEikonal::new(
        &mesh,
        muscle,
        &times,
        &tissue,
        &start(),
        &Settings::default(),
    )?;
    let half_edge = 0.5 * mesh.mean_edge_mm();
    let low = |k: usize| mesh.nodes_mm.iter().map(|x| x[k]).fold(f64::MAX, f64::min);
    let high = |k: usize| mesh.nodes_mm.iter().map(|x| x[k]).fold(f64::MIN, f64::max);
    let (width, height) = (high(0) - low(0) + 12.0, high(2) - low(2));
    let shown = [10.0, 25.0, 40.0, 150.0, 280.0, 320.0];
    let whole = width * shown.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {whole:.0} {:.0}\" font-family=\"sans-serif\" font-size=\"5\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        height + 30.0
    );
    for (panel, t) in shown.into_iter().enumerate() {
        model.advance_to(t)?;
        let v = model.potential_mv();
        let left = width * panel as f64 + 6.0;
        writeln!(svg, "<text x=\"{left:.1}\" y=\"7\">{t} ms</text>")?;
        for (x, v) in mesh
            .nodes_mm
            .iter()
            .zip(&v)
            .filter(|(x, v)| x[1].abs() < half_edge && v.is_finite())
        {
            let hue = 240.0 * (1.0 - ((v + 85.0) / 110.0).clamp(0.0, 1.0));
            let (cx, cy) = (left + x[0] - low(0), 12.0 + high(2) - x[2]);
            writeln!(
                svg,
                "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"1.4\" fill=\"hsl({hue:.0},80%,50%)\"/>"
            )?;
        }
    }
    for i in 0..=10 {
        let v = -85.0 + 11.0 * f64::from(i);
        let (x, y) = (6.0 + 14.0 * f64::from(i), height + 18.0);
        let hue = 240.0 * (1.0 - (v + 85.0) / 110.0);
        writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y:.1}\" width=\"14\" height=\"4\" fill=\"hsl({hue:.0},80%,50%)\"/>"
        )?;
        writeln!(
            svg,
            "<text x=\"{x}\" y=\"{:.1}\" font-size=\"4\">{v:.0}</text>",
            y + 9.0
        )?;
    }
    writeln!(
        svg,
        "<text x=\"165\" y=\"{:.1}\">mV</text>\n</svg>",
        height + 22.0
    )?;
    Ok(svg)
}
