//! A scheduler that does not answer is left alone, longer each time.

use cardiotwin_slurm::model::{Fault, Settings};

use super::lab::Lab;
use super::noops;
use crate::engine::cluster::breaker::pause_ms;
use crate::store::Writer;
use crate::store::cluster_jobs::{ClusterReport, REPORT};

#[test]
fn pauses_double_from_the_third_silence_on_up_to_an_hour() {
    let pauses: Vec<Option<i64>> = (1..=9).map(|silent| pause_ms(silent, 120)).collect();
    let s = |seconds: i64| Some(seconds * 1000);
    assert_eq!(
        pauses,
        [
            None,
            None,
            s(120),
            s(240),
            s(480),
            s(960),
            s(1920),
            s(3600),
            s(3600)
        ]
    );
    assert_eq!(
        (pause_ms(u32::MAX, 1), pause_ms(7, u64::MAX), pause_ms(7, 0)),
        (s(3600), s(3600), s(0))
    );
}

/// Three questions without an answer, and Slurm is left alone; once the pause is over it is asked again.
#[tokio::test]
async fn a_scheduler_that_does_not_answer_is_left_alone() {
    let mut lab = Lab::new(noops(1), Settings::default());
    lab.settings.grace_s = 3600;
    let questions = || {
        lab.slurm
            .asked
            .lock()
            .unwrap()
            .iter()
            .filter(|program| **program == "squeue")
            .count()
    };
    lab.slurm
        .faults
        .lock()
        .unwrap()
        .extend(vec![("squeue", Fault::Down); 4]);
    for n in 1..=3 {
        lab.tick(None).await.unwrap();
        assert_eq!(questions(), n);
    }
    for _ in 0..2 {
        lab.tick(None).await.unwrap();
        assert_eq!(questions(), 3, "it is left alone");
    }
    let pause = |minutes: i64| {
        let lab = &lab;
        async move {
            let mut writer = Writer::open(&lab.run_dir()).await.unwrap();
            let text = writer.meta().await.unwrap().remove(REPORT).unwrap();
            let mut report: ClusterReport = serde_json::from_str(&text).unwrap();
            let until_ms = report.asks_again_ms;
            report.asks_again_ms -= minutes * 60_000;
            let told = report.no_answer.clone().unwrap_or_default();
            writer
                .set_meta(&[(REPORT, &serde_json::to_string(&report).unwrap())])
                .await
                .unwrap();
            writer.close_file().await.unwrap();
            (until_ms, told)
        }
    };
    let (first, told) = pause(60).await;
    assert!(
        told.contains("left alone until") && told.contains("after 3 commands without an answer"),
        "{told}"
    );
    lab.tick(None).await.unwrap(); // asked, and silent once more
    assert_eq!(questions(), 4);
    lab.tick(None).await.unwrap();
    assert_eq!(questions(), 4, "one more silence is enough");
    assert!(pause(60).await.0 >= first);
    assert_eq!(
        lab.slurm
            .asked
            .lock()
            .unwrap()
            .iter()
            .filter(|program| **program == "sbatch")
            .count(),
        0
    );
    lab.settings.grace_s = 0;
    assert_eq!(lab.finish().await.done, 1);
}
