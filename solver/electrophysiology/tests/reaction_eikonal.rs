//! The reaction-eikonal wave compared with the eikonal solution, on meshes as coarse as in organ
//! simulations.

mod common;

use cardiotwin_electrophysiology::luo_rudy1991::paced::rest;
use cardiotwin_electrophysiology::{Crossings, Parameters, ReactionEikonal, Settings, Tissue};
use cardiotwin_linalg::vec3::{Vec3, distance};
use cardiotwin_mesh::TetMesh;
use cardiotwin_mesh::eikonal::{Conduction, Site, Speeds, activation_ms};
use cardiotwin_units::Ms;
use common::block;

const SPEEDS: Speeds = Speeds {
    fibre: 0.6,
    sheet: 0.3,
    normal: 0.3,
};
/// Side of a cell. The edges of a cube divided into six tetrahedra have a mean length of 1.26
/// sides, here 0.69 mm.
const SIDE_MM: f64 = 0.69 / 1.2612;

fn eikonal(mesh: &TetMesh, sites: Vec<Site>) -> Vec<f64> {
    let conduction = Conduction {
        speeds: SPEEDS,
        endocardial_speed: None,
        tags: vec![1],
        sites,
    };
    activation_ms(mesh, &conduction).unwrap()
}

fn face(mesh: &TetMesh) -> Vec<Site> {
    let nodes = mesh.nodes_mm.iter().filter(|x| x[0] == 0.0);
    nodes
        .map(|x| Site {
            at_mm: *x,
            radius_mm: 0.0,
            time: Ms(0.0),
        })
        .collect()
}

fn model(mesh: &TetMesh, times: &[f64], settings: &Settings) -> ReactionEikonal {
    let start = rest(&Parameters::default());
    ReactionEikonal::new(
        mesh,
        &[1],
        times,
        &Tissue::matching(&SPEEDS),
        &start,
        settings,
    )
    .unwrap()
}

/// Slope of the regression of y on x, and the standard deviation of the residuals.
fn regression(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let (mx, my) = (
        points.iter().map(|p| p.0).sum::<f64>() / n,
        points.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let xx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let xy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    let slope = xy / xx;
    let rest: f64 = points
        .iter()
        .map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2))
        .sum();
    (slope, (rest / n).sqrt())
}

/// Upstroke speed in a bar with the mesh size of organs, away from its ends \[mm/ms\]; `None` if
/// the wave dies out.
fn plane_wave_speed(fibre: Vec3, length_mm: f64, led: bool) -> Option<f64> {
    let n = (length_mm / SIDE_MM).round() as usize;
    let mesh = block(
        [n, 3, 3],
        [n as f64 * SIDE_MM, 3.0 * SIDE_MM, 3.0 * SIDE_MM],
        fibre,
    );
    assert!(
        (mesh.mean_edge_mm() - 0.69).abs() < 0.002,
        "{}",
        mesh.mean_edge_mm()
    );
    let mut times = eikonal(&mesh, face(&mesh));
    if !led {
        // Only the face is activated; diffusion has to propagate the wave.
        for (time, x) in times.iter_mut().zip(&mesh.nodes_mm) {
            *time = if x[0] > 1.5 * SIDE_MM {
                f64::INFINITY
            } else {
                0.0
            };
        }
    }
    let mut model = model(&mesh, &times, &Settings::default());
    model.advance_to(120.0).unwrap();
    let up = &model.crossings().up_ms;
    let inner = |x: f64| x > 0.3 * length_mm && x < 0.85 * length_mm;
    let points: Vec<(f64, f64)> = mesh
        .nodes_mm
        .iter()
        .zip(up)
        .filter(|(x, _)| inner(x[0]))
        .map(|(x, t)| (x[0], *t))
        .collect();
    points
        .iter()
        .all(|(_, t)| t.is_finite())
        .then(|| 1.0 / regression(&points).0)
}

#[test]
fn a_plane_wave_keeps_the_speed_of_the_eikonal_to_two_per_cent_on_a_coarse_mesh() {
    for (fibre, length_mm, speed) in [([1.0, 0.0, 0.0], 20.0, 0.6), ([0.0, 1.0, 0.0], 12.0, 0.3)] {
        let led = plane_wave_speed(fibre, length_mm, true);
        assert!(
            led.is_some_and(|led| (led / speed - 1.0).abs() < 0.02),
            "{led:?} instead of {speed} mm/ms"
        );
        // The eikonal maintains the wave: on this mesh, diffusion alone is too slow, or the wave
        // dies out.
        let alone = plane_wave_speed(fibre, length_mm, false);
        assert!(
            alone.is_none_or(|alone| alone < 0.95 * speed),
            "{alone:?} of {speed} mm/ms without the eikonal"
        );
    }
}

