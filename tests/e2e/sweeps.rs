//! Sensitivity sweeps: whole, interrupted, extended, damaged; and the published analysis compared
//! with an independent reference.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

use crate::schema;
use crate::support::{Cohort, Running, Said, cardiotwin, start};

/// A folder for sweeps.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().expect("a temporary folder"),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn call(&self, arguments: &[&str]) -> Said {
        cardiotwin(self.folder.path(), arguments)
    }

    /// Runs `sweep gsa` with few resamples.
    fn gsa(&self, out: &str, more: &[&str]) -> Said {
        let mut all = vec!["sweep", "gsa", "--out", out, "--resamples", "20"];
        all.extend(more);
        self.call(&all)
    }

    /// Starts a sweep of 512 chunks, each made slow by its tolerance. It takes minutes at least, so
    /// that there is time to stop it on a fast machine, too.
    fn start_slow(&self, out: &str) -> Running {
        let slow = [
            "--samples",
            "2048",
            "--chunk-blocks",
            "4",
            "--tolerance",
            "1e-10",
            "--workers",
            "1",
        ];
        self.start(
            &[
                &["sweep", "gsa", "--out", out, "--resamples", "20"],
                slow.as_slice(),
            ]
            .concat(),
        )
    }

    fn start(&self, arguments: &[&str]) -> Running {
        start(self.folder.path(), arguments)
    }

    fn status(&self, out: &str) -> Value {
        self.call(&["sweep", "status", out, "--json"]).json()
    }

    /// Waits until at least `n` chunks of a running sweep are done.
    fn wait_for_chunks(&self, out: &str, n: u64) {
        let began = std::time::Instant::now();
        loop {
            let said = self.call(&["sweep", "status", out, "--json"]);
            if let Ok(status) = serde_json::from_str::<Value>(&said.out)
                && status["chunks"]["done"].as_u64() >= Some(n)
            {
                return;
            }
            assert!(
                began.elapsed().as_secs() < 120,
                "never saw {n} chunks; last:\n{}{}",
                said.out,
                said.err
            );
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
    }

    /// Number of published attempts by task: a chunk that was computed twice has two.
    fn attempts(&self, out: &str) -> BTreeMap<String, usize> {
        let mut found = BTreeMap::new();
        for folder in children(&self.path(out).join("attempts")) {
            for attempt in children(&folder) {
                let outcome = std::fs::read_to_string(attempt.join("outcome.json"));
                if outcome.is_ok_and(|text| !text.contains("\"revoked\"")) {
                    let name = attempt.file_name().unwrap().to_string_lossy().into_owned();
                    let task = name.rsplit_once("-g").unwrap().0.to_owned();
                    *found.entry(task).or_default() += 1;
                }
            }
        }
        found
    }
}

fn children(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder)
        .map(|entries| entries.map(|e| e.unwrap().path()).collect())
        .unwrap_or_default()
}

/// First-order or total indices by biomarker and parameter.
fn indices(sensitivity: &Value, order: &str) -> BTreeMap<(String, String), f64> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let outputs = sensitivity["outputs"].as_array().unwrap();
    let of = |output: &Value| -> Vec<((String, String), f64)> {
        let parameters = output["parameters"].as_array().unwrap();
        let one = |p: &Value| {
            (
                (text(&output["name"]), text(&p["name"])),
                p[order]["value"].as_f64().unwrap(),
            )
        };
        parameters.iter().map(one).collect()
    };
    outputs.iter().flat_map(of).collect()
}

