//! The commands rerun, retry, cancel and logs.

use crate::support::{Cohort, published};

#[test]
fn rerun_with_damping_continues_from_stored_iterations() {
    let cohort = Cohort::quick();
    cohort.call(&["run", "--no-report"]).expect(0);
    let before = published(&cohort.patient("01-CoA"));
    let iterations = |tasks: &[(String, String, u64)]| -> Vec<(String, String, u64)> {
        tasks
            .iter()
            .filter(|(step, ..)| step.starts_with("step-1"))
            .cloned()
            .collect()
    };
    let first = iterations(&before);
    let rerun = [
        "rerun",
        "01-CoA",
        "--from",
        "step1",
        "--damping",
        "0.5",
        "--set",
        "step1.tolerance=0.001",
    ];
    let said = cohort.call(&rerun).expect(0);
    assert!(
        said.err.contains("continue with `cardiotwin run`"),
        "{}",
        said.err
    );
    cohort.call(&["run", "--no-report"]).expect(0);
    let after = iterations(&published(&cohort.patient("01-CoA")));
    assert!(
        after.len() > first.len(),
        "iterations were added: {} then {}",
        first.len(),
        after.len()
    );
    assert_eq!(
        after[..first.len()],
        first[..],
        "stored iterations stay as they are"
    );
    let config = cohort
        .call(&[
            "config",
            "show",
            "--origin",
            "--patient",
            "01-CoA",
            "--json",
        ])
        .json();
    let damping = config
        .as_array()
        .unwrap()
        .iter()
        .find(|leaf| leaf["key"] == "step1.damping")
        .unwrap();
    assert_eq!(
        (&damping["value"], &damping["origin"]),
        (&0.5.into(), &"rerun".into())
    );
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(
        said.out.contains("nothing to do"),
        "the rerun's settings stay: {}",
        said.out
    );
    assert_eq!(
        cohort.patient("02-CoA")["plan"]["settings"]["step1"]["damping"],
        1.0,
        "the other patient's do not change"
    );
}

