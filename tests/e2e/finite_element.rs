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
    let said = cohort.call(&[&RUN[..8], &["--vtu-every", "200"]].concat()).expect(0).err;
    assert!(said.contains("VTU series: 4 frames of about 500 nodes"), "{said}");
    let patient = cohort.patient("06-CoA");
    assert_eq!(patient["step1"]["quality"]["quality"], "converged", "{patient:#}");
    let iterations = patient["iterations"].as_array().expect("iterations");
    assert!(iterations.len() <= 3, "{iterations:#?}");
    let shown = cohort.call(&["show", "06-CoA"]).expect(0).out;
    for part in
        ["passive.exponent_factor", "one-fibre ventricle corrected to 1", "verification", "MOTION", "Hu et al. 2013"]
    {
        assert!(shown.contains(part), "{part:?} is not in\n{shown}");
    }
    for run in [&iterations[iterations.len() - 1]["run"], &patient["verification"]] {
        let shortening = run["result"]["motion"]["shortening_percent"].as_f64().expect("a motion");
        assert!((0.0..40.0).contains(&shortening), "{shortening} %");
    }
    // Step 0 meets the measured end-diastole, the fit the measured peak.
    for (row, percent) in [("EDV_mL", 1.0), ("P_max_mmHg", 10.0)] {
        let line = shown.lines().find(|line| line.starts_with(row)).expect(row);
        let off = line.split_whitespace().nth(3).expect("a difference").parse::<f64>().expect("a number");
        assert!(off.abs() <= percent, "{line}");
    }
    // Pictures, their index written last, and the nodes' spread.
    let (step1, verification) = (&iterations[iterations.len() - 1]["run"], &patient["verification"]);
    for run in [step1, verification] {
        let names: Vec<&str> =
            run["artefacts"].as_array().unwrap().iter().map(|a| a["name"].as_str().unwrap()).collect();
        assert!(["heart", "series"].iter().all(|name| names.contains(name)), "{names:?}");
        let vtu = std::path::Path::new(run["directory"].as_str().unwrap()).join("vtu");
        let index = std::fs::read_to_string(vtu.join("beat.pvd")).expect("an index");
        assert!(index.matches("DataSet").count() == 4 && vtu.join("beat-00003.vtu").is_file(), "{index}");
    }
    cohort.call(&["report"]).expect(0);
    let page = std::fs::read_to_string(cohort.run_dir().join("report.html")).expect("a report");
    assert_eq!(page.matches("<svg class=\"heart\"").count(), 4);
    assert!(page.contains("cavity shortening") && page.contains("against the normal range"));
    let picture = cohort.path().join("spread.svg");
    cohort.call(&["show", "06-CoA", "--plot", &picture.to_string_lossy()]).expect(0);
    assert!(std::fs::read_to_string(&picture).expect("a picture").contains("since activation"));

    // A series changes no task's key.
    let again = cohort.call(&RUN[..8]).expect(0);
    assert!(again.out.contains("nothing to do") || again.out.contains("0 tasks"), "{}", again.out);
}
