//! What logins print around the answers of Slurm's commands, and leases of other hosts: kinds 20 and 21
//! of the public reports. A job is adopted, or waited for as unknown; it is never submitted twice.

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::support::{Cohort, Said, command};

/// Seconds since 1970 of a day in 2026.
const SUBMITTED_S: u64 = 1_780_000_000;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/public-reports")
        .join(name)
}

/// Programs with Slurm's names that know jobs: sbatch notes the name, and squeue lists it as waiting.
fn scheduler(folder: &Path) {
    let row =
        "ctq|%s|%s|%s|PENDING|Priority|main|normal|t01|1|1||SUBMITTED|N/A|N/A|30:00|%s|ctq.\\n"
            .replace("SUBMITTED", &SUBMITTED_S.to_string());
    let sbatch = r#"for script; do :; done
n=$(( $(wc -l < "$jobs") + 4711 ))
name=$(sed -n 's/^#SBATCH --job-name=//p' "$script")
last=$(sed -n 's/^#SBATCH --array=0-\([0-9]*\).*/\1/p' "$script")
echo "$n $name $last" >> "$jobs"
echo "$n"
"#;
    let squeue = r#"echo 'ctq|ARRAY_JOB_ID|ARRAY_TASK_ID|JOBID|STATE|REASON|PARTITION|QOS|ACCOUNT|NODES|CPUS|NODELIST|SUBMIT_TIME|START_TIME|END_TIME|TIME_LIMIT|NAME|ctq.'
while read -r n name last; do
    if [ -z "$last" ]; then
        printf 'ROW' "$n" N/A "$n" "$name"
    else
        for k in $(seq 0 "$last"); do printf 'ROW' "$n" "$k" "$((n + k))" "$name"; done
    fi
done < "$jobs"
"#
    .replace("ROW", &row);
    let jobs = folder.join("jobs");
    std::fs::write(&jobs, "").unwrap();
    for (name, text) in [
        ("sbatch", sbatch),
        ("squeue", &squeue),
        ("sacct", "exit 1\n"),
        ("scancel", ":\n"),
        ("scontrol", "echo 'SLURM_VERSION = 24.05.0'\n"),
        ("sacctmgr", "exit 1\n"),
    ] {
        let file = folder.join(name);
        let script = format!("#!/bin/bash\njobs='{}'\n{text}", jobs.display());
        std::fs::write(&file, script).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
}

/// A cohort of one patient on a Slurm that answers as a variant does.
struct Site {
    cohort: Cohort,
    programs: tempfile::TempDir,
    search: String,
    reason: &'static str,
}

impl Site {
    fn of(variant: Option<&str>) -> Self {
        let programs = tempfile::tempdir().unwrap();
        scheduler(programs.path());
        let mut search = format!(
            "{}:{}",
            programs.path().display(),
            std::env::var("PATH").unwrap()
        );
        if let Some(variant) = variant {
            // A copy, because a checkout may not keep the rights of programs.
            let copy = programs.path().join(variant);
            std::fs::create_dir(&copy).unwrap();
            for entry in std::fs::read_dir(fixture("20-slurm-answers").join(variant)).unwrap() {
                let from = entry.unwrap().path();
                let to = copy.join(from.file_name().unwrap());
                std::fs::copy(&from, &to).unwrap();
                std::fs::set_permissions(&to, std::fs::Permissions::from_mode(0o755)).unwrap();
            }
            search = format!("{}:{search}", copy.display());
        }
        Self {
            cohort: Cohort::quick_of("01-CoA"),
            programs,
            search,
            reason: "Priority",
        }
    }

    fn call(&self, first: &[&str]) -> Said {
        let site = format!(
            "executor.slurm.site={}",
            fixture("19-slurm-submit-environment/site.toml").display()
        );
        let settings = ["--set", &site, "--set", "executor.slurm.account=t01"];
        let output = command(self.cohort.path(), &[first, &settings].concat())
            .env("PATH", &self.search)
            .env("REASON_FAKE", self.reason)
            .output()
            .unwrap();
        Said {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// Submits, and looks at the queue three times more.
    fn four_ticks(&self) -> Value {
        self.call(&["run", ".", "--executor", "slurm"]).expect(8);
        for _ in 0..3 {
            self.call(&["advance"]).expect(8);
        }
        self.cohort.call(&["status", "--json"]).json()
    }

    fn n_submitted(&self) -> usize {
        let jobs = std::fs::read_to_string(self.programs.path().join("jobs")).unwrap();
        jobs.lines().count()
    }
}

#[test]
fn kind_20_a_job_behind_any_answer_is_adopted_or_unknown() {
    for variant in [
        "banner",
        "banner2",
        "clusterline",
        "dupid",
        "footer",
        "lateid",
        "oncluster",
        "reason",
    ] {
        let site = Site::of(Some(variant));
        let status = site.four_ticks();
        let jobs = status["cluster"]["jobs"].as_array().unwrap();
        assert_eq!(
            (jobs.len(), site.n_submitted()),
            (1, 1),
            "{variant}: {status:#}"
        );
        assert_eq!(jobs[0]["state"], "waiting", "{variant}: {status:#}");
        let id = jobs[0]["id"].as_str().unwrap();
        assert!(id.starts_with("4711"), "{variant}: {status:#}");
    }
    // Without an answer of the queue nothing is submitted, and it is said why.
    let site = Site::of(Some("nome"));
    let status = site.four_ticks();
    let holds = status["cluster"]["holds"].as_str().unwrap_or_default();
    assert!(
        holds.contains("until the queue answers") && holds.contains("option '--me'"),
        "{status:#}"
    );
    assert_eq!(site.n_submitted(), 0, "{status:#}");
}

#[test]
fn kind_20_a_held_job_is_named_as_held_with_what_releases_it() {
    for (reason, parts) in [
        (
            "user env retrieval failed requeued held",
            ["held", "scontrol release"],
        ),
        (
            "ReservationDeleted",
            [
                "its reservation was deleted or has ended",
                "scontrol release",
            ],
        ),
    ] {
        let site = Site {
            reason,
            ..Site::of(Some("reason"))
        };
        let status = site.four_ticks();
        let why = status["cluster"]["jobs"][0]["why"].as_str().unwrap();
        assert!(parts.iter().all(|part| why.contains(part)), "{status:#}");
        // The command names the job.
        assert!(why.contains("scontrol release 4711"), "{why}");
        assert_eq!(site.n_submitted(), 1);
    }
}

#[test]
fn kind_21_a_lease_of_a_clock_that_is_ahead_says_how_to_end_it() {
    let site = Site::of(None);
    site.call(&["run", ".", "--executor", "slurm"]).expect(8);
    let folder = site.cohort.run_dir().join("lease");
    let mut leases: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .collect();
    leases.sort();
    let newest = std::fs::read_to_string(leases.last().unwrap()).unwrap();
    let mut lease: Value = serde_json::from_str(&newest).unwrap();
    let now_ms = cardiotwin_engine::clock::now_ms();
    let five_hours_ms = 5 * 3_600_000;
    let generation = lease["generation"].as_u64().unwrap() + 1;
    let ends_ms = now_ms + five_hours_ms;
    lease["generation"] = json!(generation);
    lease["released"] = json!(false);
    lease["expires_ms"] = json!(ends_ms);
    lease["holder"]["host"] = json!("login4.example");
    lease["holder"]["boot_id"] = json!("00000000-0000-0000-0000-000000000000");
    lease["holder"]["at"] = json!(cardiotwin_engine::clock::utc_text(ends_ms - 600_000));
    let name = format!("{generation:010}.json");
    std::fs::write(folder.join(&name), lease.to_string()).unwrap();
    let said = site.call(&["advance"]);
    assert_ne!(said.code, 8);
    said.complains_of(&[
        "on login4.example",
        &format!(
            "holds until {}",
            cardiotwin_engine::clock::utc_text(ends_ms)
        ),
        "the clock of login4.example is ahead",
        "If no coordinator runs there any more, remove",
        &name,
    ]);
    assert_eq!(site.n_submitted(), 1);
}
