//! Step 0 on a patient's own mesh. The generated mesh, written as CARP files with other tags and
//! another unit, gives the same heart.

mod support;

use std::path::Path;

use cardiotwin_mesh::LengthUnit;
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::files::{carp, node_values};
use cardiotwin_mesh::tags;
use cardiotwin_schemas::finite_element::{
    FiniteElementSettings, MeshFibres, OwnMesh, VentricleFigures,
};
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::outcome::Ending;
use cardiotwin_schemas::task::{PassiveStateSpec, TaskSpec};
use cardiotwin_units::Ml;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::run_task;
use support::{input, passive_state, step0};

fn spec() -> PassiveStateSpec {
    let settings = FiniteElementSettings {
        mesh_nodes: 500,
        ..FiniteElementSettings::default()
    };
    PassiveStateSpec {
        finite_element: Some(settings.anatomy(&[])),
        ..step0("01-CoA")
    }
}

/// The ellipsoid of 01-CoA in the form of a clinic's mesh: tags 7 and 9, coordinates in µm, no
/// surfaces.
fn clinic(folder: &Path, cavity_ml: f64) -> OwnMesh {
    let wall_ml = step0("01-CoA").wall_volume_ml.expect("known");
    let made = generate(&EllipsoidSpec::new(Ml(cavity_ml), Ml(wall_ml), 500)).unwrap();
    let mut mesh = made.mesh.clone();
    mesh.surfaces.clear();
    for tag in &mut mesh.tags {
        *tag = if *tag == tags::LEFT_VENTRICLE { 7 } else { 9 };
    }
    carp::write(&mesh, &folder.join("heart")).unwrap();
    OwnMesh {
        files: ["heart.pts", "heart.elem"]
            .map(|name| input("mesh", &folder.join(name)))
            .to_vec(),
        unit: LengthUnit::Micrometre.symbol().to_owned(),
        left_ventricle: vec![7],
        fibres: MeshFibres::Auto,
        activation_times: None,
        activation_sites_mm: made
            .shape
            .fascicles()
            .iter()
            .map(|site| site.at_mm)
            .collect(),
        right_ventricle: None,
    }
}

fn figures(spec: &PassiveStateSpec, folder: &Path) -> VentricleFigures {
    std::fs::create_dir(folder).unwrap();
    match passive_state(spec, &mut Context::plain(folder, 1)).organ {
        OrganSpec::FiniteElement(organ) => organ.figures,
        OrganSpec::Reduced { .. } | OrganSpec::External(_) => panic!("another organ"),
    }
}

fn refused(own: OwnMesh, folder: &Path) -> String {
    let spec = PassiveStateSpec {
        own_mesh: Some(own),
        ..spec()
    };
    match run_task(
        &TaskSpec::PassiveState(Box::new(spec)),
        &mut Context::plain(folder, 1),
    ) {
        Ending::Failed { failure } => failure.message,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_heart_from_files_is_the_heart_that_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let generated = figures(&spec(), &folder.path().join("generated"));
    let own = clinic(folder.path(), 138.5);
    // The wall's volume is the mesh's, whatever the patient's file lacks.
    let read = figures(
        &PassiveStateSpec {
            own_mesh: Some(own.clone()),
            wall_volume_ml: None,
            ..spec()
        },
        &folder.path().join("read"),
    );
    assert_eq!(
        (read.nodes, read.elements),
        (generated.nodes, generated.elements)
    );
    let pairs = [
        (read.wall_volume_ml, generated.wall_volume_ml),
        (read.image_volume_ml, generated.image_volume_ml),
        (read.unloaded_volume_ml, generated.unloaded_volume_ml),
        (read.stiffness_kpa, generated.stiffness_kpa),
        (read.exponent_factor, generated.exponent_factor),
        (read.spread_ms, generated.spread_ms),
    ];
    // Results do not agree bit for bit, because surfaces are searched again and coordinates are
    // rounded to the files' digits.
    assert!(
        pairs.iter().all(|(a, b)| (a / b - 1.0).abs() < 0.02),
        "{pairs:?}"
    );

    let n = read.nodes as usize;
    let times: Vec<f64> = (0..n).map(|k| 100.0 + 20.0 * (k % 2) as f64).collect();
    let file = folder.path().join("times.dat");
    node_values::write(&file, "activation times, ms", &times).unwrap();
    let timed = OwnMesh {
        activation_times: Some(input("activation times", &file)),
        activation_sites_mm: vec![],
        ..own
    };
    let timed = figures(
        &PassiveStateSpec {
            own_mesh: Some(timed),
            ..spec()
        },
        &folder.path().join("timed"),
    );
    assert!((timed.spread_ms - 20.0).abs() < 0.1, "{}", timed.spread_ms);
}

#[test]
fn what_is_wrong_with_a_mesh_is_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let own = clinic(folder.path(), 138.5);
    let metres = refused(
        OwnMesh {
            unit: "mm".to_owned(),
            left_ventricle: vec![3],
            ..own.clone()
        },
        folder.path(),
    );
    assert!(
        metres.contains("set anatomy.mesh.unit = \"um\"")
            && metres.contains("no element with the tag 3"),
        "{metres}"
    );
    let nowhere = refused(
        OwnMesh {
            activation_sites_mm: vec![],
            ..own.clone()
        },
        folder.path(),
    );
    assert!(
        nowhere.contains("neither activation times nor activation sites"),
        "{nowhere}"
    );
    let fibres = refused(
        OwnMesh {
            fibres: MeshFibres::Mesh,
            ..own
        },
        folder.path(),
    );
    assert!(fibres.contains("found no fibres"), "{fibres}");
    let small = refused(clinic(folder.path(), 90.0), folder.path());
    assert!(
        small.contains("a cavity of 90.0 mL") && small.contains("138.5"),
        "{small}"
    );
}
