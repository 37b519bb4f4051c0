//! Robustness sweeps: whole personalisations around a patient's, in a folder of their own.

use rustix::process::Signal;
use serde_json::Value;

use crate::support::{Cohort, published};

const DATA: [&str; 8] = ["sweep", "robustness", "--kind", "data", "--patient", "02-CoA", "--samples", "2"];
const FOLDER: &str = "sweeps/robustness-data";

fn quantity<'a>(result: &'a Value, table: &str, name: &str) -> &'a Value {
    let tables = result["patients"][0]["tables"].as_array().unwrap();
    let table = tables.iter().find(|t| t["table"] == table).unwrap_or_else(|| panic!("{table} is missing"));
    table["quantities"].as_array().unwrap().iter().find(|q| q["name"] == name).unwrap()
}

#[test]
fn uncertain_data_spread_into_tables_and_the_original_is_the_patients_own() {
    let cohort = Cohort::quick();
    cohort.call(&["run", "--no-report", "--patient", "02-CoA"]).expect(0);
    let own = published(&cohort.patient("02-CoA"));

    let result = cohort.call(&[&DATA[..], &["--seeds", "1", "--json"]].concat()).json();
    let members = result["patients"][0]["members"].as_array().unwrap();
    let ids: Vec<&str> = members.iter().map(|m| m["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["02-CoA.base", "02-CoA.d01", "02-CoA.d02", "02-CoA.s01"]);
    assert!(members.iter().all(|m| m["state"] == "done" && m["values"]["step2-biomarkers"].is_object()));
    let original = cohort.call(&["show", "02-CoA.base", "--cohort", FOLDER, "--json"]).json();
    assert_eq!(published(&original), own, "the same tasks, and so the same numbers");

    // The pressure that a sample is fitted to is the measured one times its factor, and the fit follows.
    let sample = cohort.call(&["show", "02-CoA.d01", "--cohort", FOLDER, "--json"]).json();
    let measured = |p: &Value| p["step0"]["result"]["measured"]["P_max_mmHg"].as_f64().unwrap();
    let factor = members[1]["inputs"]["P_max_mmHg"].as_f64().unwrap();
    assert!((measured(&sample) / measured(&original) - factor).abs() < 1e-12);
    assert_eq!(sample["step0"]["result"]["organ"], original["step0"]["result"]["organ"], "the same heart");
    assert_eq!(sample["step0"]["result"]["circulation"], original["step0"]["result"]["circulation"]);
    let p_max = quantity(&result, "step1-biomarkers", "P_max_mmHg");
    assert_eq!((&p_max["n"], &p_max["amplification"]["input"]), (&2.into(), &"P_max_mmHg".into()));
    assert!(p_max["spread"].as_f64().unwrap() > 0.0 && p_max["paper"].is_object());

    // Another seed: step 1 stays to the last bit, the fitted cell does not.
    let values = |member: usize, table: &str| &members[member]["values"][table];
    assert_eq!(values(3, "step1-parameters"), values(0, "step1-parameters"));
    assert_ne!(values(3, "step2-parameters"), values(0, "step2-parameters"));
    for file in ["robustness.json", "tables.csv", "members.csv", "targets.csv", "robustness.html"] {
        let path = cohort.path().join(FOLDER).join("results").join(file);
        assert!(std::fs::metadata(&path).unwrap_or_else(|e| panic!("{file}: {e}")).len() > 200, "{file}");
    }
    let page = std::fs::read_to_string(cohort.path().join(FOLDER).join("results/robustness.html")).unwrap();
    for line in ["02-CoA.base, step1", "02-CoA.d01, step1", "02-CoA.d02, step2"] {
        assert_eq!(page.matches(&format!("data-name=\"{line}\"")).count(), 3, "{line} in each of three charts");
    }

    // Again: nothing is computed, the same is said; another design is refused, more seeds are not.
    let again = cohort.call(&[&DATA[..4], &["--json"]].concat());
    assert!(again.err.contains("0 tasks published"), "{}", again.err);
    assert_eq!(again.json(), result);
    cohort.call(&[&DATA[..6], &["--samples", "3"]].concat()).expect(2).complains_of(&["--samples 2 then, 3 now"]);
    let more = cohort.call(&[&DATA[..4], &["--seeds", "2"]].concat()).expect(0);
    assert!(more.out.contains("02-CoA") && more.err.contains("2 tasks published"), "{}", more.err);
    cohort.call(&["sweep", "robustness", "--kind", "guess", "--out", FOLDER]).expect(2).complains_of(&["kind data"]);
    cohort.call(&["sweep", "robustness", "--kind", "guess", "--range", "1.5"]).expect(2).complains_of(&["--range"]);
}

#[test]
fn guesses_of_both_steps_are_varied() {
    let cohort = Cohort::quick();
    let arguments = ["sweep", "robustness", "--kind", "guess", "--patient", "02-CoA", "--samples", "2", "--seeds", "0"];
    let result = cohort.call(&[&arguments[..], &["--json"]].concat()).json();
    let members = result["patients"][0]["members"].as_array().unwrap();
    assert_eq!((members.len(), result["patients"][0]["inputs"].as_array().unwrap().len()), (3, 16));
    let value = |m: &Value, table: &str, name: &str| m["values"][table][name].as_f64().unwrap();
    assert_ne!(
        value(&members[1], "step1-parameters", "Smax_ref_kPa"),
        value(&members[0], "step1-parameters", "Smax_ref_kPa"),
        "another start of step 1"
    );
    let sample = cohort.call(&["show", "02-CoA.g01", "--cohort", "sweeps/robustness-guess", "--json"]).json();
    let guess = members[1]["inputs"]["step2.n_Tm"].as_f64().unwrap();
    assert_eq!(sample["plan"]["settings"]["step2"]["initial"]["n_Tm"].as_f64(), Some(guess));
    assert_eq!(sample["plan"]["settings"]["step2"]["seed"], 3, "the seed stays");
}

#[test]
fn an_interrupted_sweep_shows_what_is_there_and_repeats_nothing() {
    let cohort = Cohort::slow();
    let running = cohort.start_command(&[&DATA[..], &["--workers", "1"]].concat());
    cohort.wait_for_step_of_run(FOLDER, "step-2");
    running.signal(Signal::KILL);
    running.end().expect(-1);
    let show = |id: &str| cohort.call(&["show", id, "--cohort", FOLDER, "--json"]).json();
    let ids = ["02-CoA.base", "02-CoA.d01", "02-CoA.d02"];
    let before = ids.map(|id| published(&show(id)));
    assert!(before[0].len() >= 3, "{before:?}");

    let partial = cohort.call(&[&DATA[..4], &["--results-only", "--json"]].concat()).json();
    let patient = &partial["patients"][0];
    assert_eq!(patient["conditions"][0]["passed"], Value::Null, "still open");
    assert!(patient["members"][0]["values"]["step1-parameters"].is_object());
    assert!(patient["members"][0]["values"]["step2-parameters"].is_null());

    cohort.edit("cohort.toml", "max_generations = 1000000", "max_generations = 1");
    let whole = cohort.call(&[&DATA[..4], &["--json"]].concat()).json();
    assert_eq!(whole["patients"][0]["conditions"][0]["passed"], true);
    for (id, before) in ids.iter().zip(before) {
        let after = published(&show(id));
        for task in before.iter().filter(|(step, ..)| step != "step-2" && step != "verification") {
            assert!(after.contains(task), "{id} {task:?} was done again: {after:?}");
        }
    }
}
