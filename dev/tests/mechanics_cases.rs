//! Mechanics benchmarks from a file, with the real program.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use cardiotwin_mesh::LengthUnit;
use cardiotwin_mesh::files::vtu;

/// A cube of 10 mm, divided into five tetrahedra, as CARP files with three of its sides as
/// surfaces.
fn write_cube(stem: &Path) {
    let with = |extension: &str| format!("{}.{extension}", stem.display());
    let points = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ];
    let mut text = String::from("8\n");
    for (x, y, z) in points {
        text += &format!("{} {} {}\n", 10_000 * x, 10_000 * y, 10_000 * z);
    }
    fs::write(with("pts"), text).unwrap();
    fs::write(
        with("elem"),
        "5\nTt 0 1 3 4 1\nTt 1 2 3 6 1\nTt 1 4 5 6 1\nTt 3 4 6 7 1\nTt 1 3 4 6 1\n",
    )
    .unwrap();
    fs::write(with("low.surf"), "2\nTr 0 3 1\nTr 1 3 2\n").unwrap();
    fs::write(with("high.surf"), "2\nTr 4 5 6\nTr 4 6 7\n").unwrap();
    fs::write(with("side.surf"), "2\nTr 1 2 6\nTr 1 6 5\n").unwrap();
}

const CASE: &str = r#"
title = "cube"
[mesh]
file = "cube"
unit = "um"
[element]
degree = "linear"
volume = "pointwise"
[[tissue]]
density_mg_per_mm3 = 1.0
viscosity_kPa_ms = 20.0
passive = { law = "neo-hookean", mu_kPa = 10.0 }
volumetric = { law = "quadratic", kappa_kPa = 100.0 }
[fibres]
rule = "constant"
fibre = [1.0, 0.0, 0.0]
sheet = [0.0, 1.0, 0.0]
[[fixed]]
surface = "low"
components = ["x", "y", "z"]
[[pressure]]
surface = "high"
course = { kind = "ramp", value_kPa = 1.0, until_s = 0.05 }
[[probe]]
name = "top"
at_mm = [5.0, 5.0, 10.0]
[time]
mode = "dynamic"
dt_ms = 2.0
end_ms = 300.0
output_every_ms = 50.0
alpha_m = 0.2
alpha_f = 0.4
"#;

fn run(folder: &Path, text: &str) -> Output {
    write_cube(&folder.join("cube"));
    fs::write(folder.join("case.toml"), text).unwrap();
    Command::new(env!("CARGO_BIN_EXE_cardiotwin-dev"))
        .args(["mechanics-case", "--quiet"])
        .arg(folder.join("case.toml"))
        .output()
        .unwrap()
}

fn table(output: &Output) -> Vec<Vec<f64>> {
    table_of(output, "t_s,top_ux_mm,top_uy_mm,top_uz_mm")
}

fn table_of(output: &Output, head: &str) -> Vec<Vec<f64>> {
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert_eq!(text.lines().next(), Some(head));
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(|x| x.parse().unwrap()).collect())
        .collect()
}

#[test]
fn motion_ends_where_equilibrium_is() {
    let folder = tempfile::tempdir().unwrap();
    let moved = table(&run(folder.path(), CASE));
    let times: Vec<f64> = moved.iter().map(|row| row[0]).collect();
    assert_eq!(times, [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3]);
    let still = CASE.split("mode = \"dynamic\"").next().unwrap().to_owned() + "mode = \"static\"\n";
    let settled = table(&run(folder.path(), &still));
    assert_eq!(settled.len(), 1);
    assert!(settled[0][3] < -0.1, "pressed together: {settled:?}");
    assert!(
        (moved[6][3] / settled[0][3] - 1.0).abs() < 1e-3,
        "{moved:?} {settled:?}"
    );
}

fn settled(case: &str) -> String {
    case.split("mode = \"dynamic\"").next().unwrap().to_owned() + "mode = \"static\"\n"
}

#[test]
fn two_surfaces_have_a_pressure_and_a_cavity_each() {
    let folder = tempfile::tempdir().unwrap();
    // With low pressures, so that their effects add up.
    let with = |high: f64, side: f64| {
        let second = format!(
            "[[pressure]]\nsurface = \"side\"\ncourse = {{ kind = \"constant\", value_kPa = {side} }}\n"
        );
        let cavities = "[[cavity]]\nname = \"left\"\nsurfaces = [\"high\", \"side\"]\n[[cavity]]\nname = \"right\"\nsurfaces = [\"side\"]\n";
        let text = settled(CASE).replace("value_kPa = 1.0", &format!("value_kPa = {high}"));
        let text = text.replacen("[[probe]]", &(second + cavities + "[[probe]]"), 1);
        table_of(
            &run(folder.path(), &text),
            "t_s,top_ux_mm,top_uy_mm,top_uz_mm,left_mL,right_mL",
        )
        .remove(0)
    };
    let (rest, high, side, both) = (
        with(0.0, 0.0),
        with(0.01, 0.0),
        with(0.0, 0.02),
        with(0.01, 0.02),
    );
    assert!(rest[1..4].iter().all(|u| *u == 0.0), "{rest:?}");
    assert!(
        high[3] < -1e-4 && side[1] < -1e-4,
        "each pushes along its own normal: {high:?} {side:?}"
    );
    for k in 1..4 {
        let sum = high[k] + side[k];
        assert!(
            (both[k] - sum).abs() < 0.01 * sum.abs().max(1e-3),
            "{k}: {both:?} {high:?} {side:?}"
        );
    }
    // Two sides of the cube, and the fan around the mean of their rim's nodes, which is a third of
    // an edge away from both.
    assert!(
        (rest[4].abs() - 2.0 / 9.0).abs() < 1e-5 && rest[5].abs() < 1e-12,
        "{rest:?}"
    );
    assert!((both[4] - rest[4]).abs() > 2e-5, "{both:?} {rest:?}");
}

