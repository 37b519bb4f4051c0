//! `cardiotwin prepare` on recordings with known truth, and `fit afterload` without a measured
//! flow.

use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::schema::misfits;
use crate::support::cardiotwin;

const RAW: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/recordings/P001-raw"
);

fn schema(name: &str) -> Value {
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../schemas/json")
        .join(name);
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

/// A copy of the example's recordings with changes.
fn copy(change: impl Fn(&str, String) -> Option<String>) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("raw");
    std::fs::create_dir(&raw).unwrap();
    for name in ["catheter.csv", "cine.csv", "prepare.toml"] {
        let text = std::fs::read_to_string(Path::new(RAW).join(name)).unwrap();
        if let Some(text) = change(name, text) {
            std::fs::write(raw.join(name), text).unwrap();
        }
    }
    (folder, raw)
}

fn step<'a>(answer: &'a Value, name: &str) -> &'a Value {
    answer["steps"]
        .as_array()
        .unwrap()
        .iter()
        .find(|step| step["step"] == name)
        .unwrap()
}

/// The command in the example's README has the true values: a cycle of 962 ms with 4 ectopic beats,
/// a drift of 4 mmHg/min, a systole times 1.020 and a lag of -51.5 ms in the cine, and volumes to
/// be multiplied by 1.0277.
#[test]
fn recordings_become_a_patient_that_check_accepts() {
    let folder = tempfile::tempdir().unwrap();
    let call = ["prepare", RAW, "cohort/patients/P001", "--json"];
    let said = cardiotwin(folder.path(), &call).expect(0);
    assert!(said.err.contains("no problems"), "{}", said.err);
    let answer: Value = serde_json::from_str(&said.out).unwrap();
    assert_eq!(
        misfits(&answer, &schema("prepare.schema.json")),
        Vec::<String>::new()
    );
    let number = |name: &str, key: &str| step(&answer, name)["numbers"][key].as_f64().unwrap();
    assert!((answer["cycle_length_ms"].as_f64().unwrap() - 962.0).abs() < 20.0);
    let left_out = answer["beats"]["left_out"].as_array().unwrap();
    assert_eq!(
        left_out
            .iter()
            .filter(|beat| beat["kind"] == "ectopic")
            .count(),
        3,
        "{left_out:#?}"
    );
    assert!(
        left_out.len() <= 12
            && left_out
                .iter()
                .all(|beat| !beat["reasons"][0].as_str().unwrap().is_empty())
    );
    assert!((number("drift", "ventricle_mmHg_per_min") - 4.0).abs() < 1.0);
    assert!((number("volume", "factor") - 1.0277).abs() < 0.03);
    let patient = folder.path().join("cohort/patients/P001");
    for name in answer["written"].as_array().unwrap() {
        assert!(patient.join(name.as_str().unwrap()).is_file(), "{name}");
    }
    // The files agree with the answer, and the recordings are unchanged.
    let kept: Value = serde_json::from_str(
        &std::fs::read_to_string(patient.join("prepared/prepare.json")).unwrap(),
    )
    .unwrap();
    assert_eq!(kept, answer);
    assert_eq!(
        std::fs::read_dir(folder.path().join("cohort/patients"))
            .unwrap()
            .count(),
        1,
        "no litter"
    );
    std::fs::write(
        folder.path().join("cohort/cohort.toml"),
        "name = \"made\"\nsolver.fidelity = \"reduced\"\n",
    )
    .unwrap();
    cardiotwin(folder.path(), &["check", "cohort", "--strict"]).expect(0);
    // Existing files are replaced only on request, and never if something else made them.
    cardiotwin(folder.path(), &call)
        .expect(2)
        .complains_of(&["already exists", "--replace"]);
    cardiotwin(
        folder.path(),
        &["prepare", RAW, "cohort/patients/P001", "--replace"],
    )
    .expect(0);
    assert_eq!(
        std::fs::read_dir(folder.path().join("cohort/patients"))
            .unwrap()
            .count(),
        1,
        "no litter"
    );
    cardiotwin(folder.path(), &["prepare", RAW, "cohort", "--replace"])
        .expect(2)
        .complains_of(&["P001"]);
}

