//! Mesh files: round trips, files of other programs, and error messages for invalid files.

use cardiotwin_mesh::cavity::Cavity;
use cardiotwin_mesh::checks::{Expected, check};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::files::{LengthUnit, carp, gmsh, node_values, vtu};
use cardiotwin_mesh::find_surfaces::find_surfaces;
use cardiotwin_mesh::surface::sorted;
use cardiotwin_mesh::tet_mesh::{Frame, surface_names};
use cardiotwin_mesh::{Surface, TetMesh};
use cardiotwin_units::Ml;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// The left ventricle of Aróstica et al. 2025; see its README for source and licence.
fn arostica() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/meshes/arostica_lv/arostica_lv")
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

fn small() -> TetMesh {
    let mut mesh = generate(&EllipsoidSpec::new(Ml(80.0), Ml(90.0), 500))
        .unwrap()
        .mesh;
    mesh.frames = (0..mesh.n_tets())
        .map(|e| {
            let (sin, cos) = (e as f64).sin_cos();
            Frame {
                fibre: [cos, sin, 0.0],
                sheet: [-sin, cos, 0.0],
                normal: [0.0, 0.0, 1.0],
            }
        })
        .collect();
    mesh
}

/// Asserts equality except for the last digits of directions and, if `ulp` > 0, of positions.
fn assert_same(a: &TetMesh, b: &TetMesh, ulp: f64) {
    assert_eq!((&a.tets, &a.tags), (&b.tets, &b.tags));
    let by_name = |mesh: &TetMesh| {
        let mut surfaces = mesh.surfaces.clone();
        surfaces.sort_by(|a, b| a.name.cmp(&b.name));
        surfaces
    };
    assert_eq!(by_name(a), by_name(b));
    for (x, y) in a.nodes_mm.iter().flatten().zip(b.nodes_mm.iter().flatten()) {
        assert!((x - y).abs() <= ulp * x.abs(), "{x} {y}");
    }
    assert_eq!(a.frames.len(), b.frames.len());
    for (f, g) in a.frames.iter().zip(&b.frames) {
        for (x, y) in [f.fibre, f.sheet, f.normal]
            .iter()
            .flatten()
            .zip([g.fibre, g.sheet, g.normal].iter().flatten())
        {
            assert!((x - y).abs() < 1e-14);
        }
    }
}

#[test]
fn the_benchmark_ventricle_has_its_published_volumes_and_its_surfaces_are_found() {
    let mesh = carp::read(&arostica(), LengthUnit::Micrometre).unwrap();
    assert_eq!((mesh.n_nodes(), mesh.n_tets()), (4577, 17_625));
    assert!((mesh.tissue_volume(&[]).0 - 177.695).abs() < 1e-3);
    let endo = mesh.surface("endo").unwrap();
    let cavity = Cavity::behind(&endo.triangles).unwrap();
    assert_eq!(cavity.openings.len(), 1);
    assert!(
        (cavity.volume(&mesh.nodes_mm).0 - 167.518).abs() < 1e-3,
        "{}",
        cavity.volume(&mesh.nodes_mm)
    );
    let expected = Expected {
        muscle_tags: &[1],
        surfaces: &["endo", "epi", "base"],
        ..Expected::default()
    };
    assert_eq!(check(&mesh, LengthUnit::Micrometre, &expected), vec![]);
    let set = |surface: &Surface| {
        surface
            .triangles
            .iter()
            .map(|t| sorted(*t))
            .collect::<std::collections::BTreeSet<_>>()
    };
    let found = find_surfaces(&mesh).unwrap();
    let names = [
        (surface_names::ENDOCARDIUM, "endo"),
        (surface_names::EPICARDIUM, "epi"),
        (surface_names::RIM, "base"),
    ];
    for (ours, theirs) in names {
        let found = found.iter().find(|surface| surface.name == ours).unwrap();
        assert_eq!(set(found), set(mesh.surface(theirs).unwrap()), "{ours}");
    }
}

#[test]
fn carp_files_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let stem = folder.path().join("heart");
    let mesh = small();
    carp::write(&mesh, &stem).unwrap();
    assert_same(
        &mesh,
        &carp::read(&stem, LengthUnit::Micrometre).unwrap(),
        1e-15,
    );
    let vtx = folder.path().join("apex.vtx");
    carp::write_vtx(&[4, 0, 17], &vtx).unwrap();
    assert_eq!(carp::read_vtx(&vtx, 18).unwrap(), [4, 0, 17]);
    assert!(carp::read_vtx(&vtx, 17).unwrap_err().to_string().ends_with(
        "apex.vtx:5: element names node 17, but the mesh has 17 nodes, numbered from 0"
    ));
}

