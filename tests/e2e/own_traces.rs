//! `cardiotwin init --from`: a cohort from a user's own traces.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::support::cardiotwin;

const EXAMPLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/own-traces/traces.csv"
);

/// Rows of the example: time in s, pressure in mmHg, volume in mL.
fn example() -> Vec<[f64; 3]> {
    let text = fs::read_to_string(EXAMPLE).unwrap();
    let row = |line: &str| {
        let mut cells = line.split(',').map(|cell| cell.parse().unwrap());
        [(); 3].map(|()| cells.next().unwrap())
    };
    text.lines().skip(1).map(row).collect()
}

/// A file in a new folder.
fn file(name: &str, text: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    (folder, path)
}

/// What `init --from` says as JSON, with further options.
fn made(path: &Path, more: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let from = path.to_str().unwrap();
    let call = [&["init", "mine", "--from", from, "--json"], more].concat();
    cardiotwin(folder.path(), &call).json()
}

fn understood(answer: &Value, quantity: &str) -> (f64, String) {
    let rows = answer["patients"][0]["understood"].as_array().unwrap();
    let row = rows.iter().find(|row| row["quantity"] == quantity).unwrap();
    let first = row["value"].as_str().unwrap().split(' ').next().unwrap();
    (
        first.parse().unwrap(),
        row["origin"].as_str().unwrap().to_owned(),
    )
}

/// Two commands make a twin, and nothing must be edited between them.
#[test]
fn two_columns_become_a_cohort_that_check_and_run_accept() {
    let folder = tempfile::tempdir().unwrap();
    let said = cardiotwin(folder.path(), &["init", "mine", "--from", EXAMPLE]).expect(0);
    for part in [
        "mmHg by its size",
        "mL by its size",
        "8 of 8",
        "wall volume",
        "estimated",
        "If an estimate is 20 % off",
        "picture: mine/patients/traces/prepared/understood.svg",
    ] {
        assert!(said.out.contains(part), "{part:?} is not in\n{}", said.out);
    }
    let patient = folder.path().join("mine/patients/traces");
    for name in [
        "patient.toml",
        "pressure.csv",
        "volume.csv",
        "prepared/understood.svg",
        "prepared/prepare.html",
    ] {
        assert!(patient.join(name).is_file(), "{name}");
    }
    let checked = cardiotwin(folder.path(), &["check", "mine"]).expect(0);
    assert!(checked.out.contains("0 errors") || checked.out.contains("no problems"));
    assert!(
        checked.out.contains("anatomy.wall_volume_mL"),
        "estimates are named:\n{}",
        checked.out
    );
    let run = cardiotwin(
        folder.path(),
        &[
            "run",
            "mine",
            "--no-report",
            "--set",
            "workflow.until=step2-verification",
            "--set",
            "step2.popsize=3",
            "--set",
            "step2.max_generations=4",
            "--set",
            "step2.polish=false",
        ],
    )
    .expect(0);
    assert!(run.out.contains("1 done"), "{}", run.out);
}

