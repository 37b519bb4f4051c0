//! Output of the program: tables, comparisons, simulations, completions, manual pages, schemas,
//! templates.

use std::path::Path;
use std::process::Stdio;

use serde_json::Value;

use crate::support::{Cohort, PATIENTS, binary, cardiotwin, command};

#[test]
fn two_runs_are_compared_and_exported() {
    let cohort = Cohort::quick();
    cohort.call(&["run", "--no-report"]).expect(0);
    cohort
        .call(&[
            "run",
            "--no-report",
            "--run-dir",
            "other",
            "--set",
            "step2.seed=11",
        ])
        .expect(0);
    let same = cohort.call(&["compare", "run", "run"]).expect(0).out;
    assert!(
        same.starts_with("no setting differs\n0 quantities differ"),
        "{same}"
    );
    let told = cohort.call(&["compare", ".", "other"]).expect(0).out;
    assert!(
        told.starts_with("1 setting differs:\n  step2.seed: 3 -> 11\n"),
        "{told}"
    );
    let rows = told.lines().filter(|line| line.contains("-CoA ")).count();
    assert_eq!(rows, 20, "{told}");
    assert!(told.contains("smaller differences; --all shows them"));
    let compared = cohort.call(&["compare", ".", "other", "--json"]).json();
    let rows = compared["quantities"].as_array().unwrap();
    let differs = |patient: &str, quantity: &str| {
        let row = rows
            .iter()
            .find(|row| row["patient"] == patient && row["quantity"] == quantity);
        let row = row.unwrap_or_else(|| panic!("{patient} {quantity} is missing"));
        row["before"] != row["after"]
    };
    for id in PATIENTS {
        assert!(!differs(id, "step-1 cost") && !differs(id, "organ Smax_ref_kPa"));
        assert!(differs(id, "step-2 cost") && differs(id, "cell a_p_kPa"));
    }
    let said = cohort
        .call(&["export", "other", "--out", "tables"])
        .expect(0);
    let files: Vec<&str> = said.out.lines().collect();
    for name in [
        "table_1.csv",
        "table_2.json",
        "table_A6.csv",
        "table_A7.csv",
        "traces.csv",
    ] {
        let path = files
            .iter()
            .find(|file| file.ends_with(name))
            .unwrap_or_else(|| panic!("{name} in {files:?}"));
        assert!(
            std::fs::metadata(cohort.path().join(path)).unwrap().len() > 50,
            "{name} is not empty"
        );
    }
    let report = cohort
        .call(&["report", "other", "--out", "r.html"])
        .expect(0);
    assert!(report.out.trim().ends_with("r.html") && cohort.path().join("r.html").exists());
    cohort.call(&["compare", "run", "nothing"]).expect(5);
}

#[test]
fn a_simulation_stands_alone_and_follows_the_run() {
    let cohort = Cohort::quick();
    let said = cohort.call(&["simulate", "01-CoA"]).expect(0);
    assert!(
        said.out.starts_with("time_ms,pressure_mmHg,volume_mL"),
        "{}",
        said.out
    );
    assert!(said.err.contains("P_max_mmHg"), "{}", said.err);
    assert!(!cohort.run_dir().exists(), "nothing is stored");
    let p_max = |arguments: &[&str]| -> f64 {
        let mut all = vec!["simulate", "01-CoA", "--json"];
        all.extend(arguments);
        cohort.call(&all).json()["result"]["biomarkers"]["P_max_mmHg"]
            .as_f64()
            .unwrap()
    };
    assert!(
        p_max(&["--set", "Smax_ref_kPa=150"]) > p_max(&[]),
        "more stress, more pressure"
    );
    cohort
        .call(&["simulate", "01-CoA", "--set", "Smax_ref=150"])
        .expect(2)
        .complains_of(&["did you mean"]);

    cohort.call(&["run", "--no-report"]).expect(0);
    let patient = cohort.patient("01-CoA");
    let best = patient["step1"]["best_iteration"].as_u64().unwrap();
    let iteration = patient["iterations"]
        .as_array()
        .unwrap()
        .iter()
        .find(|i| i["number"] == best)
        .unwrap()
        .clone();
    let of_run = iteration["run"]["result"]["biomarkers"]["P_max_mmHg"]
        .as_f64()
        .unwrap();
    assert_eq!(
        p_max(&[]),
        of_run,
        "the run's best iteration, to the last digit"
    );
    let of_run = patient["verification"]["result"]["biomarkers"]["P_max_mmHg"]
        .as_f64()
        .unwrap();
    assert_eq!(p_max(&["--cell"]), of_run, "the verification beat");
    assert_eq!(
        p_max(&["--as", "step2"]),
        of_run,
        "the same by its other name"
    );
    assert_eq!(p_max(&["--as", "step1"]), p_max(&[]));
    for (of_step, words) in [
        (
            "step1",
            format!("simulated: step 1's best iteration, number {best}"),
        ),
        (
            "step2",
            "simulated: step 2's cell with step 1's valves".to_owned(),
        ),
        // This cohort stops before step 3.
        (
            "twin",
            "simulated: the twin, which is step 2's cell: there is no step 3".to_owned(),
        ),
    ] {
        let said = cohort
            .call(&["simulate", "01-CoA", "--as", of_step])
            .expect(0);
        assert!(
            said.err.contains(&words),
            "{words:?} is not in\n{}",
            said.err
        );
        let json = cohort
            .call(&["simulate", "01-CoA", "--as", of_step, "--json"])
            .json();
        assert_eq!(json["simulated_as"], of_step);
    }

    let said = cohort
        .call(&["simulate", "01-CoA", "--beats", "periodic", "--out", "beat"])
        .expect(0);
    assert!(said.out.contains("beats, periodic"), "{}", said.out);
    let traces = std::fs::read_to_string(cohort.path().join("beat/traces.csv")).unwrap();
    assert!(traces.lines().count() > 300);
}