#[test]
fn vtu_files_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("heart.vtu");
    let mesh = small();
    let pressure = vtu::Field::scalar(
        "t_ms",
        (0..mesh.n_nodes()).map(|i| i as f64 * 0.1).collect(),
    );
    let volume = vtu::Field::vector(
        "centre_mm",
        &(0..mesh.n_tets())
            .map(|e| mesh.centroid_mm(e))
            .collect::<Vec<_>>(),
    );
    let content = vtu::Content {
        surfaces: true,
        point_fields: std::slice::from_ref(&pressure),
        cell_fields: std::slice::from_ref(&volume),
        compact: false,
    };
    vtu::write(&file, &mesh, &content).unwrap();
    let grid = vtu::read(&file, LengthUnit::Millimetre).unwrap();
    assert_same(&mesh, &grid.mesh, 0.0);
    assert_eq!(
        (grid.point_fields, grid.cell_fields),
        (vec![pressure.clone()], vec![volume.clone()])
    );
    let compact = vtu::encode(
        &mesh,
        &vtu::Content {
            compact: true,
            ..content
        },
    );
    let grid = vtu::parse(compact.as_bytes(), &file, LengthUnit::Millimetre).unwrap();
    assert_same(
        &TetMesh {
            frames: vec![],
            ..mesh.clone()
        },
        &TetMesh {
            frames: vec![],
            ..grid.mesh
        },
        1e-7,
    );
    assert!(compact.len() < 3 * vtu::encode(&mesh, &content).len() / 4);
    let short = vtu::Field::scalar("short", vec![1.0]);
    let error = vtu::write(
        &file,
        &mesh,
        &vtu::Content {
            point_fields: &[short],
            ..content
        },
    )
    .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("found 1 values of the field short, expected 1 for each of"),
        "{error}"
    );
}

/// The same two tetrahedra and one triangle, as other programs write them.
#[test]
fn vtu_files_of_all_encodings_are_read() {
    let ascii = vtu::read(&data("two_tets_ascii.vtu"), LengthUnit::Centimetre).unwrap();
    assert_eq!(ascii.mesh.tets, [[0, 1, 2, 3], [1, 2, 3, 4]]);
    assert_eq!(ascii.mesh.tags, [1, 2]);
    assert_eq!(ascii.mesh.nodes_mm[4], [10.0, 10.0, 10.0]);
    assert_eq!(ascii.point_fields[0].values, [0.0, 1.0, 2.0, 3.0, 4.5]);
    for name in [
        "binary",
        "binary_zlib",
        "appended_raw",
        "appended_base64",
        "appended_zlib",
        "big_endian",
    ] {
        let other = vtu::read(
            &data(&format!("two_tets_{name}.vtu")),
            LengthUnit::Centimetre,
        );
        assert_eq!(
            other.unwrap_or_else(|e| panic!("{name}: {e}")),
            ascii,
            "{name}"
        );
    }
}

#[test]
fn a_broken_vtu_file_is_told_with_its_line() {
    let text = std::fs::read_to_string(data("two_tets_ascii.vtu")).unwrap();
    let told = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let broken = text.replacen(from, to, 1);
        vtu::parse(
            broken.as_bytes(),
            Path::new("a.vtu"),
            LengthUnit::Millimetre,
        )
        .unwrap_err()
        .to_string()
    };
    assert_eq!(
        told("10 10 5", "10 12 5"),
        "a.vtu:14: found cell 1 of VTK's type 12, expected tetrahedra (10) and triangles (5)"
    );
    assert!(told("1 2 3 4\n", "1 2 3 9\n").contains("node 9 in cell 1, expected one of 5 nodes"));
    assert!(told("4 8 11", "4 8").contains("the array offsets of 2 numbers, expected 3 numbers"));
    assert!(told("<Points>", "<Pts>").contains("text that is not XML"));
    assert!(told("UnstructuredGrid\"", "PolyData\"").contains("a.vtu:2: found another document"));
    assert!(
        told(
            "<Piece ",
            "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"/><Piece "
        )
        .contains("found 2 pieces")
    );
}

