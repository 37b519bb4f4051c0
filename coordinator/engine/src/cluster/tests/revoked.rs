//! A worker that outlives the end of its job: either its outcome or the revocation counts, not
//! both.

use std::path::PathBuf;

use cardiotwin_protocol::closing::{PreparedOutcome, Winner};
use cardiotwin_protocol::names;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::task::AttemptSpec;
use cardiotwin_slurm_model::Settings;

use super::lab::Lab;
use super::noops;

/// A job whose driver is dead and whose worker has claimed an attempt, with the outcome that this
/// worker will publish.
async fn orphan() -> (Lab, PathBuf, TaskOutcome) {
    let mut lab = Lab::new(noops(1), Settings::default());
    lab.tick().await;
    lab.pass(2);
    lab.drive(|| Some((0, true))).await;
    let at_work = lab.attempts_at_work();
    assert_eq!(at_work.len(), 1, "{at_work:?}");
    let directory = at_work[0].clone();
    let spec = std::fs::read(directory.join(names::SPEC)).unwrap();
    let spec: AttemptSpec = serde_json::from_slice(&spec).unwrap();
    let outcome = TaskOutcome {
        schema_version: formats::OUTCOME.version,
        attempt: spec.attempt,
        ending: lab.script.lock().unwrap().ending(&spec.task),
        artefacts: vec![],
        provenance: Provenance::default(),
        sha256: None,
    };
    (lab, directory, outcome)
}

#[tokio::test]
async fn a_worker_that_comes_second_publishes_nothing() {
    let (mut lab, directory, outcome) = orphan().await;
    let prepared = PreparedOutcome::new(&directory, &outcome).unwrap();
    lab.slurm.model.lock().unwrap().lose_node(1);
    lab.tick().await;
    assert_eq!(prepared.publish().unwrap(), Winner::Coordinator);
    assert_eq!(lab.finish().await.done, 1);
    lab.assert_published_once().await;
    assert_eq!(lab.attempts(), (4, 3), "its task was tried again, once");
}

#[tokio::test]
async fn an_outcome_that_comes_first_is_taken_up() {
    let (mut lab, directory, outcome) = orphan().await;
    let prepared = PreparedOutcome::new(&directory, &outcome).unwrap();
    lab.slurm.model.lock().unwrap().lose_node(1);
    assert_eq!(prepared.publish().unwrap(), Winner::Worker);
    lab.tick().await;
    assert_eq!(lab.finish().await.done, 1);
    lab.assert_published_once().await;
    assert_eq!(lab.attempts(), (3, 3), "nothing was tried again");
}
