//! Options that a run keeps, and consent before finished work is redone.

use crate::support::{Cohort, published};

#[test]
fn options_are_kept_with_the_run_and_a_change_that_redoes_work_needs_consent() {
    let cohort = Cohort::quick_of("02-CoA");
    cohort
        .call(&[
            "run",
            "--no-report",
            "--set",
            "step2.seed=7",
            "--workers",
            "1",
        ])
        .expect(0);
    let before = published(&cohort.patient("02-CoA"));

    let again = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(again.out.contains("nothing to do"), "{}", again.out);
    again.complains_of(&["saved options: executor.workers=1, step2.seed=7 (--unset KEY drops one"]);
    let leaves = cohort
        .call(&["config", "show", "--origin", "--json"])
        .json();
    let seed = leaves
        .as_array()
        .and_then(|leaves| leaves.iter().find(|leaf| leaf["key"] == "step2.seed"))
        .unwrap()
        .clone();
    assert_eq!(
        (&seed["value"], &seed["origin"]),
        (&7.into(), &"kept option".into())
    );

    let unset = ["run", "--no-report", "--unset", "step2.seed"];
    let told = [
        "step2.seed: 7 -> 3 (cohort.toml:",
        "1 patient done would be redone: 1 from step-2 on; 2 tasks that took",
    ];
    let refused = cohort.call(&unset).expect(2);
    refused.complains_of(&[&told[..], &["nothing was done: add --yes"]].concat());
    let dry = cohort
        .call(&[&unset[..], &["--dry-run"]].concat())
        .expect(0);
    assert!(
        told.iter().all(|words| dry.out.contains(words)),
        "{}",
        dry.out
    );
    assert_eq!(published(&cohort.patient("02-CoA")), before);

    cohort.call(&[&unset[..], &["--yes"]].concat()).expect(0);
    let after = published(&cohort.patient("02-CoA"));
    assert_ne!(after, before);
    let kept = cohort.call(&["run", "--no-report", "--unset", "step2.seed"]);
    kept.expect(2)
        .complains_of(&["--unset step2.seed: this run keeps executor.workers"]);
}
