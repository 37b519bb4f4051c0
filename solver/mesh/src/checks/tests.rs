use super::*;
use crate::ellipsoid::{EllipsoidSpec, generate};
use crate::tet_mesh::{Frame, surface_names, tags};
use crate::vec3::unit;

const EXPECTED: Expected = Expected {
    muscle_tags: &[tags::LEFT_VENTRICLE],
    fibres: false,
    surfaces: &[
        surface_names::ENDOCARDIUM,
        surface_names::EPICARDIUM,
        surface_names::RIM,
    ],
    right_ventricle: None,
    sprung: &[],
    surfaces_not_found: None,
    cavity: Some((Ml(120.0), 0.05)),
    wall: None,
};

fn heart() -> TetMesh {
    generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 600))
        .unwrap()
        .mesh
}

fn told(mesh: &TetMesh, expected: &Expected) -> Vec<Defect> {
    check(mesh, LengthUnit::Millimetre, expected)
}

fn names(mesh: &TetMesh, expected: &Expected) -> Vec<&'static str> {
    told(mesh, expected).iter().map(Defect::name).collect()
}

/// The single defect of a mesh.
fn only(mesh: &TetMesh, expected: &Expected) -> Defect {
    let told = told(mesh, expected);
    assert_eq!(told.len(), 1, "{told:#?}");
    told[0].clone()
}

fn without_volume() -> Expected<'static> {
    Expected {
        cavity: None,
        ..EXPECTED
    }
}

#[test]
fn a_generated_heart_has_no_defects() {
    assert_eq!(told(&heart(), &EXPECTED), Vec::<Defect>::new());
}

#[test]
fn every_inverted_element_is_named_with_its_place() {
    let mut mesh = heart();
    mesh.tets[7].swap(0, 1);
    mesh.tets[90].swap(0, 1);
    let turned = told(&mesh, &without_volume()).remove(0);
    let items: Vec<Item> = turned.places().iter().map(|place| place.item).collect();
    assert!(
        items.len() == 2 && items.contains(&Item::Element(7)) && items.contains(&Item::Element(90)),
        "{turned}"
    );
    let at = mesh.centroid_mm(7);
    assert!(
        turned.places().iter().any(|place| place.at_mm == at),
        "{turned}"
    );
    assert!(turned.remedy().contains("mesh repair"), "{turned}");
}

#[test]
fn flat_and_badly_shaped_elements_are_told_apart() {
    let mut mesh = heart();
    let [a, b, c, d] = mesh.tets[3];
    let x = [a, b, c].map(|node| mesh.nodes_mm[node as usize]);
    let old = mesh.nodes_mm[d as usize];
    let middle: Vec3 = std::array::from_fn(|k| (x[0][k] + x[1][k] + x[2][k]) / 3.0);
    mesh.nodes_mm[d as usize] = middle;
    let flat = told(&mesh, &EXPECTED);
    let flat = flat
        .iter()
        .find(|defect| defect.name() == "flat-elements")
        .expect("told");
    assert!(
        flat.places()
            .iter()
            .any(|place| place.item == Item::Element(3)),
        "{flat}"
    );
    assert_eq!(flat.severity(), Severity::Error);
    // Flattened to a fiftieth of its height.
    mesh.nodes_mm[d as usize] = std::array::from_fn(|k| middle[k] + 0.02 * (old[k] - middle[k]));
    let poor = told(&mesh, &EXPECTED);
    let poor = poor
        .iter()
        .find(|defect| defect.name() == "badly-shaped-elements")
        .expect("told");
    assert_eq!(poor.severity(), Severity::Warning);
}

#[test]
fn loose_nodes_loose_pieces_doubled_nodes_and_overlaps_are_listed() {
    let mut mesh = heart();
    mesh.nodes_mm.push([0.0; 3]);
    assert_eq!(only(&mesh, &EXPECTED).severity(), Severity::Warning);
    let n = mesh.n_nodes() as u32;
    mesh.nodes_mm
        .extend([[5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 5.0]]);
    mesh.tets.push([n - 1, n, n + 1, n + 2]);
    mesh.tags.push(1);
    let loose = only(&mesh, &EXPECTED);
    assert_eq!(
        loose.places(),
        [Place {
            item: Item::Piece(1),
            at_mm: [1.25; 3]
        }],
        "{loose}"
    );

    let mut mesh = heart();
    let node = mesh.tets[11][2];
    let at_mm = mesh.nodes_mm[node as usize];
    mesh.nodes_mm.push(at_mm);
    mesh.tets[11][2] = mesh.n_nodes() as u32 - 1;
    let doubled = told(&mesh, &without_volume());
    let doubled = doubled
        .iter()
        .find(|defect| defect.name() == "doubled-nodes")
        .expect("told");
    assert_eq!(doubled.places().len(), 1);
    assert_eq!(doubled.places()[0].at_mm, at_mm);

    let mut mesh = heart();
    for _ in 0..2 {
        mesh.tets.push(mesh.tets[0]);
        mesh.tags.push(1);
    }
    assert!(names(&mesh, &EXPECTED).contains(&"overlap"));
}