#[test]
fn a_mesh_is_the_same_from_carp_vtu_and_gmsh_and_may_be_refined() {
    let folder = tempfile::tempdir().unwrap();
    let carp = table(&run(folder.path(), &settled(CASE)));
    let mesh =
        cardiotwin_mesh::files::carp::read(&folder.path().join("cube"), LengthUnit::Micrometre)
            .unwrap();
    vtu::write(
        &folder.path().join("cube.vtu"),
        &mesh,
        &vtu::Content {
            surfaces: true,
            ..vtu::Content::default()
        },
    )
    .unwrap();
    let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n");
    text += "$PhysicalNames\n4\n2 1 \"low\"\n2 2 \"high\"\n2 3 \"side\"\n3 4 \"wall\"\n$EndPhysicalNames\n$Nodes\n8\n";
    for (k, [x, y, z]) in mesh.nodes_mm.iter().enumerate() {
        text += &format!("{} {x} {y} {z}\n", k + 1);
    }
    text += &format!("$EndNodes\n$Elements\n{}\n", 6 + mesh.n_tets());
    let mut number = 0;
    for (tag, name) in [(1, "low"), (2, "high"), (3, "side")] {
        for [a, b, c] in &mesh.surface(name).unwrap().triangles {
            number += 1;
            text += &format!("{number} 2 2 {tag} {tag} {} {} {}\n", a + 1, b + 1, c + 1);
        }
    }
    for [a, b, c, d] in &mesh.tets {
        number += 1;
        text += &format!("{number} 4 2 4 4 {} {} {} {}\n", a + 1, b + 1, c + 1, d + 1);
    }
    fs::write(folder.path().join("cube.msh"), text + "$EndElements\n").unwrap();
    for name in ["cube.vtu", "cube.msh"] {
        let case = settled(CASE)
            .replace("file = \"cube\"", &format!("file = \"{name}\""))
            .replace("\"um\"", "\"mm\"");
        let same = table(&run(folder.path(), &case));
        assert!(
            (same[0][3] / carp[0][3] - 1.0).abs() < 1e-9,
            "{name}: {same:?} {carp:?}"
        );
    }
    // Halving the edges makes the cube softer, the second time by less.
    let refined = |n: usize| {
        let case = settled(CASE).replace("unit = \"um\"", &format!("unit = \"um\"\nrefine = {n}"));
        table(&run(folder.path(), &case))[0][3]
    };
    let (once, twice) = (refined(1), refined(2));
    assert!(
        once < carp[0][3] && (twice - once).abs() < (once - carp[0][3]).abs(),
        "{carp:?} {once} {twice}"
    );
}

#[test]
fn what_is_wrong_with_a_file_is_said_with_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let error = |from: &str, to: &str| {
        assert!(CASE.contains(from), "{from}");
        let output = run(folder.path(), &CASE.replacen(from, to, 1));
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    for (from, to, parts) in [
        (
            "unit = \"um\"",
            "unit = \"nm\"",
            ["mesh.unit: found \"nm\"", "expected one of um, mm, cm, m"],
        ),
        (
            "surface = \"high\"",
            "surface = \"top\"",
            [
                "pressure[0].surface: found \"top\"",
                "a surface of the mesh: high, low, side",
            ],
        ),
        (
            "unit = \"um\"",
            "unit = \"um\"\nrefine = 9",
            ["mesh.refine: found 9", "expected at most 4"],
        ),
        (
            "until_s = 0.05",
            "until_s = 0.0",
            [
                "pressure[0].course.until_s: found 0",
                "expected more than zero",
            ],
        ),
        (
            "output_every_ms = 50.0",
            "output_every_ms = 3.0",
            ["time.output_every_ms: found 3", "a whole number of steps"],
        ),
        (
            "alpha_f = 0.4",
            "alpha_f = 0.7",
            [
                "time.alpha_m, time.alpha_f: found 0.2, 0.7",
                "alpha_m ≤ alpha_f ≤ 1/2",
            ],
        ),
        (
            "law = \"neo-hookean\"",
            "law = \"hooke\"",
            ["unknown variant `hooke`", "case.toml"],
        ),
        (
            "dt_ms = 2.0",
            "dt = 2.0",
            ["unknown field `dt`", "docs/benchmark-runner.md"],
        ),
        (
            "file = \"cube\"",
            "file = \"cub\"",
            ["mesh.file", "cub.pts"],
        ),
        (
            "at_mm = [5.0, 5.0, 10.0]",
            "at_mm = [5.0, 5.0, 30.0]",
            [
                "probe \"top\": at_mm: found (5.000, 5.000, 30.000) mm",
                "outside",
            ],
        ),
        (
            "mu_kPa = 10.0",
            "mu_kPa = -1.0",
            ["mu_kPa = -1", "case.toml"],
        ),
    ] {
        let text = error(from, to);
        assert!(parts.iter().all(|part| text.contains(part)), "{to}: {text}");
    }
}