/// Each estimate's weight comes from simulations: a wall, a load or a filling pressure that is 20 % off
/// changes the beat, and in opposite senses.
#[test]
fn what_an_estimate_does_is_simulated() {
    let answer = made(Path::new(EXAMPLE), &[]);
    let twin = &answer["patients"][0]["twin"];
    assert_eq!(twin["converged"], true, "{twin:#}");
    let estimates = twin["estimates"].as_array().unwrap();
    let change = |key: &str, side: &str, of: &str| {
        let one = estimates.iter().find(|one| one["key"] == key).unwrap();
        one[side][of].as_f64().unwrap()
    };
    let wall = |side| change("anatomy.wall_volume_mL", side, "largest_pressure");
    assert!(
        wall("if_smaller") < -0.01 && wall("if_larger") > 0.01,
        "{estimates:#?}"
    );
    let filling = |side| change("preload.left_atrial_pressure_mmHg", side, "stroke_volume");
    assert!(
        filling("if_smaller") < -0.01 && filling("if_larger") > 0.01,
        "{estimates:#?}"
    );
    let load = |side| {
        let key = "afterload.peripheral_resistance_mmHg_s_per_mL";
        change(key, side, "stroke_volume")
    };
    assert!(
        load("if_smaller") > 0.01 && load("if_larger") < -0.01,
        "{estimates:#?}"
    );
    // What is stated is no estimate.
    let stated = made(
        Path::new(EXAMPLE),
        &[
            "--wall-volume-ml",
            "100",
            "--left-atrial-pressure-mmhg",
            "6",
            "--cuff",
            "115/75",
        ],
    );
    let estimates = stated["patients"][0]["twin"]["estimates"].to_string();
    for key in ["wall_volume", "left_atrial", "afterload"] {
        assert!(!estimates.contains(key), "{key} in {estimates}");
    }
}

/// The same beats in another form are the same patient.
#[test]
fn units_signs_headers_and_missing_times_do_not_change_the_patient() {
    let plain = made(Path::new(EXAMPLE), &[]);
    let (edp, _) = understood(&plain, "end-diastolic pressure");
    let (edv, _) = understood(&plain, "end-diastolic volume");
    let (cycle, origin) = understood(&plain, "cycle length");
    assert_eq!(origin, "assumed", "the header has no unit");
    let rows = example();
    let text = |row: &dyn Fn(&[f64; 3]) -> String| -> String {
        rows.iter().map(|r| row(r) + "\n").collect()
    };
    let other_units = text(&|r| format!("{:.0}\t{:.4}\t{:.1}", 1e3 * r[0], r[1] / 7.500_617, r[2]));
    let german = text(&|r| format!("{};{};{}", r[2], r[1], r[0])).replace('.', ",");
    let bare = text(&|r| format!("{} {}", r[2], r[1]));
    let rate = format!("{:.3}", 60_000.0 / cycle);
    let forms: [(&str, String, Vec<&str>); 3] = [
        ("t (ms)\tLVP (kPa)\tLVV (mL)\n", other_units, vec![]),
        ("", german, vec![]),
        ("", bare, vec!["--heart-rate", &rate]),
    ];
    for (header, rows, more) in forms {
        let (_folder, path) = file("other.csv", &(header.to_owned() + &rows));
        let answer = made(&path, &more);
        for (quantity, expected, tolerance) in [
            ("end-diastolic pressure", edp, 0.4),
            ("end-diastolic volume", edv, 1.0),
            ("cycle length", cycle, 0.01 * cycle),
        ] {
            let (found, _) = understood(&answer, quantity);
            assert!(
                (found - expected).abs() <= tolerance,
                "{header:?} {quantity}: {found}, not {expected}"
            );
        }
    }
}

/// One beat is enough, and a folder gives a patient a file.
#[test]
fn a_folder_of_single_beats_gives_a_patient_a_file() {
    let rows = example();
    let answer = made(Path::new(EXAMPLE), &[]);
    let (cycle, _) = understood(&answer, "cycle length");
    let n = (cycle / 5.0).round() as usize;
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("beats")).unwrap();
    for (name, begin) in [("a.csv", 400), ("b.txt", 650)] {
        let text: String = rows[begin..begin + n]
            .iter()
            .map(|r| format!("{:.3},{},{}\n", r[0], r[1], r[2]))
            .collect();
        fs::write(
            folder.path().join("beats").join(name),
            format!("s,LVP,LVV\n{text}"),
        )
        .unwrap();
    }
    let call = ["init", "mine", "--from", "beats", "--json"];
    let answer = cardiotwin(folder.path(), &call).json();
    let ids: Vec<&str> = answer["patients"]
        .as_array()
        .unwrap()
        .iter()
        .map(|patient| patient["id"].as_str().unwrap())
        .collect();
    assert_eq!(ids, ["a", "b"]);
    cardiotwin(folder.path(), &["check", "mine"]).expect(0);
}

