//! `cardiotwin mesh` on files, and `check` of a patient's own mesh.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::support::{Cohort, cardiotwin};

/// The benchmark's ventricle in the repository.
fn heart() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/meshes/arostica_lv/arostica_lv")
}

fn read(file: &Path) -> Vec<String> {
    std::fs::read_to_string(file)
        .expect("a file of the mesh")
        .lines()
        .map(str::to_owned)
        .collect()
}

fn write(file: &Path, lines: &[String]) {
    std::fs::write(file, lines.join("\n") + "\n").expect("written");
}

/// CARP files of the ventricle with defects: an inverted element, a duplicate node, an unused node,
/// and a piece inside the cavity.
fn broken(folder: &Path) -> PathBuf {
    let stem = folder.join("broken");
    let (mut points, mut elements) = (
        read(&heart().with_extension("pts")),
        read(&heart().with_extension("elem")),
    );
    let n = points.len() - 1;
    let words: Vec<String> = elements[8].split(' ').map(str::to_owned).collect();
    elements[8] = format!(
        "Tt {} {} {} {} {}",
        words[2], words[1], words[3], words[4], words[5]
    );
    let words: Vec<String> = elements[100].split(' ').map(str::to_owned).collect();
    points.push(points[words[1].parse::<usize>().expect("a node") + 1].clone());
    elements[100] = format!("Tt {n} {} {} {} {}", words[2], words[3], words[4], words[5]);
    for at in [
        "90000 0 0",
        "-20000 0 0",
        "-18000 0 0",
        "-20000 2000 0",
        "-20000 0 2000",
    ] {
        points.push(at.to_owned());
    }
    elements.push(format!("Tt {} {} {} {} 1", n + 2, n + 3, n + 4, n + 5));
    points[0] = (points.len() - 1).to_string();
    elements[0] = (elements.len() - 1).to_string();
    write(&stem.with_extension("pts"), &points);
    write(&stem.with_extension("elem"), &elements);
    stem
}

fn names(answer: &Value, list: &str) -> Vec<String> {
    let defects = answer[list].as_array().expect("a list of defects");
    defects
        .iter()
        .map(|defect| defect["name"].as_str().expect("a name").to_owned())
        .collect()
}

#[test]
fn a_broken_mesh_is_told_with_all_its_places_mended_and_refined() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    broken(folder.path());
    let said = cardiotwin(folder.path(), &["mesh", "check", "broken", "--json"]).expect(1);
    let answer: Value = serde_json::from_str(&said.out).expect("JSON");
    let found = names(&answer, "defects");
    for name in [
        "turned-elements",
        "doubled-nodes",
        "loose-pieces",
        "unused-nodes",
    ] {
        assert!(
            found.iter().any(|other| other == name),
            "{name} is not in {found:?}"
        );
    }
    let turned = answer["defects"]
        .as_array()
        .unwrap()
        .iter()
        .find(|d| d["name"] == "turned-elements")
        .unwrap();
    assert_eq!(turned["places"][0]["element"], 7, "{turned}");
    assert_eq!(
        turned["places"][0]["at_mm"].as_array().map(Vec::len),
        Some(3),
        "{turned}"
    );
    let text = cardiotwin(folder.path(), &["mesh", "check", "broken"])
        .expect(1)
        .out;
    assert!(
        text.contains("element 7 (") && text.contains("remedy:   `cardiotwin mesh repair`"),
        "{text}"
    );

    let mend = [
        "mesh",
        "repair",
        "broken",
        "--keep-largest",
        "--out",
        "whole",
        "--json",
    ];
    let done = cardiotwin(folder.path(), &mend).json();
    assert_eq!(names(&done, "left"), Vec::<String>::new());
    assert_eq!(done["mesh"]["nodes"], 4577, "as before it was broken");
    assert_eq!(done["mesh"]["elements"], 17_625);
    assert!(
        (done["mesh"]["cavity_mL"].as_f64().unwrap() - 167.518).abs() < 0.01,
        "{}",
        done["mesh"]
    );
    cardiotwin(folder.path(), &mend)
        .expect(2)
        .complains_of(&["already exists", "--force"]);
    cardiotwin(
        folder.path(),
        &["mesh", "check", "whole", "--left-ventricle", "1"],
    )
    .expect(0);

    let refined = cardiotwin(
        folder.path(),
        &["mesh", "refine", "whole", "--out", "fine.vtu", "--json"],
    )
    .json();
    assert_eq!(refined["mesh"]["elements"], 8 * 17_625);
    assert!(
        (refined["mesh"]["cavity_mL"].as_f64().unwrap() - 167.518).abs() < 0.01,
        "{}",
        refined["mesh"]
    );
    cardiotwin(folder.path(), &["mesh", "check", "fine.vtu"])
        .expect(2)
        .complains_of(&["--unit"]);
    let checked = cardiotwin(
        folder.path(),
        &["mesh", "check", "fine.vtu", "--unit", "mm", "--json"],
    )
    .json();
    assert_eq!(
        checked["mesh"]["surfaces_found"], false,
        "they were written"
    );
}