#[test]
fn edges_at_which_four_triangles_meet_are_all_listed() {
    // Two cubes of a block that share only an edge.
    let block = crate::test_meshes::block([2, 2, 1], [20.0, 20.0, 10.0]);
    let mut mesh = block.clone();
    let keep = |e: &usize| {
        let x = block.centroid_mm(*e);
        (x[0] < 10.0) == (x[1] < 10.0)
    };
    mesh.tets = (0..block.n_tets())
        .filter(keep)
        .map(|e| block.tets[e])
        .collect();
    mesh.tags.truncate(mesh.tets.len());
    let told = told(&mesh, &Expected::default());
    let touching = told
        .iter()
        .find(|defect| defect.name() == "touching-edges")
        .expect("told");
    assert_eq!(
        touching.places(),
        [Place {
            item: Item::Edge([4, 13]),
            at_mm: [10.0, 10.0, 5.0]
        }],
        "{touching}"
    );
}

#[test]
fn a_heart_in_the_wrong_unit_is_told_with_the_likely_one() {
    let mut mesh = heart();
    for x in mesh.nodes_mm.iter_mut().flatten() {
        *x *= 1000.0;
    }
    let remedy = only(&mesh, &without_volume()).remedy();
    assert!(
        remedy.ends_with("look like um: set anatomy.mesh.unit = \"um\""),
        "{remedy}"
    );
    for x in mesh.nodes_mm.iter_mut().flatten() {
        *x *= 1e-6;
    }
    let remedy = only(&mesh, &without_volume()).remedy();
    assert!(
        remedy.ends_with("set anatomy.mesh.unit = \"m\""),
        "{remedy}"
    );
}

#[test]
fn a_cavity_that_disagrees_with_the_measured_one_is_told_with_the_scale_that_would_mend_it() {
    let found = only(
        &heart(),
        &Expected {
            cavity: Some((Ml(120.0 / 2.744), 0.1)),
            ..EXPECTED
        },
    );
    assert_eq!(found.name(), "cavity-volume");
    assert!(
        found.remedy().contains("all lengths times 0.714"),
        "{found}"
    );
    let wall = only(
        &heart(),
        &Expected {
            wall: Some((Ml(90.0), 0.25)),
            ..EXPECTED
        },
    );
    assert_eq!(
        (wall.name(), wall.severity()),
        ("wall-volume", Severity::Warning)
    );
}

#[test]
fn open_turned_and_foreign_surfaces_are_told() {
    let position = |mesh: &TetMesh| {
        mesh.surfaces
            .iter()
            .position(|s| s.name == surface_names::ENDOCARDIUM)
            .unwrap()
    };
    let mut mesh = heart();
    let endocardium = position(&mesh);
    let gone = mesh.surfaces[endocardium].triangles.remove(3);
    let hole = only(&mesh, &without_volume());
    let middle = super::places::middle(&mesh, &gone);
    assert!(
        hole.name() == "hole" && norm(sub(hole.places()[0].at_mm, middle)) < 1e-9,
        "{hole}"
    );

    let mut mesh = heart();
    mesh.surfaces[endocardium].triangles[5].swap(0, 1);
    assert_eq!(
        names(&mesh, &without_volume()),
        ["inward-surface", "turned-triangles"]
    );
    assert_eq!(
        told(&mesh, &without_volume())[1].places().len(),
        3,
        "the triangle's three edges"
    );

    let mut mesh = heart();
    let inside = mesh.surfaces[endocardium].triangles[0];
    mesh.surfaces[endocardium]
        .triangles
        .push([inside[0], inside[1], inside[2] + 2]);
    assert!(names(&mesh, &EXPECTED).contains(&"foreign-triangles"));

    let mut mesh = heart();
    mesh.surfaces.remove(endocardium);
    let text = only(&mesh, &EXPECTED).to_string();
    assert!(
        text.contains("no surface named endocardium; surfaces there are: epicardium"),
        "{text}"
    );

    let mut mesh = heart();
    let rim = mesh
        .surfaces
        .iter()
        .position(|s| s.name == surface_names::RIM)
        .unwrap();
    mesh.surfaces[rim].triangles.push(inside);
    assert!(names(&mesh, &EXPECTED).contains(&"shared-triangles"));
}

