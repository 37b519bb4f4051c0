//! A cohort with a solver in Python: the bundled example, its failures, and kills.

use std::collections::BTreeMap;
use std::path::Path;

use rustix::process::{Pid, Signal};

use super::support::{Cohort, published};

/// A cohort of one patient on the bundled `lv.py`; `None`, with a message, if there is no Python.
fn cohort(patient: &str, more: &str) -> Option<Cohort> {
    if !std::process::Command::new("python3")
        .arg("--version")
        .output()
        .is_ok_and(|said| said.status.success())
    {
        cardiotwin_not_tested::not_tested(
            "python3",
            "no python3 in PATH to run an external solver",
        );
        return None;
    }
    let cohort = Cohort::quick_of(patient);
    cohort.edit(
        "cohort.toml",
        "solver.fidelity = \"reduced\"",
        "solver.fidelity = \"external\"",
    );
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/external-solver");
    for file in ["lv.py", "lv.par.in"] {
        std::fs::copy(example.join(file), cohort.path().join(file)).unwrap();
    }
    let path = cohort.path().join("cohort.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let settings = "command = [\"python3\", \"{model}\", \"{parameters}\", \"{out}\"]\nparameters = \"json\"\n";
    let settings = format!(
        "{text}\n[solver.external]\n{}\n",
        if more.is_empty() {
            format!("{settings}files = {{ model = \"lv.py\" }}\nexit_codes = {{ input = [2] }}")
        } else {
            more.to_owned()
        }
    );
    std::fs::write(path, settings).unwrap();
    Some(cohort)
}

fn biomarkers(patient: &serde_json::Value) -> BTreeMap<String, f64> {
    let found = &patient["verification"]["result"]["biomarkers"];
    let found = found.as_object().unwrap_or_else(|| panic!("{patient:#}"));
    found
        .iter()
        .filter_map(|(name, value)| Some((name.clone(), value.as_f64()?)))
        .collect()
}

#[test]
fn a_patient_is_personalised_with_another_solver_and_its_source_is_part_of_the_data() {
    let Some(cohort) = cohort("02-CoA", "") else {
        return;
    };
    cohort.call(&["run", "--no-report", "--quiet"]).expect(0);
    let patient = cohort.patient("02-CoA");
    assert_eq!(
        patient["step1"]["quality"]["quality"], "converged",
        "{patient:#}"
    );
    // Each simulation teaches the organ's law, in which the next one is sought.
    let iterations = patient["iterations"].as_array().expect("iterations");
    assert!(iterations.len() >= 2, "{patient:#}");
    for (taught, iteration) in iterations.iter().enumerate() {
        let proposal = &iteration["proposal"]["result"];
        assert_eq!(proposal["law_beats"], taught, "{proposal:#}");
    }
    let learned = &iterations[1]["proposal"]["result"]["learned_law"]["beats"][0];
    let rms = |law: &str| learned[law]["rms_mmHg"].as_f64().expect("an error");
    assert!(rms("after") < 0.2 * rms("before"), "{learned:#}");
    let before = published(&patient);
    assert!(
        before.len() >= 5 && before.iter().all(|(_, _, generation)| *generation == 1),
        "{before:?}"
    );
    let again = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(
        again.out.contains("nothing to do") || again.out.contains("0 tasks"),
        "{}",
        again.out
    );
    // A changed solver: simulations are repeated, but not step 0.
    cohort.edit("lv.py", "n = 6\n", "n = 7\n");
    cohort.call(&["run", "--no-report", "--quiet"]).expect(0);
    let after = published(&cohort.patient("02-CoA"));
    assert_eq!(before[0], after[0]);
    assert!(
        before[1..]
            .iter()
            .zip(&after[1..])
            .all(|(before, after)| before.1 != after.1),
        "{before:?} {after:?}"
    );
    cohort.call(&["report"]).expect(0);
}

#[test]
fn step_3_moves_the_cell_of_another_solver() {
    let Some(cohort) = cohort("02-CoA", "") else {
        return;
    };
    let until = [
        "--set",
        "workflow.until=step3",
        "--set",
        "step3.max_iterations=2",
        "--set",
        "posterior.enabled=false",
    ];
    // Exit code 2 means that the twin is not personalised after two beats.
    cohort.call(&[&["run", "--no-report", "--quiet"][..], &until].concat());
    let patient = cohort.patient("02-CoA");
    let beats = patient["step3_iterations"]
        .as_array()
        .unwrap_or_else(|| panic!("{patient:#}"));
    assert!((1..=2).contains(&beats.len()), "{beats:#?}");
    let misfit = |beat: &serde_json::Value| beat["misfit"].as_f64();
    let best = beats
        .iter()
        .filter_map(misfit)
        .fold(f64::INFINITY, f64::min);
    assert!(
        best.is_finite() && beats[0]["proposal"].is_object(),
        "{beats:#?}"
    );
    // Sum of squares of the verification beat, from its biomarkers alone: step 3 came nearer to the
    // measurements.
    let off = |run: &serde_json::Value| {
        let (found, measured) = (
            &run["result"]["biomarkers"],
            &patient["step0"]["result"]["measured"],
        );
        ["P_max_mmHg", "PTD90_ms", "SV_mL"]
            .iter()
            .map(|name| {
                (found[name].as_f64().unwrap() / measured[name].as_f64().unwrap() - 1.0).abs()
            })
            .fold(0.0, f64::max)
    };
    let taken = patient["step3"]["best_iteration"]
        .as_u64()
        .expect("a beat of step 3");
    let twin = beats
        .iter()
        .find(|beat| beat["number"] == taken)
        .map_or(&patient["verification"], |beat| &beat["run"]);
    assert!(
        off(twin) < off(&patient["verification"]),
        "{} and {}",
        off(twin),
        off(&patient["verification"])
    );
    let directory = twin["directory"].as_str().expect("a directory");
    assert!(
        Path::new(directory).join("external").is_dir(),
        "the other solver simulated it"
    );
}

#[test]
fn another_solver_can_do_without_the_organ_s_law() {
    let Some(cohort) = cohort("02-CoA", "") else {
        return;
    };
    let without = "workflow.surrogate=\"one-fibre\"";
    let until = "workflow.until=\"step2-verification\"";
    cohort
        .call(&[
            "run",
            "--no-report",
            "--quiet",
            "--set",
            without,
            "--set",
            until,
        ])
        .expect(0);
    let patient = cohort.patient("02-CoA");
    let iterations = patient["iterations"].as_array().expect("iterations");
    for iteration in iterations {
        let proposal = &iteration["proposal"]["result"];
        assert!(proposal["law_beats"].is_null(), "{proposal:#}");
    }
    assert_eq!(patient["step1"]["quality"]["quality"], "converged");
}

#[test]
fn parameter_files_and_nodal_results_of_opencarp_give_the_same_answer() {
    let Some(plain) = cohort("02-CoA", "") else {
        return;
    };
    let settings = "command = [\"python3\", \"{model}\", \"{parameters}\", \"{out}\", \"--igb\"]\nparameters = \"json\"\n\
                    files = { model = \"lv.py\", par = \"lv.par.in\" }\ntemplates = { \"lv.par\" = \"par\" }\n\
                    results = { igb = { Sa_kPa = \"Sa.igb\", lambda = \"lambda.igb\" }, activation = \"lat.dat\" }";
    let Some(carp) = cohort("02-CoA", settings) else {
        return;
    };
    let run = |cohort: &Cohort| {
        cohort.call(&["run", "--no-report", "--quiet"]).expect(0);
        cohort.patient("02-CoA")
    };
    let (plain, carp_patient) = (run(&plain), run(&carp));
    // The single precision of the nodal traces affects the verification beat through step 2's
    // targets.
    let (expected, found) = (biomarkers(&plain), biomarkers(&carp_patient));
    for (name, expected) in &expected {
        assert!(
            (found[name] / expected - 1.0).abs() < 1e-3,
            "{name}: {} against {expected}",
            found[name]
        );
    }
    let directory = carp_patient["iterations"][0]["run"]["directory"]
        .as_str()
        .expect("a directory");
    let made = std::fs::read_to_string(Path::new(directory).join("external/lv.par"))
        .expect("the template's file");
    assert!(
        made.contains("\"Stress_Niederer\"") && made.contains("Tpeak=") && !made.contains('{'),
        "{made}"
    );
    let directory = carp_patient["verification"]["directory"]
        .as_str()
        .expect("a directory");
    let made = std::fs::read_to_string(Path::new(directory).join("external/lv.par"))
        .expect("the template's file");
    assert!(
        made.contains("\"Stress_Land17\"") && made.contains("nperm="),
        "{made}"
    );
}

#[test]
fn failures_of_another_solver_have_their_classes() {
    for (fault, class, words) in [
        (
            "sys.exit(2)",
            "input",
            "exit code 2; its last words: parameters make no sense",
        ),
        (
            "return",
            "input",
            "traces.csv: expected results here, found none",
        ),
        (
            "import os; os.kill(os.getpid(), 9)",
            "site",
            "killed by signal 9",
        ),
        ("sys.exit(77)", "numerics", "exit code 77"),
    ] {
        let Some(cohort) = cohort("02-CoA", "") else {
            return;
        };
        let fault = format!(
            "def main():\n    print(\"parameters make no sense\", flush=True)\n    {fault}"
        );
        cohort.edit("lv.py", "def main():", &fault);
        let said = cohort
            .call(&[
                "run",
                "--no-report",
                "--quiet",
                "--set",
                "executor.site_retries=0",
            ])
            .expect(1);
        let failure = &cohort.patient("02-CoA")["failure"];
        assert_eq!(failure["class"], class, "{said:?} {failure:#}");
        assert!(
            failure["message"]
                .as_str()
                .is_some_and(|message| message.contains(words)),
            "{failure:#}"
        );
    }
    // Impossible settings are reported before anything runs.
    let Some(cohort) = cohort("02-CoA", "") else {
        return;
    };
    cohort.edit("cohort.toml", "{model}", "{modle}");
    cohort
        .call(&["run"])
        .expect(3)
        .complains_of(&["solver.external.command", "did you mean {model}?"]);
    cohort.edit("cohort.toml", "{modle}", "{model}");
    cohort.edit("cohort.toml", "\"python3\"", "\"no-such-python\"");
    cohort.call(&["run", "--no-report", "--quiet"]).expect(1);
    let message = cohort.patient("02-CoA")["failure"]["message"].to_string();
    assert!(
        message.contains("`no-such-python` cannot be started"),
        "{message}"
    );
}

/// Kills everything within a call of the solver or right after it. Each time the next coordinator
/// continues.
#[test]
fn kills_lose_nothing_and_repeat_nothing_of_another_solver() {
    let Some(cohort) = cohort("02-CoA", "") else {
        return;
    };
    let log = cohort.path().join("solver.log");
    // The solver logs its begin and its end, and takes a moment in between.
    let begin = format!(
        "if __name__ == \"__main__\":\n    import time\n    def say(word):\n        with open({:?}, \"a\") as log:\n            \
         log.write(f\"{{word}} {{sys.argv[2]}}\\n\")\n    say(\"begin\")\n    time.sleep(0.2)\n    main()\n    say(\"end\")\n",
        log.display().to_string()
    );
    cohort.edit(
        "lv.py",
        "if __name__ == \"__main__\":\n    main()\n",
        &begin,
    );
    let n_said = |word: &str| {
        let said = std::fs::read_to_string(&log).unwrap_or_default();
        said.lines().filter(|line| line.starts_with(word)).count()
    };
    for round in 0..8 {
        // Either within a call of the solver, or after one, when its results are about to be read
        // and published.
        let word = ["begin", "end"][round / 2 % 2];
        let before = n_said(word);
        let mut coordinator = cohort.start(&["--no-report", "--quiet"]);
        if !coordinator.wait_until(&format!("{word} of a call"), || n_said(word) > before) {
            break; // nothing was left to do
        }
        coordinator.signal(Signal::KILL);
        // In every other round the workers are killed, too, and their solvers with them.
        if round % 2 == 0 {
            workers(&cohort.run_dir()).into_iter().for_each(|pid| {
                let _ = rustix::process::kill_process(pid, Signal::KILL);
            });
        }
        drop(coordinator.end());
    }
    cohort.call(&["run", "--no-report", "--quiet"]).expect(0);
    let tasks = published(&cohort.patient("02-CoA"));
    let said = std::fs::read_to_string(&log).expect("the solver was called");
    let begun: Vec<&str> = said
        .lines()
        .filter_map(|line| line.strip_prefix("begin "))
        .collect();
    for (step, key, generation) in &tasks {
        let of_task = |path: &&&str| path.contains(&format!("{}-g", &key[..16]));
        let later = begun.iter().filter(of_task).filter(|path| {
            let at = path.rfind("-g").map_or("", |at| &path[at + 2..]);
            at.split('/')
                .next()
                .and_then(|n| n.parse::<u64>().ok())
                .is_some_and(|n| n > *generation)
        });
        assert_eq!(
            later.count(),
            0,
            "{step} was simulated after it was published: {said}"
        );
        let attempts = begun
            .iter()
            .filter(of_task)
            .collect::<std::collections::BTreeSet<_>>();
        assert_eq!(
            attempts.len(),
            begun.iter().filter(of_task).count(),
            "{step}: twice in one directory: {said}"
        );
    }
    assert!(tasks.len() >= 5, "{tasks:?}");
}

/// The run's workers: processes whose command line contains the run directory.
fn workers(run: &Path) -> Vec<Pid> {
    let run = run.display().to_string();
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    let is_worker = |pid: &i32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).into_owned();
        line.contains("cardiotwin-worker") && line.contains(&run)
    };
    pids.filter(is_worker).filter_map(Pid::from_raw).collect()
}
