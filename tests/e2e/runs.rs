//! Whole runs, and the tasks that a change makes them repeat.

use std::path::Path;

use serde_json::Value;

use crate::schema::misfits;
use crate::support::{Cohort, PATIENTS, published};

#[test]
fn a_cohort_runs_to_the_end_and_the_second_time_does_nothing() {
    let cohort = Cohort::quick();
    let run = [
        "run",
        "--set",
        "workflow.until=step3",
        "--set",
        "step3.max_iterations=1",
        "--set",
        "posterior.enabled=true",
        "--set",
        "posterior.draws=40",
    ];
    let said = cohort.call(&run).expect(0);
    for part in ["PATIENT", "P_max", "01-CoA", "02-CoA", "2 done", "report: "] {
        assert!(said.out.contains(part), "{part} is not in\n{}", said.out);
    }
    assert!(
        said.err.contains("step-1  iteration 1  cost"),
        "a line for each finished step:\n{}",
        said.err
    );
    assert!(
        said.err.contains("step-3  iteration 1  "),
        "step 3 is one of them:\n{}",
        said.err
    );
    assert!(
        !said.out.contains('\x1b') && !said.err.contains('\x1b'),
        "no colour in pipes"
    );
    let report = std::fs::read_to_string(cohort.run_dir().join("report.html")).unwrap();
    assert!(
        report.contains("01-CoA") && report.contains("<svg"),
        "a report with plots"
    );

    let before: Vec<_> = PATIENTS
        .iter()
        .map(|id| published(&cohort.patient(id)))
        .collect();
    assert!(before.iter().all(|tasks| tasks.len() >= 5), "{before:?}");
    let again = cohort.call(&run).expect(0);
    assert!(again.out.contains("nothing to do"), "{}", again.out);
    let after: Vec<_> = PATIENTS
        .iter()
        .map(|id| published(&cohort.patient(id)))
        .collect();
    assert_eq!(before, after);
}

#[test]
fn space_mapping_proposes_each_simulation_and_goes_on_from_those_of_the_fixed_point() {
    let cohort = Cohort::quick();
    let run = ["run", "--no-report", "--patient", "02-CoA"];
    // With these weights the minimised misfit is the cost.
    let counted = [
        "dPdt_max_mmHg_per_ms",
        "dPdt_min_mmHg_per_ms",
        "PTD90_ms",
        "tau_VD_ms",
        "tau_VR_ms",
    ];
    let mut of_the_cost = vec!["--set".to_owned(), "step1.weights.SV_mL=0".to_owned()];
    of_the_cost.extend(
        counted
            .iter()
            .flat_map(|name| ["--set".to_owned(), format!("step1.weights.{name}=1")]),
    );
    let of_the_cost: Vec<&str> = of_the_cost.iter().map(String::as_str).collect();
    let said = cohort
        .call(&[&run[..], &["--update", "space-mapping"], &of_the_cost].concat())
        .expect(0);
    assert!(
        said.err.contains("step-1  proposal 1  predicted cost"),
        "{}",
        said.err
    );
    let patient = cohort.patient("02-CoA");
    assert_eq!(patient["step1"]["quality"]["quality"], "converged");
    let iteration = &patient["iterations"][0];
    assert!(
        iteration["cost"].as_f64().unwrap() < 0.02,
        "the ventricle that is simulated proposes: {iteration}"
    );
    let shown = cohort.call(&["show", "02-CoA"]).expect(0).out;
    assert!(
        shown.contains("PREDICTED") && shown.contains("one-fibre ventricle"),
        "{shown}"
    );

    // The default again gives other iterations; a rerun then proposes on top of them.
    cohort
        .call(&[&run[..], &["--unset", "all", "--yes"]].concat())
        .expect(0);
    let before = cohort.patient("02-CoA")["iterations"]
        .as_array()
        .unwrap()
        .len();
    let other = [
        "--set",
        "step1.update=space-mapping",
        "--set",
        "step1.tolerance=0.005",
    ];
    cohort
        .call(
            &[
                &["rerun", "02-CoA", "--from", "step1"],
                &other[..],
                &of_the_cost,
            ]
            .concat(),
        )
        .expect(0);
    cohort.call(&run).expect(0);
    let iterations = cohort.patient("02-CoA")["iterations"]
        .as_array()
        .unwrap()
        .clone();
    assert!(iterations.len() > before, "{iterations:?}");
    assert_eq!(
        iterations[before]["proposal"]["result"]["from_iteration"].as_u64(),
        Some(before as u64)
    );
    // The rerun's settings differ from the file's, and yet nothing is left to do.
    let said = cohort.call(&[&run[..], &["--dry-run"]].concat()).expect(0);
    assert!(
        !said.out.contains("redo") && said.out.contains("change nothing"),
        "{}",
        said.out
    );
}