/// Nothing is written from traces that cannot be used, each error says what to do, and nobody is asked
/// where there is no terminal.
#[test]
fn bad_traces_leave_nothing_behind() {
    let rows = example();
    let text = |row: &dyn Fn(&[f64; 3]) -> String| -> String {
        rows.iter().map(|r| row(r) + "\n").collect()
    };
    let cases = [
        (
            "no time",
            text(&|r| format!("{},{}", r[1], r[2])),
            "--heart-rate",
        ),
        (
            "pressure in kPa that is mmHg",
            "t (s),LVP (kPa),LVV (mL)\n".to_owned()
                + &text(&|r| format!("{},{},{}", r[0], r[1], r[2])),
            "did you mean --pressure-unit mmHg?",
        ),
        (
            "swapped names",
            "t (s),LVV,LVP\n".to_owned() + &text(&|r| format!("{},{},{}", r[0], r[1], r[2])),
            "are both swapped",
        ),
        (
            "one column",
            "LVP\n".to_owned() + &text(&|r| format!("{}", r[1])),
            "export the traces as text",
        ),
        (
            "a letter",
            text(&|r| format!("{},{},{}", r[0], r[1], r[2])).replacen("\n", "\nx,1,2\n", 1),
            "correct or remove the line",
        ),
        (
            "words",
            "dear diary\nnothing\n".to_owned(),
            "export the traces as text",
        ),
        ("nothing", String::new(), "export"),
        (
            "a flat line",
            text(&|r| format!("{},7,120", r[0])),
            "--pressure",
        ),
    ];
    for (name, text, remedy) in cases {
        let (folder, _) = file("bad.csv", &text);
        let said = cardiotwin(folder.path(), &["init", "mine", "--from", "bad.csv"]);
        assert!(said.code == 3, "{name}: {said:?}");
        assert!(
            said.err.contains(remedy),
            "{name}: {remedy:?} is not in\n{}",
            said.err
        );
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().flatten().collect();
        assert_eq!(left.len(), 1, "{name}: only the file itself");
    }
    // The user's file is named, not the place where the cohort was tried.
    let small = text(&|r| format!("{},{},{}", r[0], r[1] / 7.50062, r[2]));
    let (folder, _) = file("small.csv", &format!("t (s),LVP (kPa),LVV (mL)\n{small}"));
    let call = [
        "init",
        "mine",
        "--from",
        "small.csv",
        "--pressure-unit",
        "mmHg",
    ];
    let said = cardiotwin(folder.path(), &call).expect(3);
    assert!(
        said.err.contains("small.csv: pressure_mmHg: found a peak"),
        "{}",
        said.err
    );
    assert!(!said.err.contains("/tmp"), "{}", said.err);
    let alone = text(&|r| format!("{},{}", r[0], r[1]));
    let (folder, _) = file("pressure.csv", &format!("time_s,pressure_mmHg\n{alone}"));
    cardiotwin(folder.path(), &["init", "mine", "--from", "pressure.csv"])
        .expect(3)
        .complains_of(&["cardiotwin init DIR", "patients/P001", "volume.csv"]);
    let (folder, _) = file("good.csv", &fs::read_to_string(EXAMPLE).unwrap());
    fs::create_dir(folder.path().join("mine")).unwrap();
    fs::write(folder.path().join("mine/notes.txt"), "mine").unwrap();
    cardiotwin(folder.path(), &["init", "mine", "--from", "good.csv"])
        .expect(2)
        .complains_of(&["already exists"]);
    cardiotwin(folder.path(), &["init", "new", "--from", "god.csv"])
        .expect(2)
        .complains_of(&["no such file"]);
    assert_eq!(fs::read_dir(folder.path().join("mine")).unwrap().count(), 1);
}
