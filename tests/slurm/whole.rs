//! Cohorts from end to end.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use rustix::process::Signal;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK, signal};

pub fn a_cohort_is_done_after_one_wait_in_the_queue(cluster: &Cluster) {
    let patients = ["01-CoA", "03-CoA"];
    let cohort = Cohort::of(cluster, &patients, QUICK)
        .set("executor.notices.command=[\"./hook\"]")
        .set("workflow.until=step3")
        .set("step3.max_iterations=1")
        // The posterior costs most of this chain; as few draws as a cohort may ask for.
        .set("posterior.draws=40");
    let (hook, heard) = (
        cohort.folder.path().join("hook"),
        cohort.folder.path().join("heard"),
    );
    fs::write(&hook, "#!/bin/sh\ncat >> \"$(dirname \"$0\")/heard\"\n").expect("a hook");
    fs::set_permissions(&hook, fs::Permissions::from_mode(0o755)).expect("it is ours");
    let first = cohort.advance();
    assert_eq!(first.code, 8, "{first:?}");
    assert!(first.err.contains("cardiotwin advance"), "{first:?}");
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    assert_eq!(
        cohort.jobs().len(),
        1,
        "one array, whatever the number of iterations"
    );
    // The tick that ends the run sends the notice, and no later tick does.
    cohort.advance();
    let told = fs::read_to_string(&heard).expect("the hook was called");
    assert_eq!(told.matches("\"event\": \"done\"").count(), 1, "{told}");
    let outcomes = cohort.attempts_with("outcome.json").len();
    assert!(
        outcomes > 5 * patients.len(),
        "{outcomes} simulations in one job"
    );
    assert_eq!(
        outcomes,
        cohort.attempts_with("started.json").len(),
        "nothing was begun twice"
    );
    let script = cohort.script(0);
    for part in [
        "--no-requeue",
        "--open-mode=append",
        "--export=NONE",
        "--array=0-1",
        "--signal=B:USR1@60",
    ] {
        assert!(script.contains(part), "{part} is not in\n{script}");
    }
    // The same cohort on this machine gives the same numbers.
    let there = cohort.call(&[
        "run",
        "--executor",
        "local",
        "--run-dir",
        "here",
        "--no-report",
    ]);
    // 7: cells of quick settings are off.
    assert_eq!(there.code, 7, "{there:?}");
    let compared = cohort.call(&["compare", "run", "here"]);
    assert_eq!(compared.code, 0, "{compared:?}");
    the_costs_of_jobs_add_up(&cohort, patients.len());
}

/// By job and by patient: node-hours as `status` counts them, and the efficiency that sacct knows.
fn the_costs_of_jobs_add_up(cohort: &Cohort, n_patients: usize) {
    let spent = cohort.status()["cluster"]["node_hours"].as_f64();
    let spent = spent.expect("node-hours");
    for by in [&["jobs", "--json"][..], &["jobs", "--json", "--by-patient"]] {
        let said = cohort.call(by);
        assert_eq!(said.code, 0, "{said:?}");
        let answer: serde_json::Value = serde_json::from_str(&said.out).expect("JSON");
        let rows = answer["jobs"].as_array().expect("rows");
        assert_eq!(rows.len(), n_patients, "{answer:#}");
        let hours: f64 = rows
            .iter()
            .filter_map(|row| row["node_hours"].as_f64())
            .sum();
        assert!(
            (hours - spent).abs() < 1e-9 && spent > 0.0,
            "{hours} of {spent}"
        );
        for row in rows {
            let efficiency = row["efficiency"].as_f64().expect("sacct knows it");
            assert!((0.02..1.2).contains(&efficiency), "{answer:#}");
            assert!(row["ran_s"].as_f64() > Some(0.0) && row["waited_s"].as_f64() >= Some(0.0));
        }
    }
}

pub fn a_tick_takes_two_commands(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], crate::cohort::SLOW);
    cohort.running_job();
    // A folder of programs that precede Slurm's own in the path, count their calls and pass them
    // on.
    let counting = tempfile::tempdir().expect("a folder");
    for program in [
        "squeue", "sacct", "sbatch", "scancel", "scontrol", "sacctmgr",
    ] {
        let path = counting.path().join(program);
        let log = counting.path().join("log");
        let real = format!(
            "#!/bin/sh\necho {program} >> {}\nexec /usr/bin/{program} \"$@\"\n",
            log.display()
        );
        std::fs::write(&path, real).expect("a program");
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755))
            .expect("it is ours");
    }
    let path = format!(
        "{}:{}",
        counting.path().display(),
        std::env::var("PATH").expect("a PATH")
    );
    let output = cohort
        .command(&["advance"])
        .env("PATH", path)
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(8));
    let asked = std::fs::read_to_string(counting.path().join("log")).expect("a log");
    assert_eq!(asked, "squeue\n");
}