#[test]
fn a_changed_setting_redoes_only_what_depends_on_it_and_explain_names_it() {
    let cohort = Cohort::quick();
    cohort.call(&["run", "--no-report"]).expect(0);
    let before = published(&cohort.patient("01-CoA"));
    cohort.edit("cohort.toml", "seed = 3", "seed = 7");
    let said = cohort.call(&["run", "--dry-run"]).expect(0);
    assert!(
        said.out.contains("redo step-2 and all later steps"),
        "{}",
        said.out
    );
    assert_eq!(
        published(&cohort.patient("01-CoA")),
        before,
        "a dry run does nothing"
    );
    cohort.call(&["run", "--no-report", "--yes"]).expect(0);
    let after = published(&cohort.patient("01-CoA"));
    let same: Vec<&str> = before
        .iter()
        .filter(|task| after.contains(task))
        .map(|(step, ..)| step.as_str())
        .collect();
    let changed: Vec<&str> = after
        .iter()
        .filter(|task| !before.contains(task))
        .map(|(step, ..)| step.as_str())
        .collect();
    assert_eq!(changed, ["step-2", "verification"], "same: {same:?}");
    let said = cohort.call(&["explain", "01-CoA"]).expect(0).out;
    assert!(said.contains("step-2 differs"), "{said}");
    assert!(
        said.contains("seed: 3 -> 7") && said.contains("cohort.toml:5"),
        "the key and its place:\n{said}"
    );

    cohort.edit("cohort.toml", "seed = 7", "seed = 3");
    let said = cohort.call(&["run", "--no-report"]).expect(0).out;
    assert!(
        said.contains("nothing to do") || said.contains("0 tasks"),
        "the earlier results are found again:\n{said}"
    );
    assert_eq!(published(&cohort.patient("01-CoA")), before);
}

#[test]
fn a_changed_trace_is_named_by_its_file() {
    let cohort = Cohort::quick();
    cohort
        .call(&["run", "--no-report", "--patient", "01-CoA"])
        .expect(0);
    let trace = cohort.path().join("patients/01-CoA/pressure.csv");
    let text = std::fs::read_to_string(&trace).unwrap();
    std::fs::write(&trace, text.replacen("\n0,", "\n0.0,", 1)).unwrap();
    cohort
        .call(&["run", "--no-report", "--patient", "01-CoA"])
        .expect(0);
    let said = cohort.call(&["explain", "01-CoA"]).expect(0).out;
    assert!(
        said.contains("pressure.sha256") && said.contains("patients/01-CoA/pressure.csv"),
        "{said}"
    );
}

#[test]
fn one_patient_alone() {
    let cohort = Cohort::quick();
    cohort
        .call(&["run", "--no-report", "--patient", "02-CoA"])
        .expect(0);
    assert_eq!(cohort.patient("02-CoA")["status"]["state"], "done");
    assert_ne!(cohort.patient("01-CoA")["status"]["state"], "done");
    cohort
        .call(&["run", "--patient", "2-CoA"])
        .expect(2)
        .complains_of(&["did you mean `02-CoA`?"]);
    cohort.call(&["run", "--no-report"]).expect(0);
    assert_eq!(cohort.patient("01-CoA")["status"]["state"], "done");
}

#[test]
fn status_follows_its_schema() {
    let cohort = Cohort::quick();
    cohort
        .call(&["status"])
        .expect(5)
        .complains_of(&["nothing was run here yet"]);
    cohort.call(&["run", "--no-report"]).expect(0);
    let status = cohort.call(&["status", "--json"]).json();
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("../schemas/json/status.schema.json");
    let schema: Value = serde_json::from_str(&std::fs::read_to_string(schema).unwrap()).unwrap();
    assert_eq!(misfits(&status, &schema), Vec::<String>::new());
    assert_eq!(status["counts"]["done"], 2);
    let table = cohort.call(&["status"]).expect(0).out;
    assert!(table.starts_with("PATIENT  STEP  STATE"), "{table}");
    // The run's own folder identifies the run as well as the cohort's folder does.
    let by_run = crate::support::cardiotwin(&cohort.run_dir(), &["status", "--json"]).json();
    assert_eq!(by_run["patients"].as_array().unwrap().len(), 2);
}

#[test]
fn wrong_input_stops_before_anything_runs() {
    let cohort = Cohort::quick();
    cohort.edit("patients/01-CoA/patient.toml", "volume.csv", "cine.csv");
    cohort.edit("cohort.toml", "seed", "sead");
    cohort.call(&["run"]).expect(3).complains_of(&[
        "\nerror: patients/01-CoA/patient.toml:",
        "cine.csv",
        "cohort.toml:5",
        "did you mean `seed`?",
    ]);
    assert!(!cohort.run_dir().join("cardiotwin.db").exists());
    cohort
        .call(&["run", "--set", "step1.damping=2"])
        .expect(3)
        .complains_of(&["--set: step1.damping"]);
}

#[test]
fn pressure_alone_leaves_the_valves_at_their_start() {
    let cohort = Cohort::quick();
    cohort.edit(
        "patients/01-CoA/patient.toml",
        "volume = \"volume.csv\"",
        "end_diastolic_volume_mL = 161.2",
    );
    cohort
        .call(&["run", "--no-report", "--patient", "01-CoA"])
        .expect(0);
    let patient = cohort.patient("01-CoA");
    let valves = &patient["step1"]["parameters"]["valves"];
    assert_eq!(valves["R_AV_f_mmHg_s_per_mL"], 0.01);
    assert_eq!(valves["R_MV_f_mmHg_s_per_mL"], 0.01);
    assert_ne!(
        patient["step1"]["parameters"]["tanh"]["Smax_ref_kPa"],
        100.0
    );
}
