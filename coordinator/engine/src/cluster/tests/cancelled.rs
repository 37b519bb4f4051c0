//! Jobs in state CANCELLED: by a person, whose wish holds, or by Slurm, which counts as a failure
//! of the site.

use cardiotwin_slurm::access::folder::JobFolder;
use cardiotwin_slurm::commands;
use cardiotwin_slurm::job::JobName;
use cardiotwin_slurm_model::Settings;

use super::lab::Lab;
use super::noops;

/// Cancels a job by its name, as a person would.
fn scancel(lab: &Lab, name: &str) {
    let cancel = commands::cancel_name(&JobName::new(name).unwrap());
    lab.slurm
        .model
        .lock()
        .unwrap()
        .answer(&cancel, |_| None, None);
}

fn first_run(lab: &Lab) -> String {
    lab.slurm.model.lock().unwrap().runs()[0].name.clone()
}

#[tokio::test]
async fn a_job_that_a_person_cancelled_stays_cancelled() {
    let lab = Lab::new(noops(1), Settings::default());
    lab.tick().await;
    lab.pass(5);
    scancel(&lab, &first_run(&lab));
    lab.pass(5);
    let summary = lab.tick().await;
    assert_eq!((summary.cancelled, summary.jobs), (1, 0));
    assert_eq!(
        lab.tick().await.cancelled,
        1,
        "it is not taken up again by itself"
    );
}

/// While the database still has the job as running, it is asked again, and then it names the
/// person.
#[tokio::test]
async fn while_accounting_lags_nobody_is_blamed() {
    let mut lab = Lab::new(
        noops(1),
        Settings {
            accounting_lag_s: 3,
            ..Settings::default()
        },
    );
    lab.settings.grace_s = 3600;
    lab.tick().await;
    lab.pass(10);
    scancel(&lab, &first_run(&lab));
    let summary = lab.tick().await;
    assert_eq!(
        (summary.cancelled, summary.jobs),
        (0, 1),
        "Slurm says CANCELLED, accounting says RUNNING"
    );
    let note = lab.reader().await.status().await.unwrap().patients[0]
        .note
        .clone();
    assert!(note.contains("not yet by whom"), "{note}");
    lab.pass(10);
    let summary = lab.tick().await;
    assert_eq!((summary.cancelled, summary.jobs), (1, 0));
}

/// A controller that lost its state hands out a number twice and cancels the new job as it starts.
/// No person did.
#[tokio::test]
async fn a_job_whose_number_still_runs_is_submitted_again() {
    for has_accounting in [true, false] {
        let mut lab = Lab::new(
            noops(1),
            Settings {
                has_accounting,
                ..Settings::default()
            },
        );
        lab.tick().await;
        lab.pass(2);
        assert_eq!(
            lab.slurm.model.lock().unwrap().runs().len(),
            1,
            "the first job runs"
        );
        lab.slurm.model.lock().unwrap().crash_controller();
        let mut jobs = 0;
        for _ in 0..4 {
            lab.moment();
            let summary = lab.tick().await;
            assert_eq!(summary.cancelled, 0, "accounting: {has_accounting}");
            jobs = jobs.max(
                std::fs::read_dir(lab.run_dir().join("slurm"))
                    .unwrap()
                    .count(),
            );
            lab.pass(1);
        }
        assert!(
            jobs >= 3,
            "lost, cancelled as it started, and once more: {jobs}"
        );
        assert_eq!(lab.finish().await.done, 1);
        lab.assert_published_once().await;
        assert_eq!(lab.attempts(), (3, 3));
    }
}

/// Without accounting the job's own evidence decides: its processes were asked to end, or it never
/// had a node.
#[tokio::test]
async fn without_accounting_the_jobs_own_evidence_tells() {
    let settings = || Settings {
        has_accounting: false,
        n_nodes: 1,
        ..Settings::default()
    };
    let lab = Lab::new(noops(1), settings());
    lab.tick().await;
    lab.pass(5);
    let name = first_run(&lab);
    JobFolder::of(&lab.run_dir(), &name).note_asked_to_end(0, 0);
    scancel(&lab, &name);
    assert_eq!(lab.tick().await.cancelled, 1);

    let mut lab = Lab::new(noops(2), settings());
    lab.settings.job_s = 1;
    lab.tick().await;
    lab.slurm.model.lock().unwrap().lose_node(1); // nothing starts any more
    let names: Vec<String> = (std::fs::read_dir(lab.run_dir().join("slurm"))
        .unwrap()
        .flatten())
    .map(|entry| entry.file_name().to_string_lossy().into_owned())
    .collect();
    names.iter().for_each(|name| scancel(&lab, name));
    assert_eq!(lab.tick().await.cancelled, 2);
}
