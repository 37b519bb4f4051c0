use super::*;
use crate::checks::{Defect, Expected, check};
use crate::ellipsoid::{EllipsoidSpec, generate};
use crate::files::LengthUnit;
use crate::surface::{boundary, openings};
use crate::test_meshes::{block, cube};
use crate::tet_mesh::Frame;
use cardiotwin_units::Ml;

fn heart() -> TetMesh {
    let spec = EllipsoidSpec {
        septum_deg: 0.0,
        ..EllipsoidSpec::new(Ml(120.0), Ml(130.0), 700)
    };
    generate(&spec).unwrap().mesh
}

const NEEDED: [&str; 3] = [
    surface_names::ENDOCARDIUM,
    surface_names::EPICARDIUM,
    surface_names::RIM,
];

fn defects(mesh: &TetMesh) -> Vec<Defect> {
    check(
        mesh,
        LengthUnit::Millimetre,
        &Expected {
            surfaces: &NEEDED,
            ..Expected::default()
        },
    )
}

fn cavity(mesh: &TetMesh) -> f64 {
    crate::Cavity::behind(&mesh.surface(surface_names::ENDOCARDIUM).unwrap().triangles)
        .unwrap()
        .volume(&mesh.nodes_mm)
        .0
}

#[test]
fn a_sound_mesh_stays_as_it_is() {
    let made = heart();
    let mut mesh = made.clone();
    let done = repair(&mut mesh, &Repair::default()).unwrap();
    assert_eq!(done.steps, Vec::<String>::new());
    assert_eq!(mesh, made);
}

#[test]
fn turned_doubled_unused_and_loose_things_are_mended() {
    let made = heart();
    let mut mesh = made.clone();
    mesh.tets[7].swap(0, 1);
    mesh.tets[300].swap(2, 3);
    // An element with a doubled node, an unused node, and a disconnected piece.
    let node = mesh.tets[11][2];
    mesh.nodes_mm.push(mesh.nodes_mm[node as usize]);
    mesh.tets[11][2] = mesh.n_nodes() as u32 - 1;
    let n = mesh.n_nodes() as u32;
    mesh.nodes_mm.extend([
        [99.0; 3],
        [0.0; 3],
        [5.0, 0.0, 0.0],
        [0.0, 5.0, 0.0],
        [0.0, 0.0, 5.0],
    ]);
    mesh.tets.push([n + 1, n + 2, n + 3, n + 4]);
    mesh.tags.push(1);
    let done = repair(
        &mut mesh,
        &Repair {
            keep_largest: true,
            ..Repair::default()
        },
    )
    .unwrap();
    assert_eq!(defects(&mesh), vec![], "{:?}", done.steps);
    assert_eq!(
        (mesh.n_nodes(), mesh.n_tets()),
        (made.n_nodes(), made.n_tets())
    );
    assert!((cavity(&mesh) - cavity(&made)).abs() < 1e-9);
    for said in [
        "1 doubled node merged",
        "2 turned elements turned back",
        "1 element of loose pieces removed",
    ] {
        assert!(
            done.steps.iter().any(|step| step == said),
            "{said} is not in {:?}",
            done.steps
        );
    }
}

#[test]
fn flat_elements_are_smoothed_without_moving_the_boundary() {
    let mut mesh = block([4, 4, 4], [40.0; 3]);
    let outer = boundary(&mesh);
    // Two inner nodes are moved until elements become flat.
    let inner = mesh
        .nodes_mm
        .iter()
        .position(|x| *x == [20.0, 20.0, 20.0])
        .unwrap();
    mesh.nodes_mm[inner] = [29.9, 20.1, 20.0];
    let other = mesh
        .nodes_mm
        .iter()
        .position(|x| *x == [10.0, 20.0, 10.0])
        .unwrap();
    mesh.nodes_mm[other] = [10.0, 29.95, 10.0];
    let worst = |mesh: &TetMesh| crate::quality::Quality::of(mesh).min;
    assert!(worst(&mesh) < crate::checks::DEGENERATE, "{}", worst(&mesh));
    let before = mesh.tissue_volume(&[]).0;
    repair(&mut mesh, &Repair::default()).unwrap();
    assert!(
        worst(&mesh) > crate::checks::POOR_WARNING,
        "{}",
        worst(&mesh)
    );
    assert!((mesh.tissue_volume(&[]).0 - before).abs() < 1e-9);
    assert_eq!(boundary(&mesh).len(), outer.len());
}