#[test]
fn a_treatment_of_a_twin_is_predicted_or_refused() {
    let cohort = Cohort::quick();
    let stent = "peripheral_resistance_mmHg_s_per_mL=-20%";
    let predict = |more: &[&str]| cohort.call(&[&["predict"], more].concat());
    predict(&["01-CoA", "--set", stent])
        .expect(5)
        .complains_of(&["cardiotwin run"]);
    cohort.call(&["run", "--no-report"]).expect(0);
    predict(&["01-CoA", "--set", "P_max_mmHg=100"])
        .expect(2)
        .complains_of(&["is a result of the beat"]);
    predict(&["01-CoA", "--set", "wall_volume_mL=-5%"])
        .expect(2)
        .complains_of(&["does not describe growth"]);
    predict(&["01-CoA"]).expect(2).complains_of(&["--set"]);

    let said = predict(&["01-CoA", "--set", stent, "--out", "stent", "--json"]);
    let json: Value = serde_json::from_str(&said.out).unwrap();
    let prediction = &json["predictions"][0];
    let index = |name: &str, of: &str| {
        let indices = prediction["indices"].as_array().unwrap();
        indices.iter().find(|i| i["name"] == name).unwrap()[of]
            .as_f64()
            .unwrap()
    };
    assert!(
        index("aortic_mean_mmHg", "relative_change") < -0.05,
        "less afterload, less pressure: {prediction}"
    );
    assert!(
        index("SV_mL", "relative_change") > 0.02,
        "and more volume: {prediction}"
    );
    let patient = cohort.patient("01-CoA");
    let number = patient["step3"]["best_iteration"]
        .as_u64()
        .unwrap_or_default();
    let of_step3 = patient["step3_iterations"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|i| i["number"] == number);
    let twin = of_step3.map_or(&patient["verification"], |i| &i["run"]);
    assert_eq!(
        index("SV_mL", "twin"),
        twin["result"]["biomarkers"]["SV_mL"].as_f64().unwrap()
    );
    assert_eq!(prediction["periodic"], true);
    for name in [
        "01-CoA-before.csv",
        "01-CoA-after.csv",
        "01-CoA.svg",
        "01-CoA.json",
    ] {
        assert!(cohort.path().join("stent").join(name).exists(), "{name}");
    }
    for (circuit, words) in [("open", "open circuit"), ("closed", "closed loop")] {
        let asked = [
            "01-CoA",
            "--set",
            stent,
            "--no-band",
            "--circulation",
            circuit,
        ];
        let said = predict(&asked);
        assert!(
            said.out.contains(&format!("ventricle, {words}, ")),
            "{}",
            said.out
        );
        let json = predict(&[&asked[..], &["--json", "--out", circuit]].concat());
        let json: Value = serde_json::from_str(&json.out).unwrap();
        assert_eq!(json["predictions"][0]["circulation"], circuit);
        let plot = cohort.path().join(circuit).join("01-CoA.svg");
        assert!(std::fs::read_to_string(plot).unwrap().contains(words));
    }
    predict(&[
        "01-CoA",
        "--set",
        stent,
        "--circulation",
        "closed",
        "--beats",
        "2",
    ])
    .expect(2)
    .complains_of(&["--circulation closed", "--beats"]);
    let file = cohort.path().join("scenarios.toml");
    std::fs::write(
        &file,
        format!("[stent]\nset = [\"{stent}\"]\n[none]\nset = [\"phi=+0%\"]\n"),
    )
    .unwrap();
    let all = predict(&["--scenarios", "scenarios.toml", "--json"]);
    let all: Value = serde_json::from_str(&all.out).unwrap();
    let all = all["predictions"].as_array().unwrap();
    assert_eq!(all.len(), 4, "two scenarios, two patients");
    let unchanged = all
        .iter()
        .filter(|p| p["scenario"] == "none")
        .flat_map(|p| p["indices"].as_array().unwrap());
    assert!(
        unchanged.clone().count() > 10
            && unchanged.into_iter().all(|i| i["relative_change"] == 0.0)
    );
    the_elastance_is_that_of_the_predicted_beats(&cohort);
}

