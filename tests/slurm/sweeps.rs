//! Sweeps as jobs: Sobol chunks that continue at their first missing sample, personalisations
//! packed into arrays, and array sizes that the scheduler accepts.

use std::fs;
use std::path::Path;

use rustix::process::Signal;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK, signal};

/// Number of blocks of 44 samples each, which take seconds.
const BLOCKS: &str = "384";

/// Complete lines in a log of samples, which end with a line break.
fn logged(attempt: &Path) -> Vec<String> {
    let text = fs::read_to_string(attempt.join("checkpoint/samples")).unwrap_or_default();
    text.split_inclusive('\n')
        .skip(1)
        .filter(|line| line.ends_with('\n'))
        .map(str::to_owned)
        .collect()
}

pub fn a_killed_chunk_goes_on_at_its_first_missing_sample(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &[], QUICK);
    let sweep = |more: &[&str]| {
        let arguments = [
            "sweep",
            "gsa",
            "--samples",
            BLOCKS,
            "--chunk-blocks",
            BLOCKS,
            "--resamples",
            "2",
        ];
        cohort.call(&[&arguments, more].concat())
    };
    let site = cohort.site();
    let tick = || sweep(&["--out", "run", "--slurm", &site, "--account", "t01"]);
    assert_eq!(tick().code, 8);
    let at_work = || {
        cohort
            .attempts_with("started.json")
            .into_iter()
            .find(|path| logged(path).len() > 700)
    };
    cluster.wait("some samples", || at_work().is_some());
    let first = at_work().expect("it was there");
    signal(&first.join("started.json"), Signal::KILL);
    let left = logged(&first);
    assert!(
        !first.join("outcome.json").exists(),
        "it was killed within the chunk"
    );
    cluster.wait("the end of the sweep", || {
        let said = tick();
        assert!(matches!(said.code, 0 | 8), "{said:?}");
        said.code == 0
    });
    assert_eq!(
        cohort.jobs().len(),
        2,
        "a job that was killed in, and one that goes on"
    );
    let name = first
        .file_name()
        .expect("a name")
        .to_string_lossy()
        .replace("-g1", "-g2");
    let second = first.with_file_name(name);
    assert_eq!(
        logged(&second)[..left.len()],
        left,
        "what was left is not computed again"
    );
    let progress =
        fs::read_to_string(second.join("progress.jsonl")).expect("it has more than one step to do");
    let begun: serde_json::Value =
        serde_json::from_str(progress.lines().next().expect("a report")).expect("JSON");
    assert!(
        begun["done"]
            .as_f64()
            .is_some_and(|done| done >= left.len() as f64),
        "{begun}"
    );
    // The same sweep in one continue this machine gives the same numbers.
    assert_eq!(sweep(&["--out", "here"]).code, 0);
    let result = |folder: &str| {
        let path = cohort
            .folder
            .path()
            .join(folder)
            .join("results/second_order.csv");
        fs::read_to_string(path).expect("a result")
    };
    assert_eq!(result("run"), result("here"));
}

/// Two whole personalisations on a coarse mesh in 3D, each as an element of an array.
pub fn a_robustness_sweep_in_3d_is_packed_into_an_array(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["02-CoA"], QUICK);
    let site = cohort.site();
    let tick = || {
        let what = [
            "sweep",
            "robustness",
            ".",
            "--kind",
            "data",
            "--samples",
            "1",
            "--out",
            "run",
            "--slurm",
            &site,
        ];
        let settings = [
            "solver.fidelity=finite-element",
            "solver.finite_element.mesh_nodes=500",
        ];
        cohort.call(&[&what[..], &["--set", settings[0], "--set", settings[1]]].concat())
    };
    assert_eq!(tick().code, 8);
    assert!(
        cohort.script(0).contains("--array=0-1"),
        "{}",
        cohort.script(0)
    );
    cluster.wait("the end of the sweep", || {
        let said = tick();
        assert!(matches!(said.code, 0 | 8), "{said:?}");
        said.code == 0
    });
    cohort.assert_done();
    assert_eq!(cohort.jobs().len(), 1);
    assert_eq!(
        cohort.attempts_with("started.json").len(),
        cohort.attempts_with("outcome.json").len()
    );
    let members =
        fs::read_to_string(cohort.folder.path().join("run/results/members.csv")).expect("a table");
    assert_eq!(members.lines().count(), 3, "{members}");
}

/// Fault recipe (e): an array above MaxArraySize is refused. The profile does not contain Slurm's
/// limit, but Slurm reports it.
pub fn arrays_are_split_where_slurm_says(cluster: &Cluster) {
    let refused = cluster.refused("sbatch", &["--array=0-1001", "--hold", "--wrap=true"]);
    assert!(
        refused.contains("Invalid job array specification"),
        "{refused}"
    );
    let cohort = Cohort::of(cluster, &["02-CoA"], QUICK);
    cohort.change_profile(
        "[arrays]\nallowed = true\n",
        "[arrays]\nallowed = true\nmax_size = 100000\n",
    );
    // No job is to run.
    cluster.slurm("scontrol", &["update", "partitionname=main", "state=down"]);
    let site = cohort.site();
    let what = [
        "sweep",
        "robustness",
        ".",
        "--kind",
        "data",
        "--samples",
        "1100",
        "--out",
        "run",
        "--slurm",
        &site,
    ];
    let said = cohort.call(&what);
    let cancelled = cohort.call(&["cancel", "--all", "--cohort", "run"]);
    assert!(
        cluster.slurm("squeue", &["--me", "-h"]).is_empty(),
        "{cancelled:?}"
    );
    cluster.slurm("scontrol", &["update", "partitionname=main", "state=up"]);
    assert_eq!(
        (said.code, cancelled.code),
        (8, 0),
        "{said:?} {cancelled:?}"
    );
    let sizes: Vec<u32> = (0..cohort.jobs().len())
        .map(|n| {
            let script = cohort.script(n);
            let array = script
                .lines()
                .find_map(|line| line.strip_prefix("#SBATCH --array=0-"))
                .unwrap_or("0");
            array
                .split('%')
                .next()
                .and_then(|last| last.parse::<u32>().ok())
                .expect("a number")
                + 1
        })
        .collect();
    // 1101 personalisations, each an element of its own.
    assert_eq!(sizes, [1001, 100], "{said:?}");
}