#[test]
fn tissue_that_touches_itself_is_parted() {
    // Two cubes of a block that share only an edge.
    let whole = block([2, 2, 1], [20.0, 20.0, 10.0]);
    let mut mesh = whole.clone();
    let keep: Vec<usize> = (0..whole.n_tets())
        .filter(|e| {
            let x = whole.centroid_mm(*e);
            (x[0] < 10.0) == (x[1] < 10.0)
        })
        .collect();
    mesh.tets = keep.iter().map(|e| whole.tets[*e]).collect();
    mesh.tags.truncate(keep.len());
    let done = repair(
        &mut mesh,
        &Repair {
            keep_shapes: true,
            ..Repair::default()
        },
    )
    .unwrap();
    assert!(
        done.steps
            .iter()
            .any(|step| step == "2 nodes parted where tissue touched itself"),
        "{:?}",
        done.steps
    );
    let triangles: Vec<[u32; 3]> = boundary(&mesh).iter().map(|face| face.triangle).collect();
    assert_eq!(openings(&triangles), Ok(vec![]));
    assert_eq!(mesh.n_tets(), keep.len());
}

#[test]
fn a_closed_shell_is_cut_open_at_a_plane() {
    let mut mesh = cube(6, 60.0);
    let inside = |x: [f64; 3]| x.iter().all(|c| (20.0..40.0).contains(c));
    let keep: Vec<bool> = (0..mesh.n_tets())
        .map(|e| !inside(mesh.centroid_mm(e)))
        .collect();
    nodes::keep_elements(&mut mesh, &keep);
    mesh.frames = vec![
        Frame {
            fibre: [1.0, 0.0, 0.0],
            sheet: [0.0, 1.0, 0.0],
            normal: [0.0, 0.0, 1.0]
        };
        mesh.n_tets()
    ];
    // An oblique plane, so that elements are cut in every way.
    let normal = crate::vec3::unit([0.2, 0.1, 1.0]).unwrap();
    let plane = Plane {
        point_mm: [30.0, 30.0, 33.0],
        normal,
    };
    let wanted = Repair {
        cut: Some(plane),
        rim_plane: Some(plane),
        ..Repair::default()
    };
    let done = repair(&mut mesh, &wanted).unwrap();
    assert_eq!(
        defects(&mesh)
            .iter()
            .filter(|d| d.severity() == crate::checks::Severity::Error)
            .count(),
        0,
        "{done:?}"
    );
    // Prisms under the plane: area times height at their centre. Snapping bends the inner cube's
    // walls slightly.
    let expected = (60.0 * 60.0 * 33.0 - 20.0 * 20.0 * 13.0) * 1e-3;
    assert!(
        (mesh.tissue_volume(&[]).0 / expected - 1.0).abs() < 0.01,
        "{} {expected}",
        mesh.tissue_volume(&[]).0
    );
    assert!((cavity(&mesh) / 5.2 - 1.0).abs() < 0.1, "{}", cavity(&mesh));
    assert_eq!(mesh.frames.len(), mesh.n_tets());
    assert!(mesh.nodes_mm.iter().all(|x| plane.above_mm(*x) < 1e-9));
}