/// The paper's exceptional patient, whose tenth simulation was aborted, so that the ninth was used.
/// Here too a simulation fails, the best earlier iteration is used, step 2 starts from it, and a
/// damped rerun continues after the failed one. With one evaluation of the wall for each step, the
/// beat diverges as the rise of the stress becomes fast from simulation to simulation.
#[test]
fn a_stalled_step_1_is_a_result_and_can_be_continued() {
    let cohort = Cohort::quick_of("04-CoA");
    let file = cohort.path().join("cohort.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    let runaway = "solver.cell_stretch = \"end-diastole\"\nsolver.activation.onset_ms = 0";
    std::fs::write(&file, format!("{runaway}\n{text}")).unwrap();
    let patient = cohort.path().join("patients/04-CoA/patient.toml");
    let text = std::fs::read_to_string(&patient).unwrap();
    let tight = text
        .replace("newton_iterations = 2", "newton_iterations = 1")
        .replace("shortest_step_ms = 0.25", "shortest_step_ms = 0.03");
    assert_ne!(tight, text);
    std::fs::write(&patient, tight).unwrap();
    cohort.call(&["run", "--no-report"]);
    let before = cohort.patient("04-CoA");
    assert_eq!(
        before["step1"]["quality"]["reason"], "simulation-failed",
        "{}",
        before["step1"]
    );
    let stored = before["iterations"].as_array().unwrap().clone();
    assert_eq!(stored.last().unwrap()["failure"]["class"], "numerics");
    assert!(before["step1"]["best_iteration"].as_u64().unwrap() < stored.len() as u64);
    assert!(
        before["cell_fit"]["result"]["cost"].is_number(),
        "step 2 ran from the best iteration"
    );
    let status = cohort.call(&["status"]).expect(0).out;
    assert!(status.contains("stalled: best iteration"), "{status}");

    cohort
        .call(&["rerun", "04-CoA", "--from", "step1", "--damping", "0.5"])
        .expect(0);
    cohort.call(&["run", "--no-report"]);
    let after = cohort.patient("04-CoA")["iterations"]
        .as_array()
        .unwrap()
        .clone();
    assert!(
        after.len() > stored.len(),
        "{} then {}",
        stored.len(),
        after.len()
    );
    for (old, new) in stored.iter().zip(&after) {
        assert_eq!(
            old["run"]["key"], new["run"]["key"],
            "no iteration is simulated again"
        );
    }
    assert!(
        after[stored.len()]["cost"].is_number(),
        "the damped iteration succeeded"
    );
}

#[test]
fn rerun_refuses_what_cannot_be_right() {
    let cohort = Cohort::quick();
    cohort
        .call(&["rerun", "01-CoA", "--from", "step1", "--damping", "0.5"])
        .expect(5);
    cohort
        .call(&["run", "--no-report", "--patient", "01-CoA"])
        .expect(0);
    let call = |arguments: &[&str]| {
        let mut all = vec!["rerun", "01-CoA", "--from", "step1"];
        all.extend(arguments);
        cohort.call(&all)
    };
    call(&["--damping", "1.5"])
        .expect(3)
        .complains_of(&["step1.damping", "up to 1"]);
    call(&["--bounds", "t_CR_ms=600:300"])
        .expect(3)
        .complains_of(&["lower bound < upper bound"]);
    call(&["--bounds", "t_CR=300:600"])
        .expect(2)
        .complains_of(&["did you mean `t_CR_ms`?"]);
    call(&["--set", "step1.dampin=0.5"])
        .expect(3)
        .complains_of(&["did you mean `damping`?"]);
    cohort
        .call(&["rerun", "01-CoA", "--from", "step7"])
        .expect(2)
        .complains_of(&["step7"]);
    cohort
        .call(&["rerun", "09-CoA", "--from", "step1"])
        .expect(2)
        .complains_of(&["no patient 09-CoA", "01-CoA"]);
}

#[test]
fn a_cancelled_patient_stays_so_until_it_is_retried() {
    let cohort = Cohort::quick();
    cohort
        .call(&["run", "--no-report", "--patient", "01-CoA"])
        .expect(0);
    cohort.call(&["cancel", "02-CoA"]).expect(0);
    assert_eq!(cohort.patient("02-CoA")["status"]["state"], "cancelled");
    let said = cohort.call(&["run", "--no-report"]).expect(1);
    assert!(said.out.contains("1 cancelled"), "{}", said.out);
    cohort.call(&["retry", "02-CoA"]).expect(0);
    cohort.call(&["run", "--no-report"]).expect(0);
    assert_eq!(cohort.patient("02-CoA")["status"]["state"], "done");
    let said = cohort.call(&["retry", "--failed"]).expect(0);
    assert!(said.err.contains("nothing to retry"), "{}", said.err);
}

#[test]
fn all_cancelled_patients_are_retried_by_their_class_and_with_all() {
    let cohort = Cohort::quick();
    cohort
        .call(&["run", "--no-report", "--patient", "01-CoA"])
        .expect(0);
    cohort.call(&["cancel", "--all"]).expect(0);
    // The first patient was done before: nothing of it was cancelled.
    for selection in [
        &["--class", "cancelled"][..],
        &["--failed", "--class", "cancelled"],
        &["--all"],
    ] {
        let dry = [&["retry", "--dry-run"], selection].concat();
        let said = cohort.call(&dry).expect(0);
        assert_eq!(
            said.out, "02-CoA  cancelled\n1 patient (1 cancelled) would be retried\n",
            "{selection:?}"
        );
        assert_eq!(cohort.patient("02-CoA")["status"]["state"], "cancelled");
        let said = cohort.call(&[&["retry"], selection].concat()).expect(0);
        assert!(
            said.out.contains("1 patient (1 cancelled) to retry"),
            "{}",
            said.out
        );
        assert_ne!(cohort.patient("02-CoA")["status"]["state"], "cancelled");
        cohort.call(&["cancel", "02-CoA"]).expect(0);
    }
    let said = cohort.call(&["retry", "--failed"]).expect(0);
    assert!(said.err.contains("nothing to retry"), "{}", said.err);
    cohort.call(&["retry", "--all"]).expect(0);
    cohort.call(&["run", "--no-report"]).expect(0);
    assert_eq!(cohort.patient("02-CoA")["status"]["state"], "done");
}

#[test]
fn a_running_coordinator_takes_up_requests() {
    let cohort = Cohort::slow();
    let running = cohort.start(&["--no-report", "--workers", "1"]);
    cohort.wait_for_step("step-2");
    let said = cohort.call(&["cancel", "--all"]).expect(0);
    assert!(
        said.err.contains(&format!("process {}", running.pid())),
        "{}",
        said.err
    );
    let said = running.end().expect(1);
    assert!(said.out.contains("2 cancelled"), "{}", said.out);
}

#[test]
fn a_failed_task_is_retried_with_the_same_settings() {
    let cohort = Cohort::quick();
    // A program that is no worker: every attempt ends without an outcome, which is a site failure.
    let fake = cohort.path().join("fake-worker");
    std::fs::write(&fake, "#!/bin/sh\necho 'no disk here' >&2\nexit 9\n").unwrap();
    std::fs::set_permissions(&fake, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let fake = fake.to_str().unwrap();
    let said = cohort
        .call(&[
            "run",
            "--no-report",
            "--worker",
            fake,
            "--set",
            "executor.site_retries=1",
        ])
        .expect(1);
    assert!(said.out.contains("2 failed"), "{}", said.out);
    let status = cohort.call(&["status"]).expect(0);
    assert!(
        status.out.lines().nth(1).unwrap().contains("failed"),
        "failures first:\n{}",
        status.out
    );
    assert!(
        status.err.contains("retry"),
        "the hint says what to do: {}",
        status.err
    );
    let logs = cohort.call(&["logs", "01-CoA", "--all"]).expect(0).out;
    assert!(
        logs.contains("no disk here") && logs.contains("try 2"),
        "{logs}"
    );
    let key = |id: &str| cohort.call(&["explain", id, "--json"]).json()["steps"][0]["task"].clone();
    let before = key("01-CoA");
    cohort.call(&["retry", "--failed"]).expect(0);
    cohort.call(&["run", "--no-report"]).expect(0);
    assert_eq!(key("01-CoA"), before, "the same task");
    assert_eq!(cohort.patient("01-CoA")["status"]["state"], "done");
}
