//! Pilots of a cohort teach the organ's law of the other patients.

use rustix::process::Signal;
use serde_json::Value;

use super::support::Cohort;

const RUN: [&str; 14] = [
    "run",
    "--quiet",
    "--fidelity",
    "finite-element",
    "--mesh-nodes",
    "500",
    "--set",
    "solver.time_step_ms=2",
    "--set",
    "step1.max_iterations=1",
    "--set",
    "workflow.pilots=1",
    "--workers",
    "2",
];

/// State and note of a patient.
fn standing<'a>(status: &'a Value, id: &str) -> (&'a str, &'a str) {
    let patients = status["patients"].as_array().expect("patients");
    let patient = patients.iter().find(|p| p["patient"] == id).expect(id);
    let text = |key: &str| patient[key].as_str().expect("a text");
    (text("state"), text("note"))
}

/// The run is killed while a patient waits for the pilot, and ends as if it had not been.
#[test]
fn a_pilot_teaches_the_other_patient_in_3d() {
    let cohort = Cohort::quick_of_these(&["06-CoA", "07-CoA"]);
    let coordinator = cohort.start(&RUN[1..]);
    let status = cohort.wait_for_run(".", "a patient who waits", |status| {
        status.to_string().contains("waits for pilot 06-CoA")
    });
    assert_eq!(standing(&status, "07-CoA").1, "waits for pilot 06-CoA");
    assert_eq!(standing(&status, "07-CoA").0, "waiting");
    let dry = cohort.call(&[&RUN[..], &["--dry-run"]].concat()).expect(0);
    assert!(dry.out.contains("wait for pilots"), "{}", dry.out);
    coordinator.signal(Signal::KILL);
    coordinator.end();
    cohort.call(&RUN).expect(0);

    let (pilot, pupil) = (cohort.patient("06-CoA"), cohort.patient("07-CoA"));
    assert!(pilot["law"].is_null());
    let law = &pupil["law"];
    assert_eq!(law["result"]["organs"][0]["patient"], "06-CoA");
    let beats = law["result"]["organs"][0]["beats"].as_array();
    let verification = &pilot["verification"]["key"];
    assert!(
        beats.is_some_and(|beats| beats.contains(verification)),
        "{law:#}"
    );
    let error = |key: &str| {
        let error = law["result"]["organs"][0][key].as_f64();
        error.expect("an error")
    };
    assert!(error("pressure_error_after_mmHg") < error("pressure_error_before_mmHg"));
    let wall_s = law["provenance"]["wall_s"].as_f64().expect("a time");
    assert!(wall_s < 1.0, "every patient repeats it: {wall_s} s");

    let shown = |id: &str| cohort.call(&["show", id]).expect(0).out;
    assert!(shown("06-CoA").contains("organ's law at the start: of the program"));
    let start =
        "organ's law at the start: pilots 06-CoA (1 organ and 2 beats; error of the pressure";
    assert!(shown("07-CoA").contains(start), "{}", shown("07-CoA"));
    let page = std::fs::read_to_string(cohort.run_dir().join("report.html")).expect("a report");
    assert!(page.contains("pilots 06-CoA (1 organ and 2 beats"));
    let said = cohort.call(&["status"]).expect(0).out;
    assert!(
        said.contains("the law of further patients is learned from 06-CoA: 1 organ and 2 beats"),
        "{said}"
    );
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["learned"]["organs"][0], "06-CoA");
    assert_eq!(status["learned"]["beats"], 2);

    let again = cohort.call(&RUN).expect(0);
    assert!(again.out.contains("nothing to do"), "{}", again.out);
}
