//! A patient from end to end with the finite-element ventricle.

use super::support::Cohort;

const RUN: [&str; 9] = [
    "run",
    "--no-report",
    "--fidelity",
    "finite-element",
    "--mesh-nodes",
    "500",
    "--update",
    "space-mapping",
    "--quiet",
];

#[test]
fn a_patient_is_personalised_in_3d_and_nothing_is_done_twice() {
    let cohort = Cohort::quick_of("06-CoA");
    cohort.call(&RUN).expect(0);
    let patient = cohort.patient("06-CoA");
    assert_eq!(patient["step1"]["quality"]["quality"], "converged", "{patient:#}");
    let iterations = patient["iterations"].as_array().expect("iterations");
    assert!(iterations.len() <= 3, "{iterations:#?}");
    let shown = cohort.call(&["show", "06-CoA"]).expect(0).out;
    for part in ["passive.exponent_factor", "one-fibre ventricle corrected to 1", "verification"] {
        assert!(shown.contains(part), "{part:?} is not in\n{shown}");
    }
    // Step 0 meets the measured end-diastole, the fit the measured peak.
    for (row, percent) in [("EDV_mL", 1.0), ("P_max_mmHg", 10.0)] {
        let line = shown.lines().find(|line| line.starts_with(row)).expect(row);
        let off = line.split_whitespace().nth(3).expect("a difference").parse::<f64>().expect("a number");
        assert!(off.abs() <= percent, "{line}");
    }
    let again = cohort.call(&RUN[..8]).expect(0);
    assert!(again.out.contains("nothing to do") || again.out.contains("0 tasks"), "{}", again.out);
}