/// The reference that the program shows next to its own ranking.
fn reference() -> Value {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../coordinator/sweep/src/gsa/reference.json"
    );
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn the_published_analysis_agrees_with_an_independent_reference() {
    let place = Place::new();
    let answer = place
        .call(&[
            "sweep",
            "gsa",
            "--scramble",
            "--seed",
            "1",
            "--json",
            "--select",
            "9",
        ])
        .json();
    let found = &answer["sensitivity"];
    assert_eq!(
        (
            found["samples"]["total"].as_u64(),
            found["n_blocks"].as_u64()
        ),
        (Some(45_056), Some(1024))
    );
    let reference = reference();
    for (ours, theirs) in [("first", "first"), ("total", "total")] {
        for ((output, parameter), value) in indices(found, ours) {
            let expected = reference[theirs][&output][&parameter].as_f64().unwrap();
            assert!(
                (value - expected).abs() < 0.002,
                "{ours} {output} {parameter}: {value}, reference {expected}"
            );
        }
    }
    let excluded = found["samples"]["excluded"].as_f64().unwrap() / 45_056.0;
    assert!(
        (excluded - reference["excluded_share"].as_f64().unwrap()).abs() < 0.002,
        "{excluded}"
    );
    let ranking = found["ranking"].as_array().unwrap();
    let names: Vec<&str> = ranking
        .iter()
        .map(|r| r["name"].as_str().unwrap())
        .collect();
    assert_eq!(names[..3], ["Ca50_ref_uM", "n_TRPN", "Ca_max_uM"]);
    let of_paper = ranking[..9]
        .iter()
        .filter(|r| r["paper"]["among_first_nine"] == true)
        .count();
    assert!(of_paper >= 7, "{of_paper} of the paper's nine: {names:?}");
    let schema = place.call(&["schemas", "--out", "schemas"]).expect(0);
    assert!(schema.err.len() + schema.out.len() > 0);
    let schema = std::fs::read_to_string(place.path("schemas/sensitivity.schema.json")).unwrap();
    assert_eq!(
        schema::misfits(found, &serde_json::from_str(&schema).unwrap()),
        Vec::<String>::new()
    );
    for name in [
        "indices.csv",
        "second_order.csv",
        "ranking.csv",
        "sensitivity.json",
        "sensitivity.svg",
        "report.html",
    ] {
        assert!(
            std::fs::metadata(place.path("gsa/results").join(name))
                .unwrap()
                .len()
                > 1000,
            "{name}"
        );
    }
    let written: Value =
        serde_json::from_slice(&std::fs::read(place.path("gsa/results/sensitivity.json")).unwrap())
            .unwrap();
    assert_eq!(&written, found);
    a_cohort_takes_the_selection(&place, &names);
}

/// A cohort accepts step 2's settings as `--select` wrote them, and `check` finds no fault.
fn a_cohort_takes_the_selection(place: &Place, ranking: &[&str]) {
    let snippet = std::fs::read_to_string(place.path("gsa/results/step2.toml")).unwrap();
    place.call(&["init", "cohort"]).expect(0);
    let bundled =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/coa-seven/patients/01-CoA");
    let patients = place.path("cohort/patients");
    std::fs::remove_dir_all(&patients).unwrap();
    std::fs::create_dir_all(patients.join("01-CoA")).unwrap();
    for file in children(&bundled) {
        std::fs::copy(
            &file,
            patients.join("01-CoA").join(file.file_name().unwrap()),
        )
        .unwrap();
    }
    std::fs::write(
        place.path("cohort/cohort.toml"),
        format!("name = \"selected\"\n\n{snippet}"),
    )
    .unwrap();
    place.call(&["check", "cohort", "--strict"]).expect(0);
    let shown = place
        .call(&["config", "show", "cohort", "--json"])
        .expect(0)
        .out;
    for name in &ranking[..9] {
        assert!(shown.contains(name), "{name} is not in {shown}");
    }
}

