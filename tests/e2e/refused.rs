//! Patients whose files have errors: they are refused alone, and the others run.

use serde_json::Value;

use crate::support::{Cohort, published};

const FILE: &str = "patients/02-CoA/patient.toml";

/// Pseudonyms of the patients that `status` shows as refused, and the number of errors of the first.
fn refused(status: &Value) -> (Vec<&str>, usize) {
    let rows = status["refused"].as_array();
    let rows = rows.map(Vec::as_slice).unwrap_or_default();
    let names = rows.iter().filter_map(|row| row["patient"].as_str());
    let n_errors = rows
        .first()
        .and_then(|row| row["errors"].as_array())
        .map_or(0, Vec::len);
    (names.collect(), n_errors)
}

#[test]
fn one_broken_patient_is_refused_and_the_others_run() {
    let cohort = Cohort::quick();
    let sound = std::fs::read(cohort.path().join(FILE)).unwrap();
    std::fs::write(cohort.path().join(FILE), "\0junk").unwrap();

    let strict = cohort.call(&["run", "--strict"]).expect(3);
    strict.complains_of(&["patient.toml:1", "2 errors"]);
    assert!(!cohort.run_dir().join("cardiotwin.db").exists());
    let alone = cohort.call(&["run", "--patient", "02-CoA"]).expect(3);
    alone.complains_of(&["patient.toml:1"]);

    let said = cohort.call(&["run", "-q"]).expect(1);
    assert!(
        said.out
            .contains("1 done, 1 refused for errors in their files"),
        "{}",
        said.out
    );
    // Errors are printed even if the program is quiet.
    said.complains_of(&["error: ", "patients/02-CoA/patient.toml:1"]);
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(refused(&status), (vec!["02-CoA"], 2), "{status:#}");
    let table = cohort.call(&["status"]).expect(0).out;
    assert!(
        table.contains("02-CoA") && table.contains("refused") && table.contains("[input] "),
        "{table}"
    );
    let report = std::fs::read_to_string(cohort.run_dir().join("report.html")).unwrap();
    assert!(report.contains("Not part of this run") && report.contains("02-CoA"));
    let done = published(&cohort.patient("01-CoA"));

    // Once its file is mended, the patient runs, and nothing of the other one is repeated.
    std::fs::write(cohort.path().join(FILE), &sound).unwrap();
    cohort.call(&["run"]).expect(0);
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(refused(&status), (vec![], 0), "{status:#}");
    assert_eq!(published(&cohort.patient("01-CoA")), done);
    let of_second = published(&cohort.patient("02-CoA"));
    assert!(of_second.len() >= 5, "{of_second:?}");

    // A file that breaks later loses no result.
    std::fs::write(cohort.path().join(FILE), "\0junk").unwrap();
    cohort.call(&["run"]).expect(1);
    assert_eq!(published(&cohort.patient("02-CoA")), of_second);
    std::fs::write(cohort.path().join(FILE), &sound).unwrap();
    let again = cohort.call(&["run"]).expect(0);
    assert!(again.out.contains("nothing to do"), "{}", again.out);
}

#[test]
fn an_error_of_the_cohort_refuses_all() {
    let cohort = Cohort::quick();
    cohort.edit(
        "cohort.toml",
        "fidelity = \"reduced\"",
        "fidelity = \"none\"",
    );
    let said = cohort.call(&["run"]).expect(3);
    said.complains_of(&["cohort.toml:2"]);
    assert!(!cohort.run_dir().join("cardiotwin.db").exists());
}

/// A device never ends, a pipe keeps its reader waiting, and a sparse file fills the memory.
#[test]
fn files_that_cannot_be_read_whole_are_refused() {
    let cohort = Cohort::quick();
    let file = cohort.path().join(FILE);
    std::fs::remove_file(&file).unwrap();
    let check = |expected: &[&str]| {
        let said = cohort.call(&["run", "--strict"]).expect(3);
        said.complains_of(expected);
        std::fs::remove_file(&file).unwrap();
    };
    std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
    check(&["patient.toml", "a device, expected a regular file"]);
    let made = std::process::Command::new("mkfifo").arg(&file).status();
    assert!(made.is_ok_and(|status| status.success()));
    check(&["patient.toml", "a pipe, expected a regular file"]);
    let sparse = std::fs::File::create(&file).unwrap();
    sparse.set_len(10 << 30).unwrap();
    check(&["patient.toml", "10.0 GiB, expected at most 16 MiB"]);

    std::fs::write(&file, "id = \"\\u001b[2J\"\n").unwrap();
    let said = cohort.call(&["run", "--strict"]).expect(3);
    assert!(!said.err.contains('\u{1b}'), "{:?}", said.err);
    said.complains_of(&["id: found", "1b"]);
}

/// A folder that vanished is said, its results stay, and it continues when it comes back.
#[test]
fn a_patient_whose_folder_vanished_is_told() {
    let cohort = Cohort::quick();
    cohort.call(&["run", "--no-report", "-q"]).expect(0);
    let done = published(&cohort.patient("02-CoA"));
    let (folder, aside) = (
        cohort.path().join("patients/02-CoA"),
        cohort.path().join("aside"),
    );
    std::fs::rename(&folder, &aside).unwrap();
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    said.complains_of(&["no folder any more: 02-CoA"]);
    let quiet = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(!quiet.err.contains("no folder"), "{}", quiet.err);
    std::fs::rename(&aside, &folder).unwrap();
    let back = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(back.out.contains("nothing to do"), "{}", back.out);
    assert_eq!(published(&cohort.patient("02-CoA")), done);
}