/// The end-systolic line once more, from the beats that `predict` writes for two of its three fillings.
fn the_elastance_is_that_of_the_predicted_beats(cohort: &Cohort) {
    let said = cohort.call(&["elastance", "--json"]).expect(0).out;
    let json: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(json["patients"].as_array().unwrap().len(), 2);
    let line = &json["patients"][0]["twin"]["end_systolic_line_mmHg_per_mL"];
    let number = |key: &str| line[key].as_f64().unwrap();
    let (slope, intercept_ml) = (number("slope"), number("intercept_mL"));
    let less = "left_atrial_pressure_mmHg=-30%";
    let asked = ["predict", "01-CoA", "--set", less, "--out", "less"];
    // Exit code 1: these quick twins are not personalised.
    cohort.call(&asked).expect(1);
    let end_systole = |file: &str| {
        let text = std::fs::read_to_string(cohort.path().join("less").join(file)).unwrap();
        let mut lines = text.lines();
        let names: Vec<&str> = lines.next().unwrap().split(',').collect();
        let column = |name| names.iter().position(|n| *n == name).unwrap();
        let (p, v) = (column("pressure_mmHg"), column("volume_mL"));
        let points = lines.map(|line| {
            let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
            (row[v], row[p])
        });
        let stiffness = |point: &(f64, f64)| point.1 / (point.0 - intercept_ml);
        points
            .max_by(|a, b| stiffness(a).total_cmp(&stiffness(b)))
            .unwrap()
    };
    let (full, empty) = (
        end_systole("01-CoA-before.csv"),
        end_systole("01-CoA-after.csv"),
    );
    let through_two = (full.1 - empty.1) / (full.0 - empty.0);
    // `predict` carries the change over to the twin's own beat, so that its points are not the same.
    assert!(
        (through_two / slope - 1.0).abs() < 0.35,
        "{through_two} {slope}: {line}"
    );
    let table = cohort.call(&["elastance", "01-CoA"]).expect(0).out;
    assert!(
        table.contains("EES") && table.contains("Ees of 788 people"),
        "{table}"
    );
}

#[test]
fn a_new_cohort_is_made_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    cardiotwin(folder.path(), &["init", "mine", "--name", "my cohort"]).expect(0);
    let checked = cardiotwin(folder.path(), &["check", "mine", "--json"]).expect(1);
    let checked: Value = serde_json::from_str(&checked.out).unwrap();
    assert_eq!(
        (&checked["cohort"], &checked["errors"]),
        (&"my cohort".into(), &2.into())
    );
    cardiotwin(folder.path(), &["init", "mine"])
        .expect(2)
        .complains_of(&["nothing was written"]);
    let bundled = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/coa-seven");
    cardiotwin(folder.path(), &["check", bundled, "--strict"]).expect(0);
}

#[test]
fn a_reader_that_leaves_hides_no_exit_code_and_ends_what_follows() {
    let code = |folder: &Path, arguments: &[&str]| {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = command(folder, arguments);
        command.stdout(writer).stderr(Stdio::null());
        command.status().unwrap().code()
    };
    let broken = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/broken-cohort");
    assert_eq!(code(&broken, &["check", "."]), Some(1));
    // With a patient that waits for a run, `status --watch` continues until it is left.
    let cohort = Cohort::quick();
    cohort.call(&["run", "--no-report"]).expect(0);
    cohort
        .call(&["rerun", PATIENTS[0], "--from", "step1"])
        .expect(0);
    assert_eq!(code(cohort.path(), &["status", "--watch"]), Some(0));
}