#[test]
fn threads_chunks_and_repetition_change_no_digit_and_repeat_no_chunk() {
    let place = Place::new();
    let whole = place
        .gsa(
            "whole",
            &["--samples", "16", "--chunk-blocks", "16", "--json"],
        )
        .json();
    let parts = place
        .gsa(
            "parts",
            &[
                "--samples",
                "16",
                "--chunk-blocks",
                "3",
                "--workers",
                "3",
                "--json",
            ],
        )
        .json();
    assert_eq!(
        (
            whole["chunks"]["total"].as_u64(),
            parts["chunks"]["total"].as_u64()
        ),
        (Some(1), Some(6))
    );
    for field in ["outputs", "ranking", "samples"] {
        assert_eq!(
            whole["sensitivity"][field], parts["sensitivity"][field],
            "{field}"
        );
    }
    let again = place.gsa("parts", &["--json"]).json();
    assert_eq!(
        (
            again["chunks"]["published_now"].as_u64(),
            &again["sensitivity"]
        ),
        (Some(0), &parts["sensitivity"])
    );
    // A longer sweep keeps the existing chunks, and its first blocks give the result of the shorter
    // one.
    let longer = place.gsa("parts", &["--samples", "21", "--json"]).json();
    assert_eq!(
        longer["chunks"]["published_now"].as_u64(),
        Some(2),
        "blocks 15 to 17 and 18 to 20"
    );
    let first = place
        .call(&["sweep", "show", "parts", "--blocks", "16", "--json"])
        .json();
    assert_eq!(first["outputs"], parts["sensitivity"]["outputs"]);
}

#[test]
fn changed_settings_are_refused_with_both_values() {
    let place = Place::new();
    place
        .gsa("gsa", &["--samples", "4", "--chunk-blocks", "4"])
        .expect(0);
    let refused: [(&[&str], &str); 4] = [
        (&["--samples", "2"], "samples 4 (now 2"),
        (&["--scramble"], "plain points (now scrambled with seed 1)"),
        (&["--set", "phi=2"], "phi in [0.1, 4] (now = 2)"),
        (
            &["--cycle-length-ms", "800"],
            "cycle-length-ms 1000 (now 800)",
        ),
    ];
    for (options, said) in refused {
        place
            .gsa("gsa", options)
            .expect(2)
            .complains_of(&[said, "--out"]);
    }
    let other = place.gsa("gsa", &["--confidence", "0.9", "--json"]).json();
    assert_eq!(
        other["chunks"]["published_now"].as_u64(),
        Some(0),
        "another analysis of the same samples"
    );
    place
        .gsa("other", &["--set", "Ca50=1"])
        .expect(2)
        .complains_of(&["`Ca50`", "Ca50_ref_uM"]);
    place
        .gsa("other", &["--select", "22"])
        .expect(2)
        .complains_of(&["1 to 21"]);
    assert!(!place.path("other/cardiotwin.db").exists());
    for command in [&["report", "gsa"], &["run", "gsa"], &["export", "gsa"]] {
        place.call(command).expect(2).complains_of(&["is a sweep"]);
    }
    place
        .call(&["sweep", "show", "nothing"])
        .expect(2)
        .complains_of(&["holds no sweep"]);
    place.call(&["init", "cohort"]).expect(0);
    place
        .gsa("cohort", &[])
        .expect(2)
        .complains_of(&["is a cohort"]);
}

#[test]
fn after_kill_9_the_first_blocks_are_valid_and_no_finished_chunk_is_repeated() {
    let place = Place::new();
    let running = place.start_slow("gsa");
    place.wait_for_chunks("gsa", 3);
    running.signal(Signal::KILL);
    running.end().expect(-1);
    let status = place.status("gsa");
    let complete = status["blocks_complete"].as_u64().unwrap();
    assert!(
        complete >= 12 && status["coordinator_running"] == false,
        "{status}"
    );
    let partial = place.call(&["sweep", "show", "gsa", "--json"]).json();
    assert_eq!(partial["n_blocks"].as_u64(), Some(complete));
    let before = place.attempts("gsa");
    let running = place.start(&["sweep", "gsa", "--out", "gsa", "--workers", "1"]);
    place.wait_for_chunks("gsa", status["chunks"]["done"].as_u64().unwrap() + 2);
    running.signal(Signal::INT);
    running
        .end()
        .expect(130)
        .complains_of(&["continue with `cardiotwin sweep gsa --out gsa`"]);
    let after = place.attempts("gsa");
    assert!(
        after.len() > before.len() && before.keys().all(|task| after[task] == before[task]),
        "{before:?} {after:?}"
    );
    let first = place
        .call(&[
            "sweep",
            "show",
            "gsa",
            "--blocks",
            &complete.to_string(),
            "--json",
        ])
        .json();
    assert_eq!(
        first["outputs"], partial["outputs"],
        "a prefix says the same later"
    );
}