#[test]
fn gmsh_files_of_both_versions_give_the_same_mesh() {
    let second = gmsh::read(&data("two_tets_v2.msh"), LengthUnit::Millimetre).unwrap();
    let fourth = gmsh::read(&data("two_tets_v4.msh"), LengthUnit::Millimetre).unwrap();
    assert_eq!(second, fourth);
    assert_eq!(second.n_nodes(), 5, "the point of the geometry is left out");
    assert_eq!(second.tags, [7, 8]);
    assert_eq!(second.surfaces.len(), 1);
    assert_eq!(second.surfaces[0].name, "endocardium");
    let defects = check(
        &second,
        LengthUnit::Centimetre,
        &Expected {
            surfaces: &["endocardium"],
            ..Expected::default()
        },
    );
    assert!(
        defects
            .iter()
            .all(|defect| matches!(defect, cardiotwin_mesh::checks::Defect::Size { .. })),
        "{defects:?}"
    );
}

#[test]
fn broken_gmsh_files_are_told_with_their_line() {
    let text = std::fs::read_to_string(data("two_tets_v2.msh")).unwrap();
    let told = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let broken = text.replacen(from, to, 1);
        gmsh::parse(&broken, Path::new("a.msh"), LengthUnit::Millimetre)
            .unwrap_err()
            .to_string()
    };
    assert!(
        told("2.2 0 8", "2.2 1 8").starts_with("a.msh:2: found `2.2 1 8`, expected an ASCII file")
    );
    assert!(told("2.2 0 8", "4.0 0 8").contains("expected version 2.2 or 4.1"));
    assert!(told("2 4 2 7 1 ", "2 11 2 7 1 ").contains("first order, not of gmsh's type 11"));
    assert!(
        told("2 4 2 7 1 1 2 3 4", "2 4 2 7 1 1 2 3").contains("expected 4 nodes of an element")
    );
    assert!(told("2 4 2 7 1 1 2 3 4", "2 4 2 7 1 1 2 3 77").contains("found node 77"));
    assert!(told("$EndNodes", "$End").contains("expected `$EndNodes`"));
}

#[test]
fn broken_carp_files_are_told_with_their_line() {
    let file = Path::new("h");
    let um = LengthUnit::Micrometre;
    let told = carp::parse_pts("2\n1 2 3\n1 2\n", file, um).unwrap_err();
    assert_eq!(
        told.to_string(),
        "h:3: found `1 2`, expected three numbers, x y z"
    );
    let told = carp::parse_pts("2\n1 2 3\n", file, um).unwrap_err();
    assert_eq!(
        told.to_string(),
        "h:3: found the end of the file, expected 1 more points (the header says 2)"
    );
    let told = carp::parse_pts("1\n1 2 3\n4 5 6\n", file, um).unwrap_err();
    assert_eq!(
        told.to_string(),
        "h:3: found `4 5 6`, expected the end of the file after 1 points, as its header says"
    );
    assert!(
        carp::parse_pts("1\n1 nan 3\n", file, um)
            .unwrap_err()
            .to_string()
            .contains("finite")
    );
    let told = carp::parse_elem("1\nTt 0 1 2 9 1\n", file, 4).unwrap_err();
    assert_eq!(
        told.to_string(),
        "h:2: element names node 9, but the mesh has 4 nodes, numbered from 0"
    );
    assert!(
        carp::parse_elem("1\nHx 0 1 2 3 4 5 6 7 1\n", file, 8)
            .unwrap_err()
            .to_string()
            .contains("a tetrahedron")
    );
    assert!(
        carp::parse_lon("3\n", file, 1)
            .unwrap_err()
            .to_string()
            .contains("expected 1 (a fibre")
    );
    let told = carp::parse_lon("2\n1 0 0 1 0 0\n", file, 1)
        .unwrap_err()
        .to_string();
    assert!(told.contains("perpendicular"), "{told}");
    let fibre = carp::parse_lon("1\n0 3 4\n", file, 1).unwrap()[0].fibre;
    assert!(
        (fibre[1] - 0.6).abs() + (fibre[2] - 0.8).abs() < 1e-15,
        "{fibre:?}"
    );
    let error = carp::read(Path::new("nowhere/heart"), um).unwrap_err();
    assert_eq!(error.to_string(), "cannot read nowhere/heart.pts");
    assert!(
        node_values::parse("# t_ms\n1\n2\n", file, 3)
            .unwrap_err()
            .to_string()
            .contains("found 2 numbers, expected 3")
    );
    assert_eq!(
        node_values::parse("# t_ms\n1\n2.5\n", file, 2).unwrap(),
        [1.0, 2.5]
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Any points, corners, tags and directions, whether or not they form a sound mesh.
    #[test]
    fn carp_and_vtu_give_back_what_was_written(
        nodes in prop::collection::vec(prop::array::uniform3(-1e3..1e3f64), 4..40),
        picks in prop::collection::vec((prop::array::uniform4(any::<prop::sample::Index>()), -5..9i32, 0.0..6.3f64), 1..40),
        triangles in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 1..20),
    ) {
        // The number of rows determines whether a file's fibres belong to nodes or elements.
        prop_assume!(nodes.len() != picks.len());
        let n = nodes.len();
        let mut mesh = TetMesh { nodes_mm: nodes, ..TetMesh::default() };
        for (corners, tag, angle) in picks {
            mesh.tets.push(corners.map(|pick| pick.index(n) as u32));
            mesh.tags.push(tag);
            let (s, c) = angle.sin_cos();
            mesh.frames.push(Frame { fibre: [0.0, c, s], sheet: [0.0, -s, c], normal: [1.0, 0.0, 0.0] });
        }
        let triangles = triangles.into_iter().map(|t| t.map(|pick| pick.index(n) as u32)).collect();
        mesh.surfaces.push(Surface { name: "a b&<c".into(), triangles });
        let folder = tempfile::tempdir().unwrap();
        let stem = folder.path().join("any");
        carp::write(&mesh, &stem).unwrap();
        assert_same(&mesh, &carp::read(&stem, LengthUnit::Micrometre).unwrap(), 3e-16);
        let text = vtu::encode(&mesh, &vtu::Content { surfaces: true, ..vtu::Content::default() });
        let grid = vtu::parse(text.as_bytes(), &stem, LengthUnit::Millimetre).unwrap();
        assert_same(&mesh, &grid.mesh, 0.0);
    }
}

