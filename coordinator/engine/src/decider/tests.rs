//! Decisions read nothing: they believe what they are told of files.

use cardiotwin_store::Writer;
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