#[test]
fn completions_manual_pages_and_schemas() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish"] {
        let said = cardiotwin(folder.path(), &["completions", shell]).expect(0);
        assert!(said.out.contains("CARDIOTWIN_COMPLETE"), "{shell}");
    }
    let page = cardiotwin(folder.path(), &["man"]).expect(0).out;
    assert!(page.contains(".TH cardiotwin"), "{page}");
    cardiotwin(folder.path(), &["man", "--out", "man"]).expect(0);
    assert!(folder.path().join("man/cardiotwin-run.1").exists());
    let schemas = cardiotwin(folder.path(), &["schemas"]).json();
    assert!(schemas["cohort.schema.json"]["properties"]["step1"].is_object());
    cardiotwin(folder.path(), &["frobnicate"]).expect(2);
    // Measurements of the program itself belong to developers.
    cardiotwin(folder.path(), &["bench", "orchestration"]).expect(2);
}

/// Scripts see whether a run that is done has twins to continue with.
#[test]
fn a_twin_that_is_off_is_no_success() {
    let cohort = Cohort::quick();
    let said = cohort.call(&["run", "--no-report"]);
    assert!(said.out.contains("not personalised: "), "{}", said.out);
    assert_eq!(said.code, 7, "{}", said.out);
    let again = cohort.call(&["run", "--no-report"]);
    assert_eq!(
        again.code, 7,
        "nothing to do is no success either: {}",
        again.out
    );
}

#[test]
fn escape_sequences_in_names_of_folders_never_reach_stderr() {
    let folder = tempfile::tempdir().unwrap();
    // The second one is a colour that the program uses itself.
    for name in ["e\x1b[2Jvil", "e\x1b[31mvil"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
        for colour in ["never", "always"] {
            let said =
                crate::support::cardiotwin(folder.path(), &["status", name, "--color", colour])
                    .expect(5);
            let shown = name.replace('\x1b', "\\u001b");
            assert!(said.err.contains(&shown), "{:?}", said.err);
        }
    }
}

#[test]
fn version_names_the_program_and_its_worker() {
    let folder = tempfile::tempdir().unwrap();
    let said = cardiotwin(folder.path(), &["version"]).expect(0);
    let lines: Vec<&str> = said.out.lines().collect();
    assert!(
        lines[0].starts_with("cardiotwin ") && lines[1].starts_with("cardiotwin-worker "),
        "{lines:?}"
    );
    let json = cardiotwin(folder.path(), &["version", "--json"]).json();
    assert_eq!(
        format!("cardiotwin {}", json["cardiotwin"].as_str().unwrap()),
        lines[0]
    );
}

#[test]
fn status_names_patients_that_are_new_or_changed_since_the_run() {
    let cohort = Cohort::quick();
    let run = cohort.call(&["run", "--no-report", "--json"]).json();
    assert_eq!(run["counts"]["done"], 2, "{run:#}");
    let told = || cohort.call(&["status"]).expect(0).out;
    assert!(!told().contains("since the run"), "{}", told());
    let patients = cohort.path().join("patients");
    let toml = patients.join("01-CoA/patient.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    let text = text.replace("wall_volume_mL = 120.9", "wall_volume_mL = 119.0");
    std::fs::write(&toml, &text).unwrap();
    let new = patients.join("P9");
    std::fs::create_dir(&new).unwrap();
    for name in ["pressure.csv", "volume.csv"] {
        std::fs::copy(patients.join("01-CoA").join(name), new.join(name)).unwrap();
    }
    std::fs::write(
        new.join("patient.toml"),
        text.replace("\"01-CoA\"", "\"P9\""),
    )
    .unwrap();
    let told = told();
    assert!(told.contains("not in the run yet: P9"), "{told}");
    assert!(
        told.contains("changed since the run: 01-CoA (from step-0 on)"),
        "{told}"
    );
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["new_patients"], serde_json::json!(["P9"]));
    assert_eq!(
        status["changed_patients"],
        serde_json::json!([{"patient": "01-CoA", "from": "step-0"}])
    );
    let watched = cohort.call(&["status", "--watch"]).expect(0).out;
    assert!(watched.contains("not in the run yet: P9"), "{watched}");
}

/// What bash offers after these words, the last of which is being typed.
fn offered(folder: &Path, words: &[&str]) -> Vec<String> {
    let quoted: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
    let script = format!(
        "source <(cardiotwin completions bash); COMP_TYPE=9; COMP_WORDS=({}); COMP_CWORD={}; \
         _clap_complete_cardiotwin cardiotwin {}; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        quoted.join(" "),
        words.len() - 1,
        quoted.last().unwrap()
    );
    let programs = binary("cardiotwin").parent().unwrap().display().to_string();
    let path = std::env::var("PATH").unwrap();
    let output = std::process::Command::new("bash")
        .args(["-c", &script])
        .env("PATH", format!("{programs}:{path}"))
        .current_dir(folder)
        .output()
        .unwrap();
    let lines = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut words: Vec<String> = lines
        .lines()
        .filter(|line| !line.is_empty())
        .map(|line| line.trim().to_owned())
        .collect();
    words.sort();
    assert!(output.status.success(), "{output:?}");
    words
}