/// Lag of the upstroke behind the eikonal's time: slope of the upstroke's time over the eikonal's,
/// and the residual spread \[ms\].
fn point_source(mesh: &TetMesh, settings: &Settings, centre: Vec3) -> (f64, f64) {
    let times = eikonal(
        mesh,
        vec![Site {
            at_mm: centre,
            radius_mm: 1.5,
            time: Ms(0.0),
        }],
    );
    let mut model = model(mesh, &times, settings);
    model.advance_to(40.0).unwrap();
    let up = &model.crossings().up_ms;
    assert!(up.iter().all(|t| t.is_finite()), "every node fires");
    let away = mesh
        .nodes_mm
        .iter()
        .zip(times.iter().zip(up))
        .filter(|(x, _)| distance(**x, centre) > 3.0);
    regression(&away.map(|(_, (t, up))| (*t, *up)).collect::<Vec<_>>())
}

#[test]
fn a_point_source_keeps_the_times_of_the_eikonal_with_and_without_diffusion() {
    let n = 16;
    let length = n as f64 * SIDE_MM;
    let mut mesh = block([n; 3], [length; 3], [1.0, 2.0, 0.5]);
    // An irregular mesh, with inner nodes moved by up to a fifth of the side.
    let mut seed = 1_u64;
    let mut random = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    for x in &mut mesh.nodes_mm {
        if x.iter()
            .all(|x| *x > 0.5 * SIDE_MM && *x < length - 0.5 * SIDE_MM)
        {
            *x = x.map(|x| x + 0.4 * SIDE_MM * random());
        }
    }
    assert!((0..mesh.n_tets()).all(|e| mesh.volume_mm3(e) > 0.0));
    for diffusion in [true, false] {
        let settings = Settings {
            diffusion,
            ..Settings::default()
        };
        let (slope, spread) = point_source(&mesh, &settings, [0.5 * length; 3]);
        assert!(
            (slope - 1.0).abs() < 0.02,
            "diffusion {diffusion}: slope {slope}"
        );
        assert!(spread < 0.5, "diffusion {diffusion}: spread {spread} ms");
    }
}

/// Basis of [`Tissue::matching`]: the speed by diffusion alone, on bars fine enough for
/// extrapolation.
#[test]
fn the_wave_without_eikonal_has_the_stated_speed() {
    let tissue = Tissue::matching(&SPEEDS);
    let speed = |side_mm: f64| {
        let n = (9.0 / side_mm).round() as usize;
        let mesh = block([n, 1, 1], [9.0, side_mm, side_mm], [1.0, 0.0, 0.0]);
        let times: Vec<f64> = mesh
            .nodes_mm
            .iter()
            .map(|x| if x[0] > 1.0 { f64::INFINITY } else { 0.0 })
            .collect();
        let settings = Settings {
            step_ms: 0.005,
            ..Settings::default()
        };
        let start = rest(&Parameters::default());
        let mut model =
            ReactionEikonal::new(&mesh, &[1], &times, &tissue, &start, &settings).unwrap();
        model.advance_to(22.0).unwrap();
        let up = &model.crossings().up_ms;
        let inner = mesh
            .nodes_mm
            .iter()
            .zip(up)
            .filter(|(x, _)| x[0] > 4.0 && x[0] < 7.5);
        1.0 / regression(&inner.map(|(x, t)| (x[0], *t)).collect::<Vec<_>>()).0
    };
    let [coarse, fine] = [0.1, 0.05].map(speed);
    // Lumped linear elements are of second order.
    let limit = fine + (fine - coarse) / 3.0;
    assert!(
        (limit / SPEEDS.fibre - 1.0).abs() < 0.02,
        "{coarse} {fine} {limit}"
    );
}