#[test]
fn a_closed_endocardium_is_told_as_such() {
    // A hollow cube: 3 × 3 × 3 cells without the middle one.
    let mut mesh = crate::test_meshes::cube(3, 30.0);
    let inside = |x: [f64; 3]| x.iter().all(|c| (10.0..20.0).contains(c));
    let kept: Vec<_> = (0..mesh.n_tets())
        .filter(|e| !inside(mesh.centroid_mm(*e)))
        .collect();
    mesh.tets = kept.iter().map(|e| mesh.tets[*e]).collect();
    mesh.tags.truncate(kept.len());
    mesh.surfaces = crate::find_surfaces::find_surfaces(&mesh).unwrap();
    let closed = only(&mesh, &without_volume());
    assert_eq!(
        (closed.name(), closed.severity()),
        ("closed-endocardium", Severity::Error)
    );
    assert!(
        closed.remedy().contains("--remove-tags") && closed.remedy().contains("--cut-plane"),
        "{closed}"
    );
}

#[test]
fn missing_and_wrong_fibres_are_told() {
    let expected = Expected {
        fibres: true,
        ..EXPECTED
    };
    let mut mesh = heart();
    assert_eq!(only(&mesh, &expected), Defect::NoFibres);
    let frame = Frame {
        fibre: [1.0, 0.0, 0.0],
        sheet: [0.0, 1.0, 0.0],
        normal: [0.0, 0.0, 1.0],
    };
    mesh.frames = vec![frame; mesh.n_tets()];
    let placeholder = only(&mesh, &expected);
    assert_eq!(
        (placeholder.name(), placeholder.severity()),
        ("fibres-of-one-direction", Severity::Warning)
    );
    // Other directions in fewer than half of the elements do not make fibres of a placeholder.
    mesh.frames[0].fibre = [0.0, 0.0, 1.0];
    assert_eq!(only(&mesh, &expected).name(), "fibres-of-one-direction");
    for frame in mesh.frames.iter_mut().step_by(3) {
        frame.fibre = [0.0, 0.0, 1.0];
    }
    for frame in mesh.frames.iter_mut().skip(1).step_by(3) {
        frame.fibre = [0.0, 1.0, 0.0];
    }
    assert_eq!(only(&mesh, &expected).name(), "fibres-without-order");
    // Fibres around the axis.
    for e in 0..mesh.n_tets() {
        let [x, y, _] = at_element(&mesh, e).at_mm;
        mesh.frames[e].fibre = unit([-y, x, 0.0]).unwrap();
    }
    assert_eq!(told(&mesh, &expected), Vec::<Defect>::new());
    mesh.frames[4].fibre = [0.0; 3];
    mesh.frames[9].fibre = [f64::NAN; 3];
    let wrong = only(&mesh, &expected);
    let mut items: Vec<Item> = wrong.places().iter().map(|place| place.item).collect();
    items.sort_by_key(|item| if let Item::Element(e) = item { *e } else { 0 });
    assert_eq!(items, [Item::Element(4), Item::Element(9)]);
    mesh.frames.pop();
    assert_eq!(only(&mesh, &expected).name(), "length");
}

#[test]
fn wrong_tags_numbers_and_an_empty_mesh_are_told() {
    let mesh = heart();
    let text = only(
        &mesh,
        &Expected {
            muscle_tags: &[7],
            ..EXPECTED
        },
    )
    .found();
    assert!(
        text.starts_with("no element with the tag 7; tags there are 1 ("),
        "{text}"
    );
    let mut broken = mesh.clone();
    broken.tets[2][1] = 99_999;
    assert!(
        only(&broken, &EXPECTED)
            .found()
            .starts_with("element 2 with node 99999")
    );
    let mut broken = mesh;
    broken.nodes_mm[11][2] = f64::NAN;
    assert!(only(&broken, &EXPECTED).found().ends_with("no numbers: 11"));
    assert_eq!(only(&TetMesh::default(), &EXPECTED), Defect::Empty);
}

