//! Searches for missing effects: the names found in a few cases, a patient outside of a cohort,
//! acceptance and its reversal, kill -9.
//!
//! The cases come from a model other than the fitted one (solver/discover/tests/cases).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

use crate::schema::misfits;
use crate::support::{Cohort, cardiotwin, start};

/// No effect, a late volume trace, and an atrial kick.
const CASES: [(&str, &[&str]); 3] = [
    ("dev-008", &[]),
    ("dev-013", &["pv_misalignment"]),
    ("dev-019", &["atrial_kick"]),
];

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from)
        .unwrap()
        .map(Result::unwrap)
        .filter(|entry| entry.path().is_file())
    {
        fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

fn case(id: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../solver/discover/tests/cases/patients")
        .join(id)
}

/// A cohort made of the cases.
fn cases() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    CASES
        .iter()
        .for_each(|(id, _)| copy(&case(id), &folder.path().join("patients").join(id)));
    fs::write(
        folder.path().join("cohort.toml"),
        "name = \"cases\"\nsolver.fidelity = \"reduced\"\n",
    )
    .unwrap();
    folder
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn schema(name: &str) -> Value {
    json(
        &Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../schemas/json")
            .join(name),
    )
}

fn names(case: &Value) -> Vec<&str> {
    case["accepted"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap())
        .collect()
}

/// Every finished attempt, with the time at which its outcome was written.
fn outcomes(run: &Path) -> BTreeMap<PathBuf, std::time::SystemTime> {
    let folders = |folder: &Path| {
        fs::read_dir(folder)
            .into_iter()
            .flatten()
            .map(|e| e.unwrap().path())
    };
    let attempts =
        folders(&run.join("attempts")).flat_map(|shard| folders(&shard).collect::<Vec<_>>());
    let outcome = |attempt: PathBuf| {
        Some((
            attempt.clone(),
            fs::metadata(attempt.join("outcome.json"))
                .ok()?
                .modified()
                .ok()?,
        ))
    };
    attempts.filter_map(outcome).collect()
}

#[test]
fn a_cohort_is_searched_killed_and_gone_on_with_and_the_names_are_right() {
    let folder = cases();
    let run = folder.path().join("discover");
    let search = [
        "discover",
        ".",
        "--all",
        "--jobs",
        "1",
        "--json",
        "found.json",
    ];
    let mut running = start(folder.path(), &search);
    running.wait_for_words("(1 of 3)");
    running.signal(Signal::KILL);
    running.end();
    let before = outcomes(&run);
    assert!(!before.is_empty());

    cardiotwin(folder.path(), &search).expect(0);
    let found = json(&folder.path().join("found.json"));
    assert_eq!(
        misfits(&found, &schema("discover-cohort.schema.json")),
        [""; 0]
    );
    for (id, expected) in CASES {
        let case = &found[id];
        assert_eq!(names(case), expected, "{id}: {}", case["summary"]);
        assert_eq!(
            (case["case"].as_str(), case["none"].as_bool()),
            (Some(id), Some(expected.is_empty()))
        );
        assert_eq!(case["effects"].as_array().unwrap().len(), 16);
        if !expected.is_empty() {
            let gap = |key: &str| case[key].as_f64().unwrap();
            assert!(
                gap("gap_heldout_after") < gap("gap_heldout_before")
                    && gap("gap_after") < gap("gap_before")
            );
        }
    }
    let after = outcomes(&run);
    assert!(
        after.len() >= 3 && before.iter().all(|(attempt, at)| after[attempt] == *at),
        "finished searches stay"
    );
    assert!(
        fs::read_to_string(run.join("report.html"))
            .unwrap()
            .contains("id=\"missing-dev-019\"")
    );

    // The result of one of its patients is known already and printed alone; stdout has nothing but
    // the JSON.
    let said = cardiotwin(folder.path(), &["discover", "patients/dev-019", "--json"]).expect(0);
    let alone: Value = serde_json::from_str(&said.out).unwrap();
    assert_eq!(alone, found["dev-019"]);
    assert_eq!(
        misfits(&alone, &schema("discover-case.schema.json")),
        [""; 0]
    );
    assert!(outcomes(&folder.path().join("patients/dev-019/discover")).is_empty());
}

/// Uses a part of the catalogue, for speed.
#[test]
fn what_is_accepted_is_personalised_with_until_it_is_reverted() {
    let cohort = Cohort::quick_of("03-CoA");
    let folder = cohort.path().join("patients/03-CoA");
    let measured = ["patient.toml", "pressure.csv", "volume.csv"];
    let bytes = || measured.map(|file| fs::read(folder.join(file)).unwrap());
    let as_measured = bytes();
    let first = cohort.call(&["run", "--no-report"]).expect(0).out;
    assert!(!first.contains("nothing to do"), "{first}");
    let gap = |patient: &Value| {
        patient["verification"]["result"]["biomarkers"]["end_of_beat_gap_mL"]
            .as_f64()
            .unwrap()
    };
    let as_it_was = cohort.patient("03-CoA");
    let before = gap(&as_it_was);

    let search = [
        "discover",
        "patients/03-CoA",
        "--effects",
        "atrial_kick,pressure_offset",
        "--json",
        "found.json",
    ];
    let said = cohort
        .call(&[&search[..], &["--accept"]].concat())
        .expect(0);
    assert!(
        said.err.contains("accepted: atrial_kick; version 1 of"),
        "{}",
        said.err
    );
    assert_eq!(
        names(&json(&cohort.path().join("found.json"))),
        ["atrial_kick"]
    );
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(!said.out.contains("nothing to do"), "{}", said.out);
    let patient = cohort.patient("03-CoA");
    assert_eq!(patient["plan"]["effects"][0]["name"], "atrial_kick");
    // The atrium adds the filling that the constant filling pressure leaves open.
    assert!(
        gap(&patient).abs() < 0.5 * before.abs(),
        "{before} {}",
        gap(&patient)
    );
    // The earlier results are kept next to it: the iterate that step 1 chose, and the verification
    // beat.
    let best = as_it_was["step1"]["best_iteration"].as_u64().unwrap() as usize;
    assert_eq!(
        patient["before"]["step1"]["key"],
        as_it_was["iterations"][best - 1]["run"]["key"]
    );
    assert_eq!(
        patient["before"]["verification"]["key"],
        as_it_was["verification"]["key"]
    );
    assert_eq!(gap(&patient["before"]), before);
    // What was accepted is told from what the patient's file has, also inside the passive law.
    let said = cohort.call(&["explain", "03-CoA"]).expect(0).out;
    for changed in ["wall_volume_mL", "exponent", "compliance_mL_per_mmHg"] {
        let line = said
            .lines()
            .find(|line| line.contains(&format!(".{changed}: ")));
        let line = line.unwrap_or_else(|| panic!("no {changed} in {said}"));
        assert!(
            line.contains("`discover --accept`, in its model.toml"),
            "{line}"
        );
    }
    assert!(!said.contains("patient.toml"), "{said}");
    let learned = fs::read_to_string(cohort.run_dir().join("models/03-CoA/model.toml")).unwrap();
    assert!(learned.contains("atrial_kick"), "{learned}");

    cohort
        .call(&["discover", "patients/03-CoA", "--revert"])
        .expect(0);
    assert!(!folder.join("model.toml").exists() && folder.join("model.v1.toml").exists());
    // Results from before the acceptance are found again.
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(said.out.contains("nothing to do"), "{}", said.out);
    assert_eq!(gap(&cohort.patient("03-CoA")), before);
    assert!(
        cohort.patient("03-CoA").get("before").is_none(),
        "nothing is accepted any more"
    );
    cohort
        .call(&["discover", "patients/03-CoA", "--revert"])
        .expect(2)
        .complains_of(&["nothing to revert"]);
    assert!(bytes() == as_measured, "what was measured was changed");
}

/// The finite-element ventricle is simulated without and with what is named. A second call repeats
/// nothing, and what the search found is kept.
#[test]
fn the_gap_in_3d_is_shown_before_and_after() {
    let folder = tempfile::tempdir().unwrap();
    copy(&case("dev-019"), &folder.path().join("patients/dev-019"));
    let settings = "name = \"one\"\n[solver]\ntime_step_ms = 2.0\n[step1]\nmax_iterations = 3\n[step2]\npopsize = 3\nmax_generations = 2\npolish = false\n";
    fs::write(folder.path().join("cohort.toml"), settings).unwrap();
    let search = [
        "discover",
        ".",
        "--effects",
        "atrial_kick",
        "--json",
        "found.json",
    ];
    let in_3d = [&search[..], &["--in-3d", "--mesh-nodes", "500"]].concat();
    let said = cardiotwin(folder.path(), &in_3d).expect(0);
    assert!(said.out.contains("TRACE IN 3D"), "{}", said.out);
    let found = json(&folder.path().join("found.json"));
    assert_eq!(
        misfits(&found, &schema("discover-cohort.schema.json")),
        Vec::<String>::new()
    );
    let gap = &found["dev-019"]["finite_element"];
    let rms = |beat: &str, trace: &str| gap[beat][trace].as_f64().unwrap();
    let volume = ["before", "after"].map(|beat| rms(beat, "volume_rms_mL"));
    assert!(volume[1] < 0.8 * volume[0], "{volume:?}");
    assert!(rms("before", "pressure_rms_mmHg") > 0.0);
    let rows = gap["gaps"].as_array().unwrap();
    assert!(
        rows.iter()
            .any(|row| row["phase"] == "atrial_systole" && row["signal"] == "volume")
    );
    let report = fs::read_to_string(folder.path().join("discover/report.html")).unwrap();
    assert!(report.contains("On the finite-element ventricle"));

    let run = folder.path().join("discover/in-3d");
    let done = outcomes(&run);
    assert!(!done.is_empty());
    cardiotwin(folder.path(), &in_3d).expect(0);
    assert_eq!(outcomes(&run), done);
    assert_eq!(json(&folder.path().join("found.json")), found);
    cardiotwin(folder.path(), &search).expect(0);
    assert_eq!(json(&folder.path().join("found.json")), found);
}

/// What cannot act is refused before anything is computed.
#[test]
fn an_accepted_effect_that_cannot_act_in_3d_is_refused_before_the_run() {
    let cohort = Cohort::quick_of("03-CoA");
    let model = "version = 1\npatient = \"03-CoA\"\nwritten = \"2026-01-01T00:00:00.000Z\"\n[from]\n[[effects]]\n\
                 name = \"passive_stiffening\"\nparameters = { exponent_factor = 2.0 }\n";
    fs::write(cohort.path().join("patients/03-CoA/model.toml"), model).unwrap();
    let in_3d = [
        "--set",
        "solver.fidelity=finite-element",
        "--set",
        "solver.finite_element.wall.muscle_law=neo-hookean",
    ];
    for command in ["check", "run"] {
        let said = cohort.call(&[&[command][..], &in_3d].concat());
        assert_ne!(said.code, 0, "{command}");
        let all = format!("{}{}", said.out, said.err);
        let why = "passive_stiffening cannot act in a finite-element ventricle";
        assert!(all.contains(why), "{all}");
    }
    assert!(!cohort.run_dir().join("attempts").exists());
}

/// An artefact corrects the traces from which step 0 takes its biomarkers.
#[test]
fn an_accepted_artefact_corrects_the_data() {
    let folder = tempfile::tempdir().unwrap();
    copy(&case("dev-013"), &folder.path().join("patients/dev-013"));
    let settings = "name = \"one\"\nsolver.fidelity = \"reduced\"\nposterior.enabled = false\n[step2]\npopsize = 3\nmax_generations = 2\npolish = false\n";
    fs::write(folder.path().join("cohort.toml"), settings).unwrap();
    let accept = [
        "discover",
        "patients/dev-013",
        "--effects",
        "pv_misalignment,atrial_kick",
        "--accept",
    ];
    let said = cardiotwin(folder.path(), &accept).expect(0);
    assert!(
        said.out
            .contains("in the data, not in the heart: pv misalignment"),
        "{}",
        said.out
    );
    cardiotwin(folder.path(), &["run", "--no-report"]).expect(0);
    let step0 = cardiotwin(folder.path(), &["show", "dev-013", "--json"]).json()["step0"].clone();
    let remarks = step0["result"]["remarks"].to_string();
    assert!(
        remarks.contains("corrected for pv_misalignment"),
        "{remarks}"
    );
    let artefact = &step0["artefacts"][0];
    assert_eq!(artefact["name"], "measured");
    let used =
        Path::new(step0["directory"].as_str().unwrap()).join(artefact["file"].as_str().unwrap());
    let late = emptiest_ms(&folder.path().join("patients/dev-013/volume.csv")) - emptiest_ms(&used);
    // The search finds 41 ms, to within the distance of two frames.
    assert!((10.0..75.0).contains(&late), "{late}");
}

/// Time of the smallest volume, which is a file's last column.
fn emptiest_ms(file: &Path) -> f64 {
    let text = fs::read_to_string(file).unwrap();
    let rows = text.lines().skip(1).map(|line| {
        line.split(',')
            .map(|v| v.parse::<f64>().unwrap())
            .collect::<Vec<_>>()
    });
    rows.min_by(|a, b| a[a.len() - 1].total_cmp(&b[b.len() - 1]))
        .unwrap()[0]
}

#[test]
fn what_cannot_be_searched_is_named() {
    let folder = cases();
    let call = |arguments: &[&str]| cardiotwin(folder.path(), arguments);
    call(&["discover", "patients"])
        .expect(2)
        .complains_of(&["neither patient.toml nor cohort.toml"]);
    call(&["discover", ".", "--accept"])
        .expect(2)
        .complains_of(&["--all", "--patient"]);
    call(&["discover", "patients/dev-008", "--all"])
        .expect(2)
        .complains_of(&["need a cohort"]);
    let said = call(&["discover", "patients/dev-008", "--effects", "kick"]).expect(1);
    assert!(
        said.err.contains("unknown effect kick") && said.err.contains("atrial_kick"),
        "{}",
        said.err
    );
    let file = folder.path().join("patients/dev-008/patient.toml");
    let text = fs::read_to_string(&file)
        .unwrap()
        .replace("volume = \"volume.csv\"", "");
    fs::write(&file, text).unwrap();
    call(&["discover", "patients/dev-008"])
        .expect(3)
        .complains_of(&["measured.volume", "both pressure and volume"]);
    call(&["discover", ".", "--strict"])
        .expect(3)
        .complains_of(&["measured.volume", "both pressure and volume"]);
    // One bad patient does not stop the others.
    let said = call(&["discover", ".", "--effects", "pressure_offset"])
        .expect(1)
        .complains_of(&["measured.volume", "dev-008 refused: 1 error in its files"]);
    let searched = format!("{} patients searched", CASES.len() - 1);
    assert!(said.err.contains(&searched), "{}", said.err);
}
