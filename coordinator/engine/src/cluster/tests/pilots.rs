//! Pilots on a cluster: nobody who waits takes a place in a job, and the numbers are the same.

use super::*;
use crate::EngineError;
use crate::RunSummary;
use crate::tests::pilots::{cohort, keys};

fn lab(n: u32, n_pilots: u32) -> Lab {
    let lab = Lab::new(cohort(n, n_pilots), Settings::default());
    lab.script.lock().unwrap().nodes = Some(100);
    lab
}

async fn waits(lab: &Lab) -> Vec<String> {
    let status = lab.reader().await.status().await.unwrap();
    let notes = status.patients.into_iter().map(|patient| patient.note);
    notes.filter(|note| note.starts_with("waits for")).collect()
}

/// Names of the patients of all jobs so far.
async fn placed(lab: &Lab) -> usize {
    lab.slurm.model.lock().unwrap().runs().len()
}

#[tokio::test]
async fn the_others_are_placed_when_the_pilots_have_ended_and_the_keys_are_those_of_one_machine() {
    let here = tests::Bench::new(cohort(5, 2));
    here.script(|s| s.nodes = Some(100));
    assert_eq!(here.run().await.0.done, 5);
    let expected = keys(&here.reader().await).await;

    for mut lab in [
        lab(5, 2),
        lab(5, 2).with_whole_nodes(),
        lab(5, 2).without_arrays(),
    ] {
        lab.tick().await;
        lab.pass(30);
        let status = lab.reader().await.status().await.unwrap();
        let in_jobs: Vec<String> = (status.cluster.unwrap().jobs.into_iter())
            .flat_map(|job| job.patients)
            .collect();
        assert_eq!(in_jobs, ["P1", "P2"]);
        assert_eq!(waits(&lab).await, ["waits for pilots P1, P2"; 3]);
        let summary = lab.finish().await;
        assert_eq!((summary.done, summary.held), (5, 0));
        assert_eq!(keys(&lab.reader().await).await, expected);
        lab.assert_published_once().await;
        assert!(placed(&lab).await >= 2);
    }
}

#[tokio::test]
async fn drivers_and_ticks_that_die_change_no_key() {
    let mut whole = lab(4, 2);
    assert_eq!(whole.finish().await.done, 4);
    let expected = keys(&whole.reader().await).await;
    let mut lab = lab(4, 2);
    // Drivers that die are the test's, not the patients'.
    (lab.site_retries, lab.settings.free_repeats) = (1000, 1000);
    for n in 0..400 {
        // Each tick dies a few points later than the one before, and each driver at another attempt.
        let summary = match lab.tick_dying_at(3 + n % 11).await {
            Ok(summary) => summary,
            Err(EngineError::Crashed { .. }) => lab.tick().await,
            Err(error) => panic!("{error}"),
        };
        if !summary.on_cluster() {
            assert_eq!(summary.done, 4, "{summary:?}");
            assert_eq!(keys(&lab.reader().await).await, expected);
            lab.assert_published_once().await;
            return;
        }
        lab.pass(30);
        lab.drive(|| {
            n.is_multiple_of(3)
                .then_some(((n / 3 % 5) as usize, n.is_multiple_of(2)))
        })
        .await;
    }
    panic!("it does not end");
}

#[tokio::test]
async fn a_lost_pilot_ends_the_ticks_and_says_what_to_do() {
    let mut lab = lab(3, 1);
    lab.script.lock().unwrap().fails_step0 = Some((8.0, FailureClass::Site));
    let mut summary = RunSummary::default();
    for _ in 0..100 {
        summary = lab.tick().await;
        if !summary.on_cluster() {
            break;
        }
        lab.pass(30);
        lab.drive(|| None).await;
    }
    assert!(!summary.on_cluster(), "{summary:?}");
    assert_eq!(
        (summary.failed, summary.unfinished, summary.held),
        (1, 2, 2)
    );
    let note = "waits for pilot P1: P1 failed; `retry P1`, or `run --set workflow.pilots=0`";
    assert_eq!(waits(&lab).await, [note; 2]);
    lab.script.lock().unwrap().fails_step0 = None;
    crate::retry(&lab.run_dir(), &"P1".into()).await.unwrap();
    assert_eq!(lab.finish().await.done, 3);
}