#[test]
fn a_patients_own_mesh_is_checked_before_anything_waits() {
    let cohort = Cohort::quick_of("06-CoA");
    let toml = cohort.path().join("cohort.toml");
    let settings = std::fs::read_to_string(&toml)
        .expect("settings")
        .replace("reduced", "finite-element");
    std::fs::write(&toml, settings).expect("written");
    let patient = cohort.path().join("patients/06-CoA");
    for ending in ["pts", "elem"] {
        std::fs::copy(
            heart().with_extension(ending),
            patient.join(format!("heart.{ending}")),
        )
        .expect("copied");
    }
    let file = patient.join("patient.toml");
    let before = std::fs::read_to_string(&file).expect("a patient");
    let with = |unit: &str, tag: u32, site: &str| {
        let mesh = "\n[anatomy.mesh]\nfile = \"heart\"";
        let text = format!(
            "{before}{mesh}\nunit = \"{unit}\"\nleft_ventricle = [{tag}]\nactivation_sites_mm = [{site}]\n"
        );
        std::fs::write(&file, text).expect("written");
    };
    // Several defects at once: the volume (167.5 mL instead of the image's 141.9), the tag, and the
    // site.
    with("um", 4, "[0.0, 0.0, 90.0]");
    let said = cohort.call(&["check"]).expect(1).out;
    for part in [
        "anatomy.mesh.file: found a cavity of 167.5 mL",
        "the 141.9 mL that were measured, within 10 %",
        "anatomy.mesh.left_ventricle: found no element with the tag 4; tags there are 1 (17625 elements)",
    ] {
        assert!(said.contains(part), "{part:?} is not in\n{said}");
    }
    with("mm", 1, "[-57.5, 0.0, 19.3]");
    let said = cohort.call(&["check"]).expect(1).out;
    assert!(said.contains("set anatomy.mesh.unit = \"um\""), "{said}");
    cohort.call(&["run", "--quiet"]).expect(3);
    // After scaling to the measured volume, and with a site in the wall, no complaint is left.
    let scaled = [
        "mesh",
        "repair",
        "patients/06-CoA/heart",
        "--scale",
        "0.9462",
        "--out",
        "patients/06-CoA/heart",
        "--force",
    ];
    cohort.call(&scaled).expect(0);
    with("um", 1, "[-54.4, 0.0, 18.3]");
    let said = cohort.call(&["check"]).expect(0).out;
    assert!(!said.contains("error"), "{said}");
    with("um", 1, "[0.0, 0.0, 90.0]");
    let said = cohort.call(&["check"]).expect(1).out;
    assert!(
        said.contains("activation site 1") && said.contains("away from contracting tissue"),
        "{said}"
    );
}

/// mmg3d from PyPI, installed once per build folder; `None`, with a message, if that is not
/// possible.
fn mmg3d() -> Option<PathBuf> {
    let test = std::env::current_exe().expect("a test knows its own path");
    let place = test
        .parent()
        .and_then(Path::parent)
        .expect("tests lie in target/PROFILE/deps")
        .join("mesh-tools");
    let program = place.join("bin/mmg3d_O3");
    let ready = || {
        Command::new(&program)
            .arg("-h")
            .output()
            .is_ok_and(|said| !said.stdout.is_empty())
    };
    if !ready() {
        let _ = Command::new("python3")
            .args(["-m", "venv"])
            .arg(&place)
            .output();
        let list = Path::new(env!("CARGO_MANIFEST_DIR")).join("e2e/mesh-requirements.txt");
        let pip = place.join("bin/python");
        let _ = Command::new(pip)
            .args(["-m", "pip", "install", "--quiet", "--requirement"])
            .arg(list)
            .output();
    }
    if ready() {
        return Some(program);
    }
    cardiotwin_not_tested::not_tested("python-packages", "mmg3d (python3-venv, network)");
    None
}

#[test]
fn a_mesh_is_made_anew_with_its_surfaces_tags_and_volume() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let heart = heart().to_string_lossy().into_owned();
    let cut = [
        "mesh",
        "repair",
        &heart,
        "--cut-plane",
        "20,0,0,1,0,0",
        "--passive-above",
        "12,0,0,1,0,0",
        "--out",
        "cut",
    ];
    cardiotwin(folder.path(), &cut).expect(0);
    let wanted = [
        "mesh", "remesh", "cut", "--nodes", "2000", "--out", "coarse", "--json",
    ];
    let nowhere = [&wanted[..], &["--mmg3d", "no/such/program"]].concat();
    cardiotwin(folder.path(), &nowhere)
        .expect(6)
        .complains_of(&["cannot start no/such/program"]);
    let Some(mmg3d) = mmg3d() else { return };
    let before = cardiotwin(folder.path(), &["mesh", "check", "cut", "--json"]).json();
    let named = mmg3d.to_string_lossy();
    let after = cardiotwin(folder.path(), &[&wanted[..], &["--mmg3d", &named]].concat()).json();
    let nodes = after["mesh"]["nodes"].as_f64().expect("nodes");
    assert!((1700.0..2400.0).contains(&nodes), "{nodes}");
    let of = |answer: &Value, key: &str| answer["mesh"][key].as_f64().expect("a number");
    assert!(
        (of(&after, "cavity_mL") / of(&before, "cavity_mL") - 1.0).abs() < 0.02,
        "{after}"
    );
    assert!(of(&after, "worst_mean_ratio") > 0.1, "{after}");
    assert_eq!(after["mesh"]["surfaces_found"], false, "mmg kept them");
    // The file's own `endo` shares its triangles with `endocardium`, and both are remeshed
    // together.
    let triangles = |answer: &Value, name: &str| {
        let surfaces = answer["mesh"]["surfaces"].as_array().expect("surfaces");
        let named = surfaces.iter().find(|surface| surface["name"] == name);
        named
            .and_then(|surface| surface["triangles"].as_f64())
            .unwrap_or(0.0)
    };
    for name in ["endocardium", "epicardium", "endo", "epi"] {
        let share = triangles(&after, name) / triangles(&before, name);
        assert!((0.3..0.8).contains(&share), "{name}: {share}");
    }
    let tags = |answer: &Value| {
        answer["mesh"]["tags"]
            .as_array()
            .expect("tags")
            .iter()
            .map(|t| t["tag"].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(tags(&after), tags(&before));
}
