//! Robustness sweeps: whole personalisations around a patient's, in a folder of their own.

use rustix::process::Signal;
use serde_json::Value;

use crate::support::{Cohort, published};

/// Step 1 by the paper's rule, as in the cohort's own run.
const PAPER: [&str; 6] = [
    "sweep",
    "robustness",
    "--kind",
    "data",
    "--set",
    "step1.stop=first-converged",
];
const DATA: [&str; 4] = ["--patient", "02-CoA", "--samples", "2"];
const FOLDER: &str = "sweeps/robustness-data";

fn quantity<'a>(result: &'a Value, table: &str, name: &str) -> &'a Value {
    let tables = result["patients"][0]["tables"].as_array().unwrap();
    let table = tables
        .iter()
        .find(|t| t["table"] == table)
        .unwrap_or_else(|| panic!("{table} is missing"));
    table["quantities"]
        .as_array()
        .unwrap()
        .iter()
        .find(|q| q["name"] == name)
        .unwrap()
}

#[test]
fn uncertain_data_spread_into_tables_and_the_original_is_the_patients_own() {
    let cohort = Cohort::quick();
    cohort
        .call(&["run", "--no-report", "--patient", "02-CoA"])
        .expect(0);
    let own = published(&cohort.patient("02-CoA"));

    let result = cohort
        .call(&[&PAPER[..], &DATA, &["--seeds", "1", "--json"]].concat())
        .json();
    let members = result["patients"][0]["members"].as_array().unwrap();
    let ids: Vec<&str> = members.iter().map(|m| m["id"].as_str().unwrap()).collect();
    assert_eq!(
        ids,
        ["02-CoA.base", "02-CoA.d01", "02-CoA.d02", "02-CoA.s01"]
    );
    assert!(
        members
            .iter()
            .all(|m| m["state"] == "done" && m["values"]["step2-biomarkers"].is_object())
    );
    let original = cohort
        .call(&["show", "02-CoA.base", "--cohort", FOLDER, "--json"])
        .json();
    assert_eq!(
        published(&original),
        own,
        "the same tasks, and so the same numbers"
    );

    // A sample is fitted to the measured pressure times its factor, and the fit follows.
    let sample = cohort
        .call(&["show", "02-CoA.d01", "--cohort", FOLDER, "--json"])
        .json();
    let measured = |p: &Value| {
        p["step0"]["result"]["measured"]["P_max_mmHg"]
            .as_f64()
            .unwrap()
    };
    let factor = members[1]["inputs"]["P_max_mmHg"].as_f64().unwrap();
    assert!((measured(&sample) / measured(&original) - factor).abs() < 1e-12);
    assert_eq!(
        sample["step0"]["result"]["organ"], original["step0"]["result"]["organ"],
        "the same heart"
    );
    assert_eq!(
        sample["step0"]["result"]["circulation"],
        original["step0"]["result"]["circulation"]
    );
    let p_max = quantity(&result, "step1-biomarkers", "P_max_mmHg");
    assert_eq!(
        (&p_max["n"], &p_max["amplification"]["input"]),
        (&2.into(), &"P_max_mmHg".into())
    );
    assert!(p_max["spread"].as_f64().unwrap() > 0.0 && p_max["paper"].is_object());

    // With another seed step 1 is identical to the last bit, but the fitted cell is not.
    let values = |member: usize, table: &str| &members[member]["values"][table];
    assert_eq!(values(3, "step1-parameters"), values(0, "step1-parameters"));
    assert_ne!(values(3, "step2-parameters"), values(0, "step2-parameters"));
    for file in [
        "robustness.json",
        "tables.csv",
        "members.csv",
        "targets.csv",
        "robustness.html",
    ] {
        let path = cohort.path().join(FOLDER).join("results").join(file);
        assert!(
            std::fs::metadata(&path)
                .unwrap_or_else(|e| panic!("{file}: {e}"))
                .len()
                > 200,
            "{file}"
        );
    }
    let page = std::fs::read_to_string(cohort.path().join(FOLDER).join("results/robustness.html"))
        .unwrap();
    for line in [
        "02-CoA.base, step1",
        "02-CoA.d01, step1",
        "02-CoA.d02, step2",
    ] {
        assert_eq!(
            page.matches(&format!("data-name=\"{line}\"")).count(),
            3,
            "{line} in each of three charts"
        );
    }

    // A repeated sweep computes nothing and prints the same result. Another design is refused, but
    // further seeds are accepted.
    let again = cohort.call(&[&PAPER[..], &["--json"]].concat());
    assert!(again.err.contains("0 tasks computed"), "{}", again.err);
    assert_eq!(again.json(), result);
    cohort
        .call(&[&PAPER[..], &DATA[..2], &["--samples", "3"]].concat())
        .expect(2)
        .complains_of(&["--samples was 2, now 3"]);
    let more = cohort
        .call(&[&PAPER[..], &["--seeds", "2"]].concat())
        .expect(0);
    assert!(
        more.out.contains("02-CoA") && more.err.contains("2 tasks computed"),
        "{}",
        more.err
    );
    cohort
        .call(&["sweep", "robustness", "--kind", "guess", "--out", FOLDER])
        .expect(2)
        .complains_of(&["kind data"]);
    cohort
        .call(&["sweep", "robustness", "--kind", "guess", "--range", "1.5"])
        .expect(2)
        .complains_of(&["--range"]);
}

