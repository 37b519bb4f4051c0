//! Further variants of the meshes of the public reports, made here from the sound ones: placeholders of
//! fibres (kind 16), names of arrays (kind 17), and physical groups of gmsh (kind 18).

use std::path::Path;

use cardiotwin_mesh::checks::Defect;
use cardiotwin_mesh::files::{LengthUnit, MeshFileError, gmsh, vtu};
use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres};
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
    let (n_fibres, more) = fibres();
    all.extend(more);
    (n_arrays + n_groups + n_fibres, all)
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
    let with_second = |name: &str, direction: [f64; 3]| {
        let [x, y, z] = direction;
        let values = format!("{x} {y} {z} ").repeat(base.n_tets());
        let array = format!(
            "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"3\" format=\"ascii\">{values}</DataArray>"
        );
        text.replace("</CellData>", &format!("{array}</CellData>"))
    };
    let cases: Vec<(String, String, Right)> =
        ["f0", "fibers", "Fiber_Directions", "fibre dir", "FIBRES"]
            .into_iter()
            .map(|name| (name.to_owned(), fibres(name), Right::Same))
            .chain([
                (
                    "two arrays with other fibres".to_owned(),
                    with_second("f0", [0.0, 0.0, 1.0]),
                    Right::Said(&["FIB_DIR and f0", "one array of fibres"]),
                ),
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

/// Kinds 16 and 17: placeholders that are not quite one direction, and fibres that no reader takes, each
/// with a warning; fibres of a ventricle without one.
fn fibres() -> (usize, Vec<String>) {
    let text = String::from_utf8(fixture("17-vtu-foreign-arrays/FIB_DIR/heart.vtu")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let asked = Asked {
        unit: LengthUnit::Millimetre,
        left_ventricle: &[1],
        fibres: Fibres::Auto,
        cavity: None,
        wall: None,
        activation: Activation::Unasked,
        right_ventricle: None,
        sprung: &[],
    };
    let told = |text: &str| -> Vec<&'static str> {
        let file = folder.path().join("heart.vtu");
        std::fs::write(&file, text).unwrap();
        let found = intake::read(&file, &asked).unwrap();
        found.defects.iter().map(Defect::name).collect()
    };
    let n = vtu::parse(
        text.as_bytes(),
        Path::new("heart.vtu"),
        LengthUnit::Millimetre,
    )
    .unwrap()
    .mesh
    .n_tets();
    let array = |name: &str, width: usize, of: &dyn Fn(usize) -> Vec<f64>| {
        let values: Vec<String> = (0..n).flat_map(of).map(|v| format!("{v:.5}")).collect();
        format!(
            "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{width}\" format=\"ascii\">{}</DataArray>",
            values.join(" ")
        )
    };
    let begin = text.find("Name=\"FIB_DIR\"").unwrap();
    let begin = text[..begin].rfind("<DataArray").unwrap();
    let end = begin + text[begin..].find("</DataArray>").unwrap() + "</DataArray>".len();
    let instead = |arrays: &str| format!("{}{arrays}{}", &text[..begin], &text[end..]);
    let turning = |e: usize| {
        let (sine, cosine) = (0.7 * e as f64).sin_cos();
        vec![cosine, sine, 0.3]
    };
    let mostly = |e: usize| {
        if e.is_multiple_of(3) {
            turning(e)
        } else {
            vec![0.0, 0.1, 1.0]
        }
    };
    let (one, unread) = ("fibres-of-one-direction", "unread-directions");
    let cases: Vec<(&str, String, Option<&str>)> = vec![
        ("the ventricle's own", text.clone(), None),
        (
            "most in one direction",
            instead(&array("fiber", 3, &mostly)),
            Some(one),
        ),
        (
            "both signs of an oblique one",
            instead(&array("fiber", 3, &|e| {
                let sign = if e % 2 == 0 { 1.0 } else { -1.0 };
                vec![sign, 2.0 * sign, -sign]
            })),
            Some(one),
        ),
        (
            "nine components",
            instead(&array("fibers", 9, &|e| turning(e).repeat(3))),
            Some(unread),
        ),
        (
            "lengths that vary",
            instead(&array("Fiber orientation", 3, &|e| {
                turning(e).iter().map(|v| v * (1.0 + e as f64)).collect()
            })),
            Some(unread),
        ),
        (
            "a component in each array",
            instead(
                &["fiber_x", "fiber_y", "fiber_z"]
                    .map(|name| array(name, 1, &|e| vec![turning(e)[0]]))
                    .concat(),
            ),
            Some(unread),
        ),
        (
            "displacements",
            instead(&array("displacement", 3, &|e| vec![e as f64, 1.0, 0.0])),
            None,
        ),
    ];
    let mut faults = Vec::new();
    for (what, text, expected) in &cases {
        let found = told(text);
        if found != Vec::from_iter(*expected) {
            faults.push(format!("17: {what}: {found:?}"));
        }
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
            "a volume in a group and the same, turned",
            turned.replace(" 1 1 3 1 2 -3 ", " 2 1 -1 3 1 2 -3 "),
            Right::Same,
        ),
        (
            "a surface with the number of a volume",
            turned
                .replace("2 11 \"endocardium\"", "2 1 \"endocardium\"")
                .replace(" 1 -11 4 ", " 1 -1 4 "),
            Right::Same,
        ),
        (
            "a volume in a group without a name",
            turned.replace(" 1 1 3 1 2 -3 ", " 2 1 9 3 1 2 -3 "),
            Right::Said(&["\"wall\" (1) and 9", "one physical group"]),
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
