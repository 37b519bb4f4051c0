//! The benchmark of Aróstica et al. 2025 with the real program and the example files, shortened to
//! the length of a test.

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Rows of a table, each a map from column to value.
fn rows(text: &str) -> Vec<HashMap<String, f64>> {
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let numbers = |line: &str| {
        line.split(',')
            .map(|x| x.parse().unwrap())
            .collect::<Vec<f64>>()
    };
    lines
        .map(|line| {
            head.iter()
                .map(|h| (*h).to_owned())
                .zip(numbers(line))
                .collect()
        })
        .collect()
}

#[test]
fn the_first_quarter_of_a_second_of_step_0a_is_that_of_the_ten_codes() {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
    let mut text = fs::read_to_string(examples.join("benchmarks/arostica2025-lv-0a.toml")).unwrap();
    let mesh = examples.join("meshes/arostica_lv/arostica_lv");
    // With longer steps, and only up to the contraction.
    for (from, to) in [
        ("dt_ms = 2.0", "dt_ms = 5.0"),
        ("end_ms = 1000.0", "end_ms = 250.0"),
        (
            "\"../meshes/arostica_lv/arostica_lv\"",
            &format!("{:?}", mesh.display().to_string()),
        ),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("0a.toml");
    fs::write(&file, text).unwrap();
    let program = env!("CARGO_BIN_EXE_cardiotwin-dev");
    let output = Command::new(program)
        .args(["mechanics-case", "--quiet"])
        .arg(&file)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let here = rows(&String::from_utf8(output.stdout).unwrap());
    let reference = rows(
        &fs::read_to_string(examples.join("benchmarks/arostica2025-lv-0a.reference.csv")).unwrap(),
    );
    let (last, codes) = (here.last().unwrap(), &reference[25]);
    assert_eq!((last["t_s"], codes["t_s"]), (0.25, 0.25));
    for probe in ["p0", "p1"] {
        for axis in ["x", "y", "z"] {
            let name = format!("{probe}_u{axis}_mm");
            assert!(
                (last[&name] - codes[&name]).abs() < 0.3,
                "{name}: {} of {}",
                last[&name],
                codes[&name]
            );
        }
    }
    let (low, high) = (codes["cavity_min_mL"], codes["cavity_max_mL"]);
    assert!(
        (low - 0.3..high + 0.3).contains(&last["cavity_mL"]),
        "{} mL of {low} to {high}",
        last["cavity_mL"]
    );
}