pub fn a_plan_is_what_is_submitted(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA", "02-CoA", "03-CoA"], QUICK);
    let plan: serde_json::Value =
        serde_json::from_str(&cohort.call(&["plan", "--json"]).out).expect("JSON");
    assert_eq!(
        (
            plan["jobs"][0]["elements"].as_u64(),
            plan["jobs"][0]["patients"].as_u64()
        ),
        (Some(3), Some(3)),
        "{plan:#}"
    );
    assert!(
        plan["node_hours"].as_f64().is_some_and(|hours| hours > 0.0),
        "{plan:#}"
    );
    let script = cohort.call(&["plan", "--script"]).out;
    assert!(
        cohort.jobs().is_empty() && !cohort.folder.path().join("run").exists(),
        "a plan changes nothing"
    );
    cohort.advance();
    let name = cohort.jobs()[0]
        .file_name()
        .expect("a name")
        .to_string_lossy()
        .into_owned();
    assert_eq!(
        script.trim_end().replace("ct-plan-1", &name),
        cohort.script(0).trim_end()
    );
    assert_eq!(cohort.finish(), 0);
}

pub fn a_job_that_submits_itself_brings_a_cohort_to_its_end(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK);
    let script =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/submit-cohort.sbatch");
    let program = cohort.command(&[]).get_program().to_owned();
    let sbatch = std::process::Command::new("sbatch")
        .args(["--parsable", "--partition=main"])
        .arg(&script)
        .arg(cohort.folder.path())
        .current_dir(cohort.folder.path())
        .env("SLURM_CONF", &cluster.conf)
        .env("CARDIOTWIN", program)
        .envs([("CARDIOTWIN_PAUSE", "1"), ("CARDIOTWIN_TICKS", "1")])
        .output()
        .expect("sbatch is there");
    assert!(
        sbatch.status.success(),
        "{}",
        String::from_utf8_lossy(&sbatch.stderr)
    );
    let log = cohort.folder.path().join("cardiotwin-advance.log");
    let said = || std::fs::read_to_string(&log).unwrap_or_default();
    cluster.wait("the end of the cohort", || {
        said().contains("over: exit code")
    });
    // 7: cells of quick settings are off.
    assert!(said().contains("over: exit code 7"), "{}", said());
    cohort.assert_done();
    assert_eq!(
        cohort.attempts_with("started.json").len(),
        cohort.attempts_with("outcome.json").len()
    );
}

/// On a file system that hosts share there is no write-ahead log, readers use the published
/// snapshot, and a backup can be made and read.
pub fn a_run_on_a_shared_file_system_is_read_from_a_snapshot(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK);
    let shared = |arguments: &[&str]| {
        let output = cohort
            .command(arguments)
            .env("CARDIOTWIN_FILE_SYSTEM", "network")
            .output()
            .expect("it starts");
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stdout).into_owned(),
        )
    };
    assert_eq!(shared(&["advance"]).0, Some(8));
    let run = cohort.folder.path().join("run");
    assert!(run.join("cardiotwin.snapshot.db").exists() && !run.join("cardiotwin.db-wal").exists());
    let at = std::time::Instant::now();
    while shared(&["advance"]).0 == Some(8) {
        assert!(
            at.elapsed() < crate::cluster::PATIENCE,
            "{}",
            shared(&["status"]).1
        );
        std::thread::sleep(std::time::Duration::from_millis(200));
    }
    // The database itself is locked, which readers do not notice.
    std::fs::write(run.join("cardiotwin.db-journal"), "x").expect("a journal");
    assert!(
        shared(&["status"]).1.contains("1 done"),
        "{}",
        shared(&["status"]).1
    );
    let copy = cohort.folder.path().join("copies");
    std::fs::create_dir(&copy).expect("a folder");
    assert_eq!(
        shared(&["backup", "--to", "copies/cardiotwin.db"]).0,
        Some(0)
    );
    assert!(cohort.call(&["status", "copies"]).out.contains("1 done"));
}

/// The bundled solver in Python replaces the built-in one, and a worker is killed during one of its
/// simulations.
pub fn a_cohort_on_another_solver_survives_a_killed_worker(cluster: &Cluster) {
    if !std::process::Command::new("python3")
        .arg("--version")
        .output()
        .is_ok_and(|said| said.status.success())
    {
        crate::not_tested("python3", "no python3 in PATH to run an external solver");
        return;
    }
    let cohort = Cohort::of(cluster, &["01-CoA", "02-CoA"], QUICK);
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/external-solver/lv.py");
    let solver = fs::read_to_string(source).expect("the example");
    // Each call takes long enough to be interrupted by the kill.
    let slow = solver.replacen(
        "def main():",
        "def main():\n    import time\n    time.sleep(0.5)",
        1,
    );
    assert_ne!(slow, solver);
    fs::write(cohort.folder.path().join("lv.py"), slow).expect("a file");
    let settings = cohort.folder.path().join("cohort.toml");
    let text = fs::read_to_string(&settings)
        .expect("the cohort")
        .replace("\"reduced\"", "\"external\"");
    let external = "[solver.external]\nfiles = { model = \"lv.py\" }\nparameters = \"json\"\n\
                    command = [\"python3\", \"{model}\", \"{parameters}\", \"{out}\"]\n";
    fs::write(&settings, format!("{text}{external}")).expect("the cohort");
    cohort.running_job();
    let at_work = || {
        cohort
            .workers()
            .into_iter()
            .find(|claim| claim.with_file_name("external").is_dir())
    };
    cluster.wait("a simulation of the other solver", || at_work().is_some());
    let claim = at_work().or_else(at_work).expect("one is at work");
    signal(&claim, Signal::KILL);
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    let tally = cohort.tally();
    assert!(
        tally.published >= 10 && tally.twice == 0 && tally.again == 0 && tally.repeated <= 2,
        "{tally:?}"
    );
}