#[test]
fn guesses_of_both_steps_are_varied() {
    let cohort = Cohort::quick();
    let arguments = [
        "sweep",
        "robustness",
        "--kind",
        "guess",
        "--patient",
        "02-CoA",
        "--samples",
        "2",
        "--seeds",
        "0",
    ];
    let result = cohort.call(&[&arguments[..], &["--json"]].concat()).json();
    let members = result["patients"][0]["members"].as_array().unwrap();
    assert_eq!(
        (
            members.len(),
            result["patients"][0]["inputs"].as_array().unwrap().len()
        ),
        (3, 16)
    );
    let value = |m: &Value, table: &str, name: &str| m["values"][table][name].as_f64().unwrap();
    assert_ne!(
        value(&members[1], "step1-parameters", "Smax_ref_kPa"),
        value(&members[0], "step1-parameters", "Smax_ref_kPa"),
        "another start of step 1"
    );
    let sample = cohort
        .call(&[
            "show",
            "02-CoA.g01",
            "--cohort",
            "sweeps/robustness-guess",
            "--json",
        ])
        .json();
    let guess = members[1]["inputs"]["step2.n_Tm"].as_f64().unwrap();
    assert_eq!(
        sample["plan"]["settings"]["step2"]["initial"]["n_Tm"].as_f64(),
        Some(guess)
    );
    assert_eq!(
        sample["plan"]["settings"]["step2"]["seed"], 3,
        "the seed stays"
    );
}

#[test]
fn a_guess_whose_first_beats_open_no_valve_reaches_the_end() {
    let cohort = Cohort::quick();
    let weak = [
        "--set",
        "step1.initial.t_CR_ms=285",
        "--set",
        "step1.initial.Smax_ref_kPa=54",
    ];
    cohort
        .call(&[&["run", "--no-report", "--patient", "02-CoA"][..], &weak].concat())
        .expect(0);
    let record = cohort.patient("02-CoA");
    let first = &record["iterations"][0];
    let checks = first["run"]["result"]["checks"].as_array().unwrap();
    assert!(
        checks.iter().any(|check| check["passed"] == false),
        "{checks:?}"
    );
    assert!(
        first["cost"].as_f64().unwrap() > 2.0 && first["failure"].is_null(),
        "{first}"
    );
    let shown = cohort.call(&["show", "02-CoA"]).expect(0).out;
    assert!(shown.contains("step 1 converged"), "{shown}");
    assert!(
        shown.contains("no whole beat: ") && shown.contains("valve opened and closed, found 0"),
        "{shown}"
    );
}

