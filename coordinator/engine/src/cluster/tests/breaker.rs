//! A scheduler that does not answer is left alone, longer each time.

use cardiotwin_slurm_model::{Fault, Settings};
use cardiotwin_store::Writer;
use cardiotwin_store::cluster_jobs::{ClusterReport, REPORT};

use super::lab::Lab;
use super::noops;

/// After three queries without an answer Slurm is left alone; after the pause it is asked again.
#[tokio::test]
async fn a_scheduler_that_does_not_answer_is_left_alone() {
    let mut lab = Lab::new(noops(1), Settings::default());
    lab.settings.grace_s = 3600;
    let questions = || lab.n_asked("squeue");
    for _ in 0..4 {
        lab.fault("squeue", Fault::Down);
    }
    for n in 1..=3 {
        lab.tick().await;
        assert_eq!(questions(), n);
    }
    for _ in 0..2 {
        lab.tick().await;
        assert_eq!(questions(), 3, "it is left alone");
    }
    let report = async || {
        let mut writer = Writer::open(&lab.run_dir()).await.unwrap();
        let text = writer.meta().await.unwrap().remove(REPORT).unwrap();
        writer.close_file().await.unwrap();
        serde_json::from_str::<ClusterReport>(&text).unwrap()
    };
    let first = report().await;
    let told = first.no_answer.unwrap_or_default();
    assert!(
        told.contains("no commands until") && told.contains("after 3 commands without an answer"),
        "{told}"
    );
    lab.pass(3600);
    lab.tick().await; // asked, and silent once more
    assert_eq!(questions(), 4);
    lab.tick().await;
    assert_eq!(questions(), 4, "one more silence is enough");
    assert!(report().await.asks_again_ms > first.asks_again_ms);
    assert_eq!(lab.n_asked("sbatch"), 0);
    lab.pass(3600);
    lab.settings.grace_s = 0;
    assert_eq!(lab.finish().await.done, 1);
}
