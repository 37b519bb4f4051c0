//! One patient on the coarsest mesh of the finite-element ventricle, to the end.

use serde_json::Value;

use crate::support::{Cohort, published};

#[test]
fn a_patient_is_personalised_on_a_coarse_mesh_and_the_reduced_ventricle_keeps_its_tasks() {
    let cohort = Cohort::quick_of("03-CoA");
    cohort.call(&["run", "--no-report"]).expect(0);
    let reduced = published(&cohort.patient("03-CoA"));

    let in_3d = ["run", "--fidelity", "finite-element", "--mesh-nodes", "500"];
    let quick = ["--set", "solver.time_step_ms=2", "--set", "solver.finite_element.tolerance=1e-3"];
    let few = ["--set", "step1.max_iterations=2", "--set", "verification.enabled=false"];
    let arguments: Vec<&str> = in_3d.iter().chain(&quick).chain(&few).copied().collect();
    let said = cohort.call(&arguments).expect(0);
    assert!(said.out.contains("1 done"), "{}", said.out);

    let patient = cohort.patient("03-CoA");
    let organ = &patient["step0"]["result"]["organ"];
    assert_eq!(organ["fidelity"], "finite-element", "{organ}");
    let number = |of: &Value, key: &str| of[key].as_f64().unwrap_or_else(|| panic!("no {key} in {of}"));
    let edv = number(&patient["step0"]["result"]["measured"], "EDV_mL");
    assert!((number(&organ["figures"], "end_diastolic_volume_mL") - edv).abs() < 2e-3 * edv, "{organ}");
    assert!((450.0..550.0).contains(&number(&organ["figures"], "nodes")), "{organ}");
    let iterations = patient["iterations"].as_array().unwrap();
    assert!(!iterations.is_empty() && iterations.len() <= 2, "{iterations:?}");
    for iteration in iterations {
        let counters = &iteration["run"]["result"]["counters"];
        assert!(number(counters, "krylov_iterations") > number(counters, "newton_iterations"), "{counters}");
        assert!(number(counters, "seconds_beat") > 0.0, "{counters}");
    }
    let found = published(&patient);
    assert!(found.iter().all(|task| !reduced.contains(task)), "no task of the reduced ventricle is one of this");
    let report = std::fs::read_to_string(cohort.run_dir().join("report.html")).unwrap();
    assert!(report.contains("tetrahedra"), "mesh figures in the report");

    let again = cohort.call(&arguments).expect(0);
    assert!(again.out.contains("nothing to do"), "{}", again.out);
    let back = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(back.out.contains("nothing to do"), "the reduced ventricle's results are found again: {}", back.out);
    assert_eq!(published(&cohort.patient("03-CoA")), reduced);
}