#[test]
fn the_shell_completes_commands_patients_and_steps() {
    let cohort = Cohort::quick();
    let elsewhere = tempfile::tempdir().unwrap();
    let path = cohort.path().display().to_string();
    let words = offered(elsewhere.path(), &["cardiotwin", "rer"]);
    assert_eq!(words, ["rerun"]);
    let words = offered(cohort.path(), &["cardiotwin", "show", ""]);
    let named = words.iter().filter(|word| !word.starts_with('-'));
    assert_eq!(named.collect::<Vec<_>>(), ["01-CoA", "02-CoA"]);
    let words = offered(
        elsewhere.path(),
        &["cardiotwin", "explain", "--cohort", &path, "02"],
    );
    assert_eq!(words, ["02-CoA"]);
    let words = offered(
        elsewhere.path(),
        &["cardiotwin", "check", &path, "--patient", "0"],
    );
    assert_eq!(words, ["01-CoA", "02-CoA"]);
    let words = offered(
        cohort.path(),
        &["cardiotwin", "rerun", "01-CoA", "--from", "step"],
    );
    assert_eq!(words, ["step0", "step1", "step2", "step3"]);
}

/// `--cohort` names the cohort in every command, whether its first argument is a patient or a cohort.
#[test]
fn every_command_takes_the_cohort_in_the_same_way() {
    let cohort = Cohort::quick();
    let elsewhere = tempfile::tempdir().unwrap();
    let path = cohort.path().display().to_string();
    let call = |arguments: &[&str]| cardiotwin(elsewhere.path(), arguments);
    call(&["check", "--cohort", &path]).expect(0);
    call(&["check", &path, "--cohort", &path]).expect(2);
    call(&["run", "--cohort", &path, "--no-report"]).expect(0);
    for command in ["status", "du", "verify"] {
        call(&[command, "--cohort", &path]).expect(0);
    }
    call(&["show", "01-CoA", "--cohort", &path]).expect(0);
    call(&["discover", "1-CoA", "--cohort", &path])
        .expect(2)
        .complains_of(&["has no patient `1-CoA`", "did you mean `01-CoA`?"]);
    let found = [
        "discover",
        "01-CoA",
        "--cohort",
        &path,
        "--effects",
        "pressure_offset",
    ];
    call(&found).expect(0);
    assert!(
        cohort
            .path()
            .join("patients/01-CoA/discover/report.html")
            .exists()
    );
}

/// The demonstration ends with what was done, how good it is, and what to open.
#[test]
fn the_demonstration_ends_with_three_lines() {
    let cohort = Cohort::quick();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let hidden = root.join("examples/hidden-effect").display().to_string();
    let searches = cohort.path().join("discover").display().to_string();
    // A search of the whole catalogue takes long; the folder keeps the choice.
    let effects = "atrial_kick,pressure_offset";
    cardiotwin(
        cohort.path(),
        &[
            "discover",
            &hidden,
            "--run-dir",
            &searches,
            "--effects",
            effects,
        ],
    )
    .expect(0);
    let plots = cohort.path().join("plots");
    let output = std::process::Command::new(root.join("deploy/demo.sh"))
        .arg(binary("cardiotwin").parent().unwrap())
        .args([cohort.path(), plots.as_path()])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{output:?}");
    let first = said.lines().nth(1).unwrap();
    assert!(first.starts_with("PARAMETER"), "a table at once: {said}");
    assert!(plots.join("afterload.svg").exists());
    let last: Vec<&str> = said.lines().rev().take(3).collect();
    let path = cohort.path().display();
    assert_eq!(
        last[2],
        format!(
            "done: found the hidden effect (atrial_kick), and fitted twins to the 2 patients of {path}"
        )
    );
    let run = cohort.call(&["status", "--json"]).json();
    let notes = run["patients"].as_array().unwrap().iter();
    let good = notes
        .filter(|one| one["note"].as_str().unwrap().starts_with("personalised"))
        .count();
    assert_eq!(
        last[1],
        format!(
            "how good: the beat of {good} of 2 twins is within the tolerances of its measurements"
        )
    );
    assert_eq!(
        last[0],
        format!("open: {path}/run/report.html, and {path}/discover/report.html for the effect")
    );
    assert!(cohort.run_dir().join("report.html").exists());
}
