//! Workers that are lost: how often they are replaced, and after which pauses.

use cardiotwin_schemas::failure::FailureClass;

use super::*;

#[tokio::test]
async fn a_lost_worker_is_replaced_after_a_pause_that_the_status_shows() {
    let mut bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.clock = clock::Clock::manual(1_000_000);
    bench.script(|s| s.lost_attempts = 2);
    let (events, mut told) = tokio::sync::mpsc::unbounded_channel();
    let (clock, path) = (bench.clock.clone(), bench.path().to_owned());
    let watcher = async move {
        let mut notes = Vec::new();
        while let Some(event) = told.recv().await {
            if matches!(event, EngineEvent::AttemptFailed { .. }) {
                let reader = Reader::open(&path).await.unwrap();
                let status = reader.status().await.unwrap();
                notes.push(status.patients[0].note.clone());
                // Without this the run would wait for ever: its clock stands still.
                clock.advance_ms([1_000, 4_000][notes.len() - 1]);
            }
        }
        notes
    };
    let ((summary, _), notes) = tokio::join!(bench.run_with(events, StopSignal::new()), watcher);
    assert_eq!(summary.done, 1);
    assert_eq!(
        notes,
        [
            "try 2 begins at 1970-01-01T00:16:41.000Z, because try 1 was lost",
            "try 3 begins at 1970-01-01T00:16:45.000Z, because try 2 was lost",
        ]
    );
    let attempts = bench.reader().await.attempts(&"P1".into()).await.unwrap();
    let planned: Vec<&str> = attempts[..3].iter().map(|a| a.planned.as_str()).collect();
    assert_eq!(
        planned,
        [
            "1970-01-01T00:16:40.000Z",
            "1970-01-01T00:16:41.000Z",
            "1970-01-01T00:16:45.000Z"
        ]
    );
}

#[tokio::test]
async fn lost_workers_are_replaced_as_often_as_asked() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.lost_attempts = 2);
    assert_eq!(bench.run().await.0.done, 1);
    let attempts = bench.reader().await.attempts(&"P1".into()).await.unwrap();
    let words: Vec<_> = attempts[..3]
        .iter()
        .map(|a| (a.generation, a.state.word()))
        .collect();
    assert_eq!(words, [(1, "lost"), (2, "lost"), (3, "succeeded")]);

    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.lost_attempts = 3);
    assert_eq!(bench.run().await.0.failed, 1);
    assert_eq!(
        bench.patient("P1").await.failure.unwrap().class,
        FailureClass::Site
    );
    retry(bench.path(), &"P1".into()).await.unwrap();
    assert_eq!(bench.run().await.0.done, 1);
}
