//! Further variants of the meshes of the public reports, made here from the sound ones: names of arrays
//! (kind 17), and physical groups of gmsh (kind 18).

use std::path::Path;

use cardiotwin_mesh::files::{LengthUnit, MeshFileError, gmsh, vtu};
use cardiotwin_mesh::tet_mesh::TetMesh;

fn fixture(name: &str) -> Vec<u8> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/public-reports");
    std::fs::read(root.join(name)).unwrap()
}

/// What is right for a mesh.
enum Right {
    /// Tags and fibres as in the sound file.
    Same,
    /// Refused with these words.
    Said(&'static [&'static str]),
}

/// Number of variants, and what is wrong with them.
pub fn faults() -> (usize, Vec<String>) {
    let (n_arrays, mut all) = arrays();
    let (n_groups, more) = groups();
    all.extend(more);
    (n_arrays + n_groups, all)
}

/// Kind 17: other names of the fibres and of the tags.
fn arrays() -> (usize, Vec<String>) {
    let sound = fixture("17-vtu-foreign-arrays/FIB_DIR/heart.vtu");
    let text = String::from_utf8(sound).unwrap();
    let file = Path::new("heart.vtu");
    let parse = |text: &str| vtu::parse(text.as_bytes(), file, LengthUnit::Millimetre);
    let base = parse(&text).unwrap().mesh;
    let fibres = |name: &str| text.replace("Name=\"FIB_DIR\"", &format!("Name=\"{name}\""));
    let tag = |name: &str| text.replace("Name=\"tag\"", &format!("Name=\"{name}\""));
    let cases: Vec<(String, String, Right)> =
        ["f0", "fibers", "Fiber_Directions", "fibre dir", "FIBRES"]
            .into_iter()
            .map(|name| (name.to_owned(), fibres(name), Right::Same))
            .chain([
                (
                    "material".to_owned(),
                    tag("material"),
                    Right::Said(&["material", "an array called tag"]),
                ),
                (
                    "Region Id".to_owned(),
                    tag("Region Id"),
                    Right::Said(&["Region Id", "an array called tag"]),
                ),
            ])
            .collect();
    let mut faults = Vec::new();
    for (what, text, right) in &cases {
        let grid = parse(text);
        let fault = match (grid, right) {
            (Ok(grid), Right::Same) => (grid.mesh.frames != base.frames
                || grid.mesh.tags != base.tags)
                .then(|| "other fibres or tags".to_owned()),
            (Ok(_), Right::Said(_)) => Some("read".to_owned()),
            (Err(error), Right::Said(parts)) => {
                let said = error.to_string();
                (!parts.iter().all(|part| said.contains(part))).then_some(said)
            }
            (Err(error), _) => Some(error.to_string()),
        };
        faults.extend(fault.map(|fault| format!("17: {what}: {fault}")));
    }
    (cases.len(), faults)
}

/// Kind 18: volumes in several groups, groups without names, turned and of surfaces in three.
fn groups() -> (usize, Vec<String>) {
    let read = |name: &str| String::from_utf8(fixture(name)).unwrap();
    let both = read("18-gmsh-physical-groups/scar-in-both/heart.msh");
    let both_22 = read("18-gmsh-physical-groups/scar-in-both-22/heart.msh");
    let turned = read("18-gmsh-physical-groups/negative-endo/heart.msh");
    let parse = |text: &str| -> Result<TetMesh, MeshFileError> {
        gmsh::parse(text, Path::new("heart.msh"), LengthUnit::Millimetre)
    };
    let base = parse(&turned).unwrap();
    let without_names = |text: &str| {
        let (begin, end) = (
            text.find("$PhysicalNames").unwrap(),
            text.find("$EndPhysicalNames").unwrap() + "$EndPhysicalNames\n".len(),
        );
        format!("{}{}", &text[..begin], &text[end..])
    };
    let cases: Vec<(&str, String, Right)> = vec![
        (
            "two groups without names, 4.1",
            without_names(&both),
            Right::Said(&["physical groups", "1", "2", "one physical group"]),
        ),
        (
            "two groups without names, 2.2",
            without_names(&both_22),
            Right::Said(&["physical groups", "1", "2", "one physical group"]),
        ),
        (
            "other names of the two groups",
            both.replace("\"wall\"", "\"left ventricle\"")
                .replace("\"scar\"", "\"Narbe\""),
            Right::Said(&["\"left ventricle\" (1)", "\"Narbe\" (2)"]),
        ),
        (
            "a surface that is not turned",
            turned.replace(" 1 -11 4 ", " 1 11 4 "),
            Right::Same,
        ),
        (
            "a surface in three groups, two turned",
            turned.replace(" 1 -11 4 ", " 3 -11 21 -22 4 "),
            Right::Same,
        ),
        (
            "a turned volume",
            turned.replace(" 1 1 3 1 2 -3 ", " 1 -1 3 1 2 -3 "),
            Right::Same,
        ),
        (
            "Windows' line ends",
            turned.replace('\n', "\r\n"),
            Right::Same,
        ),
    ];
    let mut faults = Vec::new();
    for (what, text, right) in &cases {
        assert!(
            [&both, &both_22, &turned]
                .iter()
                .all(|sound| *sound != text),
            "{what}"
        );
        let fault = match (parse(text), right) {
            (Ok(mesh), Right::Same) => {
                let endocardium = |mesh: &TetMesh| {
                    mesh.surface("endocardium")
                        .map(|surface| surface.triangles.clone())
                };
                (mesh.tags != base.tags || endocardium(&mesh) != endocardium(&base))
                    .then(|| "other tags or surfaces".to_owned())
            }
            (Err(error), Right::Said(parts)) => {
                let said = error.to_string();
                (!parts.iter().all(|part| said.contains(part))).then_some(said)
            }
            (Ok(_), _) => Some("read".to_owned()),
            (Err(error), _) => Some(error.to_string()),
        };
        faults.extend(fault.map(|fault| format!("18: {what}: {fault}")));
    }
    (cases.len(), faults)
}