#[test]
fn steps_are_switched_off_and_overridden_in_a_file() {
    let (folder, raw) = copy(|name, text| {
        let steps = "\n[steps.reject]\nleave_out = [1]\nkeep = [2]\n[steps.drift]\nenabled = false\n[steps.average]\nalign = false\n\
                     [steps.volume]\nfactor = 1.5\n[steps.cycle]\nenabled = false\n[steps.synchronise]\nlag_ms = -12.5\n\
                     [steps.afterload]\nenabled = false\n[steps.noise]\npressure_rms_mmHg = 1.25\n";
        Some(if name == "prepare.toml" {
            text + steps
        } else {
            text
        })
    });
    let answer = cardiotwin(folder.path(), &["prepare", "raw", "--dry-run", "--json"]).json();
    let state = |name: &str| step(&answer, name)["state"].as_str().unwrap().to_owned();
    for (name, expected) in [
        ("drift", "off"),
        ("volume", "given"),
        ("cycle", "off"),
        ("synchronise", "given"),
        ("afterload", "off"),
        ("noise", "given"),
    ] {
        assert_eq!(state(name), expected, "{name}");
    }
    assert_eq!(step(&answer, "synchronise")["numbers"]["lag_ms"], -12.5);
    let first = &answer["beats"]["left_out"][0];
    assert_eq!(
        (first["number"].as_u64(), first["kind"].as_str()),
        (Some(1), Some("by-hand"))
    );
    let patient = answer["patient_toml"].as_str().unwrap();
    assert!(
        patient.contains("pressure_rms_mmHg = 1.25") && !patient.contains("[afterload]"),
        "{patient}"
    );
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "a dry run writes nothing"
    );
    drop(raw);
}

#[test]
fn bad_recordings_are_refused_with_file_line_and_key() {
    let refused = |change: &dyn Fn(&str, String) -> Option<String>, parts: &[&str]| {
        let (folder, _) = copy(change);
        cardiotwin(folder.path(), &["prepare", "raw", "P001"])
            .expect(3)
            .complains_of(parts);
        assert!(!folder.path().join("P001").exists(), "nothing is written");
    };
    let in_file = |file: &'static str, from: &'static str, to: &'static str| {
        move |name: &str, text: String| {
            Some(if name == file {
                text.replacen(from, to, 1)
            } else {
                text
            })
        }
    };
    refused(
        &in_file(
            "catheter.csv",
            "time_s,lv_pressure_mmHg",
            "time_s,lv_pressure",
        ),
        &["catheter.csv:1", "`lv_pressure`"],
    );
    refused(
        &in_file("catheter.csv", "\n0.008,", "\n0.001,"),
        &["catheter.csv:4", "1 ms after 4 ms", "increasing times"],
    );
    refused(
        &in_file("catheter.csv", "\n0.004,", "\n0.004,x"),
        &["catheter.csv:3", "found `x"],
    );
    refused(
        &in_file(
            "cine.csv",
            "time_ms,volume_mL\n0.0,",
            "time_ms,volume_mL\n0.0,-",
        ),
        &["cine.csv:2", "a volume of -"],
    );
    refused(
        &in_file("prepare.toml", "[whole_heart]", "[wholeheart]"),
        &["prepare.toml:7", "did you mean `whole_heart`?"],
    );
    refused(
        &in_file("prepare.toml", "time_ms = 829", "time_ms = 0.8e9"),
        &["whole_heart.time_ms", "0 to 3000 ms"],
    );
    refused(
        &|name: &str, text: String| (name != "catheter.csv").then_some(text),
        &["no catheter.csv in raw"],
    );
    let (folder, _) = copy(|name, text| {
        Some(if name == "prepare.toml" {
            text + "\n[steps.reject]\nkeep = [900]\n"
        } else {
            text
        })
    });
    cardiotwin(folder.path(), &["prepare", "raw", "P001"])
        .expect(3)
        .complains_of(&["no beat 900"]);
    cardiotwin(folder.path(), &["prepare", "raw", "P002"])
        .expect(2)
        .complains_of(&["\"P001\"", "\"P002\""]);
}