#[test]
fn sites_outside_of_contracting_tissue_are_told_with_the_nearest_node() {
    let mesh = heart();
    let inside = mesh.nodes_mm[mesh.tets[0][0] as usize];
    let far = [500.0, 0.0, 0.0];
    let found = activation(&mesh, &[tags::LEFT_VENTRICLE], &[inside, far], 3.0);
    assert!(
        matches!(&found[..], [Defect::Site { site: 1, distance_mm, .. }] if *distance_mm > 400.0),
        "{found:?}"
    );
}

/// Ambit's bi-ventricle; see its README for source and licence.
fn both_ventricles() -> TetMesh {
    let stem = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../examples/meshes/ambit_biv/ambit_biv");
    crate::files::carp::read(&stem, LengthUnit::Micrometre).unwrap()
}

/// A change of the right endocardium and the epicardium.
type Change<'a> = dyn Fn(&mut Vec<[u32; 3]>, &mut Vec<[u32; 3]>) + 'a;

const OF_BOTH: Expected = Expected {
    cavity: None,
    right_ventricle: Some("endo_rv"),
    ..EXPECTED
};

#[test]
fn a_right_ventricle_is_closed_or_open_at_the_rim_and_has_its_triangles_to_itself() {
    assert_eq!(told(&both_ventricles(), &OF_BOTH), Vec::<Defect>::new());
    let missing = only(
        &both_ventricles(),
        &Expected {
            right_ventricle: Some("rv"),
            ..OF_BOTH
        },
    );
    assert!(
        missing
            .found()
            .contains("no surface named rv; surfaces there are: endo_rv"),
        "{missing}"
    );
    assert!(
        missing
            .remedy()
            .contains("anatomy.mesh.right_ventricle.surface"),
        "{missing}"
    );
    let left = only(
        &both_ventricles(),
        &Expected {
            right_ventricle: Some("endocardium"),
            ..OF_BOTH
        },
    );
    assert_eq!(left.name(), "no-right-ventricle");
    let of = |mesh: &mut TetMesh, change: &Change<'_>| {
        let [mut right, mut epicardium] = ["endo_rv", "epicardium"]
            .map(|name| mesh.surface(name).expect("there").triangles.clone());
        change(&mut right, &mut epicardium);
        for (name, triangles) in [("endo_rv", right), ("epicardium", epicardium)] {
            mesh.surfaces
                .iter_mut()
                .filter(|s| s.name == name)
                .for_each(|s| s.triangles.clone_from(&triangles));
        }
    };
    let mut mesh = both_ventricles();
    of(&mut mesh, &|right, epicardium| epicardium.push(right[0]));
    let overlap = told(&mesh, &OF_BOTH)
        .into_iter()
        .find(|d| d.name() == "right-ventricle-overlap")
        .expect("told");
    assert_eq!(overlap.places().len(), 1, "{overlap}");
    // A triangle in the middle of the wall.
    let rim = both_ventricles()
        .surface(surface_names::RIM)
        .expect("a rim")
        .nodes();
    let mut mesh = both_ventricles();
    of(&mut mesh, &|right, _| {
        let inner = right
            .iter()
            .position(|t| t.iter().all(|node| !rim.contains(node)))
            .expect("one");
        right.remove(inner);
    });
    let hole = only(&mesh, &OF_BOTH);
    assert_eq!(
        (hole.name(), hole.places().len()),
        ("right-ventricle-hole", 1),
        "{hole}"
    );
}

#[test]
fn springs_act_on_surfaces_that_are_there_which_may_be_parts_of_others() {
    let lacks = only(
        &heart(),
        &Expected {
            sprung: &["lung"],
            ..EXPECTED
        },
    );
    assert!(lacks.found().contains("no surface named lung"), "{lacks}");
    assert!(
        lacks
            .remedy()
            .contains("solver.finite_element.wall.surface"),
        "{lacks}"
    );
    let mut mesh = heart();
    let triangles = mesh
        .surface(surface_names::EPICARDIUM)
        .expect("there")
        .triangles[..20]
        .to_vec();
    mesh.surfaces.push(crate::surface::Surface {
        name: "lung".to_owned(),
        triangles,
    });
    assert_eq!(
        told(
            &mesh,
            &Expected {
                sprung: &["lung"],
                ..EXPECTED
            }
        ),
        Vec::<Defect>::new()
    );
    mesh.surfaces.last_mut().expect("it").triangles[0].swap(0, 1);
    assert!(
        names(
            &mesh,
            &Expected {
                sprung: &["lung"],
                ..EXPECTED
            }
        )
        .contains(&"inward-surface")
    );
}
