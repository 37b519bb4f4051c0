//! Mechanics benchmarks from a file, with the real program.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A cube of 10 mm in five tetrahedra, as CARP files, with its lower and upper side as surfaces.
fn write_cube(stem: &Path) {
    let with = |extension: &str| format!("{}.{extension}", stem.display());
    let points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)];
    let mut text = String::from("8\n");
    for (x, y, z) in points {
        text += &format!("{} {} {}\n", 10_000 * x, 10_000 * y, 10_000 * z);
    }
    fs::write(with("pts"), text).unwrap();
    fs::write(with("elem"), "5\nTt 0 1 3 4 1\nTt 1 2 3 6 1\nTt 1 4 5 6 1\nTt 3 4 6 7 1\nTt 1 3 4 6 1\n").unwrap();
    fs::write(with("low.surf"), "2\nTr 0 3 1\nTr 1 3 2\n").unwrap();
    fs::write(with("high.surf"), "2\nTr 4 5 6\nTr 4 6 7\n").unwrap();
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
    Command::new(env!("CARGO_BIN_EXE_cardiotwin-worker"))
        .args(["benchmark", "--quiet"])
        .arg(folder.join("case.toml"))
        .output()
        .unwrap()
}

fn table(output: &Output) -> Vec<Vec<f64>> {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert_eq!(text.lines().next(), Some("t_s,top_ux_mm,top_uy_mm,top_uz_mm"));
    text.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect()
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
    assert!((moved[6][3] / settled[0][3] - 1.0).abs() < 0.02, "{moved:?} {settled:?}");
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
        ("unit = \"um\"", "unit = \"nm\"", ["mesh.unit: found \"nm\"", "expected one of um, mm, cm, m"]),
        (
            "surface = \"high\"",
            "surface = \"top\"",
            ["pressure[0].surface: found \"top\"", "a surface of the mesh: high, low"],
        ),
        ("until_s = 0.05", "until_s = 0.0", ["pressure[0].course.until_s: found 0", "expected more than zero"]),
        (
            "output_every_ms = 50.0",
            "output_every_ms = 3.0",
            ["time.output_every_ms: found 3", "a whole number of steps"],
        ),
        ("alpha_f = 0.4", "alpha_f = 0.7", ["time.alpha_m, time.alpha_f: found 0.2, 0.7", "alpha_m ≤ alpha_f ≤ 1/2"]),
        ("law = \"neo-hookean\"", "law = \"hooke\"", ["unknown variant `hooke`", "case.toml"]),
        ("dt_ms = 2.0", "dt = 2.0", ["unknown field `dt`", "docs/benchmark-runner.md"]),
        ("file = \"cube\"", "file = \"cub\"", ["mesh.file", "cub.pts"]),
        ("at_mm = [5.0, 5.0, 10.0]", "at_mm = [5.0, 5.0, 30.0]", ["probe 0 at (5.000, 5.000, 30.000) mm", "outside"]),
        ("mu_kPa = 10.0", "mu_kPa = -1.0", ["mu_kPa = -1", "case.toml"]),
    ] {
        let text = error(from, to);
        assert!(parts.iter().all(|part| text.contains(part)), "{to}: {text}");
    }
}
