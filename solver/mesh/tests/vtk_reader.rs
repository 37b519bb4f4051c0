//! An independent VTK reader opens our files: `meshio` from PyPI, in an environment below the
//! target folder. The test is skipped with a message if there is no Python or PyPI cannot be
//! reached.

use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::files::{pvd, vtu};
use cardiotwin_mesh::tet_mesh::Frame;
use cardiotwin_units::{Ml, Ms};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Reads the file and prints figures that require all of its content.
const SCRIPT: &str = r#"
import sys, meshio, numpy
mesh = meshio.read(sys.argv[1])
tets = mesh.cells_dict["tetra"]
x = mesh.points[tets]
volume = numpy.einsum("ei,ei->e", x[:, 1] - x[:, 0], numpy.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 0])).sum() / 6
triangles = len(mesh.cells_dict["triangle"])
marked = sum(int(mesh.cell_data_dict[name]["triangle"].sum()) for name in mesh.cell_data if name.startswith("surface:"))
fibre = mesh.cell_data_dict["fibre"]["tetra"]
print(len(mesh.points), len(tets), triangles, marked, repr(float(volume)), repr(float(mesh.point_data["t_ms"].sum())),
      repr(float(fibre[:, 1].sum())), int((mesh.cell_data_dict["tag"]["tetra"] == 2).sum()))
"#;

/// A Python with meshio, or the reason why there is none.
fn python() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("vtk-reader");
    let python = folder.join("bin/python");
    let has_meshio = || {
        Command::new(&python)
            .args(["-c", "import meshio"])
            .output()
            .is_ok_and(|out| out.status.success())
    };
    if has_meshio() {
        return Ok(python);
    }
    let run = |program: &Path, args: &[&str]| {
        let out = Command::new(program)
            .args(args)
            .output()
            .map_err(|e| format!("{}: {e}", program.display()))?;
        if out.status.success() {
            Ok(())
        } else {
            Err(String::from_utf8_lossy(&out.stderr).trim().to_owned())
        }
    };
    run(
        Path::new("python3"),
        &["-m", "venv", &folder.to_string_lossy()],
    )?;
    let quick = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--retries",
        "0",
        "--timeout",
        "10",
        "meshio",
    ];
    run(&python, &quick)?;
    if has_meshio() {
        Ok(python)
    } else {
        Err("meshio cannot be imported".into())
    }
}

#[test]
fn a_foreign_vtk_reader_opens_our_files() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => {
            cardiotwin_not_tested::not_tested("python-packages", format!("meshio: {why}"));
            return;
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("heart.vtu");
    let mut mesh = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 3000))
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
    let times = vtu::Field::scalar(
        "t_ms",
        (0..mesh.n_nodes()).map(|i| i as f64 * 0.25).collect(),
    );
    let content = vtu::Content {
        surfaces: true,
        point_fields: std::slice::from_ref(&times),
        ..vtu::Content::default()
    };
    vtu::write(&file, &mesh, &content).unwrap();
    pvd::write(
        &folder.path().join("beat.pvd"),
        &[(Ms(0.0), "heart.vtu".into())],
    )
    .unwrap();
    let out = Command::new(python)
        .args(["-c", SCRIPT])
        .arg(&file)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let text = String::from_utf8(out.stdout).unwrap();
    let words: Vec<f64> = text
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    let n_triangles: usize = mesh
        .surfaces
        .iter()
        .map(|surface| surface.triangles.len())
        .sum();
    let fibre: f64 = mesh.frames.iter().map(|frame| frame.fibre[1]).sum();
    let expected = [
        mesh.n_nodes() as f64,
        mesh.n_tets() as f64,
        n_triangles as f64,
        n_triangles as f64,
        mesh.tissue_volume(&[]).0 * 1e3,
        times.values.iter().sum(),
        fibre,
        mesh.tags.iter().filter(|tag| **tag == 2).count() as f64,
    ];
    for (found, expected) in words.iter().zip(expected) {
        assert!(
            (found - expected).abs() <= 1e-9 * expected.abs(),
            "{words:?} {expected:?}"
        );
    }
    assert_eq!(words.len(), expected.len());
}