#[test]
fn the_sweeps_commands_serve_its_folder() {
    let cohort = Cohort::quick();
    let sweep = [
        "sweep",
        "robustness",
        "--kind",
        "data",
        "--patient",
        "02-CoA",
        "--samples",
        "1",
    ];
    let onwards = [
        "--set",
        "step1.stop=best-of-limit",
        "--set",
        "step1.stall_iterations=6",
        "--set",
        "step1.max_iterations=30",
    ];
    let result = cohort
        .call(&[&sweep[..], &onwards, &["--json"]].concat())
        .json();
    // Step 1 continues beyond the first iterate within the tolerance.
    let original = &result["patients"][0]["members"][0];
    assert!(
        original["step1_iterations"].as_u64().unwrap() > 10,
        "{original}"
    );
    assert!(
        original["step1_cost"].as_f64().unwrap() < 1e-3,
        "{original}"
    );
    let status = cohort.call(&["sweep", "status", FOLDER, "--json"]).json();
    assert_eq!(
        (&status["kind"], &status["over"], &status["members"]["done"]),
        (&"robustness".into(), &"data".into(), &2.into())
    );
    let said = cohort.call(&["sweep", "status", FOLDER]).expect(0).out;
    assert!(
        said.starts_with("robustness, data: 1 patient; personalisations: 2 done; no coordinator"),
        "{said}"
    );
    assert_eq!(
        cohort.call(&["sweep", "show", FOLDER, "--json"]).json(),
        result
    );
    let shown = cohort.call(&["sweep", "show", FOLDER]).expect(0).out;
    assert!(shown.contains("step1-parameters (Table 3)"), "{shown}");
    let page = cohort.path().join(FOLDER).join("results/robustness.html");
    std::fs::remove_file(&page).unwrap();
    assert!(
        cohort
            .call(&["sweep", "report", FOLDER])
            .expect(0)
            .out
            .contains("robustness.html")
    );
    assert!(std::fs::metadata(&page).unwrap().len() > 200);
    let rows = cohort.call(&["status", FOLDER]).expect(0).out;
    assert!(
        rows.starts_with("MEMBER ") && rows.contains("02-CoA.d01"),
        "{rows}"
    );
}

#[test]
fn an_interrupted_sweep_shows_what_is_there_and_repeats_nothing() {
    let cohort = Cohort::slow();
    let running = cohort.start_command(&[&PAPER[..], &DATA, &["--workers", "1"]].concat());
    cohort.wait_for_step_of_run(FOLDER, "step-2");
    running.signal(Signal::KILL);
    running.end().expect(-1);
    let show = |id: &str| {
        cohort
            .call(&["show", id, "--cohort", FOLDER, "--json"])
            .json()
    };
    let ids = ["02-CoA.base", "02-CoA.d01", "02-CoA.d02"];
    let before = ids.map(|id| published(&show(id)));
    assert!(before[0].len() >= 3, "{before:?}");

    let partial = cohort
        .call(&[&PAPER[..], &["--results-only", "--json"]].concat())
        .json();
    let patient = &partial["patients"][0];
    assert_eq!(
        patient["conditions"][0]["passed"],
        Value::Null,
        "still open"
    );
    assert!(patient["members"][0]["values"]["step1-parameters"].is_object());
    assert!(patient["members"][0]["values"]["step2-parameters"].is_null());

    cohort.edit(
        "cohort.toml",
        "max_generations = 1000000",
        "max_generations = 1",
    );
    let whole = cohort.call(&[&PAPER[..], &["--json"]].concat()).json();
    assert_eq!(whole["patients"][0]["conditions"][0]["passed"], true);
    for (id, before) in ids.iter().zip(before) {
        let after = published(&show(id));
        for task in before
            .iter()
            .filter(|(step, ..)| step != "step-2" && step != "verification")
        {
            assert!(
                after.contains(task),
                "{id} {task:?} was done again: {after:?}"
            );
        }
    }
}
