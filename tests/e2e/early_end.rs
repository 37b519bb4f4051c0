//! A 3D simulation that ends early at parameters that step 1 reaches: `examples/early-end`.

use std::path::Path;

use super::support::{Cohort, published};

/// Steps 2 and 3 as short as possible: the test is about step 1.
const SHORT: &str = "\n[step2]\npopsize = 3\nmax_generations = 4\n\n[verification]\nenabled = false\n\n\
                     [workflow]\nuntil = \"step2-verification\"\n";

#[test]
fn step_1_goes_on_from_its_best_simulation_and_a_rerun_repeats_nothing() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/early-end");
    let cohort = Cohort::quick_of("04-CoA");
    let settings = std::fs::read_to_string(example.join("cohort.toml")).unwrap();
    std::fs::write(cohort.path().join("cohort.toml"), settings + SHORT).unwrap();
    let file = "patients/04-CoA/patient.toml";
    std::fs::copy(example.join(file), cohort.path().join(file)).unwrap();

    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(
        said.out.contains("stalled: best iteration 2 of 3"),
        "{}",
        said.out
    );
    let status = cohort.call(&["status"]).expect(0).out;
    assert!(
        status.contains("stalled: best iteration 2 (a simulation failed"),
        "{status}"
    );
    let explained = cohort.call(&["explain", "04-CoA"]).expect(0).out;
    for part in [
        "step 1 stalled: simulation 3 failed [numerics]: simulation ended at 165 ms",
        "the patient continues with simulation 2",
        "`cardiotwin rerun 04-CoA --from step1 --damping 0.5`",
    ] {
        assert!(explained.contains(part), "{part} is not in {explained}");
    }
    let place = |word: &str| status.find(word).expect(word);
    assert!(
        place("not verified") < place("step 1 stalled"),
        "the verdict comes before what a narrow table cuts off: {status}"
    );
    let before = published(&cohort.patient("04-CoA"));

    // The README's line.
    cohort
        .call(&["rerun", "04-CoA", "--from", "step1", "--damping", "0.5"])
        .expect(0);
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(
        said.out.contains("converged: iteration 4 of 4"),
        "{}",
        said.out
    );
    assert!(said.out.contains("3 tasks computed"), "{}", said.out);
    let explained = cohort.call(&["explain", "04-CoA"]).expect(0).out;
    for part in [
        "step1.damping: 1.0 -> 0.5",
        "`cardiotwin rerun 04-CoA --from step1 --set step1.damping=0.5`",
    ] {
        assert!(explained.contains(part), "{part} is not in {explained}");
    }
    assert!(
        !explained.contains(" differs from its previous task"),
        "no results of earlier tasks: {explained}"
    );
    let patient = cohort.patient("04-CoA");
    let after = published(&patient);
    let simulations = patient["iterations"].as_array().map_or(0, Vec::len);
    assert_eq!(simulations, 4);
    let n_kept = before.iter().filter(|task| after.contains(task)).count();
    assert!(
        n_kept >= 3,
        "step 0 and both simulations stay: {before:?}, {after:?}"
    );
}
