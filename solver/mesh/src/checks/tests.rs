use super::*;
use crate::ellipsoid::{EllipsoidSpec, generate};
use crate::tet_mesh::{Frame, tags};

const EXPECTED: Expected = Expected {
    muscle_tags: &[tags::LEFT_VENTRICLE],
    fibres: false,
    surfaces: &[surface_names::ENDOCARDIUM, surface_names::EPICARDIUM, surface_names::RIM],
    cavity: Some((Ml(120.0), 0.05)),
};

fn heart() -> TetMesh {
    generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 600)).unwrap().mesh
}

fn told(mesh: &TetMesh, expected: &Expected) -> Vec<String> {
    check(mesh, LengthUnit::Millimetre, expected).iter().map(ToString::to_string).collect()
}

/// The one message.
fn only(mesh: &TetMesh, expected: &Expected) -> String {
    let told = told(mesh, expected);
    assert_eq!(told.len(), 1, "{told:#?}");
    told[0].clone()
}

#[test]
fn a_generated_heart_has_no_defects() {
    assert_eq!(told(&heart(), &EXPECTED), Vec::<String>::new());
}

#[test]
fn an_inverted_element_is_named() {
    let mut mesh = heart();
    mesh.tets[7].swap(0, 1);
    let text = told(&mesh, &Expected { cavity: None, ..EXPECTED }).join("\n");
    assert!(text.starts_with("1 of ") && text.contains("the first is element 7 with -"), "{text}");
}

#[test]
fn a_flat_element_is_named_with_its_place() {
    let mut mesh = heart();
    let [a, b, c, d] = mesh.tets[3];
    let x = [a, b, c].map(|node| mesh.nodes_mm[node as usize]);
    mesh.nodes_mm[d as usize] = std::array::from_fn(|k| (x[0][k] + x[1][k] + x[2][k]) / 3.0);
    let text = told(&mesh, &EXPECTED).join("\n");
    assert!(text.contains("degenerate, the worst is element 3 at ("), "{text}");
}

#[test]
fn loose_nodes_loose_parts_and_overlaps_are_counted() {
    let mut mesh = heart();
    mesh.nodes_mm.push([0.0; 3]);
    assert!(only(&mesh, &EXPECTED).starts_with("1 nodes belong to no element"));
    let n = mesh.n_nodes() as u32;
    mesh.nodes_mm.extend([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    mesh.tets.push([n - 1, n, n + 1, n + 2]);
    mesh.tags.push(1);
    assert!(only(&mesh, &EXPECTED).contains("2 unconnected parts"));
    let mut mesh = heart();
    mesh.tets.push(mesh.tets[0]);
    mesh.tags.push(1);
    mesh.tets.push(mesh.tets[0]);
    mesh.tags.push(1);
    assert!(told(&mesh, &EXPECTED).iter().any(|text| text.contains("elements overlap")));
}

#[test]
fn a_heart_in_the_wrong_unit_is_told_with_the_likely_one() {
    let mut mesh = heart();
    for x in mesh.nodes_mm.iter_mut().flatten() {
        *x *= 1000.0;
    }
    let text = only(&mesh, &Expected { cavity: None, ..EXPECTED });
    assert!(text.ends_with("its coordinates look like um; set the mesh's unit to \"um\""), "{text}");
    for x in mesh.nodes_mm.iter_mut().flatten() {
        *x *= 1e-6;
    }
    let text = only(&mesh, &Expected { cavity: None, ..EXPECTED });
    assert!(text.ends_with("set the mesh's unit to \"m\""), "{text}");
}

#[test]
fn a_cavity_that_disagrees_with_the_measured_one_is_told() {
    let text = only(&heart(), &Expected { cavity: Some((Ml(150.0), 0.05)), ..EXPECTED });
    assert_eq!(text, "the cavity is 120.0 mL, expected 150.0 mL within 5 %: check unit, state and rim of the mesh");
}

#[test]
fn open_turned_and_foreign_surfaces_are_told() {
    let position = |mesh: &TetMesh| mesh.surfaces.iter().position(|s| s.name == surface_names::ENDOCARDIUM).unwrap();
    let mut mesh = heart();
    let endocardium = position(&mesh);
    mesh.surfaces[endocardium].triangles.remove(3);
    let text = only(&mesh, &Expected { cavity: None, ..EXPECTED });
    assert!(text.starts_with("the endocardium has a hole of 3 nodes around ("), "{text}");

    let mut mesh = heart();
    mesh.surfaces[endocardium].triangles[5].swap(0, 1);
    let text = told(&mesh, &Expected { cavity: None, ..EXPECTED });
    assert!(text[0].contains("1 of ") && text[0].contains("normals into the tissue"), "{text:?}");
    assert!(text[1].contains("oriented against each other"), "{text:?}");

    let mut mesh = heart();
    let inside = mesh.surfaces[endocardium].triangles[0];
    mesh.surfaces[endocardium].triangles.push([inside[0], inside[1], inside[2] + 2]);
    assert!(told(&mesh, &EXPECTED).iter().any(|text| text.contains("no boundary faces of the mesh")));

    let mut mesh = heart();
    mesh.surfaces.remove(endocardium);
    assert!(only(&mesh, &EXPECTED).starts_with("there is no surface endocardium; surfaces there are [\"epicardium\""));

    let mut mesh = heart();
    mesh.surfaces.push(crate::surface::Surface { name: "again".into(), triangles: vec![inside] });
    assert!(only(&mesh, &EXPECTED).contains("surfaces endocardium and again"));
}

#[test]
fn missing_and_wrong_fibres_are_told() {
    let expected = Expected { fibres: true, ..EXPECTED };
    let mut mesh = heart();
    assert!(only(&mesh, &expected).starts_with("the mesh has no fibres"));
    let frame = Frame { fibre: [1.0, 0.0, 0.0], sheet: [0.0, 1.0, 0.0], normal: [0.0, 0.0, 1.0] };
    mesh.frames = vec![frame; mesh.n_tets()];
    assert_eq!(told(&mesh, &expected), Vec::<String>::new());
    mesh.frames[4].fibre = [0.0; 3];
    mesh.frames[9].fibre = [f64::NAN; 3];
    assert!(only(&mesh, &expected).starts_with("2 contracting elements have no unit fibre, the first is element 4"));
    mesh.frames.pop();
    assert!(only(&mesh, &expected).starts_with("fibres has "));
}

#[test]
fn wrong_tags_numbers_and_an_empty_mesh_are_told() {
    let mesh = heart();
    let text = only(&mesh, &Expected { muscle_tags: &[7], ..EXPECTED });
    assert_eq!(text, "no element has the tag 7; tags there are [1, 2]: correct the tag map");
    let mut broken = mesh.clone();
    broken.tets[2][1] = 99_999;
    assert!(only(&broken, &EXPECTED).starts_with("element 2 names node 99999"));
    let mut broken = mesh;
    broken.nodes_mm[11][2] = f64::NAN;
    assert!(only(&broken, &EXPECTED).starts_with("node 11 lies at"));
    assert!(only(&TetMesh::default(), &EXPECTED).starts_with("the mesh has no elements"));
}