#[test]
fn a_cancelled_sweep_ends_and_the_same_command_takes_it_up() {
    let place = Place::new();
    let running = place.start_slow("gsa");
    place.wait_for_chunks("gsa", 1);
    place.call(&["sweep", "cancel", "gsa"]).expect(0);
    let said = running.end().expect(1);
    assert!(said.out.contains("computed"), "{}", said.out);
    let status = place.status("gsa");
    let done = status["chunks"]["done"].as_u64().unwrap();
    assert!(
        status["chunks"]["cancelled"].as_u64().unwrap() > 0
            && status["chunks"]["waiting"].is_null(),
        "{status}"
    );
    let running = place.start(&["sweep", "gsa", "--out", "gsa", "--workers", "1"]);
    place.wait_for_chunks("gsa", done + 1);
    running.signal(Signal::INT);
    let said = running.end().expect(130);
    assert!(said.err.contains("are resumed"), "{}", said.err);
}

#[test]
fn an_organ_s_sensitivity_rests_on_the_patient_s_run() {
    let cohort = Cohort::quick();
    let gsa = |more: &[&str]| {
        let all = [
            "sweep",
            "gsa",
            "--organ",
            "01-CoA",
            "--samples",
            "4",
            "--chunk-blocks",
            "2",
            "--resamples",
            "20",
        ];
        cohort.call(&[all.as_slice(), more].concat())
    };
    gsa(&[]).expect(5).complains_of(&["cardiotwin run"]);
    cohort.call(&["run", "--no-report"]).expect(0);
    let said = gsa(&["--json", "--select", "3", "--valves"])
        .expect(0)
        .json();
    let outputs = said["sensitivity"]["outputs"].as_array().unwrap();
    assert_eq!(outputs.len(), 7, "{said}");
    assert_eq!(said["sensitivity"]["ranking"].as_array().unwrap().len(), 23);
    assert_eq!(said["sensitivity"]["samples"]["total"], 4 * 48);
    let folder = cohort.path().join("gsa-01-CoA/results");
    let settings = std::fs::read_to_string(folder.join("step3.toml")).unwrap();
    assert!(settings.contains("[step3.bounds]"), "{settings}");
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.contains("Sensitivity of the organ of 01-CoA"));
    let again = gsa(&["--json", "--valves"]).expect(0).json();
    assert_eq!(
        (
            again["chunks"]["published_now"].as_u64(),
            &again["sensitivity"]
        ),
        (Some(0), &said["sensitivity"])
    );
    gsa(&["--box", "paper"])
        .expect(2)
        .complains_of(&["Smax_ref_kPa", "[90, 140]"]);
}

#[test]
fn a_damaged_chunk_is_found_by_its_hash() {
    let place = Place::new();
    place
        .gsa("gsa", &["--samples", "4", "--chunk-blocks", "4"])
        .expect(0);
    let attempt = children(&children(&place.path("gsa/attempts"))[0]).remove(0);
    let file = attempt.join("samples.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replacen("periodic", "stuck", 1)).unwrap();
    place
        .call(&["sweep", "show", "gsa"])
        .expect(5)
        .complains_of(&["samples.csv", "SHA-256"]);
}