#[test]
fn times_may_come_from_a_file_and_a_second_beat_follows_the_first() {
    let mesh = block([6, 2, 2], [6.0, 2.0, 2.0], [1.0, 0.0, 0.0]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("activation.dat");
    let text: String = mesh
        .nodes_mm
        .iter()
        .map(|x| format!("{}\n", 2.0 + 0.5 * x[0]))
        .collect();
    std::fs::write(&path, text).unwrap();
    let times = cardiotwin_mesh::files::node_values::read(&path, mesh.n_nodes()).unwrap();
    let settings = Settings {
        cycle_ms: Some(450.0),
        ..Settings::default()
    };
    let mut model = model(&mesh, &times, &settings);
    model.advance_to(449.0).unwrap();
    let Crossings {
        up_ms: first,
        down_ms: fall,
    } = model.crossings().clone();
    for (time, (up, down)) in times.iter().zip(first.iter().zip(&fall)) {
        assert!((0.0..2.0).contains(&(up - time)), "{time} {up}");
        assert!((200.0..420.0).contains(&(down - up)), "{up} {down}");
    }
    model.advance_to(520.0).unwrap();
    for (up, again) in first.iter().zip(&model.crossings().up_ms) {
        assert!((again - up - 450.0).abs() < 1.0, "{up} {again}");
    }
}

#[test]
fn a_run_from_a_snapshot_equals_the_run_without() {
    let mesh = block([5, 2, 2], [5.0, 2.0, 2.0], [1.0, 0.0, 0.0]);
    let times = eikonal(&mesh, face(&mesh));
    let mut whole = model(&mesh, &times, &Settings::default());
    whole.advance_to(7.0).unwrap();
    let kept = whole.snapshot().clone();
    whole.advance_to(30.0).unwrap();
    let mut other = model(&mesh, &times, &Settings::default());
    other.restore(kept).unwrap();
    other.advance_to(30.0).unwrap();
    assert_eq!(whole.snapshot().cells, other.snapshot().cells);
    assert_eq!(whole.t_ms(), other.t_ms());
    let small = block([1, 1, 1], [1.0; 3], [1.0, 0.0, 0.0]);
    let few = model(&small, &[0.0; 8], &Settings::default());
    let told = other
        .restore(few.snapshot().clone())
        .unwrap_err()
        .to_string();
    assert!(told.contains("8 conducting nodes, expected 54"), "{told}");
}

#[test]
fn passive_tissue_has_no_potential_and_errors_name_their_cause() {
    let mut mesh = block([4, 1, 1], [4.0, 1.0, 1.0], [1.0, 0.0, 0.0]);
    for e in 18..24 {
        mesh.tags[e] = 2;
    }
    let times: Vec<f64> = mesh
        .nodes_mm
        .iter()
        .map(|x| if x[0] > 3.0 { f64::INFINITY } else { x[0] })
        .collect();
    let mut good = model(&mesh, &times, &Settings::default());
    good.advance_to(10.0).unwrap();
    let v = good.potential_mv();
    assert!(
        mesh.nodes_mm
            .iter()
            .zip(&v)
            .all(|(x, v)| v.is_nan() == (x[0] > 3.0))
    );
    assert_eq!(good.nodes().len(), 16);

    let start = rest(&Parameters::default());
    let tissue = Tissue::matching(&SPEEDS);
    let told = |mesh: &TetMesh, tag: i32, times: &[f64], tissue: &Tissue, settings: &Settings| {
        ReactionEikonal::new(mesh, &[tag], times, tissue, &start, settings)
            .unwrap_err()
            .to_string()
    };
    let usual = Settings::default();
    assert!(told(&mesh, 9, &times, &tissue, &usual).contains("conducting tags [9]"));
    assert!(
        told(&mesh, 1, &times[1..], &tissue, &usual)
            .contains("19 activation times for a mesh of 20 nodes")
    );
    let late = Settings {
        cycle_ms: Some(2.5),
        ..usual.clone()
    };
    assert!(
        told(&mesh, 1, &times, &tissue, &late)
            .contains("activated at 3 ms, expected a time from 0 on and below")
    );
    let apart = Settings {
        diffusion: false,
        ..usual.clone()
    };
    assert!(
        told(&mesh, 1, &[f64::INFINITY; 20], &tissue, &apart)
            .contains("known wherever tissue conducts")
    );
    assert!(told(&mesh, 1, &[f64::INFINITY; 20], &tissue, &usual).contains("at one node at least"));
    let dead = Tissue {
        conductivity_ms_mm: [0.1, 0.0, 0.1],
        ..tissue
    };
    assert!(told(&mesh, 1, &times, &dead, &usual).contains("along the sheet in mS/mm is 0"));
    let mut flat = mesh.clone();
    flat.nodes_mm[0] = flat.nodes_mm[1];
    assert!(told(&flat, 1, &times, &tissue, &usual).contains("has no positive volume"));
    mesh.frames.clear();
    assert!(told(&mesh, 1, &times, &tissue, &usual).contains("make fibres first"));
}

#[test]
fn a_potential_out_of_hand_is_reported() {
    let mesh = block([2, 1, 1], [2.0, 1.0, 1.0], [1.0, 0.0, 0.0]);
    let settings = Settings {
        step_ms: 5.0,
        diffusion: false,
        ..Settings::default()
    };
    let wild = Parameters {
        g_b: 1e6,
        ..Parameters::default()
    };
    let mut model = model(
        &mesh,
        &[0.0; 12],
        &Settings {
            membrane: wild,
            ..settings
        },
    );
    let told = model.advance_to(500.0).unwrap_err().to_string();
    assert!(told.contains("try a shorter step"), "{told}");
}
