//! The organ's law from one cohort to another.

use super::support::Cohort;

/// A run teaches a law; another patient starts from it, and a file that is no law is refused.
#[test]
fn a_law_of_one_cohort_is_the_start_of_another() {
    const RUN: [&str; 7] = [
        "run",
        "--no-report",
        "--quiet",
        "--fidelity",
        "finite-element",
        "--mesh-nodes",
        "500",
    ];
    let teacher = Cohort::quick_of("06-CoA");
    let law = teacher.path().join("law.json").display().to_string();
    // Without a beat there is nothing to learn.
    teacher
        .call(&["run", "--no-report", "--quiet", "--fidelity", "reduced"])
        .expect(0);
    let said = teacher.call(&["export", "--law", &law]).expect(1);
    assert!(said.err.contains("no law was written"), "{}", said.err);
    assert!(!std::path::Path::new(&law).exists());

    teacher.call(&[&RUN[..], &["--yes"]].concat()).expect(0);
    let said = teacher.call(&["export", "--law", &law]).expect(0);
    assert!(
        said.err.contains("1 heart taught the organ's law"),
        "{}",
        said.err
    );
    let read = |file: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(file).expect("a law")).expect("JSON")
    };
    let first = read(&law);
    assert_eq!(first["organs"][0]["patient"], "06-CoA");
    assert_eq!(first["prior"]["n_organs"], 13.0);
    let error = |key: &str| first["organs"][0][key].as_f64().expect("an error");
    assert!(error("pressure_error_after_mmHg") < error("pressure_error_before_mmHg"));
    // The same run, the same law.
    let again = teacher.path().join("again.json").display().to_string();
    teacher.call(&["export", "--law", &again]).expect(0);
    assert_eq!(first, read(&again));

    // A task that learned from another law has another key.
    let pupil = Cohort::quick_of("07-CoA");
    let proposal = |cohort: &Cohort| {
        let patient = cohort.patient("07-CoA");
        patient["iterations"][0]["proposal"]["key"]
            .as_str()
            .expect("a proposal")
            .to_owned()
    };
    pupil.call(&RUN).expect(0);
    let alone = proposal(&pupil);
    pupil
        .call(&[&RUN[..], &["--law", &law, "--yes"]].concat())
        .expect(0);
    assert_ne!(alone, proposal(&pupil));

    std::fs::write(&law, "{\"schema_version\": 1}").expect("a file");
    pupil
        .call(&[&RUN[..], &["--law", &law, "--yes"]].concat())
        .expect(3)
        .complains_of(&["law.json", "a law that `cardiotwin export --law` wrote"]);
}