#[test]
fn a_plug_is_taken_out_by_its_tag_and_the_rim_is_found() {
    // The lid of the shell is a plug.
    let mut mesh = cube(6, 60.0);
    let inside = |x: [f64; 3]| x.iter().all(|c| (20.0..40.0).contains(c));
    let keep: Vec<bool> = (0..mesh.n_tets())
        .map(|e| !inside(mesh.centroid_mm(e)))
        .collect();
    nodes::keep_elements(&mut mesh, &keep);
    for e in 0..mesh.n_tets() {
        let x = mesh.centroid_mm(e);
        if x[2] > 40.0 {
            mesh.tags[e] = if (20.0..40.0).contains(&x[0]) && (20.0..40.0).contains(&x[1]) {
                9
            } else {
                2
            };
        }
    }
    let mut closed = mesh.clone();
    repair(
        &mut closed,
        &Repair {
            find_surfaces: true,
            ..Repair::default()
        },
    )
    .unwrap();
    assert!(
        defects(&closed)
            .iter()
            .any(|defect| defect.name() == "closed-endocardium")
    );
    repair(
        &mut mesh,
        &Repair {
            remove_tags: vec![9],
            map_tags: [(2, 4)].into(),
            ..Repair::default()
        },
    )
    .unwrap();
    assert_eq!(defects(&mesh), vec![]);
    // The four sides of the plug are the rim: 2 × 2 cells each, of two triangles.
    assert_eq!(
        mesh.surface(surface_names::RIM).unwrap().triangles.len(),
        32
    );
    let mut tags = mesh.tags.clone();
    tags.sort_unstable();
    tags.dedup();
    assert_eq!(tags, [1, 4]);
}

#[test]
fn the_side_towards_tissue_that_is_not_kept_is_the_septum() {
    let mut mesh = heart();
    for surface in &mut mesh.surfaces {
        surface.name = format!("other-{}", surface.name);
    }
    // A right ventricle with another tag on one side of the outer wall; each outer face there gets
    // an element.
    let nodes = mesh.nodes_mm.clone();
    let outer = mesh
        .surfaces
        .iter()
        .find(|s| s.name.ends_with("epicardium"))
        .unwrap()
        .triangles
        .clone();
    let mut septal = 0;
    for [a, b, c] in outer {
        let middle: Vec3 = std::array::from_fn(|k| {
            [a, b, c].iter().map(|n| nodes[*n as usize][k]).sum::<f64>() / 3.0
        });
        if middle[0] > 10.0 {
            mesh.nodes_mm
                .push(crate::vec3::axpy(middle, 3.0, [1.0, 0.0, 0.0]));
            mesh.tets.push([a, b, c, mesh.n_nodes() as u32 - 1]);
            mesh.tags.push(5);
            septal += 1;
        }
    }
    repair(
        &mut mesh,
        &Repair {
            keep_tags: vec![1, 2],
            ..Repair::default()
        },
    )
    .unwrap();
    assert_eq!(
        mesh.surface(surface_names::SEPTUM).unwrap().triangles.len(),
        septal
    );
    assert_eq!(defects(&mesh), vec![]);
}

#[test]
fn a_septum_is_marked_around_a_point_and_surfaces_get_names() {
    let mut mesh = heart();
    let n_outer = mesh
        .surface(surface_names::EPICARDIUM)
        .unwrap()
        .triangles
        .len();
    for surface in &mut mesh.surfaces {
        if surface.name == surface_names::RIM {
            surface.name = "base".to_owned();
        }
    }
    let rename = [(surface_names::RIM.to_owned(), "base".to_owned())].into();
    let wanted = Repair {
        rename,
        septum: Some(([50.0, 0.0, -30.0], 120.0)),
        ..Repair::default()
    };
    repair(&mut mesh, &wanted).unwrap();
    assert_eq!(defects(&mesh), vec![]);
    let septum = mesh.surface(surface_names::SEPTUM).unwrap().triangles.len() as f64;
    assert!(
        (0.2..0.4).contains(&(septum / n_outer as f64)),
        "{septum} of {n_outer}"
    );
    let error = repair(
        &mut mesh,
        &Repair {
            rename: [("rim".into(), "lid".into())].into(),
            ..Repair::default()
        },
    );
    assert!(
        matches!(error, Err(RepairError::NoSurface { .. })),
        "{error:?}"
    );
}

#[test]
fn taking_everything_away_is_an_error() {
    let mut mesh = heart();
    let error = repair(
        &mut mesh,
        &Repair {
            keep_tags: vec![77],
            ..Repair::default()
        },
    )
    .unwrap_err();
    assert_eq!(
        error,
        RepairError::Nothing {
            after: "with these tags"
        }
    );
}