/// A load fitted to the volume's fall with the aortic or the cuff pressure: the two fits agree with
/// each other and with the true values.
#[test]
fn a_load_needs_no_measured_flow() {
    let folder = tempfile::tempdir().unwrap();
    cardiotwin(folder.path(), &["prepare", RAW, "P001", "--quiet"]).expect(0);
    let (volume, aorta) = ("P001/volume.csv", "P001/aortic_pressure.csv");
    let fit = |more: &[&str]| {
        let call: Vec<&str> = ["fit", "afterload", "--volume", volume, "--json"]
            .iter()
            .chain(more)
            .copied()
            .collect();
        cardiotwin(folder.path(), &call).json()
    };
    let catheter = fit(&[aorta, "--plot", "fit.svg"]);
    assert_eq!(
        misfits(&catheter, &schema("fit-afterload.schema.json")),
        Vec::<String>::new()
    );
    assert_eq!(
        (
            catheter["periodic"].as_bool(),
            catheter["record"]["n_beats"].as_u64()
        ),
        (Some(true), Some(1))
    );
    let text = std::fs::read_to_string(folder.path().join(aorta)).unwrap();
    let pressures: Vec<f64> = text
        .lines()
        .skip(1)
        .map(|line| line.split_once(',').unwrap().1.parse().unwrap())
        .collect();
    let (low, high) = pressures
        .iter()
        .fold((f64::MAX, 0.0_f64), |(l, h), p| (l.min(*p), h.max(*p)));
    let mean = pressures.iter().sum::<f64>() / pressures.len() as f64;
    let cuff = fit(&[
        "--cuff",
        &format!("{high:.1}/{low:.1}/{mean:.1}"),
        "--plot",
        "cuff.svg",
    ]);
    assert_eq!(
        misfits(&cuff, &schema("fit-afterload-cuff.schema.json")),
        Vec::<String>::new()
    );
    let total = |answer: &Value| {
        let load = &answer["afterload"];
        let r = |key: &str| load[key].as_f64().unwrap();
        r("characteristic_resistance_mmHg_s_per_mL") + r("peripheral_resistance_mmHg_s_per_mL")
    };
    assert!(
        (total(&cuff) / total(&catheter) - 1.0).abs() < 0.1,
        "{} {}",
        total(&cuff),
        total(&catheter)
    );
    let c = |answer: &Value| {
        answer["afterload"]["compliance_mL_per_mmHg"]
            .as_f64()
            .unwrap()
    };
    assert!(
        (c(&cuff) / c(&catheter) - 1.0).abs() < 0.4,
        "{} {}",
        c(&cuff),
        c(&catheter)
    );
    let assumed = fit(&["--cuff", &format!("{high:.1}/{low:.1}")]);
    assert_eq!(assumed["assumed_share"], true);
    for plot in ["fit.svg", "cuff.svg"] {
        assert!(
            std::fs::read_to_string(folder.path().join(plot))
                .unwrap()
                .starts_with("<svg xmlns")
        );
    }
    let call = |more: &[&str]| {
        let call: Vec<&str> = ["fit", "afterload"].iter().chain(more).copied().collect();
        cardiotwin(folder.path(), &call)
    };
    call(&[aorta])
        .expect(2)
        .complains_of(&["FLOW.csv and PRESSURE.csv"]);
    call(&["--volume", volume, "--cuff", "70/115"])
        .expect(2)
        .complains_of(&["systolic pressure must exceed"]);
    call(&["--volume", volume, "--cuff", "71/70"])
        .expect(3)
        .complains_of(&["no three-element Windkessel with 71/70"]);
    call(&["--volume", aorta, "--cuff", "115/70"])
        .expect(3)
        .complains_of(&["volume_mL"]);
}

/// Data that contradict each other are an error: nothing is written, and the exit code says so.
#[test]
fn a_printed_error_is_no_success() {
    let (folder, raw) = copy(|name, text| {
        Some(match name {
            // The ventricle's pressure at half its size contradicts the aorta's.
            "catheter.csv" => text
                .lines()
                .enumerate()
                .map(|(i, line)| match line.split_once(',') {
                    Some((time, rest)) if i > 0 => {
                        let (pressure, rest) = rest.split_once(',').unwrap_or((rest, ""));
                        match pressure.parse::<f64>() {
                            Ok(p) => format!("{time},{},{rest}\n", 0.5 * p),
                            Err(_) => format!("{line}\n"),
                        }
                    }
                    _ => format!("{line}\n"),
                })
                .collect(),
            _ => text,
        })
    });
    let raw = raw.to_str().unwrap();
    let said = cardiotwin(folder.path(), &["prepare", raw, "P001"]).expect(3);
    assert!(
        said.err.contains("largest ventricular pressure"),
        "{}",
        said.err
    );
    assert!(!folder.path().join("P001").exists());
}