#[test]
fn carp_fibres_are_of_nodes_or_of_elements_by_their_number() {
    let folder = tempfile::tempdir().unwrap();
    let stem = folder.path().join("heart");
    let mesh = small();
    carp::write(&mesh, &stem).unwrap();
    let of_elements = carp::read(&stem, LengthUnit::Micrometre).unwrap();
    assert_eq!(
        (of_elements.fibres.n_nodes(), of_elements.frames.len()),
        (None, mesh.n_tets())
    );
    // Fibres that turn with the height.
    let rows = mesh
        .nodes_mm
        .iter()
        .map(|x| (0.05 * x[2]).sin_cos())
        .map(|(sin, cos)| format!("{cos} {sin} 0\n"));
    let text = std::iter::once("1\n".to_owned())
        .chain(rows)
        .collect::<String>();
    std::fs::write(stem.with_extension("lon"), &text).unwrap();
    let of_nodes = carp::read(&stem, LengthUnit::Micrometre).unwrap();
    assert_eq!(
        (of_nodes.fibres.n_nodes(), of_nodes.frames.len()),
        (Some(mesh.n_nodes()), mesh.n_tets())
    );
    for e in 0..mesh.n_tets() {
        let z = mesh.centroid_mm(e)[2];
        let along = of_nodes.frames[e].fibre[0] * (0.05 * z).cos()
            + of_nodes.frames[e].fibre[1] * (0.05 * z).sin();
        assert!(along.abs() > 0.99, "element {e}: {along}");
    }
    let cut = text
        .lines()
        .take(mesh.n_nodes())
        .collect::<Vec<_>>()
        .join("\n");
    std::fs::write(stem.with_extension("lon"), cut).unwrap();
    let error = carp::read(&stem, LengthUnit::Micrometre)
        .unwrap_err()
        .to_string();
    assert!(error.contains("one for each element"), "{error}");
}

#[test]
fn fibres_of_a_mesh_with_as_many_nodes_as_elements_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stem = folder.path().join("odd");
    let (sin, cos) = (0.75_f64.sqrt(), 0.5);
    // Five nodes and five elements, some of them repeated: not a mesh for computation, but enough
    // for this ambiguity.
    let nodes_mm = vec![
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 9.0],
        [9.0, 0.0, 0.0],
        [-9.0 * cos, 9.0 * sin, 0.0],
        [-9.0 * cos, -9.0 * sin, 0.0],
    ];
    let tets = vec![
        [0, 2, 3, 1],
        [0, 3, 4, 1],
        [0, 4, 2, 1],
        [0, 2, 3, 1],
        [0, 3, 4, 1],
    ];
    let mesh = TetMesh {
        nodes_mm,
        tags: vec![1; tets.len()],
        tets,
        ..TetMesh::default()
    };
    carp::write(&mesh, &stem).unwrap();
    std::fs::write(
        stem.with_extension("lon"),
        "1\n".to_owned() + &"1 0 0\n".repeat(5),
    )
    .unwrap();
    let error = carp::read(&stem, LengthUnit::Micrometre)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("as many nodes as elements") && error.contains("VTU"),
        "{error}"
    );
}
