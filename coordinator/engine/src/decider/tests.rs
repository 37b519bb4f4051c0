//! Decisions read nothing: they believe what they are told of files.

use cardiotwin_store::{Extent, Writer};
use cardiotwin_workflow::patient::{Patient, Stage};

use super::Decider;
use crate::books::Books;
use crate::files_seen::FilesSeen;
use crate::requests::Request;
use crate::tests::{Bench, personalised};

#[tokio::test]
async fn a_decision_waits_for_files_and_believes_the_answer() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.leaves_files();
    bench.refuses(Some("targets"));
    bench.run().await;
    for (exist, stage) in [(true, Stage::Targets), (false, Stage::Step1)] {
        let loaded = Writer::look(bench.path()).await.unwrap();
        let mut books = Books::new(bench.path(), loaded, 0).unwrap();
        books.select(|_| true);
        let mut decider = Decider::default();
        let patient = "P1".into();
        let retry = Request::Retry { patient };
        decider.request(&mut books, &retry).unwrap();
        let asked = decider.questions();
        assert!(!asked.is_empty() && asked.files.iter().all(|path| path.is_file()));
        assert_eq!(books.patient(0).row.state, Patient::Waiting);
        let seen = FilesSeen::told(asked.files, exist);
        decider.answer(&mut books, seen).unwrap();
        assert!(decider.questions().is_empty());
        let step = books.patient(0).row.state.step().unwrap();
        assert_eq!(step.stage, stage, "told that they exist: {exist}");
    }
}

#[tokio::test]
async fn unchanged_patients_keep_their_plans_and_take_their_positions() {
    let patients = ["P1", "P2", "P3"].map(|id| personalised(id, 8.0));
    let bench = Bench::new(patients.to_vec());
    bench.run().await;
    let loaded = Writer::look(bench.path()).await.unwrap();
    let mut books = Books::new(bench.path(), loaded, 0).unwrap();
    let mut decider = Decider::default();
    let standing = |books: &Books| -> Vec<(i64, bool)> {
        let rows = books.patients().iter().map(|patient| &patient.row);
        rows.map(|row| (row.position, row.active)).collect()
    };
    let changed = personalised("P2", 9.0);
    let unchanged = [(0, "P3".into()), (2, "P1".into())];
    decider
        .take_up(&mut books, std::slice::from_ref(&changed), &unchanged, &[])
        .unwrap();
    assert_eq!(standing(&books), [(2, true), (1, true), (0, true)]);
    assert_eq!(books.plan(1).unwrap(), &changed);
    assert_eq!(books.patient(0).row.state, Patient::Done);
    assert_eq!(books.patient(1).row.state, Patient::Waiting);
    decider
        .take_up(&mut books, &[], &[(0, "P2".into())], &[])
        .unwrap();
    assert_eq!(standing(&books), [(2, false), (0, true), (0, false)]);
}

#[tokio::test]
async fn outcomes_stay_in_the_store_until_a_decision_asks_and_leave_after_it() {
    let bench = Bench::new(vec![personalised("P1", 8.0), personalised("P2", 7.0)]);
    bench.run().await;
    let mut writer = Writer::open(bench.path()).await.unwrap();
    let loaded = writer.load(Extent::States).await.unwrap();
    let mut books = Books::new(bench.path(), loaded, 0).unwrap();
    books.select(|_| true);
    let n_absent = |books: &Books| books.tasks().values().filter(|t| t.is_absent()).count();
    let all = books.tasks().len();
    assert!(all > 10 && books.tasks().values().all(|t| t.spec.is_empty()));
    assert_eq!(n_absent(&books), all);

    // Another build decides again for patients that are over.
    let mut decider = Decider::default();
    decider.decide_all(&mut books, None, |_, _| true).unwrap();
    let asked = decider.questions();
    assert_eq!((asked.files.len(), asked.tasks.is_empty()), (0, false));
    books.recall(&mut writer, &asked.tasks).await.unwrap();
    assert_eq!(n_absent(&books), 0);
    decider.answer(&mut books, FilesSeen::default()).unwrap();
    assert!(decider.questions().is_empty());
    let is_done = |i| books.patient(i).row.state == Patient::Done;
    assert!(is_done(0) && is_done(1));
    assert_eq!(n_absent(&books), all);
    assert!(books.flush().is_empty() || books.outbox().is_empty());
}
